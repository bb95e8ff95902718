# SPDX-License-Identifier: Apache-2.0
"""Folders of the user alone: where caches of code lie, and what makes a folder safe."""

from __future__ import annotations

import functools
import logging
import os
import stat
from pathlib import Path

from ..errors import Error

log = logging.getLogger("oiiotex")

_notices: list[tuple[int, str]] = []  # what there is to log of caches
_ROOM = 16 << 20  # bytes that compiled kernels of a run take at most; PoCL aborts where a disk is full
_CACHES = ("oiiotex", "pocl", "pyopencl", "pytools")  # below the user's cache folder: code is run from each


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
        try:
            _require_writable(Path(temporary))
        except OSError as full:
            raise Error(
                f"{own} and {temporary} have no room for compiled kernels ({full.strerror}): expected {_ROOM >> 20} MB"
                " in one of them; free some, or set XDG_CACHE_HOME"
            ) from None
        os.environ["XDG_CACHE_HOME"] = temporary
        os.environ["POCL_CACHE_DIR"] = os.path.join(temporary, "pocl")
        os.mkdir(os.path.join(temporary, "oiiotex"), 0o700)
        why = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) else str(error)
        level = logging.INFO if isinstance(error, OSError) else logging.WARNING
        _notices.append((level, f"no cache is kept from run to run: {why}; set XDG_CACHE_HOME to such a folder"))


def _require_writable(folder: Path) -> None:
    """Raise an OSError where compiled kernels cannot be written: permissions, a full disk, a quota, a size limit."""
    import tempfile

    with tempfile.TemporaryFile(dir=folder) as file:
        try:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, _ROOM)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(folder)) from None


def _temporary_folder() -> str:
    """One of this process, removed at its end."""
    import atexit
    import shutil
    import tempfile

    folder, process = tempfile.mkdtemp(prefix="oiiotex-cache-"), os.getpid()
    atexit.register(lambda: shutil.rmtree(folder, ignore_errors=True) if os.getpid() == process else None)
    return folder
