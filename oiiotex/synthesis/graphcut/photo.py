# SPDX-License-Identifier: Apache-2.0
"""The exemplar and the result of graph cuts: in memory, or in unnamed files that are read by windows."""

from __future__ import annotations

import functools
from typing import Any

from ...engine.color.lab_grid import FINE_STEPS, to_grid
from ...engine.core.piece_cache import PieceCache
from ...engine.core.scratch import RowStore, TileStore, empty_rows
from ...engine.core.source_map import NONE, SourceMap
from ...engine.deferred import np

SIDE = 128  # px of a tile
_PHOTO_BYTES, _RESULT_BYTES = 7, 4  # bytes per pixel
_BESIDE = {(0, -1): (0, 1), (-1, 0): (1, 0), (1, 0): (-1, 0), (0, 1): (0, -1)}  # (y, x) steps in order
_HOLES = 64  # rows searched at a time


def held_bytes(budget: int, photo: int, result: int) -> int:
    """Memory of a photo and a result with those numbers of pixels: in full, or as caches of files."""
    return sum(n if n <= budget // 4 else budget // 8 for n in (_PHOTO_BYTES * photo, _RESULT_BYTES * result))


class Photo:
    """Colors and valid source pixels of an exemplar.

    Parameters
    ----------
    lab : (height, width, 3) int16 or TileStore
        In grid steps.
    usable : (height, width) bool or TileStore
    """

    def __init__(self, lab: np.ndarray | TileStore, usable: np.ndarray | TileStore):
        self.lab, self.usable = lab, usable
        self.shape: tuple[int, ...] = usable.shape[:2]

    @classmethod
    def of(cls, values: Any, usable: Any, budget: int) -> Photo:
        """From CIE Lab as floats.

        Parameters
        ----------
        values : (height, width, 3)
            An array, or an object whose slices are arrays of rows.
        usable : (height, width) bool or None
            Likewise. None: everywhere.
        budget : int
            Bytes. If the photo takes more than a quarter, it is in a file.
        """
        shape = values.shape[:2]
        here = _PHOTO_BYTES * shape[0] * shape[1] <= budget // 4
        cache = PieceCache(budget // 8)
        lab, allowed = (
            np.empty(size, kind) if here else TileStore(size, kind, SIDE, cache)
            for size, kind in (((*shape, 3), np.int16), (shape, np.bool_))
        )
        for top in range(0, shape[0], SIDE):
            bottom = min(shape[0], top + SIDE)
            first, last = max(0, top - 1), min(shape[0], bottom + 1)
            colors = to_grid(values[first:last], FINE_STEPS)
            mine = slice(top - first, bottom - first)
            if usable is None:
                able = np.ones(colors.shape[:2], bool)
            else:
                able = np.asarray(usable[first:last])
                colors = _with_neighbors(colors, able)
            for target, rows in ((lab, colors[mine]), (allowed, able[mine])):
                if isinstance(target, TileStore):
                    target.put(top, 0, rows)
                else:
                    target[top:bottom] = rows
        return cls(lab, allowed)

    def reduced(self, factor: int) -> tuple[np.ndarray, np.ndarray]:
        """Colors and usable pixels, one for each square of factor x factor: the one in its middle.

        If a mask is so fine that it contains none of these, the first usable one of each square.
        """
        y, x = (np.arange(factor // 2, n, factor) for n in self.shape)
        y, x = np.broadcast_arrays(y[:, None], x[None, :])
        usable = self.usable[y, x]
        if not usable.any():
            y, x = self._first_usable(factor)
            usable = self.usable[y, x]
        return self.lab[y, x], usable

    def _first_usable(self, factor: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the first usable pixel of each square. Arbitrary if there is none."""
        rows, columns = (-(-n // factor) for n in self.shape)
        first = np.zeros((rows, columns), np.int64)
        for row in range(rows):
            there = np.zeros((factor, columns * factor), bool)
            pixels = self._usable_rows(row * factor, min(self.shape[0], (row + 1) * factor))
            there[: len(pixels), : self.shape[1]] = pixels
            squares = there.reshape(factor, columns, factor).swapaxes(0, 1).reshape(columns, -1)
            first[row] = squares.argmax(1)
        y, x = np.arange(rows)[:, None] * factor + first // factor, np.arange(columns) * factor + first % factor
        return y, x

    def usable_from(self, number: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns, (count,) each, of the usable pixels from that number on, in raster order and cyclic."""
        ends = self._usable_by_row.cumsum()
        numbers = (number + np.arange(count)) % int(ends[-1])
        rows = np.searchsorted(ends, numbers, "right")
        columns = np.empty(count, np.int64)
        for row in np.unique(rows).tolist():
            here, before = rows == row, int(ends[row - 1]) if row else 0
            columns[here] = np.flatnonzero(self._usable_rows(row, row + 1)[0])[numbers[here] - before]
        return rows, columns

    @functools.cached_property
    def _usable_by_row(self) -> np.ndarray:
        tops = range(0, self.shape[0], SIDE)
        return np.concatenate([self._usable_rows(top, min(self.shape[0], top + SIDE)).sum(1) for top in tops])

    def _usable_rows(self, first: int, last: int) -> np.ndarray:
        return self.usable[np.ix_(np.arange(first, last), np.arange(self.shape[1]))]


def _with_neighbors(lab: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Colors with those next to usable pixels replaced by them: seams compare pixels one beyond a patch."""
    out, done = lab.copy(), usable.copy()
    height, width = usable.shape
    around = np.pad(usable, 1)
    colors = np.pad(lab, ((1, 1), (1, 1), (0, 0)))
    for y, x in _BESIDE:
        beside = slice(1 + y, 1 + y + height), slice(1 + x, 1 + x + width)
        taken = around[beside] & ~done
        out[taken] = colors[beside][taken]
        done |= taken
    return out


class Laid:
    """The source of each pixel of a result, `NONE` if it has none. Threads may share it by windows.

    `budget`: bytes. If the map takes more than a quarter, it is in a file.
    """

    def __init__(self, height: int, width: int, budget: int):
        self.rows = empty_rows((height, width), np.uint32, in_memory=_RESULT_BYTES * height * width <= budget // 4)
        for top in range(0, height, _HOLES):
            count = min(_HOLES, height - top)
            self.rows[top : top + count] = np.full((count, width), NONE, np.uint32)

    def window(self, rows: np.ndarray, columns: np.ndarray) -> SourceMap:
        """Sources of these rows and columns, each one or more runs of consecutive ones."""
        if isinstance(self.rows, RowStore):
            return SourceMap(self.rows.crossing(rows, columns))
        return SourceMap(self.rows[np.ix_(rows, columns)])

    def put(self, rows: np.ndarray, columns: np.ndarray, values: SourceMap) -> None:
        """The inverse of `window`, for rows and columns without duplicates."""
        if isinstance(self.rows, RowStore):
            self.rows.set_crossing(rows, columns, values.packed)
        else:
            self.rows[np.ix_(rows, columns)] = values.packed

    def first_hole(self, top: int) -> tuple[int, int] | None:
        """Row and column of the first pixel without a source, from row `top`."""
        for first in range(top, len(self.rows), _HOLES):
            holes = np.flatnonzero(self.rows[first : first + _HOLES] == NONE)
            if len(holes):
                y, x = divmod(int(holes[0]), self.rows.shape[1])
                return first + y, x
        return None
