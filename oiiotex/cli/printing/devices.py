# SPDX-License-Identifier: Apache-2.0
"""--devices: what there is, what works, and with -v what was tried and why."""

from __future__ import annotations

from ...errors import DeviceError, NoDeviceError
from ...machine import usable_threads
from ...opencl import device
from ...opencl.device import DeviceInfo
from ...opencl.runtime import Trial


def device_list(wanted: str | None, threads: int, verbose: bool) -> str:
    """One line per OpenCL device, with `verbose` all that is known of each; what does not work is tried anew."""
    trials = [(info, device.trial_of(info, again=True)) for info in device.devices(threads)]
    lines = []
    try:
        chosen: DeviceInfo | None = device.choose(wanted, threads)
    except DeviceError as error:
        chosen = None
        advice = [f"no device is used: {error}" if verbose or not isinstance(error, NoDeviceError) else _short(error)]
    else:
        advice = []
    for info, trial in trials:
        broken = trial is not None and trial.works is None
        facts = f"{info.name} ({info.kind}), {info.platform}, {info.version}, {info.memory >> 20} MB"
        lines.append(f"{info.number}: {facts}" + (", does not work here" if broken else ""))
        if verbose:
            lines += [f"     {line}" for line in _details(info, trial, info == chosen, wanted, threads)]
    if any(trial is not None and trial.works is None for _, trial in trials) and not verbose:
        advice.append("what does not work: oiiotex --devices -v says why")
    return "\n".join(lines + advice)


def _short(error: NoDeviceError) -> str:
    return f"no OpenCL device works here: {error.remedy}" if error.remedy else str(error)


def _details(info: DeviceInfo, trial: Trial | None, chosen: bool, wanted: str | None, threads: int) -> list[str]:
    lines = [f"used: {_why(info, wanted)}"] if chosen else []
    if trial is None:
        return [*lines, "not tried: it checks kernels, and is used only where it is named"]
    lines += [f"{attempt}: {words}" for attempt, words in trial.failures]
    if trial.works is None:
        return lines
    lines.append(f"{trial.works}: works")
    if info.kind == "cpu":
        lines.append(f"compiles for {_target(info, trial)}: {trial.lanes} lanes of 16 bits")
        lines.append(f"threads: {threads or usable_threads()}")
    largest = info.handle.max_mem_alloc_size >> 20
    lines.append(f"memory: {info.memory >> 20} MB, {largest} MB at most in one piece")
    if info.rounds_correctly:
        lines.append("division and square root: rounded correctly")
    else:
        lines.append(
            "division and square root: not said to be rounded correctly, so the same bits as elsewhere are not promised"
        )
    return lines


def _why(info: DeviceInfo, wanted: str | None) -> str:
    if wanted:
        return f"the first that works of those that --device {wanted} means"
    if device.named_by_environment():
        return f"the first that works of those that $OIIOTEX_DEVICE={device.named_by_environment()} means"
    return f"the first {info.kind.upper()} that works" + ("" if info.kind == "gpu" else "; there is no GPU that does")


def _target(info: DeviceInfo, trial: Trial) -> str:
    """The CPU that code is made for, as far as the runtime says."""
    if trial.works is not None and trial.works.cpu:
        return trial.works.cpu
    _, marker, name = info.version.rpartition("-gnu-")  # PoCL: ...-x86_64-pc-linux-gnu-skylake-avx512
    return name if marker else "this CPU"
