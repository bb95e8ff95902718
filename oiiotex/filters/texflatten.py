# SPDX-License-Identifier: Apache-2.0
"""--texflatten: remove gradients of light and stains from a photo of any size."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from ..analysis.drift.flattening import DEFAULT_RADIUS, DRIFT, DRIFT_HELP, Flattening, correction_part
from ..engine.color.lab import color_to_convert
from ..engine.core.access import ScanThenMap
from ..engine.core.image import Image, Part, derived_spec
from ..engine.core.op import Kind, Output, Plan, Space, no_pixels
from ..engine.core.parameters import image, param
from ..engine.core.tiling import TILED, tiled_spec, tiling_of
from ..engine.errors import ParameterError
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..synthesis.exemplar.exemplar_masks import laid_over, masked_pixels
from ..synthesis.exemplar.exemplar_op import MASK


@dataclass(frozen=True, kw_only=True)
class Flatten(ScanThenMap):
    """Remove low-frequency variation (gradients of light, stains) from an image.

    Local level and local contrast of lightness, as medians over a disc, are matched to those of the whole image. Color
    follows as light changes it. Structures smaller than the disc are kept; larger stains are removed, including their
    rims. Different materials keep their colors. Memory does not grow with the image.
    """

    example: ClassVar[str] = '>>> flat = filters.flatten("photo.png", flattening=0.5)'
    name: ClassVar[str] = "flatten"
    carries: ClassVar[bool] = True
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("flat", Kind.PIXELS, "Flattened image, in its own color space and type. Other channels are copied."),
        DRIFT,
    )

    source: Image = image(help="Image to flatten.")
    mask: Image | None = image(None, help=MASK)
    radius: float | None = param(
        None,
        ge=1,
        le=1e6,
        unit="px",
        unset=f"{DEFAULT_RADIUS} x longer side",
        example="200",
        help="Radius of the disc. Smaller structures are kept. Reduce it if stains remain, increase it if the texture"
        " looks flat.",
    )
    flattening: float = param(1.0, ge=0, le=1, help="Fraction of the low-frequency variation to remove.")
    localcontrast: float = param(
        1.0,
        ge=0,
        le=1,
        help="Fraction of the variation in local contrast to remove. Reduce it if dark joints become gray.",
    )
    shadows: bool = param(
        False,
        help="First remove a cast shadow with its penumbra. A photo in which none is sure is not changed by it. With"
        " flattening=0, nothing else is removed.",
    )
    tiled: str | None = TILED
    tone: str = param(
        "photo",
        choices=("photo", "gray"),
        help="Overall color of the result. photo: the median of the photo's local levels; gray: middle gray"
        " (L 50, a 0, b 0), which makes photos comparable.",
    )
    drift: bool | Path = param(False, help=DRIFT_HELP)
    data: bool = param(False, advanced=True, help="Treat the channels as data, not color.")

    def plan(self, facts: Facts) -> Plan:
        """The image and its correction, without pixels."""
        color_to_convert(self.source, facts, self.working_space)
        if self.mask is not None:
            laid_over(self.mask.first, self.source, "mask")
        part = self.source.first
        if self.shadows:
            self._check_shadows(facts)
        spec = tiled_spec(derived_spec(part.spec), self.tiled or tiling_of(part.spec))
        flat = replace(part, spec=spec, fetch=no_pixels, levels=(), ready=False)
        return Plan({"flat": flat, "drift": replace(correction_part(None, part), fetch=no_pixels)})

    def _check_shadows(self, facts: Facts) -> None:
        if color_to_convert(self.source, facts, self.working_space) is None:
            raise ParameterError("requires a color image, not data", parameter="shadows", value=1)
        if (self.tiled or tiling_of(self.source.first.spec)) != "none":
            raise ParameterError("conflicts with an image that tiles", parameter="shadows", value=1)

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """The first part flattened."""
        tiling = self.tiled or tiling_of(self.source.first.spec)
        how = Flattening(
            radius=self.radius,
            amount=self.flattening,
            contrast=self.localcontrast,
            centered=self.tone == "gray",
            wraps=("y" in tiling, "x" in tiling),
        )
        usable = None if self.mask is None else masked_pixels(self.mask, self.source)
        resources, progress = session.resources, session.progress
        source = self.source
        if self.shadows:
            from ..analysis.shadows.relighting import without_shadow  # not needed for help

            lit = without_shadow(self.flag(), source, self.working_space, resources, progress, usable)
            source = Image((lit, *source.parts[1:]), source.source)
        flat, drift, _ = how.of(self.flag(), source, self.working_space, resources, progress, usable)
        return {"flat": replace(flat, spec=plan.results["flat"].spec, levels=()), "drift": drift}
