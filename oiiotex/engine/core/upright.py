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
class _Turn:
    """A turn of windows within the display window, which keeps its corner."""

    corner: tuple[int, int]
    size: tuple[int, int]  # of the upright display window
    swaps: bool
    across: bool
    down: bool

    def upright(self, window: Window) -> Window:
        """A window of the stored image in the upright one."""
        x, y = self.corner
        return self._mirrored(self._swapped(window.shifted(-x, -y))).shifted(x, y)

    def stored(self, window: Window) -> Window:
        """A window of the upright image in the stored one."""
        x, y = self.corner
        return self._swapped(self._mirrored(window.shifted(-x, -y))).shifted(x, y)

    def pixels(self, stored: np.ndarray) -> np.ndarray:
        """Pixels of the stored image, (height, width, channels), upright."""
        turned = stored.swapaxes(0, 1) if self.swaps else stored
        return np.ascontiguousarray(turned[:: -1 if self.down else 1, :: -1 if self.across else 1])

    def _swapped(self, window: Window) -> Window:
        left, top, right, bottom = window
        return Window(top, left, bottom, right) if self.swaps else window

    def _mirrored(self, window: Window) -> Window:
        (left, top, right, bottom), (width, height) = window, self.size
        left, right = (width - right, width - left) if self.across else (left, right)
        top, bottom = (height - bottom, height - top) if self.down else (top, bottom)
        return Window(left, top, right, bottom)


def _upright(part: Part) -> Part:
    orientation, display = orientation_of(part.spec), Window.display(part.spec)
    if orientation == 1 or part.spec.deep:
        return part
    swaps, across, down = _TURNS[orientation]
    size = (display.height, display.width) if swaps else display.size
    turn = _Turn((display.left, display.top), size, swaps, across, down)
    source = _at_random(part) if swaps or down else part
    spec = turn.upright(part.window).apply_to(part.spec)
    turn.upright(display).show_in(spec)
    _describe(spec, swaps)
    small = part.thumbnail
    return dataclasses.replace(
        part,
        spec=spec,
        fetch=lambda window: turn.pixels(source.read(turn.stored(window))),
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
