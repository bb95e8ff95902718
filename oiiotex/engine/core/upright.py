# SPDX-License-Identifier: Apache-2.0
"""Upright images: pixels turned as their Orientation metadata says (Exif 2.32, 4.6.4 A).

Cameras store what the sensor sees, and say in Orientation how to turn it. Filters see pixels upright, so that a photo,
a mask painted on it and other maps of its material agree.
"""

from __future__ import annotations

import dataclasses
import threading
from dataclasses import dataclass

from ..deferred import np, oiio
from .demand import materialized
from .image import Image, Part
from .window import Window

_TURNS = {  # Orientation: rows and columns are swapped; then columns are mirrored, rows are mirrored
    2: (False, True, False),
    3: (False, True, True),
    4: (False, False, True),
    5: (True, False, False),
    6: (True, True, False),
    7: (True, True, True),
    8: (True, False, True),
}
_IN_MEMORY = 64 << 20  # bytes of pixels that are not read from top to bottom; larger ones go to a temporary file


def upright(image: Image) -> Image:
    """The image with all parts upright, Orientation 1; the image itself if it is upright. Pixels are read on demand."""
    parts = tuple(map(_upright, image.parts))
    same = all(part is own for part, own in zip(parts, image.parts, strict=True))
    return image if same else Image(parts, image.source)


def orientation_of(spec: oiio.ImageSpec) -> int:
    """The Exif orientation, 1 (upright) to 8; other values mean 1."""
    orientation = spec.get_int_attribute("Orientation", 1)
    return orientation if orientation in _TURNS else 1


@dataclass(frozen=True)
class Turn:
    """Rows and columns swapped, or not, then mirrored within a display window.

    Attributes
    ----------
    before, after : Window
        The display window, and the turned one.
    swaps : bool
        Rows and columns are swapped.
    mirrors : (bool, bool)
        Columns are mirrored, rows are.
    """

    before: Window
    after: Window
    swaps: bool
    mirrors: tuple[bool, bool]

    def turned(self, window: Window) -> Window:
        """Where the pixels of a window come to lie."""
        (x, y), (left, top) = self.before[:2], self.after[:2]
        return self._mirrored(self._swapped(window.shifted(-x, -y))).shifted(left, top)

    def back(self, window: Window) -> Window:
        """Where the turned pixels of a window come from."""
        (x, y), (left, top) = self.before[:2], self.after[:2]
        return self._swapped(self._mirrored(window.shifted(-left, -top))).shifted(x, y)

    def spec(self, spec: oiio.ImageSpec) -> oiio.ImageSpec:
        """A copy of a spec with both windows turned."""
        new = self.turned(Window.data(spec)).apply_to(spec)
        self.after.show_in(new)
        return new

    def pixels(self, before: np.ndarray) -> np.ndarray:
        """Pixels (height, width, channels), turned."""
        columns, rows = (-1 if mirror else 1 for mirror in self.mirrors)
        return np.ascontiguousarray((before.swapaxes(0, 1) if self.swaps else before)[::rows, ::columns])

    def _swapped(self, window: Window) -> Window:
        left, top, right, bottom = window
        return Window(top, left, bottom, right) if self.swaps else window

    def _mirrored(self, window: Window) -> Window:
        (left, top, right, bottom), (width, height) = window, self.after.size
        left, right = (width - right, width - left) if self.mirrors[0] else (left, right)
        top, bottom = (height - bottom, height - top) if self.mirrors[1] else (top, bottom)
        return Window(left, top, right, bottom)


def _upright(part: Part) -> Part:
    orientation, display = orientation_of(part.spec), Window.display(part.spec)
    if orientation == 1 or part.spec.deep:
        return part
    swaps, *mirrors = _TURNS[orientation]
    size = display.size[::-1] if swaps else display.size
    turn = Turn(display, Window.sized(display.left, display.top, *size), swaps, (mirrors[0], mirrors[1]))
    source = _at_random(part) if swaps or turn.mirrors[1] else part
    spec = turn.spec(part.spec)
    _describe(spec, swaps)
    small = part.thumbnail
    return dataclasses.replace(
        part,
        spec=spec,
        fetch=lambda window: turn.pixels(source.read(turn.back(window))),
        ready=source.ready,
        levels=(),
        thumbnail=None if small is None else lambda: _thumbnail(small(), orientation),
    )


def _describe(spec: oiio.ImageSpec, swaps: bool) -> None:
    """Set the metadata that depends on the orientation."""
    spec.attribute("Orientation", 1)
    for name in ("oiio:SHA-1", "textureformat"):
        spec.erase_attribute(name)
    if not swaps:
        return
    spec.tile_width, spec.tile_height = spec.tile_height, spec.tile_width
    across, comma, down = spec.get_string_attribute("wrapmodes").partition(",")
    if comma:
        spec.attribute("wrapmodes", f"{down},{across}")
    for one, other in (("XResolution", "YResolution"), ("thumbnail_width", "thumbnail_height")):
        values = spec.getattribute(one), spec.getattribute(other)
        if None not in values:
            spec.attribute(one, values[1])
            spec.attribute(other, values[0])
    aspect = spec.get_float_attribute("PixelAspectRatio", 1.0)
    if aspect not in (0.0, 1.0):
        spec.attribute("PixelAspectRatio", 1.0 / aspect)


def _thumbnail(small: oiio.ImageBuf, orientation: int) -> oiio.ImageBuf:
    """A thumbnail, stored as its image is, upright."""
    small.specmod().attribute("Orientation", orientation)
    return oiio.ImageBufAlgo.reorient(small)


def _at_random(part: Part) -> Part:
    """The part copied to memory or a temporary file at the first read: most files deliver rows from the top alone."""
    lock = threading.Lock()
    copies: list[Part] = []

    def fetch(window: Window) -> np.ndarray:
        with lock:
            if not copies:
                copies.append(materialized(part, 4 * _IN_MEMORY))
        return copies[0].read(window)

    return dataclasses.replace(part, fetch=fetch, ready=True)
