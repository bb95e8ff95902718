# SPDX-License-Identifier: Apache-2.0
"""What gives rows of an image where all of it may not be there: arrays do, files do, and what makes them anew."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from ..deferred import np
from .image import Part, dtype_of
from .window import Window

if TYPE_CHECKING:
    from numpy.typing import DTypeLike


class SomeRows(Protocol):
    """Rows for a slice, of an array with that shape and type."""

    shape: tuple[int, ...]
    dtype: np.dtype

    def __len__(self) -> int: ...

    def __getitem__(self, at: Any) -> np.ndarray: ...


class MadeRows:
    """Rows that are made whenever they are asked for.

    Parameters
    ----------
    shape : tuple of int
        Rows first.
    dtype : dtype
    make : callable
        (first, last) -> those rows, (last - first, ...).
    """

    def __init__(self, shape: tuple[int, ...], dtype: DTypeLike, make: Callable[[int, int], np.ndarray]):
        self.shape, self.dtype, self._make = shape, np.dtype(dtype), make

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: slice) -> np.ndarray:
        first, last, _ = rows.indices(self.shape[0])
        return self._make(first, last).astype(self.dtype, copy=False)


def first_channels(rows: SomeRows, count: int) -> SomeRows:
    """The same with no more channels than that."""
    if isinstance(rows, np.ndarray) or rows.shape[2] == count:
        return rows[..., :count] if isinstance(rows, np.ndarray) else rows
    return MadeRows((*rows.shape[:2], count), rows.dtype, lambda first, last: rows[first:last][..., :count])


def rows_of(part: Part) -> MadeRows:
    """Those of a part, in its own type."""
    whole = part.window

    def read(first: int, last: int) -> np.ndarray:
        return part.read(Window(whole.left, whole.top + first, whole.right, whole.top + last))

    shape = part.spec.height, part.spec.width, part.spec.nchannels
    return MadeRows(shape, dtype_of(part.spec), read)
