# SPDX-License-Identifier: Apache-2.0
"""The CPU that a runtime compiles for: PoCL 3.0 can be given one if it does not know the machine's.

`name_cpu` writes into PoCL's memory; README.md explains why, what it checks, and when to remove it.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyopencl as cl

# The build in the wheel pocl-binary-distribution 3.0, and its library, whose name has a hash of its contents.
_POCL_3_0 = "OpenCL 3.0 PoCL 3.0-rc2  Linux, Release, RELOC, LLVM 14.0.6, SLEEF, DISTRO, POCL_DEBUG"
_LIBRARY, _LIBRARY_BYTES = "libpocl-21062cec.so", 108599272
_POINTER_AT = 640  # bytes from the start of a device's struct
_UNKNOWN = b"generic\0"

# Features, by their Linux names, of instructions that compilers emit on their own. Others are not required, because
# hypervisors often hide them (pku, wbnoinvd, rdpru).
_V2 = {"cx16", "lahf_lm", "popcnt", "pni", "sse4_1", "sse4_2", "ssse3"}
_V3 = _V2 | {"abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "xsave"}
_ZEN2 = _V3 | {"adx", "aes", "pclmulqdq", "sse4a"}
_V4 = _V3 | {"avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"}
_SKYLAKE = _V4 | {"adx", "aes", "pclmulqdq"}
_ICELAKE = _SKYLAKE | {
    "avx512_bitalg", "avx512_vbmi2", "avx512_vnni", "avx512_vpopcntdq", "avx512ifma", "avx512vbmi", "gfni", "vaes",
    "vpclmulqdq",
}  # fmt: skip
# CPUs that LLVM 14 knows, the best first, with the features that each requires.
KNOWN = {
    "znver3": _ZEN2 | {"vaes", "vpclmulqdq"},
    "znver2": _ZEN2,
    "icelake-server": _ICELAKE,
    "skylake-avx512": _SKYLAKE,
    "haswell": _V3 | {"pclmulqdq"},
    "x86-64-v3": _V3,
    "x86-64-v2": _V2,
    "x86-64": set(),
}

_named: list[ctypes.Array[ctypes.c_char]] = []  # PoCL reads the name as long as the process lives


@functools.cache
def cpu() -> dict[str, str]:
    """The first CPU in /proc/cpuinfo: 'vendor_id', 'model name', 'flags' and so on; empty on other systems."""
    try:
        first = Path("/proc/cpuinfo").read_text().split("\n\n")[0]
    except OSError:
        return {}
    return {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in first.splitlines())}


def best_known(features: Iterable[str]) -> str:
    """The best CPU of `KNOWN` that needs only these features."""
    has = set(features)
    return next(name for name, needed in KNOWN.items() if needed <= has)


def name_for(device: cl.Device) -> str:
    """The CPU to name to this device's runtime; '' unless it is PoCL 3.0 and takes the CPU for 'generic'."""
    if device.platform.version != _POCL_3_0 or not device.version.strip().endswith("-generic"):
        return ""
    return best_known(cpu().get("flags", "").split())


def name_cpu(device: cl.Device, name: str) -> None:
    """Make PoCL 3.0 compile for the CPU `name`: before the first context, and after a separate process has tried it.

    Raises
    ------
    LookupError
        This is not the wheel's build, its struct has an unexpected layout, or PoCL knows the CPU.
    """
    if device.platform.version != _POCL_3_0 or not _wheels_library_is_loaded():
        raise LookupError(f"only the PoCL 3.0 of PyPI accepts a CPU name, not {device.platform.version}")
    place, ranges = device.int_ptr + _POINTER_AT, _mapped()
    if not any(begin <= place <= end - 8 and writable for begin, end, writable in ranges):
        raise LookupError("PoCL's device is not at the expected address")
    target = ctypes.c_uint64.from_address(place).value
    inside = any(begin <= target <= end - len(_UNKNOWN) for begin, end, _ in ranges)
    if not inside or ctypes.string_at(target, len(_UNKNOWN)) != _UNKNOWN:
        raise LookupError("PoCL's device has no CPU name at the expected address, or knows the CPU")
    _named.append(ctypes.create_string_buffer(name.encode()))
    ctypes.c_uint64.from_address(place).value = ctypes.addressof(_named[-1])


def _wheels_library_is_loaded() -> bool:
    paths = {Path(line.split(maxsplit=5)[5]) for line in _maps() if line.endswith(_LIBRARY)}  # it can have spaces
    return any(path.name == _LIBRARY and path.stat().st_size == _LIBRARY_BYTES for path in paths)


def _maps() -> list[str]:
    return Path("/proc/self/maps").read_text().splitlines()


def _mapped() -> list[tuple[int, int, bool]]:
    """(begin, end, writable) of this process's private readable memory: no devices, no shared memory."""
    ranges = []
    for line in _maps():
        addresses, rights = line.split()[:2]
        if rights[0] == "r" and rights[3] == "p" and "[v" not in line:  # [vvar] is mapped and cannot be read
            begin, end = (int(a, 16) for a in addresses.split("-"))
            ranges.append((begin, end, rights[1] == "w"))
    return ranges
