# SPDX-License-Identifier: Apache-2.0
"""Arrays far larger than the memory, mapped and never touched, and one work-item of a real kernel in them."""

from __future__ import annotations

import mmap

import numpy as np

from oiiotex.engine.opencl import device_choice as devices
from oiiotex.engine.opencl.device import TEAM, Device

WIDTH, HEIGHT = 60000, 50000  # px of images
X, Y = 59008, 49000  # a pixel beyond 2^31
SIDE = 65000  # px of exemplars
E = 64000  # a place in them, along both axes
AT_E = np.uint32(E << 16 | E)
_NORESERVE = 0x4000  # Linux; mmap has no name for it before Python 3.14

# kernels whose items work in teams where a device has single lanes, cl/team.h
TEAMS = {
    *(f"quilting_{name}" for name in ("target", "reduce", "histogram", "score", "best", "assign", "cut")),
    *(f"superpixels_{name}" for name in ("powers", "shares", "gather")),
}


class Far:
    """A device, and arrays that are only mapped."""

    def __init__(self, lanes: int):
        self.device = Device(devices.choose())
        type(self.device).lanes = lanes
        self.lanes = lanes

    def zeros(self, kind: type, *shape: int) -> np.ndarray:
        """An array of any size, which takes memory where it is touched."""
        size = -(-int(np.prod(shape, dtype=np.int64)) * np.dtype(kind).itemsize // 4096) * 4096
        flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _NORESERVE
        held = mmap.mmap(-1, size + 4096, flags=flags)
        return np.frombuffer(held, kind, int(np.prod(shape, dtype=np.int64))).reshape(shape)

    def run(
        self, stem: str, name: str, at: tuple[int, ...], *arguments: object, group: int = 1, **macros: int
    ) -> None:  # fmt: skip
        """One work-item of a kernel, or one work-group along the first axis, at that place."""
        device, cl = self.device, self.device._cl
        if f"{stem}_{name}" in TEAMS and self.lanes == 1:
            at, group = (TEAM * at[0], *at[1:]), TEAM
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
        typed = []
        for value in arguments:
            if isinstance(value, np.ndarray):  # its first bytes stand for all of it
                first = np.frombuffer(value.data, np.uint8, 4096) if value.nbytes > 1 << 24 else value
                value = cl.Buffer(device._context, flags, hostbuf=first)
            elif type(value) is int:
                value = np.int32(value)
            elif type(value) is float:
                value = np.float32(value)
            typed.append(value)
        kernel = device.program(stem, **macros)._kernels[f"{stem}_{name}"]
        size = (group, *(1,) * (len(at) - 1))
        kernel(device._queue, size, size, *typed, global_offset=at)
        device._queue.finish()
