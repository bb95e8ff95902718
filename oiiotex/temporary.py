# SPDX-License-Identifier: Apache-2.0
"""Temp-then-rename: a file appears under its name whole, or not at all."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import socket
from collections.abc import Iterator
from pathlib import Path

from .errors import ImageError

_number = itertools.count()
_STEM = 100  # bytes of the name that a temporary one keeps: names have a limit
_live: set[Path] = set()


@contextlib.contextmanager
def temporary_beside(path: Path) -> Iterator[Path]:
    """A name beside `path` that becomes `path` when the block ends well, and is gone when it does not.

    What SIGKILL leaves bears host and pid; it is swept here by the next run that writes into the folder.
    """
    if os.path.exists(path) and not os.path.isfile(path):
        raise ImageError(f"{path}: not a regular file")  # renaming over a device would replace it
    temporary = name_beside(path)
    _live.add(temporary)
    try:
        yield temporary
        try:
            temporary.replace(path)
        except OSError as error:
            raise ImageError(f"{path}: {error.strerror}") from error
    finally:
        temporary.unlink(missing_ok=True)
        _live.discard(temporary)


def name_beside(path: Path) -> Path:
    """A hidden name beside `path` that bears host and pid.

    Raises
    ------
    ImageError
        The folder is not there or cannot be written.
    """
    folder = path.parent
    if not folder.is_dir():
        raise ImageError(f"{path}: no such folder as {folder}")
    if not os.access(folder, os.W_OK):
        raise ImageError(f"{path}: the folder {folder} cannot be written")
    _sweep(folder)
    mark = f"{_host()}-{os.getpid()}-{next(_number)}"
    stem = path.stem.encode(errors="surrogateescape")[:_STEM].decode(errors="ignore")
    return folder / f".{stem}.oiiotex-{mark}{path.suffix}"


def discard_all() -> None:
    """Remove what this process is writing: for one that ends without unwinding."""
    for temporary in list(_live):
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _sweep(folder: Path) -> None:
    """Remove temporary files of this host's processes that are no more."""
    pattern = re.compile(rf"\..*\.oiiotex-{re.escape(_host())}-(\d+)-\d+(\.\w+)?")
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
    return re.sub(r"[^A-Za-z0-9]", "_", socket.gethostname())
