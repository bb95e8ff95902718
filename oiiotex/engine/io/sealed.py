# SPDX-License-Identifier: Apache-2.0
"""Sealed files: whatever a cache returns has the length and the SHA-256 with which it was written, or is made again.

A file of this program starts with the SHA-256 of its contents, in 64 characters. Files that other code keeps, such as
kernels that an OpenCL runtime has compiled, are listed with size and SHA-256 in a sealed file of their folder.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import mmap
import os
import re
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TypeAlias

from ..deferred import np
from ..errors import Error
from .atomic import temporary_beside
from .owned import remove_folder

_DIGEST = 64  # characters; keeps arrays aligned
_LIST = "oiiotex.seal"
_BOOT = Path("/proc/sys/kernel/random/boot_id")
_UPTIME = Path("/proc/uptime")

Arrays: TypeAlias = "tuple[np.ndarray, ...]"
Seal: TypeAlias = "tuple[int, int, str]"  # size in bytes, time of the last change of file or name in ns, SHA-256


# --- a file ---


def write_sealed(path: Path, pieces: Iterable[bytes | memoryview]) -> None:
    """Write the contents, piece by piece, with their digest before them."""
    digest = hashlib.sha256()
    with open(path, "wb") as file:
        file.write(b" " * _DIGEST)
        for piece in pieces:
            digest.update(piece)
            file.write(piece)
        file.seek(0)
        file.write(digest.hexdigest().encode())


def read_sealed(path: Path) -> mmap.mmap:
    """A read-only memory map of a sealed file, at the start of its contents.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is damaged.
    """
    if not os.path.isfile(path):  # opening a pipe would wait
        raise FileNotFoundError(path)
    with open(path, "rb") as file:
        seal = file.read(_DIGEST)  # read, not mapped: the pages of a map stay in memory
        if hashlib.file_digest(file, "sha256").hexdigest().encode() != seal:
            raise ValueError(f"{path}: damaged")
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    mapped.seek(_DIGEST)
    return mapped


def write_arrays(path: Path, arrays: Iterable[np.ndarray]) -> None:
    """Write arrays as .npy, one after the other, sealed."""

    def pieces() -> Iterable[bytes | memoryview]:
        for array in map(np.ascontiguousarray, arrays):
            header = io.BytesIO()
            np.lib.format.write_array_header_1_0(header, np.lib.format.header_data_from_array_1_0(array))
            yield from (header.getvalue(), array.data)

    write_sealed(path, pieces())


def read_arrays(path: Path) -> Arrays:
    """Read-only memory maps of the arrays in a sealed file, which never take more than the file has.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is damaged, or holds something else.
    """
    mapped, arrays = read_sealed(path), []
    while mapped.tell() < len(mapped):
        np.lib.format.read_magic(mapped)
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(mapped)
        if fortran or dtype.hasobject:
            raise ValueError(f"{path}: not written by this program")
        try:
            array = np.ndarray(shape, dtype, mapped, mapped.tell())
        except TypeError as error:  # the buffer is too small
            raise ValueError(f"{path}: {error}") from error
        mapped.seek(array.nbytes, os.SEEK_CUR)
        arrays.append(array)
    return tuple(arrays)


# --- a folder that other code writes ---


class SealedFolder:
    """The files that a library keeps in a folder of this program: damaged ones are removed before it reads them.

    A file without a seal was kept by a process that was killed, or still runs. It is complete, because libraries rename
    what they have written, unless the machine has lost power since: then it is also removed. A file is read again if
    it has changed since it was sealed, or the machine has started since. What is `misplaced` is removed:
    `file_name` matches the names that the library gives to files.
    """

    def __init__(self, folder: Path, file_name: str):
        self.folder = folder
        self._file_name = re.compile(file_name)
        self._seals: dict[str, Seal] = {}

    def remove_damaged(self) -> None:
        """Remove each file that is not as it was sealed. The library makes it again."""
        same_boot, sealed, complete_since = False, {}, _started()
        if os.path.lexists(self.folder) and not self.folder.is_dir():
            self.folder.unlink(missing_ok=True)
        try:
            document = json.loads(read_sealed(self.folder / _LIST).read())
            same_boot = document["boot"] == _boot() != ""
            sealed = {name: tuple(seal) for name, seal in document["files"].items()}
        except FileNotFoundError:
            pass
        except (OSError, ValueError):  # what has damaged the list may have damaged the files
            complete_since = time.time_ns()
        for name, size, changed in self._files():
            seal = sealed.get(name)
            if seal is None and changed >= complete_since:
                continue
            if seal is not None and same_boot and seal[:2] == (size, changed):
                self._seals[name] = seal
                continue
            path = self.folder / name
            with contextlib.suppress(OSError):  # another process has removed it
                if seal is not None and (size, digest_of(path)) == (seal[0], seal[2]):
                    self._seals[name] = (size, changed, seal[2])
                else:
                    path.unlink()

    def seal(self) -> None:
        """Seal the files that the folder has now."""
        seals = {}
        for name, size, changed in self._files():
            known = self._seals.get(name)
            with contextlib.suppress(OSError):
                digest = known[2] if known and known[:2] == (size, changed) else digest_of(self.folder / name)
                seals[name] = (size, changed, digest)
        if seals != self._seals:
            content = json.dumps({"boot": _boot(), "files": seals}).encode()
            with contextlib.suppress(OSError, Error), temporary_beside(self.folder / _LIST, cache=True) as temporary:
                write_sealed(temporary, [content])  # without it the next run seals the files
                self._seals = seals

    def misplaced(self) -> Iterable[str]:
        """Paths of files where the library has a folder, and of folders where it has a file. PoCL aborts on them."""
        return (entry.path for _, entry, as_named in self._entries() if not as_named)

    def _files(self) -> Iterable[tuple[str, int, int]]:
        """Name, size and time of change of each file. Misplaced entries, and those of other kinds, are removed.

        Each process that opens a device looks at every file, thousands in old caches: no `Path` is made for each.
        """
        for name, entry, as_named in self._entries():
            with contextlib.suppress(OSError):
                if not as_named and entry.is_dir(follow_symlinks=False):
                    remove_folder(Path(entry.path), self.folder)
                elif not as_named or not entry.is_file(follow_symlinks=False):  # a library would write through a link
                    os.unlink(entry.path)
                elif "/" in name or _LIST[:-5] not in name:
                    status = entry.stat(follow_symlinks=False)
                    yield name, status.st_size, status.st_ctime_ns

    def _entries(self) -> Iterable[tuple[str, os.DirEntry[str], bool]]:
        """Name, entry, and whether it is what its name says, of everything but folders that are."""
        root, folders = str(self.folder), [""]
        while folders:
            below = folders.pop()
            with contextlib.suppress(OSError), os.scandir(f"{root}/{below}") as entries:
                for entry in entries:
                    name, is_folder = f"{below}{entry.name}", entry.is_dir(follow_symlinks=False)
                    as_named = is_folder != bool(self._file_name.fullmatch(entry.name))
                    if is_folder and as_named:
                        folders.append(f"{name}/")
                    else:
                        yield name, entry, as_named


def digest_of(path: Path) -> str:
    """The SHA-256 of a file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _boot() -> str:
    """The machine's id of its last start; '' where there is none, so that all files are read."""
    try:
        return _BOOT.read_text().strip()
    except OSError:
        return ""


def _started() -> int:
    """When the machine was started, in ns; 0 if that is unknown."""
    try:
        return time.time_ns() - int(float(_UPTIME.read_text().split()[0]) * 1e9) - 10**9
    except (OSError, ValueError):
        return 0
