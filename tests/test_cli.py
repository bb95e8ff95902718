# SPDX-License-Identifier: Apache-2.0
"""End to end through the program, its outputs read back with OpenImageIO's own tools."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from tests import pictures
from tests.conftest import load, oiiotex, save

OIIOTOOL = Path(sys.executable).parent / "oiiotool"
QUICK = ":size=64x64:iterations=4"


def test_the_readmes_line_works_on_a_linear_exr(tmp_path):
    picture = pictures.stained(pictures.bricks(80, 96, 0)) * 4
    save(picture, tmp_path / "photo.exr", "half")
    done = oiiotex(
        "photo.exr",
        "--iscolorspace",
        "ACEScg",
        "--texstationarize:flatten=0:sigma=8:size=64x64:seed=7",
        "-o",
        "tile.exr",
        cwd=tmp_path,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    tile = oiio.ImageBuf(str(tmp_path / "tile.exr"))
    assert (tile.spec().width, tile.spec().height, str(tile.spec().format)) == (64, 64, "half")
    assert tile.spec().get_string_attribute("oiio:ColorSpace") in ("ACEScg", "lin_ap1_scene")  # one space, two names
    known = {p.tobytes() for p in load(tmp_path / "photo.exr").reshape(-1, 3)}
    assert all(p.tobytes() in known for p in load(tmp_path / "tile.exr").reshape(-1, 3))


def test_an_st_map_remakes_the_tile_to_the_bit(tmp_path, photo):
    assert oiiotex(photo, "--texstationarize:iterations=4:stmap=1", "-o", "both.exr", cwd=tmp_path).returncode == 0
    assert (
        oiiotex(
            photo, "--texflatten", "both.exr", "--texwarp", "-d", "uint8", "-o", "again.png", cwd=tmp_path
        ).returncode
        == 0
    )
    assert oiiotex(photo, "--texstationarize:iterations=4", "-o", "tile.png", cwd=tmp_path).returncode == 0
    np.testing.assert_array_equal(load(tmp_path / "again.png"), load(tmp_path / "tile.png"))
    st = oiio.ImageBuf(str(tmp_path / "both.exr"), 1, 0)
    assert (st.name.endswith("both.exr"), str(st.spec().format), st.spec().nchannels) == (True, "float", 2)
    assert st.spec().get_string_attribute("oiio:subimagename") == "st"


@pytest.mark.skipif(not OIIOTOOL.exists(), reason="no oiiotool")
def test_oiiotool_reads_the_st_map_as_we_do_where_sizes_agree(tmp_path, photo):
    assert (
        oiiotex(
            photo, "--texstationarize:flatten=0:iterations=4:stmap=st.exr", "-o", "tile.png", cwd=tmp_path
        ).returncode
        == 0
    )
    subprocess.run([OIIOTOOL, photo, "st.exr", "--st_warp:filter=box", "-o", "warped.png"], cwd=tmp_path, check=True)
    same = subprocess.run([OIIOTOOL.parent / "idiff", "warped.png", "tile.png"], cwd=tmp_path, capture_output=True)
    assert same.returncode == 0, same.stdout


def test_st_maps_refer_to_the_display_window_as_oiiotools_do(tmp_path):
    picture = pictures.stained(pictures.bricks(60, 70, 0))
    save(picture, tmp_path / "crop.exr", "float", "srgb_rec709_scene", x=9, y=4, full_width=100, full_height=80)
    assert (
        oiiotex(
            "crop.exr", "--texstationarize:flatten=0:iterations=4:stmap=1", "-o", "both.exr", cwd=tmp_path
        ).returncode
        == 0
    )
    st = load(tmp_path / "both.exr", 1)
    assert st[..., 0].min() > 9 / 100 and st[..., 0].max() < 79 / 100
    assert oiiotex("crop.exr", "both.exr", "--texwarp", "-o", "again.exr", cwd=tmp_path).returncode == 0
    np.testing.assert_array_equal(load(tmp_path / "again.exr"), load(tmp_path / "both.exr"))


def test_infix_order_waits_for_its_operand(tmp_path, photo):
    assert (
        oiiotex(photo, f"--texstationarize{QUICK}:flatten=0:stmap=st.exr", "-o", "tile.png", cwd=tmp_path).returncode
        == 0
    )
    assert oiiotex(photo, "--texwarp", "st.exr", "-o", "warped.png", cwd=tmp_path).returncode == 0
    np.testing.assert_array_equal(load(tmp_path / "warped.png"), load(tmp_path / "tile.png"))


@pytest.mark.parametrize("tile", ["xy", "x", "y", "none"])
def test_a_tile_has_no_seam_along_the_axes_it_tiles(tmp_path, tile):
    slope = np.linspace(0.2, 0.9, 96)
    picture = 0.5 * pictures.pebbles(96, 96, 0) + 0.5 * (slope[None, :, None] + slope[:, None, None]) / 2
    save(picture, tmp_path / "slope.png")
    assert oiiotex("slope.png", f"--texpatchmatch:tile={tile}", "-o", "tile.png", cwd=tmp_path).returncode == 0
    gray = load(tmp_path / "tile.png").astype(float).mean(-1)
    for axis, name in ((1, "x"), (0, "y")):
        jumps = np.abs(gray - np.roll(gray, 1, axis)).mean(1 - axis)
        assert (jumps[0] <= jumps[1:].max()) == (name in tile), (name, jumps[0], jumps[1:].max())


BAD = {
    "no such file": (["none.png", "--texstationarize"], "none.png: no such file"),
    "not an image": ([__file__, "--texstationarize"], "not an image that can be read"),
    "sigma 0": (["photo.png", "--texstationarize:sigma=0"], "sigma=0: expected a number >= 0.5"),
    "a size without width": (
        ["photo.png", "--texstationarize:size=0x10"],
        "size=0x10: expected pow2 or WIDTHxHEIGHT",
    ),
    "a word for a size": (["photo.png", "--texstationarize:size=big"], "size=big: expected"),
    "an even patch": (["photo.png", "--texstationarize:patch=10"], "patch=10: expected 5 | 7"),
    "a mistyped modifier": (["photo.png", "--texstationarize:sgima=3"], "did you mean 'sigma'?"),
    "a mistyped op": (["photo.png", "--texstationarise"], "did you mean '--texstationarize'?"),
    "an open quote": (["photo.png", '--texstationarize:stmap="a'], "is not closed"),
    "an untagged EXR": (
        ["photo.exr", "--texstationarize"],
        "photo.exr does not say its colour space: add --iscolorspace",
    ),
    "an unknown space": (["photo.exr", "--iscolorspace", "ACESgc"], "colour space 'ACESgc' is not in"),
    "a device that is not there": (
        ["photo.png", "--texstationarize", "--device", "abacus"],
        "no device 'abacus'; there is 0 =",
    ),
    "a tile beyond the budget": (
        ["photo.png", "--texstationarize:size=4096x4096", "--cache", "48"],
        "the budget is 48 MB",
    ),
    "a small exemplar": (
        ["small.png", "--texstationarize:size=512x512"],
        "12x12 px is smaller than a patch of 13x13",
    ),
    "a small tile": (["photo.png", "--texstationarize:size=9x64"], "smaller than a patch"),
    "NaN": (["nan.exr", "--iscolorspace", "ACEScg", "--texstationarize"], "2 NaN and 1 Inf values: add --fixnan"),
    "a bad repair": (["nan.exr", "--fixnan", "glue"], "strategy=glue: expected none | black | box3 | error"),
    "too few images": (["photo.png", "--texwarp"], "takes 2 image(s), there are 1"),
    "no image": (["--texstationarize"], "takes 1 image(s), there are 0"),
    "a photo for an ST map": (["photo.png", "photo.png", "--texwarp"], "two channels of floats, here are 3 of uint8"),
    "an ST map over the photo": (
        ["photo.png", f"--texstationarize{QUICK}:stmap=photo.png"],
        "photo.png would overwrite exemplar, an image that it reads",
    ),
    "an ST map under the tile": (
        ["photo.png", f"--texstationarize{QUICK}:stmap=old.png"],
        "cannot hold part 'st' as float",
    ),
    "an ST map as JPEG": (["photo.png", f"--texstationarize{QUICK}:stmap=st.jpg"], "cannot hold part 'st' as float"),
    "coordinates out of range": (
        ["photo.png", "far.exr", "--texwarp"],
        "--texwarp : far.exr has 4 coordinates outside",
    ),
    "an endless sigma": (["photo.png", "--texstationarize:sigma=1e30"], "expected a number >= 0.5 and <= 1000000"),
    "ST parts in a PNG": (
        ["photo.png", f"--texstationarize{QUICK}:stmap=1"],
        "png holds one image, here are part0, st",
    ),
    "floats in a PNG": (["photo.png", "-d", "float"], "png cannot hold part 'part0' as float"),
    "a pixel type that is none": (["photo.png", "-d", "uint31"], "no pixel type 'uint31'"),
    "a word for threads": (["photo.png", "--threads", "two"], "--threads two: expected an integer from 0"),
    "threads that no machine has": (["photo.png", "--threads", "40000"], "expected an integer from 0 to 4096"),
    "an attribute of a billion values": (
        ["photo.png", "--attrib:type=int[1000000000]", "foo", "1"],
        "expected at most 65536 values",
    ),
    "a broken config": (["photo.png", "--colorconfig", "photo.png", "--texstationarize"], "not a colour config"),
    "a truncated file": (["half.exr", "--iscolorspace", "ACEScg", "--texstationarize"], "cannot be read"),
    "all transparent": (["clear.exr", "--iscolorspace", "ACEScg", "--texstationarize"], "free of transparent pixels"),
}


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
    whole = (tmp_path / "photo.exr").read_bytes()
    (tmp_path / "half.exr").write_bytes(whole[: len(whole) // 2])


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_clear_line(case, bad_inputs, fails):
    words, expected = BAD[case]
    assert expected in fails(*words)


def test_a_tile_does_not_overwrite_its_map(tmp_path, photo):
    done = oiiotex(photo, f"--texstationarize{QUICK}:stmap=x.exr", "-o", "x.exr", cwd=tmp_path)
    assert done.returncode == 1 and "has just been written" in done.stderr
    assert not (tmp_path / "x.exr").exists()


def test_a_sigma_larger_than_the_photo_is_a_flat_window(tmp_path, photo):
    for n, sigma in enumerate((1e6, 1e5)):
        assert oiiotex(photo, f"--texstationarize{QUICK}:sigma={sigma}", "-o", f"{n}.exr", cwd=tmp_path).returncode == 0
    np.testing.assert_array_equal(load(tmp_path / "0.exr"), load(tmp_path / "1.exr"))


def test_a_full_stdout_is_one_line(tmp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-m", "oiiotex.cli.main", "--help"], stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1 and b"Traceback" not in done.stderr


def test_fixnan_makes_a_broken_photo_usable(tmp_path, bad_inputs):
    done = oiiotex(
        "nan.exr",
        "--iscolorspace",
        "ACEScg",
        "--fixnan",
        "box3",
        f"--texstationarize{QUICK}:patch=5",
        "-o",
        "t.exr",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert np.isfinite(load(tmp_path / "t.exr")).all()


def test_a_folder_that_cannot_be_written_and_one_that_is_not_there(tmp_path, photo):
    done = oiiotex(photo, "-o", tmp_path / "none" / "x.png")
    assert done.returncode == 1 and "no such folder" in done.stderr
    done = oiiotex(photo, "-o", "/dev/null")
    assert done.returncode == 1 and "not a regular file" in done.stderr
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_leaves_the_old_output_and_nothing_half(tmp_path, photo, number, code):
    out = tmp_path / "tile.png"
    out.write_bytes(b"old")
    command = [
        sys.executable,
        "-m",
        "oiiotex.cli.main",
        photo,
        "--texstationarize:size=1500x1500:iterations=1000",
        "-o",
        out,
    ]
    run = subprocess.Popen(command, stderr=subprocess.PIPE)
    time.sleep(3)
    run.send_signal(number)
    assert run.wait(timeout=60) == code
    assert out.read_bytes() == b"old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["photo.png", "tile.png"]


def test_what_kill_9_leaves_is_swept_by_the_next_run(tmp_path, photo):
    script = (
        "import os, signal; from pathlib import Path; from oiiotex.io.atomic import temporary_beside\n"
        f"with temporary_beside(Path({str(tmp_path / 'tile.png')!r})) as t:\n"
        "    t.write_bytes(b'half'); os.kill(os.getpid(), signal.SIGKILL)"
    )
    (tmp_path / "tile.png").write_bytes(b"old")
    assert subprocess.run([sys.executable, "-c", script]).returncode == -signal.SIGKILL
    assert (tmp_path / "tile.png").read_bytes() == b"old"
    assert len(list(tmp_path.glob(".tile.oiiotex-*"))) == 1
    assert oiiotex(photo, "-o", tmp_path / "other.png").returncode == 0
    assert not list(tmp_path.glob(".tile.oiiotex-*"))


def test_a_report_says_what_was_done_and_where_the_time_went(tmp_path, photo):
    done = oiiotex(photo, f"--texstationarize{QUICK}", "--runstats", "-o", "tile.png", cwd=tmp_path)
    assert done.returncode == 0
    for words in ("stationarity cost", "texture cost", "seam ratio x", "seam ratio y"):
        assert words in done.stderr
    for name in ("read", "colour", "upload", "download", "write", "patchmatch_search", "histograms_match"):
        assert name in done.stdout
    assert "\r" not in done.stderr  # no progress bar in a pipe


def test_help_version_and_devices(tmp_path):
    assert "--texstationarize" in oiiotex("--help").stdout
    page = oiiotex("--help", "texstationarize").stdout
    for modifier in ("sigma", "size", "tile", "patch", "iterations", "seed", "stmap", "uniformity", "contrast"):
        assert f":{modifier}" in page
    assert "did you mean '--texwarp'" in oiiotex("--help", "texwrap").stderr
    assert "OpenImageIO" in oiiotex("--version").stdout
    assert oiiotex("--devices").stdout.startswith("0: ")


def test_help_and_warp_need_no_opencl(tmp_path, photo):
    """pyopencl is imported by what computes on a device, and by nothing else."""
    assert (
        oiiotex(photo, f"--texstationarize{QUICK}:flatten=0:stmap=st.exr", "-o", "tile.png", cwd=tmp_path).returncode
        == 0
    )
    for words in (["--help"], [str(photo), "st.exr", "--texwarp", "-o", "again.png"]):
        script = f"import sys; sys.modules['pyopencl'] = None; from oiiotex.cli.main import main; main({words!r})"
        done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(load(tmp_path / "again.png"), load(tmp_path / "tile.png"))


def test_nothing_dear_is_imported_before_it_is_needed():
    """Every run of the program waits for what is imported at its start: scipy.stats alone takes half a second."""
    script = "import sys, oiiotex.cli.vocabulary; print(*{name.partition('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not {"scipy", "pyopencl", "sklearn", "matplotlib"} & set(done.stdout.split())


def test_debug_shows_the_traceback(tmp_path):
    done = oiiotex("none.png", "--debug")
    assert done.returncode == 1 and "Traceback" in done.stderr


def test_images_that_are_never_written_give_a_warning(photo):
    done = oiiotex(photo, f"--texstationarize{QUICK}")
    assert done.returncode == 0 and "did you forget -o?" in done.stderr


def test_a_full_disk_keeps_the_old_output(tmp_path, photo):
    if os.geteuid() != 0 or shutil.which("unshare") is None:
        pytest.skip("needs root to mount a small file system")
    script = f"""
      mount -t tmpfs -o size=64k none {tmp_path}/small 2>/dev/null || exit 77
      cp {photo} {tmp_path}/small/old.png && cp {tmp_path}/small/old.png {tmp_path}/before.png
      {shlex.quote(sys.executable)} -m oiiotex.cli.main {photo} \\
        --texstationarize:size=400x400:structure=0:sigma=16:iterations=2 -d uint16 -o {tmp_path}/small/old.png
      code=$?
      cmp {tmp_path}/small/old.png {tmp_path}/before.png && ls -A {tmp_path}/small | wc -l && exit $code
    """
    (tmp_path / "small").mkdir()
    done = subprocess.run(["unshare", "-m", "sh", "-c", script], capture_output=True, text=True)
    if done.returncode == 77:
        pytest.skip("cannot mount")
    assert (done.returncode, done.stdout.strip()) == (1, "1"), done
    assert len(done.stderr.strip().splitlines()) == 1
