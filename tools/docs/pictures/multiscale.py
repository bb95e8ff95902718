# SPDX-License-Identifier: Apache-2.0
"""The pictures of --texzoom and --texgraph: `python -m tools.docs.pictures.multiscale`."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder
from oiiotex import filters
from oiiotex.engine.session import Session
from oiiotex.surfaces.charts.drawing import Sheet
from oiiotex.synthesis.multiscale.graph import Edge, Graph
from oiiotex.synthesis.multiscale.superexemplar import Levels, unrolled
from tools.docs.pictures.layout import beside, draw, opened, pixels, stacked, write_jpeg

MAP = data_folder() / "multiscale" / "map1800_bobruisk" / "graph.json"
FRAMES = (1, 21, 41, 61, 81)
DEPTHS, LEVELS = 9, 7  # red edges that are drawn; L of HRRG08 figure 4, exemplars of 128 px
WIDE, HIGH = 84, 22  # px between vertices


def zooms() -> None:
    """A zoom through five scales of a map, and an endless one into a forest floor: a frame for every octave."""
    session = Session(autocc=True)
    moss = oiio.ImageBufAlgo.cut(opened("photos/moss_grass_stones_ground.jpg"), oiio.ROI(300, 556, 300, 556))
    rows = []
    for images, values in (((), {"graph": MAP, "center": (120, 100)}), ((moss,), {"center": (150, 140)})):
        shown = [filters.zoom(*images, frame=n, speed=0.05, size=(176, 176), session=session, **values) for n in FRAMES]
        rows.append(beside(*map(pixels, shown), gap=4))
    write_jpeg(stacked(rows), "zoom.jpg")


def graphs() -> None:
    """A graph of five maps, and a chain cut out of one photo with a loop at its end."""
    wall = opened("photos/sandstone_wall_cracked.jpg")
    with tempfile.TemporaryDirectory() as folder:
        chain = filters.graph(wall, graphfile=Path(folder) / "wall.json", scales=3, loop=1)
        print(json.dumps(json.loads((Path(folder) / "wall.json").read_text())))
    sheets = [pixels(filters.graph(draw=MAP)), pixels(chain)]
    wide = max(sheet.shape[1] for sheet in sheets)
    fitted = [np.pad(s, ((0, 0), (0, wide - s.shape[1]), (0, 0)), constant_values=237) for s in sheets]
    write_jpeg(stacked(fitted), "graph.jpg")


def superexemplars() -> None:
    """HRRG08 figure 4 (c): the tree of its graph as in the paper, below the default."""
    names = ("0", "1", "2")
    edges = (Edge(0, 1, 2), Edge(0, 2, 3), Edge(2, 2, 3))
    graph = Graph(names, tuple(map(Path, names)), 0, edges, (1.0,) * 3, (None,) * 3)
    trees = [unrolled_picture(unrolled(graph, LEVELS, literal=literal)) for literal in (True, False)]
    write_jpeg(stacked(trees), "superexemplar.jpg")


def unrolled_picture(levels: Levels) -> np.ndarray:
    """Columns are red depths; a vertex is `exemplar, level`. Red refines, black may replace. (h, w, 3) uint8."""
    columns = [_replaced(levels, [0])]
    for _ in range(DEPTHS):
        columns.append(_replaced(levels, [levels.finer[n] for n in columns[-1] if levels.finer[n] != n]))
    sheet = Sheet(WIDE * len(columns) + 40, HIGH * (2 + max(map(len, columns))))
    places = [{n: (30 + WIDE * t, HIGH * (2 + row)) for row, n in enumerate(c)} for t, c in enumerate(columns)]
    for t, column in enumerate(columns):
        sheet.text(f"t = {t}", 18 + WIDE * t, HIGH - 4)
        for n in column:
            x, y = places[t][n]
            if t < DEPTHS and levels.finer[n] != n:  # else its stack ends
                to_x, to_y = places[t + 1][levels.finer[n]]
                sheet.line(x + 16, y, to_x - 18, to_y, (0.85, 0.1, 0.1))
            for bend, (to, _) in enumerate(levels.admissible[n]):
                if to != n:
                    bow, to_y = x - 20 - 4 * bend, places[t][to][1]
                    for points in ((x - 14, y, bow, y), (bow, y, bow, to_y), (bow, to_y, x - 14, to_y)):
                        sheet.line(*points, (0.0, 0.0, 0.0))
            sheet.text("{},{}".format(*levels.stacks[n]), x - 12, y + 5)
    return np.rint(255 * sheet.image()).astype(np.uint8)


def _replaced(levels: Levels, numbers: list[int]) -> list[int]:
    """These levels and all that black edges lead to, by exemplar and level."""
    reached = list(dict.fromkeys(numbers))
    for n in reached:
        reached += [to for to, _ in levels.admissible[n] if to not in reached]
    return sorted(reached, key=levels.stacks.__getitem__)


if __name__ == "__main__":
    draw(superexemplars, zooms, graphs)
