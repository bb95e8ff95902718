# SPDX-License-Identifier: Apache-2.0
"""Subtextures against ground truth: the mosaics at hand, and collages, by setting.

python -m benchmarks.decompose [--first 20] [--collages 4] [--label]

Settings: the default; without shifts; the paper's features and assignment with and without shifts. The default was set
on the mosaics and on collages 0 to 9; those from --first on were not looked at.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.collages import drawn_collage, photo_collage
from benchmarks.labels import cases, score
from oiiotex.filters.decompose import Decompose
from oiiotex.filters.label import Label
from oiiotex.session import Session

PAPER = {"features": "haar", "assign": "neighbours", "refine": False}
SETTINGS = {
    "default": {},
    "shift=0": {"shift": 0},
    "paper, grid": PAPER,
    "paper, shift=0": {**PAPER, "shift": 0},
}


def main() -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=20)
    parser.add_argument("--collages", type=int, default=4)
    parser.add_argument(
        "--label", action="store_true", help="--texlabel beside them: its best level, chosen with the truth"
    )
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.collages)
    groups = {
        "mosaics": list(cases("mosaic")),
        "colour": [photo_collage(s) for s in seeds],
        "gray": [photo_collage(s, gray=True) for s in seeds],
        "drawn": [drawn_collage(s) for s in seeds],
    }
    print("| images | setting | covering | Rand | ARI | subtextures | CPU s |\n|---|---|---|---|---|---|---|")
    for group, found in groups.items():
        for name, values in SETTINGS.items():
            rows = []
            for case in found:
                start = time.process_time()
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
