# SPDX-License-Identifier: Apache-2.0
"""Arithmetic on pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import OpenImageIO as oiio
from OpenImageIO import ImageBufAlgo

from ..images import Image
from ..op import Op
from ..params import Numbers, argument, image
from .kinds import Point


@dataclass(frozen=True, kw_only=True)
class TwoImages(Point):
    """Two images, pixel by pixel."""

    a: Image = image(help="the first image")
    b: Image = image(help="the second image")


@dataclass(frozen=True, kw_only=True)
class ImageAndValues(Point):
    """An image and a value for all channels, or one for each."""

    neutral: ClassVar[float] = 0.0  # for channels that get no value

    source: Image = image(help="the image")
    value: Numbers = argument(help="one value for all channels, or one for each")

    def values(self, buffer: oiio.ImageBuf) -> tuple[float, ...]:
        """A value for every channel."""
        count = buffer.nchannels
        given = self.value[:count]
        return given * count if len(self.value) == 1 else given + (self.neutral,) * (count - len(given))


@dataclass(frozen=True, kw_only=True)
class Add(TwoImages):
    """Add two images."""

    name: ClassVar[str] = "add"

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """A + B."""
        return ImageBufAlgo.add(*buffers)


@dataclass(frozen=True, kw_only=True)
class AddValues(ImageAndValues):
    """Add to all channels a value, or to each its own."""

    name: ClassVar[str] = "addc"

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """A + value."""
        return ImageBufAlgo.add(*buffers, self.values(*buffers))


OPS: tuple[type[Op], ...] = (Add, AddValues)
