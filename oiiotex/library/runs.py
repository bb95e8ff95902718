# SPDX-License-Identifier: Apache-2.0
"""Runs beside each other on one library: locks that go with their process, and machines without the catalog."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import Error
from ..recipes.found import LIBRARY

if TYPE_CHECKING:
    from .catalog import Asset

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

FILE = LIBRARY
WORK = ".making"  # folders of runs, each with what it works on
CAN_LOCK = fcntl is not None
_BROKEN = ("SQLITE_NOTADB", "SQLITE_CORRUPT")  # files of which SQLite reads nothing


class FoldersAlone:
    """Stands for the catalog on a machine of a farm: folders are written, and a later run records them."""

    def __init__(self, library: Path):
        self.library = library

    def __enter__(self) -> FoldersAlone:
        with said(self.library):
            (self.library / WORK).mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def assets(self) -> dict[str, Asset]:
        """Nothing is known here."""
        return {}

    def asset(self, name: str) -> Asset | None:
        """Nothing is known here."""
        return None

    def sources(self) -> dict[str, tuple[int, int, str]]:
        """Nothing is known here."""
        return {}

    def remember_sources(self, rows: Iterable[tuple[str, int, int, str]]) -> None:
        """Nothing is kept here."""

    def put(self, *_: Any) -> None:
        """Nothing is kept here."""

    def put_all(self, *_: Any) -> None:
        """Nothing is kept here."""

    def run(self) -> contextlib.AbstractContextManager[str]:
        """While this lasts, a run with a folder of its own."""
        return folder_of_run(self.library)

    def sweep(self) -> None:
        """It is for who has the catalog."""

    def claim(self, asset: str, run: str) -> bool:
        """Shares do not overlap."""
        return True

    def release(self, asset: str, run: str) -> None:
        """Nobody waits."""


@contextlib.contextmanager
def folder_of_run(library: Path) -> Iterator[str]:
    """A folder that nobody else has, locked as long as its process lives."""
    name = f"run-{os.urandom(8).hex()}"
    folder = library / WORK / name
    with said(library), locked(library / WORK / "lock"):  # else it would be swept before it is locked
        folder.mkdir()
        held = open(folder / "lock", "wb")  # noqa: SIM115 - held as long as the run
        lock(held.fileno(), wait=False)
    try:
        yield name
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        held.close()


@contextlib.contextmanager
def said(library: Path) -> Iterator[None]:
    """SQLite's errors as ours."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        if getattr(error, "sqlite_errorname", "").startswith(_BROKEN):
            told = f"remove {library / FILE}* and ingest again, which records what is made"
            raise Error(f"{library / FILE}: {error}: {told}") from error
        told = ": remove it and ingest again" if "no such table" in str(error) else ""
        raise Error(f"{library / FILE}: {error}{told}") from error
    except (sqlite3.Error, OSError) as error:
        raise Error(f"{library}: {error}") from error


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """While this lasts, nobody else has that file locked."""
    with open(path, "wb") as file:
        lock(file.fileno(), wait=True)
        yield


def lock(file: int, wait: bool) -> bool:
    """Lock an open file until it is closed, or its process has ended; False where another one has it."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True
