# SPDX-License-Identifier: Apache-2.0
"""Number of labels at each level of every test photo, and whether a level is of no use as a palette.

python -m benchmarks.labels.photos [--side 400]
"""

from __future__ import annotations

import argparse

import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder, load
from oiiotex import filters


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--side", type=int, default=400, help="longer side of a photo, px")
    side = asked.parse_args().side
    single = equal = 0
    print("| photo | labels, finest level first | with coarsest=materials |", "|---|---|---|", sep="\n")
    paths = sorted((data_folder() / "photos").iterdir())
    for path in paths:
        counts, with_materials = (
            [int(p.get_pixels(oiio.UINT32).max()) for p in filters.label(load(path, side), coarsest=coarsest).values()]
            for coarsest in ("subtextures", "materials")
        )
        single += 1 in counts
        equal += len(set(counts)) < len(counts)
        added = "no level" if counts == with_materials else f"coarsest level of {with_materials[-1]}"
        print(f"| {path.stem} | {', '.join(map(str, counts))} | {added} |", flush=True)
    print(f"\n{len(paths)} photos: {single} with a coarsest level of a single label, {equal} with equal levels")


if __name__ == "__main__":
    main()
