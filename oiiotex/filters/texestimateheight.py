# SPDX-License-Identifier: Apache-2.0
"""--texestimateheight: heights and normals from the shading of one photo."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..engine.color.config import color_space
from ..engine.color.lab import color_to_convert, working_values
from ..engine.color.normal_maps import NORMALS
from ..engine.core.access import Whole
from ..engine.core.attributes import ESTIMATE, HEIGHT_PX
from ..engine.core.image import Image, Part, from_pixels, measure_spec
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import image, param
from ..engine.core.tiling import TILED, tiled_spec, tiling_of
from ..engine.deferred import np, oiio
from ..engine.errors import ImageError, ParameterError, modifier
from ..engine.session import Session
from ..engine.session.facts import Facts


@dataclass(frozen=True, kw_only=True)
class EstimateHeight(Whole):
    """Estimate heights and normals of a material from the shading of one photo.

    The surface is assumed to be matte, of uniform color apart from structures larger than sigma, and lit from one side
    (Pentland 1990) or by an overcast sky, where recesses are dark (Langer and Zucker 1994). Heights are the integrable
    surface closest to the estimated slopes (Frankot and Chellappa 1988, by FFT). Paint is mistaken for relief. If a
    scan has a height map, use that instead.

    A photo cannot tell from which of two opposite sides the light comes. Light from above is assumed, or from the left
    if it comes from the side. If raised and recessed parts are swapped in the result, set `light` to the other side, or
    `negate`. Two materials or paints of different lightness, such as stones and bright mortar, are refused without
    `light` or `overcast`: their depth cannot be seen. Dark joints are accepted.

    Heights are stored as 0 to 1; the attribute oiiotex:heightpx contains the height, in pixels, of the value 1.
    """

    example: ClassVar[str] = """\
>>> maps = filters.estimateheight("photo.png", normal=True)
>>> list(maps)
['height', 'normal']
"""
    name: ClassVar[str] = "estimateheight"
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("height", Kind.MEASURE, "Height map: one channel, 0 to 1, higher values are closer to the viewer."),
        Output("normal", Kind.MEASURE, "Normal map of these heights, encoded as 0 to 1.", asked_by="normal"),
    )

    source: Image = image(help="Photo to analyze.")
    normal: bool | Path = param(
        False, help="Normal map. 1: append it as part 'normal'; a file name: write it to that file."
    )
    light: float | None = param(
        None, ge=-360, le=360, unit="degrees", unset="from the shading", example="90",
        help="Direction of the light, counterclockwise from the right: 90 is above. Without it, light without a clear"
        " direction is taken as overcast.",
    )  # fmt: skip
    overcast: bool = param(False, help="Overcast light, without a direction: dark is deep.")
    negate: bool = param(
        False, help="Swap raised and recessed parts. For overcast light, this means that bright is deep."
    )
    sigma: float | None = param(
        None, ge=1, le=1e6, unit="px", unset="longer side / 8", example="128",
        help="Scale above which variation is taken as color or uneven light, not relief.",
    )  # fmt: skip
    strength: float = param(
        1.0, ge=0.01, le=100,
        help="Multiplier of the heights. 1 is right for a light 45 degrees above the surface; for another, set the"
        " tangent of its elevation.",
    )  # fmt: skip
    normals: str = NORMALS
    tiled: str | None = TILED
    data: bool = param(False, advanced=True, help="Treat the first channel as luminance, not color.")

    def plan(self, facts: Facts) -> Plan:
        """The scale of the heights."""
        from ..surfaces.capture.shading import BYTES, padded_size  # not needed to parse the command line

        if self.overcast and self.light is not None:
            problem = f"conflicts with {modifier(overcast=True)}"
            raise ParameterError(problem, parameter="light", value=f"{self.light:g}")
        part = self.source.first
        tiling = self.tiled or tiling_of(part.spec)
        wraps = "y" in tiling, "x" in tiling
        width, height = part.spec.width, part.spec.height
        sigma = self.sigma or max(1.0, max(width, height) / 8)
        facts.require(BYTES * math.prod(padded_size((height, width), sigma, wraps)), f"heights of {width}x{height}")
        color_to_convert(self.source, facts, self.working_space)
        return Plan(work=(sigma, wraps, tiling))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """Heights, and normals if requested."""
        from ..surfaces.capture.shading import has_two_albedos, luminance, normals_of, relief

        resources, progress, part = session.resources, session.progress, self.source.first
        sigma, wraps, tiling = plan.work
        values, opaque = working_values(self.source, resources, self.working_space)
        if opaque is not None and not opaque.any():
            raise ImageError(f"{self.source.source}: alpha is 0 everywhere: expected opaque pixels")
        progress.advance(1, 2)
        is_data = self.data or color_space(self.source, resources.color, session.settings.autocc) is None
        seen = values[..., 0] / np.float32(100) if is_data else luminance(values[..., 0])
        guessed = self.light is None and not self.overcast
        if guessed and has_two_albedos(values[..., 0], opaque, sigma):
            raise ImageError(
                f"{self.source.source} has two materials, such as bright joints, whose depth is not visible",
                hint=f"set {modifier(overcast=True)} if dark is deep, also {modifier(negate=True)} if bright is deep,"
                " or light",
            )
        found = relief(seen, opaque, sigma, self.light, self.overcast, wraps)
        found = replace(found, heights=found.heights * np.float32(-self.strength if self.negate else self.strength))
        progress.advance(2, 2)
        side = "an overcast sky" if found.light is None else f"{found.light:.0f} degrees"
        low = float(found.heights.min())
        most = max(float(found.heights.max()) - low, 1e-6)
        self.inform("light from %s; heights of %.1f px", side, most)
        spec = tiled_spec(measure_spec(part.spec), tiling)
        spec.attribute(HEIGHT_PX, most)
        spec.attribute(ESTIMATE, f"height from shading, light from {side}")
        heights = ((found.heights - np.float32(low)) / np.float32(most))[..., None]
        return {
            "height": from_pixels(part.name, heights, spec),
            "normal": lambda: self._normals(normals_of(found.heights, wraps), spec, side),
        }

    def _normals(self, normals: np.ndarray, heights: oiio.ImageSpec, side: str) -> Part:
        spec = tiled_spec(measure_spec(heights, ("R", "G", "B")), tiling_of(heights))
        spec.erase_attribute(HEIGHT_PX)
        spec.attribute(ESTIMATE, f"normal from shading, light from {side}")
        if self.normals == "directx":
            normals = normals * np.array([1, -1, 1], np.float32)
        return from_pixels("normal", 0.5 + 0.5 * normals, spec)
