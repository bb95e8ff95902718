# SPDX-License-Identifier: Apache-2.0
"""What is in a region: label histograms, keys, and the table from a key to all windows that have it.

LSA16 section 6. A window is named by its top-left pixel. Id 0 is no label.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..errors import ImageError

NO_KEY = np.uint32(0xFFFFFFFF)  # in a key map: no window may be taken here
_TILE = 256  # offsets looked at together: a small piece holds few labels, and only those are counted


def patch_side(rho: float, least: int = 16, most: int = 256) -> int:
    """The side of a patch that holds patterns of scale rho: rho rounded to a power of two (LSA16 section 6.1)."""
    return int(min(most, max(least, 2 ** int(np.rint(np.log2(max(rho, 1.0)))))))


def box_counts(chosen: np.ndarray, side: int) -> np.ndarray:
    """How many pixels of `chosen` (h, w) bool every window holds: (h - side + 1, w - side + 1) int32."""
    sums = np.zeros((chosen.shape[0] + 1, chosen.shape[1] + 1), np.int32)
    np.cumsum(chosen, 0, np.int32, out=sums[1:, 1:])
    np.cumsum(sums[1:, 1:], 1, np.int32, out=sums[1:, 1:])
    return sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]


def histogram(labels: np.ndarray, y: int, x: int, height: int, width: int | None = None) -> dict[int, int]:
    """The label histogram h of a region, id -> pixels (LSA16 eq. 9). Pixels without label do not count."""
    found, counts = np.unique(labels[y : y + height, x : x + (width or height)], return_counts=True)
    return {int(c): int(n) for c, n in zip(found, counts, strict=True) if c != 0}


def key_of(counts: dict[int, int]) -> tuple[int, int]:
    """(k1, k2): the two most frequent labels of a histogram, ties to the lower id; k2 = k1 where there is only one."""
    if not counts:
        return 0, 0
    order = sorted(counts, key=lambda c: (-counts[c], c))
    return order[0], order[min(1, len(order) - 1)]


def whole_windows(allowed: np.ndarray, side: int) -> np.ndarray:
    """Which windows lie fully inside `allowed` (h, w) bool: (h - side + 1, w - side + 1) bool."""
    out = np.empty((allowed.shape[0] - side + 1, allowed.shape[1] - side + 1), bool)
    for place, piece in _tiles(out.shape, side):
        out[place] = box_counts(allowed[piece], side) == side * side
    return out


def largest_window(allowed: np.ndarray) -> int:
    """The side of the largest square that lies fully inside `allowed` (h, w) bool; 0 where it is empty."""
    low, high = 0, min(allowed.shape)
    while low < high:
        side = (low + high + 1) // 2
        low, high = (side, high) if whole_windows(allowed, side).any() else (low, side - 1)
    return low


def regions(chosen: np.ndarray, block: int) -> int:
    """How many blocks of block x block offsets have one that is chosen, (h, w) bool."""
    rows, columns = (-(-n // block) * block for n in chosen.shape)
    padded = np.zeros((rows, columns), bool)
    padded[: chosen.shape[0], : chosen.shape[1]] = chosen
    return int(padded.reshape(rows // block, block, -1, block).any((1, 3)).sum())


def window_keys(labels: np.ndarray, side: int, allowed: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The key (k1, k2) of every window, by integral counting, label by label in small pieces of the map.

    Memory is a few times that of the map, whatever the number of labels.

    Parameters
    ----------
    labels : (h, w) of ids
    side : int
    allowed : (h, w) bool, optional

    Returns
    -------
    k1, k2 : (h - side + 1, w - side + 1) int32
        Both 0 where the window touches a pixel that has no label or is not allowed.
    """
    shape = (labels.shape[0] - side + 1, labels.shape[1] - side + 1)
    first, second = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
    for place, piece in _tiles(shape, side):
        ids = labels[piece]
        good = ids != 0 if allowed is None else (ids != 0) & allowed[piece]
        whole = box_counts(good, side) == side * side
        if not whole.any():
            continue
        k1, k2 = np.zeros(whole.shape, np.int32), np.zeros(whole.shape, np.int32)
        n1, n2 = np.zeros(whole.shape, np.int32), np.zeros(whole.shape, np.int32)
        for label in np.unique(ids[good]):  # in ascending order: with a strict comparison ties go to the lower id
            count = box_counts(ids == label, side)
            better = count > n1
            next_best = (count > n2) & ~better
            n2[better], k2[better] = n1[better], k1[better]
            n1[better], k1[better] = count[better], label
            n2[next_best], k2[next_best] = count[next_best], label
        first[place] = np.where(whole, k1, 0)
        second[place] = np.where(whole, np.where(n2 == 0, k1, k2), 0)
    return first, second


def _tiles(shape: tuple[int, int], side: int) -> Iterable[tuple[tuple[slice, slice], tuple[slice, slice]]]:
    """Pieces of a map of offsets, and the pixels that their windows see."""
    step = max(_TILE, 2 * side)
    for y in range(0, shape[0], step):
        for x in range(0, shape[1], step):
            y1, x1 = min(y + step, shape[0]), min(x + step, shape[1])
            yield (slice(y, y1), slice(x, x1)), (slice(y, y1 + side - 1), slice(x, x1 + side - 1))


@dataclass(frozen=True)
class ContentTable:
    """Key -> all offsets whose window has this key (LSA16 figure 11), and those of a key by regions of the exemplar.

    Only offsets are stored, so its size is proportional to the exemplar. Within a key they are sorted by blocks of
    `block` x `block` offsets; one block's offsets of one key are a range. What is used too often is counted by range.

    Attributes
    ----------
    side, block : int
    keys : (n, 2) int32
        (k1, k2) in ascending order.
    starts : (n + 1,) int64
        Offsets of key n are `offsets[starts[n]:starts[n + 1]]`.
    offsets : (m,) uint32
        y << 16 | x.
    ranges : (n + 1,) int64
        Ranges of key n are ranges[n] to ranges[n + 1].
    range_starts : (r + 1,) int64
        Offsets of range r are `offsets[range_starts[r]:range_starts[r + 1]]`.
    range_blocks : (r,) int32
        The block of a range, counted row by row.
    key_map : (h - side + 1, w - side + 1) uint32
        The number of the key of every offset, or NO_KEY.
    """

    side: int
    block: int
    keys: np.ndarray
    starts: np.ndarray
    offsets: np.ndarray
    ranges: np.ndarray
    range_starts: np.ndarray
    range_blocks: np.ndarray
    key_map: np.ndarray

    def find(self, key: tuple[int, int]) -> int | None:
        """The number of a key, or None."""
        at = np.flatnonzero((self.keys == np.asarray(key)).all(1))
        return int(at[0]) if len(at) else None

    def nearest(self, key: tuple[int, int]) -> int:
        """The number of the key, or of the nearest that has offsets.

        Nearest: the pure (k1, k1); any other (k1, .); (., k1); the pure (k2, k2); (k2, .); (., k2); any. Of several,
        the one with most offsets, ties to the lower ids.
        """
        k1, k2 = key
        first, second = self.keys[:, 0], self.keys[:, 1]
        tries = (
            (first == k1) & (second == k2), (first == k1) & (second == k1), first == k1, second == k1,
            (first == k2) & (second == k2), first == k2, second == k2, np.ones(len(self.keys), bool),
        )  # fmt: skip
        fits = np.flatnonzero(next(t for t in tries if t.any()))
        return int(fits[np.argmax(self.count()[fits])])

    def count(self) -> np.ndarray:
        """How many offsets each key has."""
        return np.diff(self.starts)

    def nbytes(self) -> int:
        """Of the arrays that are as large as the exemplar."""
        return self.offsets.nbytes + self.key_map.nbytes


def content_table(first: np.ndarray, second: np.ndarray, side: int, block: int) -> ContentTable:
    """The table of what `window_keys` found.

    Raises
    ------
    ImageError
        There is no window at all.
    """
    good = np.flatnonzero(first.ravel())
    if not len(good):
        raise ImageError(f"no {side}x{side} patch of the exemplar has a label throughout")
    most = int(max(first.max(), second.max())) + 1
    codes = first.ravel()[good].astype(np.int64) * most + second.ravel()[good]
    present = _distinct(codes, most * most)
    number = np.searchsorted(present, codes)
    del codes
    columns = first.shape[1]
    across = -(-columns // block)
    blocks = -(-first.shape[0] // block) * across
    key_map = np.full(first.size, NO_KEY, np.uint32)
    key_map[good] = number
    place = number * blocks + good // columns // block * across + good % columns // block
    order = np.argsort(place, kind="stable")
    place = place[order]
    heads = np.flatnonzero(np.diff(place, prepend=-1))
    key_of_range = place[heads] // blocks
    at = good[order]
    return ContentTable(
        side=side,
        block=block,
        keys=np.stack([present // most, present % most], 1).astype(np.int32),
        starts=np.searchsorted(place, np.arange(len(present) + 1) * blocks),
        offsets=((at // columns) << 16 | at % columns).astype(np.uint32),
        ranges=np.searchsorted(key_of_range, np.arange(len(present) + 1)),
        range_starts=np.append(heads, len(place)),
        range_blocks=(place[heads] % blocks).astype(np.int32),
        key_map=key_map.reshape(first.shape),
    )


def _distinct(codes: np.ndarray, limit: int) -> np.ndarray:
    """The values there are, ascending."""
    if limit > 1 << 22:
        return np.unique(codes)
    return np.flatnonzero(np.bincount(codes, minlength=1))
