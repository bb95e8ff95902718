# SPDX-License-Identifier: Apache-2.0
"""A photo, or what was joined of it, as a strip that is to be joined along its first axis."""

from __future__ import annotations

from dataclasses import dataclass

from ...engine.color.lab_grid import COARSE_STEPS, to_grid
from ...engine.core.demand import MadeRows, SomeRows, resized
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np

_TURNS = 4  # of the rounding, across the width of a strip that is bent


@dataclass(frozen=True)
class PhotoStrip:
    """Source pixels in rows; joints run across them.

    Attributes
    ----------
    source : SourceMap
        (length, width).
    closed : bool
        The last column continues in the first one.
    values : (h, w, channels) float32
        Of the photo.
    usable : (h, w) bool or None
        Valid source pixels of the photo. None: all.
    """

    source: SourceMap
    closed: bool
    values: SomeRows
    usable: np.ndarray | None = None

    @property
    def length(self) -> int:
        """Number of rows, px."""
        return self.source.packed.shape[0]

    @property
    def width(self) -> int:
        """Number of columns, px."""
        return self.source.packed.shape[1]

    def colors(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Grid colors at pixels of the strip, (..., channels) int32."""
        return self.photo_colors(*self.source[rows, columns].yx)

    def photo_colors(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Grid colors at pixels of the photo, (..., channels) int32."""
        return to_grid(SourceMap.of(y, x).gather(self.values), COARSE_STEPS).astype(np.int32)

    def reduced(self, length: int, width: int) -> tuple[np.ndarray, np.ndarray]:
        """Grid colors at a smaller size, (length, width, channels) int32, and the share of valid pixels in each."""
        colors = to_grid(resized(self._rows_of(self.values), width, length), COARSE_STEPS).astype(np.int32)
        if self.usable is None:
            return colors, np.ones((length, width), np.float32)
        return colors, resized(self._rows_of(self.usable[..., None]), width, length)[..., 0]

    def _rows_of(self, pixels: SomeRows) -> SomeRows:
        shape = *self.source.packed.shape, pixels.shape[2]
        return MadeRows(shape, np.float32, lambda first, last: self.source[first:last].gather(pixels))

    def part(self, rows: slice) -> PhotoStrip:
        """Some of its rows."""
        return PhotoStrip(self.source[rows], self.closed, self.values, self.usable)

    def leveled(self, rise: int, length: int) -> PhotoStrip:
        """The strip with its columns shifted so that what rises by `rise` px over `length` rows is level.

        The rows of a closed strip are rolled. Others lose the columns that would come from outside.
        """
        if rise == 0:
            return self
        return self._shifted((2 * np.arange(self.length)[:, None] * rise + length) // (2 * length))

    def bent(self, distances: np.ndarray, length: int) -> PhotoStrip:
        """The strip with each of its columns moved by its distance, (width,) int px, over `length` rows.

        It is moved by half of it at most, in both directions. For its borders, see `leveled`. Columns are rounded in
        turn, so that they do not step in the same row.
        """
        rows = np.arange(self.length)[:, None] - length // 2
        turn = np.abs(2 * _TURNS * np.arange(self.width) % (2 * self.width) - self.width)
        return self._shifted((2 * rows * distances + (2 * length - 1) * turn // self.width) // (2 * length))

    def _shifted(self, shift: np.ndarray) -> PhotoStrip:
        """The strip with each pixel taken from `shift` columns to the right, (length, width or 1) int."""
        columns = shift + np.arange(self.width)
        if not self.closed:
            inside = np.flatnonzero((columns.min(0) >= 0) & (columns.max(0) < self.width))
            columns = columns[:, inside[0] : inside[-1] + 1]
        source = self.source[np.arange(self.length)[:, None], columns % self.width]
        return PhotoStrip(source, self.closed, self.values, self.usable)

    def turned(self, closed: bool) -> PhotoStrip:
        """The strip with rows and columns exchanged."""
        return PhotoStrip(SourceMap(np.ascontiguousarray(self.source.packed.T)), closed, self.values, self.usable)
