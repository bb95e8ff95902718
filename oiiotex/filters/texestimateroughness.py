# SPDX-License-Identifier: Apache-2.0
"""--texestimateroughness: roughness where a material has none, from one photo's local contrast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..color.lab import Lens, lens_of
from ..core.access import ScanThenMap
from ..core.attributes import ESTIMATE
from ..core.image import Image, Part, channels_of, measure_spec
from ..core.op import Kind, Output, Space
from ..core.parameters import image, param
from ..core.window import Window
from ..deferred import np
from ..session import Session
from ..stationarity.grid_statistics import SplineSurface


@dataclass(frozen=True, kw_only=True)
class EstimateRoughness(ScanThenMap):
    """Guess how rough a surface is from its photo's local contrast.

    Where a bumpy surface is smooth it glitters: highlights lie beside dark reflections. What is looked at is the
    contrast of the finest detail, in linear light, over a Gaussian of sigma. Roughness is `middle` where that is as in
    the whole photo, and at most `amount` more or less. It is a weak guess (its page has figures):
    fine paint looks smooth to it, and a photo under an overcast sky says next to nothing. Where a scan has roughness,
    use that. It needs no more memory for a large photo than for a small one.
    """

    example: ClassVar[str] = '>>> roughness = filters.estimateroughness("photo.png", middle=0.5)'
    name: ClassVar[str] = "estimateroughness"
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("roughness", Kind.MEASURE, "one channel, 0 (a mirror) to 1 (matt)"),
    )

    source: Image = image(help="the photo")
    sigma: float | None = param(
        None,
        ge=1,
        le=1e6,
        unit="px",
        help="scale of the contrast; longer side / 16, 2 at least, when left out",
    )
    middle: float = param(0.6, ge=0, le=1, help="roughness where contrast is as everywhere")
    amount: float = param(0.3, ge=0, le=1, help="by how much it is more or less at most")
    data: bool = param(False, help="the channels are no colors: the first is lightness")

    def compute(self, session: Session) -> dict[str, Part]:
        """The map."""
        from ..capture.fine_detail import fine_detail  # what a line alone says needs none of it
        from ..drift.drift_field import drift_of

        part = self.source.first
        lens = lens_of(self.source, session.resources, self.working_space)
        sigma = self.sigma or max(2.0, max(part.spec.width, part.spec.height) / 16)
        fine = Image((fine_detail(part, lens),), self.source.source)
        plain = Lens(fine.source, channels_of(fine.first.spec))
        drift = drift_of(fine, plain, 2 * sigma, session.resources, session.progress, robust=False)
        spec = measure_spec(part.spec)
        spec.attribute(ESTIMATE, f"roughness from local contrast at sigma {sigma:g} px")
        middle, amount = np.float32(self.middle), np.float32(self.amount)
        overall = np.float32(0 if drift is None else drift.overall_level[0])
        if drift is None or overall == 0:  # nothing to be seen, or no detail anywhere

            def even(window: Window) -> np.ndarray:
                return np.full((window.height, window.width, 1), middle)

            return {"roughness": Part(part.name, spec, even, ready=True)}
        contrast = SplineSurface(drift.level[..., :1], drift.cells)

        def fetch(window: Window) -> np.ndarray:
            seen = np.maximum(contrast.values(window), np.float32(0))
            return np.clip(middle - amount * (seen - overall) / (seen + overall), np.float32(0), np.float32(1))

        return {"roughness": Part(part.name, spec, fetch, ready=True)}
