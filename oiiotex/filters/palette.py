# SPDX-License-Identifier: Apache-2.0
"""--texpalette: what a texture has to paint with, LSA16 section 6.2."""

from __future__ import annotations

import functools
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..charts.paint_chips import paint_chips
from ..core.access import Whole
from ..core.op import Kind, Output
from ..core.parameters import param
from ..core.source_map import ST, SourceMap
from ..core.window import Window
from ..deferred import np
from ..exemplar.exemplar_masks import both, label_levels, label_map
from ..exemplar.exemplar_op import LabelledExemplar
from ..io.paint_palette import Paint
from ..labels.content_table import largest_window
from ..labels.legend import Legend
from ..patchmatch.optimization import synthesize
from ..patchmatch.recipe import Recipe
from ..session import Session

log = logging.getLogger("oiiotex")

_PATCHES = (11, 9, 7, 5)  # px
_ITERATIONS = 12


@dataclass(frozen=True, kw_only=True)
class Palette(LabelledExemplar, Whole):
    """Lay out what a texture consists of: a band for every label, beside it the labels within.

    Every row is a label of one level, its texture synthesized from its pixels alone;
    right of it are its children on the next finer level, side by side (LSA16: Lockerman, Sauvage, Allegre, Dischler,
    Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 6.2, figures 13
    and 14). The largest label is on top. json=FILE says for each its id, name, colour to paint with, area, parent,
    children and place in the picture: the table of --texpaint. paints=FILE is a palette for painting programs, chips=1
    a picture of the same colours.
    """

    name: ClassVar[str] = "palette"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("palette", Kind.PIXELS, "rows of texture, copied from the photo, in its own colour space and type"),
        ST,
        Output(
            "chips", Kind.PICTURE, "the paint colours with ids and names, each as large as its swatch", asked_by="chips"
        ),
        Output(
            "paints",
            Kind.PAINTS,
            "the paint colours by name, for GIMP, Krita and Inkscape, or Photoshop",
            asked_by="paints",
        ),
        Output(
            "table", Kind.TABLE, "ids, names, colours, areas, parents, children and boxes of labels", asked_by="json"
        ),
    )

    side: int = param(96, ge=16, le=1024, unit="px", help="height of a row")
    rows: int = param(24, ge=1, le=256, help="labels that are shown, the largest first")
    children: int = param(8, ge=0, le=64, help="children that are shown of each, the largest first")
    chips: bool | Path = param(
        False, help="1: a further part with the paint colours, ids and names in them; a file name: there"
    )
    paints: Path | None = param(None, help="the paint colours go to this file, .gpl or .aco: load it where you paint")
    json: Path | None = param(None, help="ids, names, colours, areas, parents, children and boxes go to this file")

    def compute(self, session: Session) -> dict[str, Any]:
        """The palette, where its pixels come from, and the table of its labels."""
        spec = self.exemplar.first.spec
        labels = label_map(self.exemplar, self.labels, self.level)
        finer = label_levels(self.exemplar, self.labels).get(labels.level - 1)
        width = self.side * (2 if finer is None else 2 + self.children)
        session.require(
            spec.width * spec.height * (90 + self.exemplar.first.pixel_bytes) + 20 * width * self.side * self.rows,
            f"a palette of {spec.width}x{spec.height}",
        )
        seen = self.read(session)
        shown = Legend.of(labels, seen.usable).entries()
        below = [] if finer is None else Legend.of(finer, seen.usable).entries()
        for entry in shown:
            entry["children"] = [e["id"] for e in below if e["parent"] == entry["id"]]
        if len(shown) > self.rows:
            log.warning("%s: %d of %s's %d labels are shown", self.flag(), self.rows, labels.part.name, len(shown))
        shown = shown[: self.rows]
        boxes = self._boxes(shown, {entry["id"]: entry for entry in below}, width)
        source = SourceMap(np.empty((self.side * len(shown), width), np.uint32))
        maps = {labels.level: labels.ids} | ({} if finer is None else {finer.level: finer.ids})
        for n, (down, entry, box) in enumerate(boxes):
            allowed = both(seen.usable, maps[labels.level - down] == entry["id"])
            place = box.inside(Window(0, 0, width, len(source.packed)))
            source.packed[place] = self._swatch(session, seen.values, allowed, box, n).packed
            entry["box"] = [box.left, box.top, box.width, box.height]
            session.advance(n + 1, len(boxes))
        self.say_what_stays()
        table = {"level": labels.level, "labels": shown, "finer": below}
        chips = functools.partial(paint_chips, [(entry, box) for _, entry, box in boxes], *source.packed.shape[::-1])
        paints = [Paint(entry["name"], *map(int, entry["colour"].split(","))) for entry in (*shown, *below)]
        return source.parts("palette", self.exemplar.first) | {"chips": chips, "paints": paints, "table": table}

    def _boxes(
        self, shown: list[dict[str, Any]], below: dict[int, dict[str, Any]], width: int
    ) -> list[tuple[int, dict[str, Any], Window]]:
        """(levels down, entry, place) of every swatch: no pixel of the picture is left over."""
        boxes = []
        for row, entry in enumerate(shown):
            top = row * self.side
            children = entry["children"][: self.children]
            left = width if not children else 2 * self.side
            boxes.append((0, entry, Window(0, top, left, top + self.side)))
            edges = np.linspace(left, width, len(children) + 1).astype(int).tolist()
            for child, begin, end in zip(children, edges, edges[1:], strict=False):
                boxes.append((1, below[child], Window(begin, top, end, top + self.side)))
        return boxes

    def _swatch(self, session: Session, lab: np.ndarray, allowed: np.ndarray, box: Window, number: int) -> SourceMap:
        """One label's texture: by PatchMatch, or cut from pieces where it is too thin for whole patches."""
        from ..graphcut.placement import Layout, graph_cut  # scipy is not loaded before it is needed

        rows, columns = (np.flatnonzero(allowed.any(axis)) for axis in (1, 0))
        around = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        lab, allowed = lab[around], allowed[around]
        seed = (self.seed + 0x9E3779B1 * number) & 0xFFFFFFFF
        widest = largest_window(allowed)
        patch = next((p for p in _PATCHES if p + 2 <= widest and p <= min(box.width, box.height) // 2), None)
        if patch is None:
            side = min(16, self.side // 2)
            cut = Layout(box.width, box.height, patch=side, passes=0, seed=seed)
            source = graph_cut(lab, allowed, cut, session.budget, lambda done, total: None)
        else:
            recipe = Recipe(
                box.width, box.height, sigma=None, patch=patch, iterations=_ITERATIONS, seed=seed, uniformity=0.01,
                contrast=1.0, flat=False,
            )  # fmt: skip
            source = synthesize(session.device, lab, allowed, recipe, session.budget, lambda done, total: None).source
        y, x = source.yx
        return SourceMap.of(y + rows[0], x + columns[0])
