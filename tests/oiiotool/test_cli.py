# SPDX-License-Identifier: Apache-2.0
"""End to end through the program, its outputs read back with OpenImageIO's own tools."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from tests import pictures
from tests.conftest import load, oiiotex, save
from tests.peer import OIIOTOOL

pytestmark = pytest.mark.usefixtures("few_places")
QUICK = ":size=64x64:iterations=4"


def done_well(folder: Path, line: str) -> None:
    """Run a line in a folder: it exits 0, and says nothing."""
    done = oiiotex(*shlex.split(line), cwd=folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_the_readmes_line_works_on_a_linear_exr(tmp_path):
    save(pictures.stained(pictures.bricks(80, 96, 0)) * 4, tmp_path / "photo.exr", "half")
    filter = "--texstationarize:flattening=0:sigma=8:size=64x64:seed=7"
    done_well(tmp_path, f"photo.exr --iscolorspace ACEScg {filter} -o tile.exr")
    tile = oiio.ImageBuf(str(tmp_path / "tile.exr"))
    assert (tile.spec().width, tile.spec().height, str(tile.spec().format)) == (64, 64, "half")
    assert tile.spec().get_string_attribute("oiio:ColorSpace") in ("ACEScg", "lin_ap1_scene")  # one space, two names
    known = {p.tobytes() for p in load(tmp_path / "photo.exr").reshape(-1, 3)}
    assert all(p.tobytes() in known for p in load(tmp_path / "tile.exr").reshape(-1, 3))


def test_an_st_map_remakes_the_tile_to_the_bit(tmp_path, photo):
    for line in (
        "photo.png --texstationarize:sigma=12:iterations=4:st=1 -o both.exr",
        "photo.png --texflatten both.exr --texwarp -d uint8 -o again.png",
        "photo.png --texstationarize:sigma=12:iterations=4 -o tile.png",
    ):
        done_well(tmp_path, line)
    np.testing.assert_array_equal(load(tmp_path / "again.png"), load(tmp_path / "tile.png"))
    st = oiio.ImageBuf(str(tmp_path / "both.exr"), 1, 0)
    assert (st.name.endswith("both.exr"), str(st.spec().format), st.spec().nchannels) == (True, "float", 2)
    assert st.spec().get_string_attribute("oiio:subimagename") == "st"


@pytest.mark.skipif(not OIIOTOOL.exists(), reason="no oiiotool")
def test_oiiotool_reads_the_st_map_as_we_do_where_sizes_agree(tmp_path, photo):
    done_well(tmp_path, "photo.png --texstationarize:flattening=0:iterations=4:st=st.exr -o tile.png")
    subprocess.run([OIIOTOOL, photo, "st.exr", "--st_warp:filter=box", "-o", "warped.png"], cwd=tmp_path, check=True)
    same = subprocess.run([OIIOTOOL.parent / "idiff", "warped.png", "tile.png"], cwd=tmp_path, capture_output=True)
    assert same.returncode == 0, same.stdout


def test_st_maps_refer_to_the_display_window_as_oiiotools_do(tmp_path):
    picture = pictures.stained(pictures.bricks(60, 70, 0))
    save(picture, tmp_path / "crop.exr", "float", "srgb_rec709_scene", x=9, y=4, full_width=100, full_height=80)
    done_well(tmp_path, "crop.exr --texstationarize:flattening=0:iterations=4:st=1 -o both.exr")
    st = load(tmp_path / "both.exr", 1)
    assert st[..., 0].min() > 9 / 100 and st[..., 0].max() < 79 / 100
    done_well(tmp_path, "crop.exr both.exr --texwarp -o again.exr")
    np.testing.assert_array_equal(load(tmp_path / "again.exr"), load(tmp_path / "both.exr"))


@pytest.mark.parametrize("tile", ["xy", "x", "y", "none"])
def test_a_tile_has_no_seam_along_the_axes_it_tiles(tmp_path, tile):
    slope = np.linspace(0.2, 0.9, 96)
    picture = 0.5 * pictures.pebbles(96, 96, 0) + 0.5 * (slope[None, :, None] + slope[:, None, None]) / 2
    save(picture, tmp_path / "slope.png")
    assert oiiotex("slope.png", f"--texpatchmatch:tiles={tile}", "-o", "tile.png", cwd=tmp_path).returncode == 0
    gray = load(tmp_path / "tile.png").astype(float).mean(-1)
    for axis, name in ((1, "x"), (0, "y")):
        jumps = np.abs(gray - np.roll(gray, 1, axis)).mean(1 - axis)
        assert (jumps[0] <= jumps[1:].max()) == (name in tile), (name, jumps[0], jumps[1:].max())


BAD = """
none.png --texstationarize | none.png: no such file
page.txt --texstationarize | cannot read the image
photo.png --texstationarize:size=0x10 | size=0x10: expected pow2 or WIDTHxHEIGHT
photo.png --texstationarize:size=big | size=big: expected
photo.png --texstationarize:patch=10 | patch=10: expected one of 5, 7,
photo.exr --texstationarize | photo.exr has no color space tag ('oiio:ColorSpace'); add --iscolorspace
photo.exr --iscolorspace ACESgc | color space 'ACESgc' is not in
photo.png --texstationarize --device abacus | no device 'abacus'; available: 0 =
photo.png --texstationarize:size=4096x4096 --cache 48 | the budget is 48 MB
small.png --texstationarize:size=512x512 | 12x12 px is smaller than a patch of 13x13
photo.png --texstationarize:size=9x64 | smaller than a patch
nan.exr --iscolorspace ACEScg --texstationarize | 2 NaN and 1 Inf values: add --fixnan
nan.exr --fixnan glue | strategy=glue: expected one of none, black, box3, error
photo.png --texwarp | expected 2 image(s) on the stack, found 1
photo.png photo.png --texwarp | has 3 channels of uint8: expected two float channels
photo.png --texstationarize:QUICK:st=photo.png | photo.png would overwrite exemplar, an input image
photo.png --texstationarize:QUICK:st=old.png | cannot hold part 'st' as float
photo.png --texstationarize:QUICK:st=st.jpg | cannot hold part 'st' as float
photo.png far.exr --texwarp | --texwarp : far.exr has 4 coordinates outside
photo.png --texstationarize:QUICK:st=1 | png holds one image, not part0, st
photo.png -d float | png cannot hold part 'part0' as float
photo.png -d uint31 | unknown pixel type 'uint31'
photo.png --threads two | --threads two: expected an integer from 0
photo.png --threads 40000 | --threads 40000: expected an integer from 0 to 4096
photo.png --attrib:type=int[1000000000] foo 1 | expected at most 65536 values
photo.png --colorconfig photo.png --texstationarize | cannot load the color config
half.exr --iscolorspace ACEScg --texstationarize | cannot read rows
clear.exr --iscolorspace ACEScg --texstationarize | free of transparent pixels
"""  # mistyped ops and modifiers: test_parse.py; operands that lack: test_rehearsal.py


@pytest.fixture
def bad_inputs(tmp_path, photo):
    picture = pictures.bricks(48, 60, 0)
    save(picture, tmp_path / "photo.exr", "half")
    save(pictures.bricks(12, 12, 0), tmp_path / "small.png")
    broken = picture.copy()
    broken[2, 3, 1] = broken[4, 4, 0] = np.nan
    broken[9, 9, 2] = np.inf
    save(broken, tmp_path / "nan.exr", "float")
    save(np.concatenate([picture, 0 * picture[..., :1]], -1), tmp_path / "clear.exr", "half")
    save(np.full((2, 2, 2), 1.5), tmp_path / "far.exr", "float")
    (tmp_path / "page.txt").write_text("a page")
    whole = (tmp_path / "photo.exr").read_bytes()
    (tmp_path / "half.exr").write_bytes(whole[: len(whole) // 2])


@pytest.mark.parametrize("case", BAD.strip().splitlines())
def test_bad_input_is_one_clear_line(case, bad_inputs, fails):
    line, _, says = case.partition(" | ")
    assert says in fails(*line.replace(":QUICK", QUICK).split())


def test_a_tile_does_not_overwrite_its_map(tmp_path, photo):
    done = oiiotex(photo, f"--texstationarize{QUICK}:st=x.exr", "-o", "x.exr", cwd=tmp_path)
    assert done.returncode == 1 and "would overwrite a file written by an earlier op" in done.stderr
    assert not (tmp_path / "x.exr").exists()


def test_a_sigma_larger_than_the_photo_is_a_flat_window(tmp_path, photo):
    for n, sigma in enumerate((1e6, 1e5)):
        assert oiiotex(photo, f"--texstationarize{QUICK}:sigma={sigma}", "-o", f"{n}.exr", cwd=tmp_path).returncode == 0
    np.testing.assert_array_equal(load(tmp_path / "0.exr"), load(tmp_path / "1.exr"))


def test_fixnan_makes_a_broken_photo_usable(tmp_path, bad_inputs):
    done_well(tmp_path, f"nan.exr --iscolorspace ACEScg --fixnan box3 --texstationarize{QUICK}:patch=5 -o t.exr")
    assert np.isfinite(load(tmp_path / "t.exr")).all()


def test_a_report_says_what_was_done_and_where_the_time_went(tmp_path, photo):
    done = oiiotex(photo, f"--texstationarize{QUICK}", "--runstats", "-o", "tile.png", cwd=tmp_path)
    assert done.returncode == 0
    for words in ("stationarity cost", "texture cost", "seam ratio x", "seam ratio y"):
        assert words in done.stderr
    for name in ("read", "color", "upload", "download", "write", "patchmatch_search", "histograms_match"):
        assert name in done.stdout
    assert "\r" not in done.stderr  # no progress bar in a pipe


def test_help_and_warp_need_no_opencl(tmp_path, photo):
    """pyopencl is imported by what computes on a device, and by nothing else."""
    done_well(tmp_path, f"photo.png --texstationarize{QUICK}:flattening=0:st=st.exr -o tile.png")
    for words in (["--help", "all"], ["photo.png", "--texwarp", "st.exr", "-o", "again.png"]):
        script = (
            f"import sys; sys.modules['pyopencl'] = None; from oiiotex.oiiotool.cli.main import main; main({words!r})"
        )
        done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(load(tmp_path / "again.png"), load(tmp_path / "tile.png"))


def test_debug_shows_the_traceback(tmp_path):
    done = oiiotex("none.png", "--debug")
    assert done.returncode == 1 and "Traceback" in done.stderr
