# SPDX-License-Identifier: Apache-2.0
"""Sizes at both ends: wide scanlines, a single pixel, many channels, and what does not fit the memory."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.errors import Error
from oiiotex.oiiotool import host
from oiiotex.oiiotool.cli.running.line_run import run
from tests.conftest import load, oiiotex, save
from tests.faults import PROGRAM, line_of, slow
from tests.parts import deep_file
from tests.refusals import refused

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals, mounts and limits of POSIX")


def peak_of(folder: Path, *words: object) -> int:
    """Megabytes that a run has held at most; of a child of a small process, whose own peak a child begins with."""
    script = "import resource as r, subprocess as s, sys; s.run(sys.argv[1:], check=True)"
    script += "; print(r.getrusage(r.RUSAGE_CHILDREN).ru_maxrss)"
    done = subprocess.run(
        [sys.executable, "-c", script, *PROGRAM, "--noprogress", *words], cwd=folder, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    return int(done.stdout) >> 10


def wide(path: Path, height: int) -> Path:
    """Scanlines of a hundred thousand pixels."""
    spec = oiio.ImageSpec(100_000, height, 3, oiio.UINT8 if path.suffix == ".tif" else oiio.HALF)
    spec.attribute("compression", "none")
    pixels = np.zeros((height, 100_000, 3), np.uint8)
    pixels[..., 0], pixels[..., 1] = (np.arange(height) % 251)[:, None], np.arange(100_000) % 251
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_image(pixels)
    assert out.close()
    return path


@pytest.mark.parametrize(
    ("ending", "op"), [("exr", "--flip"), ("tif", "--cut 700x50+99300+9"), slow("tif", "--mulc 0.5")]
)
def test_memory_does_not_grow_with_the_scanlines_of_a_wide_file(tmp_path, ending, op):
    low, high = (wide(tmp_path / f"{height}.{ending}", height) for height in (64, 256))
    words = ["--cache", "32", "--compression", "none", *op.split(), "-o", f"out.{ending}"]
    grown = peak_of(tmp_path, high, *words) - peak_of(tmp_path, low, *words)
    assert grown < 100  # its floats alone are 220 MB more
    if op == "--flip":
        np.testing.assert_array_equal(load(tmp_path / f"out.{ending}"), load(low)[::-1])
    if op.startswith("--cut"):
        np.testing.assert_array_equal(load(tmp_path / f"out.{ending}"), load(low)[9:59, 99300:])


def test_wide_scanlines_are_resized_or_refused_with_the_figure(tmp_path):
    wide(tmp_path / "wide.tif", 64)
    assert oiiotex("wide.tif", "--resize", "1000x16", "-o", "out.tif", cwd=tmp_path).returncode == 0
    assert load(tmp_path / "out.tif").shape == (16, 1000, 3)
    done = oiiotex("--cache", "16", "wide.tif", "--resize", "1000x16", "-o", "out.tif", cwd=tmp_path)
    assert done.returncode == 0 or "of memory; the budget is 16 MB" in line_of(done)


# what an op's argument may be, by its name; by the op's flag where one is to differ
ARGUMENTS = {
    "value": "0.5", "scale": "0.5", "strategy": "box3", "channels": "R,G,B", "count": "3", "names": "A,B,C",
    "map": "inferno", "space": "ACEScg", "to_space": "ACEScg", "from_space": "ACEScg", "matrix": "1,0,0,0,1,0,0,0,1",
    "orientation": "6", "place": "+3+4", "offset": "+1+1", "size": "3x3", "codes": "1,13", "position": "+0+0",
    "shift": "+1+1", "aspect": "2", "angle": "30", "corners": "0,0,1,1", "points": "0,0,1,1", "kernel": "gaussian",
    "--crop": "1x1+0+0", "--cut": "1x1+0+0", "--mosaic": "1x1", "--resize": "1x1", "--create": "1x1 3",
    "--pattern": "noise 1x1 3",
    "--deepen": "--flatten",  # pixels of deep images are no array
}  # fmt: skip


@pytest.fixture(scope="module")
def single_pixels(tmp_path_factory):
    """A folder with a file of one pixel for each number of channels."""
    folder, one = tmp_path_factory.mktemp("pixels"), np.full((1, 1, 4), 0.5)
    sources = {"rgb.exr": one[..., :3], "rgba.tif": one, "st.exr": one[..., :2], "y.png": one[..., :1]}
    for name, pixels in sources.items():
        save(pixels, folder / name, "uint8" if name == "y.png" else "float", "ACEScg")
    return folder


@pytest.mark.parametrize("op", [*host.OPS, *filters.FILTERS], ids=lambda op: op.flag())
def test_a_single_pixel_has_a_result_or_a_one_line_refusal(single_pixels, op):
    tmp_path, sources = single_pixels, sorted(path.name for path in single_pixels.iterdir())
    assert len(sources) == 4
    given = ARGUMENTS.get(op.flag(), " ".join(ARGUMENTS.get(p.name, "1") for p in op.arguments())).split()
    for source in sources:
        images = [source, *["st.exr" if "warp" in op.name else source] * (max(1, len(op.images())) - 1)]
        words = [*images, op.flag(), *given, "-d", "float", "-o", "out.exr"]
        try:
            run([str(word) for word in words], tmp_path)
        except Error as error:
            assert "\n" not in str(error)
        else:
            assert np.prod(load(tmp_path / "out.exr").shape) > 0
            (tmp_path / "out.exr").unlink()
    assert sorted(os.listdir(tmp_path)) == sources


@pytest.mark.parametrize("op", ["--fft", "--ifft"])
def test_an_op_that_needs_the_whole_image_refuses_with_the_figure(tmp_path, op):
    words = ["--create", "3000x2000", "2", "--cache", "20", op, "-o", "out.exr"]
    line = line_of(oiiotex(*words, cwd=tmp_path))
    assert f"{op} needs " in line
    assert " MB of memory; the budget is 20 MB: raise --cache" in line
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
def test_thirty_two_channels_go_through_or_are_cut_with_a_warning(tmp_path):
    save(np.random.default_rng(0).random((20, 30, 32)), tmp_path / "many.exr", "float")
    pixels = load(tmp_path / "many.exr")
    for op, expected in (("--flip", pixels[::-1]), ("--mulc 0.5", pixels * np.float32(0.5)), ("--crop 9x9", None)):
        done = oiiotex("many.exr", *op.split(), "-o", "o.tif", "-o", "o.exr", cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
        for name in ("o.tif", "o.exr"):
            assert load(tmp_path / name).shape[2] == 32
            if expected is not None:
                np.testing.assert_allclose(load(tmp_path / name), expected, atol=1e-6)
    done = oiiotex("many.exr", "-d", "uint8", "-o", "o.png", cwd=tmp_path)
    assert (done.returncode, load(tmp_path / "o.png").shape[2]) == (0, 4)
    assert "cannot hold 32 channels" in done.stderr


def test_a_deep_image_is_refused_in_one_clear_line(tmp_path):
    deep_file(tmp_path / "deep.exr")
    for words in (["--flip", "-o", "o.exr"], ["--printstats"], ["-otex", "o.tx"]):
        line = line_of(oiiotex("deep.exr", *words, cwd=tmp_path))
        assert "deep.exr is deep: expected a flat image; add --flatten before this step" in line
    assert os.listdir(tmp_path) == ["deep.exr"]


def test_a_quilt_that_looks_for_a_lattice_beyond_the_budget_says_so_before_the_work(tmp_path):
    noise = np.random.default_rng(0).random((2000, 2000, 3))
    save(noise, tmp_path / "photo.exr", "half", "lin_rec709_scene")
    words = ["photo.exr", "--texquilt:size=400x400", "--cache", "256", "-o", "out.exr"]
    with refused(Error, task="finding the lattice of 2000x2000", budget=256 << 20, advice="set lattice=0"):
        run(words, tmp_path)  # it held 440 MB


@pytest.mark.slow
def test_a_quilt_of_a_large_photo_keeps_to_the_budget(tmp_path):
    noise = np.random.default_rng(0).random((2000, 2000, 3))
    save(noise, tmp_path / "photo.exr", "half", "lin_rec709_scene")
    save(noise[:64, :64], tmp_path / "small.exr", "half", "lin_rec709_scene")
    large, small = (
        peak_of(tmp_path, f"{name}.exr", f"--texquilt:{what}:lattice=0", "--cache", "256", "-o", "out.exr")
        for name, what in (("photo", "size=2000x2000"), ("small", "size=64x64:patch=16"))
    )
    assert large - small < 256
