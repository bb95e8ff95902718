# SPDX-License-Identifier: Apache-2.0
"""Contents of regions: label histograms, keys, and a table of all windows with each key.

LSA16 section 6. A window is identified by its top-left pixel. Id 0 is unlabeled.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.errors import ImageError

NO_KEY = 0xFFFFFFFF  # in a key map: invalid window
TABLE_BYTES = 22  # peak per pixel of a label map while its windows are sorted by content
_SORTED = 1 << 16  # windows sorted at once, of 70 bytes each
_TILE = 256  # side of a tile of offsets: a small tile holds few labels, and only those are counted


def patch_side(rho: float) -> int:
    """Side of a patch for patterns of scale rho: the nearest power of two from 16 to 256 (LSA16 section 6.1)."""
    return 2 ** int(np.clip(np.rint(np.log2(max(rho, 1.0))), 4, 8))


def box_counts(chosen: np.ndarray, side: int) -> np.ndarray:
    """Number of pixels of `chosen` (h, w) bool in each window: (h - side + 1, w - side + 1) int32."""
    sums = np.zeros((chosen.shape[0] + 1, chosen.shape[1] + 1), np.int32)
    np.cumsum(chosen, 0, np.int32, out=sums[1:, 1:])
    np.cumsum(sums[1:, 1:], 1, np.int32, out=sums[1:, 1:])
    return sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]


def histogram(labels: np.ndarray, y: int, x: int, side: int) -> dict[int, int]:
    """Label histogram h of the window at (y, x), id -> pixels (LSA16 eq. 9), without unlabeled pixels."""
    ids, counts = np.unique(labels[y : y + side, x : x + side], return_counts=True)
    return {int(c): int(n) for c, n in zip(ids, counts, strict=True) if c != 0}


def key_of(counts: dict[int, int]) -> tuple[int, int]:
    """(k1, k2): the two most frequent labels of a histogram, ties to the lower id; k2 = k1 if there is only one."""
    if not counts:
        return 0, 0
    order = sorted(counts, key=lambda c: (-counts[c], c))
    return order[0], order[min(1, len(order) - 1)]


def whole_windows(allowed: np.ndarray, side: int) -> np.ndarray:
    """Windows that lie fully inside `allowed` (h, w) bool: (h - side + 1, w - side + 1) bool."""
    out = np.empty((allowed.shape[0] - side + 1, allowed.shape[1] - side + 1), bool)
    for place, piece in _tiles(out.shape, side):
        out[place] = box_counts(allowed[piece], side) == side * side
    return out


def largest_window(allowed: np.ndarray) -> int:
    """Side of the largest square that lies fully inside `allowed` (h, w) bool; 0 if `allowed` is empty."""
    low, high = 0, min(allowed.shape)
    while low < high:
        side = (low + high + 1) // 2
        low, high = (side, high) if whole_windows(allowed, side).any() else (low, side - 1)
    return low


def regions(chosen: np.ndarray, block: int) -> int:
    """Number of blocks of block x block offsets that contain a chosen one; `chosen` is (h, w) bool."""
    rows, columns = (-(-n // block) * block for n in chosen.shape)
    padded = np.zeros((rows, columns), bool)
    padded[: chosen.shape[0], : chosen.shape[1]] = chosen
    return int(padded.reshape(rows // block, block, -1, block).any((1, 3)).sum())


def window_keys(labels: np.ndarray, side: int, allowed: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Keys (k1, k2) of all windows, by integral images, label by label in small tiles of the map.

    Memory is a small multiple of that of the map, for any number of labels. Both arrays are (h - side + 1, w - side +
    1) int32, and 0 where the window contains a pixel that is unlabeled or not allowed.
    """
    shape = (labels.shape[0] - side + 1, labels.shape[1] - side + 1)
    first, second = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
    for place, piece in _tiles(shape, side):
        ids = labels[piece]
        good = ids != 0 if allowed is None else (ids != 0) & allowed[piece]
        if good.all() and (ids == ids[0, 0]).all():  # a single label, as without label maps
            first[place] = second[place] = ids[0, 0]
            continue
        whole = box_counts(good, side) == side * side
        if not whole.any():
            continue
        k1, k2 = np.zeros(whole.shape, np.int32), np.zeros(whole.shape, np.int32)
        n1, n2 = np.zeros(whole.shape, np.int32), np.zeros(whole.shape, np.int32)
        # ascending: with a strict comparison ties go to the lower id
        for label in _distinct(ids[good], int(ids.max()) + 1):
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
    """Tiles of a map of offsets, and the pixels that their windows cover."""
    step = max(_TILE, 2 * side)
    for y in range(0, shape[0], step):
        for x in range(0, shape[1], step):
            y1, x1 = min(y + step, shape[0]), min(x + step, shape[1])
            yield (slice(y, y1), slice(x, x1)), (slice(y, y1 + side - 1), slice(x, x1 + side - 1))


@dataclass(frozen=True)
class ContentTable:
    """Key -> all offsets whose window has this key (LSA16 figure 11), in memory proportional to the exemplar."""

    keys: np.ndarray  # (n, 2) int32: (k1, k2), ascending
    starts: np.ndarray  # (n + 1,) int64: offsets of key n are `offsets[starts[n]:starts[n + 1]]`, row by row
    offsets: np.ndarray  # (m,) uint32, as `SourceMap.packed`
    key_map: np.ndarray  # (h - side + 1, w - side + 1) uint32: index of the key of each offset, or NO_KEY

    def nearest(self, key: tuple[int, int]) -> int:
        """Index of the key, or of the nearest key that has offsets.

        In order of preference: the pure (k1, k1); any other (k1, .); (., k1); the pure (k2, k2); (k2, .); (., k2);
        any. Of several, the one with most offsets, ties to the lower ids.
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
        """Number of offsets of each key."""
        return np.diff(self.starts)


def content_table(first: np.ndarray, second: np.ndarray, side: int) -> ContentTable:
    """The table of the keys from `window_keys`; raises ImageError if there is no valid window."""
    if not first.any():
        raise ImageError(f"no {side}x{side} patch of the exemplar lies within labeled pixels; reduce patch")
    most = int(max(first.max(), second.max())) + 1
    width, step = first.shape[1], max(1, _SORTED // first.shape[1])

    def strips() -> Iterable[tuple[int, np.ndarray, np.ndarray]]:
        """For some rows: the first row, which of their windows have a key, and the codes of these keys."""
        for top in range(0, len(first), step):
            one, other = (keys[top : top + step].ravel() for keys in (first, second))
            good = np.flatnonzero(one)
            yield top, good, one[good].astype(np.int64) * most + other[good]

    found = [_distinct(codes, most * most) for _, _, codes in strips()]
    present = _distinct(np.concatenate(found), most * most)
    counts = np.zeros(len(present), np.int64)
    for _, _, codes in strips():
        counts += np.bincount(np.searchsorted(present, codes), minlength=len(present))
    starts = np.append(0, counts.cumsum())
    key_map, offsets = np.full(first.shape, NO_KEY, np.uint32), np.empty(starts[-1], np.uint32)
    free = starts[:-1].copy()  # position of the next offset of each key: sorting by strips needs no large index
    for top, good, codes in strips():
        number = np.searchsorted(present, codes)
        key_map[top : top + step].reshape(-1)[good] = number
        order = np.argsort(number, kind="stable")
        number, y, x = number[order], *np.divmod(good[order], width)
        here = np.bincount(number, minlength=len(present))
        place = np.arange(len(number)) + (free - (here.cumsum() - here))[number]
        offsets[place] = SourceMap.of(top + y, x).packed
        free += here
    keys = np.stack([present // most, present % most], 1).astype(np.int32)
    return ContentTable(keys=keys, starts=starts, offsets=offsets, key_map=key_map)


def _distinct(codes: np.ndarray, limit: int) -> np.ndarray:
    """Distinct values, ascending."""
    if limit > 1 << 22:
        return np.unique(codes)
    return np.flatnonzero(np.bincount(codes, minlength=1))
