# SPDX-License-Identifier: Apache-2.0
"""The start of a fill: thin parts of the region are peeled from the border inward, each pixel from the best patch.

From a random start, votes are a gray mean, which plain patches fit, and parts in which all patches reach fixed pixels
never leave it. Peeling continues their surroundings (Newson, Almansa, Fradet, Gousseau and Perez, Video Inpainting of
Complex Scenes, 2014). Wider parts start at random: peeled, they become plainer and darker than the photo.
"""

from __future__ import annotations

from ...engine.core.demand import SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ..patchmatch.field import Geometry
from ..projections.histograms import OUTSIDE

_VALUES = 1 << 19  # of all patches compared: from there on, only some patches of the source are
_AT_ONCE = 32  # patches of the region
BYTES = 8 * (2 * _VALUES + 4 * _AT_ONCE * (_VALUES // 75))  # at most: patches of 5 px have the most places


def peeled(
    field: SourceMap, stays: np.ndarray, exemplar: SomeRows, patches: np.ndarray, geometry: Geometry
) -> SourceMap:
    """The field with the patches over thin parts of the free pixels matched to what continues their surroundings.

    Parameters
    ----------
    field : SourceMap
        (rows, columns): a first guess.
    stays : (height, width, channels) int16
        The fixed pixels of the target, `OUTSIDE` where it is free.
    exemplar : (rows, columns, channels) int16
    patches : (exemplar_rows, exemplar_columns) bool
        Allowed patches.
    geometry : Geometry
    """
    side, target = geometry.patch, stays.astype(np.float64)
    known = stays[..., 0] != OUTSIDE
    thin = _thin(~known, side, geometry.wrap_y, geometry.wrap_x)
    if not thin.any() or not known.any():
        return field
    target[~known] = 0
    from_y, from_x = np.nonzero(patches)
    step = -(-len(from_y) * side * side * geometry.channels // _VALUES)
    from_y, from_x = from_y[::step], from_x[::step]
    rim = np.arange(side)
    pixels = np.asarray(exemplar[0 : geometry.exemplar_height])
    shown = pixels[from_y[:, None, None] + rim[:, None], from_x[:, None, None] + rim].reshape(len(from_y), -1)
    shown = shown.astype(np.float64)  # integers, so sums are exact in any order
    squares = shown * shown
    whole = squares.sum(1)

    def best(y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """The patch that fits the known pixels of each target patch best; the corners are (y, x)."""
        found = np.empty(len(y), np.int64)
        for begin in range(0, len(y), _AT_ONCE):
            part = slice(begin, begin + _AT_ONCE)
            rows = (y[part, None, None] + rim[:, None]) % geometry.height
            columns = (x[part, None, None] + rim) % geometry.width
            values = target[rows, columns].reshape(len(rows), -1)  # 0 where unknown
            seen = np.repeat(known[rows, columns].reshape(len(rows), -1), geometry.channels, 1)
            counted = whole if seen.all() else seen.astype(np.float64) @ squares.T
            found[part] = np.argmin(counted - 2 * values @ shown.T, 1)
        return found

    def corner(at: np.ndarray, count: int, wraps: bool, length: int) -> np.ndarray:
        return (at - side // 2) % length if wraps else np.clip(at - side // 2, 0, count - 1)

    while (edge := thin & ~known & _beside(known, geometry.wrap_y, geometry.wrap_x)).any():
        y, x = np.nonzero(edge)
        top = corner(y, geometry.rows, geometry.wrap_y, geometry.height)
        left = corner(x, geometry.columns, geometry.wrap_x, geometry.width)
        match = best(top, left)
        down, right = (y - top) % geometry.height, (x - left) % geometry.width
        target[y, x] = pixels[from_y[match] + down, from_x[match] + right]
        known[y, x] = True
    over = np.zeros((geometry.rows, geometry.columns), bool)
    y, x = np.nonzero(thin)
    for dy in rim:
        for dx in rim:
            top, left = y - dy, x - dx
            if geometry.wrap_y:
                top = top % geometry.height
            if geometry.wrap_x:
                left = left % geometry.width
            inside = (top >= 0) & (left >= 0) & (top < geometry.rows) & (left < geometry.columns)
            over[top[inside], left[inside]] = True
    y, x = np.nonzero(over)
    match = best(y, x)
    packed = np.array(field.packed)
    packed[y, x] = SourceMap.of(from_y[match], from_x[match]).packed
    return SourceMap(packed)


def _thin(free: np.ndarray, side: int, wrap_y: bool, wrap_x: bool) -> np.ndarray:
    """Free pixels of parts in which every pixel has a patch that reaches fixed pixels."""
    from scipy.ndimage import binary_opening  # scipy is not loaded before it is needed

    size = 2 * side - 1  # all patches of a pixel
    pad = (size, size)
    wide = np.pad(free, (pad, (0, 0)), "wrap") if wrap_y else np.pad(free, (pad, (0, 0)))
    wide = np.pad(wide, ((0, 0), pad), "wrap") if wrap_x else np.pad(wide, ((0, 0), pad))
    inside = slice(size, -size)
    thin: np.ndarray = free & ~binary_opening(wide, np.ones(pad))[inside, inside]
    return thin


def _beside(known: np.ndarray, wrap_y: bool, wrap_x: bool) -> np.ndarray:
    """Pixels next to known ones, diagonals included."""
    wide = np.pad(known, ((1, 1), (0, 0)), "wrap") if wrap_y else np.pad(known, ((1, 1), (0, 0)))
    wide = np.pad(wide, ((0, 0), (1, 1)), "wrap") if wrap_x else np.pad(wide, ((0, 0), (1, 1)))
    tall = wide[:-2] | wide[1:-1] | wide[2:]
    near: np.ndarray = tall[:, :-2] | tall[:, 1:-1] | tall[:, 2:]
    return near
