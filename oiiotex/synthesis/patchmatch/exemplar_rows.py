# SPDX-License-Identifier: Apache-2.0
"""The planes of a level's exemplar: they are in the device's buffers, or pass through them in pieces of rows.

A pass processes one piece after another, and only the matches whose patches begin in it. Results do not depend on the
order of pieces (cl/patchmatch.cl), so they are bit-identical for any piece height.
"""

from __future__ import annotations

from collections.abc import Iterator

from ...engine.core.demand import MadeRows, SomeRows
from ...engine.core.scratch import AT_ONCE, RowStore
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from ...engine.opencl.rows import Rows
from .field import Geometry

RowRange = tuple[int, int]
"""Patches of the exemplar, by the rows that they begin in: (first, last)."""

LEAST_ROWS = 16  # minimum height of a piece or a band
_REGION, _SMALL, _GROWTH = 32, 13, 9  # px; larger patches keep larger objects, which many regions are part of


def region_of(patch: int) -> int:
    """Side of a region whose reuse is penalized, px at full size (use_prices.py): the size of objects, as of patches.

    If regions are smaller than the photo's objects, a whole object pays for each of its regions that is also used
    elsewhere, and one that is pieced together from several does not.
    """
    return _REGION + _GROWTH * max(0, patch - _SMALL)


def piece_halo(patch: int) -> int:
    """Rows that buffers hold in addition to those of a piece: penalties depend on uses around them."""
    return 2 * max(patch - 1, region_of(patch))


class ExemplarRows:
    """The exemplar and the penalties of its patches on one level.

    `image` (exemplar_height, exemplar_width, channels) int16; `allowed` (exemplar_rows, exemplar_columns) bool; `price`
    (exemplar_rows, exemplar_columns) float32 or None.
    """

    def __init__(
        self, device: Device, buffers: Buffers, geometry: Geometry, image: SomeRows, allowed: np.ndarray,
        price: SomeRows | None = None,
    ):  # fmt: skip
        g = self._geometry = geometry
        self._device, self._buffers = device, buffers
        held = buffers["exemplar"].size // (2 * g.channels * g.exemplar_width)
        held = min(held, buffers["penalty"].size // (4 * g.exemplar_width))
        self.whole = held >= g.exemplar_height
        self._most = g.exemplar_rows if self.whole else held - piece_halo(g.patch)
        self._at: RowRange | None = None
        self._loaded: dict[str, RowRange] = {}
        self._rows: dict[str, Rows] = {}
        self.plane("exemplar", image)

        def priced(first: int, last: int) -> np.ndarray:
            rows = slice(first, last)
            return np.where(allowed[rows], np.float32(1) if price is None else price[rows], np.float32(-1))

        self.plane("price", MadeRows(allowed.shape, np.float32, priced))
        self._plane("penalty", None if self.whole else RowStore(allowed.shape, np.int32))

    def plane(self, name: str, values: SomeRows) -> None:
        """Let rows pass through the buffer of that name."""
        self._plane(name, None if self.whole else values)
        if self.whole:
            row = int(np.prod(values.shape[1:])) * values.dtype.itemsize
            step = max(1, AT_ONCE // row)
            for first in range(0, len(values), step):
                self._device.write(self._buffers[name], values[first : first + step], first * row)

    def _plane(self, name: str, store: SomeRows | None) -> Rows:
        g = self._geometry
        width, height = g.exemplar_columns, g.exemplar_rows
        if name == "exemplar":
            width, height = g.exemplar_width, g.exemplar_height
        self._rows[name] = Rows(self._device, self._buffers, name, width, height, False, store, self._most)
        return self._rows[name]

    @property
    def count(self) -> int:
        """Number of pieces."""
        return -(-self._geometry.exemplar_rows // self._most)

    def pieces(self, *names: str) -> Iterator[RowRange]:
        """One piece after another, with the rows of the named planes loaded."""
        rows, step = self._geometry.exemplar_rows, self._most
        pieces = [(first, min(first + step, rows)) for first in range(0, rows, step)]
        if pieces[-1] == self._at:  # still loaded from the last sweep
            pieces.reverse()
        for piece in pieces:
            for name in names:
                self._load(name, piece)
            self._at = piece
            yield piece

    def _load(self, name: str, piece: RowRange) -> None:
        if not self.whole and self._loaded.get(name) != piece:
            first, last = piece
            self._rows[name].load(first, last + (self._geometry.patch - 1 if name == "exemplar" else 0))
            self._loaded[name] = piece

    def keep_penalty(self, piece: RowRange) -> None:
        """Save buffer `penalty` as the penalties of a piece."""
        if not self.whole:
            first, last = piece
            step = max(1, AT_ONCE // (4 * self._geometry.exemplar_columns))
            for top in range(first, last, step):
                self._rows["penalty"].save(top, min(top + step, last), first)
            self._loaded["penalty"] = piece
