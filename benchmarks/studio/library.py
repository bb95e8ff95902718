# SPDX-License-Identifier: Apache-2.0
"""A library from a folder: its use of two cores, and the response time of a catalog of 10,000 assets.

`python -m benchmarks.studio.library [--photos 12] [--size 512] [--assets 10000] [--only run|catalog] [--keep FOLDER]`
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from oiiotex_studio.library.asset import key_of
from oiiotex_studio.library.catalog import Asset, Catalog
from oiiotex_studio.recipes.found import extract, materials
from oiiotex_studio.recipes.lines import SOURCE, source_name, steps_of
from oiiotex_studio.recipes.recipe import load_recipe

from oiiotex.engine.machine import usable_threads
from oiiotex.oiiotool.cli.language.sequences import Frame
from oiiotex.oiiotool.cli.running.tasks import Job, Task, work
from tests.conftest import data_folder

PROGRAM = [sys.executable, "-m", "oiiotex_studio.library.main"]
RECIPE = """schema = 1
[find]
normals = "opengl"
license = "see MANIFEST.tsv"
[[product]]
name = "tile"
line = "$maps --texstationarize:kinds=$kinds:report=$report $outputs"
[deliver]
materialx = true
[judge]
limits = ["seam>1.5", "loss>0.3", "normal_length>0.1", "height_steps>0.05"]
"""


def crops(count: int, size: int) -> Iterator[tuple[str, np.ndarray]]:
    """Crops of the test photos, by turns, each from another place."""
    photos = sorted(p for p in (data_folder() / "photos").iterdir() if p.suffix in (".jpg", ".png"))
    for n in range(count):
        path = photos[n % len(photos)]
        pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
        height, width = (max(0, length - size) for length in pixels.shape[:2])
        top, left = height * (n // len(photos)) // 7 % (height + 1), width * (n // len(photos)) // 5 % (width + 1)
        yield f"{path.stem}_{n:03d}", pixels[top : top + size, left : left + size]


def write_photos(folder: Path, count: int, size: int) -> None:
    folder.mkdir(parents=True)
    for name, pixels in crops(count, size):
        out = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.UINT8))
        out.set_pixels(oiio.ROI.All, pixels)
        out.write(str(folder / f"{name}.png"))


def single_times(folder: Path) -> list[tuple[float, float]]:
    """Wall-clock and CPU seconds of each material's lines alone: one thread, in a running process."""
    recipe = load_recipe(folder / "recipe.toml")
    found, times = materials(folder / "photos", recipe), []
    for number, material in enumerate([found[0], *found]):
        with tempfile.TemporaryDirectory() as made:
            Path(made, SOURCE).mkdir()
            for role, file in material.maps.items():
                extract(folder / "photos", file, Path(made) / source_name(role, file))
            start, cpu = time.perf_counter(), time.process_time()
            for step in steps_of(recipe, material.maps):
                Path(made, step.product).mkdir()
                _, error, _ = work(Job(Task(Frame(None, step.words), len(step.words)), 1 << 30, 1, folder=made))
                assert not error, error
            if number:  # the first one warms up
                times.append((time.perf_counter() - start, time.process_time() - cpu))
    return times


def timed(words: list[str], folder: Path, codes: tuple[int, ...] = (0, 3)) -> tuple[float, str]:
    start = time.perf_counter()
    done = subprocess.run([*PROGRAM, *words], cwd=folder, capture_output=True, text=True)
    assert done.returncode in codes, done.stderr
    return time.perf_counter() - start, done.stdout


def run_of_photos(folder: Path, count: int, size: int) -> None:
    write_photos(folder / "photos", count, size)
    (folder / "recipe.toml").write_text(RECIPE)
    alone, alone_cpu = (sum(column) for column in zip(*single_times(folder), strict=True))
    line = ["ingest", "photos", "library", "--recipe", "recipe.toml"]
    before = cpu_of_children()
    wall, text = timed(line, folder)
    cpu = cpu_of_children() - before
    again, _ = timed(line, folder)
    workers = min(usable_threads(), count)
    busy = sum(float(match) for match in re.findall(r", (\d+\.\d) s", text))
    print(text.splitlines()[-1])
    print(f"{count} photos of {size}², lines alone, one thread: {alone:.1f} s, {alone_cpu:.1f} s of CPU in all")
    print(f"ingest by {workers} workers: {wall:.1f} s, {cpu:.1f} s of CPU, start of the programs and all")
    print(f"lines' share of the CPU: {alone_cpu / cpu:.2f}; workers at work {busy / workers / wall:.2f} of the time")
    print(f"sum of lines over {workers} x wall-clock: {alone / wall / workers:.2f} (goal .9; meaningless under load)")
    print(f"again, nothing changed: {again:.1f} s")


def cpu_of_children() -> float:
    """Seconds of CPU of all processes that were started here and have ended, and of theirs."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def large_catalog(folder: Path, count: int) -> None:
    """Rows as a run would have left them, and the photos: three maps each."""
    photos, library = folder / "photos", folder / "library"
    photos.mkdir(parents=True)
    one = oiio.ImageBuf(oiio.ImageSpec(8, 8, 3, oiio.UINT8))
    one.write(str(folder / "one.png"))
    data = (folder / "one.png").read_bytes()
    for n in range(count):
        for role in ("diff", "nor_gl", "rough"):
            (photos / f"m{n:05d}_{role}.png").write_bytes(data)
    (folder / "recipe.toml").write_text(RECIPE)
    recipe = load_recipe(folder / "recipe.toml")
    digest = "0" * 64
    found = materials(photos, recipe)
    random = np.random.default_rng(1)
    names = ("fidelity", "seam", "repeat", "loss", "cost", "cost_photo", "texture", "copied", "normal_length")
    with Catalog(library, create=True) as catalog:
        used = sorted({file.path for material in found for file in material.maps.values()})
        facts = ((path, os.stat(photos / path)) for path in used)
        catalog.remember_sources((str(photos / p), s.st_size, s.st_mtime_ns, digest) for p, s in facts)
        rows = []
        for material in found:
            key = key_of(material, recipe, dict.fromkeys(material.maps, digest))
            asset = Asset(
                material.name, key, "ok", f"assets/{material.name}/{key}", (), str(photos), "CC0-1.0", "", 1024, 1024,
                (), (50.0, 0.0, 10.0), 10.0, "2026-01-01T00:00:00+00:00",
            )  # fmt: skip
            (library / asset.folder).mkdir(parents=True)
            files = [(f"tile/{n:02d}.exr", "tile", 10**6, digest) for n in range(16)]
            rows.append(
                (asset, files, dict(zip(names, random.random(len(names)).tolist(), strict=True)), ("scan",), ())
            )
        catalog.put_all(rows)
    (library / "report.html").touch()
    print(f"{count} assets, {len(used)} maps, catalog of {(library / 'library.sqlite').stat().st_size / 1e6:.0f} MB")
    searches = {
        "list": ["list", "library"],
        "list --measure": ["list", "library", "--measure", "seam<0.01", "--tag", "scan"],
        "list --color": ["list", "library", "--color", "777777", "--distance", "1"],
        "ingest, nothing changed": ["ingest", "photos", "library", "--recipe", "recipe.toml"],
    }
    for name, words in searches.items():
        seconds, text = timed(words, folder)
        assert words[0] == "list" or f"{count} unchanged" in text, text
        print(f"{name}: {seconds:.2f} s (goal 5); {len(text.splitlines())} lines, last: {text.splitlines()[-1][:70]}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=int, default=12)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--assets", type=int, default=10_000)
    parser.add_argument("--only", choices=("run", "catalog"))
    parser.add_argument("--keep", type=Path, help="folder to keep the libraries in")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = (given.keep or Path(scratch)).resolve()
        if given.only != "catalog":
            run_of_photos(folder / "run", given.photos, given.size)
        if given.only != "run":
            large_catalog(folder / "catalog", given.assets)


if __name__ == "__main__":
    main()
