# SPDX-License-Identifier: Apache-2.0
"""Contents of a label map of any size, read in strips: the keys of its windows, and their positions.

The out-of-core counterpart of `content_table`. Keys are exact counts, so strips do not affect the result.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from ...engine.core.demand import BAND_BYTES, cached, stream
from ...engine.core.image import Part
from ...engine.core.label_map import LabelMap
from ...engine.core.scratch import empty_rows
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from .content_table import window_keys

_STEP = 256  # least columns of windows per thread
_DENSE = 1 << 22  # pairs of labels up to which counts are held in a dense table
_STRIP_PIXELS = BAND_BYTES // 8
_ID_BYTES, _KEY_BYTES = 12, 30  # per pixel and per window of a strip; measured, as is the next
_PIECE_BYTES = 24  # per pixel that a thread works on
CELL = 128  # px: precision of the positions of `fullest_windows`
_KEY_BITS = 32  # k1 << _KEY_BITS | k2


@dataclass(frozen=True)
class _Strip:
    """Keys of some rows of windows; a window is identified by its top-left pixel in the data window."""

    top: int  # the first row
    keys: np.ndarray  # (rows, columns) int64: k1 << 32 | k2 of `content_table.window_keys`; 0: none
    counts: dict[int, int]  # number of windows with each key
    ids: np.ndarray  # (rows, width): labels of the rows that belong to this strip


def _key_pair(code: int) -> tuple[int, int]:
    """(k1, k2) of a key of a strip."""
    return code >> _KEY_BITS, code & ((1 << _KEY_BITS) - 1)


def _key_code(key: tuple[int, int]) -> int:
    """The inverse of `_key_pair`."""
    return key[0] << _KEY_BITS | key[1]


def _add_areas(areas: dict[int, int], ids: np.ndarray) -> None:
    """Add the number of pixels of each label in an array of ids."""
    if int(ids.max()) < _DENSE:
        counted = np.bincount(ids.ravel())
        labels = np.flatnonzero(counted)
        found = zip(labels.tolist(), counted[labels].tolist(), strict=True)
    else:
        found = zip(*(a.tolist() for a in np.unique(ids, return_counts=True)), strict=True)
    for label, count in found:
        areas[label] = areas.get(label, 0) + count


def scan_bytes(width: int, height: int, side: int, facts: Facts) -> int:
    """Memory of `_key_strips`, in bytes, for a map of any height."""
    across = _columns(side) + side
    pieces = facts.thread_count * min(width, across) * min(height, across)
    rows = min(height, _rows(width, side))
    strip = _ID_BYTES * min(height, rows + side) + _KEY_BYTES * rows
    return strip * width + _PIECE_BYTES * pieces


def _key_strips(labels: Part, side: int, resources: Resources, advance: Callable[[], object]) -> Iterator[_Strip]:
    """All windows of side x side px of a map of ids (0: unlabeled), top down; `advance` is called after each strip."""
    whole, part = labels.window, cached(labels, resources.cache)
    bands = list(Window(0, 0, whole.width, whole.height - side + 1).cells(whole.width, _rows(whole.width, side)))
    pieces = list(Window(0, 0, whole.width - side + 1, 1).cells(_columns(side), 1))
    wanted = (Window(whole.left, whole.top + b.top, whole.right, whole.top + b.bottom + side - 1) for b in bands)
    for band, (_, pixels) in zip(bands, stream(part, wanted), strict=True):
        ids = pixels[..., 0]
        given = [ids[:, p.left : p.right + side - 1] for p in pieces]
        keyed = list(resources.spread(lambda seen: _keyed(seen, side), given))
        counts: dict[int, int] = {}
        for _, found in keyed:
            for code, count in found.items():
                counts[code] = counts.get(code, 0) + count
        mine = band.height if band.bottom + side - 1 < whole.height else len(ids)
        yield _Strip(band.top, np.concatenate([keys for keys, _ in keyed], 1), counts, ids[:mine])
        advance()


def _rows(width: int, side: int) -> int:
    """Rows of windows in a strip: limited by its memory, but enough that halos do not dominate the work."""
    return max(side // 2, _STRIP_PIXELS // width - side)


def _columns(side: int) -> int:
    return max(_STEP, 2 * side)


def _keyed(ids: np.ndarray, side: int) -> tuple[np.ndarray, dict[int, int]]:
    """Keys of the windows of a piece, and the number of windows with each key."""
    first, second = window_keys(ids, side)
    most = int(max(first.max(), second.max())) + 1
    if most * most <= _DENSE:
        counted = np.bincount((first * np.int32(most) + second).ravel(), minlength=1)
        present = np.flatnonzero(counted)
        counts = {_key_code(divmod(int(n), most)): int(counted[n]) for n in present}
        keys = first.astype(np.int64) << _KEY_BITS | second
    else:
        keys = first.astype(np.int64) << _KEY_BITS | second
        counts = dict(zip(*(a.tolist() for a in np.unique(keys, return_counts=True)), strict=True))
    counts.pop(0, None)
    return keys, counts


class Contents:
    """Number of windows of `side` px with each key in a label map, and centers of the windows with one key.

    `passes` is how often the map will be read: 2 if `middles` is called.
    """

    def __init__(
        self, labels: Part, side: int, resources: Resources, progress: Progress, key: tuple[int, int], passes: int
    ):
        self.side, self.key, self.areas = side, key, dict[int, int]()
        self._labels, self._resources, self._progress, self._half = labels, resources, progress, side // 2
        width, height = labels.spec.width, labels.spec.height
        strips = -(-(height - side + 1) // _rows(width, side))  # of `_key_strips`
        self._done, self._total = 0, passes * strips
        size = height, -(-width // 8)  # a bit for each pixel
        self._marks = empty_rows(size, np.uint8, in_memory=size[0] * size[1] <= resources.budget // 4)
        self._rows = range(self._half, self._half + height - side + 1)
        found: Counter[int] = Counter()
        for strip in self._strips():
            found.update(strip.counts)
            if passes > 1:
                _add_areas(self.areas, strip.ids)
            marked = np.zeros((len(strip.keys), width), bool)
            marked[:, self._half : self._half + strip.keys.shape[1]] = (strip.keys == _key_code(key)) & any(key)
            at = strip.top + self._half
            self._marks[at : at + len(marked)] = np.packbits(marked, 1)
        if not found:
            raise ImageError(f"no {side}x{side} patch of the exemplar lies within labeled pixels; reduce patch")
        self.counts = {_key_pair(code): found[code] for code in sorted(found)}

    def _strips(self) -> Iterator[_Strip]:
        return _key_strips(self._labels, self.side, self._resources, self._advance)

    def _advance(self) -> None:
        self._done += 1
        self._progress.advance(self._done, self._total)

    def centers(self, rows: range) -> np.ndarray:
        """Whether pixels in rows of the data window are centers of windows with the key: (rows, width) bool."""
        width = self._labels.spec.width
        out = np.zeros((len(rows), width), bool)
        begin, end = max(rows.start, self._rows.start), min(rows.stop, self._rows.stop)
        if begin < end:
            bits = np.unpackbits(self._marks[begin:end], 1, count=width)
            out[begin - rows.start : end - rows.start] = bits.view(bool)
        return out

    def middles(self, keys: Iterable[tuple[int, int]]) -> dict[tuple[int, int], tuple[int, int]]:
        """Top and left of the median window of each key: the first may be an outlier at a border."""
        left = {_key_code(key): self.counts[key] // 2 for key in keys}  # windows before it
        places = {}
        for strip in self._strips():
            for code, count in strip.counts.items():
                if code in left and left[code] < count:
                    at = np.flatnonzero(strip.keys == code)[left.pop(code)]
                    row, column = divmod(int(at), strip.keys.shape[1])
                    places[_key_pair(code)] = strip.top + row, column
                elif code in left:
                    left[code] -= count
        return places


def areas_of(labels: LabelMap, usable: np.ndarray | None) -> np.ndarray:
    """Number of usable pixels of each label, by id."""
    areas: dict[int, int] = {}
    for _, ids in _bands(labels, usable):
        _add_areas(areas, ids)
    out = np.zeros(max(areas) + 1, np.int64)
    out[list(areas)] = list(areas.values())
    return out


def fullest_windows(labels: LabelMap, usable: np.ndarray | None, wanted: list[int], reach: int) -> dict[int, Window]:
    """For each label the window of reach x reach px, or less in a small map, with most pixels of it."""
    whole = labels.part.window
    cells = -(-whole.height // CELL), -(-whole.width // CELL)
    number = {label: n for n, label in enumerate(wanted)}
    counts = np.zeros((len(wanted), *cells), np.int32)
    for top, ids in _bands(labels, usable):
        columns = np.broadcast_to(np.arange(ids.shape[1]) // CELL, ids.shape)
        for label in np.intersect1d(ids, wanted).tolist():
            counts[number[label], top // CELL] += np.bincount(columns[ids == label], minlength=cells[1]).astype(
                np.int32
            )
    windows = {}
    for label, n in number.items():
        high, wide = (min(size, reach // CELL) for size in cells)
        sums = np.pad(counts[n].cumsum(0).cumsum(1), ((1, 0), (1, 0)))
        held = sums[high:, wide:] - sums[:-high, wide:] - sums[high:, :-wide] + sums[:-high, :-wide]
        y, x = (int(i) * CELL for i in np.unravel_index(int(held.argmax()), held.shape))
        windows[label] = Window.sized(x, y, wide * CELL, high * CELL) & Window(0, 0, whole.width, whole.height)
    return windows


def _bands(labels: LabelMap, usable: np.ndarray | None) -> Iterator[tuple[int, np.ndarray]]:
    """Ids of usable pixels, else 0, top down: (first row, ids of up to CELL rows)."""
    part, whole = labels.part, labels.part.window
    for window, pixels in stream(part, whole.cells(whole.width, CELL)):
        rows = window.inside(whole)[0]
        ids = pixels[..., 0]
        yield rows.start, ids if usable is None else np.where(usable[rows], ids, 0)
