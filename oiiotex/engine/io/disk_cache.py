# SPDX-License-Identifier: Apache-2.0
"""Disk cache of expensive arrays between runs, keyed by a hash of their inputs.

A file is sealed (`sealed`), written atomically, and read as a memory map; a damaged one is recomputed. The folder is
limited to `MOST_BYTES`, with the least recently used files evicted first. Any number of processes may read, write and
evict at the same time.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from ..core.scratch import RowStore
from ..deferred import np
from ..errors import Error
from .atomic import temporary_beside
from .sealed import Arrays, read_arrays, write_arrays

MOST_BYTES = 2 << 30  # per folder
_ROWS = 256  # rows of an array that are hashed at once
_SUFFIX = ".arrays"


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
    """The arrays of this name in a folder; made and stored if they are missing or damaged.

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
    with contextlib.suppress(OSError, ValueError):  # missing or damaged
        arrays = read_arrays(path)
        os.utime(path)
        return arrays
    arrays = make()
    if sum(array.nbytes for array in arrays) <= MOST_BYTES:
        with contextlib.suppress(OSError, Error):  # a run must not fail for lack of a cache
            folder.mkdir(parents=True, exist_ok=True)
            with temporary_beside(path, cache=True) as temporary:
                write_arrays(temporary, arrays)
            _sweep(folder, path)
    return arrays


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
