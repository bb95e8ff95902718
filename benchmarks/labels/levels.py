# SPDX-License-Identifier: Apache-2.0
"""Label maps against ground truth: which level is best, and how good, by features.

python -m benchmarks.labels.levels [--features textons,moments,gabor,quadtree]
                                   [--pictures DIR] [--persistence 0.9] [--share 0.5] [--name PART]

LSA16 figures 3c and 3d, with curves over the number of labels, are redrawn by benchmarks.labels.curves.

Best level: the one of the best covering of the truth. `truth by labels` is the covering of true regions by labels,
`labels by truth` the reverse; UE: share of superpixels' pixels beyond the region that has most of them, at the best
level's superpixels. Synthetic pictures have exact truth: bricks, pebbles and moss with wavy borders.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import OpenImageIO as oiio
from sklearn.metrics.cluster import contingency_matrix, pair_confusion_matrix

from benchmarks.shared.measures import data_folder
from oiiotex import filters
from oiiotex.analysis.labels.features import features_of, small_lab
from oiiotex.analysis.labels.scales import LabelMaps, LabelSettings, label_levels
from oiiotex.analysis.segmentation.subtextures import superpixel_subtextures
from oiiotex.analysis.superpixels.hierarchy import hierarchy
from oiiotex.analysis.superpixels.superpixels import superpixels
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.core.image import Image, from_buffer, to_buffer
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from oiiotex.filters.texlabel import label_map
from tests import pictures

PHOTOS = {"facade_tiles": "photos/facade_tiles.jpg", "rusty_metal_albedo": "pbr/rusty_metal/rusty_metal_albedo.jpg"}


class Case(NamedTuple):
    """An image with its truth: (h, w) int, 0 is not counted."""

    name: str
    image: Image
    truth: np.ndarray


class Score(NamedTuple):
    """How near labels are to the truth."""

    covering: float
    back: float
    rand: float
    adjusted: float
    count: int
    error: float


def cases(part_of_name: str = "") -> Iterator[Case]:
    """The 14 ground-truth maps, then the synthetic pictures."""
    folder = data_folder() / "gt"
    for path in sorted(folder.glob("*_gt.png")):
        name = path.stem.removesuffix("_gt")
        if part_of_name not in name:
            continue
        found = data_folder() / PHOTOS[name] if name in PHOTOS else next(folder.glob(f"{name}.[jp]*g"))
        truth = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT16)[..., 0].astype(np.int64)
        if oiio.ImageBuf(str(path)).spec().format == oiio.UINT8:
            truth //= 257
        if "gravel" in name:
            truth = (truth > 0) + 1
        yield Case(name, from_buffer(oiio.ImageBuf(str(found))), truth)
    for seed in range(4):
        if part_of_name in f"synthetic_{seed}":
            yield synthetic(seed)


def synthetic(seed: int, side: int = 384) -> Case:
    """Bricks, pebbles, moss and darker bricks in four fields with wavy borders."""
    y, x = np.mgrid[0:side, 0:side]
    wave = 40.0 * (pictures.smooth_noise(side, side, 48, seed, 20) - 0.5)
    across = (x + wave > side * (0.4 + 0.05 * seed)).astype(int)
    down = (y + wave.T > side * (0.6 - 0.05 * seed)).astype(int)
    truth = 2 * down + across
    looks = [p(side, side, seed) for p in (pictures.bricks, pictures.pebbles, pictures.moss)]
    looks.append(pictures.bricks(side, side, seed + 7)[..., ::-1] * 0.6)
    picture = np.stack(looks)[truth, y, x]
    spec = oiio.ImageSpec(side, side, 3, oiio.FLOAT)
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, picture.astype(np.float32))
    return Case(f"synthetic_{seed}", from_buffer(buffer), truth + 1)


def score(truth: np.ndarray, labels: np.ndarray, regions: np.ndarray) -> Score:
    """Labels (h, w) and superpixels (h, w) against the truth where it is not 0."""
    known = truth > 0
    table = contingency_matrix(truth[known], labels[known]).astype(np.float64)
    overlap = table / (table.sum(1)[:, None] + table.sum(0) - table)
    covering = float((table.sum(1) * overlap.max(1)).sum() / table.sum())
    back = float((table.sum(0) * overlap.max(0)).sum() / table.sum())
    (tn, fp), (fn, tp) = pair_confusion_matrix(truth[known], labels[known]).astype(np.float64)
    rand = (tp + tn) / (tp + tn + fp + fn)
    beyond = (tp + fn) * (fn + tn) + (tp + fp) * (fp + tn)
    adjusted = 1.0 if fn == fp == 0 else 2.0 * (tp * tn - fn * fp) / beyond
    pieces = contingency_matrix(truth[known], regions[known])
    error = 1.0 - float(pieces.max(0).sum() / pieces.sum())
    return Score(covering, back, float(rand), float(adjusted), table.shape[1], error)


def main() -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--features", default="textons,moments,gabor,quadtree")
    parser.add_argument("--persistence", type=float, default=LabelSettings.persistence)
    parser.add_argument("--share", type=float, default=LabelSettings.share)
    parser.add_argument("--name", default="")
    parser.add_argument("--levels", action="store_true", help="print every level, not only the best")
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    session = Session()
    rows: dict[str, list[tuple[str, Score, bool, float]]] = {}
    for case in cases(arguments.name):
        lens = lens_of(case.image, session.resources)
        start = time.perf_counter()
        found = superpixels(case.image, lens, session.resources)
        levels = hierarchy(found, session.resources)
        small = small_lab(found)
        before = time.perf_counter() - start
        ids = found.labels.read(found.window)[..., 0].astype(np.int64) - 1
        for kind in arguments.features.split(","):
            start = time.perf_counter()
            described = features_of(kind, found, small, session.resources)
            describing = time.perf_counter() - start
            start = time.perf_counter()
            settings = LabelSettings(persistence=arguments.persistence, share=arguments.share)
            labeled = label_levels(
                levels,
                described,
                settings,
                found.edges,
                session.resources,
                lambda: [superpixel_subtextures(found, small, session.resources)],  # noqa: B023 - called at once
            )
            took = time.perf_counter() - start
            scores = [score(case.truth, level.labels[ids], level.groups[ids]) for level in labeled]
            best = max(range(len(scores)), key=lambda n: scores[n].covering)
            true = len(np.unique(case.truth[case.truth > 0]))
            near = abs(scores[best].count / true - 1) <= 0.5
            rows.setdefault(kind, []).append((case.name, scores[best], near, describing + took))
            shown = "all" if arguments.levels else str(best + 1)
            print(f"{case.name:26s} {kind:8s} n {found.count:5d} {before:5.2f} s {describing:5.2f} s"
                  f" {took:5.2f} s  level {shown} of {len(scores)}  truth {true}", end="")  # fmt: skip
            for s in scores if arguments.levels else [scores[best]]:
                print(f"  {s.count:3d} labels: Rand {s.rand:.3f} ARI {s.adjusted:.3f} truth by labels"
                      f" {s.covering:.3f} back {s.back:.3f} UE {100 * s.error:.1f} %", end="")  # fmt: skip
            print(flush=True)
            if arguments.pictures:
                maps = LabelMaps(found, labeled)
                parts = [label_map(case.image.first, maps, n + 1).part for n in range(len(labeled))]
                view = run(filters.op_named("labelview")(source=Image((case.image.first, *parts), case.name)), session)[
                    0
                ].image
                arguments.pictures.mkdir(parents=True, exist_ok=True)
                to_buffer(view.first).write(str(arguments.pictures / f"{case.name}_{kind}.png"))
    print(f"\n{'':18s} {'':9s} {'Rand':>6s} {'ARI':>6s} {'cover':>6s} {'back':>6s}   UE %  count within 50 %   s")
    for kind, found_rows in rows.items():
        for group in ("mosaic", "synthetic", ""):
            chosen = [r for r in found_rows if (group in r[0] if group else "synthetic" not in r[0])]
            if chosen:
                s = np.mean([[r[1].rand, r[1].adjusted, r[1].covering, r[1].back, 100 * r[1].error] for r in chosen], 0)
                near = sum(r[2] for r in chosen)
                print(f"{kind:18s} {group or 'all 14':9s} {s[0]:6.3f} {s[1]:6.3f} {s[2]:6.3f} {s[3]:6.3f} {s[4]:6.1f}"
                      f"   {near:2d} of {len(chosen):2d}  {np.mean([r[3] for r in chosen]):12.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
