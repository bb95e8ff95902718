# SPDX-License-Identifier: Apache-2.0
"""The same chain through oiiotool and through oiiotex: wall time and peak memory, as ratios of one run.

`python -m benchmarks.speed.chains [--size 8192] [--runs 3] [--only NAME]`
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import Spent, measured
from oiiotex.engine.core.image import Image, Part
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.formats import Format
from oiiotex.engine.io.writing import write

BIN = Path(sys.executable).parent
CHAINS = {
    "copy": "a.exr -o out.exr",
    "one point op": "a.exr --mulc 0.9 -o out.exr",
    "four point ops": "a.exr --mulc 0.9 --addc 0.1 --powc 0.8 --clamp:min=0:max=1 -o out.exr",
    "two images": "a.exr b.exr --over -o out.exr",
    "to sRGB 8 bit": "a.exr --colorconvert lin_rec709_scene srgb_rec709_scene -d uint8 -o out.tif",
    "tiled copy": "t.exr --tile 64 64 -o out.exr",
    "resize 50%": "a.exr --resize 50% -o out.exr",
    "blur 7x7": "a.exr --blur 7x7 -o out.exr",
    "flip": "a.exr --flip -o out.exr",
    "rotate90": "a.exr --rotate90 -o out.exr",
    "crop": "a.exr --crop 1000x1000+1000+1000 -o out.exr",
}


def picture(size: int, channels: int, seed: int) -> Part:
    """A smooth picture with some grain, computed by window."""
    spec = oiio.ImageSpec(size, size, channels, oiio.HALF)
    grain = np.random.default_rng(seed).normal(0, 0.02, (256, size, channels)).astype(np.float32)

    def fetch(window: Window) -> np.ndarray:
        y = np.arange(window.top, window.bottom)[:, None, None] / size
        x = np.arange(window.left, window.right)[None, :, None] / size
        base = 0.5 + 0.3 * np.sin(9 * x + 3 * seed) * np.cos(7 * y)
        rows = grain[np.arange(window.top, window.bottom) % 256][:, window.left : window.right]
        return np.clip(base + rows, 0, 1).astype(np.float16)

    return Part("rgba", spec, fetch, spec.format)


def main() -> None:
    """Print a table."""
    options = argparse.ArgumentParser()
    options.add_argument("--size", type=int, default=4096)
    options.add_argument("--runs", type=int, default=3)
    options.add_argument("--only", default="")
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for seed, file in enumerate(("a.exr", "b.exr")):
            write(Image((picture(given.size, 4, seed),)), folder / file)
        write(Image((picture(given.size, 4, 0),)), folder / "t.exr", Format(tile=(64, 64)))
        print("| chain | oiiotool s | oiiotex s | ratio | oiiotool MB | oiiotex MB | ratio |\n" + "|---" * 7 + "|")
        for title, chain in CHAINS.items():
            if given.only not in title:
                continue
            found: dict[str, list[Spent]] = {"oiiotool": [], "oiiotex": []}
            for _ in range(given.runs):
                for program, runs in found.items():
                    runs.append(measured([str(BIN / program), *chain.split()], folder))
            (a, am), (b, bm) = (
                (statistics.median(r.wall for r in runs), max(r.megabytes for r in runs)) for runs in found.values()
            )
            print(f"| {title} | {a:.2f} | {b:.2f} | {b / a:.2f} | {am} | {bm} | {bm / am:.2f} |", flush=True)


if __name__ == "__main__":
    main()
