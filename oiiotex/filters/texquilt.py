# SPDX-License-Identifier: Apache-2.0
"""--texquilt: image quilting, optionally guided by labels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from ..engine.color.lab import working_values
from ..engine.core.image import Image
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import image, param
from ..engine.core.source_map import COPIED, ST
from ..engine.errors import ImageError, ParameterError, present
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..engine.session.progress import Progress
from ..engine.session.resources import Resources
from ..synthesis.exemplar.exemplar_masks import both, mask_of
from ..synthesis.exemplar.exemplar_op import LABEL, MASK, ExemplarPixels
from ..synthesis.exemplar.first_result import say_fidelity
from ..synthesis.exemplar.flattened import Flattened
from ..synthesis.exemplar.photo_lattice import Structured
from ..synthesis.quality.judged_tries import Try, best_tried
from ..synthesis.quality.report import REPORT, Quality
from ..synthesis.quality.reported_op import Reported
from ..synthesis.quilting.guide_map import meaning_of, read_table
from ..synthesis.quilting.quilt_job import CARRIED, Quilted, Sewing, fidelity_of_quilt, sewn_parts, sewn_whole
from ..synthesis.quilting.quilt_plan import MOST_PATCH, QuiltPlan, Renderer
from ..synthesis.quilting.quilter import Quilt


@dataclass(frozen=True, kw_only=True)
class Quilting(Reported, Quilted, Structured, Flattened):
    """Synthesize a texture of any size from patches of a photo, joined along minimum-error cuts.

    Image quilting (Efros & Freeman, SIGGRAPH 2001) places square patches on a regular grid. Each patch is the best
    match for its neighbors, and is cut along the path of least difference.

    With label maps, a guide controls the layout: patches are selected by their content, the two most
    frequent labels in them (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map
    Extraction for Texture Synthesis, SIGGRAPH 2016, section 6.1).

    Gradients and stains of the photo are removed first. Every pixel of the result is then a copy of one pixel. Only a
    plan of offsets and cuts is kept in memory, so memory does not grow with the number of pixels.
    """

    example: ClassVar[str] = '>>> texture = filters.quilt("photo.png", size=(1024, 512), seed=7)'
    name: ClassVar[str] = "quilt"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("quilt", Kind.PIXELS, COPIED),
        ST,
        CARRIED,
        Output("planfile", Kind.ARRAYS, "Plan of the quilt: offsets and cuts.", asked_by="planfile"),
        REPORT,
    )

    mask: Image | None = image(None, help=MASK)  # type: ignore[misc]  # the base class has none
    label: int | None = param(None, example="3", ge=1, help=LABEL)  # type: ignore[misc]  # the base class has none
    guide: Image | None = image(
        None,
        help="Image of any size that controls the layout. Its pixels are label ids, or ids or colors that `palette`"
        " maps to labels.",
    )
    palette: Path | None = param(
        None,
        example="table.json",
        advanced=True,
        help='JSON file that maps ids or 8-bit colors of the guide to labels or pairs of labels: {"255,0,0": 3,'
        ' "0,0,255": [1, 2]}.',
    )
    planfile: Path | None = param(
        None, example="plan.npz", advanced=True, help="File (.npz) to write the plan (offsets and cuts) to."
    )
    fromplan: Path | None = param(
        None,
        example="plan.npz",
        advanced=True,
        help="Plan of an earlier run to render instead of computing one. The exemplar may be another map of the same"
        " size.",
    )

    def plan(self, facts: Facts) -> Plan:
        """The measures, and how to quilt: the plan to render, or the patches to choose."""
        size = self.size or (self.guide or self.exemplar).first.window.size
        quality = Quality.of_copies(self, facts, size, judged=self.guide is None)
        if self.fromplan is not None:
            return Plan(work=(quality, self._stored(self.fromplan, facts)))
        sewing = self._sewing()
        sewing.require_memory(facts)
        self.require_readable(facts)
        return Plan(work=(quality, sewing))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The quilt and its further outputs."""
        resources, (progress,) = session.resources, session.progress.stages(1)  # a second try lengthens it
        quality, sewing = plan.work
        quality = quality.during(resources, progress)
        if isinstance(sewing, QuiltPlan):
            renderer = Renderer.of(resources.device, sewing, resources.budget)
            return quality.add_to_copies(sewn_parts(self, renderer.sources, sewing.grid, resources))
        op = self._flat(resources)
        sewing, pixels = replace(sewing, op=op, structured=op), op.read(resources)
        if self.guide is not None:  # a painting is not to look like the photo
            made = sewing.quilt(pixels, resources, progress)
        else:
            own = working_values(self.exemplar, resources, self.working_space, self.holds_both(resources))[0]
            tries = self._tries(sewing, pixels, resources, progress)
            best = best_tried(self.flag(), tries, lambda quilt: fidelity_of_quilt(quilt, pixels, own), progress)
            say_fidelity(self.flag(), best.kept, best.spelled, warn=self.patch is None)
            made = best.made
        return quality.add_to_copies(sewn_whole(op, made, resources), copied=op.exemplar)

    @property
    def _is_alone(self) -> bool:
        """Whether no labels decide the result."""
        return not any((self.guide, self.label, self.labellevel))

    def _flat(self, resources: Resources) -> Quilting:
        """The op on the flattened photo, without its stains."""
        allowed = self._allowed()
        alone = self._is_alone and self.planfile is None
        flat, stained = self.flattened(self.exemplar, alone, resources, allowed)
        mask = self.mask if stained is None else mask_of(present(both(~stained, allowed)), self.exemplar.first)
        return replace(self, exemplar=flat, mask=mask, flattening=0.0)

    def _tries(
        self, sewing: Sewing, pixels: ExemplarPixels, resources: Resources, progress: Progress
    ) -> Iterator[Try[Quilt]]:
        """Patches of the default side or the given one; if neither it nor labels are given, also twice as large."""
        first = sewing.quilt(pixels, resources, progress)
        side = first.grid.patch
        yield Try(f"patch={side}", lambda _: first)
        if self.patch is None and self._is_alone and 2 * side <= min(MOST_PATCH, *pixels.values.shape[:2]):
            larger = replace(sewing, patch=2 * side)
            yield Try(f"patch={2 * side}", lambda _: larger.quilt(pixels, resources, progress))

    def _sewing(self) -> Sewing:
        if self.guide is not None and self.label is not None:
            raise ParameterError("guide conflicts with label; set only one of them")
        if self.palette is not None and self.guide is None:
            raise ParameterError("palette requires guide")
        table = None if self.palette is None else read_table(self.palette)
        return Sewing(
            op=self, guide=self.guide, level=self.labellevel, size=self.size, patch=self.patch, structured=self,
            meaning=lambda there: meaning_of(present(self.guide).first, table, there),
        )  # fmt: skip

    def _stored(self, path: Path, facts: Facts) -> QuiltPlan:
        """The plan to render."""
        planned = self.size, self.mask, self.guide, self.label, self.patch, self.planfile
        if any(value is not None for value in planned):
            names = "size, patch, mask, label, guide and planfile"
            raise ParameterError(f"fromplan conflicts with {names}: the plan contains them")
        plan, size = QuiltPlan.load(path, facts.budget)
        spec = self.exemplar.first.spec
        if size != (spec.width, spec.height):
            raise ImageError(
                f"{path} requires an exemplar of {size[0]}x{size[1]}, but {self.exemplar.source} is"
                f" {spec.width}x{spec.height}"
            )
        return plan
