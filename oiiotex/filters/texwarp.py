# SPDX-License-Identifier: Apache-2.0
"""--texwarp: an image resampled by a map of source coordinates, without interpolation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..engine.core.access import Gather
from ..engine.core.demand import bands
from ..engine.core.image import Image, Part, derived_spec, dtype_of
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import image
from ..engine.core.source_map import SourceMap, Sources
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.errors import ImageError
from ..engine.session import Session
from ..engine.session.facts import Facts


@dataclass(frozen=True, kw_only=True)
class Warp(Gather):
    """Rearrange the pixels of an image by a map of source coordinates, without interpolation.

    Use it to apply a synthesis to further maps of a photo: for example, the photo's normal map and the `st` of its
    tile give the normal map of the tile. The result has the size of the map. Pixels are copied unchanged, so normals
    remain valid. The image must have the display window of the photo from which the map was made.
    """

    example: ClassVar[str] = """\
>>> made = filters.stationarize("photo.png", st=True)
>>> rough_tile = filters.warp("roughness.png", made["st"])
"""
    name: ClassVar[str] = "warp"
    copies: ClassVar[bool] = True
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("warped", Kind.PIXELS, "Pixels of the image, copied as the map says."),
    )

    source: Image = image(help="Image that provides the pixels.")
    stmap: Image = image(help="Source coordinates: part 'st', or the first part if there is none of that name.")

    def plan(self, facts: Facts) -> Plan:
        """The map of source coordinates."""
        st = self.stmap.part("st") or self.stmap.first
        if st.spec.nchannels != 2 or dtype_of(st.spec) not in (np.float32, np.float64):
            raise ImageError(
                f"has {st.spec.nchannels} channels of {st.spec.format}: expected two float channels (s, t)",
                subject=self.stmap.source,
            )

        return Plan(work=st)

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """The rearranged first part. The map is read in bands, once to check it; a large image lies in a file."""
        part, st = self.source.first, plan.work

        def read(window: Window) -> SourceMap:
            at = window.shifted(st.spec.x, st.spec.y)
            return SourceMap.of_coordinates(st.read(at), part.spec, self.stmap.source)

        spec = derived_spec(part.spec, st.spec.width, st.spec.height)
        with session.resources.stats.time("read"):
            warped = Sources(read, spec, session.resources).copied(part, spec)
            for window in bands(warped):  # reports errors of the map before the result is written
                read(window)
        return {"warped": warped}
