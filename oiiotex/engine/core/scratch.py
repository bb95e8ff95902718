# SPDX-License-Identifier: Apache-2.0
"""Arrays in unnamed temporary files, stored by rows or in square tiles."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from io import BufferedRandom
from typing import TYPE_CHECKING, Any

from ..deferred import np
from ..errors import ImageError, reason_of

if TYPE_CHECKING:
    from numpy.typing import DTypeLike

    from .piece_cache import PieceCache

AT_ONCE = 8 << 20  # bytes that are read or written by a call; the system's limit is 2 GB


def empty_rows(shape: tuple[int, ...], dtype: DTypeLike, in_memory: bool) -> np.ndarray | RowStore:
    """An uninitialized array, in memory or in a file."""
    return np.empty(shape, dtype) if in_memory else RowStore(shape, dtype)


class RowStore:
    """An array in a file, read and written by rows; thread-safe.

    It is indexed like an array, by slices of rows, or of rows and columns. `np.asarray` reads all of it.

    Parameters
    ----------
    shape : tuple of int
        Rows first.
    dtype : dtype

    Raises
    ------
    ImageError
        The disk is full, now or when the array is written.
    """

    def __init__(self, shape: tuple[int, ...], dtype: DTypeLike):
        self.shape, self.dtype = shape, np.dtype(dtype)
        self._row_bytes = int(np.prod(shape[1:], dtype=np.int64)) * self.dtype.itemsize
        self._file = _scratch_file(self._row_bytes * shape[0])

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, at: Any) -> np.ndarray:
        rows, columns = at if isinstance(at, tuple) else (at, slice(None))
        first, last, _ = rows.indices(self.shape[0])
        out = np.empty((max(0, last - first), *self.shape[1:]), self.dtype)
        self._read(out, first * self._row_bytes)
        return out[:, columns]

    def __setitem__(self, rows: slice, values: np.ndarray) -> None:
        self._write(values, rows.indices(self.shape[0])[0] * self._row_bytes)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        out = self[:]
        return out if dtype is None else out.astype(dtype)

    def crossing(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """`array[np.ix_(rows, columns)]`, (rows, columns), efficient if most columns are adjacent."""
        out = np.empty((len(rows), len(columns)), self.dtype)
        for n, into, offset in self._runs(rows, columns):
            self._read(out[n, into], offset)
        return out

    def set_crossing(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
        """The inverse of `crossing`, for unique rows and columns."""
        for n, into, offset in self._runs(rows, columns):
            self._write(values[n, into], offset)

    def _runs(self, rows: np.ndarray, columns: np.ndarray) -> Iterator[tuple[int, slice, int]]:
        """Runs of adjacent columns, row by row: (index of the row, slice of columns, offset in the file)."""
        begins = np.flatnonzero(np.diff(columns, prepend=-2) != 1).tolist()
        for begin, end in zip(begins, [*begins[1:], len(columns)], strict=True):
            for n, row in enumerate(rows.tolist()):
                yield n, slice(begin, end), row * self._row_bytes + int(columns[begin]) * self.dtype.itemsize

    def _read(self, out: np.ndarray, offset: int) -> None:
        into = out.data.cast("B") if out.size else out.data[:0]
        for at in range(0, len(into), AT_ONCE):
            os.preadv(self._file.fileno(), [into[at : at + AT_ONCE]], offset + at)

    def _write(self, values: np.ndarray, offset: int) -> None:
        array = np.ascontiguousarray(values, self.dtype)
        try:
            if os.pwrite(self._file.fileno(), array.data, offset) < array.nbytes:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # a full disk silently writes a part
        except OSError as error:
            raise _no_room(error) from error


class TileStore:
    """An image in a file, in square tiles, with random access to windows and pixels; thread-safe.

    Parameters
    ----------
    shape : (height, width, ...)
    dtype : dtype
    side : int
        Side of a tile, px.
    cache : PieceCache, optional
        Cache of tiles.
    """

    def __init__(self, shape: tuple[int, ...], dtype: DTypeLike, side: int, cache: PieceCache | None = None):
        self.shape, self.dtype, self._side, self._cache = shape, np.dtype(dtype), side, cache
        self._across = -(-shape[1] // side)
        self._tiles = RowStore((-(-shape[0] // side) * self._across, side, side, *shape[2:]), dtype)

    def put(self, top: int, left: int, pixels: np.ndarray) -> None:
        """Write a row of whole tiles, which may be cropped at the border of the image."""
        number, count = self._number(top, left), -(-pixels.shape[1] // self._side)
        tiles = np.zeros((count, *self._tiles.shape[1:]), self.dtype)
        for n in range(count):
            piece = pixels[:, n * self._side : (n + 1) * self._side]
            tiles[n, : piece.shape[0], : piece.shape[1]] = piece
        self._tiles[number : number + count] = tiles

    def window(self, rows: slice, columns: slice) -> np.ndarray:
        """The pixels of any window: (rows, columns, ...)."""
        out = np.empty((rows.stop - rows.start, columns.stop - columns.start, *self.shape[2:]), self.dtype)
        for top, down, into_rows in _cells(rows, self._side):
            for left, across, into_columns in _cells(columns, self._side):
                out[into_rows, into_columns] = self._tile(self._number(top, left))[down, across]
        return out

    def __getitem__(self, at: tuple[np.ndarray, ...]) -> np.ndarray:
        y, x = np.broadcast_arrays(*at)
        shape, y, x = y.shape, y.ravel(), x.ravel()
        out = np.empty((y.size, *self.shape[2:]), self.dtype)
        number = self._number(y, x)
        order = np.argsort(number, kind="stable")
        for here in filter(len, np.split(order, np.flatnonzero(np.diff(number[order])) + 1)):
            out[here] = self._tile(int(number[here[0]]))[y[here] % self._side, x[here] % self._side]
        return out.reshape(*shape, *self.shape[2:])

    def _number(self, y: Any, x: Any) -> Any:
        return y // self._side * self._across + x // self._side

    def _tile(self, number: int) -> np.ndarray:
        def read() -> np.ndarray:
            return self._tiles[number : number + 1].squeeze(0)

        return read() if self._cache is None else self._cache.get((self, number), read)


def _cells(places: slice, side: int) -> Iterator[tuple[int, slice, slice]]:
    """Tiles along one axis: (begin of the tile, slice of the tile, slice of the output)."""
    for begin in range(places.start // side * side, places.stop, side):
        first, last = max(begin, places.start), min(begin + side, places.stop)
        yield begin, slice(first - begin, last - begin), slice(first - places.start, last - places.start)


def _scratch_file(size: int) -> BufferedRandom:
    """An unnamed temporary file of `size` bytes, which the system removes when the process ends.

    If /tmp is in memory, set TMPDIR to a folder on disk.
    """
    import tempfile  # slow to import, and rarely needed

    try:
        file = tempfile.TemporaryFile(prefix="oiiotex-")  # noqa: SIM115 - lives as long as its owner
    except OSError as error:
        raise ImageError(f"cannot create a file for intermediate results: {reason_of(error)}; set TMPDIR") from error
    try:
        if size:
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        raise _no_room(error) from error
    return file


def _no_room(error: OSError) -> ImageError:
    import tempfile

    return ImageError(f"no space for intermediate results in {tempfile.gettempdir()}: {reason_of(error)}; set TMPDIR")
