# SPDX-License-Identifier: Apache-2.0
"""The pictures of --texsynth, after HRRG08's figures: `python -m tools.docs.pictures.synth [FIGURE...]`."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.engine.session import Session
from tests import pictures
from tools.demo import save
from tools.docs.pictures.layout import beside, opened, pixels, shrunk, stacked, write_jpeg
from tools.docs.pictures.multiscale import MAP

PANE = 190  # px


def photo(name: str, side: int) -> oiio.ImageBuf:
    """The middle of a test photo."""
    whole = opened(f"photos/{name}.jpg")
    spec = whole.spec()
    x, y = (spec.width - side) // 2, (spec.height - side) // 2
    return oiio.ImageBufAlgo.cut(whole, oiio.ROI(x, x + side, y, y + side))


def made(*images: oiio.ImageBuf, shown: int | None = None, **values: object) -> np.ndarray:
    """The result of --texsynth, reduced to `shown` px if given: (h, w, 3) uint8."""
    found = filters.synth(*images, session=SESSION, **values)
    return pixels(found if shown is None else shrunk(found, shown))


def graph_of(folder: Path, edges: list[tuple[str, str, int]], **exemplars: np.ndarray) -> Path:
    """A graph document next to its exemplars, (h, w, 3) of 0 to 1, the first of which is the root."""
    for name, picture in exemplars.items():
        save(np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8), folder / f"{name}.png")
    document = {
        "exemplars": [{"id": name, "file": f"{name}.png"} for name in exemplars],
        "root": next(iter(exemplars)),
        "edges": [{"from": a, "to": b, "r": r} for a, b, r in edges],
    }
    (folder / "graph.json").write_text(json.dumps(document))
    return folder / "graph.json"


def enlarged(picture: np.ndarray, times: int) -> np.ndarray:
    """Every pixel as a square."""
    return picture.repeat(times, 0).repeat(times, 1)


def scales() -> np.ndarray:
    """Figure 1: a map from five maps; each pane is the middle quarter of the one before."""
    panes = []
    for n, level in enumerate(range(8, 13)):
        x, y = ((at << n) - PANE // 2 for at in (150, 130))
        panes.append(made(graph=MAP, lod=level, window=f"{PANE}x{PANE}{x:+d}{y:+d}"))
    return beside(*panes, gap=4)


def single() -> np.ndarray:
    """Figure 2: 2048 x 2048 from one exemplar, without and with an edge to itself; reduced, and a detail of each."""
    exemplar = photo("moss_grass_stones_ground", 256)
    with tempfile.TemporaryDirectory() as folder:
        loop = graph_of(Path(folder), [("a", "a", 1)], a=exemplar.get_pixels(oiio.FLOAT)[..., :3])
        panes = [pixels(shrunk(exemplar, PANE))]
        for images, values in (((exemplar,), {}), ((), {"graph": loop, "lod": 11})):
            panes.append(made(*images, shown=2 * PANE, size=(1024, 1024), **values))
            panes.append(made(*images, window=f"{PANE}x{PANE}+400+400", **values))
    return beside(*panes, gap=4)


def zooms() -> np.ndarray:
    """Figure 3: windows of endless zooms, each 16 times as fine as the one before."""
    rows = []
    for name, r in (("castle_brick_broken", 3), ("pebbles_beach_shadow", 3), ("flower_meadow_stones", 1)):
        exemplar = photo(name, 256)
        with tempfile.TemporaryDirectory() as folder:
            loop = graph_of(Path(folder), [("a", "a", r)], a=exemplar.get_pixels(oiio.FLOAT)[..., :3])
            windows = [made(graph=loop, lod=n, window=f"{PANE}x{PANE}+0+0") for n in (8, 12, 16, 20, 40)]
        rows.append(beside(pixels(shrunk(exemplar, PANE)), *windows, gap=4))
    return stacked(rows, gap=4)


def rainbow() -> np.ndarray:
    """Figure 5: colored stripes and gray pebbles 8 times finer; not corrected, corrected."""
    phase = np.arange(128)[:, None, None] / 64 * 2 * np.pi
    stripes = np.broadcast_to(0.5 + 0.45 * np.sin(phase + np.array([0.0, 2.1, 4.2])), (128, 128, 3))
    gray = pictures.pebbles(128, 128, 2).mean(-1, keepdims=True) * np.ones(3)
    with tempfile.TemporaryDirectory() as folder:
        graph = graph_of(Path(folder), [("stripes", "gray", 3)], stripes=stripes, gray=gray)
        panes = [np.rint(255 * p).astype(np.uint8) for p in (stripes, gray)]
        for correct in (False, True):
            panes.append(made(graph=graph, matchcolor=correct, size=(512, 512), shown=256))
            panes.append(made(graph=graph, matchcolor=correct, window="128x128+200+200"))
    return beside(*panes, gap=4)


def locked() -> np.ndarray:
    """Figure 7: a map enlarged 8 times, and detail put into it; below without the lock."""
    root = oiio.ImageBuf(str(MAP.parent / "map_bobruisk_z3.jpg"))
    spec, side = root.spec(), 56
    x, y = spec.width // 2 - side // 2, spec.height // 2 - side // 2
    seen = enlarged(pixels(oiio.ImageBufAlgo.cut(root, oiio.ROI(x, x + side, y, y + side))), 8)
    at = (128 - side // 2) * 8
    window = f"{8 * side}x{8 * side}+{at}+{at}"
    return beside(seen, *(made(graph=MAP, keeplayout=lock, lod=11, window=window) for lock in (1, 0)), gap=4)


def crops() -> np.ndarray:
    """Figure 8: four crops of 128 x 128 of one photo, and windows at their four scales."""
    whole = opened("photos/bark_flaky.jpg")
    with tempfile.TemporaryDirectory() as folder:
        graph = Path(folder) / "bark.json"
        filters.graph(whole, graphfile=graph, scales=4, exemplarside=128)
        document = json.loads(graph.read_text())
        panes = [pixels(oiio.ImageBuf(str(Path(folder) / e["file"]))) for e in document["exemplars"]]
        rows = [beside(*panes, gap=4)]
        windows = [made(graph=graph, exemplarside=128, lod=n, window=f"{PANE}x{PANE}+300+300") for n in (7, 8, 9, 10)]
    rows.append(beside(*windows, gap=4))
    return stacked(rows, gap=4)


def chain() -> np.ndarray:
    """Figure 9: splotches, dabs of paint and grain at three scales, drawn without regard to each other."""
    yellow, ground, blue = np.array([0.9, 0.75, 0.2]), np.array([0.55, 0.25, 0.15]), np.array([0.15, 0.3, 0.7])
    splotch = (pictures.pebbles(128, 128, 1).mean(-1, keepdims=True) > 0.5) * 1.0
    root = splotch * yellow + (1 - splotch) * ground
    dabs = np.broadcast_to(ground, (128, 128, 3)).copy()
    y, x = np.mgrid[:128, :128]
    random = np.random.default_rng(1)
    for canvas, count, wide, wave in ((root, 40, 1.5, 0.0), (dabs, 9, 6.0, 3.0)):
        for _ in range(count):
            v, u = random.integers(0, 128, 2)
            canvas[((x - u) / (2 * wide)) ** 2 + ((y - v + wave * np.sin(x / 3)) / wide) ** 2 < 1] = blue
    grain = 0.5 + 0.25 * pictures.noise(128, 128, 3)[..., None] * np.ones(3)
    with tempfile.TemporaryDirectory() as folder:
        graph = graph_of(Path(folder), [("root", "dabs", 2), ("dabs", "grain", 2)], root=root, dabs=dabs, grain=grain)
        panes = [np.rint(255 * np.clip(p, 0, 1)).astype(np.uint8) for p in (root, dabs, grain)]
        windows = [made(graph=graph, lod=n, window=f"{PANE}x{PANE}+{150 << n - 7}+{150 << n - 7}") for n in (7, 9, 11)]
    return stacked([beside(*panes, gap=4), beside(*windows, gap=4)], gap=4)


def failures() -> np.ndarray:
    """Figure 10: a flat field that takes one texel over and over, a hard edge that bleeds, letters."""
    root = np.ones((128, 128, 3)) * 0.9
    root[:64, :64] = (0.1, 0.2, 0.8)
    root[64:, :] = np.where((np.arange(128) // 32 % 2)[None, :, None] == 0, (0.8, 0.1, 0.1), (0.95, 0.95, 0.9))
    page = oiio.ImageBuf(oiio.ImageSpec(64, 64, 3, oiio.FLOAT))
    oiio.ImageBufAlgo.fill(page, (0.9, 0.9, 0.9))
    for line in range(5):
        oiio.ImageBufAlgo.render_text(page, 2, 12 * line + 11, "texture", 11, "", (0.1, 0.1, 0.1))
    root[:64, 64:] = page.get_pixels(oiio.FLOAT)
    gray = pictures.pebbles(128, 128, 2).mean(-1, keepdims=True) * np.ones(3)
    with tempfile.TemporaryDirectory() as folder:
        graph = graph_of(Path(folder), [("root", "gray", 3)], root=root, gray=gray)
        panes = [np.rint(255 * root).astype(np.uint8)]
        panes.append(made(graph=graph, keeplayout=1, size=(1024, 1024), shown=384))
        panes.append(made(graph=graph, lod=7, size=(192, 192)))
    return beside(*panes, gap=4)


def seams() -> np.ndarray:
    """Photos that do not tile, taken for a torus, and mirrored at their borders as they are by themselves."""
    rows = []
    for name in ("stone_breccia", "sail_cloth_stained", "pebbles_beach_shadow"):
        exemplar = photo(name, 128)
        with tempfile.TemporaryDirectory() as folder:
            graph = graph_of(Path(folder), [], a=exemplar.get_pixels(oiio.FLOAT)[..., :3])
            document = json.loads(graph.read_text())
            document["exemplars"][0]["wrap"] = "periodic"
            graph.write_text(json.dumps(document))
            torus = made(graph=graph, size=(300, PANE))
        rows.append(beside(pixels(exemplar), torus, made(exemplar, size=(300, PANE)), gap=4))
    return stacked(rows, gap=4)


FIGURES: dict[str, Callable[[], np.ndarray]] = {
    f.__name__: f for f in (scales, single, zooms, rainbow, locked, crops, chain, failures, seams)
}

if __name__ == "__main__":
    if not MAP.is_file():
        raise SystemExit(f"no {MAP}: the pictures stay as they are")
    SESSION = Session(autocc=True)
    for name in sys.argv[1:] or FIGURES:
        write_jpeg(FIGURES[name](), f"synth_{name}.jpg", quality=64)
