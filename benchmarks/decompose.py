# SPDX-License-Identifier: Apache-2.0
"""Subtextures against ground truth: the mosaics at hand, and collages, by setting.

python -m benchmarks.decompose [--first 20] [--collages 4] [--label] [--groups mosaics,photos,colour,gray,drawn]

Settings: the default; without shifts; the paper's features and assignment with and without shifts. The default was set
on the mosaics and on collages 0 to 9; those from --first on were not looked at. k-means (on the histograms of the
samples) and normalised cuts (on their similarities, CZF02 figure 5d) stand where clique partitioning does; they are
told the true number of subtextures, which it is not.
"""

from __future__ import annotations

import argparse
import time
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np
from sklearn.cluster import KMeans, SpectralClustering

from benchmarks.collages import drawn_collage, photo_collage
from benchmarks.labels import cases, score
from oiiotex.analysis import subtextures
from oiiotex.filters.decompose import Decompose
from oiiotex.filters.label import Label
from oiiotex.session import Session

PAPER = {"features": "haar", "assign": "neighbours", "refine": False}
SETTINGS = {
    "default": {},
    "shift=0": {"shift": 0},
    "k-means, count told": {},
    "normalised cuts, count told": {},
    "paper, grid": PAPER,
    "paper, shift=0": {**PAPER, "shift": 0},
}


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
        likeness = weights + subtextures.Settings.threshold
        return SpectralClustering(count, affinity="precomputed", random_state=0).fit_predict(likeness)

    if not name.endswith("told"):
        yield
        return
    with patch.object(subtextures, "similarities", compared), patch.object(subtextures, "partition", grouped):
        yield


def main() -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=20)
    parser.add_argument("--collages", type=int, default=4)
    parser.add_argument(
        "--label", action="store_true", help="--texlabel beside them: its best level, chosen with the truth"
    )
    parser.add_argument("--groups", default="mosaics,photos,colour,gray,drawn")
    parser.add_argument("--only", default="", help="settings with this in their name")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.collages)
    groups = {
        "mosaics": lambda: list(cases("mosaic")),
        "photos": lambda: [c for c in cases() if not c.name.startswith(("mosaic", "synthetic"))],
        "colour": lambda: [photo_collage(s) for s in seeds],
        "gray": lambda: [photo_collage(s, gray=True) for s in seeds],
        "drawn": lambda: [drawn_collage(s) for s in seeds],
    }
    print("| images | setting | covering | Rand | ARI | subtextures | CPU s |\n|---|---|---|---|---|---|---|")
    for group in arguments.groups.split(","):
        found = groups[group]()
        for name, values in ((n, v) for n, v in SETTINGS.items() if arguments.only in n):
            rows = []
            for case in found:
                start = time.process_time()
                with grouped_by(name, len(np.unique(case.truth[case.truth > 0]))):
                    labels = Decompose(source=case.image, **values).compute(Session()).first.pixels()[..., 0]
                took = time.process_time() - start
                s = score(case.truth, labels.astype(np.int64), labels.astype(np.int64))
                rows.append((s.covering, s.rand, s.adjusted, s.count, took))
            report(group, name, rows)
        if arguments.label:
            rows = []
            for case in found:
                start = time.process_time()
                made = Label(source=case.image).compute(Session())
                took = time.process_time() - start
                levels = [p.pixels()[..., 0].astype(np.int64) for p in made.parts if p.name.startswith("label.")]
                s = max((score(case.truth, level, level) for level in levels), key=lambda s: s.covering)
                rows.append((s.covering, s.rand, s.adjusted, s.count, took))
            report(group, "--texlabel, best level", rows)


def report(group: str, name: str, rows: list[tuple[float, ...]]) -> None:
    """One line of the table."""
    mean = np.mean(rows, 0)
    print(
        f"| {group} | {name} | {mean[0]:.3f} | {mean[1]:.3f} | {mean[2]:.3f} | {mean[3]:.1f} | {mean[4]:.2f} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
