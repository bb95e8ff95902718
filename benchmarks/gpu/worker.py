# SPDX-License-Identifier: Apache-2.0
"""The part of `benchmarks.gpu.run` that touches a device: a separate process, because a driver may crash it.

python -m benchmarks.gpu.worker DEVICE LANES LAST: a line of JSON in, a line of JSON out. LANES 0: the device's own.
The file LAST names the kernel that was launched last, so that it is known after a crash.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gpu import bounds, workloads
from oiiotex.engine.machine import usable_threads
from oiiotex.engine.opencl import device_choice as devices
from oiiotex.engine.opencl.device import Device
from oiiotex.engine.session import Session

_NOISE = """
__kernel void touch(__global uint *a) { a[get_global_id(0)] = 1; }
__kernel void copy(const __global uint4 *restrict a, __global uint4 *restrict b) {
  b[get_global_id(0)] = a[get_global_id(0)];
}
"""


class _Watched:
    """A program whose launches are counted with what they must do at least."""

    def __init__(self, program: Callable, stem: str, macros: dict[str, int], watch: Watch):
        self._program, self._stem, self._macros, self._watch = program, stem, macros, watch

    def __call__(self, name: str, shape: tuple[int, ...], *arguments: object, **options: object) -> None:
        kernel = f"{self._stem}_{name}"
        self._watch.launched(kernel)
        launch = bounds.launch_of(self._stem, kernel, self._macros, shape, arguments)
        self._watch.costs.setdefault(kernel, bounds.Cost()).add(kernel, launch)
        self._program(name, shape, *arguments, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._program, name)


class Watch:
    """What was built and launched."""

    def __init__(self, last: Path):
        self._last = os.open(last, os.O_WRONLY | os.O_CREAT)
        self.costs: dict[str, bounds.Cost] = {}
        self.programs: dict[tuple, tuple[str, dict[str, int]]] = {}

    def launched(self, kernel: str) -> None:
        os.pwrite(self._last, kernel.ljust(80).encode(), 0)


def opened(name: str, lanes: int, watch: Watch) -> Device:
    """The device, with its launches recorded; `lanes` is used unless it is 0."""

    class WatchedDevice(Device):
        def program(self, stem: str, **macros: int) -> Any:
            watch.launched(f"the build of {stem}.cl")
            program = super().program(stem, **macros)
            watch.programs[stem, *sorted(macros.items())] = stem, macros
            return _Watched(program, stem, macros, watch)

    if lanes:
        WatchedDevice.lanes = lanes
    return WatchedDevice(devices.choose(name))


class Worker:
    """Requests, a method for each; they return values for JSON."""

    def __init__(self, name: str, lanes: int, last: Path):
        self._watch = Watch(last)
        self._device = opened(name, lanes, self._watch)
        self._device.record = True
        self._warmed: set[str] = set()

    def facts(self) -> dict[str, Any]:
        """The device, its driver, and the properties that bits depend on."""
        import pyopencl as cl

        info, handle = self._device.info, self._device.info.handle
        config = handle.single_fp_config
        flags = ("CORRECTLY_ROUNDED_DIVIDE_SQRT", "ROUND_TO_NEAREST", "FMA", "DENORM", "INF_NAN")
        rounding = {f.lower(): bool(config & getattr(cl.device_fp_config, f)) for f in flags}
        return {
            "number": info.number,
            "kind": info.kind,
            "device": info.name,
            "platform": f"{info.platform}, {info.version}",
            "OpenCL C": handle.opencl_c_version.strip(),
            "driver": handle.driver_version.strip(),
            "memory": f"{info.memory >> 20} MB, {handle.max_mem_alloc_size >> 20} MB at once, "
            f"{handle.local_mem_size >> 10} KB local",
            "compute units": f"{handle.max_compute_units} at {handle.max_clock_frequency} MHz, groups of at most "
            f"{handle.max_work_group_size}",
            "lanes": self._device.lanes,
            "rounding": ", ".join(f"{'' if there else 'no '}{flag}" for flag, there in rounding.items()),
            "host": f"{platform.system()} {platform.machine()}, {usable_threads()} cores, "
            f"Python {platform.python_version()}, pyopencl {cl.VERSION_TEXT}, numpy {np.__version__}",
            "photo": f"{'gravel' if workloads.util.find_spec('skimage') else 'pebbles'}, "
            f"{workloads.EXEMPLAR} px, with a stain",
            "devices": [f"{d.number}: {d.name} ({d.kind}), {d.platform}, {d.version}" for d in devices.devices()],
            "cpu": next((d.number for d in devices.devices() if d.kind == "cpu"), None),
        }

    def copies(self) -> dict[str, float]:
        """Bytes a second that are read and written, within the device and between it and the host; launch seconds."""
        import pyopencl as cl

        context, queue = self._device._context, self._device._queue
        size = (
            min(512 << 20, self._device.info.memory // 16, self._device.info.handle.max_mem_alloc_size) // 1024 * 1024
        )
        a, b = (cl.Buffer(context, cl.mem_flags.READ_WRITE, size) for _ in range(2))
        program = cl.Program(context, _NOISE).build()
        copy, touch = program.copy, program.touch
        host = np.ones(min(size, 256 << 20), np.uint8)

        def rate(moved: int, enqueue: Callable[[], Any]) -> float:
            seconds = []
            for _ in range(5):
                event = enqueue()
                event.wait()
                seconds.append((event.profile.end - event.profile.start) * 1e-9)
            return moved / max(min(seconds[1:]), 1e-9)  # the first may allocate

        cl.enqueue_fill_buffer(queue, a, np.uint32(7), 0, size)
        cl.enqueue_fill_buffer(queue, b, np.uint32(9), 0, size)
        found = {
            "copy": rate(2 * size, lambda: cl.enqueue_copy(queue, b, a)),
            "kernel": rate(2 * size, lambda: copy(queue, (size // 16,), (64,), a, b)),
            "upload": rate(host.nbytes, lambda: cl.enqueue_copy(queue, a, host)),
            "download": rate(host.nbytes, lambda: cl.enqueue_copy(queue, host, a)),
        }
        times = 300
        for n in range(times + 1):
            touch(queue, (64,), (64,), a)
            if n == 0:
                queue.finish()
                begin = time.perf_counter()
        queue.finish()
        found["launch"] = (time.perf_counter() - begin) / times
        for buffer in (a, b):
            buffer.release()
        return found

    def warm(self, workload: str) -> dict[str, Any]:
        """Run it very small: which programs it builds, and which kernels it runs."""
        session = self._session()
        before, seen = set(self._watch.programs), set(self._watch.costs)
        workloads.TIMED[workload](session, 64)()
        self._drain(session)
        self._warmed.add(workload)
        return {
            "programs": [self._watch.programs[key] for key in self._watch.programs if key not in before],
            "kernels": sorted(set(self._watch.costs) - seen),
        }

    def build(self, stem: str, macros: dict[str, int]) -> dict[str, Any]:
        """Seconds to build a program, and what the compiler says of it when it may say something."""
        import pyopencl as cl

        begin = time.perf_counter()
        program = Device.program(self._device, stem, **macros)
        seconds = time.perf_counter() - begin
        built = next(iter(program._kernels.values())).program
        handle = self._device.info.handle
        words = built.get_build_info(handle, cl.program_build_info.OPTIONS).split()
        words = [word for word in words if word != "-w"]
        if "cl_nv_compiler_options" in handle.extensions:
            words.append("-cl-nv-verbose")  # registers and spills
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", cl.CompilerWarning)
                loud = cl.Program(self._device._context, built.source).build(words)
            said = loud.get_build_info(handle, cl.program_build_info.LOG).strip("\0 \n")
        except Exception as error:
            said = f"nothing that could be had: {one_line(error)}"
        return {"seconds": seconds, "said": said}

    def time(self, workload: str, side: int) -> dict[str, Any]:
        """Run it once or, where it is quick, some times: the least wall seconds, and what its kernels did then."""
        if workload not in self._warmed:
            self.warm(workload)  # builds are not what is timed
        best: dict[str, Any] = {}
        spent, times = 0.0, 0
        while times == 0 or (times < 3 and spent < 1.5):
            session = self._session()
            work = workloads.TIMED[workload](session, side)
            self._drain(session)
            self._watch.costs.clear()
            begin = time.perf_counter()
            work()
            self._device.finish()
            seconds = time.perf_counter() - begin
            stats = self._drain(session)
            if not best or seconds < best["seconds"]:
                best = {"seconds": seconds, "kernels": self._kernels(stats)}
            spent, times = spent + seconds, times + 1
        return best | {"times": times}

    def compare(self, workload: str, side: int, path: str) -> dict[str, Any]:
        """The pixels that it makes, into a file."""
        session = self._session()
        made = workloads.arrays(workloads.COMPARED[workload](session, side)())
        self._drain(session)
        np.savez(path, **{name or "pixels": array for name, array in made.items()})
        return {}

    def _session(self) -> Session:
        session = Session()
        session.resources.device = self._device  # what the cached property would hold
        return session

    def _drain(self, session: Session) -> Any:
        """Where the time went since the session began, or since the last call."""
        stats, session.resources.stats = session.resources.stats, type(session.resources.stats)()
        self._device.collect(stats)
        return stats

    def _kernels(self, stats: Any) -> dict[str, Any]:
        """Seconds and calls of kernels and copies, with the least bytes and the work of those that declare them."""
        names = [n for n in stats.seconds if n in self._watch.costs or n in ("upload", "download", "fill")]
        made = {n: {"seconds": stats.seconds[n], "calls": stats.calls[n]} for n in names}
        for name in made:
            if name in self._watch.costs:
                cost = self._watch.costs[name]
                made[name] |= {"bytes": cost.bytes, "work": cost.work}
        return made


def one_line(error: BaseException) -> str:
    """An error as one line: its type, and the line of it that says most."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    said = next((line for line in lines if "error" in line.lower()), lines[0] if lines else "")
    return f"{type(error).__name__}: {said}"[:300]


def main() -> None:
    """Answer until there are no more questions or one could not be answered: a driver may be broken after that."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # drivers and libraries print what they like
    worker = None
    for line in sys.stdin:
        request = json.loads(line)
        try:
            worker = worker or Worker(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
            answer = getattr(worker, request.pop("do"))(**request)
        except Exception as error:
            answer = {"error": one_line(error)}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
        if "error" in answer:
            os._exit(1)  # not through destructors of a broken driver


if __name__ == "__main__":
    main()
