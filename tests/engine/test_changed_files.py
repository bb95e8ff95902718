# SPDX-License-Identifier: Apache-2.0
"""Files that are cut short, gone, written over or changed while they are read."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.conftest import load, oiiotex, save
from tests.faults import OLD, half_files, line_of, slow, start, wait_for

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals, mounts and limits of POSIX")


ENDINGS = ["exr", "tif", "png", "jpg"]


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("share", [slow(0.0), 0.03, slow(0.5), 0.97])
def test_a_truncated_file_is_one_line(tmp_path, picture, ending, share):
    whole = tmp_path / f"whole.{ending}"
    save(np.random.default_rng(0).random((200, 300, 3)), whole, "half" if ending == "exr" else "uint8")
    data = whole.read_bytes()
    (tmp_path / f"cut.{ending}").write_bytes(data[: int(len(data) * share)])
    (tmp_path / "out.tif").write_bytes(OLD)
    assert f"cut.{ending}" in line_of(oiiotex(f"cut.{ending}", "--flip", "-o", "out.tif", cwd=tmp_path))
    assert (tmp_path / "out.tif").read_bytes() == OLD
    assert half_files(tmp_path) == []


@pytest.mark.parametrize("skip", [False, True])
@pytest.mark.parametrize("parallel", [False, True])
def test_a_frame_that_is_not_there_ends_the_run_or_is_skipped(tmp_path, skip, parallel):
    for number in (1, 3):
        save(np.zeros((8, 8, 3)), tmp_path / f"f.{number:04d}.png")
    words = ["--skip-bad-frames"] * skip + ["--parallel-frames", "--threads", "1"] * parallel
    done = oiiotex("--frames", "1-3", *words, "f.#.png", "-o", "o.#.png", cwd=tmp_path)
    assert "f.0002.png: no such file" in line_of(done)
    for number, there in ((1, skip), (2, False), (3, skip)):  # a gap is seen before the first frame is worked on
        assert (tmp_path / f"o.{number:04d}.png").exists() == there


def test_a_file_that_vanishes_between_frames_ends_its_frame_alone(tmp_path):
    for number in (1, 2, 3):
        save(np.zeros((8, 8, 3)), tmp_path / f"f.{number:04d}.png")
    run = start(
        tmp_path, "--frames", "1-3", "--skip-bad-frames",
        "f.#.png", "--pattern", "noise", "900x900", "3", "--blur", "9x9", "-o", "o.#.png",
    )  # fmt: skip
    wait_for(lambda: half_files(tmp_path), run)
    (tmp_path / "f.0002.png").unlink()
    output, errors = run.communicate(timeout=120)
    done = subprocess.CompletedProcess([], run.returncode, output, errors)
    assert "f.0002.png: no such file" in line_of(done)
    assert sorted(path.name for path in tmp_path.glob("o.*")) == ["o.0001.png", "o.0003.png"]


def striped(path: Path, side: int = 2400) -> np.ndarray:
    """More pixels than are kept in memory with a small --cache."""
    pixels = np.zeros((side, side, 3), np.uint8)
    pixels[..., 0], pixels[..., 1] = (np.arange(side) % 251)[:, None], np.arange(side) % 241
    spec = oiio.ImageSpec(side, side, 3, oiio.UINT8)
    spec.attribute("compression", "none" if path.suffix == ".tif" else "zip")
    spec.attribute("png:compressionLevel", 1)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_image(pixels)
    assert out.close()
    return pixels


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_an_input_that_is_written_over_is_still_what_it_was(tmp_path, name):
    pixels = striped(tmp_path / name)
    words = [name, "--dup", "--mulc", "0.5", "-o", name, "--pop", "--cache", "8", "--flip", "-o", "b.tif"]
    done = oiiotex(*words, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    np.testing.assert_array_equal(load(tmp_path / "b.tif"), pixels[::-1])
    assert sorted(os.listdir(tmp_path)) == sorted([name, "b.tif"])


@pytest.mark.parametrize(
    "op", [["--flip"], slow(["--transpose"]), slow(["--rotate", "90"]), ["--blur", "3x3"], slow(["--resize", "50%"])]
)
@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.tif"])
def test_an_op_in_place_gives_what_it_gives_elsewhere(tmp_path, name, op):
    save(np.random.default_rng(0).random((60, 50, 3)), tmp_path / name, "half" if name == "a.exr" else "uint8")
    assert oiiotex(name, *op, "-o", "b" + name, cwd=tmp_path).returncode == 0
    assert oiiotex(name, *op, "-o", name, cwd=tmp_path).returncode == 0
    np.testing.assert_array_equal(load(tmp_path / name), load(tmp_path / f"b{name}"))
    assert sorted(os.listdir(tmp_path)) == sorted([name, f"b{name}"])


CHANGED = """
import os, shutil, sys
from oiiotex.engine.errors import Error
from oiiotex.engine.io.reading import read
from oiiotex.engine.core.piece_cache import PieceCache
from oiiotex.engine.core.window import Window

part = read(sys.argv[1], PieceCache(1)).first
part.read(Window(0, 2300, 2400, 2400))
how = sys.argv[2]
if how == "replaced":
    shutil.copy(sys.argv[1], "new"), os.replace("new", sys.argv[1])
elif how == "removed":
    os.remove(sys.argv[1])
else:
    os.truncate(sys.argv[1], 10_000)
try:
    part.read(Window(0, 0, 2400, 100))
except Error as error:
    print(error)
"""


@pytest.mark.parametrize("how", ["replaced", "removed", "truncated"])
@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_an_input_that_another_changes_while_it_is_read_is_an_error(tmp_path, name, how):
    striped(tmp_path / name)
    done = subprocess.run([sys.executable, "-c", CHANGED, name, how], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done
    assert done.stdout == f"{name}: the file was changed by another program while it was read\n"
