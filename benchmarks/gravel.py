# SPDX-License-Identifier: Apache-2.0
"""The demo's photo: gravel with a gradient of light and a stain, over ten seeds, at the shipped defaults.

python -m benchmarks.gravel [--seeds 10]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from benchmarks import measures
from docs.demo import gravel, save, stained
from oiiotex import filters


def row(rgb: np.ndarray, clean: np.ndarray) -> tuple[float, ...]:
    """(wrap percentile x, y, LowF, sharpness and contrast relative to the clean photo) of 8-bit pixels."""
    gray = measures.luma(rgb)
    return (
        measures.wrap_percentile(gray, 1),
        measures.wrap_percentile(gray, 0),
        measures.low_frequency(gray),
        measures.sharpness(gray) / measures.sharpness(clean),
        float(gray.std() / clean.std()),
    )


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    arguments = parser.parse_args()
    clean = gravel().astype(np.float64)
    photo = stained(gravel())
    with tempfile.TemporaryDirectory() as folder:
        save(photo, Path(folder) / "photo.png")
        buffer = oiio.ImageBuf(f"{folder}/photo.png")
        buffer.read(force=True)
    print(f"{'':10s} {'wrap % x':>9s} {'wrap % y':>9s} {'LowF':>6s} {'sharp':>6s} {'contrast':>9s}")
    form = "{:10s} {:9.1f} {:9.1f} {:6.2f} {:6.3f} {:9.3f}"
    print(form.format("clean", *row(gravel()[..., None].repeat(3, 2), clean)))
    print(form.format("photo", *row(photo, clean)))
    rows = []
    for seed in range(arguments.seeds):
        rows.append(row(filters.stationarize(buffer, seed=seed).get_pixels(oiio.UINT8), clean))
        print(form.format(f"seed {seed}", *rows[-1]), flush=True)
    print(form.format("mean", *np.mean(rows, axis=0)))


if __name__ == "__main__":
    main()
