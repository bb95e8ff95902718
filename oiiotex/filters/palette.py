# SPDX-License-Identifier: Apache-2.0
"""--texpalette: what a texture has to paint with, LSA16 section 6.2."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..analysis.regions import largest_window
from ..color import working_values
from ..images import Image, Part
from ..op import Op, Output, Reach, Space
from ..params import image, param
from ..session import Session
from ..synthesis.stationarize import Recipe, synthesize
from ..windows import Window
from .label import PARENTS, write_json
from .labelview import srgb_of
from .sources import LABELS, both, label_part, label_parts
from .stationarize import refuse_overwriting, tile_image

log = logging.getLogger("oiiotex")

_PATCHES = (11, 9, 7, 5)  # px
_ITERATIONS = 12


@dataclass(frozen=True, kw_only=True)
class Palette(Op):
    """Lay out what a texture consists of: a band for every label, beside it the labels within.

    Every row is a label of one level, its texture synthesized from its pixels alone;
    right of it are its children on the next finer level, side by side (LSA16: Lockerman, Sauvage, Allegre, Dischler,
    Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 6.2, figures 13
    and 14). The largest label is on top. json=FILE says for each its id, name, colour to paint with, area, parent,
    children and place in the picture: the table of --texpaint.
    """

    name: ClassVar[str] = "palette"
    copies: ClassVar[bool] = True
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("palette", "rows of texture, copied from the photo, in its own colour space and type"),
        Output("st", "where every pixel comes from: 32-bit float source coordinates"),
    )

    exemplar: Image = image(help="the photo, with label maps as --texlabel:keep=1 makes them")
    labels: Image | None = image(None, help=LABELS)
    level: int | None = param(None, ge=1, help="which label map: label.N; the coarsest when left out")
    side: int = param(96, ge=16, le=1024, unit="px", help="height of a row")
    rows: int = param(24, ge=1, le=256, help="labels that are shown, the largest first")
    children: int = param(8, ge=0, le=64, help="children that are shown of each, the largest first")
    json: Path | None = param(None, help="ids, names, colours, areas, parents, children and boxes go to this file")
    stmap: bool | Path = param(False, help="1: source coordinates as part 'st' of the result; a file name: there")
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def compute(self, session: Session) -> Image:
        """The palette, followed by the part 'st' where it is asked for."""
        refuse_overwriting(self.exemplar, stmap=self.stmap, json=self.json)
        spec = self.exemplar.first.spec
        parts = label_parts(self.exemplar, self.labels)
        part = label_part(self.exemplar, self.labels, self.level)
        level = next(number for number, found in parts.items() if found is part or found.name == part.name)
        width = self.side * (2 + (self.children if level - 1 in parts else 0))
        session.require(
            spec.width * spec.height * (90 + self.exemplar.first.pixel_bytes) + 20 * width * self.side * self.rows,
            f"a palette of {spec.width}x{spec.height}",
        )
        with session.stats.time("read and colour"):
            working = working_values(self.exemplar, None if self.data else session.color, session.autocc)
            pixels = self.exemplar.first.pixels()
        shown = self._entries(part, level, working.values, working.opaque)
        finer = self._entries(parts[level - 1], level - 1, working.values, working.opaque) if level - 1 in parts else []
        for entry in shown:
            entry["children"] = [e["id"] for e in finer if e["parent"] == entry["id"]]
        if len(shown) > self.rows:
            log.warning("%s: %d of %s's %d labels are shown", self.flag(), self.rows, part.name, len(shown))
        shown = shown[: self.rows]
        boxes = self._boxes(shown, finer, width)
        places = np.empty((self.side * len(shown), width), np.uint32)
        maps = {level: part.pixels()[..., 0]}
        if finer:
            maps[level - 1] = parts[level - 1].pixels()[..., 0]
        for n, (number, entry, box) in enumerate(boxes):
            allowed = both(working.opaque, maps[number] == entry["id"])
            place = box.inside(Window(0, 0, width, len(places)))
            places[place] = self._swatch(session, working.values, allowed, box, n)
            entry["box"] = [box.left, box.top, box.width, box.height]
            session.advance(n + 1, len(boxes))
        if self.json is not None:
            write_json(self.json, {"level": level, "labels": shown, "finer": finer}, session)
        return tile_image(self, self.exemplar, pixels, places, session)

    def _entries(self, part: Part, level: int, lab: np.ndarray, opaque: np.ndarray | None) -> list[dict[str, Any]]:
        """What there is to say of a level's labels, the largest first."""
        ids = part.pixels()[..., 0]
        if opaque is not None:
            ids = np.where(opaque, ids, 0)
        flat = ids.ravel()
        areas = np.bincount(flat)
        means = np.stack([np.bincount(flat, lab[..., c].ravel(), len(areas)) for c in range(3)], -1)
        text = part.spec.get_string_attribute(PARENTS)
        parents = [int(word) for word in text.split(",")] if text else []
        there = [int(i) for i in np.argsort(-areas, kind="stable") if i > 0 and areas[i]]
        colours = distinct(srgb_of(means[there] / areas[there, None]))
        return [
            {
                "id": i,
                "name": f"label.{level}/{i}",
                "colour": ",".join(map(str, colour)),
                "area": int(areas[i]),
                "parent": parents[i - 1] if i <= len(parents) else 0,
            }
            for i, colour in zip(there, colours, strict=True)
        ]

    def _boxes(
        self, shown: list[dict[str, Any]], finer: list[dict[str, Any]], width: int
    ) -> list[tuple[int, dict[str, Any], Window]]:
        """(level, entry, place) of every swatch: no pixel of the picture is left over."""
        by_id, boxes = {e["id"]: e for e in finer}, []
        for row, entry in enumerate(shown):
            level, top = int(entry["name"][6:].split("/")[0]), row * self.side
            children = entry["children"][: self.children]
            left = width if not children else 2 * self.side
            boxes.append((level, entry, Window(0, top, left, top + self.side)))
            edges = np.linspace(left, width, len(children) + 1).astype(int).tolist()
            for child, begin, end in zip(children, edges, edges[1:], strict=False):
                boxes.append((level - 1, by_id[child], Window(begin, top, end, top + self.side)))
        return boxes

    def _swatch(self, session: Session, lab: np.ndarray, allowed: np.ndarray, box: Window, number: int) -> np.ndarray:
        """One label's texture: by PatchMatch, or cut from pieces where it is too thin for whole patches."""
        from ..synthesis.graphcut import Layout, graph_cut  # scipy is not loaded before it is needed

        rows, columns = (np.flatnonzero(allowed.any(axis)) for axis in (1, 0))
        around = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        lab, allowed = lab[around], allowed[around]
        seed = (self.seed + 0x9E3779B1 * number) & 0xFFFFFFFF
        widest = largest_window(allowed)
        patch = next((p for p in _PATCHES if p + 2 <= widest and p <= min(box.width, box.height) // 2), None)
        if patch is None:
            side = min(16, self.side // 2)
            cut = Layout(
                width=box.width, height=box.height, wrap_x=False, wrap_y=False, patch=side, passes=0, seed=seed
            )
            found = graph_cut(lab, allowed, cut, lambda done, total: None)
        else:
            recipe = Recipe(
                width=box.width, height=box.height, wrap_x=False, wrap_y=False, sigma=None, patch=patch,
                iterations=_ITERATIONS, seed=seed, uniformity=0.01, contrast=1.0, flat=False,
            )  # fmt: skip
            found = synthesize(session.device, lab, allowed, recipe, session.budget, lambda done, total: None).source
        return found + np.uint32(rows[0] << 16 | columns[0])


def distinct(colours: np.ndarray) -> list[tuple[int, int, int]]:
    """8-bit colours of (n, 3) sRGB in 0 .. 1, moved as little as need be where two are the same or one is black."""
    taken, found = {(0, 0, 0)}, []
    for colour in np.rint(255 * np.clip(colours, 0, 1)).astype(int):
        at, reach = tuple(colour.tolist()), 0
        while at in taken:
            reach += 1
            around = np.indices((2 * reach + 1,) * 3).reshape(3, -1).T - reach + colour
            free = [tuple(c) for c in around.tolist() if min(c) >= 0 and max(c) < 256 and tuple(c) not in taken]
            at = free[0] if free else at
        taken.add(at)
        found.append(at)
    return found
