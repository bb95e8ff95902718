# SPDX-License-Identifier: Apache-2.0
"""--texsynth: cost of windows, of their start, and of the analysis; distance of its candidates from the exact ones.

python -m benchmarks.multiscale.windows [--graph GRAPH.json] [--photo PHOTO] [--runs 7]

Modes alternate, so that a slow phase of the machine affects all of them. Numbers are medians. CPU seconds are
those of all threads. Wall times are meaningful only on an idle machine.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.shared.measures import data_folder, machine
from oiiotex.engine.core.op import Space
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.reading import read
from oiiotex.engine.session import Session
from oiiotex.synthesis.multiscale.candidate_sets import DIMS, DISC, analyze, neighborhoods, project
from oiiotex.synthesis.multiscale.graph import Graph
from oiiotex.synthesis.multiscale.infinite_plane import Plane, graph_images, opened
from oiiotex.synthesis.multiscale.synthesizer import Synthesizer
from tools.demo import gravel, save, stained

SIDE = 1024  # px of a window
LAB = {"literal": False, "space": Space.LAB}  # planes are looked at in it, with our turns
SAMPLED = 1500  # texels of a level whose exact candidates are looked for


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """CPU seconds of all threads, and seconds."""
    cpu, wall = time.process_time(), time.perf_counter()
    work()
    return time.process_time() - cpu, time.perf_counter() - wall


def modes(session: Session, graph: Path, photo: Path) -> dict[str, tuple[Synthesizer, Plane, int]]:
    """A case: a maker, its plane, and the level of its windows."""
    found = {}
    known, images = graph_images(graph, session.resources)
    root = images[known.root]
    for name, given, of, correct in (
        (f"{graph.parent.name}, with correction", known, images, True),
        (f"{graph.parent.name}, correct=0", known, images, False),
        ("its root alone (Lefebvre & Hoppe)", Graph.single("root"), (root,), True),
        (
            f"{photo.stem} alone (Lefebvre & Hoppe)",
            Graph.single("photo"),
            (read(photo, session.resources.cache),),
            True,
        ),
    ):
        plane = opened(
            session.resources, session.progress, given, of, name, side=256, dims=DIMS, correct=correct, **LAB
        )
        settings = plane.settings(seed=1, lock=False)
        maker = Synthesizer(session.resources.device, plane.analysis, settings, session.resources.budget)
        found[name] = maker, plane, plane.finest + given.depth()
    return found


def print_windows(session: Session, graph: Path, photo: Path, runs: int) -> None:
    """CPU seconds a megapixel of each mode, all levels in, shown as pixels, no file written."""
    makers = modes(session, graph, photo)
    spent: dict[str, list[tuple[float, float, float, float]]] = {name: [] for name in makers}
    for turn in range(runs + 1):
        for name, (maker, plane, level) in makers.items():
            held = []
            window = Window.sized(SIDE * turn, 0, SIDE, SIDE)
            made = timed(lambda: held.append(maker.window(level, window)))  # noqa: B023 - called at once
            shown = timed(lambda: plane.pixels(held[0]))  # noqa: B023
            if turn > 0:
                spent[name].append((*made, *shown))
    pixels = SIDE * SIDE / 1e6
    print(f"windows of {SIDE}x{SIDE}, D = {DIMS}, all levels in; {runs} rounds")
    print(f"{'':36s} {'exemplars':>9s} {'level':>5s} {'CPU s/Mpix':>10s} {'shown':>6s} {'Mpix/s':>7s} {'of first':>8s}")
    first = None
    for name, (_, plane, level) in makers.items():
        cpu, wall, shown_cpu, shown_wall = (median(column) for column in zip(*spent[name], strict=True))
        total = (cpu + shown_cpu) / pixels
        first = first or total
        sizes = f"{len(plane.exemplars)} x {plane.exemplars[0].side}"
        print(
            f"{name:36s} {sizes:>9s} {level:5d} {total:10.3f} {shown_cpu / pixels:6.3f}"
            f" {pixels / (wall + shown_wall):7.2f} {first / total:8.2f}"
        )


def print_start(graph: Path, runs: int) -> None:
    """A window far down by the program, its analysis cached."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable, "-m", "oiiotex", "--autocc",
            f"--texsynth:graph={graph}:lod=30:window=1920x1080+0+0", "-o", f"{folder}/window.exr",
        ]  # fmt: skip
        spent = []
        for _ in range(runs + 1):
            before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            subprocess.run(command, check=True, capture_output=True)
            wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
            spent.append((after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall))
    cpu, wall = (median(column) for column in zip(*spent[1:], strict=True))
    print(f"\n1920x1080 at level 30 of {graph.parent.name}, whole program, cached: CPU {cpu:.2f} s, wall {wall:.2f} s")


def print_analysis(session: Session, photo: Path, runs: int) -> None:
    """The analysis of one exemplar without a cache, and its candidates compared with the exact ones."""
    given = Graph.single("photo"), (read(photo, session.resources.cache),), "photo"
    plane = opened(session.resources, session.progress, *given, side=256, dims=DIMS, correct=True, **LAB)
    stacks = plane.analysis.stacks

    def run() -> None:
        analyze(session.resources.device, stacks, DIMS, True, session.resources.budget, lambda done, total: None, None)

    run()  # builds the kernels
    cpu, wall = (median(column) for column in zip(*(timed(run) for _ in range(max(2, runs // 2))), strict=True))
    print(f"\nanalysis of {photo.stem}, {stacks.planes.shape[1]} px: CPU {cpu:.2f} s, wall {wall:.2f} s")
    print(f"\n{'level':>5s} {'found / exact, mean distance':>29s} {'found exactly':>14s}")
    sums = np.zeros(2)
    for number, found, exact in distances(plane):
        sums += found.mean(), exact.mean()
        ratio, share = found.mean() / exact.mean(), (found <= exact + 1e-6).mean()
        print(f"{stacks.levels.stacks[number][1]:5d} {ratio:29.3f} {100 * share:12.1f} %")
    print(f"{'all':>5s} {sums[0] / sums[1]:29.3f}")


def distances(plane: Plane) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Distances to the second candidates, those found and the exact ones, of some texels of each level from 2 on."""
    analysis, random = plane.analysis, np.random.default_rng(0)
    stacks, side = analysis.stacks, analysis.stacks.planes.shape[1]
    disc = round((DISC * side) ** 2)
    for number in range(2, len(stacks.planes)):
        around = neighborhoods(stacks.planes[number], stacks.levels.spacing(number), stacks.periodic[number])
        all_of = project(around, analysis.basis).astype(np.float64)
        texels = random.choice(side * side, SAMPLED, replace=False)
        found = analysis.links[number, texels, 1].astype(np.int64) - number * side * side
        pieces = []
        for piece in np.array_split(np.arange(SAMPLED), 10):
            own = all_of[texels[piece]]
            squared = (own**2).sum(1)[:, None] + (all_of**2).sum(1) - 2 * own @ all_of.T  # exact: integers
            mine, every = (np.stack(np.divmod(of, side)) for of in (texels[piece], np.arange(side * side)))
            apart = np.abs(mine[:, :, None] - every[:, None])
            apart = np.minimum(apart, side - apart)
            squared[(apart**2).sum(0) < disc] = np.inf
            pieces.append((squared[np.arange(len(piece)), found[piece]], squared.min(1)))
        yield number, *(np.sqrt(np.concatenate(column)) for column in zip(*pieces, strict=True))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--graph", type=Path, default=data_folder() / "multiscale/mars/graph.json")
    parser.add_argument("--photo", type=Path, help="the one exemplar; the demo's")
    parser.add_argument("--runs", type=int, default=7, help="of each, after one to warm up")
    arguments = parser.parse_args()
    if not arguments.graph.exists():
        parser.error(f"no graph {arguments.graph}: say --graph")
    session = Session(device_name=os.environ.get("OIIOTEX_DEVICE") or "cpu", autocc=True)
    print(machine())
    with tempfile.TemporaryDirectory() as folder:
        photo = arguments.photo or Path(folder) / "gravel.png"
        if arguments.photo is None:
            save(stained(gravel()), photo)
        print_windows(session, arguments.graph, photo, arguments.runs)
        print_start(arguments.graph, max(1, arguments.runs // 2))
        print_analysis(session, photo, arguments.runs)


if __name__ == "__main__":
    main()
