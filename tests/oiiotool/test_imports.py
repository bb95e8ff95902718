# SPDX-License-Identifier: Apache-2.0
"""What a run does not need it does not import: a copied PNG took five times as long as oiiotool's for its imports."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from oiiotex import filters
from tests import pictures
from tests.conftest import save

RUN = """
import sys
from oiiotex.oiiotool.cli.main import main
try:
    main(sys.argv[2:])
except SystemExit as done:
    assert done.code == int(sys.argv[1]), done
print()
print(*sys.modules)
"""
PYTHON = """
import sys
from oiiotex import filters
filters.stationarize
print(*sys.modules)
"""
ROOT = Path(__file__).parents[2]
LARGE = {"numpy", "OpenImageIO", "PyOpenColorIO", "pyopencl", "scipy"}
SLOW = {"asyncio", "http", "multiprocessing", "sqlite3", "ssl", "unittest", "xml"}  # of Python's own
PYOPENCLS = {
    "pytools", "attr", "attrs", "platformdirs", "typing_extensions", "siphash24", "mmh3", "cython_runtime"
}  # fmt: skip  # those installed

# rooms: packages of a floor, or modules that lie there alone; those of the command line are one level deeper
CLI = {f"oiiotool.cli.{name}" for name in ("language", "main", "printing", "running", "vocabulary")}
WORDS = CLI | {"engine.core", "engine.deferred", "engine.errors", "engine.guard", "engine.shipped", "engine.stats"}
NOT_FOUND = WORDS | {"python.declared_entries"}  # where a name may be a filter's of another package
HOST = NOT_FOUND | {"oiiotool.host", "engine.io", "engine.machine", "engine.patterns", "engine.session"}
FILTER = HOST - {"oiiotool.host"} | {
    f"engine.{name}" for name in ("color", "opencl", "scan")
}  # and the techniques that it calls
LINE = WORDS | {f"engine.{name}" for name in ("io", "machine", "operands", "patterns", "run", "session")}
LINE |= {"oiiotool.cli.files", "oiiotool.cli.stack"}
ALL = FILTER | LINE | {"oiiotool.host"}
TECHNIQUES = ("analysis.", "synthesis.", "surfaces.")


def imported(*words: object, code: int = 0) -> list[str]:
    """The modules of a run of the program that ends with that exit code."""
    return modules_of(RUN, code, *words)


def modules_of(program: str, *words: object) -> list[str]:
    """The modules that a program prints in its last line."""
    line = [sys.executable, "-P", "-c", program, *map(str, words)]
    done = subprocess.run(line, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1].split()


def rooms(modules: list[str]) -> set[str]:
    """Where the modules of ours lie, files of filters by their names; packages alone are a line each."""
    names = [name.split(".") for name in modules if name.startswith("oiiotex.")]
    inside = [parts for parts in names if not ROOT.joinpath(*parts, "__init__.py").exists()]
    return {".".join(parts[1 : 4 if parts[2] == "cli" else 3]) for parts in inside if len(parts) > 2}


def foreign(modules: list[str]) -> set[str]:
    """The libraries of others among them."""
    packages = {name.partition(".")[0] for name in modules} - set(sys.stdlib_module_names) - {"__main__"}
    return {name for name in packages if not name.startswith(("_", "oiiotex", "sitecustomize"))}


def named(*filters: str) -> set[str]:
    return {f"filters.tex{name}" for name in filters}


@pytest.mark.parametrize(
    ("words", "code", "allowed", "libraries"),
    [
        (["--version"], 0, WORDS, set()),
        ([], 0, WORDS, set()),
        (["--help"], 0, WORDS, set()),
        (["--cache-info"], 0, WORDS | {"engine.io"}, {"platformdirs"}),
        (["--nonsense"], 1, NOT_FOUND, set()),
        (["--capture"], 1, NOT_FOUND, set()),
        (["--help", "resize"], 0, HOST, set()),
        (["--help", "scaling"], 0, HOST, set()),
        (["photo.png", "--resize:filter=", "-o"], 1, HOST, set()),
        (["--help", "texstationarize:sigma"], 0, FILTER | named("stationarize"), set()),
        (["photo.png", "--texlabel:persistance=0.5", "-o", "x.exr"], 1, FILTER | named("label"), set()),
        (["photo.png", "--texstationarize:sigma=0", "-o", "x.exr"], 1, FILTER | named("stationarize"), set()),
        (["photo.png", "--threads", "few", "-o", "x.exr"], 1, LINE, {"mmh3"}),
        (["--help", "all"], 0, ALL | named(*(op.name for op in filters.OURS)), {"mmh3"}),
        (["--completion", "bash"], 0, ALL | named(*(op.name for op in filters.OURS)), {"mmh3"}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_words_alone_touch_no_library(words, code, allowed, libraries):
    """Techniques are declared by the filters that are named; nothing else is looked up for a word."""
    modules = imported(*words, code=code)
    assert foreign(modules) <= libraries and not SLOW & set(modules)
    techniques = {room for room in rooms(modules) if room.startswith(TECHNIQUES)}
    assert rooms(modules) - techniques <= allowed
    assert not techniques or any(room.startswith("filters.tex") for room in allowed)


@pytest.mark.parametrize(
    ("line", "more", "libraries"),
    [
        (["-o", "copy.png"], set(), set()),
        (["--resize", "50%", "-o", "copy.png"], {"oiiotool.host"}, set()),
        (["--info:verbose=1"], set(), set()),
        (["--texlab", "-o", "copy.exr"], {"engine.color", "engine.scan", *named("lab")}, {"PyOpenColorIO"}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_line_imports_what_it_names(photo, tmp_path, line, more, libraries):
    """Of files of ops those of the line; of rooms those that they call; no device for what asks for none."""
    modules = imported(photo, *(tmp_path / word if word.startswith("copy") else word for word in line))
    assert foreign(modules) <= {"OpenImageIO", "numpy", "mmh3"} | libraries and not SLOW & set(modules)
    assert libraries <= set(modules)
    assert rooms(modules) <= LINE | more


def test_a_function_imports_one_filter():
    modules = modules_of(PYTHON)
    assert {room for room in rooms(modules) if room.startswith("filters.")} == named("stationarize")
    assert foreign(modules) <= {"OpenImageIO", "numpy", "mmh3"}


@pytest.mark.parametrize("measure", ["histogram", "moments4", "steerable"])
def test_a_tile_takes_no_more_than_its_measure_needs(photo, tmp_path, measure):
    line = f"--texstationarize:size=32x32:iterations=1:histogram=0.7:measure={measure}"  # else the photo is looked at
    modules = imported(photo, line, "-o", tmp_path / "tile.png")
    needed = LARGE - {"scipy"}
    assert needed <= foreign(modules) <= needed | PYOPENCLS
    assert SLOW & set(modules) <= {"sqlite3"}  # of pyopencl
    allowed = LINE | FILTER | named("stationarize")
    assert {room for room in rooms(modules) if not room.startswith(TECHNIQUES)} <= allowed - {"oiiotool.host"}
    assert ("oiiotex.synthesis.projections.pearson_table" in modules) == measure.startswith("moments")


def test_a_script_ends_without_a_word_from_libraries(tmp_path):
    """OpenImageIO prints forty lines about objects that are held when Python ends."""
    photo = tmp_path / "photo.png"
    save(pictures.moss(16, 16, 1), photo)
    code = f"from oiiotex import filters; filters.flatten({str(photo)!r}, radius=4).get_pixels()"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
