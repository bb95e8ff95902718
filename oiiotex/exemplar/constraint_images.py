# SPDX-License-Identifier: Apache-2.0
"""Images that control a synthesis: pixels to inpaint, weights of source pixels, sigma for each pixel."""

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
    "Image that marks the pixels to resynthesize (first channel above half its range, or a nonzero label id). They"
    " are filled from patches outside the marked area; all other pixels are kept unchanged."
)
WEIGHT = (
    "Image of relative weights, in its first channel: pixels of weight 2 are used twice as often as pixels of weight"
    " 1, and pixels of weight 0 are never used."
)
SIGMAMAP = (
    "Float image of the result's size whose first channel is sigma, in pixels, at each pixel. Use it to keep"
    " structure in some areas and even out others."
)
_LEAST_SIGMA = 0.5

Run = Callable[[Recipe, Constraints], Synthesis]


def marked_pixels(inpaint: Image, exemplar: Image) -> np.ndarray:
    """The pixels to resynthesize, (height, width) bool; raises ImageError if all are marked."""
    marked = mask_pixels(laid_over(inpaint.first, exemplar, "inpaint"))
    if marked.all():
        raise ImageError(
            f"inpaint marks every pixel of {exemplar.source}: no source pixels remain; mark fewer, or omit inpaint to"
            " resynthesize the whole photo"
        )
    return marked


def weights_of(weight: Image, exemplar: Image) -> np.ndarray:
    """Relative weights of the exemplar's pixels, (height, width) float32 >= 0, not 0 everywhere."""
    values = _channel(laid_over(weight.first, exemplar, "weight"))
    wrong = np.count_nonzero(~(np.isfinite(values) & (values >= 0)))
    if wrong:
        raise ImageError(f"weight has {wrong} negative, NaN or Inf values: expected numbers >= 0")
    if not values.any():
        raise ImageError("weight is 0 everywhere: expected at least one positive value")
    return values


def sigmas_of(sigmamap: Image, width: int, height: int) -> np.ndarray:
    """Sigma at each pixel of the result, (height, width) float32, px."""
    part = sigmamap.first
    if (part.spec.width, part.spec.height) != (width, height):
        size = f"{part.spec.width}x{part.spec.height}"
        raise ImageError(f"sigmamap is {size}, but the result is {width}x{height}: sizes must match")
    if not np.issubdtype(dtype_of(part.spec), np.floating):
        raise ImageError(f"sigmamap is {part.spec.format}: expected a float image with sigma in pixels")
    values = _channel(part)
    broken = np.count_nonzero(~np.isfinite(values))
    if broken:
        raise ImageError(f"sigmamap has {broken} NaN or Inf values: expected numbers >= {_LEAST_SIGMA:g} px")
    small = np.count_nonzero(values < _LEAST_SIGMA)
    if small:
        raise ImageError(
            f"sigmamap has {small} values below {_LEAST_SIGMA:g} px (minimum {values.min():g}):"
            " expected sigma in pixels"
        )
    return np.minimum(values, np.float32(2 * max(width, height)))  # beyond twice the tile the window is flat


def _channel(part: Part) -> np.ndarray:
    return as_float(part.pixels()[..., channels_of(part.spec).color[0]])


def remade_source(
    marked: np.ndarray, opaque: np.ndarray | None, recipe: Recipe, constraints: Constraints, run: Run
) -> SourceMap:
    """The source of every pixel of a photo of which only the marked pixels are resynthesized, by `run`.

    Only the surroundings of the marked pixels that patches and local histograms reach are synthesized. Recipe and
    constraints are for the whole photo; new pixels match the photo's color where it is opaque.
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
    """The marked pixels and all that influence them; the full extent of an axis that wraps."""
    reach = 2 * recipe.patch + int(3 * (recipe.sigma or 0))
    ends = []
    for axis, wraps in ((0, recipe.wrap_x), (1, recipe.wrap_y)):
        hit = np.flatnonzero(marked.any(axis))
        n = marked.shape[1 - axis]
        ends.append((0, n) if wraps else (max(0, int(hit[0]) - reach), min(n, int(hit[-1]) + 1 + reach)))
    (left, right), (top, bottom) = ends
    return Window(left, top, right, bottom)
