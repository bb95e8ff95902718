# SPDX-License-Identifier: Apache-2.0
"""--texwarp: any map of a material re-made from the source coordinates of another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..core.access import Gather
from ..core.demand import bands
from ..core.image import Image, Part, derived_spec, dtype_of
from ..core.op import Kind, Output, Space
from ..core.parameters import image
from ..core.source_map import SourceMap, Sources
from ..core.window import Window
from ..deferred import np
from ..errors import ImageError
from ..session import Session


@dataclass(frozen=True, kw_only=True)
class Warp(Gather):
    """Re-make an image from a map of source coordinates, pixel for pixel, to the bit.

    Of a photo's normals and the `stmap` of a tile, it makes the normals that belong to that tile. The result has the
    map's size; nothing is interpolated, so normals stay normals. The image must have the display window of the photo
    from which the map was made.
    """

    example: ClassVar[str] = """\
>>> made = filters.stationarize("photo.png", stmap=True)
>>> rough_tile = filters.warp("roughness.png", made["st"])
"""
    name: ClassVar[str] = "warp"
    copies: ClassVar[bool] = True
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("warped", Kind.PIXELS, "the image's pixels at the map's places"),)

    source: Image = image(help="the image to take pixels from")
    st: Image = image(help="source coordinates: part 'st', else the first part")

    def compute(self, session: Session) -> dict[str, Part]:
        """The re-made first part; the map is read band by band, once to check it; the image is held."""
        part, st = self.source.first, self.st.part("st") or self.st.first
        if st.spec.nchannels != 2 or dtype_of(st.spec) not in (np.float32, np.float64):
            raise ImageError(
                f"{self.st.source}: source coordinates are two channels of floats, here are {st.spec.nchannels} of"
                f" {st.spec.format}"
            )

        def read(window: Window) -> SourceMap:
            at = window.shifted(st.spec.x, st.spec.y)
            return SourceMap.of_coordinates(st.read(at), part.spec, self.st.source)

        spec = derived_spec(part.spec, st.spec.width, st.spec.height)
        with session.resources.stats.time("read"):
            warped = Sources(read, spec, session.resources.spread).copied(part, spec)
            for window in bands(warped):  # what is wrong with the map is said here, not while the result is written
                read(window)
        return {"warped": warped}
