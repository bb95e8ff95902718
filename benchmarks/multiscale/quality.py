# SPDX-License-Identifier: Apache-2.0
"""Quality of --texsynth in numbers (HRRG08): contrast in a zoom, similarity to the exemplars, coherence of scales.

python -m benchmarks.multiscale.quality [--side 128] [zooms] [graphs]
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder
from oiiotex.engine.color.lab_grid import FINE_STEPS
from oiiotex.engine.core.op import Space
from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from oiiotex.synthesis.multiscale.candidate_sets import neighborhoods
from oiiotex.synthesis.multiscale.contrast import with_contrast
from oiiotex.synthesis.multiscale.coverage import shares, unmatched
from oiiotex.synthesis.multiscale.infinite_plane import Plane, graph_images, opened
from oiiotex.synthesis.multiscale.synthesizer import Synthesizer
from tests import pictures
from tools.demo import save

PHOTOS = (
    "castle_brick_broken", "pebbles_beach_shadow", "flower_meadow_stones", "stone_breccia", "bark_flaky",
    "sandstone_wall_cracked", "clover_lawn", "onyx_veins",
)  # fmt: skip
GRAPHS = ("map1800_bobruisk", "mars", "drone_caliterra", "sand_grain_ladder")
LEVELS = (12, 20, 40)
PLACES = ((0, 0), (5000, 7000), (-3000, 99), (777, -(1 << 20)))
WINDOW = 128
SAMPLED = 1000  # neighborhoods of a level


def prepared(path: Path, session: Session, side: int, correct: bool = True) -> tuple[Plane, Synthesizer]:
    """A graph's plane, and what makes windows of it."""
    graph, images = graph_images(path, session.resources)
    how = {"side": side, "dims": 16, "correct": correct, "literal": False, "space": Space.LAB}
    plane = opened(session.resources, session.progress, graph, images, str(path), **how)
    settings = plane.settings(seed=1, lock=0)
    maker = Synthesizer(session.resources.device, plane.analysis, settings, session.resources.budget)
    return plane, maker if settings.kept == 1 else with_contrast(maker, plane.analysis, None, "")


def lab(plane: Plane, maker: Synthesizer, level: int, window: Window) -> np.ndarray:
    """Pixels as L, a and b minus the root's mean: (h, w, 3)."""
    state = maker.window(level, window)
    planes = plane.analysis.stacks.planes.reshape(-1, 4)
    moved = 0 if state.offset is None else state.offset[..., :3].astype(float)
    return (planes[state.texel][..., :3] + moved) / FINE_STEPS


def zooms(folder: Path, session: Session, side: int) -> None:
    """Of exemplars with an edge to themselves: the standard deviation of L at three levels over the exemplar's."""
    print("| exemplar | r | " + " | ".join(f"level {n}" for n in LEVELS) + " | within 25 % | means in gamut |")
    for name in PHOTOS:
        photo = oiio.ImageBuf(str(data_folder() / "photos" / f"{name}.jpg")).get_pixels(oiio.UINT8)[..., :3]
        top, left = (n // 2 - side // 2 for n in photo.shape[:2])
        save(np.ascontiguousarray(photo[top : top + side, left : left + side]), folder / f"{name}.png")
        for r in (1, 2, 3):
            document = {"exemplars": [{"id": name, "file": f"{name}.png"}], "root": name}
            document["edges"] = [{"from": name, "to": name, "r": r}]
            (folder / "loop.json").write_text(json.dumps(document))
            plane, maker = prepared(folder / "loop.json", session, side)
            values = plane.exemplars[0].values[..., :3]
            whole = values - values.mean((0, 1))
            found, inside = [], True
            for level in LEVELS:
                made = [lab(plane, maker, level, Window.sized(x, y, WINDOW, WINDOW)) for x, y in PLACES]
                found.append(float(np.mean([m[..., 0].std() for m in made]) / whole[..., 0].std()))
                means = np.array([m.mean((0, 1)) for m in made])
                inside &= bool(((means >= whole.min((0, 1))) & (means <= whole.max((0, 1)))).all())
            near = all(abs(f - 1) <= 0.25 for f in found)
            ratios = " | ".join(f"{f:.2f}" for f in found)
            print(f"| {name} | {r} | {ratios} | {'yes' if near else 'no'} | {'yes' if inside else 'no'} |", flush=True)


def unlikeness(plane: Plane, maker: Synthesizer, level: int) -> float:
    """How far neighborhoods, less their pixel's R, are from the nearest admissible one: rms of a color, Lab units."""
    stacks, window = plane.analysis.stacks, Window.sized(300, 200, 64, 64)
    state = maker.window(level, window)
    color = stacks.planes.reshape(-1, 4)[state.texel][..., :3].astype(float) + state.offset[..., :3]
    number = plane.source(state).number
    random = np.random.default_rng(0)
    y, x = random.integers(2, 62, (2, SAMPLED))
    seen = np.stack([color[y + v, x + u] for v in range(-2, 3) for u in range(-2, 3)], 1)
    seen = (seen - state.offset[y, x, None, :3]).reshape(SAMPLED, 75)
    least = np.full(SAMPLED, np.inf)
    for to in {to for n in np.unique(number[y, x]) for to, _ in stacks.levels.admissible[n]}:
        other = neighborhoods(stacks.planes[to], stacks.levels.spacing(to), stacks.periodic[to])
        squares = np.square(seen).sum(1)[:, None] + np.square(other).sum(1) - 2 * seen @ other.T
        least = np.minimum(least, squares.min(1))
    return float(np.sqrt(np.maximum(least, 0).mean() / 25) / FINE_STEPS)


def incoherence(plane: Plane, maker: Synthesizer, level: int) -> float:
    """How far a level, averaged over 2 x 2 pixels, is from the coarser one: rms, Lab units."""
    fine = lab(plane, maker, level, Window.sized(600, 400, 2 * WINDOW, 2 * WINDOW))
    coarse = lab(plane, maker, level - 1, Window.sized(300, 200, WINDOW, WINDOW))
    mean = fine.reshape(WINDOW, 2, WINDOW, 2, 3).mean((1, 3))
    return float(np.sqrt(np.square(mean - coarse).sum(-1).mean()))


def drawn(folder: Path) -> Path:
    """HRRG08 figure 5: stripes in colors, gray pebbles 8 times finer."""
    phase = np.arange(128)[:, None, None] / 64 * 2 * np.pi
    stripes = np.broadcast_to(0.5 + 0.45 * np.sin(phase + np.array([0.0, 2.1, 4.2])), (128, 128, 3))
    gray = pictures.pebbles(128, 128, 2).mean(-1, keepdims=True) * np.ones(3)
    for name, picture in (("stripes", stripes), ("gray", gray)):
        save(np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8), folder / f"{name}.png")
    nodes = [{"id": n, "file": f"{n}.png"} for n in ("stripes", "gray")]
    path = folder / "rainbow.json"
    path.write_text(json.dumps({"exemplars": nodes, "edges": [{"from": "stripes", "to": "gray", "r": 3}]}))
    return path


def graphs(folder: Path, session: Session, side: int) -> None:
    """Of graphs: unlikeness and incoherence of levels, corrected and not; who is taken; what nothing is like."""
    paths = [data_folder() / "multiscale" / name / "graph.json" for name in GRAPHS] + [drawn(folder)]
    print("| graph | level | unlike | coarser level | the same, correct=0 |")
    notes = []
    for path in paths:
        name = path.parent.name if path.name == "graph.json" else path.stem
        both = [prepared(path, session, side, correct) for correct in (True, False)]
        plane, maker = both[0]
        for level in _levels(plane):
            away = [incoherence(p, m, level) for p, m in both]
            print(
                f"| {name} | {level} | {unlikeness(plane, maker, level):.2f} | {away[0]:.2f} | {away[1]:.2f} |",
                flush=True,
            )
        taken = ", ".join(f"{plane.graph.names[n]} {100 * s:.0f} %" for n, s in shares(plane.graph, plane.analysis))
        lost = ", ".join(f"{plane.graph.names[u.exemplar]} {100 * u.share:.0f} %" for u in unmatched(plane.analysis))
        notes.append(f"| {name} | {taken} | {lost} |")
    print("\n| graph | share of replaceable texels where it is a candidate | without a finer match |", *notes, sep="\n")


def _levels(plane: Plane) -> Iterator[int]:
    """The root's two finest, and each that follows."""
    yield from range(plane.finest - 1, plane.finest + plane.graph.depth() + 1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", default=["zooms", "graphs"], choices=["zooms", "graphs"])
    parser.add_argument("--side", type=int, default=128)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as made_in:
        for table in arguments.what:
            {"zooms": zooms, "graphs": graphs}[table](Path(made_in), Session(autocc=True), arguments.side)
