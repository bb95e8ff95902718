# SPDX-License-Identifier: Apache-2.0
"""Coarse grids of cells that hold statistics of an image, and smooth surfaces evaluated from such a grid.

`Cells` of a scanned image cover whole pixels. Their sums are integers, so neither the order of the summands nor the
division into pieces changes them. A `CellGrid` fills a domain evenly, as a torus requires.
Grids are smoothed by a Gaussian normalized by the pixel count: pixels beyond the border, or with alpha 0, are missing,
not black. Surfaces are cubic B-splines over cells, without creases or overshoot, and bit-identical for a pixel in any
window.
"""

from __future__ import annotations

import functools
import itertools
import math
import threading
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass

from ...engine.core.elementary import gaussian_taps
from ...engine.core.window import Domain, Window
from ...engine.deferred import np

CELLS_PER_SIGMA = 2.5
LARGEST_CELL = 512  # px; bounds the number of values in a cell
_ROUNDING = 1e-2  # bound of the error of places that kernels compute in floats, in cells or px
MARGIN = 2  # cells beyond each border: the support of a B-spline
# in squared cells: of a cubic B-spline, of a cell, and of the tents by which a `CellGrid` is gathered and read
_SPLINE_VARIANCE, _BOX_VARIANCE, _TENTS_VARIANCE = 1.0 / 3.0, 1.0 / 12.0, 1.0 / 3.0


@dataclass(frozen=True)
class Cells:
    """Cells from the top left corner of the data window.

    Along an axis that does not wrap, each has the length `side`, and the last one is cropped. Around a torus their
    lengths are as equal as whole pixels allow, so that the grid closes.

    Attributes
    ----------
    window : Window
        The data window.
    side : int
        Side of a cell, px. Around a torus: approximate.
    wraps : (bool, bool)
        The image is a torus along y, along x.
    """

    window: Window
    side: int
    wraps: tuple[bool, bool] = (False, False)

    @classmethod
    def for_sigma(
        cls, window: Window, sigma: float, per_sigma: float = CELLS_PER_SIGMA,
        wraps: tuple[bool, bool] = (False, False),
    ) -> Cells:  # fmt: skip
        """`per_sigma` cells per sigma, each from 1 to `LARGEST_CELL` px.

        Parameters
        ----------
        sigma : float
            px.
        wraps : (bool, bool)
            As in `Cells`.
        """
        return cls(window, max(1, min(LARGEST_CELL, round(sigma / per_sigma))), wraps)

    @property
    def across(self) -> int:
        """Number of columns of cells."""
        return self._count(self.window.width, self.wraps[1])

    @property
    def down(self) -> int:
        """Number of rows of cells."""
        return self._count(self.window.height, self.wraps[0])

    @property
    def steps(self) -> tuple[float, float]:
        """Distance between centers of neighboring cells along y, along x, px."""
        sizes, counts = (self.window.height, self.window.width), (self.down, self.across)
        y, x = (size / n if wraps else self.side for size, n, wraps in zip(sizes, counts, self.wraps, strict=True))
        return y, x

    def row_of(self, y: int) -> int:
        """The row of cells of a row of pixels."""
        return int(np.searchsorted(self._tops, y - self.window.top, "right")) - 1

    def rows(self, window: Window) -> Iterator[Window]:
        """The pieces of a full-width window, each within one row of cells."""
        tops = self._tops + self.window.top
        inner = tops[(tops > window.top) & (tops < window.bottom)].tolist()
        for top, bottom in itertools.pairwise([window.top, *inner, window.bottom]):
            yield Window(window.left, top, window.right, bottom)

    def add(self, sums: np.ndarray, window: Window, sums_of_rows: list[np.ndarray]) -> None:
        """Add the sums from the `rows` of a window to the `sums` (down, ...) of all rows of cells."""
        for piece, sums_of_row in zip(self.rows(window), sums_of_rows, strict=True):
            sums[self.row_of(piece.top)] += sums_of_row

    @functools.cached_property
    def starts(self) -> np.ndarray:
        """First column of every cell, (across,)."""
        return self._starts(self.window.width, self.across, self.wraps[1])

    @functools.cached_property
    def columns(self) -> np.ndarray:
        """The cell of every column of pixels, (width,) int32."""
        return _cell_of_each(self.starts, self.window.width)

    @functools.cached_property
    def lines(self) -> np.ndarray:
        """The cell of every row of pixels, (height,) int32."""
        return _cell_of_each(self._tops, self.window.height)

    @functools.cached_property
    def _tops(self) -> np.ndarray:
        return self._starts(self.window.height, self.down, self.wraps[0])

    def _count(self, size: int, wraps: bool) -> int:
        return max(1, round(size / self.side)) if wraps else -(-size // self.side)

    def _starts(self, size: int, count: int, wraps: bool) -> np.ndarray:
        return np.arange(count) * size // count if wraps else np.arange(count) * self.side


def _cell_of_each(starts: np.ndarray, size: int) -> np.ndarray:
    return np.repeat(np.arange(len(starts), dtype=np.int32), np.diff(starts, append=size))


@dataclass(frozen=True, kw_only=True)
class CellGrid(Domain):
    """Cells that fill a domain evenly, spaced for a Gaussian: the grid of cl/grid.h.

    Attributes
    ----------
    sigma : float
        Sigma of the Gaussian window of its statistics, px.
    across, down : int
        Number of cells along x, y. At least four, each at least a pixel wide.
    """

    sigma: float
    across: int
    down: int

    @classmethod
    def of(cls, domain: Domain, sigma: float) -> CellGrid:
        """With `CELLS_PER_SIGMA` cells per sigma."""
        pitch = max(1.0, sigma / CELLS_PER_SIGMA)
        across, down = (max(4, min(n, round(n / pitch))) for n in domain.size)
        return cls(*domain.size, *domain.wraps, sigma=sigma, across=across, down=down)

    @property
    def arguments(self) -> tuple[int, ...]:
        """Kernel arguments: cl/grid.h, GRID_ARGS."""
        return *self.size, self.across, self.down, *self.wraps

    @property
    def counts(self) -> tuple[int, int]:
        """Cells along x and y."""
        return self.across, self.down

    def cells_around(self, y: int) -> tuple[int, int]:
        """The rows of cells above and below a row of pixels. Beyond the border the numbering continues."""
        above = math.floor((y + 0.5) * self.down / self.height - 0.5 - _ROUNDING)
        return above, math.floor((y + 0.5) * self.down / self.height - 0.5 + _ROUNDING) + 1

    def rows_of_cells(self, first: int, last: int) -> tuple[int, int]:
        """The rows of pixels that rows of cells are gathered from. Beyond a wrapped border the numbering continues."""
        pitch = self.height / self.down
        begin = math.floor((first - 0.5) * pitch - 0.5 - _ROUNDING)
        end = math.ceil((last + 0.5) * pitch - 0.5 + _ROUNDING) + 1
        return (begin, end) if self.wrap_y else (max(0, begin), min(self.height, end))

    def taps(self) -> tuple[np.ndarray, np.ndarray]:
        """Gaussian weights over cells along x and y: together with the tents they give `sigma`."""
        in_cells = (self.sigma * n / size for n, size in zip((self.across, self.down), self.size, strict=True))
        sigmas = (math.sqrt(max(1e-4, sigma**2 - _TENTS_VARIANCE)) for sigma in in_cells)
        x, y = (gaussian_taps(sigma, 3.2) for sigma in sigmas)
        return x, y


# --- smoothing a grid ---


def smoothing_taps(sigma: float, side: float) -> np.ndarray:
    """Gaussian weights over cells, (2 radius + 1,): together with cell width and spline they give `sigma` px."""
    in_cells = math.sqrt(max(0.0, (sigma / side) ** 2 - _SPLINE_VARIANCE - _BOX_VARIANCE))
    return gaussian_taps(max(in_cells, 1e-3), 3.5)


def padded(grid: np.ndarray) -> np.ndarray:
    """A grid (down, across, ...) with `MARGIN` empty cells around it."""
    return np.pad(grid, [(MARGIN, MARGIN), (MARGIN, MARGIN)] + [(0, 0)] * (grid.ndim - 2))


def close_margins(grid: np.ndarray, wraps: tuple[bool, bool]) -> None:
    """Fill the `MARGIN` along wrapped axes, y or x, of a grid (down, across, ...) from the opposite end."""
    for axis, count in enumerate(n - 2 * MARGIN for n in grid.shape[:2]):
        if wraps[axis]:
            lines = np.moveaxis(grid, axis, 0)
            for n in (*range(-MARGIN, 0), *range(count, count + MARGIN)):
                lines[MARGIN + n] = lines[MARGIN + n % count]


def correlated(
    grid: np.ndarray, taps_y: np.ndarray, taps_x: np.ndarray, axes: tuple[int, int] = (0, 1),
    wraps: tuple[bool, bool] = (False, False),
) -> np.ndarray:  # fmt: skip
    """sum_k taps[k] grid[i + k - radius] along two axes, in one fixed order.

    Parameters
    ----------
    grid : array of float
    taps_y, taps_x : (2 radius + 1,) float
    axes : (int, int)
        Y and x axis of `grid`.
    wraps : (bool, bool)
        The grid is a torus along y, along x. Otherwise it is zero outside.
    """
    return _along(_along(grid, taps_y, axes[0], wraps[0]), taps_x, axes[1], wraps[1])


def _along(grid: np.ndarray, taps: np.ndarray, axis: int, wraps: bool) -> np.ndarray:
    radius, n = len(taps) // 2, grid.shape[axis]
    moved = np.moveaxis(grid, axis, 0)
    out = np.zeros_like(moved, np.float64)
    if wraps:
        if len(taps) > n:  # taps are longer than the axis
            taps, radius = np.bincount((np.arange(len(taps)) - radius) % n, taps, n), 0
        around = np.moveaxis(np.take(grid, np.arange(-radius, n - radius + len(taps) - 1) % n, axis), axis, 0)
        for k, tap in enumerate(taps):
            out += tap * around[k : k + n]
    else:
        for k in range(max(-radius, 1 - n), min(radius, n - 1) + 1):  # no cells farther away
            here = slice(max(0, -k), n - max(0, k))
            there = slice(max(0, k), n - max(0, -k))
            out[here] += taps[k + radius] * moved[there]
    return np.moveaxis(out, 0, axis)


# --- reading a grid as a surface ---


class SplineSurface:
    """A cubic B-spline over a grid of cells.

    Parameters
    ----------
    grid : (down + 2 MARGIN, across + 2 MARGIN, fields) float
        Values at the cells' centers, with the margin.
    """

    _KEPT = 16  # rows of the grid at full width in a cache

    def __init__(self, grid: np.ndarray, cells: Cells):
        self._grid, self._cells = np.ascontiguousarray(grid, np.float32), cells
        self._first, self._weights = _spline(cells.window.width, cells.steps[1])
        self._first_row, self._row_weights = _spline(cells.window.height, cells.steps[0])
        self._rows: OrderedDict[int, np.ndarray] = OrderedDict()
        self._lock = threading.Lock()

    def row(self, y: int, left: int, right: int) -> np.ndarray:
        """Values at the pixels of a row, y, left and right in image coordinates: (right - left, fields) float32."""
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
            row = self._rows.get(j)
            if row is not None:
                self._rows.move_to_end(j)
                return row
        line = self._grid[j]
        out = line[self._first] * self._weights[:, :1]
        for k in range(1, 4):
            out += line[self._first + k] * self._weights[:, k : k + 1]
        with self._lock:
            self._rows[j] = out
            while len(self._rows) > self._KEPT:
                self._rows.popitem(last=False)
        return out


def _spline(size: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """For every pixel of an axis: the first of four cells (margin included), and their weights (size, 4)."""
    place = (np.arange(size) + 0.5) / step - 0.5 + MARGIN
    cell = np.floor(place).astype(np.int64)
    t = place - cell
    weights = np.stack(
        [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1
    ) / 6.0  # fmt: skip
    return cell - 1, weights.astype(np.float32)
