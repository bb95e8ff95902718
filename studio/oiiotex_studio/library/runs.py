# SPDX-License-Identifier: Apache-2.0
"""Concurrent runs on one library: working folders, and locks that end with their process."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from oiiotex.engine.errors import Error, reason_of

from ..api.files import owned, remove_folder
from ..recipes.found import LIBRARY

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

FILE = LIBRARY
WORK = ".making"  # working folders of runs
CAN_LOCK = fcntl is not None
_BROKEN = ("SQLITE_NOTADB", "SQLITE_CORRUPT")  # SQLite errors of unreadable files


def require_no_links(library: Path) -> None:
    """Raise Error for links among a library's own files and runs, through which other files would be written."""
    for pattern in ("*", f"{WORK}/*", f"{WORK}/*/*"):  # a name without wildcards would omit broken links
        for path in library.glob(pattern):
            owned(path, library)


@contextlib.contextmanager
def folder_of_run(library: Path) -> Iterator[str]:
    """A new working folder, locked until the process ends."""
    name = f"run-{os.urandom(8).hex()}"
    folder = library / WORK / name
    with (
        sqlite_errors(library),
        locked(library / WORK / "lock"),
    ):  # else another run could remove it
        folder.mkdir()
        held = open(folder / "lock", "wb")  # noqa: SIM115 - held during the run
        lock(held.fileno(), wait=False)
    try:
        yield name
    finally:
        remove_folder(folder, library / WORK)
        held.close()


@contextlib.contextmanager
def sqlite_errors(library: Path) -> Iterator[None]:
    """Convert SQLite's errors to Error."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        if getattr(error, "sqlite_errorname", "").startswith(_BROKEN):
            hint = f"remove {library / FILE}* and run ingest again, which restores the catalog"
            raise Error(f"{library / FILE}: {error}; {hint}") from error
        hint = "; remove it and run ingest again" if "no such table" in str(error) else ""
        raise Error(f"{library / FILE}: {error}{hint}") from error
    except sqlite3.Error as error:
        raise Error(f"{library}: {error}") from error
    except OSError as error:
        raise Error(reason_of(error) if error.filename else f"{library}: {error.strerror}") from error


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock of a file."""
    with open(path, "wb") as file:
        lock(file.fileno(), wait=True)
        yield


def lock(file: int, wait: bool) -> bool:
    """Lock an open file until it is closed or the process ends; False if another process holds the lock."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True
