# SPDX-License-Identifier: Apache-2.0
"""What this process may use of the machine: threads and memory; how it starts others.

All that is started is started here, and takes no code from the current folder. A child works in `/`. Its program is
named in full, or looked for in the folders that $PATH names in full; lists of folders in its environment have no entry
that means the current folder; a Python of ours looks for modules where this one does.
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

# Lists of folders from which Python, the dynamic loader, OpenImageIO, compilers and linkers take code.
_LISTS = (
    "PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "OPENIMAGEIO_PLUGIN_PATH", "OIIO_LIBRARY_PATH",
    "LIBRARY_PATH", "COMPILER_PATH", "GCC_EXEC_PREFIX", "CPATH", "C_INCLUDE_PATH",
)  # fmt: skip


def usable_threads() -> int:
    """CPU threads that this process may use: by affinity, and by the quota of its cgroup."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    for quota in _quotas():
        count = min(count, max(1, math.ceil(quota)))
    return count


def _quotas() -> list[float]:
    """CPUs that the cgroup allows, where it says so."""
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
    """Bytes of memory that this process may use: the machine's, or less where a cgroup says so."""
    installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 8 << 30
    limits = [installed]
    for name in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            limits.append(int(Path(name).read_text()))
        except (OSError, ValueError):  # absent, or the word 'max'
            continue
    return min(limits)


# --- processes ---


def start(command: Sequence[str], *, env: Mapping[str, str] | None = None, **how: Any) -> Popen[Any]:
    """Start a program.

    Parameters
    ----------
    command : sequence of str
        The program, by its absolute path, and its arguments. Paths among them must be absolute: it works in `/`.
    env : mapping, optional
        Its environment. Default: this process's.
    how
        As `subprocess.Popen` takes it.

    Raises
    ------
    ValueError
        The program is not named by an absolute path.
    OSError
        It cannot be started.
    """
    if not os.path.isabs(command[0]):
        raise ValueError(f"{command[0]}: expected the absolute path of a program")
    from subprocess import Popen  # slow to import, and few lines start a process

    return Popen(command, env=_without_current_folder(os.environ if env is None else env), cwd="/", **how)


def start_python(module: str, *arguments: str, **how: Any) -> Popen[Any]:
    """Start a module of ours as a program, in a Python that ignores the environment's and the user's own settings.

    Parameters
    ----------
    module : str
    arguments : str
    how
        As `start` takes it.
    """
    code = (
        f"import sys; sys.path[:] = {search_path()!r}; import runpy;"
        f" runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    )
    return start([sys.executable, "-I", "-c", code, *arguments], **how)


def program(name: str) -> str | None:
    """The absolute path of a program in a folder that $PATH names in full; None where there is none."""
    import shutil  # as slow

    path = shutil.which(name, path=_without_current_folder(os.environ).get("PATH", ""))
    return path if path and os.path.isabs(path) else None  # Windows looks in the current folder first


def forget_current_folder() -> None:
    """What this process loads from here on comes from folders that its environment names in full, too."""
    kept = _without_current_folder(os.environ)
    for name in _LISTS:
        if name in os.environ and name not in kept:
            del os.environ[name]
        elif name in kept and kept[name] != os.environ[name]:
            os.environ[name] = kept[name]


def search_path() -> list[str]:
    """Where this process looks for modules, less the current folder."""
    own = set(sysconfig.get_paths().values())  # of the interpreter, even where somebody works there
    here = os.path.realpath(os.curdir)
    entries = [p for p in sys.path if os.path.isabs(p) and (p in own or os.path.realpath(p) != here)]
    return [*entries, str(Path(__file__).resolve().parents[1])]


def _without_current_folder(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment, its lists of folders less the entries that are not absolute: '', '.', 'lib'."""
    kept = dict(environment)
    for name in _LISTS:
        if name in kept:
            kept[name] = os.pathsep.join(entry for entry in kept[name].split(os.pathsep) if os.path.isabs(entry))
            if not kept[name]:  # which loaders take for the current folder
                del kept[name]
    return kept
