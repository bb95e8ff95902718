# SPDX-License-Identifier: Apache-2.0
"""A quilt of five maps as an indexed image: bytes of the file and of a shader's textures, and errors at all MIP levels.

python -m benchmarks.quilts.indexed [--side 16384]

Rusty metal, five maps of 1024 px with 9 channels, half. By level of the albedo, differences to the box-filtered tile in
1/255: of texels that cross a seam if they are read from the filtered photo at the offset of their center (median, 99 %,
most), and of all texels as textures.py stores them (most). Textures of the
whole tile have MIP levels, 8 bits a channel, and four channels instead of three. EXR files have ZIP compression.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from importlib import util
from pathlib import Path
from types import ModuleType

import numpy as np

from benchmarks.shared.measures import data_folder
from oiiotex.engine.core.demand import rows_of
from oiiotex.engine.io.reading import read

MAPS = {"albedo": 3, "normal": 3, "roughness": 1, "metallic": 1, "height": 1}  # channels
PROGRAM = Path(__file__).parents[2] / "hosts" / "shaders" / "textures.py"
_MB = 1e6


def textures_module() -> ModuleType:
    """The program textures.py of hosts/shaders."""
    spec = util.spec_from_file_location("shader_textures", PROGRAM)
    assert spec is not None and spec.loader is not None
    module = sys.modules["shader_textures"] = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def written(side: int, name: str, folder: Path) -> Path:
    """The quilt in a file, of the same places for all maps."""
    if not (folder / "tile.npz").exists():
        _run(
            folder, _photo("albedo"), f"--texquilt:size={side}x{side}:planfile=tile.npz:flattening=0", "-o", "first.exr"
        )
    words = [word for one in MAPS for word in (_photo(one), "--texquilt:data=1:fromplan=tile.npz:flattening=0")]
    _run(folder, *words, "--siappendall", "-d", "half", "-o", name)
    return folder / name


def _photo(name: str) -> str:
    return str(data_folder().resolve() / "pbr" / "rusty_metal" / f"rusty_metal_{name}.jpg")


def _run(folder: Path, *words: str) -> None:
    line = [sys.executable, "-m", "oiiotex", *words]
    subprocess.run(line, cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def from_photo(layers: np.ndarray, offsets: np.ndarray, level: int) -> np.ndarray:
    """A level that is read from the photo alone: filtered, at the offset of the pixel at each texel's center."""
    filtered = layers[0].astype(np.float32)
    for step in (1 << n for n in range(level)):
        pairs = filtered + np.roll(filtered, -step, 0)
        filtered = (pairs + np.roll(pairs, -step, 1)) / 4
    half = 1 << level >> 1
    center = offsets[half :: 1 << level, half :: 1 << level]
    y, x = np.indices(center.shape) << level
    return filtered[(y + (center >> 16)) % filtered.shape[0], (x + (center & 0xFFFF)) % filtered.shape[1]]


def as_fetched(layers: np.ndarray, index: np.ndarray, level: int, own: int) -> np.ndarray:
    """A level as the shader fetches it."""
    height, width, channels = layers.shape[1:]
    y, x = np.indices(index.shape) << level
    place = (level * height + (y + (index >> 16)) % height) * width + (x + (index & 0xFFFF)) % width
    return layers.reshape(-1, channels)[np.where(index < own, place, index & (own - 1))].astype(np.float32)


def main() -> None:
    """Print two tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=16384)
    given = parser.parse_args()
    module = textures_module()
    with tempfile.TemporaryDirectory() as text:
        path = written(given.side, "tile.oiiotex", Path(text))
        bytes_of = {path.name: path.stat().st_size}
        plain = written(given.side, "tile.exr", Path(text))
        bytes_of[plain.name] = plain.stat().st_size
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        line = [sys.executable, str(PROGRAM), str(path), str(Path(text) / "textures")]
        subprocess.run(["time", "-o", "peak", "-f", "%M", *line], cwd=text, check=True)
        peak = 1024 * int((Path(text) / "peak").read_text())
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        made, tile, own = module.textures(path), read(path).first, int(module.OWN)
        values, offsets = module.halved(rows_of(tile))[:], np.asarray(made.index[0])
        layers, pieces = np.asarray(made.maps[tile.name]), module.index_levels(tile)
        print("| level | texels | stored | median | 99 % | most | as stored |\n|---|---|---|---|---|---|---|")
        for level, index in enumerate(map(np.asarray, made.index[1:8]), 1):
            near = np.abs(from_photo(layers, offsets, level) - values).max(-1)
            crosses = pieces[level][:] >= own
            apart = 255 * near[crosses] if crosses.any() else np.zeros(1)
            ours = 255 * np.abs(as_fetched(layers, index, level, own) - values).max()
            figures = " | ".join(f"{one:.2f}" for one in (*np.percentile(apart, [50, 99, 100]), ours))
            print(
                f"| {level} | {values.shape[1]} x {values.shape[0]} | {np.mean(index >= own):.1%} | {figures} |",
                flush=True,
            )
            values = module.halved(values)[:]
    texels = sum(int(np.prod(level.shape)) for level in made.index)
    bytes_of["texture of the index, R32UI"] = 4 * texels
    bytes_of["textures of the maps, half"] = sum(
        np.prod(one.shape[:3]) * _stored_channels(one.shape[-1]) * 2 for one in made.maps.values()
    )
    bytes_of["textures of the whole tile, 8 bits"] = texels * sum(map(_stored_channels, MAPS.values()))
    print("\n| | MB |\n|---|---|")
    for name, count in bytes_of.items():
        print(f"| {name} | {count / _MB:.1f} |")
    print(f"\ntextures.py: {spent:.0f} s of CPU time, {peak / _MB:.0f} MB")


def _stored_channels(count: int) -> int:
    return 4 if count == 3 else count


if __name__ == "__main__":
    main()
