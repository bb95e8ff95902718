# SPDX-License-Identifier: Apache-2.0
"""--texestimateao: ambient occlusion from the heights of a material."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from ..engine.core.access import Gather
from ..engine.core.attributes import ESTIMATE
from ..engine.core.demand import PIECE_PIXELS, cached
from ..engine.core.image import Image, Part, channels_of, measure_spec
from ..engine.core.op import Kind, Output, Plan, Space, no_pixels
from ..engine.core.parameters import image, param
from ..engine.core.tiling import TILED, tiled_spec, tiling_of
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.session import Session
from ..engine.session.facts import Facts

_HIGHEST = 1e12  # px, up or down: larger heights occlude no more, and squares of differences stay finite


@dataclass(frozen=True, kw_only=True)
class EstimateAO(Gather):
    """Compute ambient occlusion from a height map.

    1 is unoccluded, 0 is fully occluded. In each of sixteen directions the steepest horizon within the radius is
    found, and the light between the horizons is integrated in closed form (Jimenez and others 2016, eq. 10). Results
    agree with ray tracing of the same heights to 0.01. The scale of the heights is a guess unless `relief` or the
    attribute oiiotex:heightpx gives it. Occlusion from farther away than the radius is ignored.
    """

    example: ClassVar[str] = """\
>>> height = filters.estimateheight("photo.png")
>>> occlusion = filters.estimateao(height)
"""
    name: ClassVar[str] = "estimateao"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("ao", Kind.MEASURE, "Ambient occlusion: one channel, 0 (fully occluded) to 1 (unoccluded)."),
    )

    source: Image = image(help="Height map: its first channel, where larger is nearer.")
    radius: int = param(32, ge=2, le=1024, unit="px", help="Maximum distance at which the surface occludes.")
    relief: float | None = param(
        None, ge=1e-6, le=1e6, unit="px", unset="the attribute oiiotex:heightpx, else longer side / 32", example="24",
        help="Height that a value of 1 stands for.",
    )  # fmt: skip
    tiled: str | None = TILED

    def plan(self, facts: Facts) -> Plan:
        """The map, and the scale of its heights."""
        from ..surfaces.capture.occlusion import relief_of  # not needed to parse the command line

        part = self.source.first
        scale = self.relief or relief_of(part.spec)
        spec = tiled_spec(measure_spec(part.spec), self.tiled or tiling_of(part.spec))
        spec.attribute(ESTIMATE, f"ambient occlusion from heights of {scale:g} px")
        return Plan({"ao": Part(part.name, spec, no_pixels)}, scale)

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """The map, computed window by window on request."""
        from ..surfaces.capture.occlusion import heights_around, visible_sky  # not needed to parse the command line

        part, scale = self.source.first, plan.work
        self.inform("a height of 1 is %g px", scale)
        near, channel = cached(part, session.resources.cache), channels_of(part.spec).first
        tiling = self.tiled or tiling_of(part.spec)
        wraps = "x" in tiling, "y" in tiling

        def look(heights: np.ndarray) -> np.ndarray:
            return visible_sky(heights, self.radius)[..., None]

        def fetch(window: Window) -> np.ndarray:
            around = heights_around(near, window, self.radius, wraps, channel, self.source.source)
            around = np.clip(around, -_HIGHEST / scale, _HIGHEST / scale) * np.float32(scale)
            high = max(1, PIECE_PIXELS // max(1, window.width))
            pieces = [around[y : y + high + 2 * self.radius] for y in range(0, window.height, high)]
            return np.concatenate(list(session.resources.spread(look, pieces)))

        return {"ao": replace(plan.results["ao"], fetch=fetch)}
