# SPDX-License-Identifier: Apache-2.0
"""--texestimateroughness: roughness where a material has none, from one photo's local contrast."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import ClassVar

from ..color.lab import lens_of
from ..core.access import ScanThenMap
from ..core.attributes import ESTIMATE
from ..core.image import Image, Part, measure_spec
from ..core.op import Kind, Output, Space
from ..core.parameters import image, param
from ..core.window import Window
from ..deferred import np
from ..session import Session
from ..stationarity.grid_statistics import Surface
from ..stationarity.local_moments import drift_of

log = logging.getLogger("oiiotex")


@dataclass(frozen=True, kw_only=True)
class EstimateRoughness(ScanThenMap):
    """Guess how rough a surface is from its photo's local contrast.

    Where a bumpy surface is smooth it glitters: highlights lie beside dark reflections, and the contrast of lightness
    is high; where it is rough, light is spread and contrast low. Roughness is `middle` where contrast, the standard
    deviation of L through a Gaussian of sigma, is that of the whole photo, and at most `amount` more or less.
    Paint that is patterned looks smooth to it, and a photo under an overcast sky says next to nothing: where a scan has
    roughness, use that. It needs no more memory for a large photo than for a small one.
    """

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
        help="scale at which contrast is seen; longer side / 64, 2 at least, when left out",
    )
    middle: float = param(0.6, ge=0, le=1, help="roughness where contrast is as everywhere")
    amount: float = param(0.3, ge=0, le=1, help="by how much it is more or less at most")
    data: bool = param(False, help="the channels are no colours: the first is lightness")

    def compute(self, session: Session) -> dict[str, Part]:
        """The map."""
        part = self.source.first
        lens = lens_of(self.source, session, self.working_space)
        sigma = self.sigma or max(2.0, max(part.spec.width, part.spec.height) / 64)
        drift = drift_of(self.source, lens, sigma, session)
        spec = measure_spec(part.spec)
        spec.attribute(ESTIMATE, f"roughness from local contrast at sigma {sigma:g} px")
        middle, amount = np.float32(self.middle), np.float32(self.amount)
        if drift is None or drift.overall_deviation[0] == 0:  # nothing to be seen, or no contrast anywhere

            def even(window: Window) -> np.ndarray:
                return np.full((window.height, window.width, 1), middle)

            return {"roughness": Part(part.name, spec, even, ready=True)}
        overall = np.float32(drift.overall_deviation[0])
        log.info("%s: contrast is %.1f L at sigma %g px", self.flag(), overall, sigma)
        contrast = Surface(drift.deviation[..., :1], drift.cells)

        def fetch(window: Window) -> np.ndarray:
            seen = np.maximum(contrast.values(window), np.float32(0))
            return np.clip(middle - amount * (seen - overall) / (seen + overall), np.float32(0), np.float32(1))

        return {"roughness": Part(part.name, spec, fetch, ready=True)}
