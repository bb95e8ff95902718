# SPDX-License-Identifier: Apache-2.0
"""Threads and memory that this process may use, and how it starts other processes.

All child processes are started here, and load no code from the current folder. They run in `/`. Their program is an
absolute path, or is found in absolute entries of $PATH. Search paths in their environment have no relative entries, and
child Pythons use the module search path of this process.
"""

from __future__ import annotations

import math
import os
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from subprocess import Popen

# Search paths from which Python, the dynamic loader, OpenImageIO, compilers and linkers load code.
_LISTS = (
    "PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "OPENIMAGEIO_PLUGIN_PATH", "OIIO_LIBRARY_PATH",
    "LIBRARY_PATH", "COMPILER_PATH", "GCC_EXEC_PREFIX", "CPATH", "C_INCLUDE_PATH",
)  # fmt: skip
_MMAP_THRESHOLD = -3  # an option of mallopt, by glibc's malloc.h


def usable_threads() -> int:
    """Number of CPU threads that this process may use, by affinity and cgroup quota."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    for quota in _quotas():
        count = min(count, max(1, math.ceil(quota)))
    return count


def _quotas() -> list[float]:
    """CPU quotas of the cgroup, if it has any."""
    quotas = []
    try:
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text().split()
        quotas.append(int(quota) / int(period))
    except (OSError, ValueError):  # absent, or the word 'max'
        pass
    try:
        folder = Path("/sys/fs/cgroup/cpu")
        quota, period = ((folder / f"cpu.cfs_{n}_us").read_text() for n in ("quota", "period"))
        if int(quota) > 0:
            quotas.append(int(quota) / int(period))
    except (OSError, ValueError):
        pass
    return quotas


def memory() -> int:
    """Bytes of memory that this process may use: the machine's, or the limit of its cgroup."""
    installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 8 << 30
    limits = [installed]
    for name in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            limits.append(int(Path(name).read_text()))
        except (OSError, ValueError):  # absent, or the word 'max'
            continue
    return min(limits)


# --- processes ---


def return_freed_memory() -> None:
    """Give freed memory back to the system: glibc keeps what arrays of some megabytes leave in its heaps."""
    trim = _of_glibc("malloc_trim")
    if trim is not None:
        trim(0)


def map_large_arrays() -> None:
    """Let glibc return an array of 4 MB or more to the system when it is freed.

    By itself it raises that size, up to 32 MB, to that of each array that is freed, and buffers then leave holes.
    """
    set_option = _of_glibc("mallopt")
    if set_option is not None:
        set_option(_MMAP_THRESHOLD, 4 << 20)


def _of_glibc(name: str) -> Any:
    """A function of the C library; None if it has none of this name, which glibc alone has."""
    if sys.platform != "linux":
        return None
    import ctypes

    return getattr(ctypes.CDLL(None), name, None)


def start(command: Sequence[str], *, env: Mapping[str, str] | None = None, **how: Any) -> Popen[Any]:
    """Start a program.

    Parameters
    ----------
    command : sequence of str
        Absolute path of the program, and its arguments. Paths in arguments must be absolute, as it runs in `/`.
    env : mapping, optional
        Its environment. Default: this process's.
    how
        Further arguments of `subprocess.Popen`.

    Raises
    ------
    ValueError
        The path of the program is not absolute.
    OSError
        The program cannot be started.
    """
    if not os.path.isabs(command[0]):
        raise ValueError(f"{command[0]}: expected the absolute path of a program")
    from subprocess import Popen  # slow to import, and rarely needed

    return Popen(command, env=_without_current_folder(os.environ if env is None else env), cwd="/", **how)


def start_python(module: str, *arguments: str, **how: Any) -> Popen[Any]:
    """Start a module of oiiotex as a program, in a Python that ignores environment variables and user settings.

    Parameters
    ----------
    module : str
    arguments : str
    how
        Further arguments of `start`.
    """
    code = (
        f"import sys; sys.path[:] = {search_path()!r}; import runpy;"
        f" runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    )
    return start([sys.executable, "-I", "-c", code, *arguments], **how)


def program(name: str) -> str | None:
    """The absolute path of a program found in absolute entries of $PATH; None if there is none."""
    import shutil  # slow to import

    path = shutil.which(name, path=_without_current_folder(os.environ).get("PATH", ""))
    return path if path and os.path.isabs(path) else None  # Windows searches the current folder first


def forget_current_folder() -> None:
    """Remove relative entries from the search paths in this process's environment."""
    kept = _without_current_folder(os.environ)
    for name in _LISTS:
        if name in os.environ and name not in kept:
            del os.environ[name]
        elif name in kept and kept[name] != os.environ[name]:
            os.environ[name] = kept[name]


def search_path() -> list[str]:
    """The module search path of this process, without the current folder."""
    own = set(sysconfig.get_paths().values())  # of the interpreter, kept even if it is the current folder
    here = os.path.realpath(os.curdir)
    entries = [p for p in sys.path if os.path.isabs(p) and (p in own or os.path.realpath(p) != here)]
    return [*entries, str(Path(__file__).resolve().parents[2])]


def _without_current_folder(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment, without relative entries such as '', '.' and 'lib' in its search paths."""
    kept = dict(environment)
    for name in _LISTS:
        if name in kept:
            kept[name] = os.pathsep.join(entry for entry in kept[name].split(os.pathsep) if os.path.isabs(entry))
            if not kept[name]:  # an empty list means the current folder to loaders
                del kept[name]
    return kept
