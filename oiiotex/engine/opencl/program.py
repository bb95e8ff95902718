# SPDX-License-Identifier: Apache-2.0
"""OpenCL programs: one .cl file, built for a device, whose kernels are called by name."""

from __future__ import annotations

import threading
import warnings
from typing import TYPE_CHECKING

from ..errors import BuildError, DeviceError
from . import runtime
from .buffers import INT_RANGE
from .source import kernel_source

if TYPE_CHECKING:
    from .device import Device

_GROUP = 64  # items; fixed, because PoCL compiles a kernel again for each work-group shape
_TYPES = {bool: "i4", int: "i4", float: "f4"}  # of numbers as kernel arguments


class Program:
    """A built .cl file. Call it with a kernel's name without the file's: `program("score", shape, *arguments)`."""

    def __init__(self, device: Device, stem: str, macros: dict[str, int]):
        cl = device._cl
        self._device, self._stem = device, stem
        options = ["-w", f"-DLANES={device.lanes}", *(f"-D{k}={v}" for k, v in macros.items())]
        if device.info.rounds_correctly:
            options.append("-cl-fp32-correctly-rounded-divide-sqrt")
        try:
            with warnings.catch_warnings(action="ignore", category=cl.CompilerWarning):
                built = cl.Program(device._context, kernel_source(stem)).build(options)
        except cl.Error as error:
            words = runtime.compilers_words(str(error))
            raise BuildError(f"{device.info.name} cannot build {stem}.cl: {words}") from error
        self._kernels = {k.function_name: k for k in built.all_kernels()}
        self._types: dict[str, tuple[str | None, ...]] = {}  # of a kernel's arguments: untyped numbers cost 6 us each
        self._launching = threading.Lock()  # a kernel keeps its arguments: two threads would mix theirs

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
