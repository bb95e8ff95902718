# SPDX-License-Identifier: Apache-2.0
"""Stability of a partition for another scale or other seeds, compared with SLIC (LSA16 section 3.2).

python -m benchmarks.superpixels.stability [--counts 33,100] [--photos NAME,NAME] [--seeds 3]

Two partitions A and B differ by the mean of two under-segmentation errors, that of A with B's regions as the truth and
that of B with A's, in percent: 0 for equal ones. For a partition and its refinement one of the two is 0. The variation
of information is in bits. `sigma`: the partition at sigma compared with those at sigma - 3 and sigma + 3 px, which
always have more and fewer superpixels; mean over four sigmas. `seeds`: compared with the same number of superpixels
from seeds that were moved at random by up to a quarter of a cell. For `seeds` the hierarchy's finest superpixels
change, for `sigma` its levels. scikit-image's SLIC takes no seeds.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from unittest import mock

import numpy as np
from skimage.metrics import variation_of_information

from benchmarks.shared.measures import data_folder
from benchmarks.superpixels.quality import load, under_segmentation
from benchmarks.superpixels.segmenters import scikit_slic
from oiiotex.analysis.superpixels import superpixels as module
from oiiotex.analysis.superpixels.hierarchy import hierarchy
from oiiotex.analysis.superpixels.slic import Slic
from oiiotex.analysis.superpixels.superpixels import Superpixels, superpixels
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.core.image import Image
from oiiotex.engine.session import Session

PHOTOS = ("castle_brick_broken", "fieldstone_wall_kodim01", "flower_meadow_stones", "moss_grass_stones_ground",
          "pebbles_beach_shadow", "rust_barrel_side", "stained_plaster_wall", "stone_breccia")  # fmt: skip
STEP = 3.0  # px
BASES = (0.8, 0.9, 1.0, 1.15)  # times the count: SLIC's grid of seeds is the same over a range of sigma, and then jumps


def distance(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Mean under-segmentation of two partitions (h, w), percent, and their variation of information, bits."""
    a, b = (np.unique(p, return_inverse=True)[1].reshape(p.shape) for p in (a, b))
    error = 50.0 * (under_segmentation(a, b) + under_segmentation(b, a))
    return error, float(sum(variation_of_information(a, b)))


class Moved(Slic):
    """SLIC whose first seeds are moved at random."""

    seed = 0

    def iterate(self, iterations: int, jitter: np.ndarray | None = None) -> np.ndarray:
        """As SLIC's, with jitter."""
        return super().iterate(iterations, module._jitter(self.grid, self.seed, 1))


class Photo:
    """One photo, and how each method cuts it."""

    def __init__(self, image: Image, session: Session):
        self.image, self.session = image, session
        self.lens = lens_of(image, session.resources)
        self.shape = image.first.spec.height, image.first.spec.width
        self.lab = self.lens.values(image.first.pixels())[0][..., :3].astype(np.float64)
        self._finest: dict[int, Superpixels] = {}

    def ours(self, sigma: float | None, seed: int) -> Superpixels:
        """SLIC of one scale; seed 0 leaves the seeds where they are."""
        Moved.seed = seed
        with mock.patch.object(module, "Slic", Moved if seed else Slic):
            return superpixels(self.image, self.lens, self.session.resources, sigma=sigma)

    def hierarchy(self, count: int, seed: int = 0) -> np.ndarray:
        """The hierarchy's partition into `count` superpixels."""
        found = self._finest.setdefault(seed, None) or self.ours(None, seed)
        self._finest[seed] = found
        last = np.sqrt(self.shape[0] * self.shape[1] / (count - 1))
        levels = hierarchy(found, self.session.resources, np.arange(found.sigma, last + STEP, STEP))
        return found.runs.relabeled(levels.partition_of(count)).pixels(0, self.shape[0], 0, self.shape[1])

    def slic(self, count: int, seed: int = 0) -> np.ndarray:
        """Our SLIC at that scale."""
        return self.ours(float(np.sqrt(self.shape[0] * self.shape[1] / count)), seed).labels.pixels()[..., 0]

    def scikit(self, count: int, seed: int = 0) -> np.ndarray:
        """scikit-image's."""
        return scikit_slic(self.lab, count)


def moves(photo: Photo, method: str, count: int, seeds: int) -> dict[str, tuple[float, float]]:
    """Mean distances by what was changed."""
    area = photo.shape[0] * photo.shape[1]
    cut = getattr(photo, method)
    apart = []
    for base in BASES:
        sigma = np.sqrt(area / (base * count))
        first, *near = (cut(round(area / (sigma + d) ** 2)) for d in (0.0, -STEP, STEP))
        apart += [distance(first, other) for other in near]
    found = {"sigma": np.mean(apart, 0)}
    if method != "scikit":
        first = cut(count)
        others = [cut(count, seed) for seed in range(1, seeds + 1)]
        found["seeds"] = np.mean([distance(first, other) for other in others], 0)
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--counts", default="33,100")
    parser.add_argument("--photos", default=",".join(PHOTOS))
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    columns = [
        ("hierarchy", "sigma"),
        ("slic", "sigma"),
        ("scikit", "sigma"),
        ("hierarchy", "seeds"),
        ("slic", "seeds"),
    ]
    session = Session()
    for count in map(int, given.counts.split(",")):
        print(f"\nabout {count} superpixels: mean under-segmentation both ways, % (variation of information, bits)")
        print(f"{'':26s}" + "".join(f"{' '.join(c):>18s}" for c in columns))
        rows = []
        for name in given.photos.split(","):
            path = next(p for p in sorted((data_folder() / "photos").iterdir()) if p.stem == Path(name).stem)
            photo = Photo(load(path), session)
            found = {m: moves(photo, m, count, given.seeds) for m in dict.fromkeys(c[0] for c in columns)}
            rows.append([found[method][what] for method, what in columns])
            print(f"{name:26s}" + "".join(f"{e:10.1f} ({v:5.2f})" for e, v in rows[-1]), flush=True)
        print(f"{'mean':26s}" + "".join(f"{e:10.1f} ({v:5.2f})" for e, v in np.mean(rows, 0)))


if __name__ == "__main__":
    main()
