# SPDX-License-Identifier: Apache-2.0
"""What a line alone shows to be wrong is said before a pixel is computed and before a device is opened."""

from __future__ import annotations

import contextlib
import logging
import os
import shlex

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.errors import Error
from oiiotex.engine.opencl import device_choice
from oiiotex.engine.opencl.device import DeviceMemory
from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.conftest import load, save


class Worked(BaseException):
    """Work has begun: it cannot be mistaken for an error of ours."""


@pytest.fixture
def folder(tmp_path):
    save(pictures.stained(pictures.bricks(80, 96, seed=1)), tmp_path / "photo.png")
    (tmp_path / "locked").mkdir()
    return tmp_path


@pytest.fixture
def idle(monkeypatch):
    """Neither a device may be opened nor a pixel of a file be decoded."""

    def worked(*_, **__):
        raise Worked

    monkeypatch.setattr(device_choice, "open_device", worked)
    monkeypatch.setattr("oiiotex.engine.io.reading._OpenFile.read", worked)


REFUSED = {
    "a format without ids": ("photo.png --texlabel -o lab.png", "png cannot hold part 'label.1' as uint"),
    "a type that would lose ids": ("photo.png --texlabel -d uint8 -o lab.tif", "would change its values"),
    "ids behind a flip": ("photo.png --texlabel --flip -o lab.png", "cannot hold"),
    "parts in a format of one": ("photo.png --texstationarize:st=1 -o t.png", "png holds one image"),
    "a folder that is not there": ("photo.png --texstationarize -o nosuch/t.exr", "no such folder"),
    "an unknown suffix": ("photo.png --texstationarize -o t.xyz", "no writer for '.xyz'"),
    "a type that the format lacks": ("photo.png --texstationarize -d half -o t.png", "cannot hold"),
    "the second of two outputs": ("photo.png --texstationarize -o t.exr -o nosuch/t.exr", "no such folder"),
    "a texture's folder": ("photo.png --texstationarize -otex nosuch/t.tx", "no such folder"),
    "a profile's folder": ("photo.png --texstationarize -o t.exr photo.png --iccwrite p.icc", "no ICC profile"),
    "an input later on the line": ("photo.png --texstationarize nosuch.png --over -o t.exr", "no such file"),
    "a later op": ("photo.png --texstationarize -o t.exr photo.png --texsynth:window=bad -o s.exr", "window=bad"),
    "a window": ("photo.png --texsynth:window=32by32 -o t.exr", "expected WxH+X+Y"),
    "a window outside": ("photo.png --texsynth:size=64x64:window=32x32+60+0 -o t.exr", "expected a window inside size"),
    "memory of synthesis": ("--cache 1 photo.png --texsynth -o t.exr", "analyzing exemplars needs"),
    "memory of a tile": (
        "--cache 64 photo.png --texstationarize:size=2048x2048 -o t.exr",
        "a tile of 2048x2048 px from an exemplar of 96x80 px needs",
    ),
    "memory of a tile whose size follows from the photo": (
        "--cache 64 --pattern checker 3000x3000 3 --iscolorspace sRGB --texstationarize -o t.exr",
        "a tile of 2100x2100",
    ),
    "memory of a baseline": ("--cache 64 photo.png --texpatchmatch:size=4096x2048 -o t.exr", "a tile of 4096x2048"),
    "memory of patches": (
        "--cache 1 photo.png --texquilt:size=9000x9000:patch=12 -o t.exr",
        "quilting 9000x9000 in 1265625 patches",
    ),
    "a photo smaller than a patch": ("photo.png --crop 8x8 --texpatchmatch -o t.exr", "smaller than a patch of 13x13"),
    "the size of a tile": ("photo.png --texstationarize:size=32x32 --texdominant:patch=63 -o m.exr", "exceeds"),
    "the size of a texture": ("photo.png --texsynth:size=32x32 --texdominant:patch=63 -o m.exr", "exceeds"),
    "the size of a flat photo": ("photo.png --crop 8x8 --texflatten --texpatchmatch -o t.exr", "smaller than a patch"),
    "memory of labeling": ("--cache 2 photo.png --texlabel -o t.exr", "labeling needs"),
    "memory of whole images": ("--cache 1 photo.png --resize 900x900 --fft -o t.exr", "the budget is 1 MB"),
    "source coordinates that the output replaces": (
        "photo.png --texsynth:st=q.exr -o q.exr",
        "would overwrite a file written by an earlier op",
    ),
    "a table over an input": ("photo.png --texlabel:facts=photo.png -o l.exr", "would overwrite"),
    "a color space": ("photo.png --iscolorspace nosuch --texstationarize -o t.exr", "nosuch"),
    "an op that lacks an operand": ("photo.png --texstationarize -o t.exr --over", "image"),
    "a loop without end": ("photo.png --texstationarize -o t.exr --for i 3", "--for is not closed: expected --endfor"),
    "a device's name": ("--device nosuch photo.png -o t.exr", "no device 'nosuch'"),
    "an output's type behind a filter": ("photo.png --texflatten -o t.exr -d foo -o u.exr", "unknown pixel type 'foo'"),
    "too few operands behind a filter": ("photo.png --texflatten -o t.exr --add -o u.exr", "expected 2 image(s)"),
    "a setting behind a filter": ("photo.png --fft -o t.exr --tile 0 0 -o u.exr", "--tile"),
    "a modifier behind a filter": ("photo.png --texflatten -o t.exr --fixnan foo -o u.exr", "strategy=foo"),
    "a gap in a sequence": ("--frames 1-3 in.%04d.png --texstationarize -o out.%04d.exr", "in.0002.png: no such file"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_it_is_said_before_the_work(folder, idle, case):
    line, says = REFUSED[case]
    for number in (1, 3):
        os.link(folder / "photo.png", folder / f"in.{number:04d}.png")
    with pytest.raises(Error) as caught:
        run(shlex.split(line), folder)
    assert says in str(caught.value)
    assert not list(folder.glob("*.exr"))


def test_what_does_not_fit_a_device_of_its_own_memory_is_said_before_the_work(folder, idle, monkeypatch):
    begin = DeviceMemory.__init__

    def small(self, info):
        begin(self, info)
        self.own_memory, self.memory, self.largest = True, 18 << 20, 18 << 20

    monkeypatch.setattr(DeviceMemory, "__init__", small)
    with pytest.raises(Error, match=r"tile .*16384x16384 .* 16 MB"):
        run(shlex.split("photo.png --texstationarize:size=16384x16384 -o t.exr"), folder)
    with pytest.raises(Worked):
        run(shlex.split("photo.png --texstationarize:size=64x64 -o t.exr"), folder)


IN_VAIN = {
    "no output": ("photo.png --texstationarize", "no file was written: did you forget -o?"),
    "a step behind the last output": (
        "photo.png -o p.png --texstationarize",
        "--texstationarize after the last output is skipped: did you forget -o?",
    ),
    "a type behind the last output": ("photo.png -o p.png -d uint8", "-d uint8 after the last output has no effect"),
}


@pytest.mark.parametrize("case", IN_VAIN)
def test_what_nobody_gets_is_not_computed(folder, monkeypatch, caplog, case):
    monkeypatch.setattr(device_choice, "open_device", lambda *_: pytest.fail("a device is opened"))
    line, says = IN_VAIN[case]
    with caplog.at_level(logging.WARNING, "oiiotex"):
        assert run(shlex.split(line), folder) == 0
    assert says in caplog.messages


SET_OF_TILES = "photo.png --texstationarize:variants=4:size=64x64"
WRITTEN = {"-o t.png": True, "-o:all=0 t_%d.png": False, "--siappendall -o t.exr": False}


@pytest.mark.parametrize("output", WRITTEN)
def test_one_of_several_images_is_not_written_in_silence(folder, idle, caplog, output):
    with caplog.at_level(logging.WARNING, "oiiotex"), contextlib.suppress(Worked):
        run(shlex.split(f"{SET_OF_TILES} {output}"), folder)
    says = "1 of the 4 images of --texstationarize is written: to write all, use -o:all=0 NAME_%d.png"
    assert (says in caplog.messages) == WRITTEN[output]


UP_TO_DATE = ["photo.png --texstationarize -o t.exr", "photo.png --texlabel photo.png --over -o t.exr"]


@pytest.mark.parametrize("line", UP_TO_DATE)
def test_what_is_up_to_date_is_not_computed(folder, idle, line):
    save(np.ones((4, 4, 3)), folder / "t.exr", "half")
    assert run(["-u", *shlex.split(line)], folder) == 0
    os.utime(folder / "t.exr", (1, 1))
    with pytest.raises(Worked):
        run(["-u", *shlex.split(line)], folder)


def test_what_is_made_of_a_new_file_is_new(folder):
    for name in ("a.exr", "b.exr"):
        save(np.ones((4, 4, 3)), folder / name, "half")
    os.utime(folder / "a.exr", (1, 1))
    assert run(shlex.split("-u photo.png -o a.exr a.exr -o b.exr"), folder) == 0
    assert load(folder / "b.exr").shape == (80, 96, 3)


def test_a_mask_that_is_newer_counts(folder, idle):
    save(np.ones((80, 96, 1)), folder / "mask.tif")
    save(np.ones((4, 4, 3)), folder / "t.exr", "half")
    os.utime(folder / "t.exr", (2, 2))
    os.utime(folder / "photo.png", (1, 1))
    with pytest.raises(Worked):
        run(shlex.split("-u photo.png --texstationarize:mask=mask.tif -o t.exr"), folder)


HOLDS = [
    # what is not there yet, but will be
    "photo.png -o a.exr a.exr --texflatten -o b.exr",
    "photo.png --texsuperpixel:photo=1 -o a.exr a.exr --subimage 1 -o b.tif",
    "--create-dir photo.png -o new/folder/a.exr new/folder/a.exr -o b.exr",
    # what hangs on pixels
    "photo.png --ch R --if '{TOP.AVGCOLOR > 2}' -o nosuch/x.exr --endif -o b.exr",
    "photo.png --texflatten --resize '{TOP.width}x8' -o b.exr",
    "--no-error-exit photo.png -o nosuch/x.exr photo.png -o b.exr",
    # parts of a number that is not known yet
    "photo.png --texsuperpixel --dup --siappend -o b.exr",
    "photo.png --texstationarize:size=64x64:iterations=2 -o:udim=2x2 b.<UDIM>.exr",
]


@pytest.mark.parametrize("line", HOLDS)
def test_what_will_do_is_not_refused(folder, line):
    assert run(shlex.split(line), folder) == 0
    assert list(folder.glob("b.*"))


def test_frames_may_read_what_earlier_ones_write(folder):
    os.link(folder / "photo.png", folder / "a.0000.png")
    line = "--frames 1-3 a.{FRAME_NUMBER-1}.png --mulc 0.5 -o a.{FRAME_NUMBER}.png"
    save(np.ones((8, 8, 3)), folder / "a.0.png")
    assert run(shlex.split(line), folder) == 0
    assert load(folder / "a.3.png").max() == 32


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("--frames 1-2 {} --texdominant:facts=f.json -o d.#.exr", "facts=f.json would be written by several frames"),
        ("--frames 1-2 {} --texflatten:drift=f.exr -o d.#.exr --skip-bad-frames", "drift=f.exr would be written by"),
        ("--frames 1-2 {} --texdominant:facts=f.#.json -o d.#.exr", ""),
        ("--frames 2 {} --texdominant:facts=f.json -o d.#.exr", ""),
    ],
)
def test_a_file_of_several_frames_is_refused(folder, idle, line, says):
    with pytest.raises(Error if says else Worked, match=says or None):
        run(shlex.split(line.format("photo.png")), folder)


@pytest.mark.parametrize(
    ("line", "count"),
    [
        ("--frames 1-3 photo.png --mulc 2 -o last.exr", 1),
        ("--frames 1-3 photo.png --mulc 2 -o last.#.exr", 0),
        ("--frames 1-3 other.exr photo.png --add -o other.exr", 0),
    ],
)
def test_an_image_that_the_next_frame_replaces_is_warned_about(folder, caplog, line, count):
    save(np.ones((4, 4, 3)), folder / "other.exr", "half")
    with caplog.at_level(logging.WARNING, "oiiotex"):
        assert run(shlex.split(line), folder) == 0
    assert sum("is written by several frames, and only the last remains" in said for said in caplog.messages) == count


def test_bad_frames_are_skipped_and_the_others_done(folder):
    for number in (1, 3):
        os.link(folder / "photo.png", folder / f"in.{number:04d}.png")
    assert run(shlex.split("--skip-bad-frames --frames 1-3 in.%04d.png -o out.%04d.png"), folder) == 1
    assert sorted(p.name for p in folder.glob("out.*")) == ["out.0001.png", "out.0003.png"]


# --- windows off the origin ---


@pytest.mark.parametrize("suffix", ["png", "tif", "jpg", "exr"])
@pytest.mark.parametrize("place", ["+5000-300", "-40-30", "+40+30"])
def test_a_window_off_the_origin_keeps_its_pixels(folder, suffix, place):
    line = f"photo.png --texsynth:lod=8:window=32x24{place} -o w.{suffix} -d half -o w2.exr"
    assert run(shlex.split(line), folder) == 0
    found, whole = load(folder / f"w.{suffix}"), load(folder / "w2.exr")
    assert found.shape == (24, 32, 3)
    spec = oiio.ImageBuf(str(folder / "w2.exr")).spec()
    x, y = (int(word) for word in place.replace("+", " ").replace("-", " -").split())
    assert (spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width) == (x, y, x, y, 32)
    if suffix in ("png", "tif"):
        np.testing.assert_allclose(found / 255, whole, atol=1e-3)
    assert found.std() > 0
