# SPDX-License-Identifier: Apache-2.0
"""Filters that look at a neighbourhood."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import OpenImageIO as oiio
from OpenImageIO import ImageBufAlgo

from ..images import Image
from ..op import Op
from ..params import argument, image, param
from ..windows import Window
from .kinds import Area, checked
from .geometry_text import parse_size


@dataclass(frozen=True, kw_only=True)
class Blur(Area):
    """Blur with a kernel."""

    name: ClassVar[str] = "blur"

    source: Image = image(help="the image")
    size: str = argument(help="width x height of the kernel: 5x5, 3.5x1")
    kernel: str = param("gaussian", help="name of the kernel: gaussian, box, triangle, binomial, disk ...")

    def halo(self) -> tuple[int, int]:
        """Half the kernel."""
        width, height = parse_size(self.size)
        return math.ceil(width / 2) + 1, math.ceil(height / 2) + 1

    def apply(self, target: oiio.ImageSpec, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """Convolved."""
        kernel = checked(ImageBufAlgo.make_kernel(self.kernel, *parse_size(self.size)))
        return ImageBufAlgo.convolve(*buffers, kernel, True, Window.data(target).roi(target.nchannels))


OPS: tuple[type[Op], ...] = (Blur,)
