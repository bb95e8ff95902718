# SPDX-License-Identifier: Apache-2.0
"""How often a quilt shows regions of its exemplar, and how often it should: what showing them again costs.

Not in LSA16 or Efros & Freeman 2001. The exemplar is cut into squares. A patch shows those that its middle covers, half
an overlap inside of its border, where cuts lie on the average, so the shown parts of all patches are as large as the
quilt. Each square has a share: how often it would be shown if all that a key's patches can show were shown alike. Of
that share a square is due, at any time, the part of the quilt that is laid. Twice, or once more than is due, is free,
what is above that costs its square (cl/quilting.cl, use_share): what a large quilt shows often it shows all over, and
every part of the photo has its turn. All of it is whole numbers, so that nothing but the order of cells counts.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..core.source_map import NONE, SourceMap
from ..deferred import np
from ..labels.content_table import ContentTable
from .quilt_plan import Grid

GROWTH = 0.3  # price of a patch that is shown once too often, in exemplar variances of the overlaps' pixels
OFTEN = 10  # times that patches of one label alone may show the same before mixed ones are taken, too
UNITS = 256  # of a use, as shares are counted: cl/quilting.cl
_AT_ONCE = 1 << 18  # offsets that are counted
_SQUARES = 6  # along the side of what a patch shows, at least


@dataclass(frozen=True)
class PatchSquares:
    """The squares of an exemplar, as patches of a grid show them."""

    side: int  # px
    count: int  # Of a patch along a side
    before: int  # px from a patch's corner to what it shows
    rows: int  # Of the exemplar
    columns: int

    @classmethod
    def of(cls, grid: Grid, height: int, width: int) -> PatchSquares:
        """Of an exemplar of that size."""
        side = max(1, grid.step // _SQUARES)
        count, before = grid.step // side, grid.overlap // 2
        # of the last patch, rounded up
        rows, columns = ((n - grid.patch + before + side // 2) // side + count for n in (height, width))
        return cls(side, count, before, rows, columns)

    def shown(self, offsets: np.ndarray) -> np.ndarray:
        """How many of the patches at these offsets, packed, show each square: (rows, columns) int32."""
        corners = np.zeros(self.rows * self.columns, np.int64)
        for first in range(0, len(offsets), _AT_ONCE):
            some = SourceMap(offsets[first : first + _AT_ONCE]).yx
            y, x = ((n + self.before + self.side // 2) // self.side for n in some)
            corners += np.bincount(y * self.columns + x, minlength=len(corners))
        return _spread(corners, self)

    def spans(self, table: ContentTable, keys: np.ndarray, reuse: float) -> np.ndarray:
        """Where the patches of each key are when cells with these keys are laid: (keys, 4) int64.

        Offsets from and up to, and keys from and up to, in the table. They are the key's own, with one exception: a
        label that is wanted alone takes all patches in which it dominates, if patches of nothing else would each be
        shown more than `OFTEN` times. A stone of one label holds few squares of a patch's size, and a whole area of it
        would be rows of these few.
        """
        of, numbers = table.keys[:, 0], np.arange(len(table.keys))
        first, last = numbers.copy(), numbers + 1
        cells = np.bincount(keys.ravel(), minlength=len(table.keys))
        for key in np.flatnonzero((cells > 0) & (of == table.keys[:, 1])):
            can = self.shown(table.offsets[table.starts[key] : table.starts[key + 1]]) > 0
            if cells[key] * self.count**2 > OFTEN * max(1.0, reuse) * np.count_nonzero(can):
                first[key], last[key] = np.searchsorted(of, of[key]), np.searchsorted(of, of[key], "right")
        return np.stack([table.starts[first], table.starts[last], first, last], 1)

    def shares(self, offsets: np.ndarray, spans: np.ndarray, keys: np.ndarray, reuse: float) -> np.ndarray:
        """How often each square is due when cells with these keys are laid, `reuse` times: (rows, columns) int32.

        In 1 / `UNITS`. Of a key all squares that its patches, `spans` of all offsets, can show are shown alike.
        """
        cells = np.bincount(keys.ravel(), minlength=len(spans))
        shares = np.zeros((self.rows, self.columns))
        for key in np.flatnonzero(cells):
            can = self.shown(offsets[spans[key, 0] : spans[key, 1]]) > 0
            shares += np.where(can, cells[key] * self.count**2 / np.count_nonzero(can), 0.0)
        return np.minimum(np.rint(UNITS * reuse * shares), 2**31 - 1).astype(np.int32)


def laid(offsets: np.ndarray) -> np.ndarray:
    """Those of cells that have a patch."""
    return offsets[offsets != NONE]


def _spread(corners: np.ndarray, squares: PatchSquares) -> np.ndarray:
    """Counts of first squares -> counts of all squares that belong to them."""
    sums = np.zeros((squares.rows + 1, squares.columns + 1), np.int64)
    sums[1:, 1:] = corners.reshape(squares.rows, squares.columns).cumsum(0).cumsum(1)
    n = squares.count
    upper, left = (np.maximum(np.arange(1, size + 1) - n, 0) for size in (squares.rows, squares.columns))
    lower = sums[1:] - sums[upper]
    return (lower[:, 1:] - lower[:, left]).astype(np.int32)
