# SPDX-License-Identifier: Apache-2.0
"""Statistics of an image on a coarse grid of cells, and smooth surfaces read from such a grid.

An image of any size is looked at once, band by band. What is summed per cell are whole numbers, so neither the order
nor the cut into bands can be seen in the sums. Grids are smoothed by a Gaussian that counts pixels: what lies beyond
the border, or under alpha 0, is missing and not black. Surfaces are cubic B-splines over the grid: no creases, no
overshoot, and the same bits for a pixel whatever window it is asked in.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..color import BrokenValues
from ..images import Image
from ..session import Session
from ..tiles import BAND_BYTES, bands, stream
from ..windows import Window
from ..working import Lens

MARGIN = 2  # cells beyond each border: a B-spline looks that far
_PIECE_PIXELS = 1 << 17
_SPLINE_VARIANCE, _BOX_VARIANCE = 1.0 / 3.0, 1.0 / 12.0  # of a cubic B-spline and of a cell, in squared cells


@dataclass(frozen=True)
class Cells:
    """Square cells from the data window's top left corner on; the last ones are cut.

    Attributes
    ----------
    window : Window
        The data window.
    side : int
        Of a cell, px.
    """

    window: Window
    side: int

    @property
    def across(self) -> int:
        """How many columns of cells."""
        return -(-self.window.width // self.side)

    @property
    def down(self) -> int:
        """How many rows of cells."""
        return -(-self.window.height // self.side)

    def row_of(self, y: int) -> int:
        """The row of cells in which a row of pixels lies."""
        return (y - self.window.top) // self.side

    def pieces(self, band: Window) -> Iterator[Window]:
        """Full-width pieces of a band, small enough for caches, none of which crosses a border between cells."""
        rows = max(1, _PIECE_PIXELS // band.width)
        for rows_of_cells in band.cells(band.width, self.side, origin=(self.window.left, self.window.top)):
            yield from rows_of_cells.cells(band.width, rows)

    def starts(self) -> np.ndarray:
        """First column of every cell, (across,)."""
        return np.arange(self.across) * self.side


def survey(
    image: Image,
    lens: Lens,
    cells: Cells,
    session: Session,
    look: Callable[[np.ndarray, np.ndarray | None], np.ndarray],
    keep: Callable[[int, np.ndarray], None],
) -> None:
    """Look at the first part once, on all threads.

    Parameters
    ----------
    image, lens, cells, session
    look : callable
        (values, opaque) of rows that lie in one row of cells -> sums of them. Runs on several threads.
    keep : callable
        (row of cells, sums), called piece after piece by one thread.

    Raises
    ------
    BrokenValues
        NaN or Inf: all are counted.
    """
    part = image.first
    broken: np.ndarray | None = None

    def seen(rows: np.ndarray) -> np.ndarray | BrokenValues:
        try:
            with np.errstate(over="ignore"):  # values are cut to a range in the end
                return look(*lens.values(rows))
        except BrokenValues as error:
            return error

    for band, pixels in stream(part, bands(part, BAND_BYTES)):
        pieces = list(cells.pieces(band))
        rows = [pixels[piece.inside(band)] for piece in pieces]
        for piece, found in zip(pieces, session.spread(seen, rows), strict=True):
            if isinstance(found, BrokenValues):
                broken = found.counts if broken is None else broken + found.counts
            else:
                keep(cells.row_of(piece.top), found)
            if (piece.bottom - cells.window.top) % cells.side == 0 or piece.bottom == cells.window.bottom:
                session.advance(cells.row_of(piece.top) + 1, cells.down)
    if broken is not None:
        raise BrokenValues(lens.name, broken)


# --- smoothing a grid ---


def smoothing_taps(sigma: float, side: int) -> np.ndarray:
    """Gaussian weights over cells, (2 radius + 1,): with the cells' own width and the spline it comes to `sigma` px."""
    in_cells = math.sqrt(max(0.0, (sigma / side) ** 2 - _SPLINE_VARIANCE - _BOX_VARIANCE))
    radius = max(1, math.ceil(3.5 * in_cells))
    away = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 * (away / max(in_cells, 1e-3)) ** 2)
    return weights / weights.sum()


def padded(grid: np.ndarray) -> np.ndarray:
    """A grid (down, across, ...) with `MARGIN` empty cells around it."""
    return np.pad(grid, [(MARGIN, MARGIN), (MARGIN, MARGIN)] + [(0, 0)] * (grid.ndim - 2))


def correlated(grid: np.ndarray, taps_y: np.ndarray, taps_x: np.ndarray) -> np.ndarray:
    """sum_k taps[k] grid[i + k - radius] along both axes; nothing lies beyond the grid. Summed in one fixed order."""
    return _along(_along(grid, taps_y, 0), taps_x, 1)


def _along(grid: np.ndarray, taps: np.ndarray, axis: int) -> np.ndarray:
    radius, n = len(taps) // 2, grid.shape[axis]
    moved = np.moveaxis(grid, axis, 0)
    out = np.zeros(moved.shape)
    for k in range(max(-radius, 1 - n), min(radius, n - 1) + 1):  # further away there are no cells
        here = slice(max(0, -k), n - max(0, k))
        there = slice(max(0, k), n - max(0, -k))
        out[here] += taps[k + radius] * moved[there]
    return np.moveaxis(out, 0, axis)


# --- reading a grid as a surface ---


class Surface:
    """A cubic B-spline over a grid of cells.

    Parameters
    ----------
    grid : (down + 2 MARGIN, across + 2 MARGIN, fields) float
        Values at the cells' centres, with the margin.
    cells : Cells
    """

    _KEPT = 16  # rows of the grid, spread to full width

    def __init__(self, grid: np.ndarray, cells: Cells):
        self._grid, self._cells = np.ascontiguousarray(grid, np.float32), cells
        self._first, self._weights = _spline(cells.window.width, cells.side)
        self._first_row, self._row_weights = _spline(cells.window.height, cells.side)
        self._rows: OrderedDict[int, np.ndarray] = OrderedDict()
        self._lock = threading.Lock()

    def row(self, y: int, left: int, right: int) -> np.ndarray:
        """Its values at the pixels of a row, y, left and right in image coordinates: (right - left, fields) float32."""
        at = y - self._cells.window.top
        part = slice(left - self._cells.window.left, right - self._cells.window.left)
        first, weights = self._first_row[at], self._row_weights[at]
        out = self._spread(first)[part] * weights[0]
        term = np.empty_like(out)
        for k in range(1, 4):
            out += np.multiply(self._spread(first + k)[part], weights[k], out=term)
        return out

    def values(self, window: Window) -> np.ndarray:
        """(height, width, fields) float32."""
        rows = [self.row(y, window.left, window.right) for y in range(window.top, window.bottom)]
        return np.stack(rows)

    def _spread(self, j: int) -> np.ndarray:
        """Row j of the grid interpolated to all columns of pixels, (width, fields)."""
        with self._lock:
            found = self._rows.get(j)
            if found is not None:
                self._rows.move_to_end(j)
                return found
        line = self._grid[j]
        out = line[self._first] * self._weights[:, :1]
        for k in range(1, 4):
            out += line[self._first + k] * self._weights[:, k : k + 1]
        with self._lock:
            self._rows[j] = out
            while len(self._rows) > self._KEPT:
                self._rows.popitem(last=False)
        return out


def _spline(size: int, side: int) -> tuple[np.ndarray, np.ndarray]:
    """For every pixel of an axis: the first of four cells (counted with the margin), and their weights (size, 4)."""
    place = (np.arange(size) + 0.5) / side - 0.5 + MARGIN
    cell = np.floor(place).astype(np.int64)
    t = place - cell
    weights = np.stack(
        [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1
    ) / 6.0  # fmt: skip
    return cell - 1, weights.astype(np.float32)
