# SPDX-License-Identifier: Apache-2.0
"""The pictures of --texzoom and --texgraph: `python -m docs.multiscale_pictures`."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from docs.layout import beside, pixels, stacked, write_jpeg
from oiiotex import filters
from oiiotex.session import Session

DATA = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data"))
FRAMES = (1, 21, 41, 61, 81)


def zooms() -> None:
    """A zoom through five scales of a map and one without end into a forest floor: every octave a frame."""
    graph, photo = (
        DATA / "multiscale" / "map1800_bobruisk" / "graph.json",
        DATA / "photos" / "moss_grass_stones_ground.jpg",
    )
    if not (graph.is_file() and photo.is_file()):
        print(f"no {graph} or no {photo}: the zooms stay as they are")
        return
    session = Session(autocc=True)
    moss = oiio.ImageBufAlgo.cut(oiio.ImageBuf(str(photo)), oiio.ROI(300, 556, 300, 556))
    rows = []
    for images, values in (((), {"graph": graph, "at": (120, 100)}), ((moss,), {"at": (150, 140)})):
        shown = [filters.zoom(*images, frame=n, speed=0.05, size=(176, 176), session=session, **values) for n in FRAMES]
        rows.append(beside(*map(pixels, shown), gap=4))
    write_jpeg(stacked(rows), "zoom.jpg")


def graphs() -> None:
    """A graph of five maps, and a chain cut out of one photo with a loop at its end."""
    maps, photo = (
        DATA / "multiscale" / "map1800_bobruisk" / "graph.json",
        DATA / "photos" / "sandstone_wall_cracked.jpg",
    )
    if not (maps.is_file() and photo.is_file()):
        print(f"no {maps} or no {photo}: the graphs stay as they are")
        return
    with tempfile.TemporaryDirectory() as folder:
        wall = oiio.ImageBuf(str(photo))
        chain = filters.graph(wall, json=Path(folder) / "wall.json", scales=3, loop=1, thumb=96)
        print(json.dumps(json.loads((Path(folder) / "wall.json").read_text())))
    sheets = [pixels(filters.graph(graph=maps, thumb=96)), pixels(chain)]
    wide = max(sheet.shape[1] for sheet in sheets)
    fitted = [np.pad(s, ((0, 0), (0, wide - s.shape[1]), (0, 0)), constant_values=237) for s in sheets]
    write_jpeg(stacked(fitted), "graph.jpg")


if __name__ == "__main__":
    zooms()
    graphs()
