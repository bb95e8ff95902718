# SPDX-License-Identifier: Apache-2.0
"""How much of a photo's lattice its tile keeps, with and without `lattice`, and the cost over toroidal PatchMatch's.

python -m benchmarks.tiles.regularity [FILE ...] [--side 256] [--seeds 2]

Without files: photos of $OIIOTEX_TEST_DATA, scikit-image's brick, and the procedural lattices of the tests. Peaks are
the normalized autocorrelation over its floor at the lattice's first three vectors; of tiles, wrapped, as a share of the
photo's, the mean over seeds. The cost of MJH17 eq. 1 is measured at half the longest period where that is more than
the default sigma: below it the lattice itself looks different from place to place (a tile of one cell of
the gingham, repeated, has 0.77 of PatchMatch's cost at the default sigma, and 0.10 at half its period).

--op quilt, cut or synth: the least of the three peaks of that op's result, without -> with `lattice`, and how often
the most repeated region is shown in both.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder, load
from oiiotex.analysis.regularity.lattice import Lattice, find_lattice
from oiiotex.analysis.regularity.offset_prices import InStep
from oiiotex.analysis.stationarity.costs import stationarity_cost
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.core.window import Domain
from oiiotex.engine.errors import Error
from oiiotex.engine.session import Session
from oiiotex.filters.texcut import Cut
from oiiotex.filters.texpatchmatch import PatchMatch
from oiiotex.filters.texquilt import Quilting
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.filters.texsynth import Synth
from oiiotex.synthesis.patchmatch.optimization import synthesize
from oiiotex.synthesis.patchmatch.recipe import Recipe
from oiiotex.synthesis.quality.copy_detection import copies_by_source
from oiiotex.synthesis.quality.lost_structure import peaks_over_floor
from tests.any_filter import buffer
from tests.lattices import VECTORS, regular

OPS = {"quilt": Quilting, "cut": Cut, "synth": Synth}


def photos(files: list[Path], side: int) -> Iterator[tuple[str, oiio.ImageBuf]]:
    """Names and pictures."""
    if not files:
        import skimage

        files = sorted((data_folder() / "photos").iterdir())
        files.append(Path(skimage.__file__).parent / "data" / "brick.png")
    for path in files:
        yield path.stem, load(path, side)
    for name in VECTORS:
        yield f"procedural {name}", buffer(regular(name, side, side, 3))


def row(name: str, picture: oiio.ImageBuf, seeds: int, session: Session) -> str:
    """Of the table."""
    image = from_buffer(picture)
    lab, opaque = working_values(image, session.resources)
    lattice = find_lattice(lab, opaque)
    if lattice is None:
        return f"| {name} | none | | | | | |"
    own_size = lab.shape[1], lab.shape[0]
    size = lattice.fitting(Domain(*own_size, True, True))
    longest = 1 / np.linalg.norm(lattice.frequencies, axis=1).min()
    sigma = max(max(own_size) / 32, longest / 2)
    photo = peaks_over_floor(lab, lattice, False)

    def made(recipe: Recipe) -> tuple[np.ndarray, float]:
        places = synthesize(
            session.resources.device, lab, opaque, recipe, session.resources.budget, lambda done, total: None
        ).source
        tile, wanted = places.gather(lab), lattice.on_torus(recipe)
        closed: Lattice = replace(lattice, frequencies=wanted)
        return peaks_over_floor(tile, closed, True) / photo, stationarity_cost(tile, sigma)

    found = {"before": [], "after": [], "patchmatch": []}
    for seed in range(1, seeds + 1):
        plain = Stationarize(exemplar=image, seed=seed).recipe(*own_size)
        op = Stationarize(exemplar=image, seed=seed)
        kept = InStep(lattice, lattice.on_torus(Domain(*size, True, True)), op.lattice)
        found["before"].append(made(plain))
        found["after"].append(made(replace(op.recipe(*size), in_step=kept)))
        found["patchmatch"].append(made(PatchMatch(exemplar=image, seed=seed).recipe(*own_size)))
    peaks = {k: " ".join(f"{p:.2f}" for p in np.mean([v[0] for v in values], 0)) for k, values in found.items()}
    costs = {k: float(np.mean([v[1] for v in values])) for k, values in found.items()}
    ratios = " -> ".join(f"{costs[k] / costs['patchmatch']:.2f}" for k in ("before", "after"))
    own = " ".join(f"{p:.2f}" for p in photo)
    tile = "x".join(map(str, size))
    return f"| {name} | {lattice} | {tile} | {own} | {peaks['before']} | {peaks['after']} | {ratios} |"


def row_of(op: type, name: str, picture: oiio.ImageBuf, seeds: int, session: Session) -> str:
    """Of the table of an op that lays pixels of the photo."""
    image = from_buffer(picture)
    lab, opaque = working_values(image, session.resources)
    lattice = find_lattice(lab, opaque)
    if lattice is None:
        return f"| {name} | none | | |"
    own, more = peaks_over_floor(lab, lattice, False), {} if op is Synth else {"tiles": "xy"}
    peaks, shown = {0.0: [], 0.5: []}, {0.0: [], 0.5: []}
    for structure, seed in itertools.product(peaks, range(1, seeds + 1)):
        use = op(exemplar=image, seed=seed, lattice=structure, **more)
        made = use.make(use.plan(session.resources), session)
        source = SourceMap.of_coordinates(made["st"].pixels(), image.first.spec, "st")
        tile, torus = source.gather(lab), Domain(*source.packed.shape[::-1], True, True)
        kept = lattice if op is Synth else replace(lattice, frequencies=lattice.on_torus(torus))
        peaks[structure].append(peaks_over_floor(tile, kept, op is not Synth) / own)
        shown[structure].append(copies_by_source(source, lab.shape[:2]).shown)
    least = " -> ".join(f"{np.mean(found, 0).min():.2f}" for found in peaks.values())
    often = " -> ".join(f"{np.mean(found):.1f}" for found in shown.values())
    return f"| {name} | {lattice} | {least} | {often} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--side", type=int, default=256)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--op", choices=OPS)
    options = parser.parse_args()
    session = Session()
    if options.op:
        print("| photo | lattice | least peak | shown |\n|---|---|---|---|")
        for name, picture in photos(options.files, options.side):
            print(row_of(OPS[options.op], name, picture, options.seeds, session), flush=True)
        return
    print("| photo | lattice | tile | its peaks | share without | share with | cost, of PatchMatch's |")
    print("|---|---|---|---|---|---|---|")
    for name, picture in photos(options.files, options.side):
        try:
            print(row(name, picture, options.seeds, session), flush=True)
        except (Error, OSError) as error:
            print(f"{name}: {error}", file=sys.stderr)


if __name__ == "__main__":
    main()
