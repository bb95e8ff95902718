# SPDX-License-Identifier: Apache-2.0
"""--texquilt: how fast, how wide, how good. `python -m benchmarks.quilts.quilting [NAME ...]`.

speed: 1024 x 1024 from a 256 x 256 crop, the whole command, compared with peers that synthesize (shared/peers.py).
wide: CPU seconds per output megapixel from 4096 to 65536 columns.
guided: LSA16 figure 12: an exemplar of 2560 x 1920 and a guide to 16638 x 11776, written as tiled EXR with zip.
quality: seams, verbatim copies and the most repeated region on test photos.
patches: the same on three photos that are smooth between large edges, by the side of a patch.
peers: 1024 x 1024 from 256 x 256 crops of four photos, compared with all installed synthesis tools: time, verbatim
copies and the most repeated region, from the place of each block in the exemplar (benchmarks/quilts/copies.py).
fidelity: agreement with a guide, on six photos: by the labels of the sources, and by the result's appearance
(benchmarks/quilts/relabel.py).
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

from benchmarks.quilts.copies import copies
from benchmarks.quilts.relabel import far_from_borders, relabeled
from benchmarks.shared.peers import CROPS, PEERS, SYNTHESIZERS, ToolError
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.io.reading import read
from oiiotex.synthesis.patchmatch.field import hash_at
from oiiotex.synthesis.quality.copy_detection import most_shown
from oiiotex.synthesis.quilting.quilt_plan import QuiltPlan

PHOTOS = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")).resolve() / "photos"
PHOTOS_SEEN = (
    "bark_flaky", "castle_brick_broken", "clover_lawn", "drone_forest_canopy", "fabric_gingham_weave", "onyx_veins",
    "flower_meadow_stones", "pebbles_beach_shadow", "roof_slates", "rust_barrel_side", "stained_plaster_wall",
    "stone_breccia",
)  # fmt: skip
SMOOTH = ("pebbles_beach_shadow", "onyx_veins", "flower_meadow_stones")
SIX = ("flower_meadow_stones", "stone_breccia", "moss_grass_stones_ground", "rust_barrel_side",
       "drone_track_grass_soil", "stained_plaster_wall")  # fmt: skip
SPACE = ("--iscolorspace", "srgb_rec709_scene")
BUDGET = 1 << 30  # bytes that a plan may have


def oiiotex(*words: object, cwd: Path) -> tuple[float, float, int]:
    """Run the program: wall and CPU seconds, and its resident memory at most in MB."""
    start = time.perf_counter()
    child = subprocess.Popen([sys.executable, "-m", "oiiotex", *map(str, words)], cwd=cwd)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - start
    if child.returncode:
        sys.exit(f"oiiotex failed: {words}")
    return wall, used.ru_utime + used.ru_stime, used.ru_maxrss // 1024


def speed(folder: Path) -> None:
    """The whole command from a 256 x 256 crop, best of three, alternating with peers."""
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
    oiiotex(photo, *SPACE, *grown, "--texlabel:photo=1", "-o", "labels.exr", cwd=folder)
    levels = [p.name for p in read(folder / "labels.exr").parts[1:]]
    level = int(levels[-1][6:])
    save_ids(regions(read(folder / "labels.exr").part(levels[-1]).pixels()[..., 0], 736, 1040, 1), folder / "guide.tif")
    quilt = f"--texquilt:guide=guide.tif:labellevel={level}:size=16638x11776"
    words = (quilt, "--tile", 64, 64, "--compression", "zip", "-d", "half", "-o", "huge.exr")
    wall, cpu, memory = oiiotex("labels.exr", *words, cwd=folder)
    size = (folder / "huge.exr").stat().st_size >> 20
    print(f"2560 x 1920 to 16638 x 11776: {wall:.1f} s wall, {cpu:.1f} s CPU, {memory} MB resident, {size} MB EXR")


def sources(path: Path, photo: Path) -> tuple[np.ndarray, np.ndarray]:
    """(y, x) in the photo of every pixel of an ST map."""
    st, spec = read(path).first.pixels(), read(photo).first.spec
    return np.floor(st[..., 1] * spec.height).astype(int), np.floor(st[..., 0] * spec.width).astype(int)


def most_used(path: Path) -> tuple[QuiltPlan, float]:
    """A plan, and how often its most used region stands in it over its fair share, by blocks of offsets."""
    plan, (width, height) = QuiltPlan.load(path, BUDGET)
    step = plan.grid.step
    blocks = (plan.offsets >> 16) // step * 10000 + (plan.offsets & 0xFFFF) // step
    there = -(-(height - plan.grid.patch + 1) // step) * -(-(width - plan.grid.patch + 1) // step)
    return plan, np.unique(blocks, return_counts=True)[1].max() / (blocks.size / there)


def seams(st: Path, photo: Path) -> tuple[float, float]:
    """Mean squared jump at seams over that inside patches; the share of pixels with both neighbors of the photo."""
    y, x = sources(st, photo)
    gray = read(photo).first.pixels().astype(float).mean(-1)[y, x]
    across = (np.diff(y, axis=1) == 0) & (np.diff(x, axis=1) == 1)
    down = (np.diff(y, axis=0) == 1) & (np.diff(x, axis=0) == 0)
    jumps = [(np.diff(gray, axis=1) ** 2, across), (np.diff(gray, axis=0) ** 2, down)]
    return np.mean([j[~whole].mean() / j[whole].mean() for j, whole in jumps]), (across[:-1] & down[:, :-1]).mean()


def quality(folder: Path) -> None:
    """Numbers for twelve photos at their defaults."""
    print(f"{'photo':24} {'patch':>5} {'seams':>6} {'verbatim':>8} {'most/fair':>9}")
    for name in PHOTOS_SEEN:
        photo = PHOTOS / f"{name}.jpg"
        oiiotex(photo, *SPACE, "--texquilt:size=1400x1000:seed=1:st=st.exr:planfile=p.npz", "-o", "a.png", cwd=folder)
        seam, share = seams(folder / "st.exr", photo)
        plan, most = most_used(folder / "p.npz")
        print(f"{name:24} {plan.grid.patch:5} {seam:6.2f} {share:8.3f} {most:9.2f}")


def patches(folder: Path) -> None:
    """Seams of photos that are smooth between large edges, by the patch."""
    print(f"{'photo':24} {'patch':>5} {'seams':>6} {'verbatim':>8} {'most/fair':>9}")
    for name in SMOOTH:
        for patch in (64, 128, 192, 256):
            quilt = f"--texquilt:size=1400x1000:seed=1:patch={patch}:st=st.exr:planfile=p.npz"
            oiiotex(PHOTOS / f"{name}.jpg", *SPACE, quilt, "-o", "a.png", cwd=folder)
            seam, share = seams(folder / "st.exr", PHOTOS / f"{name}.jpg")
            print(f"{name:24} {patch:5} {seam:6.2f} {share:8.3f} {most_used(folder / 'p.npz')[1]:9.2f}", flush=True)


def peers(folder: Path) -> None:
    """Each tool once per photo, in turn. Ours: `by the plan` counts offsets, `by sources` what is seen."""
    for tool in SYNTHESIZERS:
        if not tool.available():
            print(f"{tool.name} is not installed: {tool.install}")
    print(f"{'crop of':21} {'tool':16} {'wall s':>6} {'exact':>6} {'near':>6} {'shown':>6} {'/ fair':>6}")
    for name, (x, y) in CROPS.items():
        crop = folder / f"{name}.png"
        oiiotex(PHOTOS / f"{name}.jpg", "--crop", f"256x256+{x}+{y}", "--fullpixels", "-o", crop, cwd=folder)
        seen = read(crop).first.pixels()[..., :3]
        walls, more = {}, {}
        for patch in ("", ":patch=96"):
            quilt, out = f"--texquilt:size=1024x1024:seed=1{patch}", folder / f"{name}_oiiotex{patch}.png"
            # kernels are compiled here
            oiiotex(crop, *SPACE, f"{quilt}:planfile=p.npz:st=st.exr", "-o", "a.png", cwd=folder)
            plan, most = most_used(folder / "p.npz")
            down, right = sources(folder / "st.exr", crop)
            true = most_shown(SourceMap.of(down, right), seen.shape[:2])[1]
            more[out] = f"  patch {plan.grid.patch}: {most:.2f} by the plan, {true:.2f} by sources"
            walls[out] = oiiotex(crop, *SPACE, quilt, "-o", out, cwd=folder)[0]
        for tool in SYNTHESIZERS:
            if tool.available():
                out = folder / f"{name}_{tool.name}.png"
                try:
                    walls[out] = tool.run(crop, out, (1024, 1024))
                except ToolError as error:
                    print(name, tool.name, error)
        for out, wall in walls.items():
            found, near = copies(read(out).first.pixels()[..., :3], seen)
            tool = out.stem.removeprefix(f"{name}_")
            print(f"{name:21} {tool:16} {wall:6.1f} {found.exact:6.3f} {near:6.3f} {found.shown:6.1f}"
                  f" {found.over_fair:6.2f}{more.get(out, '')}", flush=True)  # fmt: skip


def fidelity(folder: Path) -> None:
    """The guide against the label of every pixel's source, and against what the result is by its own looks.

    `looks`: of the pixels further from a border of the guide than a superpixel is wide (rho), those whose superpixel
    has the guide's label by the exemplar's features (relabel.py), for 1, 3, 5 neighbors; `ceiling`: the
    same for the exemplar, whose superpixels are labeled by its others, against its own labels, all its pixels.
    """
    print(f"{'photo':26} {'level':>5} {'labels':>6} {'patch':>5} {'all':>6} {'> patch/2 from a border':>23} {'rho':>6}"
          f" {'far':>5}  looks, for 1, 3, 5  ceiling, for 1, 3, 5")  # fmt: skip
    for name in SIX:
        photo = PHOTOS / f"{name}.jpg"
        oiiotex(photo, *SPACE, "--texlabel:photo=1:facts=l.json", "-o", "labels.exr", cwd=folder)
        levels = json.loads((folder / "l.json").read_text())["levels"]
        # a level with some labels to tell apart
        level = next((n for n in range(len(levels), 0, -1) if len(levels[n - 1]["labels"]) >= 4), 1)
        ids = read(folder / "labels.exr").part(f"label.{level}").pixels()[..., 0]
        guide = regions(ids, 175, 250, 3)
        save_ids(guide, folder / "guide.tif")
        quilt = f"--texquilt:guide=guide.tif:labellevel={level}:size=2000x1400:st=st.exr:planfile=p.npz"
        oiiotex("labels.exr", quilt, "-o", "a.exr", cwd=folder)
        patch = QuiltPlan.load(folder / "p.npz", BUDGET)[0].grid.patch
        full = guide.repeat(8, 0).repeat(8, 1)
        y, x = sources(folder / "st.exr", photo)
        right = ids[y, x] == full
        inside, far = np.ones(full.shape, bool), patch // 2
        for dy in (-far, 0, far):
            for dx in (-far, 0, far):
                inside &= np.roll(full, (dy, dx), (0, 1)) == full
        labels, rho = len(levels[level - 1]["labels"]), levels[level - 1]["rho"]
        print(f"{name:26} {level:5} {labels:6} {patch:5} {right.mean():6.3f} {right[inside].mean():12.3f}", end="")
        seen = read(photo).first.pixels()[..., :3]
        found = relabeled(seen, ids.astype(np.int64), seen[y, x], rho)
        away = far_from_borders(full, rho)
        looks = [(looked == full)[away].mean() for looked in found.made.values()]
        ceiling = [(looked == ids).mean() for looked in found.exemplar.values()]
        print(f"{'':11} {rho:6.1f} {away.mean():5.2f}  {' '.join(f'{v:.3f}' for v in looks)}"
              f"     {' '.join(f'{v:.3f}' for v in ceiling)}", flush=True)  # fmt: skip


def main() -> None:
    """Those that are named, or all."""
    found = {f.__name__: f for f in (speed, wide, guided, quality, patches, peers, fidelity)}
    for name in sys.argv[1:] or found:
        with tempfile.TemporaryDirectory() as folder:
            found[name](Path(folder))


if __name__ == "__main__":
    main()
