# SPDX-License-Identifier: Apache-2.0
"""--devices: the OpenCL devices, and with -v how each was tested."""

from __future__ import annotations

from ....engine.errors import DeviceError, NoDeviceError
from ....engine.machine import usable_threads
from ....engine.opencl import device_choice
from ....engine.opencl.device import DeviceInfo
from ....engine.opencl.runtime import Trial


def device_list(wanted: str | None, threads: int, verbose: bool) -> str:
    """One line per OpenCL device, with `verbose` all details; devices that failed before are tested again."""
    trials = [(info, device_choice.trial_of(info, again=True)) for info in device_choice.devices(threads)]
    lines = []
    try:
        chosen: DeviceInfo | None = device_choice.choose(wanted, threads)
    except DeviceError as error:
        chosen = None
        advice = [f"no device selected: {error}" if verbose or not isinstance(error, NoDeviceError) else _short(error)]
    else:
        advice = []
    for info, trial in trials:
        broken = trial is not None and trial.works is None
        facts = f"{info.name} ({info.kind}), {info.platform}, {info.version}, {info.memory >> 20} MB"
        lines.append(f"{info.number}: {facts}" + (", does not work" if broken else ""))
        if verbose:
            lines += [f"     {line}" for line in _details(info, trial, info == chosen, wanted, threads)]
    if any(trial is not None and trial.works is None for _, trial in trials) and not verbose:
        advice.append("to see why a device does not work: oiiotex --devices -v")
    return "\n".join(lines + advice)


def _short(error: NoDeviceError) -> str:
    return f"no OpenCL device works: {error.remedy}" if error.remedy else str(error)


def _details(info: DeviceInfo, trial: Trial | None, chosen: bool, wanted: str | None, threads: int) -> list[str]:
    lines = [f"selected: {_why(info, wanted)}"] if chosen else []
    if trial is None:
        return [*lines, "not tested: it checks kernels, and is used only if --device names it"]
    lines += [f"{attempt}: {words}" for attempt, words in trial.failures]
    if trial.works is None:
        return lines
    lines.append(f"{trial.works}: works")
    if info.kind == "cpu":
        lines.append(f"compiles for {_target(info, trial)}: {trial.lanes} lanes of 16 bits")
        lines.append(f"threads: {threads or usable_threads()}")
    largest = info.handle.max_mem_alloc_size >> 20
    lines.append(f"memory: {info.memory >> 20} MB, largest allocation {largest} MB")
    if info.rounds_correctly:
        lines.append("division and square root: rounded correctly")
    else:
        lines.append("division and square root: rounding unknown; results may differ between devices")
    return lines


def _why(info: DeviceInfo, wanted: str | None) -> str:
    if wanted:
        return f"first working device that matches --device {wanted}"
    if device_choice.named_by_environment():
        return f"first working device that matches $OIIOTEX_DEVICE={device_choice.named_by_environment()}"
    return f"first working {info.kind.upper()}" + ("" if info.kind == "gpu" else "; no GPU works")


def _target(info: DeviceInfo, trial: Trial) -> str:
    """The CPU that the runtime compiles for, if it reports one."""
    if trial.works is not None and trial.works.cpu:
        return trial.works.cpu
    _, marker, name = info.version.rpartition("-gnu-")  # PoCL: ...-x86_64-pc-linux-gnu-skylake-avx512
    return name if marker else "this CPU"
