# SPDX-License-Identifier: Apache-2.0
"""Same chain, same pixels: whole lines through oiiotool and through oiiotex. Single ops are in test_host_*.py."""

from __future__ import annotations

import shlex
import subprocess
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.errors import Error
from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.conftest import load, save
from tests.peer import OIIOTOOL, assert_same_file, same
from tests.refusals import refused

pytestmark = pytest.mark.skipif(not OIIOTOOL.exists(), reason="no oiiotool")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Images of all kinds, tiny."""
    folder = tmp_path_factory.mktemp("chains")
    a, b = pictures.bricks(40, 52, seed=1), pictures.pebbles(40, 52, seed=2)
    alpha = np.clip(pictures.pebbles(40, 52, seed=3)[..., :1] * 2 - 0.5, 0, 1)
    save(a, folder / "a.png")
    save(a * 3 - 0.5, folder / "a.exr", "half", x=4, y=-3, full_width=60, full_height=50)
    save(np.concatenate([b * alpha, alpha], -1), folder / "rgba.exr", "half")
    save(np.concatenate([b, alpha, alpha * 100, alpha], -1), folder / "six.exr", "float")
    save(b, folder / "b.tif", "uint16")
    save(b[..., :1], folder / "gray.tif", "float")
    parts = [OIIOTOOL, "rgba.exr", "six.exr", "--siappend", "-o", "parts.exr"]
    tiled = [OIIOTOOL, "b.tif", "--resize", "128x96", "-d", "half", "-otex", "tex.exr"]
    for words in (parts, tiled):
        subprocess.run(words, cwd=folder, check=True)
    for n in (1, 2, 3):
        save(a * n / 3, folder / f"f.{n:04d}.png")
    return folder


LINES = [
    # reading and writing
    "a.png -o OUT.png",
    "a.png --attrib oiio:subimagename A a.png --attrib oiio:subimagename B --siappendall -d B.G=float -o OUT.exr",
    "a.png --native --addc 0.3 -d half -o OUT.exr",
    "a.png --for i 0,90 --addc 0.001 --endfor -o OUT.exr",
    "a.png --attrib:type=timecode smpte:TimeCode 21:02:53:14 -o OUT.exr",
    "a.png -o OUT.exr",
    "a.png -o OUT.tif",
    "a.exr -o OUT.exr",
    "a.exr -o OUT.png",
    "a.exr -o OUT.jpg",
    "a.exr -d float -o OUT.exr",
    "a.exr -d uint8 -o OUT.tif",
    "a.exr --addc 0 -o OUT.exr",
    "a.png --addc 0.1 -o OUT.png",
    "a.png b.tif --add -o OUT.tif",
    "b.tif a.png --add -o OUT.tif",
    "a.exr b.tif --add -o OUT.tif",
    "six.exr --mulc 2 -o OUT.exr",
    "six.exr -o OUT.tif",
    "six.exr -d R=half,G=half -o OUT.exr",
    "six.exr -o OUT.png",
    "rgba.exr -o OUT.jpg",
    "a.png -o:type=half OUT.exr",
    "a.png -o:datatype=uint16 OUT.tif",
    "b.tif -d uint10 -o OUT.dpx",
    "b.tif -o:bits=10 OUT.dpx",
    "a.png --tile 16 16 -o OUT.tif",
    "tex.exr -o OUT.exr",
    "tex.exr --selectmip 1 -o OUT.exr",
    "tex.exr --unmip -o OUT.exr",
    "tex.exr --addc 0.1 -o OUT.exr",
    "a.exr --compression piz -o OUT.exr",
    "a.png --compression jpeg:50 -o OUT.jpg",
    "b.tif --planarconfig separate -o OUT.tif",
    "b.tif -o:separate=1 OUT.tif",
    "a.exr --noautocrop -o OUT.tif",
    "a.exr -o:autocrop=0 OUT.png",
    "rgba.exr --autotrim -o OUT.exr",
    "a.png --native --flip -o OUT.png",
    "-i:native=1 b.tif --flop -o OUT.tif",
    "-i:type=half b.tif -o OUT.tif",
    "-i:ch=G,R a.png -o OUT.png",
    "-i:now=1 a.exr --flip -o OUT.exr",
    "a.png -otex OUT.tx",
    "b.tif -otex:wrap=periodic:filter=lanczos3 OUT.tif",
    "a.exr -d half -otex OUT.exr",
    # stack
    "a.png --dup --flip --add -o OUT.png",
    "a.png b.tif --swap -o OUT.tif",
    "a.png b.tif --pop -o OUT.tif",
    "a.png b.tif --popbottom -o OUT.tif",
    "a.png b.tif gray.tif --stackreverse -o OUT.tif",
    "a.png b.tif gray.tif --stackextract 1 -o OUT.tif",
    "a.png --label x b.tif x --sub -d half -o OUT.exr",
    "a.png --label x --pop x x --add -o OUT.tif",
    "--add a.png b.tif -o OUT.tif",
    "a.png --add b.tif -o OUT.tif",
    "a.png --mad b.tif a.png -o OUT.tif",
    "--sub a.png -d half b.tif -o OUT.exr",
    # parts
    "parts.exr -o OUT.exr",
    "parts.exr --subimage 1 -o OUT.exr",
    "parts.exr --subimage:delete=1 0 -o OUT.exr",
    "parts.exr --sisplit --pop -o OUT.exr",
    "parts.exr --addc 0.25 -o OUT.exr",
    "parts.exr -a --addc 0.25 -o OUT.exr",
    "parts.exr --addc:allsubimages=1 0.25 -o OUT.exr",
    "parts.exr --addc:subimages=1 0.25 -o OUT.exr",
    "parts.exr --addc:subimages=-0 0.25 -o OUT.exr",
    "rgba.exr b.tif six.exr --siappendall -o OUT.exr",
    "rgba.exr b.tif six.exr --siappend:n=3 -o OUT.exr",
    "six.exr --chnames a.R,a.G,a.B,A,b.Z,b.Y --layersplit -o OUT.exr",
    # expressions and control flow
    "a.png --resize '{TOP.width/2}x{TOP.height/2}' -o OUT.png",
    "a.exr --cut '{TOP.width-10}x{TOP.height-8}+{TOP.x+2}+{TOP.y+3}' -d half -o OUT.exr",
    "a.png --attrib size '{TOP.geom}' -o OUT.tif",
    "a.png --set g 0.25 --addc '{g}' -o OUT.tif",
    "a.png --for i 3 --addc '{i/10}' --endfor -o OUT.tif",
    "a.png --for i 3,0,-1 --addc '{i/10}' --endfor -o OUT.tif",
    "a.png --set n 3 --while '{n}' --addc 0.1 --set n '{n-1}' --endwhile -o OUT.tif",
    "a.png --if '{TOP.width > 50}' --flip --else --flop --endif -o OUT.png",
    "a.png --if '{TOP.width < 50}' --flip --else --flop --endif -o OUT.png",
    "a.png --if 0 --if 1 --flip --else --flop --endif --endif -o OUT.png",
    "a.png --text:measure=1:render=0:size=12 hello --crop '{TEXT_WIDTH}x{TEXT_HEIGHT}+2+2' -o OUT.png",
    "a.png b.tif a.png b.tif --mosaic 2x1 -d half -o OUT.exr",
    "parts.exr -a --flop -o OUT.exr",
    "a.png --for i 2 --for j 2 --addc '{(i+j)/10}' --endfor --endfor -o OUT.tif",
    "a.png --evaloff --attrib x '{TOP.width}' --evalon -o OUT.tif",
    # metadata
    "a.png --attrib shot ab_010 --attrib n 3 --attrib:type=float f 2 -o OUT.tif",
    "a.png b.tif --metamerge --add -o OUT.tif",
    "a.png --caption hello --keyword stone -o OUT.tif",
    "a.png --nosoftwareattrib -o OUT.tif",
    # long lines
    "a.exr --resize 150% --blur 5x5 --addc 0.1 --crop 40x30+5+5 --flip -o OUT.exr",
    "rgba.exr six.exr --ch R,G,B,A --resize 60x50 --over --premult -d half -o OUT.exr",
    "rgba.exr --dup --flop --over --ch R,G,B --clamp:min=0:max=1 --powc 0.8 -d uint8 -o OUT.tif",
    "a.png --rotate90 --transpose --resize 30x0 --median 3x3 -o OUT.png",
    "a.png gray.tif --resize 52x40 --mul --normalize -o OUT.exr",
    "a.png --dup --blur 9x9 --sub --abs --maxchan -o OUT.tif",
    "a.png b.tif a.png b.tif --mosaic:pad=2 2x2 --resize 50% -d uint8 -o OUT.png",
    "six.exr --ch R,G,B --iscolorspace lin_rec709_scene --tocolorspace srgb_rec709_scene -d uint8 -o OUT.png",
    "--pattern checker:width=8 40x30 3 a.png --sub --absdiffc 0.2 -o OUT.tif",
    "--create 30x20 3 --text:x=2:y=15:size=12 hi a.png --max -o OUT.tif",
    "--missingfile checker a.png none.png --add -o OUT.png",
    "--missingfile black none.png --addc 0.5 -d uint8 -o OUT.png",
]


@pytest.mark.parametrize("line", LINES)
def test_the_same_chain_gives_the_same_image(folder, line):
    for old in folder.glob("*ours*"):
        old.unlink()
    same(folder, *shlex.split(line))


SEQUENCES = [
    "a.png f.0001.png -o:all=1 OUT.%d.tif",
    "f.#.png --flip -o OUT.#.png",
    "f.%04d.png --addc 0.1 -o OUT.%04d.png",
    "--frames 1-3x2 f.#.png --flip -o OUT.#.png",
    "f.1-2#.png --flip -o OUT.11-12#.png",
    "--framepadding 3 --frames 1-2 a.png --addc '{FRAME_NUMBER/10}' -o OUT.#.png",
    "--parallel-frames f.#.png --flip -o OUT.#.png",
]


@pytest.mark.parametrize("line", SEQUENCES)
def test_the_same_sequence_gives_the_same_files(folder, tmp_path, line):
    for name in ("a.png", *(f"f.{n:04d}.png" for n in (1, 2, 3))):
        (tmp_path / name).symlink_to(folder / name)
    words = shlex.split(line)
    subprocess.run([OIIOTOOL, *(w.replace("OUT.", "theirs.") for w in words)], cwd=tmp_path, check=True)
    assert run([w.replace("OUT.", "ours.") for w in words], tmp_path) == 0
    theirs = sorted(p.name for p in tmp_path.glob("theirs.*"))
    assert theirs and sorted(p.name for p in tmp_path.glob("ours.*")) == [n.replace("theirs", "ours") for n in theirs]
    for name in theirs:
        assert_same_file(tmp_path / name.replace("theirs", "ours"), tmp_path / name)


# --- where there is nothing to compare ---


def test_dither_has_the_seed_of_oiiotool(folder, tmp_path):
    words = shlex.split("../a.png --mulc 0.77 --dither -d uint8 -o 'of a name that is longer than 32 letters.png'")
    for name in ("theirs", "ours"):
        (tmp_path / name).mkdir()
    save(load(folder / "a.png") / 255, tmp_path / "a.png")
    subprocess.run([OIIOTOOL, *words], cwd=tmp_path / "theirs", check=True)
    assert run(words, tmp_path / "ours") == 0
    assert_same_file(tmp_path / "ours" / words[-1], tmp_path / "theirs" / words[-1])


def test_all_images_under_one_name_leave_the_last_and_say_so(folder, tmp_path, caplog):
    assert run([str(folder / "a.png"), str(folder / "b.tif"), "-o:all=1", "z.png"], tmp_path) == 0
    assert caplog.messages == ["-o: z.png replaces an earlier image of all=1: add %d, its number, to the name"]
    np.testing.assert_array_equal(load(tmp_path / "z.png"), load(folder / "b.tif"))


def test_ops_without_number_do_not_nest_without_end(folder, tmp_path):
    line = f"{folder}/a.png --for i 0,400 --addc 0.001 --flip --label x x --mulc 0.999 --endfor -d float -o o.exr"
    assert run(shlex.split(line), tmp_path) == 0
    value = load(folder / "a.png") / np.float32(255)
    expected = value.astype(np.float64) * 0.999**400 + 0.001 * sum(0.999**n for n in range(1, 401))
    np.testing.assert_allclose(load(tmp_path / "o.exr"), expected, rtol=1e-3)


def test_a_while_that_does_not_end_is_refused(tmp_path):
    with pytest.raises(Error, match=r"10 iterations.*--maxloop"):
        run(shlex.split("--maxloop 10 --while 1 --set i 1 --endwhile"), tmp_path)
    with pytest.raises(Error, match=r"100000 iterations.*--maxloop"):
        run(shlex.split("--for i 1e12 --endfor"), tmp_path)
    assert run(shlex.split("--set i 0 --maxloop 10 --while '{i < 10}' --set i '{i+1}' --endwhile"), tmp_path) == 0


def test_reading_at_once_respects_the_budget(folder, tmp_path):
    line = f"--cache 1 {folder}/a.png --resize 700x700 -o big.tif big.tif -o small.tif"
    assert run(shlex.split(line), tmp_path) == 0
    with refused(Error, task="now=1", budget=1 << 20):
        run(shlex.split("--cache 1 -i:now=1 big.tif -o small.tif"), tmp_path)


@pytest.mark.parametrize("suffix", ["ppm", "pfm"])
@pytest.mark.parametrize("op", ["", "--addc 0"])
def test_portable_maps_are_the_right_way_up(folder, tmp_path, suffix, op):
    assert run(shlex.split(f"{folder}/a.png {op} -o o.{suffix} o.{suffix} -o back.png"), tmp_path) == 0
    np.testing.assert_array_equal(load(tmp_path / "back.png"), load(folder / "a.png"))


def test_a_dry_run_writes_nothing(folder, tmp_path):
    assert run(["-n", str(folder / "a.png"), "--flip", "-o", "out.png"], tmp_path) == 0
    assert list(tmp_path.iterdir()) == []


def test_no_clobber_update_and_create_dir(folder, tmp_path):
    source = str(folder / "a.png")
    (tmp_path / "old.png").write_bytes(b"old")
    assert run([source, "--no-clobber", "-o", "old.png"], tmp_path) == 0
    assert run(["-u", source, "-o", "old.png"], tmp_path) == 0
    assert (tmp_path / "old.png").read_bytes() == b"old"
    with pytest.raises(Error, match="no such folder"):
        run([source, "-o", "x/y/new.png"], tmp_path)
    assert run([source, "--create-dir", "-o", "x/y/new.png"], tmp_path) == 0
    np.testing.assert_array_equal(load(tmp_path / "x/y/new.png"), load(folder / "a.png"))


def test_history_and_software(folder, tmp_path):
    source = str(folder / "a.png")
    for option, software in (
        ([], "OpenImageIO " + oiio.__version__ + ", oiiotex 0.1.0 : "),
        (["--history"], f"--history {source} --flip"),
    ):
        assert run([*option, source, "--flip", "-o", "out.tif"], tmp_path) == 0
        assert software in oiio.ImageBuf(str(tmp_path / "out.tif")).spec().get_string_attribute("Software")


def test_no_error_exit_goes_on(folder, tmp_path, caplog):
    source = str(folder / "a.png")
    assert run(["--no-error-exit", source, "--resize", "nonsense", "--flip", "-o", "out.png"], tmp_path) == 0
    np.testing.assert_array_equal(load(tmp_path / "out.png"), load(folder / "a.png")[::-1])
    assert "nonsense" in caplog.text


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("a.png --endif", "--endif without --if"),
        ("a.png --if 1 --flip", "--if is not closed: expected --endif"),
        ("a.png --for i 1,2,0 --endfor", "expected END, START,END or START,END,STEP"),
        ("a.png --set 1x 3", "expected a name of a variable"),
        ("a.png --swap -o x.png", "expected 2 image(s) on the stack, found 1"),
        ("a.png --stackextract 4", "no image 4 on the stack"),
        ("a.png --subimage 3", "has no part '3': expected one of 0"),
        ("a.png -o:tiel=3x3 x.png", "unknown modifier 'tiel', did you mean 'tile'?"),
        ("a.png -o:all=0 100%.png", "expected a single %d"),
        ("a.png -o:all=0 %999999999d.png", "expected a single %d"),
        ("a.png -o:all=0 %0.999999999d.png", "expected a single %d"),
        ("a.png --addc x", "value=x"),
        ("a.png --echo '{TOP.widht}'", "widht"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(folder, line, says):
    with pytest.raises(Error) as caught:
        run(shlex.split(line), folder)
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_ids_move_with_pixels_and_are_never_mixed(folder, tmp_path):
    photo = str(folder / "a.png")
    assert run([photo, "--texsuperpixel:sigmamin=4:photo=1", "-o", "plain.exr"], tmp_path) == 0
    words = [photo, "--texsuperpixel:sigmamin=4:photo=1", "-a", "--flip", "--rotate90", "--crop", "20x20+5+5"]
    assert run([*words, "-o", "moved.exr"], tmp_path) == 0
    plain, moved = load(tmp_path / "plain.exr", 1), load(tmp_path / "moved.exr", 1)
    assert moved.dtype == np.uint32
    np.testing.assert_array_equal(moved, np.rot90(plain[::-1], -1)[5:25, 5:25])
    for op in (["--resize", "50%"], ["--addc", "1"], ["--blur", "3x3"]):
        with pytest.raises(Error, match="holds ids"):
            run([photo, "--texsuperpixel:photo=1", "-a", *op, "-o", "x.exr"], tmp_path)
    for words in (["-d", "half", "-o", "x.exr"], ["-o", "x.png"], ["-d", "uint8", "-o", "x.tif"]):
        with pytest.raises(Error, match="uint"):
            run([photo, "--texsuperpixel", *words], tmp_path)
    assert not (tmp_path / "x.exr").exists()


def test_an_output_does_not_wait_for_an_image(folder, tmp_path):
    with refused(Error, expected="an image"):
        run(["-o", "x.png", str(folder / "a.png")], tmp_path)
