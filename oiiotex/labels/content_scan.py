# SPDX-License-Identifier: Apache-2.0
"""The contents of a label map of any size, looked through in strips: which keys its windows have, and where.

What `content_table` is for an exemplar that is held. Keys are exact counts, so strips do not show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ..core.demand import BAND_BYTES, cached, stream
from ..core.image import Part
from ..core.window import Window
from ..deferred import np
from ..session.resources import Resources
from .content_table import window_keys

_STEP = 256  # columns of windows that a thread looks at, at least
_DENSE = 1 << 22  # pairs of labels that are counted in a table
_STRIP_PIXELS = BAND_BYTES // 8
_ID_BYTES, _KEY_BYTES = 12, 30  # of a pixel and of a window of a strip; measured, as the next
_PIECE_BYTES = 24  # of a pixel that a thread looks at meanwhile
_KEY_BITS = 32  # k1 << _KEY_BITS | k2


@dataclass(frozen=True)
class Strip:
    """Keys of some rows of windows, a window named by its top left pixel in the data window.

    Attributes
    ----------
    top : int
        The first row.
    keys : (rows, columns) int64
        k1 << 32 | k2 of `content_table.window_keys`; 0: none.
    counts : dict of int to int
        How many windows have each key.
    ids : (rows, width)
        Labels of the rows that no other strip gives.
    """

    top: int
    keys: np.ndarray
    counts: dict[int, int]
    ids: np.ndarray


def key_pair(code: int) -> tuple[int, int]:
    """(k1, k2) of a key as strips have it."""
    return code >> _KEY_BITS, code & ((1 << _KEY_BITS) - 1)


def key_code(key: tuple[int, int]) -> int:
    """The inverse of `key_pair`."""
    return key[0] << _KEY_BITS | key[1]


def add_areas(areas: dict[int, int], ids: np.ndarray) -> None:
    """Count the pixels of each label in an array of ids, too."""
    if int(ids.max()) < _DENSE:
        counted = np.bincount(ids.ravel())
        labels = np.flatnonzero(counted)
        found = zip(labels.tolist(), counted[labels].tolist(), strict=True)
    else:
        found = zip(*(a.tolist() for a in np.unique(ids, return_counts=True)), strict=True)
    for label, count in found:
        areas[label] = areas.get(label, 0) + count


def scan_bytes(width: int, height: int, side: int, resources: Resources) -> int:
    """Memory of `key_strips`, whatever the map's height."""
    across = _columns(side) + side
    pieces = resources.thread_count * min(width, across) * min(height, across)
    rows = min(height, _rows(width, side))
    strip = _ID_BYTES * min(height, rows + side) + _KEY_BYTES * rows
    return strip * width + _PIECE_BYTES * pieces


def key_strips(labels: Part, side: int, resources: Resources, advance: Callable[[], object]) -> Iterator[Strip]:
    """All windows of side x side px, from the top down.

    Parameters
    ----------
    labels : Part
        One channel of ids; 0 is no label.
    side : int
        px; as the map is wide and high at most.
    advance : callable
        Called after each strip.
    """
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
        yield Strip(band.top, np.concatenate([keys for keys, _ in keyed], 1), counts, ids[:mine])
        advance()


def strip_count(labels: Part, side: int) -> int:
    """How many strips `key_strips` gives."""
    return -(-(labels.spec.height - side + 1) // _rows(labels.spec.width, side))


def _rows(width: int, side: int) -> int:
    """Of windows in a strip: as many as it holds pixels, but no few, whose halo would be all the work."""
    return max(side // 2, _STRIP_PIXELS // width - side)


def _columns(side: int) -> int:
    return max(_STEP, 2 * side)


def _keyed(ids: np.ndarray, side: int) -> tuple[np.ndarray, dict[int, int]]:
    """Keys of the windows of a piece, and how many have each."""
    first, second = window_keys(ids, side)
    most = int(max(first.max(), second.max())) + 1
    if most * most <= _DENSE:
        counted = np.bincount((first * np.int32(most) + second).ravel(), minlength=1)
        present = np.flatnonzero(counted)
        counts = {key_code(divmod(int(n), most)): int(counted[n]) for n in present}
        keys = first.astype(np.int64) << _KEY_BITS | second
    else:
        keys = first.astype(np.int64) << _KEY_BITS | second
        counts = dict(zip(*(a.tolist() for a in np.unique(keys, return_counts=True)), strict=True))
    counts.pop(0, None)
    return keys, counts
