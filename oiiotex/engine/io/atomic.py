# SPDX-License-Identifier: Apache-2.0
"""Atomic writes: a file appears under its name complete, or not at all.

An unfinished file has a hidden name next to its target, and is locked as long as its writer lives. Leftovers of
killed writers are recognized by the missing lock, never by name alone.
"""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import re
import stat
import threading
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from ..errors import ImageError, ParameterError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_STEM = 100  # bytes of the target's name in a hidden one: file systems limit names
_OLD = 24 * 3600  # s without a change, after which a file without a usable lock is a leftover
_MARK = re.compile(r"\..*\.oiiotex-(\w+)-\d+-[0-9a-f]{16}", re.DOTALL)  # of a writer; group 1 is its host
_REST = re.compile(r"(\.kept|\.texture)?(\.[0-9a-f]{8}\.temp)?(\.[^.]*)?", re.DOTALL)  # maketx adds eight digits
_PAGES = 16  # to find out whether a disk is full
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
_MOST_BLOCK = 1 << 16  # bytes; file systems of a network name what they send at once
_NO_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EBADF)  # of file systems without fsync

OUTSIDE = "is not in the product's folder: expected $output, $report or $folder/NAME"

_live: dict[Path, int] = {}  # hidden files of this process, and the descriptors that hold their locks
_making = threading.RLock()  # held for good when the process ends, so that no further file is begun
_bounds: Path | None = None  # the folder to which a recipe's line is confined


class OutsideError(ParameterError):
    """The line of a recipe would write outside its product's folder."""


# --- writing ---


@contextlib.contextmanager
def temporary_beside(path: Path, cache: bool = False) -> Iterator[Path]:
    """An empty file next to `path` that replaces `path` if the block succeeds, and is removed if it fails.

    It has an unpredictable name, is never opened through a link, and gets the mode of the file that it replaces. If
    `path` is a link, its target is replaced, in the target's folder. Leftovers of SIGKILL are removed by the next run
    that writes into the folder. On return, the file and then its name are on the disk, unless $OIIOTEX_FSYNC is 0.

    Parameters
    ----------
    path : Path
    cache : bool
        The file belongs to a cache: a recipe's line may write it as well, and it is not synced.

    Raises
    ------
    ImageError
        `path` is not a regular file, its folder is not writable, or the disk is full.
    OutsideError
        `path` is outside of the folder of `writing_only_below`.
    """
    path = _followed(path)
    mode = stat.S_IMODE(os.stat(path).st_mode) & 0o777 if path.exists() else None
    durable = not cache and os.environ.get("OIIOTEX_FSYNC") != "0"
    temporary = _claimed(path, 0o666 if mode is None else mode, cache)
    try:
        try:
            yield temporary
        except ImageError as error:  # OpenImageIO's writers do not say why
            if reason := _fullness(temporary):
                raise ImageError(f"{error} ({reason})") from error
            raise
        except OSError as error:  # a write has no file name
            if error.errno not in _FULL:
                raise
            raise ImageError(f"{path}: {error.strerror}") from error
        try:
            if durable:
                _sync(temporary)
            if mode is not None:
                temporary.chmod(mode)
            temporary.replace(path)
        except OSError as error:
            raise ImageError(f"{path}: {error.strerror}") from error
        if durable:
            with contextlib.suppress(OSError):  # the file is whole; not every file system can sync a folder
                _sync(path.parent)
    finally:
        release(temporary)


@contextlib.contextmanager
def written(path: Path) -> Iterator[BinaryIO]:
    """A new file that replaces `path` atomically.

    Raises
    ------
    ImageError
        It cannot be written: the disk is full, or the folder read-only.
    """
    path = path.absolute()  # errors must tell the user which disk is full
    try:
        with temporary_beside(path) as temporary, open(temporary, "wb") as file:
            yield file
    except OSError as error:
        raise ImageError(f"{path}: {error.strerror}") from error


def held_beside(path: Path) -> Path:
    """An empty hidden file next to `path`, until `release` is called; `part_of` names further ones."""
    return _claimed(path, 0o600)


def part_of(temporary: Path, what: str) -> Path:
    """The name of a further hidden file, 'kept' or 'texture', that is removed when `temporary` is released."""
    mark = _mark_of(temporary)
    return temporary.with_name(f"{mark}.{what}{temporary.name[len(mark) :]}")


def take(temporary: Path, made: Path) -> None:
    """Replace `temporary` by a file that another writer made; it is locked before it gets the name.

    Raises
    ------
    OSError
        It does not exist.
    """
    if fcntl is None:
        made.replace(temporary)
        return
    with _making:
        file = os.open(made, os.O_RDWR)
        _lock(file, shared=False)
        made.replace(temporary)
        os.close(_live[temporary])
        _live[temporary] = file


def release(temporary: Path) -> None:
    """Remove a hidden file and all others with its mark."""
    temporary.unlink(missing_ok=True)
    if (file := _live.pop(temporary, -1)) >= 0:
        os.close(file)
    for what in ("kept", "texture"):
        part_of(temporary, what).unlink(missing_ok=True)


def is_writing() -> bool:
    """Whether this process has unfinished files."""
    return bool(_live)


def discard_all() -> None:
    """Remove unfinished files and prevent new ones: for a process that ends without unwinding."""
    _making.acquire(timeout=1)  # a hanging file system must not block the end of the process
    _discard(list(_live))


def discard_files_of(process: int) -> set[Path]:
    """Remove unfinished files of another process, as far as the system lists them (/proc); returns their folders."""
    opened: list[Path] = []
    with contextlib.suppress(OSError):
        for link in os.scandir(f"/proc/{process}/fd"):
            with contextlib.suppress(OSError):
                opened.append(Path(os.readlink(link.path)))
    temporaries = [path for path in opened if _MARK.match(path.name)]
    _discard(temporaries)
    return {path.parent for path in temporaries}


def _discard(temporaries: Iterable[Path]) -> None:
    for temporary in temporaries:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
            for name in _groups(temporary.parent)[_mark_of(temporary)]:  # maketx adds files
                (temporary.parent / name).unlink(missing_ok=True)


def sweep(folder: Path, now: float) -> None:
    """Remove hidden files whose writers have died; `now` is the time on the clock of the folder's machine."""
    for names in _groups(folder).values():
        paths = [folder / name for name in names]
        if any(_is_written(path, now) for path in paths):
            continue
        for path in paths:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


# --- confinement ---


@contextlib.contextmanager
def writing_only_below(folder: Path) -> Iterator[None]:
    """Confine all writes of this process to a folder, except caches.

    This applies to the line of a recipe: other paths, from expressions, variables or links, are refused on opening.
    """
    global _bounds
    before, _bounds = _bounds, Path(os.path.realpath(folder))
    try:
        yield
    finally:
        _bounds = before


def require_place(path: Path, cache: bool = False) -> None:
    """Refuse a path that cannot, or must not, be written.

    Raises
    ------
    ImageError
        The path exists but is not a file, or its folder does not exist or is not writable.
    OutsideError
        The path is outside of the folder of `writing_only_below`.
    """
    _require_inside(path, cache)
    if os.path.exists(path) and not os.path.isfile(path):
        raise ImageError(f"{path}: not a regular file")  # renaming over a device would replace it
    folder = path.parent
    if not folder.is_dir():
        raise ImageError(f"{path}: no such folder: {folder}")
    if not os.access(folder, os.W_OK):
        raise ImageError(f"{path}: the folder {folder} cannot be written")


def make_folders(folder: Path) -> None:
    """Make a folder and its parents, unless they exist.

    Raises
    ------
    OSError
        The folder cannot be made.
    OutsideError
        The folder is outside of the folder of `writing_only_below`.
    """
    _require_inside(folder)
    folder.mkdir(parents=True, exist_ok=True)


def _require_inside(path: Path, cache: bool = False) -> None:
    if _bounds is None or cache or Path(os.path.realpath(path)).is_relative_to(_bounds):
        return
    raise OutsideError(f"{path}: {OUTSIDE}")


def _followed(path: Path) -> Path:
    """The target of a link; `path` itself if it is not a link.

    Links of other users in a shared folder such as /tmp are refused, as Linux refuses to open them.
    """
    if not path.is_symlink():
        return path
    folder, link = os.stat(path.parent), os.lstat(path)
    for_all = folder.st_mode & stat.S_ISVTX and folder.st_mode & stat.S_IWOTH
    if for_all and link.st_uid not in (os.geteuid(), folder.st_uid):
        raise ImageError(f"{path}: a link of another user in a shared folder")
    target = Path(os.path.realpath(path))
    if target.is_symlink():  # a loop; Path.resolve raises for it only before Python 3.13
        raise ImageError(f"{path}: a broken link")
    return target


# --- hidden files ---


def _claimed(path: Path, mode: int, cache: bool = False) -> Path:
    """A new, locked hidden file next to `path`; leftovers in the folder are removed."""
    require_place(path, cache)
    stem = path.stem.encode(errors="surrogateescape")[:_STEM].decode(errors="ignore")
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
    while True:
        mark = f"{_host()}-{os.getpid()}-{os.urandom(8).hex()}"
        temporary = path.with_name(f".{stem}.oiiotex-{mark}{path.suffix}")
        try:
            with _making:
                _live[temporary] = -1  # before the file exists: a signal may come in between
                file = _live[temporary] = os.open(temporary, flags, mode | stat.S_IRUSR | stat.S_IWUSR)
        except OSError as error:
            del _live[temporary]
            raise ImageError(f"{path}: {error.strerror}") from error
        if _lock(file, shared=False) is not False and temporary.exists():
            break
        release(temporary)  # another process removed it before it was locked
    sweep(path.parent, os.fstat(file).st_mtime)
    if fcntl is None:  # Windows cannot rename an open file
        os.close(file)
        _live[temporary] = -1
    return temporary


def _mark_of(temporary: Path) -> str:
    match = _MARK.match(temporary.name)
    assert match is not None, temporary
    return match[0]


def _groups(folder: Path) -> defaultdict[str, list[str]]:
    """Hidden files of a folder, by mark."""
    groups = defaultdict(list)
    for name in os.listdir(folder):
        match = _MARK.match(name)
        if match and _REST.fullmatch(name, match.end()):
            groups[match[0]].append(name)
    return groups


def _is_written(path: Path, now: float) -> bool:
    """Whether the writer of a hidden file may be alive: it holds the lock, or locks are unknown and the file is new.

    Locks of other hosts may be invisible here: on NFS they are optional.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
    try:
        file = os.open(path, flags)
    except FileNotFoundError:
        return False
    except OSError:  # another user's, or not a file
        return True
    try:
        locked = _lock(file, shared=True)
        match = _MARK.match(path.name)
        if locked and match and match[1] == _host():
            return False
        return locked is False or now - os.fstat(file).st_mtime < _OLD
    finally:
        os.close(file)


def _lock(file: int, shared: bool) -> bool | None:
    """Lock an open file until it is closed; False if another process holds it, None without support for locks.

    NFS allows an exclusive lock only on a file open for writing: a query takes a shared lock.
    """
    if fcntl is None:
        return None
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # ENOLCK, ENOSYS, EOPNOTSUPP
        return None
    return True


def _fullness(temporary: Path) -> str:
    """Why a hidden file that is given up cannot grow: the system's text for a full disk or a quota; '' if it can."""
    try:
        with open(temporary, "ab", buffering=0) as file:
            for _ in range(_PAGES):  # the rest of a page that is half full may be written
                file.write(b"\0" * 4096)
    except OSError as error:
        return os.strerror(error.errno) if error.errno in _FULL else ""
    return ""


def _sync(path: Path) -> None:
    """Wait until a file's bytes, or a folder's names, are on the disk."""
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise
    finally:
        os.close(file)


def _host() -> str:
    return re.sub(r"[^A-Za-z0-9]", "_", platform.node())


def require_room(temporary: Path) -> None:
    """Raise OSError if one more block does not fit: a file is incomplete only where the disk was full."""
    with open(temporary, "r+b", buffering=0) as file:
        status = os.fstat(file.fileno())
        size, block = status.st_size, min(getattr(status, "st_blksize", 4096), _MOST_BLOCK)
        file.seek((size // block + 1) * block)  # the last block of the file may have room
        try:
            file.write(b"\0")
        except OSError as error:
            if error.errno in _FULL:
                raise
        file.truncate(size)
