# SPDX-License-Identifier: Apache-2.0
"""Folders of numbered files next to a document: masks, and steps of a painting."""

from __future__ import annotations

import os
import re
from pathlib import Path

from oiiotex.engine.deferred import np, oiio
from oiiotex.engine.errors import ImageError

from ..api.images import Image, from_array, write

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


def write_mask(folder: Path, small: np.ndarray, spec: oiio.ImageSpec) -> int:
    """Write a painted mask, (height, width) uint8, at the size of a photo, as the next file; returns its number."""
    (height, width), number = small.shape, next_number(folder)
    rows, columns = np.arange(spec.height) * height // spec.height, np.arange(spec.width) * width // spec.width
    part = from_array(np.where(small[rows][:, columns] > 127, np.uint8(255), np.uint8(0))[..., None]).first
    path = folder / f"{number:06d}.png"
    make_folder(folder, "masks of the photo")
    write(Image((part,), str(path)), path, oiio.TypeDesc("uint8"))
    return number


def is_folder(path: Path) -> bool:
    """Whether a path is a folder and not a symbolic link, which could lead anywhere."""
    return path.is_dir() and not path.is_symlink()
