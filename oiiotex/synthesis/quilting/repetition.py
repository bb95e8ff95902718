# SPDX-License-Identifier: Apache-2.0
"""The reuse penalty of quilts: how often regions of the exemplar appear, compared with their fair share.

Not in LSA16 or Efros & Freeman 2001. The exemplar is divided into squares. A patch shows those that its middle covers,
half an overlap inside its border, where cuts lie on average, so the shown areas of all patches add up to the area of
the quilt. The fair share of a square is its number of uses if all squares that a key's patches can show were used
equally, times the part of the quilt that is decided. Two uses, or one more than the share, are free. Excess uses cost
their square (cl/quilting.cl, use_share). So frequent regions are spread over a large quilt, and every part of the
photo is used. All of it is integer arithmetic, so only the order of cells matters.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...analysis.labels.content_table import ContentTable
from ...engine.core.source_map import NONE, SourceMap
from ...engine.deferred import np
from .quilt_plan import Grid

GROWTH = 0.3  # cost of a patch with one excess use, in exemplar variances of the overlaps' pixels
OFTEN = 10  # uses of the same region by pure patches of a label above which mixed patches are used
UNITS = 256  # per use, in which shares are counted: cl/quilting.cl
_AT_ONCE = 1 << 18  # offsets counted at a time
_SQUARES = 6  # minimum number along the side of a patch's shown area


@dataclass(frozen=True)
class PatchSquares:
    """The squares of an exemplar, as shown by patches of a grid."""

    side: int  # px
    count: int  # of a patch along a side
    before: int  # px from a patch's corner to its shown area
    rows: int  # of the exemplar
    columns: int

    @classmethod
    def of(cls, grid: Grid, height: int, width: int) -> PatchSquares:
        """Squares of an exemplar of that size."""
        side = max(1, grid.step // _SQUARES)
        count, before = grid.step // side, grid.overlap // 2
        # of the last patch, rounded up
        rows, columns = ((n - grid.patch + before + side // 2) // side + count for n in (height, width))
        return cls(side, count, before, rows, columns)

    def shown(self, offsets: np.ndarray) -> np.ndarray:
        """Number of patches, from packed offsets, that show each square: (rows, columns) int32."""
        corners = np.zeros(self.rows * self.columns, np.int64)
        for first in range(0, len(offsets), _AT_ONCE):
            some = SourceMap(offsets[first : first + _AT_ONCE]).yx
            y, x = ((n + self.before + self.side // 2) // self.side for n in some)
            corners += np.bincount(y * self.columns + x, minlength=len(corners))
        return _spread(corners, self)

    def spans(self, table: ContentTable, keys: np.ndarray, reuse: float) -> np.ndarray:
        """Ranges of the patches that serve each key when cells with these keys are laid: (keys, 4) int64.

        First and last offset, and first and last key, in the table. They are the key's own patches, with one exception:
        a single label uses all patches in which it dominates if each of its pure patches would appear more than `OFTEN`
        times. A stone of one label covers few squares of a patch's size, and a large area of it would be rows of these
        few.
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
        """Fair share of each square when cells with these keys are laid, times `reuse`: (rows, columns) int32.

        In 1 / `UNITS`. For a key, all squares that its patches, `spans` of all offsets, can show have equal shares.
        """
        cells = np.bincount(keys.ravel(), minlength=len(spans))
        shares = np.zeros((self.rows, self.columns))
        for key in np.flatnonzero(cells):
            can = self.shown(offsets[spans[key, 0] : spans[key, 1]]) > 0
            shares += np.where(can, cells[key] * self.count**2 / np.count_nonzero(can), 0.0)
        return np.minimum(np.rint(UNITS * reuse * shares), 2**31 - 1).astype(np.int32)


def laid(offsets: np.ndarray) -> np.ndarray:
    """Offsets of the cells that have a patch."""
    return offsets[offsets != NONE]


def _spread(corners: np.ndarray, squares: PatchSquares) -> np.ndarray:
    """Counts of first squares -> counts of all squares that patches show."""
    sums = np.zeros((squares.rows + 1, squares.columns + 1), np.int64)
    sums[1:, 1:] = corners.reshape(squares.rows, squares.columns).cumsum(0).cumsum(1)
    n = squares.count
    upper, left = (np.maximum(np.arange(1, size + 1) - n, 0) for size in (squares.rows, squares.columns))
    lower = sums[1:] - sums[upper]
    return (lower[:, 1:] - lower[:, left]).astype(np.int32)
