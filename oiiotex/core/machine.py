# SPDX-License-Identifier: Apache-2.0
"""What this process may use of the machine: threads, memory, private folders; how it starts another of ours."""

from __future__ import annotations

import functools
import logging
import math
import os
import stat
import sys
import sysconfig
from pathlib import Path

from ..errors import Error

log = logging.getLogger("oiiotex")

_notices: list[tuple[int, str]] = []  # what there is to log of caches
_CACHES = ("oiiotex", "pocl", "pyopencl", "pytools")  # below the user's cache folder: code is run from each


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


def isolated(module: str, *arguments: str) -> list[str]:
    """The command that runs a module of ours in a Python that takes no code from the current folder.

    It looks where this process looks (an environment, an editable installation, a folder of PYTHONPATH), less the
    current folder, which `python -m` and `python -c` put first.
    """
    start = (
        f"import sys; sys.path[:] = {search_path()!r}; import runpy;"
        f" runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    )
    return [sys.executable, "-I", "-c", start, *arguments]


def search_path() -> list[str]:
    """Where this process looks for modules, less the current folder."""
    own = set(sysconfig.get_paths().values())  # of the interpreter, even where somebody works there
    here = os.path.realpath(os.curdir)
    entries = [p for p in sys.path if os.path.isabs(p) and (p in own or os.path.realpath(p) != here)]
    return [*entries, str(Path(__file__).resolve().parents[2])]


# --- folders ---


def require_private(folder: Path, others: int = 0o022) -> None:
    """Refuse a folder in which somebody else could put what this process runs or connects to.

    Parameters
    ----------
    folder : Path
        It is there.
    others : int
        Permissions that neither group nor others may have; to write in the group of the user alone is no harm.

    Raises
    ------
    Error
        The folder is another user's, or open to others, or somebody else can exchange it or a folder above it.
    OSError
        It cannot be looked at.
    """
    if os.name != "posix":  # profiles are private there
        return
    real = Path(os.path.realpath(folder))
    status = real.stat()
    open_to = status.st_mode & others & ~(0o020 if _is_own_group(status.st_gid) and others == 0o022 else 0)
    mine = status.st_uid == os.geteuid() == os.lstat(folder).st_uid
    if not (stat.S_ISDIR(status.st_mode) and mine) or open_to:
        raise Error(f"{folder} belongs to another user or is open to others: expected a folder of yours alone")
    for above in {*real.parents, *Path(os.path.abspath(folder)).parents}:
        status = above.stat()
        writable = status.st_mode & (0o002 if _is_own_group(status.st_gid) else 0o022)
        if status.st_uid not in (0, os.geteuid()) or (writable and not status.st_mode & stat.S_ISVTX):
            raise Error(f"{folder}: other users can write in {above}: expected a folder that nobody else can exchange")


@functools.cache
def _is_own_group(group: int) -> bool:
    """Whether a group is that which many systems make for each user, of the same name, and of root."""
    import grp
    import pwd

    try:
        entry, user = grp.getgrgid(group), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    return group == user.pw_gid and entry.gr_name == user.pw_name and set(entry.gr_mem) <= {user.pw_name}


def cache_folder() -> Path:
    """The program's cache folder: the user's, or a temporary one where that is not safe or not writable.

    OpenCL runtimes and pyopencl follow, whose caches hold code: before the first of them is loaded this is called.
    """
    import platformdirs

    settled_caches(os.environ.get("HOME"), os.environ.get("XDG_CACHE_HOME"), os.environ.get("POCL_CACHE_DIR"))
    while _notices and not log.disabled:  # while a line is looked through nothing is said
        log.log(*_notices.pop())
    return Path(platformdirs.user_cache_dir("oiiotex"))


@functools.cache
def settled_caches(*environment: str | None) -> None:
    """Let all caches lie in folders of the user alone; of one environment once in a process."""
    import platformdirs

    own = Path(platformdirs.user_cache_dir("oiiotex"))
    named = [Path(os.environ["POCL_CACHE_DIR"])] if os.environ.get("POCL_CACHE_DIR") else []
    try:
        for folder in (*named, *(own.parent / name for name in _CACHES)):
            if folder.exists():
                for one in (folder, *(entry for entry in folder.iterdir() if entry.is_dir())):
                    require_private(one)
        for folder in (own, *named):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            require_private(folder)
            _require_writable(folder)
    except (OSError, Error) as error:
        temporary = _temporary_folder()
        os.environ["XDG_CACHE_HOME"] = temporary
        os.environ["POCL_CACHE_DIR"] = os.path.join(temporary, "pocl")
        os.mkdir(os.path.join(temporary, "oiiotex"), 0o700)
        why = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) else str(error)
        level = logging.INFO if isinstance(error, OSError) else logging.WARNING
        _notices.append((level, f"no cache is kept from run to run: {why}; set XDG_CACHE_HOME to such a folder"))


def _require_writable(folder: Path) -> None:
    import tempfile

    with tempfile.TemporaryFile(dir=folder):
        pass


def _temporary_folder() -> str:
    """One of this process, removed at its end."""
    import atexit
    import shutil
    import tempfile

    folder, process = tempfile.mkdtemp(prefix="oiiotex-cache-"), os.getpid()
    atexit.register(lambda: os.getpid() == process and shutil.rmtree(folder, ignore_errors=True))
    return folder
