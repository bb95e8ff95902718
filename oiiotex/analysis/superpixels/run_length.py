# SPDX-License-Identifier: Apache-2.0
"""Label maps as runs along rows: connected pieces, adjacency, merging of small pieces into neighbors.

A run is an interval of one row with one label. Work and memory grow with the number of runs, a fraction of the number
of pixels. Pieces are numbered by their first pixel in reading order, so the result does not depend on bands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from ...engine.deferred import np

OUTSIDE = -1  # label of transparent pixels
_RUN_BYTES, _BORDER_BYTES = 40, 200  # of memory while pieces are connected, measured on noise


@dataclass(frozen=True)
class Runs:
    """A label map."""

    width: int
    height: int
    first: np.ndarray  # (height + 1,) int64: start of each row's runs
    left: np.ndarray  # (n,) int32: first column of each run; it ends at the next one of its row
    label: np.ndarray  # (n,) int32: 0 .. count - 1, or OUTSIDE

    def rows(self) -> np.ndarray:
        """The row of every run, (n,) int32."""
        return np.repeat(np.arange(self.height, dtype=np.int32), np.diff(self.first))

    def right(self) -> np.ndarray:
        """The column after the last of every run, (n,) int32."""
        right = np.empty_like(self.left)
        right[:-1] = self.left[1:]
        right[self.first[1:] - 1] = self.width
        return right

    def pixels(self, top: int, bottom: int, left: int, right: int) -> np.ndarray:
        """Labels of a window as (rows, columns) int32.

        `top`, `bottom`, `left`, `right`: px from the map's corner; bottom and right are the first outside.
        """
        begin, end = self.first[top], self.first[bottom]
        starts = self.left[begin:end].astype(np.int64)
        starts += np.repeat(np.arange(bottom - top) * self.width, np.diff(self.first[top : bottom + 1]))
        lengths = np.diff(starts, append=(bottom - top) * self.width)
        return np.repeat(self.label[begin:end], lengths).reshape(bottom - top, self.width)[:, left:right]

    def relabeled(self, of: np.ndarray) -> Runs:
        """Each label replaced by `of[label]`, with adjacent equal runs joined."""
        label = np.append(of, OUTSIDE).astype(np.int32)[self.label]
        keep = np.ones(len(label), bool)
        keep[1:] = label[1:] != label[:-1]
        keep[self.first[:-1]] = True
        first = np.concatenate([[0], np.cumsum(keep)])[self.first]
        return Runs(self.width, self.height, first, self.left[keep], label[keep])


@dataclass(frozen=True)
class Strip:
    """Some full rows of a label map that is not complete yet."""

    width: int
    height: int
    starts: np.ndarray  # (n,) int64: first pixel of each run, counted row by row; each row begins with a run
    label: np.ndarray  # (n,) int32: from 0, or OUTSIDE; adjacent runs differ

    @classmethod
    def joined(cls, width: int, height: int, starts: np.ndarray, label: np.ndarray) -> Strip:
        """From runs of which adjacent ones may be equal."""
        keep = np.ones(len(label), bool)
        keep[1:] = label[1:] != label[:-1]
        keep |= starts % width == 0
        return cls(width, height, starts[keep], label[keep])

    @classmethod
    def of(cls, labels: np.ndarray) -> Strip:
        """From labels as pixels, (rows, width) int32."""
        height, width = labels.shape
        return cls.joined(width, height, np.arange(labels.size), labels.ravel())

    def rows(self, top: int, bottom: int) -> Strip:
        """Some of its rows."""
        begin, end = np.searchsorted(self.starts, (top * self.width, bottom * self.width))
        return Strip(self.width, bottom - top, self.starts[begin:end] - top * self.width, self.label[begin:end])


@dataclass(frozen=True)
class Borders:
    """Adjacent labels: a < b, (m,) each, sorted, with the length of their common border in pixel sides."""

    a: np.ndarray
    b: np.ndarray
    length: np.ndarray

    @classmethod
    def of(cls, a: np.ndarray, b: np.ndarray, length: np.ndarray, count: int) -> Borders:
        """From pairs in any order, with duplicates. Loops are removed.

        `a`, `b` (m,) int; `length` (m,).
        """
        apart = a != b
        a, b, length = a[apart].astype(np.int64), b[apart].astype(np.int64), length[apart]
        keys, where = np.unique(np.minimum(a, b) * count + np.maximum(a, b), return_inverse=True)
        total = np.bincount(where, length, len(keys)).astype(np.int64)
        return cls(keys // max(count, 1), keys % max(count, 1), total)


@dataclass(frozen=True)
class Pieces:
    """4-connected pieces of a label map: its runs with pieces as labels, the pieces' sizes, their borders."""

    runs: Runs
    sizes: np.ndarray
    borders: Borders


def pieces_of(
    strips: Iterable[Strip], height: int, require: Callable[[int], None] | None = None, tiled: str = "none"
) -> Pieces:
    """4-connected pieces of equal labels.

    `require`: called with the bytes required so far, and raises an error if they are too many. Photos have few runs,
    noise has nearly as many as pixels. `tiled`: axes along which opposite borders touch.
    """
    finder = _Finder(tiled)
    for strip in strips:
        finder.add(strip)
        if require is not None:
            require(finder.need)
    return finder.finished(height)


class _Finder:
    """Connects pieces, one strip after another."""

    def __init__(self, tiled: str = "none") -> None:
        self._width, self._count, self._tiled = 0, 0, tiled
        self._left: list[np.ndarray] = []
        self._per_row: list[np.ndarray] = []
        self._piece: list[np.ndarray] = []
        self._sizes: list[np.ndarray] = []
        self._same: list[np.ndarray] = []  # (2, n) pieces of two strips that are connected
        self._borders: list[Borders] = []
        self.need = 0  # bytes, at the end
        self._above: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # starts, labels, pieces of a row
        self._top: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # the same of the first row

    def add(self, strip: Strip) -> None:
        self._width = width = strip.width
        rows, starts, label = strip.height, strip.starts, strip.label
        lengths = np.diff(starts, append=rows * width)
        per_row = np.bincount(starts // width, minlength=rows)

        upper, lower, shared = _overlaps(starts, starts, width, rows)
        one = (label[upper] == label[lower]) & (label[upper] != OUTSIDE)
        count, piece = _united(upper[one], lower[one], len(starts))
        inside = np.zeros(count, bool)
        inside[piece] = label != OUTSIDE
        number = np.where(inside, self._count + np.cumsum(inside) - 1, OUTSIDE)
        piece, new = number[piece], int(np.count_nonzero(inside))  # in this strip

        self._sizes.append(np.bincount(piece[piece >= 0] - self._count, lengths[piece >= 0], new))
        beside = np.flatnonzero(starts[1:] % width != 0)
        pairs: list[tuple[np.ndarray, ...]] = [(piece[beside], piece[beside + 1], np.ones(len(beside)))]
        pairs.append((piece[upper], piece[lower], shared))
        self._count += new
        top = slice(0, per_row[0])
        row = starts[top], label[top], piece[top]
        if self._above is not None:
            pairs.append(self._touching(self._above, row))
        self._top = row if self._top is None else self._top
        if "x" in self._tiled:
            left = np.flatnonzero(starts % width == 0)
            right = np.append(left[1:], len(starts)) - 1
            pairs.append(self._connected((label[right], piece[right]), (label[left], piece[left]), np.ones(rows)))
        self._border(pairs)

        self._left.append((starts % width).astype(np.int32))
        self._per_row.append(per_row)
        self.need += _RUN_BYTES * len(starts) + _BORDER_BYTES * len(self._borders[-1].a)
        self._piece.append(piece.astype(np.int32))
        last = slice(len(starts) - per_row[-1], None)
        self._above = starts[last] - (rows - 1) * width, label[last], piece[last]

    def _touching(self, above: tuple[np.ndarray, ...], below: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        """Connect two rows of runs (starts, labels, pieces); returns as `_connected`."""
        i, j, shared = _overlaps(above[0], below[0] + self._width, self._width, 2)
        return self._connected((above[1][i], above[2][i]), (below[1][j], below[2][j]), shared)

    def _connected(
        self, some: tuple[np.ndarray, np.ndarray], others: tuple[np.ndarray, np.ndarray], length: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Connect touching runs, (labels, pieces) each, where their labels are equal; returns the other pairs."""
        one = (some[0] == others[0]) & (some[0] != OUTSIDE)
        self._same.append(np.stack([some[1][one], others[1][one]]))
        return some[1][~one], others[1][~one], length[~one]

    def _border(self, pairs: list[tuple[np.ndarray, ...]]) -> None:
        a, b, length = (np.concatenate(c) for c in zip(*pairs, strict=True))
        known = (a >= 0) & (b >= 0)
        self._borders.append(Borders.of(a[known], b[known], length[known], self._count))

    def finished(self, height: int) -> Pieces:
        if "y" in self._tiled and self._above is not None and self._top is not None:
            self._border([self._touching(self._above, self._top)])
        same = np.concatenate(self._same, 1) if self._same else np.zeros((2, 0), np.int64)
        # numbers by first pixel: pieces of strips are in that order, and a whole has that of its first part
        count, whole = _united(same[0], same[1], self._count)
        parts = np.concatenate([np.zeros(0), *self._sizes])
        sizes = np.bincount(whole, parts, count).astype(np.int64)
        a, b, length = (np.concatenate([getattr(x, f) for x in self._borders]) for f in ("a", "b", "length"))
        borders = Borders.of(whole[a], whole[b], length, count)
        starts = np.concatenate([[0], np.cumsum(np.concatenate(self._per_row))])
        runs = Runs(self._width, height, starts, np.concatenate(self._left), np.concatenate(self._piece))
        return Pieces(runs.relabeled(whole), sizes, borders)


def _overlaps(upper: np.ndarray, lower: np.ndarray, width: int, rows: int) -> tuple[np.ndarray, ...]:
    """Runs that touch across rows: (upper run, lower run, length).

    `upper` and `lower` are first pixels of runs of one strip of `rows` rows, counted row by row.
    """
    above = upper[: np.searchsorted(upper, (rows - 1) * width)]
    skipped = np.searchsorted(lower, width)
    below = lower[skipped:] - width
    cuts = np.sort(np.concatenate([above, below]), kind="stable")  # merges sorted arrays: np.unique hashes
    cuts = cuts[np.diff(cuts, prepend=-1) != 0]
    i = np.searchsorted(above, cuts, "right") - 1
    j = np.searchsorted(below, cuts, "right") - 1 + skipped
    return i, j, np.diff(cuts, append=(rows - 1) * width)


def _united(a: np.ndarray, b: np.ndarray, count: int) -> tuple[int, np.ndarray]:
    """Sets of 0 .. count - 1 where a[i] and b[i] are connected, by first members: their number, and each one's.

    As scipy.sparse.csgraph.connected_components, which takes .2 s to import and 1 to 2 times as long.
    """
    root = np.arange(count, dtype=np.int32)
    while len(a):
        a, b = root[a], root[b]
        apart = a != b
        a, b = a[apart], b[apart]
        np.minimum.at(root, np.maximum(a, b), np.minimum(a, b))
        while not np.array_equal(root, above := root[root]):
            root = above
    first = root == np.arange(count)
    return int(np.count_nonzero(first)), (np.cumsum(first, dtype=np.int32) - 1)[root]


def without_small(pieces: Pieces, least: float) -> Pieces:
    """Merge pieces below `least` pixels into neighbors until none has a neighbor. See `small_joined`."""
    of, sizes, borders, _ = small_joined(pieces, least, np.zeros(len(pieces.sizes), bool))
    return Pieces(pieces.runs.relabeled(of), sizes, borders)


def small_joined(
    pieces: Pieces, least: float, unknown: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Borders, np.ndarray]:
    """The merging of pieces below `least` pixels into neighbors.

    In every round each small piece chooses one neighbor: one that is not small, else a small one. Of these the one
    with the longest common border, of these the first. Pieces connected by choices are merged, so every round leaves
    at most half of the small pieces, and the result does not depend on the order of work or tiles.

    `least`: px; `unknown` (n,) bool; returns (n,) int, (m,) int64, (m,) int.
    """
    sizes, borders = pieces.sizes, pieces.borders
    of = first = np.arange(len(sizes))
    while True:
        small = (sizes < least) & ~unknown
        a = np.concatenate([borders.a, borders.b])
        b = np.concatenate([borders.b, borders.a])
        length = np.concatenate([borders.length, borders.length])
        asked = small[a]
        a, b, length = a[asked], b[asked], length[asked]
        if not len(a):
            return of, sizes, borders, first
        order = np.lexsort((b, -length, small[b], a))
        chooser, best = np.unique(a[order], return_index=True)
        count, joined = _united(chooser, b[order][best], len(sizes))
        # one that is not small chooses none, so a merged set contains at most one
        order = np.lexsort((small, joined))
        first = first[order[np.searchsorted(joined[order], np.arange(count))]]
        unknown = np.bincount(joined, unknown, count) > 0
        sizes = np.bincount(joined, sizes, count).astype(np.int64)
        borders = Borders.of(joined[borders.a], joined[borders.b], borders.length, count)
        of = joined[of]
