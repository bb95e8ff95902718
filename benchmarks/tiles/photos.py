# SPDX-License-Identifier: Apache-2.0
"""MJH17 figures 3 and 4 in numbers: stationarity and texture cost over photos and seeds, beside toroidal PatchMatch.

python -m benchmarks.tiles.photos [--side 320] [--seeds 10] [--csv FILE]
"""

from __future__ import annotations

import argparse
import csv
import sys

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder, load
from oiiotex import filters
from oiiotex.color.lab import working_values
from oiiotex.core.image import from_buffer
from oiiotex.core.source_map import SourceMap
from oiiotex.core.window import Domain
from oiiotex.patchmatch.matcher import match_patches
from oiiotex.session import Session
from oiiotex.stationarity.costs import stationarity_cost, texture_cost

PATCH = 11


def costs(photo: oiio.ImageBuf, made: dict[str, oiio.ImageBuf], session: Session) -> tuple[float, float]:
    """(stationarity cost, texture cost) of a tile made with `stmap`."""
    lab = working_values(from_buffer(photo), session)[0]
    height, width = lab.shape[:2]
    st = made["st"].get_pixels(oiio.FLOAT)
    x, y = (np.floor(st[..., i] * n).astype(np.int64) for i, n in ((0, width), (1, height)))
    tile = lab[y, x]
    # where the tile's pixels come from is a good first guess of where its patches do
    guess = SourceMap.of(np.minimum(y, height - PATCH), np.minimum(x, width - PATCH))
    torus = Domain(tile.shape[1], tile.shape[0], True, True)  # of a lattice's own size
    field = match_patches(session.device, tile, lab, guess, PATCH, torus, 1, session.budget)
    return stationarity_cost(tile, max(width, height) / 32), texture_cost(tile, lab, field, PATCH)


def main() -> None:
    """Measure, print a table, and say how the goals stand."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=320)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--csv")
    arguments = parser.parse_args()
    session = Session()
    table = []
    print(f"{'photo':28s} {'stationarity (sd)':>28s} {'texture':>16s}   ours | toroidal PatchMatch", flush=True)
    for path in sorted((data_folder() / "photos").iterdir()):
        photo = load(path, arguments.side)
        results = {
            op: np.array(
                [
                    costs(photo, getattr(filters, op)(photo, seed=seed, stmap=True, session=session), session)
                    for seed in range(arguments.seeds)
                ]
            )
            for op in ("stationarize", "patchmatch")
        }
        row = [f(results[op][:, i]) for i in (0, 1) for op in results for f in (np.mean, np.var)]
        wins = int((results["stationarize"][:, 0] < results["patchmatch"][:, 0]).sum())
        table.append([path.name, *row, wins])
        print(
            f"{path.stem[:28]:28s} {row[0]:6.2f} ({row[1] ** 0.5:4.2f}) | {row[2]:6.2f} ({row[3] ** 0.5:4.2f})"
            f" {row[4]:7.1f} | {row[6]:5.1f}   {wins}/{arguments.seeds}",
            flush=True,
        )
    numbers = np.array([row[1:] for row in table], float)
    runs = len(table) * arguments.seeds
    print(f"runs with lower stationarity cost: {numbers[:, -1].sum():.0f} of {runs}")
    print(f"median ratio of stationarity cost: {np.median(numbers[:, 0] / numbers[:, 2]):.2f}")
    print(f"photos with lower variance over seeds: {(numbers[:, 1] < numbers[:, 3]).sum()} of {len(table)}")
    print(f"median ratio of texture cost: {np.median(numbers[:, 4] / numbers[:, 6]):.2f}")
    if arguments.csv:
        with open(arguments.csv, "w", newline="") as file:
            writer = csv.writer(file)
            names = [
                f"{c} {m} {f}"
                for c in ("stationarity", "texture")
                for m in ("ours", "patchmatch")
                for f in ("mean", "variance")
            ]
            writer.writerows([["photo", *names, "seeds won"], *table])


if __name__ == "__main__":
    sys.exit(main())
