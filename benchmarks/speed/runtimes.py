# SPDX-License-Identifier: Apache-2.0
"""OpenCL runtimes for the CPU that are installed here: a tile of 384 px by each.

python -m benchmarks.speed.runtimes [--runs 2]

The first run of each runtime compiles the kernels in an empty cache. The photo is clover_lawn.jpg.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import tempfile
from pathlib import Path

import OpenImageIO as oiio

from benchmarks.shared.measures import Spent, data_folder, measured
from benchmarks.speed.programs import PROGRAM
from oiiotex.engine.opencl.device_choice import devices

SIDE = 384


def tiles(number: int, runs: int, folder: Path) -> tuple[Spent, list[Spent], str]:
    """Cost of the first run, and of the others, on the device of that number; a hash of the tile's pixels."""
    os.environ["XDG_CACHE_HOME"] = os.environ["POCL_CACHE_DIR"] = str(folder / f"cache{number}")
    line = [*PROGRAM, "--noprogress", "--device", str(number), "photo.png", "--texstationarize", "-o", f"{number}.png"]
    first, *others = (measured(line, folder) for _ in range(1 + runs))
    pixels = oiio.ImageBuf(str(folder / f"{number}.png")).get_pixels(oiio.UINT8)
    return first, others, hashlib.sha256(pixels.tobytes()).hexdigest()[:8]


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=2)
    runs = parser.parse_args().runs
    print("| runtime | first run, CPU s | then CPU s | hash of the pixels |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        photo = oiio.ImageBuf(str(data_folder() / "photos" / "clover_lawn.jpg"))
        oiio.ImageBufAlgo.resize(photo, roi=oiio.ROI(0, SIDE, 0, SIDE)).write(str(folder / "photo.png"), "uint8")
        for info in devices(0):
            if info.kind != "cpu":
                continue
            first, others, pixels = tiles(info.number, runs, folder)
            then = min(one.cpu for one in others)
            print(f"| {info.platform}, {info.version} | {first.cpu:.2f} | {then:.2f} | {pixels} |", flush=True)


if __name__ == "__main__":
    main()
