# SPDX-License-Identifier: Apache-2.0
"""Rows of cells that a projection holds at a time, where a small sigma makes more of them than fit."""

from __future__ import annotations

import math

from ..stationarity.grid_statistics import CellGrid

ALL_ROWS = 1 << 31


def least_cell_rows(grid: CellGrid) -> int:
    """Rows of cells that must be held: those around one row of pixels, and what is blurred into them."""
    return min(grid.down, 2 * _radius(grid) + 4)


def cell_rows_held(grid: CellGrid, cell_rows: int | None, beyond: int = 0) -> int:
    """How many rows of cells a projection holds that was given so many, None: all.

    Parameters
    ----------
    grid : CellGrid
    cell_rows : int or None
    beyond : int
        Rows of pixels above and below those that are made, which are matched as well.
    """
    if cell_rows is None:
        return grid.down
    return min(grid.down, max(cell_rows, least_cell_rows(grid) + math.ceil(2 * beyond * grid.down / grid.height)))


def last_row(grid: CellGrid, held: int, top: int) -> int:
    """Up to which row of pixels the cells around all of them are held, from row `top` on; `ALL_ROWS`: all."""
    if held == grid.down:
        return ALL_ROWS
    return top + 1 + int((held - least_cell_rows(grid)) * grid.height / grid.down)


def seen_cells(grid: CellGrid, top: int, bottom: int) -> tuple[int, int, int, int]:
    """Rows of cells that rows of pixels lie between, and those that are blurred into them: (above, below, first, last).

    All are counted on beyond a border that wraps; below and last are behind the last one.
    """
    above, below = grid.cells_around(top)[0], grid.cells_around(bottom - 1)[1] + 1
    first, last = above - _radius(grid), below + _radius(grid)
    if not grid.wrap_y:
        above, below = max(0, above), min(grid.down, below)
        first, last = max(0, first), min(grid.down, last)
    return above, below, first, last


def _radius(grid: CellGrid) -> int:
    return len(grid.taps()[1]) // 2
