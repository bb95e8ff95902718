# SPDX-License-Identifier: Apache-2.0
"""Ops that move pixels: crops, turns, scalings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import OpenImageIO as oiio
from OpenImageIO import ImageBufAlgo

from ..images import Image, Part
from ..op import Op
from ..params import argument, image, param
from ..session import Session
from ..windows import Window
from .geometry_text import box_of, parse_box
from .kinds import Remap, checked


@dataclass(frozen=True, kw_only=True)
class Flip(Remap):
    """Turn the image upside down."""

    name: ClassVar[str] = "flip"

    source: Image = image(help="the image")

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """The data window mirrored within the display window."""
        return self.needs(Window.data(specs[0]), specs)[0].apply_to(specs[0])

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """Rows counted from the other end of the display window."""
        display = Window.display(specs[0])
        middle = display.top + display.bottom
        return [Window(window.left, middle - window.bottom, window.right, middle - window.top)]

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Flipped."""
        return ImageBufAlgo.flip(*buffers)


@dataclass(frozen=True, kw_only=True)
class Resize(Remap):
    """Resize, with a filter as wide as the scale asks for."""

    name: ClassVar[str] = "resize"

    source: Image = image(help="the image")
    size: str = argument(help="of the display window: 640x480, 50%, 200%x50%, 0x480 (keeps the proportions)")
    filter: str = param("", help="name of the filter, as --help of oiiotool lists them; by the scale when left out")

    def target(self, specs: Sequence[oiio.ImageSpec]) -> oiio.ImageSpec:
        """The display window asked for, and the data window scaled with it."""
        spec = oiio.ImageSpec(specs[0])
        box = parse_box(self.size, box_of(Window.display(spec)), scaling=True).window()
        across, down = box.width / spec.full_width, box.height / spec.full_height
        x = box.left + math.floor((spec.x - spec.full_x) * across)
        y = box.top + math.floor((spec.y - spec.full_y) * down)
        window = Window.sized(x, y, math.ceil(spec.width * across), math.ceil(spec.height * down))
        spec = window.apply_to(spec)
        spec.full_x, spec.full_y, spec.full_width, spec.full_height = box.left, box.top, box.width, box.height
        return spec

    def needs(self, window: Window, specs: Sequence[oiio.ImageSpec]) -> Sequence[Window]:
        """The window scaled back, with the filter's reach: none is wider than 12 pixels of the coarser image."""
        source, target = specs[0], self.target(specs)
        display, box = Window.display(source), Window.display(target)
        across, down = display.width / box.width, display.height / box.height
        halo_x, halo_y = math.ceil(8 * max(1, across)) + 2, math.ceil(8 * max(1, down)) + 2
        return [
            Window(
                math.floor((window.left - box.left) * across) + display.left - halo_x,
                math.floor((window.top - box.top) * down) + display.top - halo_y,
                math.ceil((window.right - box.left) * across) + display.left + halo_x,
                math.ceil((window.bottom - box.top) * down) + display.top + halo_y,
            )
        ]

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Resized."""
        spec = oiio.ImageSpec(target)
        spec.set_format(buffers[0].spec().format)
        result = oiio.ImageBuf(spec)
        ImageBufAlgo.resize(result, *buffers, self.filter)
        return checked(result)

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The part itself where the size stays."""
        if Window.display(self.target([parts[0].spec])) == Window.display(parts[0].spec):
            return parts[0]
        return super().result(parts, session)


OPS: tuple[type[Op], ...] = (Flip, Resize)
