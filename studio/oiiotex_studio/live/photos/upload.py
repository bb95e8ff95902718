# SPDX-License-Identifier: Apache-2.0
"""A photo that a page sends in pieces. It is stored next to the documents, like every file of the page."""

from __future__ import annotations

import contextlib
import filecmp
import itertools
import os
from pathlib import Path

from oiiotex.engine.errors import Error, ImageError, ParameterError

from ...api.files import checked_name, held_beside, release

MOST = 1 << 30  # bytes of a photo; larger ones are copied into the folder by hand
SUFFIXES = ".exr", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".hdr", ".webp", ".tga", ".bmp", ".psd", ".dpx"
_MOST_OFFERED = 500


class Upload:
    """A file that is being received."""

    def __init__(self, folder: Path, name: str, size: int):
        require_photo(name)
        if not 0 < size <= MOST:
            raise ImageError(f"{name}: {size} bytes: expected 1 to {MOST}; copy larger photos into the page's folder")
        self._path, self._size, self._received = folder / name, size, 0
        self.created = False  # False: the folder has had the same photo before
        try:
            self._temporary = held_beside(self._path)
            self._file = open(self._temporary, "wb")  # noqa: SIM115 - closed by discard
        except OSError as error:
            raise ImageError(f"{folder.absolute()}: {error.strerror}") from error

    def take(self, data: bytes) -> str:
        """Add a piece. Returns the name of the file once it is complete, '' before."""
        self._received += len(data)
        if self._received > self._size or not data:
            self.discard()
            raise ImageError(f"{self._path.name}: {self._received} bytes: expected {self._size}")
        try:
            self._file.write(data)
            if self._received < self._size:
                return ""
            self._file.flush()
            return self._stored().name
        except OSError as error:
            self.discard()
            raise ImageError(f"{self._path.absolute()}: {error.strerror}") from error

    def discard(self) -> None:
        """Remove what has been received."""
        self._file.close()
        release(self._temporary)

    def _stored(self) -> Path:
        """Give the file its name, or another one if that name has other content. The same photo is not stored twice."""
        stem, suffix = self._path.stem, self._path.suffix
        for n in itertools.count(1):
            path = self._path if n == 1 else self._path.with_name(f"{stem}_{n}{suffix}")
            if path.is_file() and not path.is_symlink() and filecmp.cmp(path, self._temporary, shallow=False):
                break
            if not os.path.lexists(path):
                self._temporary.rename(path)
                self.created = True
                break
        self.discard()
        return path


def require_photo(name: str) -> None:
    """Check the name of a photo: a plain name with the extension of an image format."""
    if Path(checked_name(name, "photo")).suffix.lower() not in SUFFIXES:
        raise ParameterError(f"{name}: expected the name of an image: {' '.join(SUFFIXES)}")


def photos_in(folder: Path) -> list[str]:
    """Names of photos in a folder, the first 500, without links."""
    entries = sorted(entry for entry in folder.iterdir() if entry.is_file() and not entry.is_symlink())
    names = list[str]()
    for entry in entries:
        with contextlib.suppress(Error):
            require_photo(entry.name)
            names.append(entry.name)
    return names[:_MOST_OFFERED]
