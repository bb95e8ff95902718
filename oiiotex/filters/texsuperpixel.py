# SPDX-License-Identifier: Apache-2.0
"""--texsuperpixel: superpixels at any scale, of an image of any size."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ..analysis.superpixels.hierarchy import Hierarchy, hierarchy
from ..analysis.superpixels.superpixels import (
    LEAST_SIGMA,
    Superpixels,
    compactness_param,
    label_part,
    require_superpixels,
    superpixels,
)
from ..engine.color.lab import InLab, color_to_convert, lens_of
from ..engine.core.access import ScanThenMap
from ..engine.core.attributes import SIGMA, SUPERPIXELS
from ..engine.core.image import Image, Part
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import image, param
from ..engine.deferred import np, oiio
from ..engine.errors import ParameterError, present
from ..engine.session import Session
from ..engine.session.facts import Facts


@dataclass(frozen=True, kw_only=True)
class Superpixel(InLab, ScanThenMap):
    """Segment an image into superpixels: small connected regions of similar color.

    Fine superpixels are computed by SLIC in Lab. They are merged into coarser ones by their blurred colors, so
    every coarse border is also a fine border (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier,
    Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 3).

    The result is a label map. Ids start at 1, in the order of their first pixels; transparent pixels have id 0. The
    result does not depend on the memory budget.
    """

    example: ClassVar[str] = """\
>>> ids = filters.superpixel("photo.png", count=100)
>>> view = filters.labelview(ids)
"""
    name: ClassVar[str] = "superpixel"
    carries: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("photo", Kind.PIXELS, "Photo, as the first part.", asked_by="photo", of="source"),
        Output("superpixels", Kind.IDS, "One channel of ids, in the image's windows. Write it to EXR or TIFF."),
    )

    source: Image = image(help="Image to segment.")
    sigma: float | None = param(
        None,
        example="32",
        ge=1,
        le=1e6,
        unit="px",
        unset="the finest level",
        help="Scale of the superpixels, rounded to the nearest level. Increase it for larger superpixels.",
    )
    count: int | None = param(None, example="400", ge=1, help="Number of superpixels, used instead of sigma.")
    sigmamin: float | None = param(
        None,
        example="16",
        ge=2,
        le=1e5,
        unit="px",
        unset=f"shorter side / 50, at least {LEAST_SIGMA:g}",
        help="Scale of the smallest superpixels, from which coarser ones are merged. Reduce it if thin details are"
        " lost.",
    )
    compactness: float | None = compactness_param()
    paper: bool = param(
        False,
        help="Settings of the paper (LSA16 section 3): compactness=20, the best of ten SLIC runs, superpixels of at"
        " least 25 px, and seeds of large images refined on all pixels.",
    )
    photo: bool = param(False, help="Keep the image as the first part, followed by the label map.")

    PAPER: ClassVar[dict[str, Any]] = {"compactness": 20.0}

    def plan(self, facts: Facts) -> Plan:
        """Nothing but the declared output."""
        if self.sigma is not None and self.count is not None:
            raise ParameterError("sigma conflicts with count; set only one of them")
        color_to_convert(self.source, facts, self.working_space)
        require_superpixels(self.source.first, facts, self.sigmamin, self.paper)
        return Plan()

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        """The label map."""
        resources, progress = session.resources, session.progress
        lens = lens_of(self.source, resources, self.working_space)
        finest = superpixels(
            self.source, lens, resources, sigma=self.sigmamin, compactness=self.compactness,
            runs=10 if self.paper else 1, minsize=25 if self.paper else None, literal=self.paper,
            powers=False, advance=progress.advance,
        )  # fmt: skip
        sigma, partition = finest.sigma, np.arange(finest.count)
        if self.sigma is not None or self.count is not None:
            sigma, partition = self._level(finest, hierarchy(finest, resources))
        count = int(partition.max(initial=-1)) + 1
        self.inform("%d superpixels of scale %.1f px, compactness=%g", count, sigma, finest.compactness)
        part = label_part(self.source.first, finest.runs.relabeled(partition))

        def mark(spec: oiio.ImageSpec) -> None:
            spec.attribute(SIGMA, float(sigma))
            spec.attribute(SUPERPIXELS, count)

        # without the photo it takes the photo's name
        name = part.name if self.photo else self.source.first.name
        return {"superpixels": replace(part.respecced(mark), name=name)}

    def _level(self, finest: Superpixels, levels: Hierarchy) -> tuple[float, np.ndarray]:
        """The scale and partition nearest to the requested ones."""
        if self.count is None:
            level = levels.level_of(present(self.sigma))
            return float(levels.sigmas[level]), levels.partition(level)
        count = min(max(self.count, int(levels.counts[-1])), finest.count)
        if count != self.count:
            text = "count=%d is out of range; using %d (levels have %d to %d superpixels)"
            self.warn(text, self.count, count, levels.counts[-1], finest.count)
        return float(np.sqrt(finest.sizes.sum() / count)), levels.partition_of(count)
