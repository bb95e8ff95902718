# SPDX-License-Identifier: Apache-2.0
"""An image sampled at points, with a sharp filter."""

from __future__ import annotations

from ...engine.core.image import pixels_of
from ...engine.core.window import Window
from ...engine.deferred import np, oiio

FILTER = "lanczos3"
REACH = 3  # px on each side that the filter reads


def at_points(pixels: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pixels, (h, w, c) float32, at points, (rows, columns, 2) px, black outside: (rows, columns, c) float32.

    For points about a pixel apart; `reduced` comes first where they are wider apart.
    """
    height, width, count = pixels.shape
    source, st, target = (_buffer(*size) for size in ((height, width, count), points.shape, (*points.shape[:2], count)))
    source.set_pixels(source.roi, np.ascontiguousarray(pixels))
    st.set_pixels(st.roi, (points / (width, height)).astype(np.float32))
    oiio.ImageBufAlgo.st_warp(target, source, st, FILTER, 0.0, 0, 1, False, False)
    return pixels_of(target, oiio.FLOAT)


def reduced(pixels: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels, (h, w, c) float32, resized to a smaller size."""
    source, target = _buffer(*pixels.shape), _buffer(height, width, pixels.shape[2])
    source.set_pixels(source.roi, np.ascontiguousarray(pixels))
    oiio.ImageBufAlgo.resize(target, source, FILTER)
    return pixels_of(target, oiio.FLOAT)


def _buffer(height: int, width: int, channels: int) -> oiio.ImageBuf:
    return oiio.ImageBuf(oiio.ImageSpec(width, height, channels, oiio.FLOAT))


def centers(window: Window) -> np.ndarray:
    """The pixel centers of a window, (rows, columns, 2) float64."""
    x, y = np.arange(window.left, window.right) + 0.5, np.arange(window.top, window.bottom) + 0.5
    return np.stack(np.broadcast_arrays(x[None], y[:, None]), -1)


def grown(mask: np.ndarray, reach: int) -> np.ndarray:
    """A mask grown by a square of that reach, px."""
    for axis in (0, 1):
        wide = np.pad(mask, [(reach, reach) if a == axis else (0, 0) for a in (0, 1)])
        total = np.cumsum(np.insert(wide.astype(np.int32), 0, 0, axis), axis)
        size = mask.shape[axis]
        span = 2 * reach + 1
        mask = np.take(total, np.arange(span, span + size), axis) > np.take(total, np.arange(size), axis)
    return mask
