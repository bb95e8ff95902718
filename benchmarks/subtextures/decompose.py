# SPDX-License-Identifier: Apache-2.0
"""Subtextures against ground truth: fixed and random mosaics, by setting.

python -m benchmarks.subtextures.decompose [--mosaics 20] [--label] [--groups mosaics,judge,photos]
                                           [--only NAME] [--each]

Settings: the default, and with the number given; clique partitioning, and without shifts; the paper's features and
assignment with and without shifts. The default was tuned on the half "tune" of shared/mosaics.py, never on "judge".
k-means (on the histograms of the samples) and normalized cuts (on their similarities, CZF02 figure 5d) replace clique
partitioning. They get the true number of subtextures, which clique partitioning does not. Factorization
(factorization.py) is a peer by itself, run without the number and with it. `border`: of the pixels within
8 px of a true border, the share outside the true texture that its subtexture mostly covers. `correct`: of the true
textures, those that share three quarters of their pixels with one label, and it with them (CS of the Prague benchmark
of texture segmentation). `accuracy`: of pixels, when every texture has the label of the best assignment of one to one.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.optimize import linear_sum_assignment
from sklearn.cluster import KMeans, SpectralClustering
from sklearn.metrics.cluster import contingency_matrix

from benchmarks.labels.levels import Case, cases, score
from benchmarks.shared.mosaics import KINDS, suite
from benchmarks.subtextures import factorization
from oiiotex.analysis.segmentation import clique_partition, subtextures
from oiiotex.analysis.segmentation.subtextures import (
    DecompositionSettings,
    czf02,
    decomposed,
    label_map_of,
    usual,
)
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.color.lab_reduced import lab_pixels, reduction
from oiiotex.engine.core.image import Image
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from oiiotex.filters.texdecompose import WORKING_PIXELS
from oiiotex.filters.texlabel import Label

HEAD = (
    "| images | setting | covering | Rand | ARI | correct | accuracy | labels | border % | CPU s |\n"
    + "|---" * 10
    + "|"
)
CLIQUES_THRESHOLD = 0.76  # of filter bank textons in discs of 48 px
CLIQUES = {"group": "cliques", "threshold": CLIQUES_THRESHOLD}
GRID = {"scales": 1, "search": "grid"}
SETTINGS = {  # the settings of the op for a number of pixels, and what is changed in them
    "default": (usual, {}),
    "count told": (usual, {}),
    "cliques": (usual, CLIQUES),
    "cliques, shift=0": (usual, {**CLIQUES, "shift": 0}),
    "k-means, count told": (usual, CLIQUES),
    "normalized cuts, count told": (usual, CLIQUES),
    "paper, grid": (czf02, GRID),
    "paper, shift=0": (czf02, {**GRID, "shift": 0}),
}


def subtextures_of(image: Image, settings: Callable[[int], DecompositionSettings], **changes: Any) -> np.ndarray:
    """Label map (h, w) of an image by `settings`, of its number of pixels, with changes."""
    resources, (width, height) = Session().resources, image.first.window.size
    factor = reduction(width, height, WORKING_PIXELS)
    pixels = lab_pixels(image, lens_of(image, resources), resources, factor)
    how = replace(settings(-(-width // factor) * -(-height // factor)), **changes)
    return label_map_of(image.first, pixels, decomposed(pixels, how, resources)).part.pixels()[..., 0]


@contextmanager
def grouped_by(name: str, count: int):
    """Another way than clique partitioning while it lasts, where the setting is named after one."""
    compare, held = subtextures.similarities, {}

    def compared(roots, samples, *rest):
        held["values"] = roots[samples.cells()].astype(np.float64)
        return compare(roots, samples, *rest)

    def grouped(weights, refine):
        if len(weights) <= count:
            return np.arange(len(weights))
        if name.startswith("k-means"):
            return KMeans(count, n_init=4, random_state=0).fit_predict(held["values"])
        likeness = weights + CLIQUES_THRESHOLD
        return SpectralClustering(count, affinity="precomputed", random_state=0).fit_predict(likeness)

    if not name.endswith(", count told"):
        yield
        return
    with patch.object(subtextures, "similarities", compared), patch.object(clique_partition, "partition", grouped):
        yield


def border_error(truth: np.ndarray, labels: np.ndarray, reach: int = 8) -> float:
    """Share of the pixels near a true border whose label mostly covers another texture than theirs."""
    size = 2 * reach + 1
    near = (maximum_filter(truth, size) != minimum_filter(truth, size)) & (truth > 0)
    table = contingency_matrix(truth[truth > 0], labels[truth > 0])
    of_label = np.zeros(labels.max() + 1, np.int64)
    of_label[np.unique(labels[truth > 0])] = np.unique(truth[truth > 0])[table.argmax(0)]
    return float((of_label[labels] != truth)[near].mean())


def measured(case: Case, compute: Callable[[Case], list[np.ndarray]]) -> tuple[float, ...]:
    """A line's figures of one image, of the labels of the best covering where there are several."""
    start = time.process_time()
    found = [labels.astype(np.int64) for labels in compute(case)]
    took = time.process_time() - start
    best = max(found, key=lambda labels: score(case.truth, labels, labels).covering)
    s = score(case.truth, best, best)
    correct, accuracy = matched(case.truth, best)
    return (s.covering, s.rand, s.adjusted, correct, accuracy, s.count, border_error(case.truth, best), took)


def matched(truth: np.ndarray, labels: np.ndarray) -> tuple[float, float]:
    """Correctly segmented textures and accuracy: see above."""
    table = contingency_matrix(truth[truth > 0], labels[truth > 0])
    most = 0.75 * np.maximum(table.sum(0), table.sum(1)[:, None])
    accuracy = table[linear_sum_assignment(-table)].sum() / table.sum()
    return float((table >= most).any(1).mean()), float(accuracy)


def by_label(case: Case) -> list[np.ndarray]:
    """All levels of --texlabel."""
    made = run(Label(source=case.image), Session())[0].image
    return [p.pixels()[..., 0] for p in made.parts if p.name.startswith("label.")]


def by_factorization(case: Case, told: bool) -> list[np.ndarray]:
    """Yuan, Wang and Cheriyadat 2015, the number of textures found or told."""
    found = case.image.first.pixels()[..., :3]
    rgb = found.astype(np.float64) / (np.iinfo(found.dtype).max if found.dtype.kind == "u" else 1)
    if not told:
        return [factorization.segmented(rgb)]
    count = len(np.unique(case.truth[case.truth > 0]))
    return [factorization.segmented(rgb, count, factorization.WINDOW_TOLD)]


def main() -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--mosaics", type=int, default=20, help="number of mosaics of each half of benchmarks.shared.mosaics"
    )
    parser.add_argument("--label", action="store_true", help="also --texlabel: its best level, chosen with the truth")
    parser.add_argument("--groups", default="mosaics,judge,photos")
    parser.add_argument("--only", default="", help="settings whose names contain this")
    parser.add_argument("--each", action="store_true", help="print every image, not only means")
    arguments = parser.parse_args()
    groups = {
        "mosaics": lambda: list(cases("mosaic")),
        "photos": lambda: [c for c in cases() if not c.name.startswith(("mosaic", "synthetic"))],
        "tune": lambda: list(suite("tune", arguments.mosaics)),
        "judge": lambda: list(suite("judge", arguments.mosaics)),
    }
    print(HEAD)
    for group in arguments.groups.split(","):
        found = groups[group]()
        ways = {
            name: lambda case, settings=settings, changes=changes: [subtextures_of(case.image, settings, **changes)]
            for name, (settings, changes) in SETTINGS.items()
        }
        ways["count told"] = lambda case: [
            subtextures_of(case.image, usual, count=len(np.unique(case.truth[case.truth > 0])))
        ]
        ways["factorization"] = lambda case: by_factorization(case, told=False)
        ways["factorization, count told"] = lambda case: by_factorization(case, told=True)
        if arguments.label:
            ways["--texlabel, best level"] = by_label
        for name, way in ways.items():
            if arguments.only not in name:
                continue
            rows = []
            for case in found:
                with grouped_by(name, len(np.unique(case.truth[case.truth > 0]))):
                    rows.append(measured(case, way))
                if arguments.each:
                    report(case.name, name, rows[-1:])
            report(group, name, rows)
            for kind in KINDS if group in ("tune", "judge") else ():
                of_kind = [r for r, c in zip(rows, found, strict=True) if kind in c.name]
                if of_kind:  # fewer mosaics than kinds
                    report(f"{group}, {kind}", name, of_kind)


def report(group: str, name: str, rows: list[tuple[float, ...]]) -> None:
    """One line of the table."""
    covering, rand, adjusted, correct, accuracy, count, border, took = np.mean(rows, 0)
    print(
        f"| {group} | {name} | {covering:.3f} | {rand:.3f} | {adjusted:.3f} | {correct:.3f} | {accuracy:.3f} |"
        f" {count:.1f} | {100 * border:.1f} |"
        f" {took:.2f} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
