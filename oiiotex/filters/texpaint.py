# SPDX-License-Identifier: Apache-2.0
"""--texpaint: texture from a painting of labels (LSA16 section 6.2, figure 15)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..engine.core.image import Image
from ..engine.core.label_map import opened_level
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import Size, image, param
from ..engine.core.source_map import COPIED, ST
from ..engine.errors import ParameterError, present
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..synthesis.exemplar.exemplar_masks import label_levels
from ..synthesis.quality.report import REPORT, Quality
from ..synthesis.quality.reported_op import Reported
from ..synthesis.quilting.guide_map import read_table
from ..synthesis.quilting.label_painting import painting_arrays, read_begun
from ..synthesis.quilting.painted_layers import LayeredPainting
from ..synthesis.quilting.quilt_job import CARRIED, Quilted, sewn_parts


@dataclass(frozen=True, kw_only=True)
class Paint(Reported, Quilted):
    """Turn a painting of labels into a texture, at one or two scales.

    Areas painted with label 3 are filled with the photo's texture of label 3, by guided quilting (`quilt`). An
    optional second painting, `fine`, overlays labels of the next finer level; where it is empty (black, id 0 or alpha
    0), the first painting applies (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale
    Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 6.2). palette=FILE from `palette` maps colors to
    labels; paintings of ids do not need it. To edit a result, write planfile=FILE and pass it as fromplan=FILE to
    the next run: patches whose labels did not change are kept, so pixels elsewhere are bit-identical.
    """

    example: ClassVar[str] = """\
>>> import numpy as np
>>> photo = filters.label("photo.png", photo=True)
>>> painting = np.ones((300, 400), np.uint32)  # label 1 everywhere
>>> texture = filters.paint(photo, painting)
"""
    name: ClassVar[str] = "paint"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("paint", Kind.PIXELS, COPIED),
        ST,
        CARRIED,
        Output("planfile", Kind.ARRAYS, "Painted labels and the patches used for them.", asked_by="planfile"),
        REPORT,
    )

    painting: Image = image(help="Painting of any size: label ids, or colors that `palette` maps to labels.")
    fine: Image | None = image(None, help="Painting of labels of the next finer level, overlaid on the first.")
    labellevel: int | None = param(
        None,
        example="2",
        ge=1,
        unset="the table's level, else the coarsest with several labels",
        help="Level of the painted labels: N of label.N.",
    )
    palette: Path | None = param(
        None, example="palette.json", help="JSON table from `palette` (its facts), which maps colors to labels."
    )
    size: Size | None = param(
        None, ge=8, le=1 << 22, unit="px", unset="the painting's size", help="Size of the result."
    )
    planfile: Path | None = param(
        None, example="plan.npz", help="File (.npz) to write for a later edit: the next run reads it with `fromplan`."
    )
    fromplan: Path | None = param(
        None, example="plan.npz", help="Plan of an earlier run. Patches whose labels did not change are kept."
    )

    def plan(self, facts: Facts) -> Plan:
        """The measures, and the layers with the quilting of the first."""
        if self.fromplan is not None and self.fine is None and present(read_begun(self.fromplan, facts.budget)).fine:
            self.inform("%s has a fine painting, which this run does not overlay", self.fromplan)
        asked = self.size or self.painting.first.window.size
        quality = Quality.of_copies(self, facts, asked, painted=True, judged=False)
        table = None if self.palette is None else read_table(self.palette)
        levels = label_levels(self.exemplar)
        level = self.labellevel or (table.level if table else None) or opened_level(levels)
        layered = LayeredPainting(self, self.painting, self.fine, levels, level, table, self.size, self.fromplan)
        coarse = layered.coarse(facts.budget)
        coarse.require_memory(facts)
        if self.fine is not None and level - 1 not in levels:
            raise ParameterError(f"requires label.{level - 1}, which the exemplar does not have", parameter="fine")
        self.require_readable(facts)
        return Plan(work=(quality, layered, coarse))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The texture, and what other outputs are requested."""
        resources, progress = session.resources, session.progress
        quality, layered, coarse = plan.work
        quality = quality.during(resources, progress)
        layers, sources = layered.quilted(coarse, self.read(resources), resources, progress)
        spec, grid = self.exemplar.first.spec, layers[""].grid
        patches = {"planfile": lambda: painting_arrays(layers, (spec.width, spec.height))}
        parts = sewn_parts(self, sources, grid, resources) | patches
        return quality.add_to_copies(parts, lambda: layered.painted(Size(grid.width, grid.height)))
