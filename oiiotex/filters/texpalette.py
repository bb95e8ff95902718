# SPDX-License-Identifier: Apache-2.0
"""--texpalette: swatches of all labels of a texture (LSA16 section 6.2)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..analysis.labels.content_scan import CELL, areas_of, fullest_windows
from ..analysis.labels.content_table import largest_window
from ..analysis.labels.legend import Legend
from ..engine.core.access import InBands
from ..engine.core.label_map import LabelMap
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import param
from ..engine.core.source_map import ST, SourceMap
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.errors import ImageError
from ..engine.io.paint_palette import Swatch
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..engine.session.resources import Resources
from ..synthesis.exemplar.exemplar_masks import label_levels, label_map
from ..synthesis.exemplar.exemplar_op import ExemplarPixels, LabeledExemplar
from ..synthesis.patchmatch.optimization import synthesize
from ..synthesis.patchmatch.recipe import Recipe

_PATCHES = (11, 9, 7, 5)  # px
_REACH = 1024  # px: least side of the window of the photo from which a swatch is synthesized
_MASK_BYTES, _SEEN_BYTES, _SWATCH_BYTES = 3, 24, 90  # per pixel: of the photo (2 values), of the window of a swatch
_ITERATIONS = 12
_CHILDREN = 8  # of each label, the largest


@dataclass(frozen=True, kw_only=True)
class Palette(LabeledExemplar, InBands):
    """Create a chart of the labels of a texture: a row for each label, with its sublabels.

    A row starts with texture synthesized from the pixels of one label only. To its right are its children on the next
    finer level (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for
    Texture Synthesis, SIGGRAPH 2016, section 6.2, figures 13 and 14). The largest label is on top. facts=FILE writes
    the table for `paint`: id, name, paint color, area, parent, children and position in the chart of each label.
    paints=FILE writes the colors as a palette for painting programs.
    """

    example: ClassVar[str] = """\
>>> photo = filters.label("photo.png", photo=True)
>>> sheet = filters.palette(photo)
"""
    name: ClassVar[str] = "palette"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("palette", Kind.PIXELS, "Rows of texture, copied from the photo, in its own color space and type."),
        ST,
        Output(
            "paints", Kind.PAINTS, "Named paint colors for GIMP, Krita and Inkscape, or Photoshop.", asked_by="paints"
        ),
        Output(
            "facts", Kind.TABLE, "Ids, names, colors, areas, parents, children and boxes of labels.", asked_by="facts"
        ),
    )

    seed: ClassVar[int] = 0  # type: ignore[misc]  # a chart has one
    panel: int = param(96, ge=16, le=1024, unit="px", help="Height of a row.")
    maxlabels: int = param(24, ge=1, le=256, help="Maximum number of labels, the largest first.")
    paints: Path | None = param(
        None, example="paints.gpl", help="File for the paint colors (.gpl or .aco), to load into a painting program."
    )
    facts: Path | None = param(
        None, example="palette.json", help="File for ids, names, colors, areas, parents, children and boxes of labels."
    )

    def plan(self, facts: Facts) -> Plan:
        """The label map, the next finer one, and the width of the palette."""
        spec = self.exemplar.first.spec
        labels = label_map(self.exemplar, self.labellevel)
        finer = label_levels(self.exemplar).get(labels.level - 1)
        width = self.panel * (2 if finer is None else 2 + _CHILDREN)
        photo, in_memory = self.exemplar.first, self.holds_photo(facts)
        looked_at = min(spec.width, self._reach) * min(spec.height, self._reach)
        needed = spec.width * spec.height * (_MASK_BYTES + (_SEEN_BYTES + photo.pixel_bytes if in_memory else 0))
        needed += _SWATCH_BYTES * looked_at + 20 * width * self.panel * self.maxlabels
        facts.require(needed, f"a palette of {spec.width}x{spec.height}")
        self.require_readable(facts)
        return Plan(work=(labels, finer, width))

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        """The palette, its source coordinates, and the table of its labels."""
        resources, progress = session.resources, session.progress
        labels, finer, width = plan.work
        photo, in_memory = self.exemplar.first, self.holds_photo(resources)
        pixels = self.read(resources)
        shown = Legend(labels, areas_of(labels, pixels.usable)).entries()
        if not shown:
            raise ImageError(f"no pixel of {self.exemplar.source} is opaque and has a label")
        below = [] if finer is None else Legend(finer, areas_of(finer, pixels.usable)).entries()
        for entry in shown:
            entry["children"] = [e["id"] for e in below if entry["id"] in e["parents"]]
        if len(shown) > self.maxlabels:
            self.warn("only %d of the %d labels of %s are shown", self.maxlabels, len(shown), labels.part.name)
        shown = shown[: self.maxlabels]
        boxes = self._boxes(shown, {entry["id"]: entry for entry in below}, width)
        source = SourceMap(np.empty((self.panel * len(shown), width), np.uint32))
        maps = {labels.level: labels} | ({} if finer is None else {finer.level: finer})
        wanted = [(labels.level - down, entry["id"]) for down, entry, _ in boxes]
        windows: dict[tuple[int, int], Window] = {}
        for level, one in maps.items():
            within = fullest_windows(one, pixels.usable, [label for at, label in wanted if at == level], self._reach)
            windows |= {(level, label): window for label, window in within.items()}
        for n, ((level, label), (_, entry, box)) in enumerate(zip(wanted, boxes, strict=True)):
            place = box.inside(Window(0, 0, width, len(source.packed)))
            swatch = self._swatch(resources, pixels, maps[level], label, windows[level, label], box, n)
            source.packed[place] = swatch.packed
            entry["box"] = [box.left, box.top, box.width, box.height]
            progress.advance(n + 1, len(boxes))
        table = {"level": labels.level, "labels": shown, "finer": below}
        paints = [Swatch(entry["name"], *map(int, entry["color"].split(","))) for entry in (*shown, *below)]
        copied = source.parts("palette", self.in_any_order(photo, in_memory), by_rows=not in_memory)
        return copied | {"paints": paints, "facts": table}

    def holds_photo(self, facts: Facts) -> bool:
        """Whether the photo and its Lab values are held in memory."""
        return self.holds(facts, max(12, self.exemplar.first.pixel_bytes))

    @property
    def _reach(self) -> int:
        """Maximum side of the window of the photo from which a swatch is made, in px."""
        return -(-max(_REACH, 4 * self.panel) // CELL) * CELL

    def _boxes(
        self, shown: list[dict[str, Any]], below: dict[int, dict[str, Any]], width: int
    ) -> list[tuple[int, dict[str, Any], Window]]:
        """(levels down, entry, box) of each swatch; together the boxes cover the picture."""
        boxes = []
        for row, entry in enumerate(shown):
            top = row * self.panel
            children = entry["children"][:_CHILDREN]
            left = width if not children else 2 * self.panel
            boxes.append((0, entry, Window(0, top, left, top + self.panel)))
            edges = np.linspace(left, width, len(children) + 1).astype(int).tolist()
            for child, begin, end in zip(children, edges, edges[1:], strict=False):
                boxes.append((1, below[child], Window(begin, top, end, top + self.panel)))
        return boxes

    def _swatch(
        self, resources: Resources, pixels: ExemplarPixels, labels: LabelMap, label: int, window: Window, box: Window,
        number: int,
    ) -> SourceMap:  # fmt: skip
        """Texture of one label: by PatchMatch, or by graph cut where the label is too narrow for whole patches."""
        from ..synthesis.graphcut.placement import Layout, graph_cut  # scipy is not loaded before it is needed

        down, across = window.inside(Window(0, 0, 0, 0))
        allowed = labels.part.read(window.shifted(labels.part.spec.x, labels.part.spec.y))[..., 0] == label
        if pixels.usable is not None:
            allowed = allowed & pixels.usable[down, across]
        rows, columns = (np.flatnonzero(allowed.any(axis)) for axis in (1, 0))
        around = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        lab = np.ascontiguousarray(pixels.values[down][around[0], across][:, around[1]])
        allowed, rows, columns = allowed[around], rows + window.top, columns + window.left
        seed = (0x9E3779B1 * number) & 0xFFFFFFFF
        widest = largest_window(allowed)
        patch = next((p for p in _PATCHES if p + 2 <= widest and p <= min(box.width, box.height) // 2), None)
        if patch is None:
            side = min(16, self.panel // 2)
            cut = Layout(box.width, box.height, patch=side, passes=0, seed=seed)
            source = graph_cut(lab, allowed, cut, resources.budget, lambda done, total: None)
        else:
            recipe = Recipe(
                box.width, box.height, sigma=None, patch=patch, iterations=_ITERATIONS, seed=seed, uniformity=0.01,
                contrast=1.0, flat=False,
            )  # fmt: skip
            source = synthesize(
                resources.device, lab, allowed, recipe, resources.budget, lambda done, total: None
            ).source
        y, x = source.yx
        return SourceMap.of(y + rows[0], x + columns[0])
