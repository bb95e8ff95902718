# SPDX-License-Identifier: Apache-2.0
"""What is in a region: label histograms, keys, and the table from a key to all windows that have it.

LSA16 section 6. A window is named by its top-left pixel. Id 0 is no label.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..core.source_map import SourceMap
from ..deferred import np
from ..errors import ImageError

NO_KEY = 0xFFFFFFFF  # in a key map: no window may be taken here
TABLE_BYTES = 22  # held for every pixel of a label map while its windows are sorted by content, at most
_SORTED = 1 << 16  # windows that are sorted at once, of 70 bytes each
_TILE = 256  # offsets looked at together: a small piece holds few labels, and only those are counted


def patch_side(rho: float) -> int:
    """The side of a patch that holds patterns of scale rho: a power of two near it, 16 to 256 (LSA16 section 6.1)."""
    return 2 ** int(np.clip(np.rint(np.log2(max(rho, 1.0))), 4, 8))


def box_counts(chosen: np.ndarray, side: int) -> np.ndarray:
    """How many pixels of `chosen` (h, w) bool every window holds: (h - side + 1, w - side + 1) int32."""
    sums = np.zeros((chosen.shape[0] + 1, chosen.shape[1] + 1), np.int32)
    np.cumsum(chosen, 0, np.int32, out=sums[1:, 1:])
    np.cumsum(sums[1:, 1:], 1, np.int32, out=sums[1:, 1:])
    return sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]


def histogram(labels: np.ndarray, y: int, x: int, side: int) -> dict[int, int]:
    """The label histogram h of a window, id -> pixels (LSA16 eq. 9). Pixels without label do not count.

    Parameters
    ----------
    labels : (h, w) of ids
    y, x : int
        The window's top-left pixel.
    side : int
        px.
    """
    ids, counts = np.unique(labels[y : y + side, x : x + side], return_counts=True)
    return {int(c): int(n) for c, n in zip(ids, counts, strict=True) if c != 0}


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
        if good.all() and (ids == ids[0, 0]).all():  # one label, as where nothing is said of labels
            first[place] = second[place] = ids[0, 0]
            continue
        whole = box_counts(good, side) == side * side
        if not whole.any():
            continue
        k1, k2 = np.zeros(whole.shape, np.int32), np.zeros(whole.shape, np.int32)
        n1, n2 = np.zeros(whole.shape, np.int32), np.zeros(whole.shape, np.int32)
        # in ascending order: with a strict comparison ties go to the lower id
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
    """Pieces of a map of offsets, and the pixels that their windows see."""
    step = max(_TILE, 2 * side)
    for y in range(0, shape[0], step):
        for x in range(0, shape[1], step):
            y1, x1 = min(y + step, shape[0]), min(x + step, shape[1])
            yield (slice(y, y1), slice(x, x1)), (slice(y, y1 + side - 1), slice(x, x1 + side - 1))


@dataclass(frozen=True)
class ContentTable:
    """Key -> all offsets whose window has this key (LSA16 figure 11).

    Only offsets are stored, so its size is proportional to the exemplar.

    Attributes
    ----------
    keys : (n, 2) int32
        (k1, k2) in ascending order.
    starts : (n + 1,) int64
        Offsets of key n are `offsets[starts[n]:starts[n + 1]]`, row by row.
    offsets : (m,) uint32
        As `SourceMap.packed`.
    key_map : (h - side + 1, w - side + 1) uint32
        The number of the key of every offset, or NO_KEY.
    """

    side: int
    keys: np.ndarray
    starts: np.ndarray
    offsets: np.ndarray
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


def content_table(first: np.ndarray, second: np.ndarray, side: int) -> ContentTable:
    """The table of what `window_keys` found.

    Parameters
    ----------
    first, second : (h - side + 1, w - side + 1) int32
        k1 and k2 of every window; 0: none.
    side : int
        Of a window, px.

    Raises
    ------
    ImageError
        There is no window at all.
    """
    if not first.any():
        raise ImageError(f"no {side}x{side} patch of the exemplar has a label throughout")
    most = int(max(first.max(), second.max())) + 1
    width, step = first.shape[1], max(1, _SORTED // first.shape[1])

    def strips() -> Iterable[tuple[int, np.ndarray, np.ndarray]]:
        """Of some rows: the first, which of their windows have a key, and the keys' codes."""
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
    free = starts[:-1].copy()  # where the next offset of each key goes: sorted strip by strip, no index is as large
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
    return ContentTable(side=side, keys=keys, starts=starts, offsets=offsets, key_map=key_map)


def _distinct(codes: np.ndarray, limit: int) -> np.ndarray:
    """The values there are, ascending."""
    if limit > 1 << 22:
        return np.unique(codes)
    return np.flatnonzero(np.bincount(codes, minlength=1))
