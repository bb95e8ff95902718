# SPDX-License-Identifier: Apache-2.0
"""Rows of cells that a projection keeps at a time, if all cells of a small sigma do not fit."""

from __future__ import annotations

import math

from ...analysis.stationarity.grid_statistics import CellGrid
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device

ALL_ROWS = 1 << 31


def least_cell_rows(grid: CellGrid) -> int:
    """Minimum rows of cells to keep: those around one row of pixels, and those that are blurred into them."""
    return min(grid.down, 2 * _radius(grid) + 4)


def cell_rows_held(grid: CellGrid, cell_rows: int | None, beyond: int = 0) -> int:
    """Number of rows of cells that a projection keeps, given a limit (None: all)."""
    if cell_rows is None:
        return grid.down
    return min(grid.down, max(cell_rows, least_cell_rows(grid) + math.ceil(2 * beyond * grid.down / grid.height)))


def seen_cells(grid: CellGrid, top: int, bottom: int) -> tuple[int, int, int, int]:
    """Rows of cells around rows of pixels, and those that are blurred into them: (above, below, first, last).

    Beyond a wrapped border, all continue their numbering. `below` and `last` are exclusive.
    """
    above, below = grid.cells_around(top)[0], grid.cells_around(bottom - 1)[1] + 1
    first, last = above - _radius(grid), below + _radius(grid)
    if not grid.wrap_y:
        above, below = max(0, above), min(grid.down, below)
        first, last = max(0, first), min(grid.down, last)
    return above, below, first, last


def _radius(grid: CellGrid) -> int:
    return len(grid.taps()[1]) // 2


class HeldCells:
    """A projection that keeps rows of cells: all of them, or those around the rows to match."""

    held: int | None = None

    def __init__(self, device: Device, buffers: Buffers, grid: CellGrid, channels: int, name: str, held: int):
        self._device, self._buffers, self._grid, self._name = device, buffers, grid, name
        self.channels = channels
        self._held = min(grid.down, held)  # rows of cells
        self._first_cells = 0  # the first row of cells kept
        self.whole = self._held == grid.down
        self.looks_beyond = not self.whole  # matched rows depend on others

    def last_row(self, top: int) -> int:
        """End of the rows that can be matched at once from row `top`. `ALL_ROWS`: all."""
        if self.whole:
            return ALL_ROWS
        grid = self._grid
        return top + 1 + int((self._held - least_cell_rows(grid)) * grid.height / grid.down)
