# SPDX-License-Identifier: Apache-2.0
"""Similarity of two patches of one texture under different light, by hard and weighted histograms (CZF02 figure 1).

python -m benchmarks.subtextures.lit_patches

The figure is of one Brodatz texture; here two halves of a photo, one of them darker, are compared for ten photos by
Bhattacharyya's coefficient (eq. 3): with histograms in which every pixel belongs to its nearest bin alone, and with
the paper's, in which it belongs to all of them by weights (eq. 1). Bins are of color and of Haar details, eight each,
learned on both halves together. The coefficient of two different photos is also printed; weights should not raise it.
"""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio

from benchmarks.dominant.composites import seen_as
from benchmarks.shared.measures import data_folder, load
from oiiotex.analysis.segmentation.textons import BINS, weighted_counts
from oiiotex.engine.session import Session

SIDE = 96  # px, of a half
DARKER = 0.8  # of the sRGB values
PHOTOS = (
    "clover_lawn", "fabric_gingham_weave", "roof_slates", "sandstone_wall_cracked", "pebbles_beach_shadow",
    "castle_brick_broken", "stone_breccia", "bark_flaky", "drone_forest_canopy", "onyx_veins",
)  # fmt: skip


def likeness(left: np.ndarray, right: np.ndarray, session: Session) -> tuple[float, float]:
    """Of two pictures (SIDE, SIDE, 3) in 0 .. 1: by hard histograms, by weighted ones."""
    weights = weighted_counts(seen_as(np.concatenate([left, right], axis=1), session), session.resources).values
    groups = weights.reshape(SIDE, 2, SIDE, 2, BINS).astype(np.float64)  # row, half, column, group, bin
    hard = (groups == groups.max(-1, keepdims=True)).astype(np.float64)
    return coefficient(hard), coefficient(groups)


def coefficient(values: np.ndarray) -> float:
    """CZF02 eq. 3 of the two halves, the mean over both groups of bins."""
    shares = values.sum((0, 2))
    shares /= shares.sum(-1, keepdims=True)
    return float(np.sqrt(shares[0] * shares[1]).sum(-1).mean())


def main() -> None:
    """Measure and print."""
    session = Session()
    folder = data_folder() / "photos"
    photos = [load(folder / f"{name}.jpg", 512).get_pixels(oiio.FLOAT)[:SIDE, : 2 * SIDE, :3] for name in PHOTOS]
    print("| photo | darker: hard | weighted | other photo: hard | weighted |", "|---" * 5 + "|", sep="\n")
    rows = []
    for n, (name, photo) in enumerate(zip(PHOTOS, photos, strict=True)):
        left, right = photo[:, :SIDE], photo[:, SIDE:]
        rows.append((*likeness(left, DARKER * right, session), *likeness(left, photos[n - 1][:, :SIDE], session)))
        print("|", " | ".join([name, *(f"{x:.3f}" for x in rows[-1])]), "|", flush=True)
    print("| mean |", " | ".join(f"{x:.3f}" for x in np.mean(rows, 0)), "|")


if __name__ == "__main__":
    main()
