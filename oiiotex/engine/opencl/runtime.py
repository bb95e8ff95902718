# SPDX-License-Identifier: Apache-2.0
"""Setup of OpenCL before use: threads, vendor files, a linker and a CPU name for PoCL.

A runtime that cannot compile may abort its process (PoCL runs the program `ld` for every kernel), or refuse the
machine's CPU. So a device is probed once in a separate process (`probe`): with the system's linker, then with LLD from
the ziglang wheel, then both again with the best CPU that PoCL 3.0 knows (`cpu`). The result is kept in the user's
cache folder.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import importlib.util
import json
import logging
import os
import platform
import re
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
from dataclasses import asdict, dataclass
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from ... import __version__
from ..errors import DeviceError, Error
from ..machine import forget_current_folder, program, search_path, start_python, usable_threads
from . import cpu as opencl_cpu

if TYPE_CHECKING:
    import pyopencl as cl

log = logging.getLogger("oiiotex")
_PROBE_SECONDS = 120
_CAPTURED = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "errors": "replace"}
_VENDORS = Path("/etc/OpenCL/vendors")
_KERNEL_FILE = r".*\..*|last_accessed|tempfile.*"  # names of files in PoCL's folder; those of its folders have no dot
_LLD_WRAPPER = """#!/bin/sh
# Written by oiiotex: LLD as PoCL's linker. A kernel needs none of the libraries that PoCL lists.
for arg do
  shift
  case "$arg" in
    -lgcc|-lgcc_s|-lc|-lm|--as-needed|--no-as-needed) ;;
    *) set -- "$@" "$arg" ;;
  esac
done
exec {zig} ld.lld "$@"
"""


@dataclass(frozen=True)
class Attempt:
    """A way to use a runtime: the linker, and the CPU named as target ('': detected by the runtime)."""

    linker: str = "system"  # or "lld"
    cpu: str = ""

    def __str__(self) -> str:
        how = f"CPU set to {self.cpu}" if self.cpu else "default settings"
        return f"{how}, {'LLD' if self.linker == 'lld' else 'system linker'}"


@dataclass(frozen=True)
class Trial:
    """The result of probing a device: the first attempt that works, if any, and the errors of those before it."""

    works: Attempt | None
    lanes: int  # 16-bit lanes in a register of the compiler's target; 0 if nothing works
    failures: tuple[tuple[Attempt, str], ...]

    @property
    def why(self) -> str:
        """The compiler's first error: later attempts are less and less common setups."""
        return self.failures[0][1] if self.failures else ""


_trials: dict[int, Trial] = {}  # of this process, by the device's address
_used: set[int] = set()


@functools.cache
def _prepared(threads: int) -> None:
    """Set variables that runtimes read when they start. The user's own settings take precedence."""
    forget_current_folder()  # PoCL searches the program `ld`
    count = str(threads or usable_threads())
    os.environ.setdefault("POCL_MAX_PTHREAD_COUNT", count)
    os.environ.setdefault("DPCPP_CPU_NUM_CUS", count)
    os.environ["PYOPENCL_NO_CACHE"] = "1"  # its pickles are not checked; see `Program`
    _check_kernels()
    intel = _intel_library()
    if intel is not None and "OCL_ICD_VENDORS" not in os.environ:
        os.environ["OCL_ICD_VENDORS"] = _vendors_with(intel)


@functools.cache
def _check_kernels() -> None:
    """Name PoCL a folder for its kernels, without damaged ones, and seal those that it has when this process ends.

    PoCL takes an empty program for a program without kernels, and crashes on half a kernel. A folder that
    $POCL_CACHE_DIR names is not ours: it may have files of others, so nothing is removed or written there.
    """
    import atexit

    from ..io.sealed import SealedFolder

    own = cache_folder() / "pocl"
    named = Path(os.environ.setdefault("POCL_CACHE_DIR", str(own)))
    wrong = next(iter(SealedFolder(named, _KERNEL_FILE).misplaced()), "") if named != own else ""
    if wrong:
        log.warning("POCL_CACHE_DIR=%s is not used: remove %s, which makes PoCL abort", named, wrong)
        os.environ["POCL_CACHE_DIR"] = str(own)
    elif named != own:
        return
    kernels, process = SealedFolder(own, _KERNEL_FILE), os.getpid()
    kernels.remove_damaged()
    atexit.register(lambda: kernels.seal() if os.getpid() == process else None)


def _intel_library() -> Path | None:
    """Intel's runtime from PyPI, whose vendor file holds a path of the machine that it was built on."""
    library = Path(sysconfig.get_path("data")) / "lib" / "libintelocl.so"
    return library if library.exists() else None


def _vendors_with(library: Path) -> str:
    """A folder of vendor files, the system's and one for `library`: naming only the library would hide the others."""
    files = {"oiiotex-pip.icd": f"{library}\n"}
    files |= {path.name: path.read_text() for path in sorted(_VENDORS.glob("*.icd"))}
    folder = cache_folder() / f"vendors-{hashlib.sha256(repr(files).encode()).hexdigest()[:16]}"
    for name, text in files.items():
        _write_if_other(folder / name, text)
    return str(folder)


def include_no_headers_of(pyopencl: ModuleType) -> None:
    """Remove pyopencl's include folder from build options: kernels do not need it, and runtimes split at spaces."""
    options = getattr(pyopencl, "_DEFAULT_INCLUDE_OPTIONS", None)
    if isinstance(options, list):
        options.clear()


def load(threads: int = 0) -> ModuleType:
    """Import pyopencl with the environment set for `threads` CPU threads (0: as many as the process may use)."""
    cache_folder()
    _prepared(threads)
    try:
        import pyopencl
    except ImportError as error:
        raise DeviceError(f"cannot import pyopencl: {error}") from error
    include_no_headers_of(pyopencl)
    return pyopencl


def built_program(context: cl.Context, source: str, options: list[str]) -> cl.Program:
    """A built program, from the cache folder if it is there.

    PoCL has a cache, too, but preprocesses the source to find the program there, which takes 30 ms each time.

    Raises
    ------
    pyopencl.Error
        The compiler refuses the source.
    """
    import pyopencl

    from ..io.atomic import temporary_beside
    from ..io.sealed import read_sealed, write_sealed

    (device,) = context.devices
    facts = [source, *options, device.platform.version, device.name, device.version, device.driver_version]
    path = cache_folder() / "programs" / hashlib.sha256(repr(facts).encode()).hexdigest()
    with contextlib.suppress(OSError, ValueError, pyopencl.Error):  # missing, damaged, or not accepted
        return pyopencl.Program(context, [device], [read_sealed(path).read()]).build(options)
    program = pyopencl.Program(context, source).build(options)
    with contextlib.suppress(OSError, Error):
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary_beside(path, cache=True) as temporary:
            write_sealed(temporary, program.get_info(pyopencl.program_info.BINARIES))
    return program


# --- probing ---


def tried(device: cl.Device, again: bool = False) -> Trial:
    """The result of probing the device, from this process, an earlier one, or a probe now."""
    key = device.int_ptr
    if key not in _trials:
        trial = _kept(device)
        if trial is None or (again and trial.works is None):
            trial = _try(device)
            if trial.works is not None:
                keep(device, trial)
        _trials[key] = trial
    return _trials[key]


def keep(device: cl.Device, trial: Trial) -> None:
    """Cache the result for later processes.

    Cache a failure only if another device works: otherwise a repair of the machine would go unnoticed.
    """
    from ..io.atomic import temporary_beside
    from ..io.sealed import write_sealed

    path = _answer_file(device)
    with contextlib.suppress(OSError, Error), temporary_beside(path, cache=True) as temporary:  # or all probe again
        write_sealed(temporary, [json.dumps(asdict(trial)).encode()])


def use(device: cl.Device) -> None:
    """Set up this process for the attempt that works, before the device's first context."""
    works = tried(device).works
    if works is None or device.int_ptr in _used:
        return
    if works.linker == "lld":
        os.environ["PATH"] = _path_with_lld()
    if works.cpu:
        try:
            opencl_cpu.name_cpu(device, works.cpu)
        except LookupError as error:
            raise DeviceError(f"{device.name}: cannot use {works}: {error}") from error
    _used.add(device.int_ptr)


def attempts(cpu: str) -> list[Attempt]:
    """All attempts, in order. `cpu`: the CPU name for the runtime, '' if it needs none."""
    linkers = ["system"] if _zig() is None else ["system", "lld"]
    return [Attempt(linker, name) for name in (["", cpu] if cpu else [""]) for linker in linkers]


def _try(device: cl.Device) -> Trial:
    cpu = bool(device.type & load().device_type.CPU)
    failures: list[tuple[Attempt, str]] = []
    for attempt in attempts(opencl_cpu.name_for(device)) if cpu else [Attempt()]:
        lanes, words = _try_in_subprocess(device, attempt)
        if lanes:
            return Trial(attempt, lanes, tuple(failures))
        failures.append((attempt, words))
    return Trial(None, 0, tuple(failures))


def _try_in_subprocess(device: cl.Device, attempt: Attempt) -> tuple[int, str]:
    """The lanes of a kernel with correct results and '', or 0 and the error."""
    number = device.platform.get_devices().index(device)
    words = [device.platform.name, device.platform.version, str(number), attempt.cpu]
    path = _path_with_lld() if attempt.linker == "lld" else _path()
    # an empty kernel cache: a cached kernel would hide a missing linker
    with tempfile.TemporaryDirectory(prefix="oiiotex-probe-") as cache:
        environment = {**os.environ, "PATH": path, "POCL_CACHE_DIR": cache}
        with start_python("oiiotex.engine.opencl.probe", *words, env=environment, **_CAPTURED) as probe:
            try:
                output, errors = probe.communicate(timeout=_PROBE_SECONDS)
            except subprocess.TimeoutExpired:
                probe.kill()
                return 0, f"no response in {_PROBE_SECONDS} s"
            except BaseException:
                probe.kill()
                raise
    answer = output.split()
    if probe.returncode == 0 and answer and answer[-1].isdigit():
        return int(answer[-1]), ""
    return 0, _last_words(errors, probe.returncode)


def _last_words(errors: str, code: int) -> str:
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    if code >= 0:
        return lines[-1] if lines else f"exit status {code}"
    first = next((line for line in lines if "error" in line), lines[-1] if lines else "")
    return f"{first} ({signal.Signals(-code).name})".strip()


# --- errors and remedies ---


def compilers_words(error: str) -> str:
    """The compiler's error of a failed build, in one line, without pyopencl's additions."""
    log = re.search(r"Build on [^\n]*:\n(.*?)\n\(options:", error, re.DOTALL)
    text = log[1] if log else error.split("(options:")[0]
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line), " ".join(lines)) or "the build failed"


def remedy(trials: list[Trial]) -> str:
    """A command that fixes this machine, given the results for all its devices; '' if none is known."""
    x86 = platform.machine().lower() in ("x86_64", "amd64")
    if not trials and x86 and sys.platform == "linux" and importlib.util.find_spec("pocl_binary_distribution") is None:
        return "pip install 'oiiotex[cpu]'"
    messages = " ".join(words for trial in trials for _, words in trial.failures)
    if _zig() is None and any(word in messages for word in ('"ld"', "linker", "linking")):
        return "pip install 'oiiotex[linker]'"
    if x86 and sys.platform in ("linux", "win32") and _intel_library() is None:
        return "pip install 'oiiotex[intel]'"
    return "apt install pocl-opencl-icd" if program("apt") else ""


# --- LLD ---


def _zig() -> Path | None:
    """The program of the ziglang wheel, which includes LLD."""
    spec = PathFinder.find_spec("ziglang", search_path()) if os.name == "posix" else None
    program = Path(spec.origin).with_name("zig") if spec is not None and spec.origin else None
    return program if program is not None and program.exists() else None


def _path_with_lld() -> str:
    """$PATH, preceded by a folder with a program `ld` that runs LLD; the program is written if necessary."""
    wrapper = _lld_folder() / "ld"
    text = _LLD_WRAPPER.format(zig=shlex.quote(str(_zig())))
    _write_if_other(wrapper, text, mode=0o755)
    return f"{wrapper.parent}{os.pathsep}{_path()}"


def _path() -> str:
    """$PATH without that folder: a process that uses LLD passes it on to its child processes."""
    return os.pathsep.join(p for p in os.environ.get("PATH", "").split(os.pathsep) if p != str(_lld_folder()))


def _lld_folder() -> Path:
    return cache_folder() / "linker"


# --- the cache folder ---


def cache_folder() -> Path:
    """As in `cache_folders`, which is imported on demand: help does not need it."""
    from ..io import cache_folders

    return cache_folders.cache_folder()


def _kept(device: cl.Device) -> Trial | None:
    from ..io.sealed import read_sealed

    try:
        facts = json.loads(read_sealed(_answer_file(device)).read())
        works = Attempt(**facts["works"]) if facts["works"] else None
        return Trial(works, int(facts["lanes"]), tuple((Attempt(**a), str(words)) for a, words in facts["failures"]))
    except (OSError, ValueError):  # missing or damaged
        return None


def _answer_file(device: cl.Device) -> Path:
    """The cache file of the result, named by a hash of everything that it depends on."""

    def installed(package: str) -> str:
        try:
            return importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            return ""

    facts = [__version__, sys.executable, installed("pyopencl"), str(_zig()), installed("ziglang")]
    facts += [device.platform.name, device.platform.version, device.name, device.version, device.driver_version]
    cpu = opencl_cpu.cpu()
    facts += [cpu.get(name, "") for name in ("vendor_id", "cpu family", "model", "flags")] + [platform.machine()]
    facts += [f"{name}={value}" for name, value in sorted(os.environ.items()) if name in _READ_BY_RUNTIMES]
    facts += [str(shutil.which(name, path=_path())) for name in ("ld", "gcc", "cc")]
    facts += sorted(map(str, Path("/usr/lib/gcc").glob("*/*/libgcc.a")))
    return cache_folder() / f"probe-{hashlib.sha256(chr(10).join(facts).encode()).hexdigest()[:16]}.json"


_READ_BY_RUNTIMES = {
    "OCL_ICD_VENDORS", "LD_LIBRARY_PATH", "POCL_DEVICES", "POCL_KERNEL_CACHE", "POCL_WORK_GROUP_METHOD",
    "CL_CONFIG_CPU_TARGET_ARCH",
}  # fmt: skip


def _write_if_other(path: Path, text: str, mode: int = 0o644) -> None:
    """Write a text that is not there, through a temporary name, because another process may read at any time."""
    with contextlib.suppress(OSError, ValueError):  # missing or damaged
        if path.read_text() == text:
            return
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}")
    part.write_text(text)
    part.chmod(mode)
    part.replace(path)
