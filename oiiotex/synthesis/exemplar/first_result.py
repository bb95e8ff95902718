# SPDX-License-Identifier: Apache-2.0
"""Check the first result against its photo: retry with larger structures, or warn."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from ...engine.color.config import as_float
from ...engine.core.demand import MadeRows, SomeRows, first_channels
from ...engine.core.image import Part, channels_of
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.stats import Stats
from ..patchmatch.constraints import Constraints
from ..patchmatch.optimization import Synthesis
from ..patchmatch.recipe import Recipe
from ..quality.fidelity import FAIR, GOOD, Fidelity, fidelity
from ..quality.seam_measures import seam_ratio
from .exemplar_op import ExemplarPixels

if TYPE_CHECKING:
    from ...engine.session.progress import Progress

log = logging.getLogger("oiiotex")

TILES = 1.15  # seam ratio up to which a photo already tiles
ONE_TILE = "The photo may have too few elements for a texture, or more than one texture; crop it"
SET_OF_TILES = "Tiles must be several times larger than the photo's elements"
_LEAST = 48  # px; shorter sides are not tested for tiling


def fidelity_of(
    seen: ExemplarPixels, source: SourceMap, recipe: Recipe, original: SomeRows | None = None
) -> Fidelity | None:
    """Fidelity of a result that is copied from those pixels; None if it is too small to measure.

    `original`: Lab of the photo before flattening, (height, width, 3).
    """
    photo = first_channels(seen.values, 3)

    def rows(first: int, last: int) -> np.ndarray:
        return source[first:last].gather(photo)

    result = MadeRows((*source.packed.shape, 3), np.float32, rows)
    return fidelity(photo, seen.usable, result, (recipe.wrap_y, recipe.wrap_x), source, original)


def better_of(
    flag: str,
    run: Callable[..., Synthesis],
    constraints: Constraints,
    recipe: Recipe,
    other: Recipe | None,
    seen: ExemplarPixels,
    stats: Stats,
    progress: Progress,
    original: SomeRows | None = None,
) -> tuple[Synthesis, Fidelity | None, Recipe]:
    """The result of the first recipe, or of the other one if the first is not good and the other is better.

    `progress` is that of one run; `original` as of `fidelity_of`.
    """
    first = run(recipe, constraints)
    with stats.time("fidelity"):
        kept = fidelity_of(seen, first.source, recipe, original)
    if other is None or kept is None or kept.value >= GOOD:
        return first, kept, recipe
    log.info("%s: %s with %s; trying %s", flag, kept, recipe.scales, other.scales)
    progress.lengthen(1)
    second = run(other, constraints)
    with stats.time("fidelity"):
        better = fidelity_of(seen, second.source, other, original)
    if better is None or better.value <= kept.value:
        return first, kept, recipe
    return second, better, other


def say_fidelity(flag: str, kept: Fidelity | None, recipe: Recipe, warn: bool, advice: str = ONE_TILE) -> None:
    """Log the chosen scales; with `warn`, warn if the result is poor, with that advice."""
    if kept is None:
        return
    log.info("%s: scales chosen: %s", flag, recipe.scales)
    if warn and kept.value < FAIR:
        log.warning("%s: %s. %s", flag, kept, advice)


def hint_that_it_tiles(flag: str, photo: Part) -> None:
    """Warn if a photo already tiles."""
    if min(photo.window.size) < _LEAST:
        return
    gray = as_float(photo.pixels()[..., list(channels_of(photo.spec).color)]).mean(-1)
    ratios = [seam_ratio(gray, axis) for axis in (1, 0)]
    if max(ratios) <= TILES and all(map(math.isfinite, ratios)):
        log.warning(
            "%s: the photo already tiles (seam ratio %.2f along x, %.2f along y); to keep its layout, use"
            " --texflatten:tiled=xy instead",
            flag, *ratios,
        )  # fmt: skip
