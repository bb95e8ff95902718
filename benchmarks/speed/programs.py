# SPDX-License-Identifier: Apache-2.0
"""Whole programs: start, reading, kernels from the cache, and writing.

python -m benchmarks.speed.programs [--runs 2] [--large] [--only PART]

Each line runs once to fill caches (not with --large), then `--runs` times; the best of each figure is printed. Memory
is the peak; values below 110 MB are those of the measuring program. Photos are clover_lawn.jpg, resized, and the
map of Mars of 33 megapixels.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import OpenImageIO as oiio

from benchmarks.shared.measures import Spent, data_folder, measured

PROGRAM = (sys.executable, "-m", "oiiotex")
SIZES = {"256": (256, 256), "512": (512, 512), "640": (640, 427), "1024": (1024, 1024), "2560": (2560, 1920)}
LINES = (
    "--version",
    "640.png -o out.png",
    "512.png --texstationarize -o out.png",
    "1024.png --texstationarize -o out.png",
    "1024.png --texstationarize:paper=1 -o out.png",
    "1024.png --texstationarize:paper=1:measure=moments -o out.png",
    "1024.png --texstationarize:paper=1:measure=steerable -o out.png",
    "256.png --texquilt:size=1024x1024 -o out.png",
    "640.png --texcut:size=1024x1024 -o out.png",
    "256.png --texsynth:size=4096x4096 -d half -o out.exr",
    "640.png --texlabel -o out.exr",
    "2560.png --texlabel -o out.exr",
    "2560.png --texsuperpixel -o out.exr",
    "512.png --texdecompose -o out.exr",
    "512.png --texdominant -o out.png",
    "2560.png --texflatten -d half -o out.exr",
)
LARGE = (
    "--cache 512 1024.png --texstationarize:size=4096x4096:seed=1 -d half -o out.exr",
    "--cache 512 mars.tif --texstationarize:size=1024x1024:seed=1 -o out.exr",
    "--cache 400 mars.tif --texsuperpixel -o out.exr",
    "--cache 900 mars.tif --texlabel -o out.exr",
    "--cache 400 mars.tif --texflatten -d half -o out.exr",
)


def write_photos(folder: Path, large: bool) -> None:
    """The files that the lines name."""
    for name, (width, height) in SIZES.items():
        photo = oiio.ImageBuf(str(data_folder() / "photos" / "clover_lawn.jpg"))
        oiio.ImageBufAlgo.resize(photo, roi=oiio.ROI(0, width, 0, height)).write(str(folder / f"{name}.png"), "uint8")
    if large:
        mars = oiio.ImageBuf(str(data_folder() / "large" / "large_mars_global_33mp.jpg"))
        mars.set_write_tiles(64, 64)
        mars.write(str(folder / "mars.tif"), "uint8")


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--large", action="store_true", help="the lines that take minutes")
    parser.add_argument("--only", default="", help="lines that contain this")
    given = parser.parse_args()
    print("| line | wall-clock s | CPU s | MB |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_photos(folder, given.large)
        for line in LARGE if given.large else LINES:
            if given.only not in line:
                continue
            words = [*PROGRAM, *(() if line.startswith("--version") else ("--iscolorspace", "sRGB")), *line.split()]
            runs = [measured(words, folder) for _ in range(given.runs + (not given.large))][-given.runs :]
            best = Spent(*map(min, zip(*runs, strict=True)))
            print(f"| `{line}` | {best.wall:.2f} | {best.cpu:.2f} | {best.megabytes} |", flush=True)


if __name__ == "__main__":
    main()
