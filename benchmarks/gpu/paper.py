# SPDX-License-Identifier: Apache-2.0
"""Report what GPU compilers make of every kernel. Requires no GPU.

python -m benchmarks.gpu.paper [--all] [--bounds SIDE]

Each program is compiled by the tools of NVIDIA's and AMD's drivers: clang and libclc to PTX, which `ptxas` assembles;
clang with AMD's device libraries. The table has registers, spills, stack and local memory of each kernel, and the
occupancy that follows from them with work-groups of 64. With --bounds, filters run at SIDE px on the CPU, and a second
table has the time that their kernels need at least on named GPUs: for the bytes that each must read and write once, and
for its integer arithmetic where no early exit saves any.

Requires clang-15, libclc-15 and rocm-device-libs of Debian 12 (or newer ones) and `ptxas`, of a CUDA toolkit or of the
wheel nvidia-cuda-nvcc-cu12.
"""

from __future__ import annotations

import argparse
import functools
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import util
from itertools import product
from pathlib import Path

from benchmarks.gpu.bounds import WORK
from benchmarks.gpu.table import number
from benchmarks.gpu.worker import Worker
from benchmarks.gpu.workloads import AT_EVERY_SIZE
from oiiotex.engine.machine import usable_threads
from tests.kernel_options import OPTIONS, compiled

SOURCES = Path(__file__).parents[2] / "oiiotex" / "cl"
LEAST = 0.25  # occupancy below which a kernel needs a reason
GROUP = 64  # items of a work-group, as oiiotex/engine/opencl/device.py launches them


@dataclass(frozen=True)
class Gpu:
    """Limits on the groups that run at once on a multiprocessor, or on a SIMD of AMD's.

    NVIDIA: tables "Technical Specifications per Compute Capability" of the CUDA C++ Programming Guide.
    """

    name: str
    vendor: str
    warps: int = 0  # at most
    groups: int = 0  # at most
    local: int = 0  # bytes for all groups
    wave64: bool = False


GPUS = (
    Gpu("sm_80", "NVIDIA", warps=64, groups=32, local=164 << 10),
    Gpu("sm_89", "NVIDIA", warps=48, groups=24, local=100 << 10),
    Gpu("sm_90", "NVIDIA", warps=64, groups=32, local=228 << 10),
    Gpu("gfx90a", "AMD", warps=8, wave64=True),
    Gpu("gfx1030", "AMD", warps=16),
    Gpu("gfx1100", "AMD", warps=16),
)
_REGISTERS = 65536  # 32 bits wide, of a multiprocessor of NVIDIA's
_RESERVED = 1 << 10  # bytes of local memory that CUDA takes for each group
_ISA = {"gfx1100": "1030"}  # Debian 12's device libraries are older than the chip: those of its predecessor


@dataclass(frozen=True)
class Kernel:
    """Resources of a compiled kernel. Bytes are per item, `local` per work-group."""

    name: str
    registers: int
    spilled: int
    stack: int
    local: int
    occupancy: float


def clang() -> str | None:
    """The compiler: 15, for which libclc and AMD's libraries are packaged, or a newer one."""
    return next((name for n in range(15, 40) if (name := shutil.which(f"clang-{n}"))), None)


@functools.cache
def libclc() -> str | None:
    """NVIDIA's builtins as bitcode."""
    return next(map(str, sorted(Path("/usr/lib/clc").glob("nvptx64--nvidiacl.bc"))), None)


@functools.cache
def rocm() -> Path | None:
    """The folder of AMD's device libraries."""
    places = (Path("/usr/lib/x86_64-linux-gnu/amdgcn/bitcode"), Path("/opt/rocm/amdgcn/bitcode"))
    return next((place for place in places if place.is_dir()), None)


@functools.cache
def ptxas() -> str | None:
    """NVIDIA's assembler: of the wheel, or of a toolkit."""
    wheel = util.find_spec("nvidia")
    for folder in (wheel.submodule_search_locations or ()) if wheel else ():
        if os.access(found := Path(folder, "cuda_nvcc", "bin", "ptxas"), os.X_OK):
            return str(found)
    return shutil.which("ptxas")


def missing(gpu: Gpu) -> str:
    """Names of the packages that are not installed; empty if all are."""
    nvidia = gpu.vendor == "NVIDIA"
    wanted = {"clang-15": clang(), "libclc-15" if nvidia else "rocm-device-libs": libclc() if nvidia else rocm()}
    wanted |= {"ptxas (pip install nvidia-cuda-nvcc-cu12)": ptxas()} if nvidia else {}
    return ", ".join(name for name, found in wanted.items() if not found)


def _clang(stem: str, macros: dict[str, int], target: str, libraries: list[str], out: Path, *more: str) -> str:
    """Compile a program to assembly. Returns the compiler's remarks."""
    command = [
        clang() or "clang",
        "-x",
        "cl",
        "-cl-std=CL1.2",
        "-target",
        target,
        "-O3",
        "-w",
        "-S",
        "-nogpulib",
        *more,
    ]
    command += [word for library in libraries for word in ("-Xclang", "-mlink-builtin-bitcode", "-Xclang", library)]
    command += [f"-I{SOURCES}", *(f"-D{name}={value}" for name, value in {"LANES": 1, **macros}.items())]
    return _run([*command, "-o", str(out), str(SOURCES / f"{stem}.cl")])


def _run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{done.stderr}")
    return done.stderr + done.stdout


def kernels(gpu: Gpu, stem: str, macros: dict[str, int]) -> list[Kernel]:
    """All kernels of a program for a GPU.

    Raises
    ------
    RuntimeError
        The compiler or the assembler refuses it, with what it says.
    """
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "made.s"
        return (_nvidia if gpu.vendor == "NVIDIA" else _amd)(gpu, stem, macros, made)


def ptx(stem: str, macros: dict[str, int], out: Path) -> None:
    """PTX for sm_80, the newest that clang 15 knows and newer GPUs take."""
    words = ("-target-cpu", "sm_80", "-target-feature", "+ptx75")
    _clang(
        stem, macros, "nvptx64-nvidia-nvcl", [libclc() or ""], out, *(w for word in words for w in ("-Xclang", word))
    )


def _nvidia(gpu: Gpu, stem: str, macros: dict[str, int], made: Path) -> list[Kernel]:
    ptx(stem, macros, made)
    said = _run([ptxas() or "ptxas", f"-arch={gpu.name}", "-v", "-c", "-o", os.devnull, str(made)])
    found = []
    for part in said.split("Compiling entry function '")[1:]:
        stack, stores = (int(re.search(rf"(\d+) bytes {word}", part)[1]) for word in ("stack frame", "spill stores"))
        registers = int(re.search(r"Used (\d+) registers", part)[1])
        local = int(m[1]) if (m := re.search(r"(\d+) bytes smem", part)) else 0
        found.append(Kernel(part.partition("'")[0], registers, stores, stack, local, _occupancy(gpu, registers, local)))
    return found


def _occupancy(gpu: Gpu, registers: int, local: int) -> float:
    """The fraction of a multiprocessor's warps that groups of GROUP items fill, as in CUDA's occupancy calculator."""
    warps = GROUP // 32
    per_warp = -(-32 * registers // 256) * 256  # allocated in units of 256
    fitting = _REGISTERS // per_warp // 4 * 4  # by four warps
    groups = min(gpu.groups, min(gpu.warps, fitting) // warps, gpu.local // (local + _RESERVED))
    return groups * warps / gpu.warps


def _amd(gpu: Gpu, stem: str, macros: dict[str, int], made: Path) -> list[Kernel]:
    switches = ("daz_opt_off", "unsafe_math_off", "finite_only_off", "correctly_rounded_sqrt_on", "abi_version_400")
    isa = _ISA.get(gpu.name, gpu.name.removeprefix("gfx"))
    wave = f"wavefrontsize64_{'on' if gpu.wave64 else 'off'}"
    names = ["opencl", "ocml", "ockl", *(f"oclc_{word}" for word in (*switches, wave, f"isa_version_{isa}"))]
    libraries = [str((rocm() or Path()) / f"{name}.bc") for name in names]
    words = (f"-mcpu={gpu.name}", "-mcode-object-version=4", "-Rpass-analysis=kernel-resource-usage")
    said = _clang(stem, macros, "amdgcn-amd-amdhsa", libraries, made, *words)
    found = []
    for part in said.split("Function Name: ")[1:]:
        facts = {name.strip(): int(value) for name, value in re.findall(r"remark:\s+([^:\n]+): (\d+)", part)}
        spilled = facts["VGPRs Spill"]  # of scalar registers: to lanes of vector registers, not to memory
        name, waves = part.split()[0], facts["Occupancy [waves/SIMD]"]
        scratch, local = facts["ScratchSize [bytes/lane]"], facts["LDS Size [bytes/block]"]
        found.append(Kernel(name, facts["VGPRs"], spilled, scratch, local, waves / gpu.warps))
    return found


def programs(every: bool) -> Iterator[tuple[str, dict[str, int]]]:
    """(file, macros) of what the package builds: all sets of options, or the first of each file."""
    for stem in sorted(OPTIONS):
        for macros in compiled(stem) if every else compiled(stem)[:1]:
            yield stem, macros


def survey(gpus: tuple[Gpu, ...], every: bool) -> dict[str, dict[str, Kernel]]:
    """By kernel and GPU: what the worst set of options needs."""
    found: dict[str, dict[str, Kernel]] = {}
    with ThreadPoolExecutor(usable_threads()) as pool:
        jobs = list(product(gpus, programs(every)))
        for (gpu, _), made in zip(jobs, pool.map(lambda job: kernels(job[0], *job[1]), jobs), strict=True):
            for kernel in made:
                row = found.setdefault(kernel.name, {})
                row[gpu.name] = max(row.get(gpu.name, kernel), kernel, key=lambda k: (k.spilled, k.registers, k.stack))
    return found


def table(found: dict[str, dict[str, Kernel]], gpus: tuple[Gpu, ...]) -> str:
    """One row for each kernel; those with the most registers come first."""
    lines = ["| kernel | " + " | ".join(gpu.name for gpu in gpus) + " |", "|---|" + "---|" * len(gpus)]
    for name, row in sorted(found.items(), key=lambda item: (-max(k.registers for k in item[1].values()), item[0])):
        lines.append(f"| `{name}` | {' | '.join(_cell(row[gpu.name]) for gpu in gpus)} |")
    return "\n".join(lines)


def _cell(kernel: Kernel) -> str:
    parts = [f"{kernel.registers} · {100 * kernel.occupancy:.0f} %"]
    parts += [f"stack {kernel.stack}"] if kernel.stack else []
    parts += [f"local {kernel.local}"] if kernel.local else []
    return ", ".join([*parts, f"**spills {kernel.spilled}**"] if kernel.spilled else parts)


# Integer operations of one thing that bounds.WORK counts, by kernel or by kind; a product with its sum is one.
_OPERATIONS = {
    "patch distances": lambda macros: 2 * macros["PATCH"] ** 2 * macros["CHANNELS"],
    "votes": lambda macros: macros["CHANNELS"],
    "superpixels_assign": lambda macros: 2 * 5,
    "distances": lambda macros: 2 * macros.get("PLANES", 16),
    "candidates": lambda macros: 1,
    "taps": lambda macros: 1,
    "products": lambda macros: 1,
}
# bytes a second, integer operations a second: NVIDIA's data sheets, 64 integer units a multiprocessor
_NAMED = {"A100 40 GB": (1555e9, 108 * 64 * 1.41e9), "RTX 4090": (1008e9, 128 * 64 * 2.52e9)}


def bounds_table(side: int) -> str:
    """The kernels of whole filters at side x side px, with what they cannot be faster than."""
    head = "| filter | kernel | launches | MB | G operations | "
    lines = [head + " | ".join(f"{gpu}, ms" for gpu in _NAMED) + " |", "|---|---|---|---|---|" + "---|" * len(_NAMED)]
    with tempfile.TemporaryDirectory() as folder:
        worker = Worker("cpu", 0, Path(folder) / "last")
        for name in AT_EVERY_SIZE:
            rows, total = [], dict.fromkeys(_NAMED, 0.0)
            for kernel, facts in worker.time(name, side)["kernels"].items():
                if facts.get("bytes") is None:
                    continue
                operations = (facts["work"] or 0.0) * _per_thing(kernel)
                times = {gpu: max(facts["bytes"] / rate, operations / ops) for gpu, (rate, ops) in _NAMED.items()}
                total = {gpu: total[gpu] + times[gpu] for gpu in _NAMED}
                cells = [f"`{kernel}`", str(facts["calls"]), number(facts["bytes"] / 1e6), number(operations / 1e9)]
                rows.append((times, f"| {name} | {' | '.join([*cells, *(number(1e3 * s) for s in times.values())])} |"))
            rows.sort(key=lambda row: -max(row[0].values()))
            lines += [row for _, row in rows[:6]]
            lines.append(f"| {name} | all | | | | {' | '.join(number(1e3 * s) for s in total.values())} |")
    return "\n".join(lines)


def _per_thing(kernel: str) -> float:
    if kernel not in WORK:
        return 0.0
    stem = max((stem for stem in OPTIONS if kernel.startswith(f"{stem}_")), key=len)
    usual = {"PATCH": 11, "CHANNELS": 3}
    return _OPERATIONS.get(kernel, _OPERATIONS[WORK[kernel][0]])({**compiled(stem)[0], **usual})


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--all", action="store_true", help="all sets of options, not the first of each program")
    parser.add_argument("--bounds", type=int, metavar="SIDE", help="print lower bounds of time for SIDE px")
    given = parser.parse_args()
    if given.bounds:
        print(bounds_table(given.bounds))
        return
    gpus = tuple(gpu for gpu in GPUS if not missing(gpu))
    for gpu in GPUS:
        if gpu not in gpus:
            print(f"{gpu.name} is skipped: not installed: {missing(gpu)}")
    found = survey(gpus, given.all)
    print(f"Registers · occupancy with groups of {GROUP}; bytes of stack an item, of local memory a group.\n")
    print(table(found, gpus))
    spilling = sum(any(k.spilled for k in row.values()) for row in found.values())
    least = min(found, key=lambda name: min(k.occupancy for k in found[name].values()))
    occupancy = min(k.occupancy for k in found[least].values())
    print(f"\n{len(found)} kernels, {spilling} with spills; least occupancy {number(100 * occupancy)} % ({least}).")


if __name__ == "__main__":
    main()
