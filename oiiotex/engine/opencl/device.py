# SPDX-License-Identifier: Apache-2.0
"""OpenCL: choose a device, build programs once, run kernels, own buffers, know the memory budget.

pyopencl is imported when the first device is requested, so lines without a device start faster.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ..deferred import np
from ..errors import DeviceError, NoDeviceError, OutOfDeviceMemory
from ..stats import Stats
from . import runtime
from .buffers import Download, megabytes
from .program import Program

if TYPE_CHECKING:
    import pyopencl as cl

log = logging.getLogger("oiiotex")

TEAM = 32  # cl/team.h
_ROUNDS_CORRECTLY = 1 << 7  # CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT
_OWN_SHARE = 7 / 8  # usable fraction of a GPU's memory: the driver and the desktop hold some


@dataclass(frozen=True)
class DeviceInfo:
    """A device, as listed by `--devices` and chosen by `--device`."""

    number: int
    kind: str  # "gpu", "cpu" or "other"
    name: str
    platform: str
    version: str
    memory: int  # bytes
    handle: cl.Device = field(repr=False, compare=False)

    @property
    def rounds_correctly(self) -> bool:
        """Whether float division and square root can be rounded correctly."""
        return bool(self.handle.single_fp_config & _ROUNDS_CORRECTLY)

    @property
    def has_doubles(self) -> bool:
        """Whether kernels can compute in double precision."""
        return "cl_khr_fp64" in self.handle.extensions.split()

    def matches(self, wanted: str) -> bool:
        """Whether `wanted` is this device's number or kind, or part of its or its platform's name."""
        if wanted.isdigit():
            return int(wanted) == self.number
        return wanted.lower() == self.kind or wanted.lower() in f"{self.platform} {self.name}".lower()


def devices(threads: int = 0) -> list[DeviceInfo]:
    """All usable OpenCL devices, GPUs first.

    Parameters
    ----------
    threads : int
        Number of CPU threads for a CPU runtime; 0: as many as the process may use. Only the first call in a process
        sets it, because runtimes read it when they start.

    Returns
    -------
    list of DeviceInfo
        Empty if the machine has no OpenCL.
    """
    cl = runtime.load(threads)
    infos = []
    try:
        platforms = cl.get_platforms()
    except cl.Error:  # the ICD loader reports "no platform" as an error
        return []
    kinds = {cl.device_type.GPU: "gpu", cl.device_type.CPU: "cpu"}
    for platform in platforms:
        try:
            handles = platform.get_devices()
        except cl.Error:  # one broken driver must not hide the others (pyopencl #821)
            continue
        for handle in handles:
            kind = next((name for bit, name in kinds.items() if handle.type & bit), "other")
            if platform.name == "Oclgrind":  # a kernel checker, a thousand times slower: used only by name
                kind = "other"
            name, version = handle.name.strip(), handle.version.strip()
            infos.append(DeviceInfo(0, kind, name, platform.name, version, handle.global_mem_size, handle))
    # CPU runtimes with correctly rounded division first: PoCL before Intel's
    infos.sort(key=lambda d: (("gpu", "cpu", "other").index(d.kind), d.kind == "cpu" and not d.rounds_correctly))
    return [replace(info, number=n) for n, info in enumerate(infos)]


def choose(wanted: str | None = None, threads: int = 0) -> DeviceInfo:
    """The device to use: `wanted`, else $OIIOTEX_DEVICE, else the first GPU, else the first CPU that works.

    A device that cannot compile is skipped, with a warning, for the next one that matches `wanted`; 'cpu' matches all
    CPUs. A simulator is used only by name.

    Raises
    ------
    DeviceError
        No device matches.
    NoDeviceError
        No device, or none that can compile. The message ends with a command that helps.
    """
    broken: list[tuple[DeviceInfo, runtime.Trial]] = []
    for info in _candidates(wanted, threads):
        trial = trial_of(info)
        if trial is None or trial.works is not None:
            for other, failed in broken:
                runtime.keep(other.handle, failed)
                _say(f"{other.name} ({other.platform}) cannot compile: {failed.why}; using {info.name} instead")
            if trial is not None:
                runtime.use(info.handle)
            return info
        broken.append((info, trial))
    if not broken:
        only = "".join(f" except {info.name}, which must be named by --device" for info in devices(threads))
        raise NoDeviceError(f"no OpenCL device{only}", runtime.remedy([]))
    reasons = "; ".join(f"{info.name} ({info.platform}): {trial.why}" for info, trial in broken)
    raise NoDeviceError(f"no OpenCL device can compile: {reasons}", runtime.remedy([t for _, t in broken]))


def require_named(wanted: str | None, threads: int = 0) -> None:
    """Refuse a name that matches no device.

    Raises
    ------
    DeviceError
        The message lists the available devices.
    """
    _candidates(wanted, threads)


def trial_of(info: DeviceInfo, again: bool = False) -> runtime.Trial | None:
    """The result of probing the device, see `runtime.tried`; None for a kernel checker, which is not probed."""
    return None if info.kind == "other" else runtime.tried(info.handle, again)


def _candidates(wanted: str | None, threads: int) -> list[DeviceInfo]:
    """The devices that match `wanted`; without a name, all that may be chosen automatically."""
    wanted = wanted or named_by_environment()
    available = devices(threads)
    if not available or wanted is None:
        unasked = [d for d in available if d.kind != "other"]
        return [d for d in unasked if d.handle.int_ptr not in _refused]
    named = [d for d in available if d.matches(wanted)]
    if not named:
        listed = ", ".join(f"{d.number} = {d.name} ({d.kind})" for d in available)
        raise DeviceError(f"no device '{wanted}'", hint=f"available: {listed}")
    return named


def named_by_environment() -> str | None:
    """The device named by $OIIOTEX_DEVICE."""
    return os.environ.get("OIIOTEX_DEVICE") or None


_refused: set[int] = set()  # devices, by address, whose compiler refused a program in this process


def refuse(info: DeviceInfo, threads: int = 0) -> DeviceInfo | None:
    """Exclude `info` from automatic choice in this process; returns the device chosen instead, or None."""
    _refused.add(info.handle.int_ptr)
    try:
        return choose(None, threads)
    except NoDeviceError:
        _refused.discard(info.handle.int_ptr)  # its own error is more helpful
        return None
    finally:
        open_device.cache_clear()


@functools.cache
def _say(text: str) -> None:
    """Warn once."""
    log.warning("%s", text)


@functools.cache
def open_device(wanted: str | None = None, threads: int = 0) -> Device:
    """The device chosen by `choose`, opened once per process: a context is expensive and holds the built kernels."""
    return Device(choose(wanted, threads))


class DeviceMemory:
    """The memory of an OpenCL device, known before the device is opened."""

    def __init__(self, info: DeviceInfo):
        self.info = info
        self.memory, self.largest = info.memory, info.handle.max_mem_alloc_size  # bytes, in total and per buffer
        # a CPU and an integrated GPU use the host's memory, other devices have their own
        self.own_memory = info.kind != "cpu" and not info.handle.host_unified_memory
        self.taken = 0  # bytes of all `Buffers`

    def memory_budget(self, budget: int) -> int:
        """Bytes that buffers may take, given the host's `budget`.

        A device with separate memory has its own limit; elsewhere both are the same memory.
        """
        return int(self.memory * _OWN_SHARE) if self.own_memory else min(budget, self.memory)


class Device(DeviceMemory):
    """An opened OpenCL device: one context, two in-order queues, the programs built so far.

    Kernels run in one queue, asynchronous downloads (`read_later`) in the other; events synchronize them.
    """

    def __init__(self, info: DeviceInfo):
        super().__init__(info)
        self._cl = runtime.load()
        self._context = self._cl.Context([info.handle])
        timed = self._cl.command_queue_properties.PROFILING_ENABLE
        self._queue, self._transfers = (self._cl.CommandQueue(self._context, properties=timed) for _ in range(2))
        self._programs: dict[tuple[object, ...], Program] = {}
        self._events: list[tuple[str, cl.Event | float]] = []
        self.record = False  # keep events for the timings of `collect`

    @property
    def lanes(self) -> int:
        """Number of 16-bit lanes in a register of the runtime's target, for cl/lanes.h; 1 on GPUs."""
        return runtime.tried(self.info.handle).lanes if self.info.kind == "cpu" else 1

    @property
    def team(self) -> int:
        """Number of work-items that form a team, for cl/team.h; 1 on CPUs."""
        return TEAM if self.lanes == 1 else 1

    def program(self, stem: str, **macros: int) -> Program:
        """Kernels of cl/<stem>.cl compiled with `macros`; built once per process."""
        key = (stem, *sorted(macros.items()))
        if key not in self._programs:
            self._programs[key] = Program(self, stem, macros)
        return self._programs[key]

    def upload(self, array: np.ndarray) -> cl.Buffer:
        """A read-only buffer with a copy of `array`: for small tables; large data belongs in `Buffers`."""
        flags = self._cl.mem_flags
        return self._buffer(flags.READ_ONLY | flags.COPY_HOST_PTR, array)

    def lend(self, array: np.ndarray) -> cl.Buffer:
        """The same for an array that does not change: a device that uses the host's memory reads it in place."""
        flags = self._cl.mem_flags
        return self._buffer(flags.READ_ONLY | (flags.COPY_HOST_PTR if self.own_memory else flags.USE_HOST_PTR), array)

    def _buffer(self, flags: int, array: np.ndarray) -> cl.Buffer:
        array = np.ascontiguousarray(array)
        with self._needing_memory(f"a table of {megabytes(array.nbytes)} MB"):
            return self._cl.Buffer(self._context, flags, hostbuf=array)

    def write(self, buffer: cl.Buffer, array: np.ndarray, offset: int = 0) -> None:
        """Copy `array` into `buffer`, `offset` bytes from its start."""
        self._enqueue("upload", self._cl.enqueue_copy, buffer, np.ascontiguousarray(array), dst_offset=offset)

    def read(self, buffer: cl.Buffer, shape: tuple[int, ...], dtype: np.dtype | type, offset: int = 0) -> np.ndarray:
        """The contents of `buffer`, from byte `offset`, as a new array."""
        array = np.empty(shape, dtype)
        self._enqueue("download", self._cl.enqueue_copy, array, buffer, src_offset=offset)
        return array

    def read_later(
        self, buffer: cl.Buffer, shape: tuple[int, ...], dtype: np.dtype | type, offset: int = 0
    ) -> Download:
        """As `read`, after the kernels queued so far and concurrent with later ones.

        The buffer must not be written before the download is complete: alternate between buffers.
        """
        array = np.empty(shape, dtype)
        options = {
            "queue": self._transfers, "is_blocking": False, "wait_for": [self.mark()], "src_offset": offset
        }  # fmt: skip
        event = self._enqueue("download", self._cl.enqueue_copy, array, buffer, **options)
        self._transfers.flush()
        return Download(self, event, array)

    def mark(self) -> cl.Event:
        """An event that is complete when all kernels queued so far are done."""
        event = self._cl.enqueue_marker(self._queue)
        self._queue.flush()
        return event

    def fill(self, buffer: cl.Buffer, value: np.generic, count: int) -> None:
        """Set the first `count` elements of `buffer` to `value`."""
        self._enqueue("fill", self._cl.enqueue_fill_buffer, buffer, value, 0, count * value.itemsize)

    def finish(self) -> None:
        """Wait until all work is done."""
        with self._needing_memory("queued work"):
            self._queue.finish()
            self._transfers.finish()

    def collect(self, stats: Stats, wait: bool = True) -> None:
        """Add the times of events since the last call to `stats`, by kernel: all (`wait`), or only complete ones."""
        if wait:
            self.finish()
        complete = self._cl.command_execution_status.COMPLETE
        events, self._events = self._events, []
        for name, event in events:
            if isinstance(event, float):
                stats.add(name, event)
            elif event.command_execution_status == complete:
                stats.add(name, _seconds(event))
            else:
                self._events.append((name, event))

    def _enqueue(
        self, name: str, command: Callable[..., cl.Event], *arguments: object, queue: cl.CommandQueue | None = None,
        **options: object,
    ) -> cl.Event:  # fmt: skip
        """Queue a command. Drivers allocate memory on first use, so this is where it may run out."""
        with self._needing_memory(name):
            event = command(queue or self._queue, *arguments, **options)
        if self.record:
            # a copy's event holds the host's array: without this a pass over an image in bands would keep all of it
            complete = event.command_execution_status == self._cl.command_execution_status.COMPLETE
            self._events.append((name, _seconds(event) if complete else event))
        return event

    @contextlib.contextmanager
    def _needing_memory(self, name: str) -> Iterator[None]:
        try:
            yield
        except self._cl.Error as error:
            codes = self._cl.status_code
            missing = codes.MEM_OBJECT_ALLOCATION_FAILURE, codes.OUT_OF_RESOURCES, codes.OUT_OF_HOST_MEMORY
            if not isinstance(error, self._cl.MemoryError) and error.code not in missing:
                raise
            raise OutOfDeviceMemory(
                f"{self.info.name} ran out of memory in {name}: {megabytes(self.taken)} of"
                f" {megabytes(self.memory)} MB are in use",
                hint="make the tile or the photo smaller",
            ) from error


def _seconds(event: cl.Event) -> float:
    return (event.profile.end - event.profile.start) * 1e-9
