# SPDX-License-Identifier: Apache-2.0
"""Disk cache of expensive arrays between runs, keyed by a hash of their inputs.

A file holds the SHA-256 of its contents, in 64 characters, followed by the arrays as .npy. It is written atomically
and read as a memory map; a corrupt file is recomputed. The folder is limited to `MOST_BYTES`, with the least recently
used files evicted first. Any number of processes may read, write and evict at the same time.
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

MOST_BYTES = 2 << 30  # per folder
_ROWS = 256  # rows of an array that are hashed at once
_SUFFIX = ".arrays"
_DIGEST = 64  # characters; keeps the arrays aligned

Arrays: TypeAlias = "tuple[np.ndarray, ...]"


def hash_of(*facts: object) -> str:
    """SHA-256 of arrays (bytes, shape and type) and of the `repr` of everything else."""
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
    """The arrays of this name in a folder; made and stored if they are missing or corrupt.

    Parameters
    ----------
    folder : Path or None
        None: no cache.
    name : str
        `hash_of` all inputs.
    make : callable
        Returns the arrays.
    """
    if folder is None:
        return make()
    path = folder / f"{name}{_SUFFIX}"
    with contextlib.suppress(OSError, ValueError):  # missing or corrupt
        arrays = _read(path)
        os.utime(path)
        return arrays
    arrays = make()
    if sum(array.nbytes for array in arrays) <= MOST_BYTES:
        with contextlib.suppress(OSError, Error):  # a run must not fail for lack of a cache
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
    """Read-only memory maps; ValueError if the file is corrupt."""
    with open(path, "rb") as file:
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    with memoryview(mapped) as whole:
        if hashlib.sha256(whole[_DIGEST:]).hexdigest().encode() != bytes(whole[:_DIGEST]):
            raise ValueError(f"{path}: corrupt")
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
    """Remove the least recently used files until the rest is at most `MOST_BYTES`."""
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
