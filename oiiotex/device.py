# SPDX-License-Identifier: Apache-2.0
"""OpenCL: choose a device, build programs once, run kernels, own buffers, know the memory budget.

The only room that knows pyopencl, which is imported when the first device is asked for: what needs no device
starts without it.
"""

from __future__ import annotations

import functools
import math
import os
import warnings
from dataclasses import dataclass, field
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np

from . import opencl_runtime
from .errors import DeviceError
from .stats import Stats

if TYPE_CHECKING:
    import pyopencl as cl

_GROUP = 64  # items; fixed, because PoCL compiles a kernel again for each work-group shape


@dataclass(frozen=True)
class DeviceInfo:
    """What `--devices` lists and `--device` chooses from."""

    number: int
    kind: str  # "gpu", "cpu" or "other"
    name: str
    platform: str
    version: str
    memory: int  # bytes
    handle: cl.Device = field(repr=False, compare=False)

    def matches(self, wanted: str) -> bool:
        """`wanted` is a number of the list, a kind, or part of the device's or platform's name."""
        if wanted.isdigit():
            return int(wanted) == self.number
        return wanted.lower() == self.kind or wanted.lower() in f"{self.platform} {self.name}".lower()


def devices(threads: int = 0) -> list[DeviceInfo]:
    """All usable OpenCL devices, GPUs first.

    Parameters
    ----------
    threads : int
        CPU threads that a CPU runtime may use; 0 means as many as the process is allowed. It takes effect only
        before the first call in a process, because runtimes read it when they start.

    Returns
    -------
    list of DeviceInfo
        Empty where the machine has no OpenCL at all.
    """
    cl = opencl_runtime.load(threads)
    found = []
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
            if platform.name == "Oclgrind":  # checks kernels, a thousand times slower: only when it is asked for
                kind = "other"
            found.append((handle, kind, platform.name))
    found.sort(key=lambda item: ("gpu", "cpu", "other").index(item[1]))
    return [
        DeviceInfo(n, kind, handle.name.strip(), platform, handle.version.strip(), handle.global_mem_size, handle)
        for n, (handle, kind, platform) in enumerate(found)
    ]


def choose(wanted: str | None = None, threads: int = 0) -> DeviceInfo:
    """The device to use: `wanted`, else $OIIOTEX_DEVICE, else the first GPU, else the first CPU.

    Raises
    ------
    DeviceError
        No device, none of that name, or a CPU runtime that cannot compile here. The text says what to install.
    """
    wanted = wanted or os.environ.get("OIIOTEX_DEVICE") or None
    available = devices(threads)
    if not available:
        raise DeviceError("no OpenCL device: install a GPU driver, or a CPU runtime with 'pip install oiiotex[cpu]'")
    info = available[0]
    if wanted is not None:
        info = next((d for d in available if d.matches(wanted)), None)
        if info is None:
            listed = ", ".join(f"{d.number} = {d.name} ({d.kind})" for d in available)
            raise DeviceError(f"no device '{wanted}'; there is {listed}")
    if info.kind == "cpu":
        opencl_runtime.require_working(info.platform, info.version)
    return info


@functools.cache
def open_device(wanted: str | None = None, threads: int = 0) -> Device:
    """The device chosen by `choose`, opened once per process: contexts are dear and hold the built kernels."""
    return Device(choose(wanted, threads))


class Device:
    """An opened OpenCL device: one context, one in-order queue, the programs built so far."""

    def __init__(self, info: DeviceInfo):
        cl = opencl_runtime.load()
        self._cl = cl
        self.info = info
        self._context = cl.Context([info.handle])
        self._queue = cl.CommandQueue(self._context, properties=cl.command_queue_properties.PROFILING_ENABLE)
        self._programs: dict[tuple, Program] = {}
        self._events: list[tuple[str, cl.Event | float]] = []
        self.record = False  # keep events, so that `collect` can say where the time went

    @property
    def lanes(self) -> int:
        """16-bit lanes of a register, as cl/lanes.h wants it: 1 on GPUs."""
        if self.info.kind != "cpu":
            return 1
        return 32 if "avx512bw" in opencl_runtime.cpu_features() else 16

    def program(self, stem: str, **macros: int) -> Program:
        """Kernels of cl/<stem>.cl compiled with `macros` defined; built once per process."""
        key = (stem, *sorted(macros.items()))
        if key not in self._programs:
            self._programs[key] = Program(self, stem, macros)
        return self._programs[key]

    def upload(self, array: np.ndarray) -> cl.Buffer:
        """A read-only buffer holding a copy of `array`: for small tables; big data belongs into `Buffers`."""
        flags = self._cl.mem_flags
        array = np.ascontiguousarray(array)
        return self._cl.Buffer(self._context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=array)

    def lend(self, array: np.ndarray) -> cl.Buffer:
        """The same for an array that does not change: where the device is the CPU, it is read where it lies."""
        flags = self._cl.mem_flags
        array = np.ascontiguousarray(array)
        how = flags.USE_HOST_PTR if self.info.kind == "cpu" else flags.COPY_HOST_PTR
        return self._cl.Buffer(self._context, flags.READ_ONLY | how, hostbuf=array)

    def write(self, buffer: cl.Buffer, array: np.ndarray, offset: int = 0) -> None:
        """Copy `array` into `buffer`, `offset` bytes from its start."""
        array = np.ascontiguousarray(array)
        self._note("upload", self._cl.enqueue_copy(self._queue, buffer, array, dst_offset=offset))

    def read(self, buffer: cl.Buffer, shape: tuple[int, ...], dtype: np.dtype | type, offset: int = 0) -> np.ndarray:
        """What stands in `buffer`, `offset` bytes from its start, as a new array."""
        array = np.empty(shape, dtype)
        self._note("download", self._cl.enqueue_copy(self._queue, array, buffer, src_offset=offset))
        return array

    def fill(self, buffer: cl.Buffer, value: np.generic, count: int) -> None:
        """Set the first `count` elements of `buffer` to `value`."""
        self._note("fill", self._cl.enqueue_fill_buffer(self._queue, buffer, value, 0, count * value.itemsize))

    def finish(self) -> None:
        """Wait until all work is done."""
        self._queue.finish()

    def collect(self, stats: Stats) -> None:
        """Add the time of all events since the last call to `stats`, each kernel by name."""
        self.finish()
        for name, event in self._events:
            stats.add(name, event if isinstance(event, float) else _seconds(event))
        self._events.clear()

    def _note(self, name: str, event: cl.Event) -> None:
        if not self.record:
            return
        # a copy's event holds the host's array: a look at an image, band by band, would hold all of it
        done = event.command_execution_status == self._cl.command_execution_status.COMPLETE
        self._events.append((name, _seconds(event) if done else event))


class Program:
    """A built .cl file. Call it with a kernel's name less the file's: `program("score", shape, *arguments)`."""

    def __init__(self, device: Device, stem: str, macros: dict[str, int]):
        cl = device._cl
        self._device, self._stem = device, stem
        folder = resources.files("oiiotex") / "cl"
        options = ["-w", "-I", str(folder), f"-DLANES={device.lanes}", *(f"-D{k}={v}" for k, v in macros.items())]
        if device.info.handle.single_fp_config & cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT:
            options.append("-cl-fp32-correctly-rounded-divide-sqrt")
        try:
            with warnings.catch_warnings():  # what a compiler has to say of a program that it can build
                warnings.simplefilter("ignore", cl.CompilerWarning)
                built = cl.Program(device._context, (folder / f"{stem}.cl").read_text()).build(options)
        except cl.Error as error:
            raise DeviceError(f"{device.info.name} cannot build {stem}.cl: {error}") from error
        self._kernels = {k.function_name: k for k in built.all_kernels()}

    def __call__(self, name: str, shape: tuple[int, ...], *arguments: object, group: int = _GROUP) -> None:
        """Run one work-item per element of `shape` (the first axis fastest); integers and floats go as 32 bit.

        `group`: items of a work-group, at most. A CPU runs a group on one thread, so long items want small groups.
        """
        name = f"{self._stem}_{name}"
        kernel = self._kernels[name]
        typed = [np.int32(a) if type(a) is int else np.float32(a) if type(a) is float else a for a in arguments]
        local = _work_group(shape, group)
        global_size = tuple(math.ceil(n / k) * k for n, k in zip(shape, local, strict=True))
        event = kernel(self._device._queue, global_size, local, *typed)
        self._device._note(name, event)


class Buffers:
    """Device memory declared as a whole: summed, checked against the budget and the device, then allocated.

    Parameters
    ----------
    device : Device
    layout : dict of name to bytes
    budget : int
        Bytes that this process may use.
    what : str
        Who asks, for the error's text.
    held : int
        Bytes that the asker holds beside them.
    tables : dict of name to array
        What is only read; it must not change. Where the device is the CPU it is not copied.

    Raises
    ------
    DeviceError
        It does not fit; the text says how much is needed and what there is.
    """

    def __init__(
        self, device: Device, layout: dict[str, int], budget: int, what: str, held: int = 0,
        tables: dict[str, np.ndarray] | None = None,
    ):  # fmt: skip
        cl = device._cl
        tables = tables or {}
        sizes = [*layout.values(), *(table.nbytes for table in tables.values())]
        need, largest = held + sum(sizes), max(sizes)
        if need > budget:
            raise DeviceError(
                f"{what} needs {_megabytes(need)} MB, the budget is {_megabytes(budget)} MB:"
                " raise --cache, or make the tile or the photo smaller"
            )
        for size, limit in ((need - held, device.info.memory), (largest, device.info.handle.max_mem_alloc_size)):
            if size > limit:
                raise DeviceError(
                    f"{what} needs {_megabytes(size)} MB, {device.info.name} gives {_megabytes(limit)} MB at most"
                )
        flags = cl.mem_flags.READ_WRITE
        try:
            self._held = {name: cl.Buffer(device._context, flags, max(1, size)) for name, size in layout.items()}
            self._held |= {name: device.lend(table) for name, table in tables.items()}
        except cl.Error as error:
            raise DeviceError(f"{what}: {device.info.name} could not allocate {_megabytes(need)} MB") from error

    def __getitem__(self, name: str) -> cl.Buffer:
        return self._held[name]

    def swap(self, first: str, second: str) -> None:
        """Exchange two buffers of equal size: what was written becomes what is read."""
        held = self._held
        held[first], held[second] = held[second], held[first]

    def __enter__(self) -> Buffers:
        return self

    def __exit__(self, *_: object) -> None:
        for buffer in self._held.values():
            buffer.release()


def _seconds(event: cl.Event) -> float:
    return (event.profile.end - event.profile.start) * 1e-9


def _megabytes(size: int) -> int:
    return math.ceil(size / (1 << 20))


def _work_group(shape: tuple[int, ...], most: int = _GROUP) -> tuple[int, ...]:
    """A work-group of up to `most` items, filled along the first axes: small ones drown in the runtime's overhead."""
    left, local = most, []
    for n in shape:
        local.append(min(left, 1 << (n - 1).bit_length()))
        left //= local[-1]
    return tuple(local)
