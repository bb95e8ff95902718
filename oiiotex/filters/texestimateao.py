# SPDX-License-Identifier: Apache-2.0
"""--texestimateao: ambient occlusion where a material has none, from its heights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..core.access import Gather
from ..core.attributes import ESTIMATE, HEIGHT_PX
from ..core.demand import PIECE_PIXELS, cached
from ..core.image import Image, Part, channels_of, measure_spec
from ..core.op import Kind, Output, Space
from ..core.parameters import image, param
from ..core.window import Window
from ..deferred import np
from ..session import Session

_HIGHEST = 1e12  # px, up or down: what is higher hides no more, and squares of differences are finite
_RELIEF = 1 / 32  # of the longer side: what a height of 1 is taken for where nothing says it


@dataclass(frozen=True, kw_only=True)
class EstimateAO(Gather):
    """Work out how much of an even sky every place of a height map sees.

    1 is a place that nothing stands around. Of sixteen directions the steepest horizon within the radius is taken, and
    the light between horizons in closed form (Jimenez and others 2016, eq. 10). It is right for the heights that it is
    given, to 0.01 of what rays say; what is guessed is how high they are, where neither scale= nor the attribute
    oiiotex:heightpx says it, and that what is farther away than the radius hides nothing.
    """

    example: ClassVar[str] = """\
>>> height = filters.estimateheight("photo.png")
>>> occlusion = filters.estimateao(height)
"""
    name: ClassVar[str] = "estimateao"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("ao", Kind.MEASURE, "one channel, 0 (nothing reaches it) to 1 (all of the sky does)"),
    )

    source: Image = image(help="heights, the first channel; larger is nearer")
    radius: int = param(32, ge=2, le=1024, unit="px", help="how far away something may stand and hide the sky")
    scale: float | None = param(
        None, ge=1e-6, le=1e6, unit="px", help="how high 1 is; as the attribute oiiotex:heightpx says when left out,"
        " else longer side / 32",
    )  # fmt: skip
    tile: str = param("none", choices=("none", "x", "y", "xy"), help="along which axes the heights tile")

    def compute(self, session: Session) -> dict[str, Part]:
        """The map, computed window by window when it is asked for."""
        from ..capture.occlusion import heights_around, visible_sky  # what a line alone says needs none of it

        part = self.source.first
        said = part.spec.get_float_attribute(HEIGHT_PX, 0.0)  # PNG has it as a text
        said = said if 1e-6 <= said <= 1e6 else 0.0
        scale = self.scale or said or max(part.spec.width, part.spec.height) * _RELIEF
        self.inform("a height of 1 is %g px", scale)
        near, channel = cached(part, session.resources.cache), channels_of(part.spec).color[0]
        wraps = "x" in self.tile, "y" in self.tile

        def look(heights: np.ndarray) -> np.ndarray:
            return visible_sky(heights, self.radius)[..., None]

        def fetch(window: Window) -> np.ndarray:
            around = heights_around(near, window, self.radius, wraps, channel, self.source.source)
            around = np.clip(around, -_HIGHEST / scale, _HIGHEST / scale) * np.float32(scale)
            high = max(1, PIECE_PIXELS // max(1, window.width))
            pieces = [around[y : y + high + 2 * self.radius] for y in range(0, window.height, high)]
            return np.concatenate(list(session.resources.spread(look, pieces)))

        spec = measure_spec(part.spec)
        spec.attribute(ESTIMATE, f"ambient occlusion from heights of {scale:g} px")
        return {"ao": Part(part.name, spec, fetch)}
