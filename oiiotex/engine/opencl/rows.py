# SPDX-License-Identifier: Apache-2.0
"""Images processed out-of-core, in bands of rows on the device."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..core.demand import SomeRows
from ..core.scratch import AT_ONCE, RowStore
from ..deferred import np
from .buffers import Buffers
from .device import Device, Download


def unwrapped(height: int, first: int, last: int) -> Iterator[tuple[int, int, int]]:
    """Rows first to last of an image that wraps at `height`, in runs (row, count, rows before the run)."""
    row = first
    while row < last:
        place = row % height
        count = min(last - row, height - place)
        yield place, count, row - first
        row += count


class Rows:
    """The rows of one image; buffer `name` holds all of them, or the loaded ones.

    Parameters
    ----------
    device : Device
    buffers : Buffers
    name : str
    width, height : int
    wraps : bool
        The image repeats beyond the border.
    store : RowStore, array or MadeRows, or None
        Storage of the rows; None: the buffer holds all of them.
    most : int
        Number of rows that may be loaded at once.
    """

    def __init__(
        self, device: Device, buffers: Buffers, name: str, width: int, height: int, wraps: bool, store: SomeRows | None,
        most: int,
    ):  # fmt: skip
        self._device, self._buffers = device, buffers
        self.name, self.width, self.height, self.wraps, self.store = name, width, height, wraps, store
        self.most = height if store is None else most
        self._coming: tuple[Any, int, int, Download] | None = None

    def bands(self, first: int = 0, last: int | None = None, most: int | None = None) -> Iterator[tuple[int, int]]:
        """Rows first to last (default: all) in bands of `most`; in one band if the buffer holds all rows."""
        last = self.height if last is None else last
        step = max(1, last - first) if self.store is None else most or self.most
        for top in range(first, last, step):
            yield top, min(top + step, last)

    def load(self, first: int, last: int) -> int:
        """Load rows first to last into the buffer; returns the row at its start, 0 if it holds all rows.

        Rows beyond the border are wrapped if the image wraps, else omitted.
        """
        if self.store is None:
            return 0
        if not self.wraps:
            first, last = max(0, first), min(self.height, last)
        row = int(np.prod(self.store.shape[1:])) * self.store.dtype.itemsize
        step = max(1, AT_ONCE // row)
        for place, count, at in unwrapped(self.height, first, last):
            for n in range(0, count, step):
                rows = self.store[place + n : place + min(n + step, count)]
                self._device.write(self._buffers[self.name], rows, (at + n) * row)
        return first

    def save(self, top: int, bottom: int, first: int | None = None, into: np.ndarray | RowStore | None = None) -> None:
        """Store rows of the buffer, whose first row is `first` (default: `top`); a no-op if it holds all rows."""
        self.save_later(top, bottom, first, into)
        self.settle()

    def save_later(
        self, top: int, bottom: int, first: int | None = None, into: np.ndarray | RowStore | None = None
    ) -> None:
        """As `save`, but asynchronous: call `settle` before this buffer is written, or the stored rows are read."""
        self.settle()
        store = self.store if into is None else into
        if store is not None:
            shape = (bottom - top, *store.shape[1:])
            at = (top - (top if first is None else first)) * (int(np.prod(shape[1:])) * store.dtype.itemsize)
            rows = self._device.read_later(self._buffers[self.name], shape, store.dtype, at)
            self._coming = store, top, bottom, rows

    def settle(self) -> None:
        """Wait for the rows of `save_later`, and store them."""
        if self._coming is not None:
            store, top, bottom, rows = self._coming
            self._coming = None
            store[top:bottom] = rows.array()
