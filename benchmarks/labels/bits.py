# SPDX-License-Identifier: Apache-2.0
"""Verify that labels of photos are bit-identical under several settings of the CPU, the BLAS and its threads.

python -m benchmarks.labels.bits [--side 400] [PHOTO ...]

Each setting runs in a separate process. For each photo it prints the digests of all levels, finest first, under the
first setting, and the levels that differ under the others.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys

import OpenImageIO as oiio

from benchmarks.shared.measures import data_folder
from oiiotex import filters

SETTINGS = {
    "as it is": {},
    "no AVX-512": {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"},
    "no AVX2": {
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2_Usable,-FMA_Usable,-AVX2,-FMA,-FMA4",
        "OPENBLAS_CORETYPE": "Nehalem",
    },
    "OpenBLAS of Skylake X, two threads": {"OPENBLAS_CORETYPE": "SkylakeX", "OPENBLAS_NUM_THREADS": "2"},
    "OpenBLAS of Sandy Bridge, one thread": {"OPENBLAS_CORETYPE": "Sandybridge", "OPENBLAS_NUM_THREADS": "1"},
}  # fmt: skip
PHOTOS = (
    "photos/fieldstone_wall_kodim01.jpg", "photos/flower_meadow_stones.jpg", "photos/rust_barrel_side.jpg",
    "photos/stone_breccia.jpg", "photos/stained_plaster_wall.jpg", "photos/roof_slates.jpg",
    "photos/clover_lawn.jpg", "photos/bark_flaky.jpg",
)  # fmt: skip


def digests(photos: list[str], side: int) -> dict[str, list[str]]:
    """Of every photo, `side` px wide: a digest for each level."""
    made = {}
    for name in photos:
        photo = oiio.ImageBuf(str(data_folder() / name))
        height = round(side * photo.spec().height / photo.spec().width)
        photo = oiio.ImageBufAlgo.resize(photo, roi=oiio.ROI(0, side, 0, height))
        photo.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
        levels = filters.label(photo)
        made[name] = [_digest(part) for name, part in levels.items() if name.startswith("label")]
    return made


def _digest(part: oiio.ImageBuf) -> str:
    pixels = part.get_pixels(oiio.UINT32)
    return f"{int(pixels.max())}:{hashlib.sha256(pixels.tobytes()).hexdigest()[:8]}"


def main() -> None:
    """Ask all settings and compare."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--side", type=int, default=400)
    asked.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    asked.add_argument("photos", nargs="*", default=list(PHOTOS), metavar="PHOTO")
    given = asked.parse_args()
    if given.child:
        print(json.dumps(digests(given.photos, given.side)))
        return
    found = {}
    for name, variables in SETTINGS.items():
        words = [sys.executable, "-m", "benchmarks.labels.bits", "--child", "--side", str(given.side), *given.photos]
        done = subprocess.run(words, env=os.environ | variables, capture_output=True, text=True, check=True)
        found[name] = json.loads(done.stdout.splitlines()[-1])
    first, *others = found
    same = 0
    for photo in given.photos:
        print(photo, *found[first][photo])
        differing = {
            n: [a for a, b in zip(found[n][photo], found[first][photo], strict=False) if a != b] for n in others
        }
        differing = {n: d for n, d in differing.items() if d or len(found[n][photo]) != len(found[first][photo])}
        same += not differing
        for name, levels in differing.items():
            print(f"    {name}: {', '.join(levels)}")
    print(f"{same} of {len(given.photos)} photos have the same bits under {len(SETTINGS)} settings")


if __name__ == "__main__":
    main()
