# SPDX-License-Identifier: Apache-2.0
"""Ops that turn the image over or move its pixels round."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..core.access import Gather
from ..core.demand import cached, on_a_torus
from ..core.image import Image, Part
from ..core.op import Op
from ..core.parameters import argument, image
from ..core.window import Window
from ..deferred import oiio
from ..session import Session
from .geometry_text import parse_offset
from .kinds import Hosted, HostOp, Remap, worked


@dataclass(frozen=True, kw_only=True)
class Flip(Remap):
    """Turn the image upside down."""

    name: ClassVar[str] = "flip"
    mixes: ClassVar[bool] = False
    function = "flip"

    source: Image = image(help="the image")

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """The data window mirrored within the display window."""
        return self.needs(Window.data(specs[0]), specs)[0].apply_to(specs[0])

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """Rows counted from the other end of the display window."""
        middle = 2 * specs[0].full_y + specs[0].full_height
        return [Window(window.left, middle - window.bottom, window.right, middle - window.top)]

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Turned over."""
        return self.of_buffers(*buffers)


@dataclass(frozen=True, kw_only=True)
class Flop(Flip):
    """Swap left and right."""

    name: ClassVar[str] = "flop"
    function = "flop"

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """Columns counted from the other end of the display window."""
        middle = 2 * specs[0].full_x + specs[0].full_width
        return [Window(middle - window.right, window.top, middle - window.left, window.bottom)]


@dataclass(frozen=True, kw_only=True)
class Rotate180(Flip):
    """Rotate by 180 degrees."""

    name: ClassVar[str] = "rotate180"
    aliases: ClassVar[tuple[str, ...]] = ("--flipflop",)
    function = "rotate180"

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """Rows and columns counted from the other ends of the display window."""
        x, y = 2 * specs[0].full_x + specs[0].full_width, 2 * specs[0].full_y + specs[0].full_height
        return [Window(x - window.right, y - window.bottom, x - window.left, y - window.top)]


def _swapped(window: Window) -> Window:
    return Window(window.top, window.left, window.bottom, window.right)


@dataclass(frozen=True, kw_only=True)
class Transpose(Remap):
    """Swap rows and columns."""

    name: ClassVar[str] = "transpose"
    mixes: ClassVar[bool] = False
    scattered: ClassVar[bool] = True

    source: Image = image(help="the image")

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """Both windows swapped."""
        spec = _swapped(Window.data(specs[0])).apply_to(specs[0])
        _swapped(Window.display(specs[0])).show_in(spec)
        return spec

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """Rows for columns."""
        return [_swapped(window)]

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Transposed."""
        return oiio.ImageBufAlgo.transpose(buffers[0])


@dataclass(frozen=True, kw_only=True)
class Rotate90(Remap):
    """Rotate by 90 degrees clockwise."""

    name: ClassVar[str] = "rotate90"
    mixes: ClassVar[bool] = False
    scattered: ClassVar[bool] = True
    function = "rotate90"

    source: Image = image(help="the image")

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """The display window lies down at its corner, the data window in it."""
        data, display = Window.data(specs[0]), Window.display(specs[0])
        turned = self.forward(data.shifted(-display.left, -display.top), display.width, display.height)
        spec = turned.shifted(display.left, display.top).apply_to(specs[0])
        spec.full_width, spec.full_height = display.height, display.width
        return spec

    def forward(self, window: Window, width: int, height: int) -> Window:
        """Where a window of an image of that size comes to lie."""
        return Window(height - window.bottom, window.left, height - window.top, window.right)

    def back(self, window: Window, width: int, height: int) -> Window:
        """Where a window of the result comes from."""
        return Window(window.top, height - window.right, window.bottom, height - window.left)

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """Columns for rows."""
        display = Window.display(specs[0])
        back = self.back(window.shifted(-display.left, -display.top), display.width, display.height)
        return [back.shifted(display.left, display.top)]

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Rotated."""
        spec = buffers[0].spec()
        x, y = spec.full_x, spec.full_y
        # ImageBufAlgo turns around the display window's corner only where that is the origin
        return moved(self.of_buffers(moved(buffers[0], -x, -y)), x, y)


@dataclass(frozen=True, kw_only=True)
class Rotate270(Rotate90):
    """Rotate by 270 degrees clockwise."""

    name: ClassVar[str] = "rotate270"
    function = "rotate270"

    def forward(self, window: Window, width: int, height: int) -> Window:
        """Where a window of an image of that size comes to lie."""
        return Window(window.top, width - window.right, window.bottom, width - window.left)

    def back(self, window: Window, width: int, height: int) -> Window:
        """Where a window of the result comes from."""
        return Window(width - window.bottom, window.left, width - window.top, window.right)


def moved(buffer: oiio.ImageBuf, x: int, y: int) -> oiio.ImageBuf:
    """The same pixels with both windows moved; a copy where they move."""
    if x == y == 0:
        return buffer
    copy = buffer.copy()
    spec = copy.specmod()
    spec.x, spec.y, spec.full_x, spec.full_y = spec.x + x, spec.y + y, spec.full_x + x, spec.full_y + y
    return copy


@dataclass(frozen=True, kw_only=True)
class Reorient(Hosted, Gather):
    """Turn the pixels as the Orientation metadata says."""

    name: ClassVar[str] = "reorient"
    steps: ClassVar[dict[int, tuple[type[Flip | Rotate90], ...]]] = {
        2: (Flop,), 3: (Rotate180,), 4: (Flip,), 5: (Rotate90, Flop), 6: (Rotate90,), 7: (Flop, Rotate90),
        8: (Rotate270,),
    }  # fmt: skip

    source: Image = image(help="the image")

    def compute(self, session: Session) -> Image:
        """Upright; the image itself where all its parts are."""
        parts = self.source.parts
        if all(_orientation(part) == 1 for part in parts):
            return self.source
        if not session.settings.all_parts:
            parts = parts[:1]
        return Image(tuple(self._upright(part, session) for part in parts), self.source.source)

    def _upright(self, part: Part, session: Session) -> Part:
        turned = worked(part)
        for step in self.steps.get(_orientation(part), ()):
            turned = step(source=self.source).result([turned], session)
        upright = turned.respecced(lambda spec: spec.attribute("Orientation", 1))
        return dataclasses.replace(upright, stored=part.stored, exact=True) if part.exact else upright


def _orientation(part: Part) -> int:
    return part.spec.get_int_attribute("Orientation", 1)


@dataclass(frozen=True, kw_only=True)
class CircularShift(HostOp, Gather):
    """Shift the image; what leaves at one side of the data window comes in at the other."""

    name: ClassVar[str] = "cshift"
    mixes: ClassVar[bool] = False

    source: Image = image(help="the image")
    shift: str = argument(help="+X+Y, to the right and down")

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """Windows of the shifted image are pieces of the image."""
        x, y = parse_offset(self.shift)
        source = worked(cached(parts[0], session.resources.cache))
        corner = Window.sized(source.window.left, source.window.top, 1, 1)
        spec = oiio.ImageBufAlgo.circular_shift(oiio.ImageBuf(corner.apply_to(source.spec)), 0, 0).spec()
        target = source.window.apply_to(spec)
        return Part(source.name, target, lambda window: on_a_torus(source, window.shifted(-x, -y)))


OPS: tuple[type[Op], ...] = (Flip, Flop, Rotate180, Rotate90, Rotate270, Transpose, Reorient, CircularShift)
