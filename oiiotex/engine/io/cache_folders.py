# SPDX-License-Identifier: Apache-2.0
"""Private folders for caches of compiled code, and the checks that make a folder safe."""

from __future__ import annotations

import functools
import logging
import os
import stat
from pathlib import Path

from ..errors import Error, reason_of

log = logging.getLogger("oiiotex")

_notices: list[tuple[int, str]] = []  # pending log messages about caches
_ROOM = 16 << 20  # bytes that compiled kernels of a run need at most; PoCL aborts on a full disk


def require_private(folder: Path, others: int = 0o022) -> None:
    """Refuse a folder in which another user could place code that this process runs, or sockets that it connects to.

    Parameters
    ----------
    folder : Path
        An existing folder.
    others : int
        Permission bits that group and others must not have; write permission for the user's private group is safe.

    Raises
    ------
    Error
        The folder belongs to another user, is open to others, or another user can replace it or a parent folder.
    OSError
        The folder cannot be inspected.
    """
    if os.name != "posix":  # profiles are private there
        return
    _require_own(folder, others)
    for above in {*Path(os.path.realpath(folder)).parents, *Path(os.path.abspath(folder)).parents}:
        status = above.stat()
        writable = status.st_mode & (0o002 if _is_own_group(status.st_gid) else 0o022)
        if status.st_uid not in (0, os.geteuid()) or (writable and not status.st_mode & stat.S_ISVTX):
            raise Error(f"{folder}: other users can write to {above}", expected="a folder that only you can replace")


def _require_own(folder: Path, others: int = 0o022) -> None:
    """Refuse a folder of another user, or one open to others, as in `require_private`; not what lies above it."""
    status = os.stat(folder)
    open_to = status.st_mode & others & ~(0o020 if _is_own_group(status.st_gid) and others == 0o022 else 0)
    mine = status.st_uid == os.geteuid() == os.lstat(folder).st_uid
    if not (stat.S_ISDIR(status.st_mode) and mine) or open_to:
        raise Error(f"{folder} belongs to another user or is open to others", expected="a private folder")


@functools.cache
def _is_own_group(group: int) -> bool:
    """Whether a group is the user's private group, which many systems create under the user's name."""
    import grp
    import pwd

    try:
        entry, user = grp.getgrgid(group), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    return group == user.pw_gid and entry.gr_name == user.pw_name and set(entry.gr_mem) <= {user.pw_name}


def cache_folder() -> Path:
    """The program's cache folder: the user's, or a temporary one if that is not safe or not writable.

    PoCL keeps its kernels there, too, unless $POCL_CACHE_DIR names another folder; it is called before PoCL is loaded.
    """
    import platformdirs

    settled_caches(os.environ.get("HOME"), os.environ.get("XDG_CACHE_HOME"), os.environ.get("POCL_CACHE_DIR"))
    while _notices and not log.disabled:  # a rehearsal of a line logs nothing
        log.log(*_notices.pop())
    return Path(platformdirs.user_cache_dir("oiiotex"))


@functools.cache
def settled_caches(*environment: str | None) -> None:
    """Place all caches in private folders, because code is run from them; once per process and environment."""
    import platformdirs

    own = Path(platformdirs.user_cache_dir("oiiotex"))
    named = [Path(os.environ["POCL_CACHE_DIR"])] if os.environ.get("POCL_CACHE_DIR") else []
    try:
        for folder in (*named, own):
            if folder.exists():
                require_private(folder)
                _require_private_within(folder)
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
                f"no space for compiled kernels in {own} and {temporary} ({full.strerror})",
                expected=f"{_ROOM >> 20} MB in one of them",
                hint="free some space, or set XDG_CACHE_HOME",
            ) from None
        os.environ["XDG_CACHE_HOME"] = temporary
        os.environ["POCL_CACHE_DIR"] = os.path.join(temporary, "oiiotex", "pocl")
        os.mkdir(os.path.join(temporary, "oiiotex"), 0o700)
        level = logging.INFO if isinstance(error, OSError) else logging.WARNING
        why = reason_of(error)
        _notices.append((level, f"caches of this run are temporary: {why}; set XDG_CACHE_HOME to a private folder"))


def _require_private_within(folder: Path) -> None:
    """Check the folders in a private folder; above all but links, everything is known to be private."""
    if os.name != "posix":
        return
    for entry in os.scandir(folder):  # thousands of files: only links to be followed
        if entry.is_dir():
            (require_private if entry.is_symlink() else _require_own)(Path(entry.path))


def _require_writable(folder: Path) -> None:
    """Raise OSError if compiled kernels cannot be written: permissions, a full disk, a quota, a size limit."""
    import tempfile

    with tempfile.TemporaryFile(dir=folder) as file:
        try:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, _ROOM)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(folder)) from None


def _temporary_folder() -> str:
    """A temporary folder, removed at the end of this process."""
    import atexit
    import tempfile

    from .owned import remove_folder

    folder, process = tempfile.mkdtemp(prefix="oiiotex-cache-"), os.getpid()
    made = Path(folder)
    atexit.register(lambda: remove_folder(made, made.parent) if os.getpid() == process else None)
    return folder
