# SPDX-License-Identifier: Apache-2.0
"""What -v says of a texture: how stationary, faithful, seamless, sharp and new it is, by numbers alone."""

from __future__ import annotations

import logging

import numpy as np

from ..analysis.copies import copies_by_source
from ..analysis.quality import low_frequency, seam_ratio, sharpness, wrap_percentile
from ..analysis.stationarity import stationarity_cost, texture_cost
from ..session import Session
from ..synthesis.patchmatch import match_patches, unpack
from ..synthesis.stationarize import Recipe, Synthesis
from .measures import cost_text

log = logging.getLogger("oiiotex")


def report(name: str, photo: np.ndarray, made: Synthesis, recipe: Recipe, session: Session) -> None:
    """Log the measures of a synthesis from a photo, (height, width, 3) Lab, before and after where both have them."""
    y, x = unpack(made.source)
    tile = photo[y, x]
    sigma, measure, order = recipe.sigma or max(recipe.width, recipe.height) / 32, recipe.measure, recipe.order
    before = stationarity_cost(photo, sigma, False, False, measure, order)
    after = stationarity_cost(tile, sigma, recipe.wrap_x, recipe.wrap_y, measure, order, like=photo)
    log.info("%s: %s at sigma %g px", name, cost_text(after, measure, order, before), sigma)
    wrap = recipe.wrap_x, recipe.wrap_y
    field = match_patches(session.device, tile, photo, made.field, recipe.patch, wrap, recipe.seed, session.budget)
    cost = texture_cost(tile, photo, *unpack(field), recipe.patch)
    log.info("%s: texture cost %.2f Lab^2 per pixel (MJH17 eq. 5, upper bound by PatchMatch)", name, cost)
    light, light_before = tile[..., 0], photo[..., 0]
    for axis, letter, wraps in ((1, "x", recipe.wrap_x), (0, "y", recipe.wrap_y)):
        if wraps:
            ratios = seam_ratio(light_before, axis), seam_ratio(light, axis)
            rank = wrap_percentile(light, axis)
            log.info(
                "%s: seam ratio %s %.2f -> %.2f (1 is invisible); %.0f %% of the lines inside are quieter",
                name, letter, *ratios, rank,
            )  # fmt: skip
    slow = low_frequency(light_before), low_frequency(light)
    log.info("%s: low-frequency energy %.2f -> %.2f Lab (L blurred with sigma 16 px)", name, *slow)
    loss = 1.0 - sharpness(light) / max(sharpness(light_before), 1e-12)
    log.info("%s: sharpness loss %.1f %% (mean |L - blurred L|, negative: sharper than the photo)", name, 100 * loss)
    found = copies_by_source(y, x, photo.shape[:2])
    log.info(
        "%s: %.0f %% of the pixels lie in verbatim copies of 8x8 px; the most repeated region of 32x32 is shown %.1f"
        " times, %.1f times its share", name, 100 * found.exact, found.shown, found.over_fair,
    )  # fmt: skip
