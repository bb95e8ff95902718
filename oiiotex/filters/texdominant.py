# SPDX-License-Identifier: Apache-2.0
"""--texdominant: where a photo shows its main texture, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..color.lab import InLab
from ..core.access import ScanThenMap
from ..core.image import Image
from ..core.op import Kind, Output
from ..core.parameters import image, param
from ..deferred import np
from ..exemplar.exemplar_masks import masked_pixels
from ..session import Session


@dataclass(frozen=True, kw_only=True)
class Dominant(InLab, ScanThenMap):
    """Find the dominant texture of a photo: a mask without objects, cracks, stains and shadows.

    Overlapping patches are points in a space of colors; heat that spreads from the densest one reaches the large
    group of patches that look alike, and hardly those that do not (LDR09: Lu, Dorsey, Rushmeier, Dominant Texture and
    Diffusion Distance Manifolds, Eurographics 2009). The mask is 1 where dominant patches lie, else 0. A photo of
    which no group of patches holds 40 % is rejected: a warning and an empty mask, or an error with `strict`. With
    `keep` the photo stays the first part and the mask follows it as part 'dominant', ready to guide a synthesis.
    Attributes say the patch's side in px (oiiotex:patch), the kernel's size (oiiotex:epsilon), the manifold's
    dimension (oiiotex:dimension), the steps of the diffusion (oiiotex:tau) and the share of dominant patches
    (oiiotex:share).
    """

    example: ClassVar[str] = """\
>>> mask = filters.dominant("photo.png")
>>> tile = filters.stationarize("photo.png", mask=mask)
"""
    name: ClassVar[str] = "dominant"
    carries: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("photo", Kind.PIXELS, "the photo, before all others", asked_by="keep", of="source"),
        Output("dominant", Kind.MASK, "1 where the dominant texture is; in the image's windows"),
        Output("types", Kind.IDS, "1 to 4 for patches of type 0 to III around a pixel, 0 where none", asked_by="types"),
        Output("score", Kind.MEASURE, "density, and the decimal logarithm of heat", asked_by="score"),
        Output("facts", Kind.TABLE, "the kernel's curve, thresholds, rounds and shares", asked_by="json"),
        Output("chart", Kind.PICTURE, "the kernel's curve, and density over heat", asked_by="chart"),
    )

    source: Image = image(help="the photo")
    mask: Image | None = image(None, help="where to look: what it leaves out is no part of the photo")
    patch: int | None = param(
        None, ge=3, le=63, unit="px", help="side of a patch, made odd; from the Fourier transform when left out"
    )
    step: int | None = param(
        None, ge=1, le=256, unit="px", help="between patches; the smallest that leaves 12000 of them when left out"
    )
    rule: str = param("repaired", choices=("repaired", "paper"), help="thresholds, mask; paper: as its text has them")
    mode: str = param(
        "diffusion",
        choices=("diffusion", "euclidean", "spectral"),
        help="euclidean: the paper's eq. 7; spectral: the larger half of a normalized cut",
    )
    paper: bool = param(
        False, help="LDR09 by the letter: rule=paper:mode=diffusion:step=1, and noise is not looked for"
    )
    strict: bool = param(False, help="a photo without a dominant texture is an error")
    keep: bool = param(False, help="the photo stays the first part, the mask follows it")
    types: bool = param(False, help="a further part: 1 to 4 for patches of type 0 to III around a pixel, 0 where none")
    score: bool = param(False, help="a further part: density, and the decimal logarithm of heat")
    json: Path | None = param(None, help="the kernel's curve, thresholds, rounds and shares go to this file")
    chart: Path | None = param(
        None, help="a picture of the kernel's curve, and of density over heat with their thresholds, goes to this file"
    )

    PAPER: ClassVar[dict[str, Any]] = {"rule": "paper", "mode": "diffusion", "step": 1}

    def compute(self, session: Session) -> dict[str, Any]:
        """The mask, and what else can be asked for."""
        from ..dominant.photo_mask import photo_mask  # scipy is not loaded before it is needed

        def allowed() -> np.ndarray | None:
            return None if self.mask is None else masked_pixels(self.mask, self.source)

        found = photo_mask(
            self.flag(), self.source, self.working_space, session.resources, session.progress,
            allowed=allowed, patch=self.patch, step=self.step, mode=self.mode, rule=self.rule, strict=self.strict,
        )  # fmt: skip

        def chart() -> np.ndarray:
            from ..charts.dominant_chart import diagnostics

            return diagnostics(found.texture)

        return {
            "dominant": found.part,
            "types": lambda: found.types,
            "score": lambda: found.score,
            "facts": found.facts,
            "chart": chart,
        }
