# SPDX-License-Identifier: Apache-2.0
"""--texpaint: texture from a painting of labels (LSA16 section 6.2, figure 15)."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..engine.core.demand import MadeRows, SomeRows
from ..engine.core.image import Image, Part
from ..engine.core.label_map import opened_level
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import Size, image, param
from ..engine.core.source_map import COPIED, ST
from ..engine.core.window import Window
from ..engine.deferred import np, oiio
from ..engine.errors import ParameterError, present
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..synthesis.exemplar.exemplar_masks import label_levels
from ..synthesis.graphcut.seam_overlay import TILE, SeamOverlay
from ..synthesis.quality.report import REPORT, Quality
from ..synthesis.quality.reported_op import Reported
from ..synthesis.quilting.guide_map import SOFT, Meaning, Table, meaning_of, read_table
from ..synthesis.quilting.label_painting import painted_labels, painting_arrays, read_begun
from ..synthesis.quilting.quilt_job import CARRIED, Quilted, Sewing, sewn_parts
from ..synthesis.quilting.quilter import Quilt


@dataclass(frozen=True, kw_only=True)
class Paint(Reported, Quilted):
    """Turn a painting of labels into a texture, at one or two scales.

    Areas painted with label 3 are filled with the photo's texture of label 3, by guided quilting (`quilt`). An
    optional second painting, `fine`, overlays labels of the next finer level; where it is empty (black, id 0 or alpha
    0), the first painting applies (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale
    Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 6.2). table=FILE from `palette` maps colors to
    labels; paintings of ids do not need it. To edit a result, write plan=FILE and pass it as previous=FILE to the next
    run: patches whose labels did not change are kept, so pixels elsewhere are bit-identical.
    """

    example: ClassVar[str] = """\
>>> import numpy as np
>>> photo = filters.label("photo.png", keep=True)
>>> painting = np.ones((300, 400), np.uint32)  # label 1 everywhere
>>> texture = filters.paint(photo, painting)
"""
    name: ClassVar[str] = "paint"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("paint", Kind.PIXELS, COPIED),
        ST,
        CARRIED,
        Output("plan", Kind.ARRAYS, "Painted labels and the patches used for them.", asked_by="plan"),
        REPORT,
    )

    painting: Image = image(help="Painting of any size: label ids, or colors that table maps to labels.")
    fine: Image | None = image(None, help="Painting of labels of the next finer level, overlaid on the first.")
    level: int | None = param(
        None,
        example="2",
        ge=1,
        unset="the table's level, else the coarsest with several labels",
        help="Level of the painted labels: N of label.N.",
    )
    table: Path | None = param(
        None, example="palette.json", help="JSON table from `palette`, which maps colors to labels."
    )
    tolerance: float = param(0.2, ge=0, le=1, advanced=True, help=SOFT)
    size: Size | None = param(
        None, ge=8, le=1 << 22, unit="px", unset="the painting's size", help="Size of the result."
    )
    plan: Path | None = param(
        None, example="plan.npz", help="File (.npz) to write for a later edit: the next run reads it with `previous`."
    )
    previous: Path | None = param(
        None, example="plan.npz", help="Plan of an earlier run. Patches whose labels did not change are kept."
    )

    def planned(self, facts: Facts) -> Plan:
        """The measures, the table, the labels by level, the painted level, and its quilting."""
        if self.previous is not None and self.fine is None and present(read_begun(self.previous, facts.budget)).fine:
            self.inform("%s has a fine painting, which this run does not overlay", self.previous)
        asked = self.size or self.painting.first.window.size
        quality = Quality.of_copies(self, facts, asked, painted=True)
        table = None if self.table is None else read_table(self.table, self.tolerance)
        levels = label_levels(self.exemplar, self.labels)
        level = self.level or (table.level if table else None) or opened_level(levels)
        coarse = self._sewing(level, self.painting, self.size, table, "", facts.budget)
        coarse.require_memory(facts)
        if self.fine is not None and level - 1 not in levels:
            raise ParameterError(f"requires label.{level - 1}, which the exemplar does not have", parameter="fine")
        self.require_readable(facts)
        return Plan(work=(quality, table, levels, level, coarse))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The texture, and what other outputs are requested."""
        resources, progress = session.resources, session.progress
        quality, table, levels, level, coarse = plan.work
        quality = quality.during(resources, progress)
        seen, stages = self.read(resources), progress.stages(*[1] * (1 + (self.fine is not None)))
        base = coarse.quilt(seen, resources, next(stages))
        layers, sources = {"": base}, base.sources
        if self.fine is not None:
            ids, fine = levels[level - 1].ids, self.fine.first
            size = Size(base.grid.width, base.grid.height)
            painted = painted_labels(fine, _meaning(fine, table, np.unique(ids), fine=True), size)
            guide = Image((_overpainted(base, ids, painted),), self.fine.source)
            sewing = self._sewing(level - 1, guide, size, table, "fine_", resources.budget)
            layers["fine_"] = over = sewing.quilt(seen, resources, next(stages))
            from ..synthesis.graphcut.photo import Photo

            lab = Photo.of(seen.values, None, resources.budget).lab
            joined = SeamOverlay(
                lab, base.sources, lambda w: (painted(w) > 0, over.sources(w)),
                Window(0, 0, *size), min(TILE // 4, over.grid.patch // 4),
            )  # fmt: skip
            sources = functools.partial(joined.sources, cache=resources.cache)
        spec = self.exemplar.first.spec
        patches = {"plan": lambda: painting_arrays(layers, (spec.width, spec.height))}

        def labels() -> tuple[np.ndarray, SomeRows]:
            ids, first, (width, height) = levels[level].ids, self.painting.first, (base.grid.width, base.grid.height)
            read = painted_labels(first, _meaning(first, table, np.unique(ids)), Size(width, height), strict=False)
            return ids, MadeRows((height, width), np.int64, lambda top, end: read(Window(0, top, width, end)))

        return quality.add_to_copies(sewn_parts(self, sources, base.grid, resources) | patches, labels)

    def _sewing(
        self, level: int, guide: Image, size: Size | None, table: Table | None, prefix: str, budget: int
    ) -> Sewing:
        """The quilting of one layer: the labels of its colors, and the patches to keep."""
        begun = None if self.previous is None else read_begun(self.previous, budget, prefix)
        patch, overlap = self.patch, None
        if begun is not None and patch is None:  # an edit keeps the patch size
            patch, overlap = begun.plan.grid.patch, begun.plan.grid.overlap
        return Sewing(
            op=self, guide=guide, level=level, size=size, patch=patch, overlap=overlap, begun=begun,
            meaning=lambda there: _meaning(guide.first, table, there),
        )  # fmt: skip


def _meaning(painting: Part, table: Table | None, ids: np.ndarray, fine: bool = False) -> Meaning:
    """Labels of a painting: colors by the table, ids as they are."""
    return meaning_of(painting, None if painting.spec.nchannels == 1 else table, ids, fine)


def _overpainted(base: Quilt, ids: np.ndarray, painted: Callable[[Window], np.ndarray]) -> Part:
    """Labels of the finer level: those painted, else those of the coarse layer's sources."""
    spec = oiio.ImageSpec(base.grid.width, base.grid.height, 1, oiio.UINT32)
    spec.channelnames = ("id",)

    def fetch(window: Window) -> np.ndarray:
        chosen = painted(window)
        return np.where(chosen > 0, chosen, base.sources(window).gather(ids)).astype(np.uint32)[..., None]

    return Part("fine", spec, fetch, spec.format, exact=True)
