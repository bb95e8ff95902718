# SPDX-License-Identifier: Apache-2.0
"""An OpenCL device: its memory, its programs (.cl files, built once) and how kernels are run.

pyopencl is imported when the first device is requested, so lines without a device start faster.
"""

from __future__ import annotations

import contextlib
import threading
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..deferred import np
from ..errors import BuildError, DeviceError, OutOfDeviceMemory, megabytes
from ..stats import Stats
from . import runtime
from .source import kernel_source

if TYPE_CHECKING:
    import pyopencl as cl

TEAM = 32  # cl/team.h
_ROUNDS_CORRECTLY = 1 << 7  # CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT
_OWN_SHARE = 7 / 8  # usable fraction of a GPU's memory: the driver and the desktop hold some
INT_RANGE = 1 << 31  # of integers in kernels
_GROUP = 64  # items; fixed, because PoCL compiles a kernel again for each work-group shape
_TYPES = {bool: "i4", int: "i4", float: "f4"}  # of numbers as kernel arguments


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

    def read(self, buffer: cl.Buffer, shape: tuple[int, ...], dtype: np.dtype | type) -> np.ndarray:
        """The contents of `buffer`, from its start, as a new array."""
        array = np.empty(shape, dtype)
        self._enqueue("download", self._cl.enqueue_copy, array, buffer)
        return array

    def read_later(
        self, buffer: cl.Buffer, shape: tuple[int, ...], dtype: np.dtype | type, offset: int = 0
    ) -> Download:
        """As `read`, from byte `offset`, after the kernels queued so far and concurrent with later ones.

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


@dataclass(frozen=True)
class Download:
    """A download from the device that runs while the host and kernels continue."""

    _device: Device = field(repr=False)
    event: cl.Event = field(repr=False)
    _array: np.ndarray = field(repr=False)

    def array(self) -> np.ndarray:
        """Wait for the array."""
        with self._device._needing_memory("download"):
            self.event.wait()
        return self._array


class Program:
    """A built .cl file. Call it with a kernel's name without the file's: `program("score", shape, *arguments)`."""

    def __init__(self, device: Device, stem: str, macros: dict[str, int]):
        self._device, self._stem, self._macros = device, stem, macros
        self._kernels = self._built()
        if not self._kernels:
            self._kernels = self._built(fresh=True)
        self._types: dict[str, tuple[str | None, ...]] = {}  # of a kernel's arguments: untyped numbers cost 6 us each
        self._launching = threading.Lock()  # a kernel keeps its arguments: two threads would mix theirs

    def _built(self, fresh: bool = False) -> dict[str, cl.Kernel]:
        """The kernels by name, built, or from a cache. `fresh`: with a kernel more, so that no cache has it.

        Raises
        ------
        BuildError
            The compiler refuses the source, and that is not the fault of a damaged cache.
        """
        cl, info = self._device._cl, self._device.info
        options = ["-w", f"-DLANES={self._device.lanes}", *(f"-D{k}={v}" for k, v in self._macros.items())]
        if info.rounds_correctly:
            options.append("-cl-fp32-correctly-rounded-divide-sqrt")
        source = kernel_source(self._stem) + ("__kernel void fresh() {}" if fresh else "")
        try:
            with warnings.catch_warnings(action="ignore", category=cl.CompilerWarning):
                built = runtime.built_program(self._device._context, source, options)
            return {kernel.function_name: kernel for kernel in built.all_kernels()}
        except cl.Error as error:
            if not fresh:
                return self._built(fresh=True)
            words = runtime.compilers_words(str(error))
            raise BuildError(f"{info.name} cannot build {self._stem}.cl: {words}") from error

    def __call__(
        self, name: str, shape: tuple[int, ...], *arguments: object, group: int = _GROUP, team: bool = False
    ) -> None:
        """Run one work-item per element of `shape` (the first axis fastest); integers and floats are passed as 32-bit.

        `group`: most items per work-group. A CPU runs a group on one thread, so use small groups for long items.
        `team`: with teams, one team per element. Kernels use `int`: a larger size or argument is an error.
        """
        if team and self._device.team > 1:
            shape, group = (self._device.team * shape[0], *shape[1:]), self._device.team
        name = f"{self._stem}_{name}"
        if name not in self._kernels:
            self._kernels, self._types = self._built(fresh=True), {}
        kernel = self._kernels[name]
        local = _work_group(shape, group)
        global_size = tuple(-(-n // k) * k for n, k in zip(shape, local, strict=True))
        most = max(map(abs, (*global_size, *(a for a in arguments if type(a) is int))))
        if most >= INT_RANGE:
            raise DeviceError(f"{name} would count to {most}, beyond 2^31", hint="make the tile or the photo smaller")
        types = tuple(_TYPES.get(type(a)) for a in arguments)
        with self._launching:
            if self._types.get(name) != types:
                kernel.set_arg_types(types)
                self._types[name] = types
            self._device._enqueue(name, kernel, global_size, local, *arguments)


def _work_group(shape: tuple[int, ...], most: int = _GROUP) -> tuple[int, ...]:
    """A work-group of `most` items: a row, or for short rows a square with some idle items.

    There are only two shapes, because PoCL recompiles a kernel for each (.15 s), and no smaller ones, because of the
    runtime's overhead per group.
    """
    if len(shape) == 1 or 4 * shape[0] > most:
        return most, *[1] * (len(shape) - 1)
    side = 1 << (most.bit_length() - 1) // 2
    return side, most // side, *[1] * (len(shape) - 2)
