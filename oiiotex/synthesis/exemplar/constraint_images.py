# SPDX-License-Identifier: Apache-2.0
"""Images that control a synthesis: weights of source pixels, sigma for each pixel."""

from __future__ import annotations

from ...engine.color.config import as_float
from ...engine.core.image import Image, Part, channels_of, dtype_of
from ...engine.deferred import np
from ...engine.errors import ImageError
from .exemplar_masks import laid_over

WEIGHT = (
    "Image of relative weights, in its first channel: pixels of weight 2 are used twice as often as pixels of weight"
    " 1, and pixels of weight 0 are never used."
)
SIGMAMAP = (
    "Float image of the result's size whose first channel is sigma, in pixels, at each pixel. Use it to keep"
    " structure in some areas and even out others."
)
_LEAST_SIGMA = 0.5


def weights_of(weight: Image, exemplar: Image) -> np.ndarray:
    """Relative weights of the exemplar's pixels, (height, width) float32 >= 0, not 0 everywhere."""
    values = _channel(laid_over(weight.first, exemplar, "weightmap"))
    wrong = np.count_nonzero(~(np.isfinite(values) & (values >= 0)))
    if wrong:
        raise ImageError(f"weightmap has {wrong} negative, NaN or Inf values: expected numbers >= 0")
    if not values.any():
        raise ImageError("weightmap is 0 everywhere: expected at least one positive value")
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
    return as_float(part.pixels()[..., channels_of(part.spec).first])
