# SPDX-License-Identifier: Apache-2.0
"""--texestimateroughness: roughness from the local contrast of one photo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..analysis.stationarity.grid_statistics import SplineSurface
from ..engine.color.lab import color_to_convert, lens_of
from ..engine.color.lens import Lens
from ..engine.core.access import ScanThenMap
from ..engine.core.attributes import ESTIMATE
from ..engine.core.image import Image, Part, channels_of, measure_spec
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import image, param
from ..engine.core.tiling import TILED, tiled_spec, tiling_of
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.session import Session
from ..engine.session.facts import Facts

_LEAST_SKEWNESS = 0.1  # rendered reliefs: -.23 to -.12 if matte, .24 to 2.4 with highlights
_NO_HIGHLIGHTS = (
    "the photo shows no highlights (skewness of its fine detail %.2f), so the map is middle everywhere; use a photo in"
    " hard light"
)

_SPREAD = 0.3  # maximum deviation from `middle`


@dataclass(frozen=True, kw_only=True)
class EstimateRoughness(ScanThenMap):
    """Estimate the roughness of a material from the local contrast of one photo.

    Where a bumpy surface is smooth, it glitters: highlights lie next to dark reflections. The contrast of the
    finest detail is measured in linear light over a Gaussian of sigma. Places with more contrast than the whole
    photo become smoother than `middle`, places with less become rougher, by at most 0.3. The estimate is weak
    (its page has figures), and fine paint appears smooth. Without highlights, as under an overcast sky, nothing can be
    estimated: the map is `middle` everywhere, and a warning says so. If a scan has a roughness map, use that instead.
    Memory does not grow with the photo.
    """

    example: ClassVar[str] = '>>> roughness = filters.estimateroughness("photo.png", middle=0.5)'
    name: ClassVar[str] = "estimateroughness"
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("roughness", Kind.MEASURE, "Roughness map: one channel, 0 (mirror) to 1 (matte)."),
    )

    source: Image = image(help="Photo to analyze.")
    sigma: float | None = param(
        None,
        ge=1,
        le=1e6,
        unit="px",
        unset="longer side / 16, at least 2",
        example="64",
        help="Scale of the local contrast.",
    )
    middle: float = param(0.6, ge=0, le=1, help="Roughness where the local contrast is average.")
    tiled: str | None = TILED
    data: bool = param(False, advanced=True, help="Treat the first channel as lightness, not color.")

    def plan(self, facts: Facts) -> Plan:
        """Nothing but the declared output."""
        color_to_convert(self.source, facts, self.working_space)
        return Plan()

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """The map."""
        from ..analysis.drift.drift_field import drift_of
        from ..surfaces.capture.fine_detail import (
            fine_detail,
            skewness,
            without_sign,
        )  # not needed to parse the command line

        part = self.source.first
        lens = lens_of(self.source, session.resources, self.working_space)
        sigma = self.sigma or max(2.0, max(part.spec.width, part.spec.height) / 16)
        tiling = self.tiled or tiling_of(part.spec)
        detail = fine_detail(part, lens, tiling)
        fine = Image((without_sign(detail),), self.source.source)
        plain = Lens(fine.source, channels_of(fine.first.spec))
        wraps = "y" in tiling, "x" in tiling
        drift = drift_of(fine, plain, 2 * sigma, session.resources, session.progress, wraps, robust=False)
        skewed = skewness(detail)
        if skewed < _LEAST_SKEWNESS:
            self.warn(_NO_HIGHLIGHTS, skewed)
        spec = tiled_spec(measure_spec(part.spec), tiling)
        spec.attribute(ESTIMATE, f"roughness from local contrast at sigma {sigma:g} px")
        middle = np.float32(self.middle)
        overall = np.float32(0 if drift is None else drift.overall_level[0])
        if drift is None or overall == 0 or skewed < _LEAST_SKEWNESS:  # no opaque pixels, no detail, or no highlights

            def even(window: Window) -> np.ndarray:
                return np.full((window.height, window.width, 1), middle)

            return {"roughness": Part(part.name, spec, even, ready=True)}
        contrast = SplineSurface(drift.level[..., :1], drift.cells)

        def fetch(window: Window) -> np.ndarray:
            seen = np.maximum(contrast.values(window), np.float32(0))
            return np.clip(
                middle - np.float32(_SPREAD) * (seen - overall) / (seen + overall), np.float32(0), np.float32(1)
            )

        return {"roughness": Part(part.name, spec, fetch, ready=True)}
