# SPDX-License-Identifier: Apache-2.0
"""--texdominant: a mask of the dominant texture of a photo."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..engine.color.lab import InLab, color_to_convert
from ..engine.core.access import ScanThenMap
from ..engine.core.image import Image
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import image, param
from ..engine.deferred import np
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..synthesis.exemplar.exemplar_masks import laid_over, masked_pixels


@dataclass(frozen=True, kw_only=True)
class Dominant(InLab, ScanThenMap):
    """Find the dominant texture of a photo: a mask without objects, cracks, stains and shadows.

    Patches are grouped by similarity, starting from the most typical one: heat diffuses from it through the large
    group of similar patches, but hardly to others (LDR09: Lu, Dorsey, Rushmeier, Dominant Texture and Diffusion
    Distance Manifolds, Eurographics 2009). The mask is 1 in dominant patches, else 0. If no group contains 40 % of
    the patches, the mask is empty and a warning is printed. With `photo` the photo is the first part and the mask
    follows it as part 'dominant', which can guide a synthesis.

    Attributes record the patch side in px (oiiotex:patch), the size of the kernel (oiiotex:epsilon), the dimension of
    the manifold (oiiotex:dimension), the diffusion steps (oiiotex:tau) and the fraction of dominant patches
    (oiiotex:share).
    """

    example: ClassVar[str] = """\
>>> mask = filters.dominant("photo.png")
>>> tile = filters.stationarize("photo.png", mask=mask)
"""
    name: ClassVar[str] = "dominant"
    carries: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("photo", Kind.PIXELS, "Photo, as the first part.", asked_by="photo", of="source"),
        Output("dominant", Kind.MASK, "Mask: 1 in the dominant texture, in the image's windows."),
        Output("score", Kind.MEASURE, "Density, and the decimal logarithm of heat.", asked_by="score"),
        Output("facts", Kind.TABLE, "Kernel curve, thresholds, iterations and proportions.", asked_by="facts"),
    )

    source: Image = image(help="Photo to mask.")
    mask: Image | None = image(None, help="Region to analyze. Pixels outside of it are ignored.")
    patch: int | None = param(
        None, ge=3, le=63, unit="px", unset="estimated from the photo's Fourier transform", example="15",
        help="Side of a patch, rounded to an odd number. Increase it if the texture has large elements.",
    )  # fmt: skip
    paper: bool = param(
        False, help="Rules of the paper (LDR09) for thresholds and mask, with a patch around every pixel: slow."
    )
    photo: bool = param(False, help="Keep the photo as the first part, before the mask.")
    score: bool = param(
        False,
        advanced=True,
        help="Append part 'score' with two channels: density, and the decimal"
        " logarithm of heat. Both are high in the dominant texture.",
    )
    facts: Path | None = param(
        None,
        example="facts.json",
        help="JSON file with diagnostics: the curve by which the kernel size was chosen, thresholds and iterations.",
    )

    def plan(self, facts: Facts) -> Plan:
        """Nothing but the declared outputs."""
        from ..analysis.dominant.photo_mask import require_memory  # scipy is not loaded before it is needed

        require_memory(self.flag(), self.source, facts, self.patch, self.paper)
        color_to_convert(self.source, facts, self.working_space)
        if self.mask is not None:
            laid_over(self.mask.first, self.source, "mask")
        return Plan()

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The mask, and what other outputs are requested."""
        from ..analysis.dominant.photo_mask import photo_mask  # scipy is not loaded before it is needed

        def allowed() -> np.ndarray | None:
            return None if self.mask is None else masked_pixels(self.mask, self.source)

        dominant = photo_mask(
            self.flag(), self.source, self.working_space, session.resources, session.progress,
            allowed=allowed, patch=self.patch, paper=self.paper,
        )  # fmt: skip
        return {"dominant": dominant.part, "score": lambda: dominant.score, "facts": dominant.facts}
