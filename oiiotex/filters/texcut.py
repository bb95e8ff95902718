# SPDX-License-Identifier: Apache-2.0
"""--texcut: graph-cut textures, KSE03 and LSA16 section 5.2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from ..analysis.regularity.lattice import bytes_needed as lattice_bytes
from ..engine.core.access import InBands
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import Size, param
from ..engine.core.source_map import COPIED, ST, require_addressable
from ..engine.errors import ImageError
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..synthesis.exemplar.exemplar_op import ExemplarOp, tiles
from ..synthesis.exemplar.photo_lattice import Structured, fitting_size, least_size
from ..synthesis.quality.report import REPORT, Quality
from ..synthesis.quality.reported_op import Reported

if TYPE_CHECKING:
    from ..synthesis.graphcut.placement import Layout

_MASK_BYTES, _LAB_BYTES, _SEEN_BYTES = 3, 12, 28  # per pixel of the photo; _SEEN_BYTES where it is in memory
_PATCHES_ALONG = 64  # most patches along the longer side, unless patch says more


@dataclass(frozen=True, kw_only=True)
class Cut(Reported, ExemplarOp, Structured, InBands):
    """Synthesize a texture from large patches of a photo, joined along minimum-error seams (graph cuts).

    Graph-cut textures (KSE03: Kwatra, Schoedl, Essa, Turk, Bobick, Graphcut Textures, SIGGRAPH 2003): matching patches
    are placed one after another, and each is cut against the existing texture along the cheapest seam of any shape.
    With passes=1, further patches cover visible seams. With label=3, only pixels of label 3 are used (LSA16:
    Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis,
    SIGGRAPH 2016, section 5.2). Each pixel of the result is a copy of one pixel of the photo.
    """

    example: ClassVar[str] = """\
>>> photo = filters.label("photo.png", photo=True)
>>> tile = filters.cut(photo, label=1)
"""
    name: ClassVar[str] = "cut"
    outputs: ClassVar[tuple[Output, ...]] = (Output("cut", Kind.PIXELS, COPIED), ST, REPORT)

    size: Size | None = param(None, ge=5, le=16384, unit="px", unset="the exemplar's size", help="Size of the result.")
    tiles: str = tiles("xy")
    patch: int | None = param(
        None,
        example="21",
        ge=5,
        le=512,
        unit="px",
        unset="shorter side of the exemplar / 5, at least 16 and longer side / 64, at most 96",
        help="Side of a patch. Increase it to preserve larger structures.",
    )
    passes: int = param(
        0,
        ge=0,
        le=100,
        example="1",
        help="Number of refinement passes. Each pass adds as many patches as the first fill, over the most visible"
        " seams. Increase it if seams are visible.",
    )

    def plan(self, facts: Facts) -> Plan:
        """The size, and the measures."""
        spec = self.exemplar.first.spec
        size = self.size or Size(spec.width, spec.height)
        quality = Quality.of_copies(self, facts, size)
        require_addressable((spec.height, spec.width))
        self._layout(least_size(size, self._wraps) if self.size is None and self.lattice > 0 else size, facts)
        self.require_readable(facts)
        return Plan(work=(size, quality))

    @property
    def _wraps(self) -> tuple[bool, bool]:
        return "x" in self.tiles, "y" in self.tiles

    def _layout(self, size: Size, facts: Facts) -> Layout:
        """The layout of patches; refuses what exceeds the memory budget."""
        from ..synthesis.graphcut.placement import Layout, bytes_needed  # scipy is not loaded before it is needed

        spec = self.exemplar.first.spec
        least = max(16, max(spec.width, spec.height) // _PATCHES_ALONG)  # else a long strip takes them by thousands
        patch = self.patch or min(96, max(least, min(spec.width, spec.height) // 5))
        layout = Layout.tiling(*size, self.tiles, patch=patch, passes=self.passes, seed=self.seed)
        needed = bytes_needed(layout, (spec.height, spec.width), facts.budget, facts.thread_count)
        needed = max(needed, lattice_bytes(spec.height, spec.width) if self.lattice else 0)
        held = _SEEN_BYTES + self.exemplar.first.pixel_bytes if self.holds_photo(facts) else 0
        facts.require(
            needed + spec.width * spec.height * (_MASK_BYTES + held),
            f"cutting {size} from {spec.width}x{spec.height}",
            "reduce the size of the result or of the photo",
        )
        return layout

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The texture and its source coordinates."""
        from ..synthesis.graphcut.placement import graph_cut

        resources, progress = session.resources, session.progress
        size, quality = plan.work
        seen = self.read(resources)
        if seen.usable is not None and not seen.usable.any():
            raise ImageError(f"no pixel of {self.exemplar.source} is free of {seen.why}")
        lattice = self.lattice_of(seen.values, seen.usable, resources)
        size = fitting_size(self.flag(), lattice, size, self.size is not None, self._wraps)
        layout = self._layout(size, resources)
        with resources.stats.time("cut"):
            in_step = self.in_step(lattice, layout, self.seed)
            source = graph_cut(
                seen.values, seen.usable, layout, resources.budget, progress.advance, in_step, resources.spread
            )
        held = self.holds_photo(resources)
        photo = self.in_any_order(self.exemplar.first, held)
        quality = quality.during(resources, progress)
        return quality.add_to_copies(source.parts("cut", photo, self.tiles, by_rows=not held))

    def holds_photo(self, facts: Facts) -> bool:
        """Whether the photo and its Lab values are held in memory."""
        return self.holds(facts, max(_LAB_BYTES, self.exemplar.first.pixel_bytes))
