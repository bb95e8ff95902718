# SPDX-License-Identifier: Apache-2.0
"""The base of --texquilt, --texpaint and --texcomposite: quilts of patches chosen by content, LSA16 section 6.1."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...analysis.labels.content_table import (
    TABLE_BYTES,
    ContentTable,
    content_table,
    largest_window,
    patch_side,
    regions,
    whole_windows,
    window_keys,
)
from ...analysis.regularity.courses import Courses
from ...analysis.regularity.lattice import Lattice
from ...engine.color.lab_grid import COARSE_STEPS, to_grid
from ...engine.core.access import Gather
from ...engine.core.demand import MadeRows, SomeRows, first_channels
from ...engine.core.image import Image, derived_spec
from ...engine.core.label_map import LabelMap, label_maps
from ...engine.core.op import Kind, Output
from ...engine.core.parameters import Size, param
from ...engine.core.source_map import SourceMap, Sources, require_addressable, tile_spec
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError, present
from ...engine.opencl.buffers import require_room
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from ..exemplar.exemplar_masks import both, label_levels, label_map
from ..exemplar.exemplar_op import ExemplarPixels, LabeledExemplar, tiles
from ..exemplar.photo_lattice import Structured, fitting_size, least_size
from ..quality.fidelity import Fidelity, fidelity
from .guide_map import Meaning, keys_in, labels_met, meaning_of, wishes_of
from .label_painting import Begun
from .quilt_plan import AT_ONCE, MOST_PATCH, Grid, plan_bytes
from .quilter import MOST_FINER, Demand, Quilt, QuiltExemplar, Rules, cell_memory, folded

CARRIED = Output(
    "label.N", Kind.IDS, "Label parts of the photo, copied from the same source pixels.", asked_by="labelmaps"
)
LEAST_PATCH, _LEAST_GUIDED = 8, 32
_LAB_BYTES, _VALUE_BYTES = 14, 12  # per pixel of the exemplar: on the grid, masks, and reduced; as floats
_GRID_ROWS = 256  # rows converted to the grid at a time
_CANDIDATES = 1024, 256  # patches compared per cell: without and with a guide, which leaves fewer to choose from
FREE_USES = 1.0  # of a region before a price, relative to equal use of all regions; two copies are always free
_JUDGED_WHOLE = 1 << 22  # px of a quilt
_REGIONS = 12  # minimum number of exemplar regions for each label of a guide


@dataclass(frozen=True, kw_only=True)
class Quilted(LabeledExemplar, Gather):
    """A result quilted from patches of a photo."""

    size: Size | None = param(
        None, ge=1, le=1 << 22, unit="px", unset="size of the guide, else of the exemplar", help="Size of the result."
    )
    tiles: str = tiles("none")
    patch: int | None = param(
        None,
        example="32",
        ge=LEAST_PATCH,
        le=MOST_PATCH,
        unit="px",
        unset="the labels' scale or, without labels, shorter side / 8, as a power of two; less if a label is rare",
        help="Side of a patch. Increase it to preserve larger structures, decrease it for more variation.",
    )
    labelmaps: bool = param(
        False, help="Append the label maps of the result as parts label.N, rearranged exactly as its pixels."
    )

    def require_readable(self, facts: Facts) -> None:
        """As `LabeledExemplar.require_readable`, if the content table fits into memory as well."""
        spec = self.exemplar.first.spec
        require_addressable((spec.height, spec.width))
        facts.require(
            (TABLE_BYTES + _LAB_BYTES + self.photo_bytes(facts)) * spec.width * spec.height,
            f"the content table of {spec.width}x{spec.height} px",
            "use a smaller exemplar",
        )
        super().require_readable(facts)

    def holds_photo(self, facts: Facts) -> bool:
        """Whether its values are in memory."""
        return self.holds(facts, _VALUE_BYTES)

    def holds_both(self, facts: Facts) -> bool:
        """Whether its values before and after flattening are in memory."""
        return self.holds(facts, 2 * _VALUE_BYTES)

    def photo_bytes(self, facts: Facts) -> int:
        """Memory per photo pixel for its values and the Lab copy: both only if they fit easily."""
        own = self.exemplar.first.pixel_bytes
        return sum(size for size in (own, _VALUE_BYTES) if self.holds(facts, size))

    def copied_by_rows(self, resources: Resources) -> bool:
        """Whether its pixels are read by rows, in the order of the result, instead of held in memory."""
        return not self.holds(resources, self.exemplar.first.pixel_bytes)


@dataclass(frozen=True, kw_only=True)
class Sewing:
    """Settings of one layer of a result, if they differ from those of its op."""

    op: Quilted
    guide: Image | None
    level: int | None
    size: Size | None
    patch: int | None
    overlap: int | None = None
    structured: Structured | None = None  # the op, if it keeps the exemplar's lattice
    meaning: Callable[[np.ndarray], Meaning] | None = None  # None: ids are labels
    begun: Begun | None = None  # an earlier painting, whose patches are kept where its labels are unchanged

    def quilt(self, pixels: ExemplarPixels, resources: Resources, progress: Progress) -> Quilt:
        """A new quilt: sources, grid, demands and, eventually, its plan."""
        source = self.op.exemplar.first
        width, height = source.spec.width, source.spec.height
        lab, allowed = np.empty((height, width, 3), np.int16), pixels.usable
        for top in range(0, height, _GRID_ROWS):
            lab[top : top + _GRID_ROWS] = to_grid(pixels.values[top : top + _GRID_ROWS], COARSE_STEPS)
        lattice = None
        if self.structured is not None:
            lattice = self.structured.structure_of(pixels, resources)
        with resources.stats.time("content"):
            labels = self._label_map()
            ids = None if labels is None else labels.ids
            grid = self._grid(labels, ids, allowed, lattice)
            rows, columns = grid.shape
            resources.require(cell_memory(grid, self.guide is not None), _task(grid))
            keyed = np.ones((height, width), np.uint8) if self.guide is None else present(ids)
            table = content_table(*window_keys(keyed, grid.patch, allowed), grid.patch)
            demand = self._demand(grid, keyed, table, resources)
        exemplar = QuiltExemplar(lab, table, self._finer(labels), keyed if demand.guide is not None else None)
        self.op.inform("%d x %d patches of %d px, overlap %d px", columns, rows, grid.patch, grid.overlap)
        return Quilt(
            resources.device, exemplar, grid, demand, self._rules(grid.patch), resources.budget,
            held=width * height * self.op.photo_bytes(resources),
            plan=None if self.begun is None else self.begun.kept(grid, demand, self.op.flag()),
            in_step=None if self.structured is None else self.structured.kept_structure(lattice, grid, self.op.seed),
            report=progress.advance,
        )  # fmt: skip

    def require_memory(self, facts: Facts) -> None:
        """Raise an error if the sizes alone exceed the memory budget.

        Labels can only make patches smaller, and so their number larger.
        """
        source, labels = self.op.exemplar.first, self._label_map()
        shorter = min(source.spec.width, source.spec.height)
        patch = self.patch or patch_side((labels.scale if labels else 0) or shorter / 8)
        if patch > shorter:
            return
        size, prescribed = self._asked()
        if self.structured is not None and self.structured.lattice > 0 and not prescribed:
            size = Size(*(max(n, patch) for n in least_size(size, self._wraps)))
        grid = Grid.tiling(*size, self.op.tiles, patch=patch, overlap=self._overlap(patch))
        facts.require(cell_memory(grid, self.guide is not None), _task(grid))
        photo_bytes = source.spec.width * source.spec.height * self.op.photo_bytes(facts)
        if self.structured is not None:
            self.structured.require_lattice(source.spec.height, source.spec.width, facts, photo_bytes)
        windows = (source.spec.width - patch + 1) * (source.spec.height - patch + 1)
        photo = {"exemplar": 6 * source.spec.width * source.spec.height, "key_map": 4 * windows}  # known minimum
        if facts.device_memory is not None:
            require_room(facts.device_memory, photo | plan_bytes(grid, AT_ONCE), facts.budget, _task(grid), photo_bytes)

    def _label_map(self) -> LabelMap | None:
        """The label map of the level, if any parameter needs labels."""
        if all(source is None for source in (self.op.label, self.guide, self.level)):
            return None
        return label_map(self.op.exemplar, self.level)

    def _rules(self, patch: int) -> Rules:
        return Rules(
            seed=self.op.seed,
            candidates=_CANDIDATES[self.guide is not None],
            reach=min(4, patch // 16),
            reuse=FREE_USES,
        )

    def _grid(
        self,
        labels: LabelMap | None,
        ids: np.ndarray | None,
        allowed: np.ndarray | None,
        lattice: Lattice | Courses | None,
    ) -> Grid:
        size = fitting_size(self.op.flag(), lattice, *self._asked(), self._wraps)
        patch, overlap = self._sides(labels, ids, allowed)
        return Grid.tiling(*size, self.op.tiles, patch=patch, overlap=overlap)

    def _asked(self) -> tuple[Size, bool]:
        """The size of the result without regard to a lattice, and whether it is prescribed."""
        like = (self.guide or self.op.exemplar).first.spec
        return self.size or Size(like.width, like.height), self.size is not None or self.guide is not None

    @property
    def _wraps(self) -> tuple[bool, bool]:
        return "x" in self.op.tiles, "y" in self.op.tiles

    def _overlap(self, patch: int) -> int:
        return self.overlap or max(4 if patch >= 12 else patch // 3, patch // 4)

    def _sides(self, labels: LabelMap | None, ids: np.ndarray | None, allowed: np.ndarray | None) -> tuple[int, int]:
        """Side of a patch, and overlap, such that valid patches exist, and several for each of a guide's labels."""
        spec = self.op.exemplar.first.spec
        if ids is not None:
            allowed = both(ids != 0, allowed)
        rho = 0.0 if labels is None else labels.scale
        shorter = min(spec.width, spec.height)
        most = shorter if allowed is None else largest_window(allowed)
        patch = self.patch or patch_side(rho or shorter / 8)
        if patch > most and self.patch is None:
            smaller = 1 << max(0, most.bit_length() - 1)
            if smaller >= LEAST_PATCH:
                self.op.warn("no patch of %d px fits in the valid source pixels; using patch=%d", patch, smaller)
                patch = smaller
        if self.patch is None and self.guide is not None:
            patch = self._guided_side(present(ids), patch)
        if patch > most:
            raise ImageError(
                f"no patch of {patch} px fits in the valid source pixels of {self.op.exemplar.source}:"
                f" the largest square is {most} px",
                hint=f"use patch={most}" if most >= LEAST_PATCH else "",
            )
        return patch, self._overlap(patch)

    def _guided_side(self, ids: np.ndarray, patch: int) -> int:
        """Halve the patch until each of the guide's labels is found in several regions: fewer would repeat."""
        meaning = self._meant(ids)
        wanted = labels_met(present(self.guide).first, meaning)
        while patch > _LEAST_GUIDED:
            block = patch - patch // 4
            if all(regions(whole_windows(ids == label, patch), block) >= _REGIONS for label in wanted):
                break
            patch //= 2
        return patch

    def _demand(self, grid: Grid, ids: np.ndarray, table: ContentTable, resources: Resources) -> Demand:
        """The key of every cell."""
        if self.guide is None:
            return Demand(np.zeros(grid.shape, np.int32))
        meaning = self._meant(ids)
        wishes = wishes_of(self.guide.first, meaning, grid, resources)
        keys, replaced = keys_in(table, wishes.keys)
        if replaced:
            named = ", ".join(f"{a} -> {b}" for a, b in list(replaced.items())[:5])
            more = f" and {len(replaced) - 5} more" if len(replaced) > 5 else ""
            text = "no patch contains these pairs of labels (dominant, second); nearest used: %s%s"
            self.op.warn(text, named, more)
        return Demand(keys, wishes.wanted)

    def _meant(self, ids: np.ndarray) -> Meaning:
        """The labels of the guide's ids or colors."""
        there = np.flatnonzero(np.bincount(ids.ravel()))
        return meaning_of(present(self.guide).first, None, there) if self.meaning is None else self.meaning(there)

    def _finer(self, labels: LabelMap | None) -> tuple[np.ndarray, ...]:
        """Label maps of the levels below."""
        if labels is None:
            return ()
        levels = label_levels(self.op.exemplar).values()
        below = [one for one in levels if one.level < labels.level][-MOST_FINER:]
        return tuple(folded(one.ids) for one in below)


def _task(grid: Grid) -> str:
    return f"quilting {grid.width}x{grid.height} in {math.prod(grid.shape)} patches of {grid.patch} px"


# --- the result ---


def sewn_parts(op: Quilted, read: Callable[[Window], SourceMap], grid: Grid, resources: Resources) -> dict[str, Any]:
    """The op's image from the sources that `read` gives for a window, the sources as 'st', and the label parts."""
    source, size = op.exemplar.first, (grid.width, grid.height)
    # all parts are read for the same windows
    spec = tile_spec(source.spec, "x" * grid.wrap_x + "y" * grid.wrap_y, size)
    by_rows = op.copied_by_rows(resources)
    sources = Sources(functools.lru_cache(1)(read), spec, resources, by_rows=by_rows)

    sewn: dict[str, Any] = sources.parts(op.main().name, op.in_any_order(source, not by_rows))
    labels = {one.part.name for one in label_maps(op.exemplar).values()}
    for part in op.exemplar.parts[1:]:
        alike = (part.spec.width, part.spec.height) == (source.spec.width, source.spec.height)
        if part.name in labels and alike:
            like = derived_spec(part.spec, *size)
            sewn[part.name] = functools.partial(sources.copied, op.in_any_order(part, not by_rows), like)
    return sewn


def sewn_whole(op: Quilted, quilt: Quilt, resources: Resources) -> dict[str, Any]:
    """The result of one layer. If its plan is requested, it is finished first."""
    spec = op.exemplar.first.spec
    plan = {"planfile": lambda: quilt.finished().arrays((spec.width, spec.height))}
    return sewn_parts(op, quilt.sources, quilt.grid, resources) | plan


def fidelity_of_quilt(quilt: Quilt, pixels: ExemplarPixels, original: SomeRows) -> Fidelity | None:
    """Fidelity of a quilt, or of a piece of the photo's size if the quilt is large; None if it is too small.

    `original` (height, width, channels) float32: Lab of the photo before flattening.
    """
    photo, grid = first_channels(pixels.values, 3), quilt.grid
    whole = grid.width * grid.height <= _JUDGED_WHOLE
    size = (grid.width, grid.height) if whole else (min(grid.width, photo.shape[1]), min(grid.height, photo.shape[0]))
    source = quilt.sources(Window(0, 0, *size))
    result = MadeRows((*source.packed.shape, 3), np.float32, lambda first, last: source[first:last].gather(photo))
    return fidelity(
        photo,
        pixels.usable,
        result,
        (whole and grid.wrap_y, whole and grid.wrap_x),
        source,
        first_channels(original, 3),
    )
