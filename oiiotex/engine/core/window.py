# SPDX-License-Identifier: Apache-2.0
"""Windows of pixels, and planes that may wrap."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from ..deferred import np, oiio
from ..errors import ImageError

_REACH = 1 << 31  # OpenImageIO counts pixels in 32-bit integers


class Window(NamedTuple):
    """Pixels left <= x < right, top <= y < bottom, in the coordinates of the image (they may be negative)."""

    left: int
    top: int
    right: int
    bottom: int

    @classmethod
    def data(cls, spec: oiio.ImageSpec) -> Window:
        """The data window: the pixels that exist."""
        return cls(spec.x, spec.y, spec.x + spec.width, spec.y + spec.height)

    @classmethod
    def display(cls, spec: oiio.ImageSpec) -> Window:
        """The display window: the pixels that are shown."""
        return cls(spec.full_x, spec.full_y, spec.full_x + spec.full_width, spec.full_y + spec.full_height)

    @classmethod
    def sized(cls, left: int, top: int, width: int, height: int) -> Window:
        """The window of that size at that corner.

        Parameters
        ----------
        left, top : int
            px; may be negative.
        width, height : int
            px.
        """
        return cls(left, top, left + width, top + height)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height)."""
        return self.width, self.height

    @property
    def width(self) -> int:
        """Columns."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Rows."""
        return self.bottom - self.top

    @property
    def empty(self) -> bool:
        """Whether it has no pixel."""
        return self.right <= self.left or self.bottom <= self.top

    def grown(self, x: int, y: int | None = None) -> Window:
        """The window padded by x pixels on the left and right, and by y (or x) above and below."""
        y = x if y is None else y
        return Window(self.left - x, self.top - y, self.right + x, self.bottom + y)

    def shifted(self, x: int, y: int) -> Window:
        """The window moved right by x and down by y."""
        return Window(self.left + x, self.top + y, self.right + x, self.bottom + y)

    def __and__(self, other: Window) -> Window:
        """The intersection; of width or height 0 if empty."""
        left, top = max(self.left, other.left), max(self.top, other.top)
        return Window(left, top, max(left, min(self.right, other.right)), max(top, min(self.bottom, other.bottom)))

    def __or__(self, other: Window) -> Window:
        """The smallest window around both."""
        return Window(
            min(self.left, other.left),
            min(self.top, other.top),
            max(self.right, other.right),
            max(self.bottom, other.bottom),
        )

    def inside(self, other: Window) -> tuple[slice, slice]:
        """Rows and columns of this window in an array that holds `other`."""
        return (
            slice(self.top - other.top, self.bottom - other.top),
            slice(self.left - other.left, self.right - other.left),
        )

    def cells(self, width: int, height: int, origin: tuple[int, int] | None = None) -> Iterator[Window]:
        """Its pieces on a grid of that spacing through `origin` (default: its own corner), row by row."""
        x0, y0 = origin or (self.left, self.top)
        for top in range(y0 + (self.top - y0) // height * height, self.bottom, height):
            for left in range(x0 + (self.left - x0) // width * width, self.right, width):
                yield Window.sized(left, top, width, height) & self

    def roi(self, channels: int) -> oiio.ROI:
        """The window as a ROI of OpenImageIO."""
        return oiio.ROI(self.left, self.right, self.top, self.bottom, 0, 1, 0, channels)

    def in_range(self) -> Window:
        """The window itself, if OpenImageIO can count its pixels.

        Raises
        ------
        ImageError
            A coordinate or a side exceeds 32 bits.
        """
        if min(self[:2]) < -_REACH or max(*self[2:], *self.size) >= _REACH:
            raise ImageError(f"window {self}: expected coordinates from {-_REACH} to {_REACH - 1}")
        return self

    def apply_to(self, spec: oiio.ImageSpec) -> oiio.ImageSpec:
        """A copy of `spec` with this data window, untiled; raises as `in_range` does."""
        new = oiio.ImageSpec(spec)
        new.x, new.y, new.width, new.height = *self.in_range()[:2], *self.size
        new.tile_width = new.tile_height = new.tile_depth = 0
        return new

    def show_in(self, spec: oiio.ImageSpec) -> None:
        """Make it the display window of `spec`; raises as `in_range` does."""
        spec.full_x, spec.full_y, spec.full_width, spec.full_height = *self.in_range()[:2], *self.size

    def __str__(self) -> str:
        return f"{self.width}x{self.height}{self.left:+d}{self.top:+d}"


def warp_needs(matrix: np.ndarray, window: Window, width: float, data: Window) -> Window:
    """The source window that a warp reads for a window of its result.

    Parameters
    ----------
    matrix : array of shape (3, 3)
        From the result to the source, for row vectors (x, y, 1).
    window : Window
        Window of the result.
    width : float
        Width of the filter, in pixels.
    data : Window
        Data window of the source, returned as a whole if the window crosses the horizon.
    """
    xs, ys = (window.left + 0.5, window.right - 0.5), (window.top + 0.5, window.bottom - 0.5)
    corners = np.array([(x, y, 1.0) for x in xs for y in ys]) @ matrix
    w = corners[:, 2]
    if not (np.all(w > 0) or np.all(w < 0)):
        return data
    # in the derivative (a / w)' = (a' w - a w') / w^2 along x, the numerator does not depend on x, so that all
    # extremes are at corners
    at = corners[:, :2] / w[:, None]
    least = np.min(np.abs(w)) ** 2
    reach = [1.0, 1.0]
    for axis in (0, 1):
        for along in (0, 1):
            slope = np.abs(matrix[along, axis] * w - corners[:, axis] * matrix[along, 2]).max() / least
            reach[axis] = max(reach[axis], slope)
    low, high = at.min(axis=0), at.max(axis=0)
    edges = []
    for axis, (begin, end) in enumerate(((data.left, data.right), (data.top, data.bottom))):
        halo = 0.5 * width * reach[axis] * 1.001 + 3
        # clamped outside of the source, so that ints do not overflow
        edges.append(math.floor(min(max(low[axis] - halo, begin - 8), end + 7)))
        edges.append(math.ceil(max(min(high[axis] + halo, end + 8), begin - 7)))
    return Window(edges[0], edges[2], edges[1], edges[3])


@dataclass(frozen=True)
class Domain:
    """A plane of pixels that wraps along some axes.

    Attributes
    ----------
    width, height : int
        px.
    wrap_x, wrap_y : bool
        Whether it wraps along that axis.
    """

    width: int
    height: int
    wrap_x: bool = False
    wrap_y: bool = False

    @classmethod
    def tiling(cls, width: int, height: int, axes: str, **more: Any) -> Self:
        """A domain that tiles along the axes x, y, xy or none."""
        return cls(width, height, "x" in axes, "y" in axes, **more)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height)."""
        return self.width, self.height

    @property
    def wraps(self) -> tuple[bool, bool]:
        """Whether it wraps along x, and along y."""
        return self.wrap_x, self.wrap_y
