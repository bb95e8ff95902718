# SPDX-License-Identifier: Apache-2.0
"""Arrays that are dear to compute, kept on disk from one run to the next by the hash of what they follow from.

A file is the SHA-256 of all that comes after it, in 64 characters, and the arrays as .npy. It is read as a memory map,
appears whole or not at all, and a spoiled one is computed again. The folder is held to `MOST_BYTES`: files that were
not asked for for the longest time go first. Any number of processes may read, write and sweep at a time.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import mmap
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from ..core.scratch import RowStore
from ..deferred import np
from ..errors import Error
from .atomic import temporary_beside

MOST_BYTES = 2 << 30  # of a folder
_ROWS = 256  # of an array, that are hashed at once
_SUFFIX = ".arrays"
_DIGEST = 64  # characters; and what follows stays aligned

Arrays: TypeAlias = "tuple[np.ndarray, ...]"


def hash_of(*facts: object) -> str:
    """SHA-256 of arrays by their bytes, shape and type, and of all else by what it prints as."""
    digest = hashlib.sha256()
    for fact in facts:
        if isinstance(fact, (np.ndarray, RowStore)):
            digest.update(f"{fact.dtype.str} {fact.shape}".encode())
            for first in range(0, len(fact), _ROWS) if fact.shape else ():
                digest.update(np.ascontiguousarray(fact[first : first + _ROWS]).data)
        else:
            digest.update(repr(fact).encode())
    return digest.hexdigest()


def cached_arrays(folder: Path | None, name: str, make: Callable[[], Arrays]) -> Arrays:
    """The arrays of that name out of a folder; made and put there where they are missing or spoiled.

    Parameters
    ----------
    folder : Path or None
        None: they are made.
    name : str
        `hash_of` all that they follow from.
    make : callable
        Gives the arrays.
    """
    if folder is None:
        return make()
    path = folder / f"{name}{_SUFFIX}"
    with contextlib.suppress(OSError, ValueError):  # absent, or spoiled
        arrays = _read(path)
        os.utime(path)
        return arrays
    arrays = make()
    if sum(array.nbytes for array in arrays) <= MOST_BYTES:
        with contextlib.suppress(OSError, Error):  # a run does not fail for want of a cache
            folder.mkdir(parents=True, exist_ok=True)
            with temporary_beside(path, cache=True) as temporary:
                _write(temporary, arrays)
            _sweep(folder, path)
    return arrays


def _write(path: Path, arrays: Arrays) -> None:
    digest = hashlib.sha256()
    with open(path, "wb") as file:
        file.write(b" " * _DIGEST)
        for array in map(np.ascontiguousarray, arrays):
            header = io.BytesIO()
            np.lib.format.write_array_header_1_0(header, np.lib.format.header_data_from_array_1_0(array))
            for piece in (header.getvalue(), array.data):
                digest.update(piece)
                file.write(piece)
        file.seek(0)
        file.write(digest.hexdigest().encode())


def _read(path: Path) -> Arrays:
    """Read-only memory maps; ValueError where the file is not what was written."""
    with open(path, "rb") as file:
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    with memoryview(mapped) as whole:
        if hashlib.sha256(whole[_DIGEST:]).hexdigest().encode() != bytes(whole[:_DIGEST]):
            raise ValueError(f"{path}: spoiled")
    arrays = []
    mapped.seek(_DIGEST)
    while mapped.tell() < len(mapped):
        np.lib.format.read_magic(mapped)
        shape, _, dtype = np.lib.format.read_array_header_1_0(mapped)
        array = np.ndarray(shape, dtype, mapped, mapped.tell())
        mapped.seek(array.nbytes, os.SEEK_CUR)
        arrays.append(array)
    return tuple(arrays)


def _sweep(folder: Path, spared: Path) -> None:
    """Remove the files that were not asked for for the longest time, until the rest is at most `MOST_BYTES`."""
    files = []
    for path in folder.iterdir():
        with contextlib.suppress(OSError):  # another process was faster
            if path.name[0] != "." and path != spared:
                files.append((path.stat().st_mtime, path.stat().st_size, path))
    left = MOST_BYTES - spared.stat().st_size
    for _, size, path in sorted(files, reverse=True):
        left -= size
        if left < 0:
            with contextlib.suppress(OSError):
                path.unlink()
