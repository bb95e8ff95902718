# SPDX-License-Identifier: Apache-2.0
"""The OpenCL devices of the machine, and the choice of the one that a process uses."""

from __future__ import annotations

import functools
import logging
import os
from dataclasses import replace

from ..errors import DeviceError, NoDeviceError
from . import runtime
from .device import Device, DeviceInfo

log = logging.getLogger("oiiotex")


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
