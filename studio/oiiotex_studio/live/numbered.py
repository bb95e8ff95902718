# SPDX-License-Identifier: Apache-2.0
"""Folders of numbered files next to a document: masks, and steps of a painting."""

from __future__ import annotations

import os
import re
from pathlib import Path

from oiiotex.engine.errors import ImageError

MOST = 1_000_000
_TAKEN = re.compile(r"(\d{6})\..*")


def taken(folder: Path) -> dict[str, int]:
    """Numbered files of a folder, by name."""
    names = os.listdir(folder) if is_folder(folder) else []
    return {name: int(match[1]) for name in names if (match := _TAKEN.fullmatch(name))}


def next_number(folder: Path, first: int = 1) -> int:
    """A number after those of all files."""
    number = max(taken(folder).values(), default=first - 1) + 1
    if number >= MOST:
        raise ImageError(f"{folder} has {MOST} files; use another document with document=FILE")
    return number


def make_folder(folder: Path, what: str) -> None:
    """Create a folder, unless it exists."""
    if os.path.lexists(folder) and not is_folder(folder):
        raise ImageError(f"{folder} must be a folder, for {what}; rename the existing file")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise ImageError(f"{folder.absolute()}: {error.strerror}") from error


def is_folder(path: Path) -> bool:
    """Whether a path is a folder and not a symbolic link, which could lead anywhere."""
    return path.is_dir() and not path.is_symlink()
