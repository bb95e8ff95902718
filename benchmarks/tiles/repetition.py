# SPDX-License-Identifier: Apache-2.0
"""Effect of the reuse penalty: how often a tile shows the same region, lost texture, and cost.

python -m benchmarks.tiles.repetition [PHOTO ...] [--side 256] [--seed 1]

Photos (all of the test data when none is named): the most repeated 32 x 32 px region, and texture cost, stationarity
cost, low-frequency energy, sharpness and CPU seconds of --texstationarize with its reuse penalty over those without.
Then photos of which a part is painted flat: the share of texture in photo and tile.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder, load, low_frequency, sharpness
from benchmarks.tiles.stationarization import Photo
from oiiotex import filters
from oiiotex.analysis.stationarity.costs import stationarity_cost
from oiiotex.engine.errors import ImageError
from oiiotex.engine.session import Session
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.synthesis.patchmatch.matcher import match_patches
from oiiotex.synthesis.patchmatch.optimization import synthesize
from oiiotex.synthesis.quality.copy_detection import copies_by_source

NAMES = ("shown", "texture", "stationarity", "LowF", "sharpness", "CPU s")
PARTS = ("gray", "noise", "black", "white")
SHARES = (0.1, 0.25, 0.5, 0.75)


def measures(photo: Photo, seed: int, complete: bool) -> np.ndarray:
    """Of a tile as large as the photo, in the order of `NAMES`."""
    resources = photo.session.resources
    op = Stationarize(exemplar=photo.image, seed=seed)
    recipe = replace(op.recipe(photo.width, photo.height), complete=complete)
    before = time.process_time()
    tile = synthesize(resources.device, photo.lab, photo.opaque, recipe, resources.budget, lambda done, total: None)
    spent = time.process_time() - before
    lab = tile.source.gather(photo.lab)
    _, texture = match_patches(resources.device, lab, photo.lab, tile.field, 11, recipe, 1, resources.budget)
    return np.array(
        [
            copies_by_source(tile.source, photo.lab.shape[:2]).shown,
            texture,
            stationarity_cost(lab, photo.sigma),
            low_frequency(lab[..., 0]),
            sharpness(lab[..., 0]),
            spent,
        ]
    )


def flattened(photo: oiio.ImageBuf, part: str, share: float) -> oiio.ImageBuf:
    """The photo with so much of it, in a corner, painted flat."""
    pixels = photo.get_pixels(oiio.FLOAT)
    rows, columns = (round(n * share**0.5) for n in pixels.shape[:2])
    corner = pixels[:rows, :columns]
    corner[:] = {"black": 0.0, "white": 1.0}.get(part, pixels.mean((0, 1)))
    if part == "noise":
        corner += np.random.default_rng(0).normal(0, 3 / 255, (rows, columns, 1)).astype(np.float32)
    painted = oiio.ImageBuf(photo.spec())
    painted.set_pixels(photo.roi, np.ascontiguousarray(np.clip(pixels, 0, 1)))
    return painted


def textured(buffer: oiio.ImageBuf) -> float:
    """Share of pixels around which 9 x 9 px deviate by 3 % or more."""
    from scipy.ndimage import uniform_filter

    gray = buffer.get_pixels(oiio.FLOAT)[..., :3].mean(-1)
    return float((uniform_filter(gray**2, 9) - uniform_filter(gray, 9) ** 2 > 0.03**2).mean())


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", nargs="*", type=Path)
    parser.add_argument("--side", type=int, default=256)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    session = Session()
    paths = arguments.photos or sorted((data_folder() / "photos").iterdir())
    print(f"{'':28s} {'shown':>13s}" + "".join(f" {name:>12s}" for name in NAMES[1:]), flush=True)
    ratios = []
    for path in paths:
        photo = Photo(path, arguments.side, session)
        without, priced = (measures(photo, arguments.seed, complete) for complete in (False, True))
        ratios.append([priced[0], *(priced[1:] / without[1:])])
        figures = "".join(f" {ratio:12.2f}" for ratio in ratios[-1][1:])
        print(f"{path.stem[:28]:28s} {without[0]:5.1f} -> {priced[0]:4.1f}{figures}", flush=True)
    figures = "".join(f" {ratio:12.2f}" for ratio in np.median(ratios, axis=0)[1:])
    print(f"{'median':28s} {'':8s} {np.median([r[0] for r in ratios]):4.1f}{figures}")
    print(f"\nshare of texture, photo -> tile, where a part of {paths[0].stem} is flat")
    photo = load(paths[0], arguments.side)
    for part in PARTS:
        cells = []
        for share in SHARES:
            painted = flattened(photo, part, share)
            try:
                tile = filters.stationarize(painted, seed=arguments.seed, session=session)
                cells.append(f"{textured(painted):.2f} -> {textured(tile):.2f}")
            except ImageError:
                cells.append(f"{textured(painted):.2f}, refused")
        print(f"{part:8s}" + "".join(f" {cell:>16s}" for cell in cells), flush=True)


if __name__ == "__main__":
    sys.exit(main())
