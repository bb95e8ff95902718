# SPDX-License-Identifier: Apache-2.0
"""Previews of a tile in use: repeated, and on a plane in perspective to the horizon (MJH17 section 5.2).

For arrays, and, as panels drawn by rows, for tiles of any size. Such a tile is read once. For each border between two
rows of a panel, the running sums of its columns are kept, in memory or in an unnamed file. A panel's rows are
differences of these.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from ...engine.color.config import as_float
from ...engine.color.lens import count_broken
from ...engine.core.demand import BAND_BYTES, bands, on_a_torus, stream
from ...engine.core.image import Part, pixels_of
from ...engine.core.scratch import empty_rows
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import BrokenValues

TILES_ACROSS = 2.0  # at the near edge of the plane
HORIZON = 1.0 / 8.0  # of the picture's height, from the top
WIDEST = 4  # most width of a panel, relative to its height
_NEAREST_HORIZON = 1e-3  # px below it, end of a row that reaches it
AT_ONCE = BAND_BYTES // 32  # values of a band, and of rows of a panel: several arrays of doubles
_BYTES = 120  # per value, measured
RowMaker = Callable[[int, int], "np.ndarray"]  # (first row, end) -> (rows, width, channels)


def area_means(image: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Exact means of a periodic image over intervals of its first axis: no aliasing, however long they are.

    Value i covers [i, i + 1). Intervals are from `start` to `stop`, (m,) float, anywhere. Returns (m, ...) float64.
    """
    n = len(image)
    sums = np.zeros((n + 1, *image.shape[1:]))
    np.cumsum(image, axis=0, out=sums[1:])

    def integral(t: np.ndarray) -> np.ndarray:
        turns = np.floor(t / n)
        inside = t - turns * n
        i = np.minimum(inside.astype(np.int64), n - 1)
        wide = (slice(None),) + (None,) * (image.ndim - 1)
        return turns[wide] * sums[-1] + sums[i] + (inside - i)[wide] * image[i]

    length = (stop - start)[(slice(None),) + (None,) * (image.ndim - 1)]
    return (integral(stop) - integral(start)) / length


def repeated(tile: np.ndarray, times: int, height: int) -> np.ndarray:
    """The tile repeated `times` x `times`, scaled to a height in px: (height, width, channels) float64."""
    width = max(1, round(height * tile.shape[1] / tile.shape[0]))
    down = np.linspace(0, times * tile.shape[0], height + 1)
    right = np.linspace(0, times * tile.shape[1], width + 1)
    rows = area_means(tile, down[:-1], down[1:])
    return area_means(rows.swapaxes(0, 1), right[:-1], right[1:]).swapaxes(0, 1)


def plane_in_perspective(tile: np.ndarray, width: int, height: int) -> np.ndarray:
    """A plane covered with the tile, from above in level view: the paper's stress test. float64.

    Every pixel is the mean of its footprint on the plane, a rectangle to first order. Above the horizon it is 0.
    """
    eye, away = eye_and_away(tile.shape[1], width, height)
    horizon = height - len(away) + 1
    rows = area_means(tile, away[1:], away[:-1])
    picture = np.zeros((height, width, tile.shape[2]))
    borders = np.arange(width + 1) - width / 2
    for y, row in enumerate(rows):
        across = borders * eye / (y + 0.5)
        picture[horizon + y] = area_means(row, across[:-1], across[1:])
    return picture


def eye_and_away(tile: int, width: int, height: int) -> tuple[float, np.ndarray]:
    """Height of the camera above the plane, and distances of the borders of rows, starting at the horizon.

    Both in px of the tile.
    """
    below = np.arange(height - round(height * HORIZON) + 1, dtype=np.float64)  # the borders, px below the horizon
    near = TILES_ACROSS * tile  # focal length `width`: `TILES_ACROSS` tiles are visible across at this distance
    eye = float(below[-1]) * near / width
    return eye, width * eye / np.maximum(below, _NEAREST_HORIZON)


def made_seamless(photo: np.ndarray) -> np.ndarray:
    """The photo blended with itself shifted by half along both axes, as in paint programs. float64.

    A baseline of MJH17 section 5.2. The shifted copy has its borders in the middle, where its weight is 0, and weight 1
    at the photo's borders: with u and v the distances from the middle lines, 0 .. 1, its weight is u v / (u v + (1 - u)
    (1 - v)).
    """
    v, u = (np.abs(2 * (np.arange(n) + 0.5) / n - 1) for n in photo.shape[:2])
    return blended(photo, np.roll(photo, (photo.shape[0] // 2, photo.shape[1] // 2), (0, 1)), v, u)


def blended(photo: np.ndarray, shifted: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Some rows of `made_seamless`, from those of the photo and of its shifted copy, and their v and u."""
    both, neither = v[:, None] * u[None, :], (1 - v)[:, None] * (1 - u)[None, :]
    share = (both / (both + neither))[..., None]
    return (1 - share) * photo + share * shifted


# --- tiles of any size ---


def bytes_needed(values: int) -> int:
    """Memory of panels, for that number of values in a row of an image or of all panels."""
    return _BYTES * max(AT_ONCE, values)


class RowIntegrals:
    """Integrals of a periodic image's columns from 0 to borders (px, anywhere), filled in row by row."""

    def __init__(self, borders: np.ndarray, shape: tuple[int, int, int], in_memory: bool):
        self._turns = np.floor(borders / shape[0])
        inside = borders - self._turns * shape[0]
        self._row = np.minimum(inside.astype(np.int64), shape[0] - 1)
        self._share = inside - self._row
        self._order = np.argsort(self._row, kind="stable")
        self._store = empty_rows((len(borders), *shape[1:]), np.float64, in_memory)
        self._whole = np.zeros(shape[1:])

    def add(self, first: int, rows: np.ndarray, sums: np.ndarray) -> None:
        """Add some rows, in order, with the sums of all rows before each of them and after the last."""
        begin, end = np.searchsorted(self._row[self._order], (first, first + len(rows)))
        for n in self._order[begin:end].tolist():
            at = int(self._row[n]) - first
            self._store[n : n + 1] = (sums[at] + self._share[n] * rows[at])[None]
        self._whole = sums[-1]

    def between(self, first: int, last: int) -> np.ndarray:
        """Integrals from border `first` to `last`, inclusive: (last - first + 1, columns, channels) float64."""
        return self._store[first : last + 1] + self._turns[first : last + 1, None, None] * self._whole


@dataclass(frozen=True)
class PreviewPanel:
    """One panel: its width in px, and its rows."""

    width: int
    rows: RowMaker
    integrals: RowIntegrals | None = None


def fitted(size: tuple[int, int], height: int) -> tuple[int, int]:
    """(width, height) of an image scaled to a height, or, where it is very wide, to the width of the widest panel."""
    high = max(1, min(height, round(WIDEST * height * size[1] / size[0])))
    return max(1, min(WIDEST * height, round(high * size[0] / size[1]))), high


def laid(size: tuple[int, int], channels: int, times: int, height: int, in_memory: bool) -> PreviewPanel:
    """An image of (width, height) repeated `times` x `times`, as in `repeated`; below a very wide one it is black."""
    width, height = fitted(size, height)
    down, right = np.linspace(0, times * size[1], height + 1), np.linspace(0, times * size[0], width + 1)
    integrals = RowIntegrals(down, (size[1], size[0], channels), in_memory)

    def rows(first: int, last: int) -> np.ndarray:
        means = np.diff(integrals.between(first, last), axis=0)
        means /= np.diff(down[first : last + 1])[:, None, None]
        return area_means(means.swapaxes(0, 1), right[:-1], right[1:]).swapaxes(0, 1)

    return PreviewPanel(width, _black_below(height, few_at_once(rows, size[0] * channels)), integrals)


def plane(size: tuple[int, int], channels: int, width: int, height: int, in_memory: bool) -> PreviewPanel:
    """A plane covered with it, as in `plane_in_perspective`."""
    eye, away = eye_and_away(size[0], width, height)
    horizon, across = height - len(away) + 1, np.arange(width + 1) - width / 2
    integrals = RowIntegrals(away, (size[1], size[0], channels), in_memory)

    def rows(first: int, last: int) -> np.ndarray:
        picture = np.zeros((last - first, width, channels))
        begin, end = max(0, first - horizon), max(0, last - horizon)
        if begin < end:
            means = -np.diff(integrals.between(begin, end), axis=0)
            means /= -np.diff(away[begin : end + 1])[:, None, None]
            for y, mean in enumerate(means, begin):
                borders = across * eye / (y + 0.5)
                picture[horizon + y - first] = area_means(mean, borders[:-1], borders[1:])
        return picture

    return PreviewPanel(width, few_at_once(rows, size[0] * channels), integrals)


def reduced(photo: Part, height: int) -> PreviewPanel:
    """A photo scaled to a height, as in `core.image.resized`."""
    whole, channels = photo.window, photo.spec.nchannels
    width, height = fitted(whole.size, height)
    scale = whole.width / width, whole.height / height
    reach = [math.ceil(max(1.0, n)) + 3 for n in scale]  # of a triangle filter

    def cell(window: Window) -> np.ndarray:
        (left, right), (top, bottom) = (
            (max(0, math.floor(first * n) - far), min(size, math.ceil(last * n) + far))
            for first, last, n, far, size in zip(window[:2], window[2:], scale, reach, whole.size, strict=True)
        )
        seen = Window(left, top, right, bottom)
        given, wanted = (oiio.ImageSpec(*size, channels, oiio.FLOAT) for size in (whole.size, (width, height)))
        source = oiio.ImageBuf(seen.apply_to(given))
        pixels = as_float(photo.read(seen.shifted(whole.left, whole.top)))
        source.set_pixels(source.roi, np.ascontiguousarray(pixels, np.float32))
        small = oiio.ImageBuf(window.apply_to(wanted))
        oiio.ImageBufAlgo.resize(small, source, "triangle")
        return pixels_of(small, oiio.FLOAT)

    def rows(first: int, last: int) -> np.ndarray:
        if (width, height) == whole.size:
            return as_float(photo.read(Window(whole.left, whole.top + first, whole.right, whole.top + last)))
        high = (last - first) * scale[1] + 2 * reach[1]
        across = max(1, int(AT_ONCE / (channels * high) - 2 * reach[0]) // math.ceil(scale[0]))
        cells = Window(0, first, width, last).cells(across, last - first)
        return np.concatenate([cell(window) for window in cells], 1)

    return PreviewPanel(
        width, _black_below(height, few_at_once(rows, round(whole.width * channels * max(1.0, scale[1]))))
    )


def look_through(tile: Part, panels: Iterable[PreviewPanel], name: str, seamless: bool = False) -> None:
    """Fill in the integrals of all panels of a tile in one pass. `seamless`: as in `made_seamless`.

    Raises BrokenValues for NaN or Inf in any channel, with the counts.
    """
    whole, filled = tile.window, [panel.integrals for panel in panels if panel.integrals is not None]
    broken, sums = np.zeros(2, np.int64), np.zeros((1, whole.width, tile.spec.nchannels))
    v, u = (np.abs(2 * (np.arange(n) + 0.5) / n - 1) for n in (whole.height, whole.width))
    for band, pixels in stream(tile, bands(tile, 4 * AT_ONCE)):
        rows = as_float(pixels)
        broken += count_broken(rows)
        if broken.any() or not filled:
            continue
        first = band.top - whole.top
        if seamless:
            shifted = as_float(on_a_torus(tile, band.shifted(0, -(whole.height // 2))))
            rows = blended(rows, np.roll(shifted, whole.width // 2, 1), v[first : first + band.height], u)
        sums = np.cumsum(np.concatenate([sums[-1:], rows]), axis=0)
        for one in filled:
            one.add(first, rows, sums)
    if broken.any():
        raise BrokenValues(name, broken)


def few_at_once(rows: RowMaker, values: int) -> RowMaker:
    """The same in pieces, for rows computed from that number of values."""
    count = max(1, AT_ONCE // values)

    def in_pieces(first: int, last: int) -> np.ndarray:
        return np.concatenate([rows(y, min(y + count, last)) for y in range(first, last, count)])

    return in_pieces


def _black_below(height: int, rows: RowMaker) -> RowMaker:
    """The same, for rows of an image of that height and black ones below."""

    def with_black(first: int, last: int) -> np.ndarray:
        drawn = rows(min(first, height - 1), max(min(last, height), min(first, height - 1) + 1))
        picture = np.zeros((last - first, *drawn.shape[1:]), drawn.dtype)
        count = max(0, min(last, height) - first)
        picture[:count] = drawn[:count]
        return picture

    return with_black
