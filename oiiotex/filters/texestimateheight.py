# SPDX-License-Identifier: Apache-2.0
"""--texestimateheight: heights and normals where a material has none, from one photo's shading."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..color.config import color_space
from ..color.lab import working_values
from ..core.access import Whole
from ..core.attributes import ESTIMATE, HEIGHT_PX
from ..core.image import Image, Part, from_pixels, measure_spec
from ..core.op import Kind, Output, Space
from ..core.parameters import image, param
from ..deferred import np
from ..errors import ImageError, ParameterError, modifier
from ..session import Session


@dataclass(frozen=True, kw_only=True)
class EstimateHeight(Whole):
    """Guess heights, and normals, from how one photo is shaded.

    The surface is taken for matt, of one color but for what is larger than sigma, and lit from one side (Pentland
    1990) or by an overcast sky, under which what is deep is dark (Langer and Zucker 1994); heights are the integrable
    surface nearest to the slopes that this says (Frankot and Chellappa 1988, by FFT). Paint is taken for relief: where
    a scan has heights, use these. From which end of its direction light comes no photo of relief says: above is
    assumed, left of two sides; light= says it, and turns what is raised into what is sunken where it was wrong.
    Heights go from 0 to 1; the attribute oiiotex:heightpx says how many pixels that is.
    """

    example: ClassVar[str] = """\
>>> maps = filters.estimateheight("photo.png", normal=True)
>>> list(maps)
['height', 'normal']
"""
    name: ClassVar[str] = "estimateheight"
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("height", Kind.MEASURE, "one channel, 0 to 1, larger is nearer"),
        Output("normal", Kind.MEASURE, "normals of these heights, as colors from 0 to 1", asked_by="normal"),
    )

    source: Image = image(help="the photo")
    normal: bool | Path = param(False, help="1: normals as part 'normal' of the result; a file name: there")
    light: float | None = param(
        None, ge=-360, le=360, unit="degrees", help="where light comes from, counterclockwise from the right: 90 is"
        " from above; when left out as the shading says, overcast where no direction stands out",
    )  # fmt: skip
    overcast: bool = param(False, help="light has no direction: dark is deep")
    elevation: float = param(
        45.0,
        ge=1,
        le=89,
        unit="degrees",
        help="of the light above the surface: low light shades small relief as much",
    )
    sigma: float | None = param(
        None, ge=1, le=1e6, unit="px", help="what is larger is color or uneven light and no relief; longer side / 8"
        " when left out",
    )  # fmt: skip
    strength: float = param(1.0, ge=0.01, le=100, help="by how much slopes of the normals are steeper")
    convention: str = param(
        "opengl", choices=("opengl", "directx"), help="where green of the normals points: up (opengl) or down"
    )
    tile: str = param("none", choices=("none", "x", "y", "xy"), help="along which axes the photo tiles")
    data: bool = param(False, help="the channels are no colors: the first is luminance")

    def compute(self, session: Session) -> dict[str, Any]:
        """Heights, and normals where they are asked for."""
        from ..capture.shading import (  # what a line alone says needs none of it
            BYTES,
            luminance,
            normals_of,
            padded_size,
            relief,
        )

        resources, progress = session.resources, session.progress
        if self.overcast and self.light is not None:
            problem = f"conflicts with {modifier(overcast=True)}"
            raise ParameterError(problem, parameter="light", value=f"{self.light:g}")
        part, wraps = self.source.first, ("y" in self.tile, "x" in self.tile)
        width, height = part.spec.width, part.spec.height
        sigma = self.sigma or max(1.0, max(width, height) / 8)
        resources.require(BYTES * math.prod(padded_size((height, width), sigma, wraps)), f"heights of {width}x{height}")
        values, opaque = working_values(self.source, resources, self.working_space)
        if opaque is not None and not opaque.any():
            raise ImageError(f"{self.source.source}: alpha is 0 everywhere: there is no shading to look at")
        progress.advance(1, 2)
        is_data = self.data or color_space(self.source, resources.color, session.settings.autocc) is None
        seen = values[..., 0] / np.float32(100) if is_data else luminance(values[..., 0])
        found = relief(seen, opaque, sigma, self.light, self.overcast, self.elevation, wraps)
        progress.advance(2, 2)
        side = "an overcast sky" if found.light is None else f"{found.light:.0f} degrees"
        low = float(found.heights.min())
        most = max(float(found.heights.max()) - low, 1e-6)
        self.inform("light from %s; heights of %.1f px", side, most)
        spec = measure_spec(part.spec)
        spec.attribute(HEIGHT_PX, most)
        spec.attribute(ESTIMATE, f"height from shading, light from {side}")
        heights = ((found.heights - np.float32(low)) / np.float32(most))[..., None]
        return {
            "height": from_pixels(part.name, heights, spec),
            "normal": lambda: self._normals(normals_of(found.heights * np.float32(self.strength), wraps), part, side),
        }

    def _normals(self, normals: np.ndarray, part: Part, side: str) -> Part:
        spec = measure_spec(part.spec, ("R", "G", "B"))
        spec.attribute(ESTIMATE, f"normal from shading, light from {side}")
        if self.convention == "directx":
            normals = normals * np.array([1, -1, 1], np.float32)
        return from_pixels("normal", 0.5 + 0.5 * normals, spec)
