# SPDX-License-Identifier: Apache-2.0
"""Regions filled by --texfill and by other tools, on photos that nothing was tuned on.

python -m benchmarks.tiles.fills [--set photos|more] [--side 352] [--sheet FILE]

Each photo loses a blob and a cable. Other tools run under $PEERS_PYTHON: pip install opencv-python-headless gmic. With
--sheet, the results are drawn side by side.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import skimage
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, gaussian_filter

from benchmarks.shared.measures import data_folder, load, luma
from benchmarks.shared.peers import interpreter
from oiiotex import filters
from tests.any_filter import buffer, pixels
from tests.lattices import regular
from tests.masonry import ashlar

PHOTOS = (
    "fieldstone_wall_kodim01.jpg", "pebbles_beach_shadow.jpg", "flower_meadow_stones.jpg", "drone_track_grass_soil.jpg",
    "sandstone_wall_cracked.jpg", "stained_plaster_wall.jpg", "marble_tiles_4x4.jpg", "rust_barrel_side.jpg",
)  # fmt: skip
SCENES = "rocket.jpg", "chelsea.png"  # of scikit-image
MORE = (
    "roof_slates.jpg", "facade_tiles.jpg", "moss_grass_stones_ground.jpg", "onyx_veins.jpg",
    "rebar_concrete_decayed.jpg", "sail_cloth_stained.jpg", "brick.png", "gravel.png",
)  # fmt: skip
DRAWN = "ashlar", "parquet"
OCTAVES = 1.0, 2.0, 4.0, 8.0  # px
RING, RIM, STEP = 12, 6, 6.0  # px: what is around the region; its outermost pixels; sigma of levels

_PEERS = """
import sys, time, numpy as np
a, m = (np.load(name) for name in sys.argv[1:3])
m = m.astype(np.uint8) * 255
try:
    import cv2
    for name, how in (("OpenCV Telea", cv2.INPAINT_TELEA), ("OpenCV Navier-Stokes", cv2.INPAINT_NS)):
        start = time.process_time()
        np.save(f"{sys.argv[3]}/{name}.npy", cv2.inpaint(a, m, 5, how))
        print(name, time.process_time() - start, sep="\\t")
    import gmic
    cv2.imwrite(f"{sys.argv[3]}/a.ppm", a)
    cv2.imwrite(f"{sys.argv[3]}/m.pgm", m)
    for name, line in (("inpaint", "9,20,0.1,1.2"), ("inpaint_matchpatch", "0,9,10,5,0")):
        start, out = time.process_time(), f"{sys.argv[3]}/o.ppm"
        gmic.run(f"v - {sys.argv[3]}/a.ppm {sys.argv[3]}/m.pgm {name}[0] [1],{line} cut[0] 0,255 output[0] {out}")
        np.save(f"{sys.argv[3]}/G'MIC {name}.npy", cv2.imread(out))
        print(f"G'MIC {name}", time.process_time() - start, sep="\\t")
except ImportError:
    pass
"""


def region_of(height: int, width: int, seed: int) -> np.ndarray:
    """A blob of a sixth of the shorter side, and a cable, (height, width) bool."""
    random, side = np.random.default_rng(seed), min(height, width)
    y, x = np.indices((height, width))
    top, left = height * random.uniform(0.4, 0.6), width * random.uniform(0.4, 0.6)
    turn = np.arctan2(y - top, x - left)
    waves = 0.25 * np.sin(3 * turn + random.uniform(0, 6)) + 0.12 * np.sin(5 * turn + random.uniform(0, 6))
    cable = np.abs(y - 0.15 * height - 0.15 * (x - width / 2)) < 0.018 * side
    return cable | (np.hypot(y - top, 0.8 * (x - left)) < 0.17 * side * (1 + waves))


def fills(photo: np.ndarray, region: np.ndarray) -> Iterator[tuple[str, np.ndarray, float]]:
    """Tool, result, CPU seconds; `photo` (height, width, 3) uint8."""
    start = time.process_time()
    made = filters.fill(buffer(photo / 255), buffer(region[..., None] * 1.0, space="", names=("Y",)))
    seconds = time.process_time() - start
    yield "oiiotex", np.rint(255 * pixels(made)).astype(np.uint8), seconds
    with tempfile.TemporaryDirectory() as folder:
        names = [f"{folder}/photo.npy", f"{folder}/region.npy"]
        for name, values in zip(names, (photo[..., ::-1], region), strict=True):
            np.save(name, np.ascontiguousarray(values))
        done = subprocess.run([interpreter(), "-c", _PEERS, *names, folder], capture_output=True, text=True, check=True)
        for line in done.stdout.splitlines():
            name, _, spent = line.partition("\t")
            if spent:
                yield name, np.load(f"{folder}/{name}.npy")[..., ::-1], float(spent)


def photo_named(name: str, side: int) -> np.ndarray:
    """A photo of the test data or of scikit-image, or a drawn one, (height, width, 3) uint8."""
    if name in DRAWN:
        values = ashlar(side, side, 3, (36, 80), 5)[0] if name == "ashlar" else regular("parquet", side, side, 1)
        return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
    path = data_folder() / "photos" / name
    path = path if path.exists() else Path(skimage.__file__).parent / "data" / name
    values = load(path, side).get_pixels(oiio.UINT8)
    return np.ascontiguousarray(np.broadcast_to(values, (*values.shape[:2], 3)))


def measures(photo: np.ndarray, filled: np.ndarray, region: np.ndarray) -> tuple[float, float, float, float]:
    """Seam, rim, detail and level step: see the table's caption."""
    light, around = luma(filled / 255), (distance_transform_edt(~region) < RING) & ~region
    jumps = [(np.abs(np.diff(light, axis=a)), np.diff(region, axis=a)) for a in (0, 1)]
    own = [np.abs(np.diff(luma(photo / 255), axis=a)) for a in (0, 1)]
    outside = [np.delete(around, -1, axis=a) & np.delete(around, 0, axis=a) for a in (0, 1)]
    seam = np.mean(np.concatenate([j[c] for j, c in jumps])) / np.mean(
        np.concatenate([o[w] for o, w in zip(own, outside, strict=True)])
    )
    rim = region & (distance_transform_edt(region) <= RIM)
    fine = [np.abs(values - gaussian_filter(values, 1.0))[rim].mean() for values in (light, luma(photo / 255))]
    inside = binary_erosion(region, iterations=3)
    wide = binary_dilation(region, iterations=3 * RING) & ~binary_dilation(region, iterations=3)
    ratios = []
    for sigma in OCTAVES:
        band = gaussian_filter(light, sigma / 2) - gaussian_filter(light, sigma)
        ratios.append(band[inside].std() / max(band[wide].std(), 1e-9))
    detail = float(np.mean([min(r, 1 / r) for r in ratios]))

    def level(where: np.ndarray) -> np.ndarray:
        weight = gaussian_filter(where.astype(float), STEP)
        return gaussian_filter(light * where, STEP) / np.maximum(weight, 1e-6)

    border = binary_dilation(region) & ~region
    step = np.abs(level(region) - level(~region))[border].mean() / light[~region].std()
    return float(seam), float(fine[0] / fine[1]), detail, float(step)


def main() -> None:
    """Print the table, and draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", choices=("photos", "more"), default="photos", help="which photos")
    parser.add_argument("--side", type=int, default=352, help="longer side of the photos, px")
    parser.add_argument("--sheet", type=Path, help="picture of all results")
    given = parser.parse_args()
    names = (*PHOTOS, *SCENES) if given.set == "photos" else (*MORE, *DRAWN)
    rows, tools, sheet = list[str](), dict[str, list[tuple[float, ...]]](), list[np.ndarray]()
    for number, name in enumerate(names):
        photo = photo_named(name, given.side)
        region = region_of(*photo.shape[:2], number)
        shown = [np.where(region[..., None], np.array([255, 0, 255], np.uint8), photo)]
        cells = []
        for tool, filled, seconds in fills(photo, region):
            found = (*measures(photo, filled, region), seconds)
            tools.setdefault(tool, []).append(found)
            cells.append(" / ".join(f"{value:.2f}" for value in found[:4]))
            shown.append(filled)
        rows.append(f"| {Path(name).stem} | {' | '.join(cells)} |")
        wide = [np.pad(one, ((0, given.side - len(one)), (0, given.side - one.shape[1]), (0, 0))) for one in shown]
        sheet.append(np.concatenate(wide, 1)[: len(photo)])
    print(f"| photo | {' | '.join(tools)} |\n|{' --- |' * (1 + len(tools))}")
    print(*rows, sep="\n")
    means = [np.mean(values, 0) for values in tools.values()]
    print("| mean | " + " | ".join(" / ".join(f"{value:.2f}" for value in mean[:4]) for mean in means) + " |")
    print("| CPU s | " + " | ".join(f"{mean[4]:.2f}" for mean in means) + " |")
    if given.sheet:
        drawn = np.concatenate(sheet, 0)
        out = oiio.ImageBuf(oiio.ImageSpec(drawn.shape[1], drawn.shape[0], 3, oiio.UINT8))
        out.set_pixels(out.roi, np.ascontiguousarray(drawn))
        out.write(str(given.sheet))


if __name__ == "__main__":
    main()
