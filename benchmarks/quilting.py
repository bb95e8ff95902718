# SPDX-License-Identifier: Apache-2.0
"""--texquilt: how fast, how wide, how good. `python -m benchmarks.quilting [speed wide guided quality fidelity]`.

speed: 1024 x 1024 from a 256 x 256 crop, the whole command, beside the peers that synthesize (benchmarks/peers.py).
wide: CPU seconds per output megapixel from 4096 to 65536 columns.
guided: LSA16 figure 12: an exemplar of 2560 x 1920 and a guide to 16638 x 11776, written as tiled EXR with zip.
quality: seams, verbatim copies and the most repeated region on test photos.
fidelity: how much of a guide is found again in the labels of the sources, on six photos.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex.files import read
from oiiotex.synthesis.patchmatch import hash_at
from oiiotex.synthesis.plans import Plan

from .peers import PEERS, ToolError

PHOTOS = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")) / "photos"
PHOTOS_SEEN = (
    "bark_flaky", "castle_brick_broken", "clover_lawn", "drone_forest_canopy", "fabric_gingham_weave", "onyx_veins",
    "flower_meadow_stones", "pebbles_beach_shadow", "roof_slates", "rust_barrel_side", "stained_plaster_wall",
    "stone_breccia",
)  # fmt: skip
SIX = ("flower_meadow_stones", "stone_breccia", "moss_grass_stones_ground", "rust_barrel_side",
       "drone_track_grass_soil", "stained_plaster_wall")  # fmt: skip
SPACE = ("--iscolorspace", "srgb_rec709_scene")


def oiiotex(*words: object, cwd: Path) -> tuple[float, float, int]:
    """Run the program: wall and CPU seconds, and its resident memory at most in MB."""
    start = time.perf_counter()
    child = subprocess.Popen([sys.executable, "-m", "oiiotex.cli.main", *map(str, words)], cwd=cwd)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - start
    if child.returncode:
        sys.exit(f"oiiotex failed: {words}")
    return wall, used.ru_utime + used.ru_stime, used.ru_maxrss // 1024


def speed(folder: Path) -> None:
    """The whole command from a 256 x 256 crop, best of three, beside peers in turn."""
    crop = folder / "crop.png"
    oiiotex(PHOTOS / "pebbles_beach_shadow.jpg", "--crop", "256x256+200+150", "--fullpixels", "-o", crop, cwd=folder)
    oiiotex(
        crop, *SPACE, "--texquilt:size=64x64", "-o", "warm.png", cwd=folder
    )  # kernels are compiled once per machine
    ours, peers = [], {}
    for _ in range(3):
        ours.append(oiiotex(crop, *SPACE, "--texquilt:size=1024x1024", "-o", "a.png", cwd=folder)[:2])
        for tool in PEERS:
            if tool.name == "gmic-matchpatch" and tool.available():
                try:
                    seconds = tool.run(crop, folder / "peer.png", (1024, 1024))
                except ToolError as error:
                    print(tool.name, error)
                    continue
                peers[tool.name] = min(seconds, peers.get(tool.name, np.inf))
    wall, cpu = min(ours)
    print(f"1024 x 1024 from 256 x 256: oiiotex {wall:.2f} s wall, {cpu:.2f} s CPU")
    for name, seconds in peers.items():
        print(f"  {name} {seconds:.2f} s wall: {seconds / wall:.1f} times ours")


def wide(folder: Path) -> None:
    """Does a wider output cost more per pixel?"""
    photo = PHOTOS / "clover_lawn.jpg"
    for width in (4096, 16384, 65536):
        size = f"{width}x{(1 << 26) // width}"
        words = (f"--texquilt:size={size}:patch=64", "--tile", 64, 64, "-d", "half", "--compression", "zip")
        wall, cpu, memory = oiiotex(photo, *SPACE, *words, "-o", "wide.exr", cwd=folder)
        print(f"{size}: {cpu / 67.1:.3f} CPU s per Mpx, {wall:.1f} s wall, {memory} MB")


def regions(labels: np.ndarray, height: int, width: int, seed: int, count: int = 4) -> np.ndarray:
    """A guide: wobbly cells that ask for the largest labels."""
    area = np.bincount(labels.ravel())
    area[0] = 0
    best = np.argsort(-area, kind="stable")[: min(count, np.count_nonzero(area))]
    y, x = np.mgrid[:height, :width].astype(float)
    y += 0.05 * height * np.sin(7 * x / width * np.pi)
    points = hash_at(seed, 1, *np.mgrid[:14, :2]) / 2.0**32 * (height, width)
    return best[np.argmin([(y - a) ** 2 + (x - b) ** 2 for a, b in points], 0) % len(best)]


def save_ids(ids: np.ndarray, path: Path) -> None:
    """As a TIFF of bytes."""
    buffer = oiio.ImageBuf(oiio.ImageSpec(ids.shape[1], ids.shape[0], 1, oiio.UINT8))
    buffer.set_pixels(buffer.roi, ids.astype(np.uint8)[..., None])
    assert buffer.write(str(path)), buffer.geterror()


def guided(folder: Path) -> None:
    """LSA16 figure 12."""
    photo = PHOTOS / "moss_grass_stones_ground.jpg"
    grown = ("--resize", "2560x2560", "--crop", "2560x1920+0+200", "--fullpixels")
    oiiotex(photo, *SPACE, *grown, "--texlabel:keep=1", "-o", "labels.exr", cwd=folder)
    levels = [p.name for p in read(folder / "labels.exr").parts[1:]]
    level = int(levels[-1][6:])
    save_ids(regions(read(folder / "labels.exr").part(levels[-1]).pixels()[..., 0], 736, 1040, 1), folder / "guide.tif")
    quilt = f"--texquilt:guide=guide.tif:level={level}:size=16638x11776"
    words = (quilt, "--tile", 64, 64, "--compression", "zip", "-d", "half", "-o", "huge.exr")
    wall, cpu, memory = oiiotex("labels.exr", *words, cwd=folder)
    size = (folder / "huge.exr").stat().st_size >> 20
    print(f"2560 x 1920 to 16638 x 11776: {wall:.1f} s wall, {cpu:.1f} s CPU, {memory} MB resident, {size} MB EXR")


def sources(path: Path, photo: Path) -> tuple[np.ndarray, np.ndarray]:
    """(y, x) in the photo of every pixel of an ST map."""
    st, spec = read(path).first.pixels(), read(photo).first.spec
    return np.floor(st[..., 1] * spec.height).astype(int), np.floor(st[..., 0] * spec.width).astype(int)


def quality(folder: Path) -> None:
    """Numbers for twelve photos at their defaults."""
    print(f"{'photo':24} {'patch':>5} {'seams':>6} {'verbatim':>8} {'most/fair':>9}")
    for name in PHOTOS_SEEN:
        photo = PHOTOS / f"{name}.jpg"
        oiiotex(photo, *SPACE, "--texquilt:size=1400x1000:seed=1:stmap=st.exr:plan=p.npz", "-o", "a.png", cwd=folder)
        y, x = sources(folder / "st.exr", photo)
        gray = read(photo).first.pixels().astype(float).mean(-1)[y, x]
        across = (np.diff(y, axis=1) == 0) & (np.diff(x, axis=1) == 1)
        down = (np.diff(y, axis=0) == 1) & (np.diff(x, axis=0) == 0)
        jumps = [(np.diff(gray, axis=1) ** 2, across), (np.diff(gray, axis=0) ** 2, down)]
        seam = np.mean([j[~whole].mean() / j[whole].mean() for j, whole in jumps])
        plan, (width, height) = Plan.load(folder / "p.npz")
        step = plan.grid.step
        blocks = (plan.offsets >> 16) // step * 10000 + (plan.offsets & 0xFFFF) // step
        there = -(-(height - plan.grid.patch + 1) // step) * -(-(width - plan.grid.patch + 1) // step)
        most = np.unique(blocks, return_counts=True)[1].max() / (blocks.size / there)
        share = (across[:-1] & down[:, :-1]).mean()
        print(f"{name:24} {plan.grid.patch:5} {seam:6.2f} {share:8.3f} {most:9.2f}")


def fidelity(folder: Path) -> None:
    """The label of the source of every pixel against the guide."""
    print(f"{'photo':26} {'level':>5} {'labels':>6} {'patch':>5} {'all':>6} {'> patch/2 from a border':>23}")
    for name in SIX:
        photo = PHOTOS / f"{name}.jpg"
        oiiotex(photo, *SPACE, "--texlabel:keep=1:json=l.json", "-o", "labels.exr", cwd=folder)
        levels = json.loads((folder / "l.json").read_text())["levels"]
        # a level with some labels to tell apart
        level = next((n for n in range(len(levels), 0, -1) if len(levels[n - 1]["labels"]) >= 4), 1)
        ids = read(folder / "labels.exr").part(f"label.{level}").pixels()[..., 0]
        guide = regions(ids, 175, 250, 3)
        save_ids(guide, folder / "guide.tif")
        quilt = f"--texquilt:guide=guide.tif:level={level}:size=2000x1400:stmap=st.exr:plan=p.npz"
        oiiotex("labels.exr", quilt, "-o", "a.png", cwd=folder)
        patch = Plan.load(folder / "p.npz")[0].grid.patch
        full = guide.repeat(8, 0).repeat(8, 1)
        right = ids[sources(folder / "st.exr", photo)] == full
        inside, far = np.ones(full.shape, bool), patch // 2
        for dy in (-far, 0, far):
            for dx in (-far, 0, far):
                inside &= np.roll(full, (dy, dx), (0, 1)) == full
        labels = len(levels[level - 1]["labels"])
        print(f"{name:26} {level:5} {labels:6} {patch:5} {right.mean():6.3f} {right[inside].mean():12.3f}")


def main() -> None:
    """Those that are named, or all."""
    found = {f.__name__: f for f in (speed, wide, guided, quality, fidelity)}
    for name in sys.argv[1:] or found:
        with tempfile.TemporaryDirectory() as folder:
            found[name](Path(folder))


if __name__ == "__main__":
    main()
