# SPDX-License-Identifier: Apache-2.0
"""Bands, rows, random access and streaming of parts.

Images are pulled: a writer reads the windows of the last part of a chain, and each part reads those before it. This
module is independent of files and colors.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Literal, Protocol, overload

from ..deferred import np, oiio
from ..errors import ImageError, MemoryBudgetError, present
from .image import Part, Pixels, dtype_of
from .piece_cache import PieceCache
from .window import Window

if TYPE_CHECKING:
    from numpy.typing import DTypeLike

    from .scratch import TileStore

BAND_BYTES = 8 << 20  # of pixels processed at once: large enough to hide the cost of calls, small enough for caches
SPILL_SIDE = 256  # px; side of a tile in a temporary file
PIECE_PIXELS = 1 << 16  # pixels that a thread processes at once: small enough for caches
_RESIZED_BYTES = 8 << 20  # bytes of rows that are read at once to be resized
_CACHED_BYTES = 128 << 10  # bytes of rows that are resized at once: they fit the cache of a core


def rows_for(part: Part, limit: int | None = None, multiple: int = 1) -> int:
    """Number of full rows, a multiple of `multiple`, in a band of about `limit` bytes (`BAND_BYTES`), as floats."""
    row = max(1, part.spec.width * max(part.pixel_bytes, 4 * part.spec.nchannels))
    return max(1, (limit or BAND_BYTES) // row // multiple) * multiple


def bands(part: Part, limit: int | None = None) -> Iterator[Window]:
    """Bands of full rows, from top to bottom, of a few megabytes as floats."""
    return part.window.cells(part.spec.width, rows_for(part, limit))


def assembled(
    window: Window,
    cell: tuple[int, int],
    whole: Window,
    piece: Callable[[Window], np.ndarray],
) -> np.ndarray:
    """The pixels of a window, assembled from the pieces of a grid.

    Parameters
    ----------
    window : Window
        Inside `whole`.
    cell : (int, int)
        Width and height of the grid's cells, px; they are clipped to `whole`.
    whole : Window
        Its top left corner is the origin of the grid.
    piece : callable
        Cell -> its pixels, (height, width, channels), of the same type for all cells.
    """
    cells = cells_of(window, cell, whole)
    if len(cells) == 1:
        return piece(cells[0])[window.inside(cells[0])]
    out: np.ndarray | None = None
    for place in cells:
        pixels, shared = piece(place), place & window
        if out is None:
            out = np.empty((window.height, window.width, pixels.shape[2]), pixels.dtype)
        out[shared.inside(window)] = pixels[shared.inside(place)]
    assert out is not None
    return out


def cells_of(window: Window, cell: tuple[int, int], whole: Window) -> list[Window]:
    """The cells of a grid of `cell` (width, height) over `whole` that overlap a window, row by row."""
    return [_whole_cell(c, cell, whole) for c in window.cells(*cell, origin=(whole.left, whole.top))]


def _whole_cell(inside: Window, cell: tuple[int, int], whole: Window) -> Window:
    """The grid's cell around `inside`, clipped to `whole`."""
    left = whole.left + (inside.left - whole.left) // cell[0] * cell[0]
    top = whole.top + (inside.top - whole.top) // cell[1] * cell[1]
    return Window.sized(left, top, *cell) & whole


def cached(part: Part, cache: PieceCache) -> Part:
    """The same part with cached bands, for ops that read rows repeatedly (halos, copies).

    Raises
    ------
    ImageError
        A row exceeds the size of the cache.
    """
    if part.ready or part.spec.deep:  # OpenImageIO holds deep images whole
        return part
    row = part.spec.width * part.pixel_bytes
    if row > cache.limit:
        raise MemoryBudgetError(f"a row of {part.spec.width} pixels", row, cache.limit, "reduce the width")
    owner, whole = object(), part.window
    cell = (whole.width, rows_for(part, BAND_BYTES // 2))

    def fetch(window: Window) -> np.ndarray:
        return assembled(window, cell, whole, lambda place: cache.get((owner, place), lambda: part.read(place)))

    return dataclasses.replace(part, fetch=fetch, ready=True)


# --- rows of images that may exceed memory ---


class SomeRows(Protocol):
    """An array-like object that provides rows for a slice."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows first."""

    @property
    def dtype(self) -> np.dtype:
        """Type of the values."""

    def __len__(self) -> int: ...

    def __getitem__(self, at: Any) -> np.ndarray: ...


class MadeRows:
    """Rows that are computed at each access.

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
    """The first `count` channels."""
    if isinstance(rows, np.ndarray) or rows.shape[2] == count:
        return rows[..., :count] if isinstance(rows, np.ndarray) else rows
    return MadeRows((*rows.shape[:2], count), rows.dtype, lambda first, last: rows[first:last][..., :count])


def rows_of(part: Part) -> MadeRows:
    """The rows of a part, in its own type."""
    whole = part.window

    def read(first: int, last: int) -> np.ndarray:
        return part.read(Window(whole.left, whole.top + first, whole.right, whole.top + last))

    shape = part.spec.height, part.spec.width, part.spec.nchannels
    return MadeRows(shape, dtype_of(part.spec), read)


def resized(pixels: SomeRows, width: int, height: int, rows: slice | None = None) -> np.ndarray:
    """An image resized by a triangle filter scaled to the reduction, or some rows of it.

    Parameters
    ----------
    pixels : (h, w, c) float32
    width, height : int
    rows : slice, optional
        With a start and a stop.

    Returns
    -------
    (height or rows, width, c) float32
        A row does not depend on which other rows are requested.
    """
    rows = rows or slice(0, height)
    high, wide, channels = pixels.shape
    if (high, wide) == (height, width):
        return pixels[rows]
    small = np.empty((rows.stop - rows.start, width, channels), np.float32)
    (down, shares_down), (right, shares_right) = _triangle(high, height), _triangle(wide, width)
    shares_right = np.repeat(shares_right, channels, axis=1)
    step = max(1, int(_RESIZED_BYTES / (4 * channels * wide * high / height)))
    block = max(1, _CACHED_BYTES // (4 * channels * max(wide, width)))  # rows
    for begin in range(rows.start, rows.stop, step):
        end = min(begin + step, rows.stop)
        first, last = int(down[0, begin]), int(down[-1, end - 1]) + 1
        source = np.ascontiguousarray(pixels[first:last], np.float32)
        for top in range(begin, end, block):
            some = slice(top, min(top + block, end))
            tall = _weighed(source, down[:, some] - first, shares_down[:, some, None], 0)
            small[some.start - rows.start : some.stop - rows.start] = _weighed(tall, right, shares_right, 1)
    return small


def at_most(side: int, *images: SomeRows) -> tuple[np.ndarray, ...]:
    """Images of one size, (h, w, c) float32 each, reduced to a longer side of at most `side` px."""
    height, width = images[0].shape[:2]
    factor = min(1.0, side / max(width, height))
    return tuple(resized(one, max(1, round(factor * width)), max(1, round(factor * height))) for one in images)


def _triangle(size: int, target: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions that each of `target` pixels is the mean of, and their shares: (n, target) int64 and float32."""
    ratio = size / target
    reach, centers = max(1.0, ratio), (np.arange(target) + 0.5) * ratio - 0.5
    at = np.ceil(centers - reach).astype(np.int64) + np.arange(int(2 * reach) + 1)[:, None]
    shares = np.maximum(0.0, 1.0 - np.abs(at - centers) / reach)
    used = shares.any(1)
    return np.clip(at[used], 0, size - 1), (shares / shares.sum(0))[used].astype(np.float32)


def _weighed(pixels: np.ndarray, at: np.ndarray, shares: np.ndarray, axis: int) -> np.ndarray:
    """Weighted sums of rows (axis 0) or columns (1) of (h, w, c) float32, added in one order on every processor.

    `at` (n, target): positions; `shares`: their weights for flat rows, (n, target, 1) or (n, target * c).
    """
    total: np.ndarray | None = None
    for where, share in zip(at, shares, strict=True):
        part = pixels.take(where, axis, mode="clip")  # checked indices are slower
        flat = part.reshape(len(part), -1)
        flat *= share
        if total is None:
            total = part
        else:
            total += part
    return present(total)


# --- random access ---


def materialized(part: Part, budget: int) -> Part:
    """The same part with random access: in memory if it is small, otherwise in a temporary file."""
    held, whole = held_pixels(part, budget), part.window

    def stored(window: Window) -> np.ndarray:
        rows, columns = window.inside(whole)
        return held[rows, columns] if isinstance(held, np.ndarray) else held.window(rows, columns)

    return dataclasses.replace(part, fetch=stored, ready=True, levels=())


def held_pixels(part: Part, budget: int, cache: PieceCache | None = None) -> np.ndarray | TileStore:
    """All pixels of a part, in memory if they take at most a quarter of the budget, otherwise in a temporary file.

    Parameters
    ----------
    part : Part
    budget : int
        Bytes.
    cache : PieceCache, optional
        Cache of the file's tiles.

    Returns
    -------
    (height, width, channels) array or TileStore
    """
    whole, shape = part.window, (part.spec.height, part.spec.width, part.spec.nchannels)
    if part.spec.width * part.spec.height * part.pixel_bytes <= budget // 4:
        pixels = np.empty(shape, dtype_of(part.spec))
        for window in bands(part):
            pixels[window.inside(whole)] = part.read(window)
        return pixels
    from .scratch import TileStore  # few runs spill

    side = SPILL_SIDE
    store = TileStore(shape, dtype_of(part.spec), side, cache)
    at_once = side * max(1, 4 * BAND_BYTES // (side * side * part.pixel_bytes))
    for window in whole.cells(at_once, side):
        store.put(window.top - whole.top, window.left - whole.left, part.read(window))
    return store


# --- beyond the border ---


def on_a_torus(part: Part, window: Window) -> np.ndarray:
    """The pixels of a window, with the image repeated outside its data window."""
    whole = part.window
    if window & whole == window:
        return part.read(window)
    out = np.empty((window.height, window.width, part.spec.nchannels), dtype_of(part.spec))
    for rows, y in _turns(window.top, window.bottom, whole.top, whole.height):
        for columns, x in _turns(window.left, window.right, whole.left, whole.width):
            out[rows, columns] = part.read(Window.sized(x, y, columns.stop - columns.start, rows.stop - rows.start))
    return out


def _turns(begin: int, end: int, low: int, size: int) -> Iterator[tuple[slice, int]]:
    """Along one axis: (slice of the output, where it begins in the image)."""
    at = begin
    while at < end:
        place = (at - low) % size
        count = min(end - at, size - place)
        yield slice(at - begin, at - begin + count), low + place
        at += count


# --- streaming ---


@overload
def stream(part: Part, windows: Iterable[Window]) -> Iterator[tuple[Window, np.ndarray]]: ...
@overload
def stream(part: Part, windows: Iterable[Window], buffers: Literal[True]) -> Iterator[tuple[Window, oiio.ImageBuf]]: ...
def stream(part: Part, windows: Iterable[Window], buffers: bool = False) -> Iterator[tuple[Window, Pixels]]:
    """The part's windows in order; the next one is computed while the caller processes this one."""
    fetch: Callable[[Window], Pixels] = part.buffer if buffers else part.read
    with ThreadPoolExecutor(1, "oiiotex-compute") as worker:
        pending: tuple[Window, Future[Pixels]] | None = None
        try:
            for window in windows:
                following = (window, worker.submit(fetch, window))
                if pending is not None:
                    yield pending[0], pending[1].result()
                pending = following
            if pending is not None:
                yield pending[0], pending[1].result()
        finally:
            worker.shutdown(wait=True, cancel_futures=True)


def sha1(part: Part) -> str:
    """The SHA-1 of a part's pixels, each channel in its own type.

    Raises
    ------
    ImageError
        There are both integer and float channels, which cannot be read exactly together.
    """
    kinds = [_numpy_type(part.spec.channelformat(channel)) for channel in range(part.spec.nchannels)]
    own = np.dtype(dtype_of(part.spec))
    if any(kind.kind != own.kind for kind in kinds):
        raise ImageError(f"'{part.name}' has both integer and float channels: cannot compute its hash")
    packed = np.dtype([(str(channel), kind) for channel, kind in enumerate(kinds)])
    digest = hashlib.sha1(usedforsecurity=False)
    for _, pixels in stream(part, bands(part)):
        if any(kind != own for kind in kinds):
            mixed = np.empty(pixels.shape[:2], packed)
            for channel in range(len(kinds)):
                mixed[str(channel)] = pixels[..., channel]
            pixels = mixed
        digest.update(np.ascontiguousarray(pixels).data)
    return digest.hexdigest().upper()


def _numpy_type(kind: oiio.TypeDesc) -> np.dtype:
    return np.dtype(dtype_of(oiio.ImageSpec(1, 1, 1, kind)))
