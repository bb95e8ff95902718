# SPDX-License-Identifier: Apache-2.0
"""Device memory: declared in total, checked, allocated, released."""

from __future__ import annotations

import contextlib
import logging
import weakref
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeVar

from ..deferred import np
from ..errors import DeviceError, MemoryBudgetError, OutOfDeviceMemory, megabytes
from .device import INT_RANGE

if TYPE_CHECKING:
    import pyopencl as cl

    from .device import Device, DeviceMemory

log = logging.getLogger("oiiotex")

Made = TypeVar("Made")

_WORTH_SAYING = 1 << 30  # bytes from which an allocation is logged


class Buffers:
    """Device memory declared in total: summed, checked against the budget and the device, then allocated.

    Parameters
    ----------
    device : Device
    layout : dict of name to bytes
    budget : int
        Bytes of the host's memory that this process may use; `Device.memory_budget` derives the device's share.
    asker : str
        Name of the task, for errors.
    held : int
        Bytes of the host's memory that the task holds in addition.
    tables : dict of name to array
        Read-only arrays, which must not change. A device that uses the host's memory does not copy them.

    Raises
    ------
    DeviceError
        The buffers do not fit; the message names the required and the available size.
    OutOfDeviceMemory
        The device cannot allocate the memory that it reports.
    """

    def __init__(
        self, device: Device, layout: dict[str, int], budget: int, asker: str, held: int = 0,
        tables: dict[str, np.ndarray] | None = None,
    ):  # fmt: skip
        tables = tables or {}
        total = require_room(device, layout, budget, asker, held, tables)
        if total >= _WORTH_SAYING:
            log.info("%s uses %d MB of %s", asker, megabytes(total), device.info.name)
        flags = device._cl.mem_flags.READ_WRITE
        device.taken += total
        self._buffers: dict[str, cl.Buffer] = {}
        self._release = weakref.finalize(self, _released, device, self._buffers, total, bool(tables))
        try:
            for name, size in layout.items():
                self._buffers[name] = device._cl.Buffer(device._context, flags, max(1, size))
            for name, table in tables.items():
                self._buffers[name] = device.lend(table)
        except (device._cl.Error, OutOfDeviceMemory) as error:
            self._release()
            raise OutOfDeviceMemory(f"{asker}: {device.info.name} could not allocate {megabytes(total)} MB") from error

    def __getitem__(self, name: str) -> cl.Buffer:
        return self._buffers[name]

    def swap(self, first: str, second: str) -> None:
        """Exchange two buffers of equal size (ping-pong)."""
        buffers = self._buffers
        buffers[first], buffers[second] = buffers[second], buffers[first]

    def __enter__(self) -> Buffers:
        return self

    def __exit__(self, *_: object) -> None:
        self._release()


def require_room(
    device: DeviceMemory, layout: Mapping[str, int], budget: int, asker: str, held: int = 0,
    tables: Mapping[str, np.ndarray] | None = None,
) -> int:  # fmt: skip
    """Refuse buffers that do not fit; returns the total number of bytes.

    `Buffers` begins with this check; it can also be made before pixels are read, and for a device that is not opened.

    Parameters
    ----------
    device, layout, budget, asker, held, tables
        As in `Buffers`.

    Raises
    ------
    MemoryBudgetError, DeviceError
        The buffers do not fit; the message has the sizes.
    """
    lent = sum(table.nbytes for table in (tables or {}).values())
    sizes = [*layout.values(), *(table.nbytes for table in (tables or {}).values())]
    total, largest = sum(sizes), max(sizes)
    on_host = held + (lent if device.own_memory else total)
    if on_host > budget:
        raise MemoryBudgetError(asker, on_host, budget, "make the tile or the photo smaller")
    most = device.memory_budget(budget) - device.taken if device.own_memory else device.memory
    for size, limit in ((total, most), (largest, device.largest)):
        if size > limit:
            raise DeviceError(
                f"{asker} needs {megabytes(size)} MB; {device.info.name} allows at most {megabytes(max(0, limit))} MB",
                hint="make the tile or the photo smaller",
            )
    return total


def in_smaller_pieces(work: Callable[[int], Made], size: int, least: int) -> Made:
    """`work(size)`, repeated with half the size, at least `least`, whenever the device runs out of memory.

    Raises
    ------
    OutOfDeviceMemory
        Even with the smallest size.
    """
    while True:
        try:
            return work(size)
        except OutOfDeviceMemory as error:
            if size <= least:
                raise
            log.warning("%s; retrying in smaller pieces", error)
        size = max(least, size // 2)


def offset_table(offsets: np.ndarray) -> np.ndarray:
    """Offsets as kernels read them, int32.

    Raises
    ------
    DeviceError
        An offset exceeds 32 bits.
    """
    if offsets.size and int(offsets.max()) >= INT_RANGE:
        raise DeviceError(
            f"a table has {int(offsets.max())} entries",
            expected="fewer than 2^31",
            hint="make the tile or the photo smaller",
        )
    return offsets.astype(np.int32)


def _released(device: Device, buffers: dict[str, cl.Buffer], total: int, lent: bool) -> None:
    if lent:  # commands that are still queued, as after an error, read the host's memory
        with contextlib.suppress(DeviceError):
            device.finish()
    for buffer in buffers.values():
        buffer.release()
    device.taken -= total
