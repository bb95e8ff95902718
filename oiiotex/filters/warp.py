# SPDX-License-Identifier: Apache-2.0
"""--texwarp: any map of a material re-made from the source coordinates of another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..errors import ImageError
from ..images import Image, Part, derived_spec, dtype_of
from ..op import Op, Output, Reach, Space
from ..params import image
from ..session import Session
from ..tiles import bands
from ..windows import Window


@dataclass(frozen=True, kw_only=True)
class Warp(Op):
    """Re-make an image from a map of source coordinates, pixel for pixel, to the bit.

    `oiiotex normal.exr st.exr --texwarp -o normal_tile.exr` gives the normals that belong to a tile made with
    `:stmap=st.exr`. The result has the map's size; nothing is interpolated, so normals stay normals. The image must
    have the display window of the photo from which the map was made.
    """

    name: ClassVar[str] = "warp"
    copies: ClassVar[bool] = True
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("warped", "the image's pixels at the map's places"),)

    source: Image = image(help="the image to take pixels from")
    st: Image = image(help="source coordinates: part 'st', else the first part")

    def compute(self, session: Session) -> Image:
        """The re-made first part; the map is read band by band, once to check it; the image is held."""
        part, st = self.source.first, self.st.part("st") or self.st.first
        if st.spec.nchannels != 2 or dtype_of(st.spec) not in (np.float32, np.float64):
            raise ImageError(
                f"{self.st.source}: source coordinates are two channels of floats, here are {_channels(st)}"
            )
        with session.stats.time("read"):
            pixels = part.pixels()
            for window in bands(st):  # what is wrong with the map is said here, not while the result is written
                _places(st.read(window), part, self.st.source)

        def fetch(window: Window) -> np.ndarray:
            y, x = _places(st.read(window.shifted(st.spec.x, st.spec.y)), part, self.st.source)
            return pixels[y, x]

        spec = derived_spec(part.spec, st.spec.width, st.spec.height)
        return Image((Part(part.name, spec, fetch, part.spec.format),), self.source.source)


def _places(coordinates: np.ndarray, part: Part, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(s, t) over the display window -> (y, x) in the data window of the part."""
    spec = part.spec
    place = coordinates[..., :2].astype(np.float64) * (spec.full_width, spec.full_height)
    if not np.isfinite(place).all():
        raise ImageError(f"{name} has {np.count_nonzero(~np.isfinite(place))} NaN or Inf coordinates")
    x = np.floor(place[..., 0]).astype(np.int64) + spec.full_x - spec.x
    y = np.floor(place[..., 1]).astype(np.int64) + spec.full_y - spec.y
    outside = np.count_nonzero((x < 0) | (x >= spec.width) | (y < 0) | (y >= spec.height))
    if outside:
        raise ImageError(f"{name} has {outside} coordinates outside the {spec.width}x{spec.height} pixels of the image")
    return y, x


def _channels(part: Part) -> str:
    return f"{part.spec.nchannels} of {part.spec.format}"
