# SPDX-License-Identifier: Apache-2.0
"""Planes at render time: one tile repeated, hex tiling, and Wang tiles through the index image.

python -m benchmarks.tiles.wang [NAME ...] [--side 192] [--seed 1]

Two photos without a lattice, two with one and a procedural wall (all when none is named). The tile is also made with
the memory of the atlas of 16 tiles, four times as wide. Planes have 12 x 12 tiles of the atlas, at level 0.
Repetition, without a lattice: highest normalized autocorrelation of 32 x 32 tiles, at a quarter of their size, at
offsets of half a tile or more. Sharpness: mean |L - blurred L|, over the photo's. Structure: the least autocorrelation
peak over its floor at the first vectors of the photo's lattice, over the photo's. Then, by MIP level, the root mean
square step of samples at borders of 16 tiles, and the difference of neighboring texels for comparison. Then the costs:
RGBA8, the tiles of 256 px with MIP levels, and texture reads and SPIR-V instructions of a sample, as glslang writes
them; a loop counts once.
"""

from __future__ import annotations

import argparse
import math
import re
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from oiiotex_studio.materials.preview import hex_tiled

from benchmarks.shared.measures import data_folder, load, sharpness
from oiiotex import filters
from oiiotex.analysis.regularity.lattice import Lattice, find_lattice
from oiiotex.engine.color.lab import working_values
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.window import Domain
from oiiotex.engine.session import Session
from oiiotex.synthesis.quality.lost_structure import peaks_over_floor
from oiiotex.synthesis.wang.plane import CELLS, index_image
from oiiotex.synthesis.wang.viewer import shader
from tests.any_filter import buffer
from tests.lattices import regular
from tests.reference.wang import border_steps

PLAIN = ("moss_grass_stones_ground", "rust_barrel_side")
REGULAR = ("marble_tiles_4x4", "facade_tiles", "procedural bricks")
ACROSS, FAR = 12, 32  # tiles of a plane; of one that is looked at for repetition


def photo_of(name: str, side: int) -> oiio.ImageBuf:
    """A photo, large enough for tiles of that side; one with a lattice has the tile's own size."""
    if name.startswith("procedural "):
        return buffer(regular(name.removeprefix("procedural "), side, side, 3))
    return load(data_folder() / "photos" / f"{name}.jpg", side if name in REGULAR else 3 * side)


def lab_of(pixels: np.ndarray, session: Session) -> np.ndarray:
    """CIE Lab of sRGB pixels, 0 to 1."""
    return np.ascontiguousarray(working_values(from_buffer(buffer(pixels)), session.resources)[0][..., :3])


def coarse(pixels: np.ndarray) -> np.ndarray:
    """Pixels at a quarter of their size, (height, width, 3)."""
    height, width = pixels.shape[0] // 4, pixels.shape[1] // 4
    return pixels[: 4 * height, : 4 * width].reshape(height, 4, width, 4, 3).mean((1, 3))


def covered(
    tile: np.ndarray, large: np.ndarray, atlases: dict[int, np.ndarray], across: int, seed: int
) -> dict[str, np.ndarray]:
    """Planes of as many tiles by way, from a tile, one of four times its size and atlases by number of tiles."""
    height, width = tile.shape[:2]
    shape = across * height, across * width

    def laid(count: int) -> np.ndarray:
        side, index = math.isqrt(count), index_image(count, seed)[:across, :across].astype(int)
        tiles = atlases[count].reshape(side, height, side, width, 3).swapaxes(1, 2)
        return tiles[index[..., 1], index[..., 0]].swapaxes(1, 2).reshape(*shape, 3)

    return {
        "one tile": np.tile(tile, (across, across, 1)),
        "one tile, memory of the atlas": np.tile(large, (across // 4, across // 4, 1)),
        "hex tiling": hex_tiled(tile, across, max(shape))[: shape[0], : shape[1]],
        "hex tiling, memory of the atlas": hex_tiled(large, across // 4, max(shape))[: shape[0], : shape[1]],
        **{f"{count} Wang tiles": laid(count) for count in atlases},
    }


def repetition(light: np.ndarray, tile: tuple[int, int]) -> float:
    """Highest normalized autocorrelation of (height, width) at offsets of half a tile (height, width) or more."""
    light = light - light.mean()
    size = [2 * n for n in light.shape]
    spectrum = np.abs(np.fft.rfft2(light, size)) ** 2
    overlap = np.abs(np.fft.rfft2(np.ones_like(light), size)) ** 2
    likeness = np.fft.irfft2(spectrum, size) / np.maximum(np.fft.irfft2(overlap, size), 1) / light.var()
    y, x = (np.abs(np.fft.fftfreq(n, 1 / n)) for n in size)
    counted = (y[:, None] >= tile[0] / 2) | (x[None, :] >= tile[1] / 2)
    counted &= (y[:, None] <= light.shape[0] / 2) & (x[None, :] <= light.shape[1] / 2)
    return float(likeness[counted].max())


def steps(name: str, atlas: np.ndarray, seed: int) -> list[str]:
    """Rows of the steps at borders of tiles by MIP level: of the atlas, and of its tiles in another order."""
    side, index = atlas.shape[0] // 4, index_image(16, seed)
    order = np.random.default_rng(2).permutation(16)
    tiles = atlas.reshape(4, side, 4, side, 3).swapaxes(1, 2).reshape(16, side, side, 3)
    other = tiles[order].reshape(4, 4, side, side, 3).swapaxes(1, 2).reshape(atlas.shape)
    place = np.argsort(order)[index[..., 2]]
    moved, found, level = np.stack([place % 4, place // 4], -1), [], 0
    while side % (1 << level) == 0:
        size = 4 * side >> level
        means = [a.reshape(size, 1 << level, size, 1 << level, 3).mean((1, 3)) for a in (atlas, other)]
        jumps = [255 * border_steps(a, i, 4) for a, i in zip(means, (index, moved), strict=True)]
        apart = 255 * float(np.sqrt(np.mean([np.square(means[0] - np.roll(means[0], 1, axis)) for axis in (0, 1)])))
        found.append(f"| {name} | {side >> level} | {jumps[0]:.2f} | {jumps[1]:.2f} | {apart:.2f} |")
        level += 1
    return found


def rows(name: str, side: int, seed: int, session: Session) -> tuple[list[str], list[str]]:
    """Of both tables."""
    side = side // 2 if name in REGULAR else side
    picture = photo_of(name, side)
    own = working_values(from_buffer(picture), session.resources)[0][..., :3]
    lattice = find_lattice(own, None) if name in REGULAR else None
    size = lattice.fitting(Domain(own.shape[1], own.shape[0], True, True)) if lattice else (side, side)
    size = int(size[0]), int(size[1])

    def made(factor: int, **more: object) -> np.ndarray:
        shape = factor * size[0], factor * size[1]
        result = filters.stationarize(picture, size=shape, seed=seed, **more)
        return result.get_pixels(oiio.FLOAT, result.roi)[..., :3]

    atlases = {count: made(1, variants=count, pack="atlas") for count in (16, 64)}
    tile, large = made(1), made(4)
    planes = covered(tile, large, atlases, ACROSS, seed)
    few = {count: coarse(atlas) for count, atlas in atlases.items()}
    far = {} if lattice else covered(coarse(tile), coarse(large), few, FAR, seed)
    sharp = sharpness(np.ascontiguousarray(own[..., 0]))
    found = []
    for way, plane in planes.items():
        lab = lab_of(plane, session)
        repeated = f"{repetition(far[way].mean(-1), (side // 4, side // 4)):.2f}" if far else ""
        kept = f"{structure(lab, own, lattice, size):.2f}" if lattice else ""
        found.append(f"| {name} | {way} | {repeated} | {sharpness(lab[..., 0]) / sharp:.2f} | {kept} |")
    return found, [] if lattice else steps(name, atlases[16], seed)


def structure(plane: np.ndarray, photo: np.ndarray, lattice: Lattice, size: tuple[int, int]) -> float:
    """The least of a plane's lattice peaks, over the photo's."""
    closed = replace(lattice, frequencies=lattice.on_torus(Domain(*size, True, True)))
    peaks = peaks_over_floor(plane, closed, False) / peaks_over_floor(photo, lattice, False)
    return float(np.nanmin(peaks))


def instructions(call: str, functions: str) -> tuple[int, int]:
    """SPIR-V instructions in functions of a fragment shader, and texture reads of a sample."""
    head = "#version 310 es\nprecision highp float;\nprecision highp int;\nuniform sampler2D atlas, plane, tile;\n"
    text = f"{head}in vec2 uv; out vec4 shown;\n{functions}\nvoid main() {{ shown = {call}; }}\n"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.frag")
        path.write_text(text)
        flags = ["-V", "-H", "--auto-map-locations", "--auto-map-bindings", "-o", f"{folder}/a.spv", "-R"]
        done = subprocess.run(["glslangValidator", *flags, str(path)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stdout)
    code = done.stdout[done.stdout.index(" Function ") :]
    bookkeeping = "Label|Variable|Function|FunctionEnd|FunctionParameter|Line|Branch|LoopMerge|SelectionMerge|Return"
    words = re.findall(rf"^\s*(?:\d+\([^)]*\):|\d+:)?\s*(?:\d+(?:\([^)]*\))? )*((?!{bookkeeping})[A-Z]\w+)", code, re.M)
    return len(words), len(re.findall(r"ImageSample|ImageFetch", code))


def costs(side: int) -> list[str]:
    """The table of costs, for tiles of that side."""
    page = shader("viewer.html")
    hexagons = page[page.index("uint mixed(") : page.index("vec3 srgb(")]
    wang = shader("sample_wang.glsl")
    tiles = {"one tile": 1, "hex tiling": 1, "16 Wang tiles": 16, "64 Wang tiles": 64}
    ways = {
        "one tile": ("texture(tile, uv)", "", 1),
        "hex tiling": ("hex_tiled(uv)", hexagons, 3),
        **{f"{n} Wang tiles": (f"sample_wang(atlas, plane, {math.sqrt(n)}, uv)", wang, 2) for n in (16, 64)},
    }
    found = []
    for way, (call, functions, reads) in ways.items():
        texels = tiles[way] * side**2 * 4 / 3 + (CELLS**2 if functions == wang else 0)
        found.append(f"| {way} | {4 * texels / 2**20:.2f} | {reads} | {instructions(call, functions)[0]} |")
    return found


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*")
    parser.add_argument("--side", type=int, default=192)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    session = Session()
    print("| photo | way | repetition | sharpness | structure |\n|---|---|---|---|---|")
    levels = []
    for name in given.names or (*PLAIN, *REGULAR):
        ways, own = rows(name, given.side, given.seed, session)
        print("\n".join(ways), flush=True)
        levels += own
    print("\n| photo | px per tile | step at borders / 255 | without shared edges | between texels |")
    print("|---|---|---|---|---|")
    print("\n".join(levels))
    print("\n| way | MB | texture reads | SPIR-V instructions |\n|---|---|---|---|")
    print("\n".join(costs(256)))


if __name__ == "__main__":
    sys.exit(main())
