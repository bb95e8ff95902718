# SPDX-License-Identifier: Apache-2.0
"""What a run does not need it does not import: a copied PNG took five times as long as oiiotool's for its imports."""

from __future__ import annotations

import subprocess
import sys

import pytest

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
NEEDED = {"numpy", "OpenImageIO", "PyOpenColorIO", "pyopencl"}
PYOPENCLS = {
    "pytools",
    "attr",
    "attrs",
    "platformdirs",
    "typing_extensions",
    "siphash24",
    "mmh3",
    "cython_runtime",
}  # those installed


LARGE = {"numpy", "OpenImageIO", "PyOpenColorIO", "pyopencl", "scipy"}


def imported(*words: object, code: int = 0) -> list[str]:
    """The modules of a run of the program that ends with that exit code."""
    line = [sys.executable, "-P", "-c", RUN, str(code), *map(str, words)]
    done = subprocess.run(line, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1].split()


def ours(modules: list[str]) -> set[str]:
    """Modules of ours; packages are a line each, and not counted."""
    inside = [name for name in modules if name.startswith("oiiotex.")]
    packages = {name.rpartition(".")[0] for name in inside}
    return {name.removeprefix("oiiotex.") for name in inside if name not in packages}


@pytest.mark.parametrize(
    ("words", "code", "most"),
    [
        (["--version"], 0, 15),
        ([], 0, 16),
        (["--help", "texstationarize:sigma"], 0, 88),
        (["--help", "resize"], 0, 31),
        (["--help"], 0, 16),
        (["--help", "scaling"], 0, 30),
        (["--help", "all"], 0, 196),
        (["--manpage"], 0, 196),
        (["--completion", "bash"], 0, 196),
        (["--cache-info"], 0, 15),
        (["--nonsense"], 1, 15),
        (["photo.png", "--texlabel:persistance=0.5", "-o", "x.exr"], 1, 34),
        (["photo.png", "--texstationarize:sigma=0", "-o", "x.exr"], 1, 84),
        (["photo.png", "--resize:filter=", "-o"], 1, 27),
        (["--capture"], 1, 13),
        (["photo.png", "--threads", "few", "-o", "x.exr"], 1, 50),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_words_alone_touch_no_large_library(words, code, most):
    modules = imported(*words, code=code)
    assert not LARGE & {name.partition(".")[0] for name in modules}
    assert len(ours(modules)) <= most, sorted(ours(modules))


@pytest.mark.parametrize(
    ("line", "rooms", "most"),
    [
        (["-o", "copy.png"], set(), 54),
        (["--resize", "50%", "-o", "copy.png"], {"host"}, 60),
        (["--info:verbose=1"], set(), 56),
        (["--texlab", "-o", "copy.exr"], {"filters", "color"}, 60),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_a_line_imports_what_it_names(photo, tmp_path, line, rooms, most):
    """Of files of ops those of the line; of rooms those that they call; no device for what asks for none."""
    modules = imported(photo, *(tmp_path / word if word.startswith("copy") else word for word in line))
    assert not {"pyopencl", "scipy"} & set(modules)
    assert ("PyOpenColorIO" in modules) == ("color" in rooms)
    program = {"cli", "core", "io", "session"}
    assert {name.partition(".")[0] for name in ours(modules) if "." in name} - program <= rooms
    assert len(ours(modules)) <= most, sorted(ours(modules))


@pytest.mark.parametrize("measure", ["histogram", "moments:order=4", "steerable"])
def test_a_tile_takes_no_more_than_its_measure_needs(photo, tmp_path, measure):
    line = f"--texstationarize:size=32x32:iterations=1:histogram=0.7:measure={measure}"  # else the photo is looked at
    modules = imported(photo, line, "-o", tmp_path / "tile.png")
    packages = {name.partition(".")[0] for name in modules} - set(sys.stdlib_module_names) - {"__main__"}
    foreign = {name for name in packages if not name.startswith(("_", "oiiotex", "sitecustomize"))}
    assert NEEDED <= foreign <= NEEDED | PYOPENCLS
    assert ("oiiotex.synthesis.projections.pearson_table" in modules) == measure.startswith("moments")
    assert sum(not name.startswith(("oiiotex", "attr")) for name in modules) < 360
