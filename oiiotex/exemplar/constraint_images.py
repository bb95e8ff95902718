# SPDX-License-Identifier: Apache-2.0
"""Images that prescribe what a synthesis does: where, how often parts are used, with which sigma."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from ..color.config import as_float
from ..core.image import Image, Part, channels_of, dtype_of
from ..core.source_map import SourceMap
from ..core.window import Window
from ..deferred import np
from ..errors import ImageError
from ..patchmatch.constraints import Constraints, FixedPixels
from ..patchmatch.optimization import Synthesis
from ..patchmatch.recipe import Recipe
from .exemplar_masks import laid_over, mask_pixels

INPAINT = (
    "make only these pixels anew, from patches outside of them, and leave the rest to the bit: above one half of the"
    " first channel's range; of ids: all but 0"
)
WEIGHT = "how often pixels of the photo are used beside others, by the first channel: 0 never, 2 twice as often as 1"
SIGMAMAP = "sigma for each pixel of the result, in px, by the first channel of floats"
_LEAST_SIGMA = 0.5

Run = Callable[[Recipe, Constraints], Synthesis]


def marked_pixels(inpaint: Image, exemplar: Image) -> np.ndarray:
    """The pixels that are to be made anew, (height, width) bool; raises ImageError where these are all."""
    marked = mask_pixels(laid_over(inpaint.first, exemplar, "inpaint"))
    if marked.all():
        raise ImageError(
            f"inpaint covers all of {exemplar.source}: nothing is left to take patches from; leave it out to make the"
            " whole anew"
        )
    return marked


def weights_of(weight: Image, exemplar: Image) -> np.ndarray:
    """How often pixels of the exemplar are to be used, (height, width) float32 >= 0, not 0 everywhere."""
    values = _channel(laid_over(weight.first, exemplar, "weight"))
    wrong = np.count_nonzero(~(np.isfinite(values) & (values >= 0)))
    if wrong:
        raise ImageError(f"weight has {wrong} values that are negative, NaN or Inf: expected numbers >= 0")
    if not values.any():
        raise ImageError(f"weight is 0 everywhere: no pixel of {exemplar.source} may be used")
    return values


def sigmas_of(sigmamap: Image, width: int, height: int) -> np.ndarray:
    """Sigma at each pixel of the result, (height, width) float32, px."""
    part = sigmamap.first
    if (part.spec.width, part.spec.height) != (width, height):
        size = f"{part.spec.width}x{part.spec.height}"
        raise ImageError(f"sigmamap is {size}, the result {width}x{height}: they must be alike")
    if not np.issubdtype(dtype_of(part.spec), np.floating):
        raise ImageError(f"sigmamap is of {part.spec.format}: sigmas are in pixels, in a file of floats")
    values = _channel(part)
    broken = np.count_nonzero(~np.isfinite(values))
    if broken:
        raise ImageError(f"sigmamap has {broken} NaN or Inf values: expected numbers >= {_LEAST_SIGMA:g} px")
    small = np.count_nonzero(values < _LEAST_SIGMA)
    if small:
        raise ImageError(
            f"sigmamap has {small} values below {_LEAST_SIGMA:g} px, the least is {values.min():g}: sigmas are in"
            " pixels, in a file of floats"
        )
    return np.minimum(values, np.float32(2 * max(width, height)))  # twice the tile is a flat window already


def _channel(part: Part) -> np.ndarray:
    return as_float(part.pixels()[..., channels_of(part.spec).color[0]])


def remade_source(
    marked: np.ndarray, opaque: np.ndarray | None, recipe: Recipe, constraints: Constraints, run: Run
) -> SourceMap:
    """Where every pixel of a photo comes from when only the marked ones are made anew, by `run`.

    What is synthesized is the part of the photo around the marked pixels, as far as patches and local histograms look.
    Recipe and constraints are for the whole photo; new pixels go with its color where it is opaque.
    """
    height, width = marked.shape
    source = SourceMap.of(np.arange(height)[:, None], np.arange(width))
    if not marked.any():
        return source
    window = _surroundings(marked, recipe)
    cut = window.inside(Window(0, 0, width, height))
    is_fixed = ~marked if opaque is None else opaque & ~marked
    fixed = FixedPixels(is_fixed[cut], source[cut], is_goal=True)
    sigmas = None if constraints.sigmas is None else constraints.sigmas[cut]
    in_step = None if recipe.in_step is None else recipe.in_step.moved(window.left, window.top)
    small = dataclasses.replace(recipe, width=window.width, height=window.height, in_step=in_step)
    synthesis = run(small, dataclasses.replace(constraints, fixed=fixed, sigmas=sigmas))
    source.packed[cut] = np.where(marked[cut], synthesis.source.packed, source.packed[cut])
    return source


def _surroundings(marked: np.ndarray, recipe: Recipe) -> Window:
    """The marked pixels and what decides on them; all of an axis that wraps."""
    reach = 2 * recipe.patch + int(3 * (recipe.sigma or 0))
    ends = []
    for axis, wraps in ((0, recipe.wrap_x), (1, recipe.wrap_y)):
        hit = np.flatnonzero(marked.any(axis))
        n = marked.shape[1 - axis]
        ends.append((0, n) if wraps else (max(0, int(hit[0]) - reach), min(n, int(hit[-1]) + 1 + reach)))
    (left, right), (top, bottom) = ends
    return Window(left, top, right, bottom)
