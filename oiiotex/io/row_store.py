# SPDX-License-Identifier: Apache-2.0
"""Rows of an image that is worked on in bands: in memory, or in an unnamed temporary file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from ..core.demand import scratch_file, write_at
from ..deferred import np
from ..errors import present

if TYPE_CHECKING:
    from numpy.typing import DTypeLike

AT_ONCE = 8 << 20  # bytes that are read or written by a call; the system reads 2 GB at once at most


class RowStore:
    """An array that is read and written by rows, and is not held in memory where it lies in a file.

    Indices are those of an array: rows, or rows and columns, as slices. As a whole it is `np.asarray` of it.

    Parameters
    ----------
    shape : tuple of int
        Rows first.
    dtype : dtype
    in_memory : bool
    """

    def __init__(self, shape: tuple[int, ...], dtype: DTypeLike, in_memory: bool):
        self.shape, self.dtype = shape, np.dtype(dtype)
        self._row_bytes = int(np.prod(shape[1:], dtype=np.int64)) * self.dtype.itemsize
        self._array = np.empty(shape, dtype) if in_memory else None
        self._file = None if in_memory else scratch_file(self._row_bytes * shape[0])

    @classmethod
    def of(cls, array: np.ndarray) -> RowStore:
        """An array that is there."""
        store = cls((0, *array.shape[1:]), array.dtype, in_memory=True)
        store.shape, store._array = array.shape, array
        return store

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, at: Any) -> np.ndarray:
        if self._array is not None:
            return self._array[at]
        rows, columns = at if isinstance(at, tuple) else (at, slice(None))
        first, last, _ = rows.indices(self.shape[0])
        out = np.empty((max(0, last - first), *self.shape[1:]), self.dtype)
        if out.size:
            into = out.data.cast("B")
            for at in range(0, len(into), AT_ONCE):
                os.preadv(present(self._file).fileno(), [into[at : at + AT_ONCE]], first * self._row_bytes + at)
        return out[:, columns]

    def __setitem__(self, rows: slice, values: np.ndarray) -> None:
        if self._array is not None:
            self._array[rows] = values
        else:
            first = rows.indices(self.shape[0])[0]
            write_at(present(self._file), np.ascontiguousarray(values, self.dtype), first * self._row_bytes)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        out = self[:]
        return out if dtype is None else out.astype(dtype)


def empty_rows(shape: tuple[int, ...], dtype: DTypeLike, in_memory: bool) -> np.ndarray | RowStore:
    """An array to be filled, or the same in a file."""
    return np.empty(shape, dtype) if in_memory else RowStore(shape, dtype, in_memory=False)
