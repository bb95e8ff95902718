# SPDX-License-Identifier: Apache-2.0
"""What must be right around OpenCL before it is used: threads, vendor files, and a linker for PoCL.

PoCL from PyPI runs the program `ld` for every kernel and aborts the whole process where it fails. So a CPU runtime is
tried once in a process of its own (`python -m oiiotex.opencl_runtime PLATFORM`), with the system's linker and, failing
that, with LLD out of the ziglang wheel; the answer is kept in the user's cache folder.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from types import ModuleType

from .errors import DeviceError

_PROBE_SECONDS = 120
_LLD_WRAPPER = """#!/bin/sh
# Written by oiiotex: LLD as PoCL's linker. A kernel needs none of the libraries that PoCL names.
for arg do
  shift
  case "$arg" in
    -lgcc|-lgcc_s|-lc|-lm|--as-needed|--no-as-needed) ;;
    *) set -- "$@" "$arg" ;;
  esac
done
exec '{python}' -m ziglang ld.lld "$@"
"""


@functools.cache
def _prepared(threads: int) -> None:
    """Set what the runtimes read once, when they start. The user's own settings win."""
    count = str(threads or len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    os.environ.setdefault("POCL_MAX_PTHREAD_COUNT", count)
    os.environ.setdefault("DPCPP_CPU_NUM_CUS", count)
    # Intel's wheel brings a vendor file with a path of the machine it was built on: name the library itself.
    intel = Path(sysconfig.get_path("data")) / "lib" / "libintelocl.so"
    if intel.exists() and importlib.util.find_spec("pocl_binary_distribution") is None:
        os.environ.setdefault("OCL_ICD_VENDORS", str(intel))


def load(threads: int = 0) -> ModuleType:
    """pyopencl, with the environment prepared for `threads` CPU threads (0: as many as the process may use).

    Raises
    ------
    DeviceError
        pyopencl is not installed or its OpenCL loader is broken.
    """
    _prepared(threads)
    try:
        import pyopencl
    except ImportError as error:
        raise DeviceError(f"pyopencl cannot be imported: {error}") from error
    return pyopencl


@functools.cache
def cpu_features() -> frozenset[str]:
    """Names of the instruction sets of this machine as Linux lists them; empty elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return frozenset()
    return frozenset(next((line.split(":")[1] for line in lines if line.startswith("flags")), "").split())


@functools.cache
def require_working(platform: str, version: str) -> None:
    """Make sure that a CPU runtime can build and run a kernel in this process.

    Raises
    ------
    DeviceError
        It cannot; the text says what to install.
    """
    if os.name != "posix":
        return
    answer = _cache_folder() / f"probe-{_fingerprint(platform, version)}"
    known = answer.read_text() if answer.exists() else ""
    if known not in ("system", "lld"):
        known = _probe(platform)
        _write(answer, known)
    if known == "lld":
        _use_lld()


def _probe(platform: str) -> str:
    """Which linker works: 'system' or 'lld'; raises DeviceError where none does."""
    path = os.environ.get("PATH", "")
    failure = _try_in_subprocess(platform, path)
    if failure is None:
        return "system"
    if importlib.util.find_spec("ziglang") is not None:
        failure = _try_in_subprocess(platform, f"{_lld_folder()}{os.pathsep}{path}")
        if failure is None:
            return "lld"
        raise DeviceError(f"{platform} cannot compile on this machine, neither with its linker nor with LLD: {failure}")
    raise DeviceError(f"{platform} needs a linker to compile and found none that works: pip install oiiotex[linker]")


def _try_in_subprocess(platform: str, path: str) -> str | None:
    """None where a kernel was built and gave the right answer, else the last line of what was said."""
    command = [sys.executable, "-m", "oiiotex.opencl_runtime", platform]
    # an empty kernel cache: a kernel compiled before would hide that the linker is gone now
    with tempfile.TemporaryDirectory(prefix="oiiotex-probe-") as cache:
        environment = {**os.environ, "PATH": path, "POCL_CACHE_DIR": cache}
        try:
            run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=_PROBE_SECONDS)
        except subprocess.TimeoutExpired:
            return f"no answer in {_PROBE_SECONDS} s"
    if run.returncode == 0:
        return None
    return (run.stderr.strip().splitlines() or [f"exit status {run.returncode}"])[-1]


def _use_lld() -> None:
    folder = _lld_folder()
    if not os.environ.get("PATH", "").startswith(folder):
        os.environ["PATH"] = f"{folder}{os.pathsep}{os.environ.get('PATH', '')}"


def _lld_folder() -> str:
    """The folder with a program `ld` that runs LLD; written where it is not there yet."""
    wrapper = _cache_folder() / "linker" / "ld"
    text = _LLD_WRAPPER.format(python=sys.executable)
    if not wrapper.exists() or wrapper.read_text() != text:
        _write(wrapper, text, mode=0o755)
    return str(wrapper.parent)


def _write(path: Path, text: str, mode: int = 0o644) -> None:
    """Write through a temporary name: another process may read at any time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}")
    part.write_text(text)
    part.chmod(mode)
    part.replace(path)


def _cache_folder() -> Path:
    import platformdirs

    return Path(platformdirs.user_cache_dir("oiiotex"))


def _fingerprint(platform: str, version: str) -> str:
    """Changes with everything that the probe's answer hangs on."""

    def installed(package: str) -> str:
        try:
            return importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            return ""

    facts = [platform, version, sys.executable, installed("pyopencl"), installed("ziglang")]
    facts += [str(shutil.which(name)) for name in ("ld", "gcc", "cc")]
    gcc = Path("/usr/lib/gcc")
    facts += sorted(str(p) for p in gcc.glob("*/*/libgcc.a")) if gcc.exists() else []
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()[:16]


def _run_probe(platform_name: str) -> bool:
    """Build and run a kernel on the platform; True where it counts right."""
    import numpy as np

    cl = load()
    platform = next(p for p in cl.get_platforms() if p.name == platform_name)
    context = cl.Context(platform.get_devices())
    queue = cl.CommandQueue(context)
    kernel = cl.Program(context, "__kernel void probe(__global int *a) { a[get_global_id(0)] *= 3; }").build().probe
    numbers = np.arange(64, dtype=np.int32)
    buffer = cl.Buffer(context, cl.mem_flags.COPY_HOST_PTR, hostbuf=numbers)
    kernel(queue, (64,), (64,), buffer)
    answer = np.empty_like(numbers)
    cl.enqueue_copy(queue, answer, buffer)
    return bool((answer == 3 * numbers).all())


if __name__ == "__main__":
    sys.exit(0 if _run_probe(sys.argv[1]) else "the kernel's answer is wrong")
