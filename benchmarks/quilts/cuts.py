# SPDX-License-Identifier: Apache-2.0
"""Graph cuts made from coarse to fine, compared with exact ones: CPU time and cost of all seams (KSE03 eq. 2).

python -m benchmarks.quilts.cuts [--photos 8] [--seeds 4] [--size 256]

Every Nth photo of the folder, at most 640 px a side, is made into tiles of --size pixels on one thread. `spread` is the
standard deviation of the exact cost over the seeds, relative to its mean.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import OpenImageIO as oiio
from skimage.color import rgb2lab

from benchmarks.shared.measures import data_folder
from oiiotex.engine.color.lab_grid import FINE_STEPS, to_grid
from oiiotex.synthesis.graphcut import seams
from oiiotex.synthesis.graphcut.placement import Layout, graph_cut

_SIDE = 640  # px
_MOST_PIXELS = 1 << 30
_PATCHES = 5  # along the shorter side, as --texcut's default


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photos", type=int, default=8)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--size", type=int, default=256)
    given = parser.parse_args()
    print("| photo | exact CPU s | CPU s | cost / exact cost | spread |\n|---|---|---|---|---|")
    photos = sorted((data_folder() / "photos").glob("*.jpg"))
    ratios = []
    for path in photos[:: max(1, len(photos) // given.photos)][: given.photos]:
        lab = _lab(str(path))
        exact, banded = (_made(lab, given.size, given.seeds, large) for large in (_MOST_PIXELS, seams.LARGE))
        costs = [np.array([cost for cost, _ in made]) for made in (exact, banded)]
        ratios.append(costs[1].mean() / costs[0].mean())
        spent = [np.mean([spent for _, spent in made]) for made in (exact, banded)]
        spread = costs[0].std() / costs[0].mean()
        print(f"| {path.stem} | {spent[0]:.2f} | {spent[1]:.2f} | {ratios[-1]:.3f} | {spread:.3f} |", flush=True)
    print(f"| mean | | | {np.mean(ratios):.3f} | |")


def _lab(path: str) -> np.ndarray:
    photo = oiio.ImageBuf(path)
    scale = min(1.0, _SIDE / max(photo.spec().width, photo.spec().height))
    roi = oiio.ROI(0, round(photo.spec().width * scale), 0, round(photo.spec().height * scale))
    pixels = oiio.ImageBufAlgo.resize(photo, roi=roi).get_pixels(oiio.FLOAT)[..., :3]
    return np.asarray(rgb2lab(pixels.clip(0, 1)), np.float32)


def _made(lab: np.ndarray, size: int, seeds: int, large: int) -> list[tuple[int, float]]:
    """Cost of all seams and CPU seconds of the tile of each seed; cuts of fewer than `large` pixels are exact."""
    seams.LARGE, before = large, seams.LARGE
    source, patch = seams.SeamPhoto(to_grid(lab, FINE_STEPS)), min(96, max(16, min(lab.shape[:2]) // _PATCHES))
    figures = []
    for seed in range(seeds):
        layout = Layout.tiling(size, size, "xy", patch=patch, passes=0, seed=seed)
        start = time.process_time()
        places = np.stack(graph_cut(lab, None, layout, 1 << 30, lambda done, total: None).yx)
        spent = time.process_time() - start
        places = np.pad(places, ((0, 0), (0, 1), (0, 1)), mode="wrap")
        costs = seams.seam_costs(source, places, np.ones(places.shape[1:], bool))
        figures.append((sum(int(c.sum()) for c in costs), spent))
    seams.LARGE = before
    return figures


if __name__ == "__main__":
    main()
