# SPDX-License-Identifier: Apache-2.0
"""Temp-then-rename: a file appears under its name whole, or not at all."""

from __future__ import annotations

import contextlib
import os
import platform
import re
import stat
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from ..errors import ImageError

_STEM = 100  # bytes of the name that a temporary one keeps: names have a limit
_live: set[Path] = set()
_making = threading.RLock()  # who ends the process takes it and keeps it: nothing is begun any more


@contextlib.contextmanager
def temporary_beside(path: Path) -> Iterator[Path]:
    """An empty file beside `path` that becomes `path` when the block ends well, and is gone when it does not.

    It is made under a name that nobody can foresee and through no link, and bears the mode of the file that it
    replaces. Where `path` is a link, the file that it leads to is replaced, in that file's folder. What SIGKILL leaves
    bears host and pid; it is swept here by the next run that writes into the folder.

    Raises
    ------
    ImageError
        `path` is no regular file, or its folder cannot be written.
    """
    path = _followed(path)
    temporary = name_beside(path)
    mode = stat.S_IMODE(os.stat(path).st_mode) & 0o777 if path.exists() else None
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
    try:
        try:
            with _making:
                _live.add(temporary)  # before it is there: a signal may come in between
                os.close(os.open(temporary, flags, 0o666 if mode is None else mode))  # as readable as the old one
        except OSError as error:
            raise ImageError(f"{path}: {error.strerror}") from error
        yield temporary
        try:
            if mode is not None:
                temporary.chmod(mode)
            temporary.replace(path)
        except OSError as error:
            raise ImageError(f"{path}: {error.strerror}") from error
    finally:
        temporary.unlink(missing_ok=True)
        _live.discard(temporary)


@contextlib.contextmanager
def written(path: Path) -> Iterator[BinaryIO]:
    """A new file that takes the path's place, whole or not at all.

    Raises
    ------
    ImageError
        It cannot be written: the disk is full, or the folder read-only.
    """
    path = path.absolute()  # which disk it is on is what a user must know
    try:
        with temporary_beside(path) as temporary, open(temporary, "wb") as file:
            yield file
    except OSError as error:
        raise ImageError(f"{path}: {error.strerror}") from error


@contextlib.contextmanager
def tried_beside(path: Path) -> Iterator[Path]:
    """A name as `name_beside` gives it, to try what can be written: nothing is left there when the block ends.

    Raises
    ------
    ImageError
        As `name_beside`.
    """
    temporary = name_beside(path)
    _live.add(temporary)
    try:
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)
        _live.discard(temporary)


def name_beside(path: Path) -> Path:
    """A hidden name beside `path` that bears host and pid, and cannot be foreseen.

    Raises
    ------
    ImageError
        Something else than a file lies there, or the folder is not there or cannot be written.
    """
    if os.path.exists(path) and not os.path.isfile(path):
        raise ImageError(f"{path}: not a regular file")  # renaming over a device would replace it
    folder = path.parent
    if not folder.is_dir():
        raise ImageError(f"{path}: no such folder as {folder}")
    if not os.access(folder, os.W_OK):
        raise ImageError(f"{path}: the folder {folder} cannot be written")
    _sweep(folder)
    mark = f"{_host()}-{os.getpid()}-{os.urandom(8).hex()}"
    stem = path.stem.encode(errors="surrogateescape")[:_STEM].decode(errors="ignore")
    return folder / f".{stem}.oiiotex-{mark}{path.suffix}"


def _followed(path: Path) -> Path:
    """Where a link leads; `path` itself where it is none.

    Links that somebody else has laid in a folder for all, as /tmp is, are refused, as Linux refuses to open them.
    """
    if not path.is_symlink():
        return path
    folder, link = os.stat(path.parent), os.lstat(path)
    for_all = folder.st_mode & stat.S_ISVTX and folder.st_mode & stat.S_IWOTH
    if for_all and link.st_uid not in (os.geteuid(), folder.st_uid):
        raise ImageError(f"{path}: a link of somebody else in a folder for all")
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:  # a loop
        raise ImageError(f"{path}: a link that leads nowhere") from error


def discard_all() -> None:
    """Remove what this process is writing, and let it begin nothing more: for one that ends without unwinding."""
    _making.acquire(timeout=1)  # a file system that hangs does not keep the process
    for temporary in list(_live):
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _sweep(folder: Path) -> None:
    """Remove temporary files of this host's processes that are no more."""
    pattern = re.compile(rf"\..*\.oiiotex-{re.escape(_host())}-(\d+)-[0-9a-f]+(\.\w+)?")
    for entry in folder.iterdir():
        match = pattern.fullmatch(entry.name)
        if match and not _alive(int(match[1])):
            with contextlib.suppress(OSError):
                entry.unlink(missing_ok=True)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass
    return True


def _host() -> str:
    return re.sub(r"[^A-Za-z0-9]", "_", platform.node())
