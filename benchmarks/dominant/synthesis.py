# SPDX-License-Identifier: Apache-2.0
"""LDR09 section 6: is a texture made from a photo's dominant part more stationary than one made from all of it?

python -m benchmarks.dominant.synthesis [--side 256] [--seeds 3]

For every photo that the manifest calls non-stationary: its dominant mask, and textures of the same size by toroidal
PatchMatch and by quilting, from the mask and from the whole photo. Costs are MJH17 eq. 1 with histograms, means over
seeds.
"""

from __future__ import annotations

import argparse
import csv

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder, load
from oiiotex import filters
from oiiotex.analysis.stationarity.costs import stationarity_cost
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.window import Domain
from oiiotex.engine.session import Session

METHODS = ("patchmatch", "quilt")


def non_stationary() -> list[str]:
    """Photos of the manifest that are called so."""
    with (data_folder() / "MANIFEST.tsv").open(newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    return sorted(row["file"] for row in rows if row["kind"] == "non-stationary")


def cost(made: oiio.ImageBuf, wraps: bool, session: Session) -> float:
    """MJH17 eq. 1 of an image at the filters' own sigma."""
    lab = working_values(from_buffer(made), session.resources)[0]
    height, width = lab.shape[:2]
    return stationarity_cost(lab, max(height, width) / 32, Domain(width, height, wraps, wraps))


def mean_cost(method: str, photo: oiio.ImageBuf, mask: oiio.ImageBuf | None, seeds: int, session: Session) -> float:
    """The mean over seeds of what one method makes of the photo, or of its masked part."""
    spec = photo.spec()
    more = {} if mask is None else {"mask": mask}
    size = {"size": (spec.width, spec.height)}
    textures = (getattr(filters, method)(photo, seed=n, session=session, **size, **more) for n in range(seeds))
    return float(np.mean([cost(made, method == "patchmatch", session) for made in textures]))


def main() -> None:
    """Measure, print a table, and say how the goal stands."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=256, help="longer side of photos, px")
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    session = Session()
    lower = dict.fromkeys(METHODS, 0)
    names = non_stationary()
    print("| photo | share | photo's cost | patchmatch: whole | mask | quilt: whole | mask |")
    print("|---" * 7 + "|")
    for name in names:
        photo = load(data_folder() / name, arguments.side)
        mask = filters.dominant(photo, session=session)
        share = mask.spec().get_float_attribute("oiiotex:share")
        before = cost(photo, False, session)
        row = f"| {name.split('/')[-1]} | {share:.2f} | {before:.2f} |"
        for method in METHODS:
            whole = mean_cost(method, photo, None, arguments.seeds, session)
            part = mean_cost(method, photo, mask, arguments.seeds, session) if share > 0 else np.nan
            lower[method] += part < whole
            row += f" {whole:.2f} | {part:.2f} |"
        print(row, flush=True)
    print(", ".join(f"{method}: lower from the mask on {n} of {len(names)}" for method, n in lower.items()))


if __name__ == "__main__":
    main()
