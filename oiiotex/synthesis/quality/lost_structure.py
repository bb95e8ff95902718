# SPDX-License-Identifier: Apache-2.0
"""Structure of a photo that its tile has lost: of its lattice, of its texture."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from typing import TYPE_CHECKING, cast

from ...analysis.regularity.autocorrelation import (
    Autocorrelation,
    autocorrelation,
    high_passed,
    wrapped_autocorrelation,
)
from ...analysis.regularity.lattice import Lattice
from ...engine.core.demand import MadeRows, SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.errors import ImageError, modifier, spelled, texture_filter
from ..patchmatch.constraints import Octaves
from ..patchmatch.field import allowed_patches
from ..patchmatch.optimization import grid_image
from ..patchmatch.recipe import Recipe, geometry_at
from ..patchmatch.use_prices import Lost, lost_texture

if TYPE_CHECKING:
    from ...analysis.regularity.offset_prices import InStep

log = logging.getLogger("oiiotex")

_MUCH = 0.08  # share of a tile above which lost texture is reported
_TOO_MUCH = 0.1  # the same for an error, if most of the photo is flat
_SIDE = 1024  # px, maximum side for measuring regularity
_BYTES = 288  # per pixel


def regularity_of(photo: SomeRows, source: SourceMap, recipe: Recipe) -> dict[str, float]:
    """Regularity of a photo, (height, width, 3) Lab, and of its tile, on the lattice that the recipe keeps."""
    kept = cast("InStep", recipe.in_step)
    height, width = photo.shape[:2]
    own = MadeRows(
        (height, width), np.uint64,
        lambda first, last: SourceMap.of(np.arange(first, last)[:, None], np.arange(width)[None, :], 32).packed,
    )  # fmt: skip
    lattice, torus = replace(kept.lattice, frequencies=kept.wanted), recipe.wrap_x and recipe.wrap_y
    return {
        "regular_photo": _regularity(SourceMap(cast("np.ndarray", own), 32), photo, kept.lattice, False),
        "regular": _regularity(source, photo, lattice, torus),
    }


def _regularity(places: SourceMap, photo: SomeRows, lattice: Lattice, torus: bool) -> float:
    """Regularity of those pixels of a photo: above `_SIDE` a side in the middle, subsampled for long periods."""
    size = places.packed.shape
    most, step = max(size), 1
    if most > _SIDE:
        most = max(_SIDE, math.ceil(4 * np.abs(lattice.first_vectors()).max()))
        step, torus = math.ceil(most / _SIDE), False
    (top, left), (high, wide) = ([max(0, n - most) // 2 for n in size], [min(n, most) for n in size])
    seen = places[top : top + high][::step, left : left + wide : step].gather(photo)
    return float(min(peaks_over_floor(seen, lattice.scaled(1 / step, 1 / step), torus)))


def regularity_bytes(*sizes: tuple[int, int]) -> int:
    """Memory of `regularity_of`, for images of these (width, height)."""
    return _BYTES * max(min(width * height, _SIDE**2) for width, height in sizes)


def texture_lost(exemplar: SomeRows, usable: np.ndarray | None, source: SourceMap, recipe: Recipe) -> Lost:
    """The texture that a tile copied from an exemplar lacks, however it was made; as for `Synthesis.lost`."""
    geometry = geometry_at(recipe, exemplar.shape, 1.0)
    image = grid_image(Octaves(exemplar, usable), geometry, isinstance(exemplar, np.ndarray))
    return lost_texture(source, image, allowed_patches(usable, geometry), geometry)


def say_what_was_lost(flag: str, lost: Lost | None) -> None:
    """Log how much of a photo's texture its tile has lost, and warn if it is much.

    Parameters
    ----------
    flag : str
        Name of the op.
    lost : Lost or None
        None: it was not measured.

    Raises
    ------
    ImageError
        More than half of it is lost, or much of it if most of the photo is flat.
    """
    if lost is None:
        return
    shares = f"{100 * lost.own:.0f} % of the photo is texture, {100 * lost.shown:.0f} % of the tile"
    log.info("%s: %s; the rest is flat (at most an eighth of the texture's activity)", flag, shares)
    if lost.share <= _MUCH:
        return
    if lost.own >= 1 - _MUCH:  # flat areas are not the cause
        log.warning("%s: texture is lost: %s; increase iterations", flag, shares)
        return
    offer = f"exclude flat areas with {modifier(mask=True)} and the mask of {texture_filter('dominant')}"
    if lost.shown < 0.5 * lost.own or (lost.own < 0.5 and lost.share > _TOO_MUCH):
        raise ImageError(f"too much of the texture is lost: {shares}", hint=offer)
    log.warning("%s: texture is lost: %s; %s", flag, shares, spelled(offer))


def peaks_over_floor(values: np.ndarray, lattice: Lattice, wraps: bool) -> np.ndarray:
    """The normalized autocorrelation at the lattice's first three vectors, minus its mean over the cell around each.

    Parameters
    ----------
    values : (height, width, channels) float32
        CIE Lab.
    lattice : Lattice
        Lattice of these pixels.
    wraps : bool
        The image is a torus.

    Returns
    -------
    (3,) float64
        NaN at a vector that is too long for the image.
    """
    if wraps:
        likeness = wrapped_autocorrelation(values)
    else:
        everywhere = np.ones(values.shape[:2], bool)
        likeness = autocorrelation(high_passed(values.astype(np.float64), everywhere), everywhere)
    return np.array([_peak_over_floor(likeness, lattice, vector) for vector in lattice.first_vectors()])


def _peak_over_floor(likeness: Autocorrelation, lattice: Lattice, vector: np.ndarray) -> float:
    """The value at the pixels nearest to a vector: fractions of a pixel are not resolved."""
    x, y = (grid - at for grid, at in zip(likeness.offsets(), vector, strict=True))
    phases = [np.abs(x * fx + y * fy) for fx, fy in lattice.frequencies]
    if lattice.rank == 1:  # a square around it
        phases.append(np.abs(y * lattice.frequencies[0, 0] - x * lattice.frequencies[0, 1]))
    says = likeness.weight > 0
    cell = says & (np.maximum(*phases) <= 0.5)
    near = says & (np.maximum(np.abs(x), np.abs(y)) < 1.5)
    return float(likeness.ncc[near].max() - likeness.ncc[cell].mean()) if near.any() else float("nan")
