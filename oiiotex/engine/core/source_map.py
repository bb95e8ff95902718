# SPDX-License-Identifier: Apache-2.0
"""Source pixels of a result: their encoding, and the copies and coordinates made from them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from ..deferred import np, oiio
from ..errors import ImageError
from .demand import SomeRows, held_pixels, rows_of
from .image import ArrayFetch, Part, derived_spec, spec_beside
from .op import Kind, Output
from .scratch import TileStore
from .tiling import tiled_spec
from .window import Window

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ..session.resources import Resources

COPIED = "Pixels copied from the photo, all channels together, in its color space and type."
ST = Output("st", Kind.COORDINATES, "Source coordinates of every pixel, for `warp` and `st_warp`.", asked_by="st")
STMAP = "Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that file."
BITS = 16  # for x and for y of a single exemplar, as in kernels (cl/offsets.h)
NONE = 0xFFFFFFFF  # no pixel
_ROWS_AT_ONCE = 16 << 20  # bytes of an exemplar that are read at once, if it is read by rows
_AT_ONCE = 1 << 18  # pixels that a thread copies at once


@dataclass(frozen=True, eq=False)
class SourceMap:
    """The source pixel of each pixel of a result, or of the first pixel of each patch.

    Attributes
    ----------
    packed : array of uint32, of any shape; uint64 if `bits` is more than 16; or an argument of `of_rows`
        number << 2 * bits | y << bits | x: number of the exemplar (if there are several), row and column.
    bits : int
    """

    packed: np.ndarray
    bits: int = BITS

    @classmethod
    def of(cls, y: ArrayLike, x: ArrayLike, bits: int = BITS) -> SourceMap:
        """From rows and columns, with broadcasting."""
        kind: type[np.unsignedinteger] = np.uint32 if bits <= BITS else np.uint64
        return cls(np.asarray(y, kind) << kind(bits) | np.asarray(x, kind), bits)

    @classmethod
    def of_rows(cls, packed: SomeRows) -> SourceMap:
        """From rows that may be in a file, such as a `scratch.RowStore`; `packed` is then only a `SomeRows`."""
        return cls(cast("np.ndarray", packed))

    @classmethod
    def of_coordinates(cls, st: np.ndarray, spec: oiio.ImageSpec, name: str) -> SourceMap:
        """The inverse of `coordinates`; raises ImageError with the map's name if some are NaN, Inf or outside."""
        place = st[..., :2].astype(np.float64) * (spec.full_width, spec.full_height)
        broken = np.count_nonzero(~np.isfinite(place))
        if broken:
            raise ImageError(f"{name} has {broken} NaN or Inf coordinates")
        x = np.floor(place[..., 0]).astype(np.int64) + spec.full_x - spec.x
        y = np.floor(place[..., 1]).astype(np.int64) + spec.full_y - spec.y
        outside = np.count_nonzero((x < 0) | (x >= spec.width) | (y < 0) | (y >= spec.height))
        if outside:
            whole = f"the {spec.width}x{spec.height} pixels of the image"
            raise ImageError(f"{name} has {outside} coordinates outside {whole}")
        return cls.of(y, x, BITS if max(spec.width, spec.height) <= 1 << BITS else 2 * BITS)

    def __getitem__(self, at: Any) -> SourceMap:
        return SourceMap(self.packed[at], self.bits)

    @property
    def yx(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns, int64."""
        packed, mask = np.asarray(self.packed).astype(np.int64), (1 << self.bits) - 1
        return packed >> self.bits & mask, packed & mask

    @property
    def number(self) -> np.ndarray:
        """The number of the exemplar, int64; 0 for a single one."""
        return np.asarray(self.packed).astype(np.int64) >> 2 * self.bits

    def flat(self, width: int) -> np.ndarray:
        """Flat indices for rows of that width, int64."""
        y, x = self.yx
        y *= width
        y += x
        return y

    def gather(self, pixels: SomeRows | TileStore) -> np.ndarray:
        """The values of an exemplar, (h, w) or (h, w, channels), at these pixels."""
        if isinstance(pixels, np.ndarray):
            return np.take(pixels.reshape(-1, *pixels.shape[2:]), self.flat(pixels.shape[1]), 0)
        if isinstance(pixels, TileStore):
            return pixels[self.yx]
        y, x = (each.ravel() for each in self.yx)
        out = np.empty((y.size, *pixels.shape[2:]), pixels.dtype)
        step = max(1, _ROWS_AT_ONCE // max(1, math.prod(pixels.shape[1:]) * out.itemsize))
        order = np.argsort(y // step, kind="stable")
        bounds = np.searchsorted(y[order] // step, np.arange(-(-pixels.shape[0] // step) + 1))
        for n in np.flatnonzero(np.diff(bounds)).tolist():
            here = order[bounds[n] : bounds[n + 1]]
            out[here] = pixels[n * step : (n + 1) * step][y[here] - n * step, x[here]]
        return out.reshape(*self.packed.shape, *pixels.shape[2:])

    def coordinates(self, spec: oiio.ImageSpec, corner: tuple[int, int] = (0, 0), factor: float = 1.0) -> np.ndarray:
        """(s, t) in the display window of an image with that spec: (..., 2) float32.

        (0, 0) is the top left corner of the display window and (1, 1) its bottom right, as in --st_warp, with pixel
        centers at half pixels. The exemplar may be a crop at `corner` (x, y) of the image enlarged by `factor`.
        """
        y, x = self.yx
        s = ((x + corner[0] + 0.5) / factor + spec.x - spec.full_x) / spec.full_width
        t = ((y + corner[1] + 0.5) / factor + spec.y - spec.full_y) / spec.full_height
        return np.stack([s, t], axis=-1).astype(np.float32)

    def parts(self, name: str, exemplar: Part, tiling: str = "none", by_rows: bool = False) -> dict[str, Part]:
        """As `Sources.parts`, for a complete result.

        Parameters
        ----------
        name : str
            Name of the op's image.
        exemplar : Part
        tiling : str
            Axes along which the result wraps: x, y, xy or none.
        by_rows : bool
            Whether the exemplar is read by rows for every window of the result, instead of held in memory.
        """
        spec = tile_spec(exemplar.spec, tiling, self.packed.shape[::-1])
        whole = Window.data(spec)
        sources = Sources(lambda window: self[window.inside(whole)], spec, ready=True, by_rows=by_rows)
        return sources.parts(name, exemplar)


@dataclass(frozen=True)
class Sources:
    """A source map that is read by windows, of a result with that spec.

    Attributes
    ----------
    resources : Resources, optional
        Threads to copy with, and the budget for exemplars: what exceeds a quarter of it is in a file. Without them, the
        op has checked that its exemplars fit in memory.
    """

    read: Callable[[Window], SourceMap]
    spec: oiio.ImageSpec
    resources: Resources | None = None
    ready: bool = False  # whether reading is cheap
    by_rows: bool = False  # whether exemplars are read by rows

    def parts(self, name: str, exemplar: Part) -> dict[str, Part]:
        """The op's image of that name, copied from its exemplar, and the part 'st'."""

        def coordinates(window: Window) -> np.ndarray:
            return self.read(window).coordinates(exemplar.spec)

        st = Part("st", spec_beside(self.spec, ("R", "G")), coordinates, ready=self.ready)
        return {name: self.copied(exemplar, self.spec), "st": st}

    def copied(self, part: Part, spec: oiio.ImageSpec) -> Part:
        """A part with that spec, copied from the pixels of a part, which are read now unless they are read by rows."""
        pixels = rows_of(part) if self.by_rows else self._held(part)
        fetch = Copied(self, lambda: pixels, (part.spec.width, part.spec.height))
        return Part(part.name, spec, fetch, part.stored, ready=self.ready and not self.by_rows, exact=part.exact)

    def _held(self, part: Part) -> np.ndarray | TileStore:
        """The pixels of a part for random access."""
        if self.resources is None:
            return np.ascontiguousarray(part.pixels())
        return held_pixels(part, self.resources.budget, self.resources.cache)


@dataclass(frozen=True, eq=False)
class Copied(ArrayFetch):
    """The `fetch` of a part whose pixels are copies; a part that is changed has another one.

    Attributes
    ----------
    sources : Sources
    pixels : callable
        Returns the exemplar, (height, width, channels).
    size : (int, int)
        Width and height of the exemplar.
    """

    sources: Sources
    pixels: Callable[[], SomeRows | TileStore]
    size: tuple[int, int]

    def __call__(self, window: Window) -> np.ndarray:
        """The pixels of a window."""
        where, pixels = self.sources.read(window), self.pixels()
        if not isinstance(pixels, np.ndarray | TileStore):
            return where.gather(pixels)
        spread = map if self.sources.resources is None else self.sources.resources.spread
        rows = max(1, _AT_ONCE // max(1, window.width))
        pieces = [where[y : y + rows] for y in range(0, window.height, rows)]
        return np.concatenate(list(spread(lambda piece: piece.gather(pixels), pieces)))


def require_addressable(shape: tuple[int, ...]) -> None:
    """Raise ImageError if an exemplar, (height, width, ...), is too large for 32-bit source pixels."""
    if max(shape[:2]) > 1 << BITS:
        raise ImageError(f"the exemplar is {shape[1]}x{shape[0]} px: expected sides of at most {1 << BITS} px")


def tile_spec(spec: oiio.ImageSpec, tiling: str, size: tuple[int, int] | None = None) -> oiio.ImageSpec:
    """The spec of a result that wraps along some axes; without `size`, in the windows of its exemplar."""
    return tiled_spec(derived_spec(spec, *(size or ())), tiling)
