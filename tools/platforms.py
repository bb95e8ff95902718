# SPDX-License-Identifier: Apache-2.0
"""`make platforms`: install the wheel on every Python and platform, each in an empty environment, and try it.

For each row: `uv` creates the environment, the wheel of dist/ is installed, the demo makes its tile, and some tests of
the source archive run, without the package of that archive. A row whose platform cannot hold oiiotex itself, because
its NumPy or OpenColorIO is older, tries what a host on it can do: ask the resident process of another environment.

Environments are in build/platforms. A missing Python is downloaded by uv, or named by $PATH. ONLY=NAME runs one row.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "build" / "platforms"
EXTRAS = "cpu,linker,demo"
TESTS = [
    "tests/engine/test_documents.py", "tests/engine/test_source_map.py", "tests/engine/test_label_map.py",
    "tests/oiiotool/test_service.py",
    "tests/promises/test_golden.py", "-k", "not golden or stationarize_bricks or label_two or quilt_pebbles or lab_",
]  # fmt: skip
# A tile by the resident process of another Python, through the client of the Blender extension.
HOST = """
import sys
import numpy as np, PyOpenColorIO
from host.process import Process
photo = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
job = Process(sys.argv[1]).begin("stationarize", [(photo, "srgb_rec709_scene")], {"flattening": 0, "seed": 3})
job.wait()
((name, tile),), = job.result()
assert tile.shape == photo.shape and not {*map(tuple, tile.reshape(-1, 3))} - {*map(tuple, photo.reshape(-1, 3))}
print(f"NumPy {np.__version__}, OpenColorIO {PyOpenColorIO.__version__}")
"""
# Of pixels alone: the metadata names the version of OpenImageIO.
PIXELS = """
import hashlib, OpenImageIO as oiio
print(hashlib.sha1(oiio.ImageBuf("demo-out/tile.png").get_pixels(oiio.UINT8).tobytes()).hexdigest()[:8])
"""
VERSIONS = """
import numpy, OpenImageIO, PyOpenColorIO, sys
print(f"{sys.version.split()[0]} | {numpy.__version__} | {OpenImageIO.VERSION_STRING} | {PyOpenColorIO.__version__}")
"""


@dataclass(frozen=True)
class Platform:
    """A row: name, version of Python, versions of packages, and whether it holds oiiotex or only a host."""

    name: str
    python: str
    packages: tuple[str, ...] = ()
    lowest: bool = False
    host: bool = False


PLATFORMS = (
    Platform("lowest", "3.11", lowest=True),  # the lower bounds of pyproject.toml
    Platform("py311", "3.11"),
    Platform("py312", "3.12"),
    Platform("py313", "3.13"),
    Platform("oiio31", "3.11", ("OpenImageIO==3.1.*",)),
    Platform("cy2026", "3.13", ("numpy==2.3.*", "opencolorio==2.5.*")),  # VFX Reference Platform
    Platform("cy2025", "3.11", ("numpy==1.26.*", "opencolorio==2.4.*"), host=True),
)


class RowError(Exception):
    """A step of a row failed; the text has the end of its output."""


def run(*words: object, cwd: Path = ROOT, **environment: str) -> str:
    """The output of a program.

    Raises
    ------
    RowError
        It failed.
    """
    there = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")} | environment
    command = [str(word) for word in words]
    done = subprocess.run(command, cwd=cwd, env=there, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode:
        raise RowError(f"{' '.join(command[:6])}: exit status {done.returncode}\n{done.stdout[-3000:]}")
    return done.stdout


def distributions() -> tuple[Path, Path]:
    """The wheel and the source archive of dist/; they are built if they are missing."""
    if not list((ROOT / "dist").glob("oiiotex-*.whl")):
        run(sys.executable, "-m", "tools.dist")
    (wheel,), (archive,) = (list((ROOT / "dist").glob(name)) for name in ("oiiotex-*.whl", "oiiotex-*.tar.gz"))
    return wheel, archive


def tests_of(archive: Path) -> Path:
    """The source archive, unpacked without the packages: its tests can only import the installed one."""
    folder = WORK / "source"
    shutil.rmtree(folder, ignore_errors=True)
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    (source,) = folder.iterdir()
    for package in ("oiiotex", "studio"):
        shutil.rmtree(source / package)
    return source


def environment(row: Platform, wheel: Path, source: Path) -> Path:
    """Create the environment of a row: its Python."""
    folder = WORK / row.name
    run("uv", "venv", "-q", "--clear", "--no-project", "--python", row.python, folder)
    python = folder / "bin" / "python"
    install = ["uv", "pip", "install", "-q", "--python", python]
    if row.host:
        run(*install, *row.packages)
        return python
    bounds: list[object] = []
    if row.lowest:
        pins = WORK / "lowest.txt"
        extras = [word for name in EXTRAS.split(",") for word in ("--extra", name)]
        line = ["uv", "pip", "compile", "-q", "--python", python, "--resolution", "lowest-direct", *extras]
        run(*line, "-o", pins, source / "pyproject.toml")
        bounds = ["--constraint", pins]
    run(*install, *bounds, f"{wheel}[{EXTRAS}]", *row.packages)
    run(*install, *bounds, "pytest", "hypothesis")
    return python


def tried(row: Platform, wheel: Path, source: Path) -> str:
    """Try a row: its cells.

    Raises
    ------
    RowError
        Something failed.
    """
    python = environment(row, wheel, source)
    place = WORK / f"{row.name}-run"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    if row.host:
        run(sys.executable, ROOT / "hosts" / "blender" / "build.py", place / "host.zip")
        with zipfile.ZipFile(place / "host.zip") as archive:
            archive.extractall(place / "host", [n for n in archive.namelist() if n.startswith(("link/", "process"))])
        other = WORK / "py311" / "bin" / "python"
        versions = run(python, "-c", HOST, other, cwd=place, PYTHONPATH=str(place)).strip().rsplit("\n")[-1]
        return f"{row.python} | {versions} | a tile by the resident process of py311"
    shutil.copytree(source / "tools", place / "tools")
    run(python, "-m", "tools.demo", cwd=place)
    tile = run(python, "-c", PIXELS, cwd=place).strip()
    tests = run(python, "-m", "pytest", "-p", "no:cacheprovider", "-m", "not slow", *TESTS, cwd=source)
    versions = run(python, "-c", VERSIONS, cwd=place).strip()
    return f"{versions} | demo: tile {tile}; {tests.strip().splitlines()[-1]}"


def main() -> None:
    """Try the chosen rows, and print a table."""
    chosen = [row for row in PLATFORMS if row.name in sys.argv[1:] or not sys.argv[1:]]
    if not chosen:
        sys.exit(f"no platform is called {' '.join(sys.argv[1:])}: expected {', '.join(p.name for p in PLATFORMS)}")
    WORK.mkdir(parents=True, exist_ok=True)
    wheel, archive = distributions()
    source = tests_of(archive)
    lines, failed = (
        ["| platform | Python | NumPy | OpenImageIO | OpenColorIO | result |", "|---|---|---|---|---|---|"],
        False,
    )
    for row in chosen:
        try:
            line = f"| {row.name} | {tried(row, wheel, source)} |"
        except RowError as error:
            line, failed = f"| {row.name} | FAILED: {error} |", True
        print(line, flush=True)
        lines.append(line)
    print("", *lines, sep="\n")
    sys.exit(failed)


if __name__ == "__main__":
    main()
