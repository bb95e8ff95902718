# SPDX-License-Identifier: Apache-2.0
"""Images that pass through the device's memory in bands of rows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..core.demand import SomeRows
from ..core.scratch import AT_ONCE, RowStore
from ..deferred import np
from .buffers import Buffers, Download
from .device import Device


def unwrapped(height: int, first: int, last: int) -> Iterator[tuple[int, int, int]]:
    """Rows that are counted on beyond the border of so many, as (row, count, rows before them)."""
    row = first
    while row < last:
        place = row % height
        count = min(last - row, height - place)
        yield place, count, row - first
        row += count


class Rows:
    """The rows of one image; buffer `name` holds them all, or those that were loaded.

    Parameters
    ----------
    device : Device
    buffers : Buffers
    name : str
    width, height : int
    wraps : bool
        They go on beyond the border.
    store : RowStore, array or MadeRows, or None
        Where they lie when the buffer does not hold them; None: it holds all.
    most : int
        Rows that may be loaded at once.
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
        """Rows first to last, all when left out, in bands of `most`; in one where the buffer holds them all."""
        last = self.height if last is None else last
        step = max(1, last - first) if self.store is None else most or self.most
        for top in range(first, last, step):
            yield top, min(top + step, last)

    def load(self, first: int, last: int) -> int:
        """Bring rows first to last into the buffer; returns which row lies at its start, 0 where it holds them all.

        Rows beyond the border are those where the image begins anew if it wraps, else none.
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
        """Keep rows of the buffer, at the start of which lies row `first` (`top`); nothing to do where it holds all."""
        self.save_later(top, bottom, first, into)
        self.settle()

    def save_later(
        self, top: int, bottom: int, first: int | None = None, into: np.ndarray | RowStore | None = None
    ) -> None:
        """As `save`, while the device goes on: `settle` comes before what writes this buffer, or reads the rows."""
        self.settle()
        store = self.store if into is None else into
        if store is not None:
            shape = (bottom - top, *store.shape[1:])
            at = (top - (top if first is None else first)) * (int(np.prod(shape[1:])) * store.dtype.itemsize)
            rows = self._device.read_later(self._buffers[self.name], shape, store.dtype, at)
            self._coming = store, top, bottom, rows

    def settle(self) -> None:
        """Wait for the rows that are saved, and keep them."""
        if self._coming is not None:
            store, top, bottom, rows = self._coming
            self._coming = None
            store[top:bottom] = rows.array()
