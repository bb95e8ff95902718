# SPDX-License-Identifier: Apache-2.0
"""--texcomposite: a non-stationary texture of any size from one photo (LSA16 section 7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..engine.core.image import Image, Part, from_pixels, spec_beside
from ..engine.core.label_map import LabelMap
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import Size, image, param
from ..engine.core.source_map import COPIED, ST
from ..engine.core.window import Domain, Window
from ..engine.deferred import np, oiio
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..engine.session.progress import Progress
from ..engine.session.resources import Resources
from ..synthesis.exemplar.exemplar_masks import label_map
from ..synthesis.exemplar.exemplar_op import MASK
from ..synthesis.patchmatch.patch_search import RANDOM, SEARCH_HELP, SEARCHES
from ..synthesis.quality.report import REPORT, Quality
from ..synthesis.quality.reported_op import Reported
from ..synthesis.quilting.label_growth import cell_side, grow_labels
from ..synthesis.quilting.quilt_job import CARRIED, Quilted, Sewing, sewn_parts

_CELL_BYTES = 400  # approximately, per cell of the grown map and per pixel of the original
_PIXEL_BYTES = 24


@dataclass(frozen=True, kw_only=True)
class Composite(Reported, Quilted):
    """Create a texture of any size that varies as the photo does.

    Use it for a larger area with the same mix of textures as the photo, such as moss on stone. A new label map is
    grown with the proportions and neighborhoods of the map from `label`, and filled with texture from the photo (as
    by `quilt` with the grown map as its guide). Each pixel of the result is a copy of one pixel of the photo.

    Section 7 of LSA16 suggests this (Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale
    Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016).
    """

    example: ClassVar[str] = """\
>>> photo = filters.label("photo.png", photo=True)
>>> texture = filters.composite(photo, size=(1024, 512))
"""
    name: ClassVar[str] = "composite"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("composite", Kind.PIXELS, COPIED),
        ST,
        CARRIED,
        Output("grown", Kind.IDS, "Grown label map, a guide for `quilt` and `paint`.", asked_by="grown"),
        REPORT,
    )

    mask: Image | None = image(None, help=MASK)  # type: ignore[misc]  # the base class has none
    size: Size | None = param(
        None, ge=8, le=1 << 22, unit="px", unset="twice the exemplar's size", help="Size of the result."
    )
    search: str = param(RANDOM, choices=tuple(SEARCHES), help=SEARCH_HELP, advanced=True)
    grown: bool = param(False, help="Append the grown label map as part 'grown'.")

    def plan(self, facts: Facts) -> Plan:
        """The size, the label map, and the measures."""
        spec = self.exemplar.first.spec
        size = self.size or Size(2 * spec.width, 2 * spec.height)
        quality = Quality.of_copies(self, facts, size, judged=False)
        labels = label_map(self.exemplar, self.labellevel)
        Sewing(op=self, guide=None, level=self.labellevel, size=size, patch=self.patch).require_memory(facts)
        side = cell_side(labels.scale, spec.width, spec.height)
        cells = -(-size.width // side) * -(-size.height // side)
        need = _CELL_BYTES * cells + _PIXEL_BYTES * spec.width * spec.height
        facts.require(need, f"growing a label map for {size.width}x{size.height} in cells of {side} px")
        self.require_readable(facts)
        return Plan(work=(size, quality, labels))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The composite, and what other outputs are requested."""
        resources, progress = session.resources, session.progress
        size, quality, labels = plan.work
        quality = quality.during(resources, progress)
        stages = progress.stages(1, 10)
        grown = self._grown(labels, size, resources, next(stages))
        guide = Image((grown,), "the grown label map")
        sewing = Sewing(op=self, guide=guide, level=self.labellevel, size=size, patch=self.patch)
        quilt = sewing.quilt(self.read(resources), resources, next(stages))
        results = quality.add_to_copies(sewn_parts(self, quilt.sources, quilt.grid, resources))
        return {**results, "grown": lambda: _enlarged(grown, results["composite"])}

    def _grown(self, labels: LabelMap, size: Size, resources: Resources, progress: Progress) -> Part:
        """The grown map as an image part of ids."""
        spec = labels.part.spec
        side = cell_side(labels.scale, spec.width, spec.height)
        with resources.stats.time("grow"):
            growth = grow_labels(
                resources.device, labels.ids, side, Domain.tiling(*size, self.tiles), self.seed,
                resources.budget, progress.advance, search=self.search,
            )  # fmt: skip
        height, width = growth.ids.shape
        text = "%s grown to %d x %d cells of %d px; errors: proportions %.1f %%, neighborhoods %.1f %%"
        self.inform(text, labels.part.name, width, height, side, 100 * growth.shares, 100 * growth.neighbors)
        spec = oiio.ImageSpec(width, height, 1, oiio.UINT32)
        spec.channelnames = ("id",)
        return from_pixels("grown", np.ascontiguousarray(growth.ids[..., None]), spec)


def _enlarged(cells: Part, like: Part) -> Part:
    """A map of cells, enlarged to the windows of an image: parts of one file share a display window."""
    ids, whole = cells.pixels(), like.window

    def fetch(window: Window) -> np.ndarray:
        rows, columns = window.inside(whole)
        y = np.arange(rows.start, rows.stop) * len(ids) // whole.height
        x = np.arange(columns.start, columns.stop) * ids.shape[1] // whole.width
        return ids[np.ix_(y, x)]

    return Part(cells.name, spec_beside(like.spec, cells.spec.channelnames), fetch)
