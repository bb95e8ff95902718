# SPDX-License-Identifier: Apache-2.0
"""--texquilt: a texture of any size from patches of an exemplar, chosen by what they contain."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..core.image import Image, Part
from ..core.op import Kind, Output
from ..core.parameters import image, param
from ..core.source_map import COPIED, ST
from ..errors import ImageError, ParameterError, modifier, present
from ..exemplar.exemplar_op import LABEL, MASK
from ..exemplar.photo_lattice import Structured
from ..quality.report import REPORT, Quality
from ..quality.reported_op import Reported
from ..quilting.guide_map import SOFT, meaning_of, read_table
from ..quilting.quilt_job import CARRIED, Quilted, Sewing, sewn_parts, sewn_whole
from ..quilting.quilt_plan import MOST_PATCH, Plan, Renderer
from ..session import Session


@dataclass(frozen=True, kw_only=True)
class Quilting(Reported, Quilted, Structured):
    """Sew a texture of any size together from patches of a photo, as a stream.

    Image quilting (Efros & Freeman, SIGGRAPH 2001): square patches on a regular grid, each the one that fits what is
    there best, cut along the line where both look most alike. With label maps (of `label`) a guide says what is
    to be where: patches are looked up by their content, the two most frequent labels in them (LSA16: Lockerman,
    Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH
    2016, section 6.1). Every pixel of the result is a copy of one pixel of the photo, and the result does not depend
    on memory or threads. A plan of offsets and cuts is all that is kept, so memory does not grow with the pixels.
    """

    example: ClassVar[str] = '>>> texture = filters.quilt("photo.png", size=(1024, 512), seed=7)'
    name: ClassVar[str] = "quilt"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("quilt", Kind.PIXELS, COPIED),
        ST,
        CARRIED,
        Output("plan", Kind.ARRAYS, "offsets and cuts", asked_by="plan"),
        REPORT,
    )

    mask: Image | None = image(None, help=MASK)  # type: ignore[misc]  # the base class has none
    label: int | None = param(None, ge=1, help=LABEL)  # type: ignore[misc]  # the base class has none
    guide: Image | None = image(
        None, help="what is to be where: ids of labels, or ids or colors that table gives a meaning; of any size"
    )
    table: Path | None = param(
        None, help='JSON: {"255,0,0": 3, "0,0,255": [1, 2]}: which label or key ids or 8-bit colors of the guide mean'
    )
    soft: float = param(0.2, ge=0, le=1, help=SOFT)
    overlap: int | None = param(
        None, ge=4, le=MOST_PATCH // 3, unit="px", help="of neighbors, at most patch / 3; patch / 4 when left out"
    )
    plan: Path | None = param(None, help="the plan goes to this file (.npz): offsets and cuts")
    render: bool = param(
        False, help="make the result from the plan in that file, of the photo or of any map of its size"
    )

    def files(self) -> dict[str, Path]:
        """With render=1 the plan is read."""
        return {name: path for name, path in super().files().items() if name != "plan" or not self.render}

    def compute(self, session: Session) -> dict[str, Any]:
        """The quilt, and what else can be asked for."""
        resources, progress = session.resources, session.progress
        size = self.size or (self.guide or self.exemplar).first.window.size
        quality = Quality.of_copies(self, resources, progress, size)
        if self.render:
            return quality.add_to_copies(self._rendered(session))
        sewing = self._sewing()
        sewing.require_memory(resources)
        return quality.add_to_copies(sewn_whole(sewing, self.read(resources), resources, progress))

    def _sewing(self) -> Sewing:
        if self.guide is not None and self.label is not None:
            raise ParameterError("guide and label both say what patches contain: give one of them")
        if self.table is not None and self.guide is None:
            raise ParameterError("table says what a guide means: say guide, too")
        table = None if self.table is None else read_table(self.table, self.soft)
        return Sewing(
            op=self, guide=self.guide, level=self.level, size=self.size, patch=self.patch, overlap=self.overlap,
            structured=self, meaning=lambda there: meaning_of(present(self.guide).first, table, there),
        )  # fmt: skip

    def _rendered(self, session: Session) -> dict[str, Part]:
        """From a plan."""
        resources = session.resources
        if self.plan is None:
            raise ParameterError(f"{modifier(render=True)} requires plan=FILE")
        planned = self.size, self.mask, self.labels, self.guide, self.label, self.patch, self.overlap
        if any(value is not None for value in planned):
            given = "size, patch, overlap, mask, label, labels and guide"
            raise ParameterError(f"{modifier(render=True)} conflicts with {given}: the plan has them")
        plan, size = Plan.load(self.plan, resources.budget)
        spec = self.exemplar.first.spec
        if size != (spec.width, spec.height):
            raise ImageError(
                f"{self.plan} is of an exemplar of {size[0]}x{size[1]}, {self.exemplar.source} is"
                f" {spec.width}x{spec.height}"
            )
        renderer = Renderer.of(resources.device, plan, resources.budget)
        return sewn_parts(self, renderer.sources, plan.grid, resources)
