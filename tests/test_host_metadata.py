# SPDX-License-Identifier: Apache-2.0
"""Metadata and windows: as oiiotool leaves them."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.cli.running.line_run import run
from tests.conftest import load
from tests.inputs import write_inputs
from tests.peer import refused, same


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_inputs(tmp_path_factory.mktemp("metadata"))
    (folder / "patterns.txt").write_text("Art.*\n\nOrient[a-z]*\n")
    (folder / "profile.icc").write_bytes(bytes(range(200)) * 3)
    return folder


CHAINS = (
    "rgb.exr --attrib num 3 -o OUT.exr",
    "rgb.exr --attrib num 3.5 --attrib text 'a b' -o OUT.exr",
    "rgb.exr --attrib:type=float num 3 --attrib:type=string name 12 -o OUT.exr",
    "rgb.exr --attrib:type=float[3] vec 1,2,3 --attrib:type=color col 1,.5,.25 -o OUT.exr",
    "rgb.exr --attrib:type=int[2] pair 4,5 --attrib:type=int one 7 -o OUT.exr",
    "rgb.exr --attrib:type=matrix m 1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1 -o OUT.exr",
    "rgb.exr --attrib:type=rational r 24/1 -o OUT.exr",
    "five.exr --attrib Artist '' -o OUT.exr",
    "five.exr --attrib:type=string Artist you -o OUT.exr",
    "parts.exr --attrib num 3 -o OUT.exr",
    "parts.exr -a --attrib num 3 -o OUT.exr",
    "parts.exr --attrib:subimages=1 num 3 -o OUT.exr",
    "five.exr --sattrib num 3 --sattrib Artist '' -o OUT.exr",
    "five.exr --eraseattrib Artist -o OUT.exr",
    "five.exr --eraseattrib 'art.*' -o OUT.exr",
    "five.exr --eraseattrib '.*' -o OUT.exr",
    "five.exr --eraseattrib rtis -o OUT.exr",
    "five.exr --eraseattrib:fromfile=1 patterns.txt -o OUT.exr",
    "rgb.exr --caption 'A wall' -o OUT.exr",
    "rgb.exr --caption 'A wall' --caption '' -o OUT.exr",
    "rgb8.png --keyword stone --keyword brick --keyword stone -o OUT.tif",
    "rgb8.png --sattrib Keywords 'a;b ; c' --keyword d -o OUT.exr",
    "rgb8.png --keyword stone --clear-keywords -o OUT.exr",
    "rgb.exr --orientation 6 -o OUT.exr",
    *(f"five.exr --{turn} -o OUT.exr" for turn in ("orientcw", "orientccw", "orient180", "rotcw", "rotccw", "rot180")),
    "rgb.exr --orientcw --orientcw -o OUT.exr",
    "rgb.exr --attrib Orientation 9 --orientcw -o OUT.exr",
    "rgba.exr --origin +7-9 -o OUT.exr",
    "rgba.exr --origin 7,9 -o OUT.exr",
    "rgba.exr --originoffset -3+4 -o OUT.exr",
    "rgba.exr --originoffset +0+0 -o OUT.exr",
    "rgba.exr --fullsize 100x50 -o OUT.exr",
    "rgba.exr --fullsize 100x50-10+3 -o OUT.exr",
    "rgba.exr --fullsize +3+4 -o OUT.exr",
    "rgba.exr --fullsize 2,3,30,40 -o OUT.exr",
    "rgba.exr --fullsize 0x64 -o OUT.exr",
    "rgba.exr --fullpixels -o OUT.exr",
    "rgba.exr --origin +7-9 --addc 0.1 --fullpixels -o OUT.exr",
    "rgb8.png --cicp 12,16,0,1 -o OUT.png",
    "rgb8.png --cicp 12,16,0,1 --cicp 9,,1 -o OUT.png",
    "rgb8.png --cicp 12,16 -o OUT.png",
    "rgb8.png --cicp 12,16,0,1 --cicp '' -o OUT.png",
    "rgb.exr --iccread profile.icc -o OUT.tif",
    "five.exr rgb8.png --pastemeta -o OUT.exr",
    "five.exr rgba.exr --pastemeta -o OUT.exr",
    "rgba.exr five.exr --pastemeta -o OUT.exr",
    *(f"five.exr rgba.exr --caption c --sattrib Artist me --pastemeta:merge={n} -o OUT.exr" for n in (0, 1, 2)),
    "five.exr --attrib Arty 1 rgba.exr --pastemeta:merge=1:pattern=Art -o OUT.exr",
    "five.exr rgba.exr --pastemeta:merge=2:pattern=full -o OUT.exr",
    "five.exr parts.exr -a --pastemeta:pattern=A:merge=1 -o OUT.exr",
    "five.exr parts.exr -a --pastemeta -o OUT.exr",
    "five.exr parts.exr --pastemeta -o OUT.exr",
)  # fmt: skip


@pytest.mark.parametrize("chain", CHAINS)
def test_as_oiiotool(folder, chain):
    same(folder, *shlex.split(chain))


REFUSED = (
    ("rgb.exr --attrib:type=quux a 1 -o o.exr", "no type 'quux'"),
    ("rgb.exr --attrib:type=int a one -o o.exr", "is no int"),
    ("rgb.exr --eraseattrib:fromfile=1 none.txt -o o.exr", "none.txt"),
    ("rgb.exr --orientation 9 -o o.exr", "orientation=9"),
    ("rgb.exr --orientation up -o o.exr", "orientation=up"),
    ("rgb.exr --origin 20x20 -o o.exr", "no offset"),
    ("rgb.exr --origin 20x20+3+3 -o o.exr", "no offset"),
    ("rgb.exr --originoffset 50% -o o.exr", "no offset"),
    ("rgb.exr --fullsize 50% -o o.exr", "no window here"),
    ("rgb.exr --fullsize 9,9,3,3 -o o.exr", "no pixel"),
    ("rgb8.png --cicp 1,2,3,4,5 -o o.exr", "up to four"),
    ("rgb8.png --cicp a -o o.exr", "codes=a"),
    ("rgb.exr --iccread none.icc -o o.exr", "none.icc"),
    ("rgb.exr rgba.exr --pastemeta:merge=3 -o o.exr", "merge=3"),
    ("rgb.exr rgba.exr '--pastemeta:pattern=[' -o o.exr", "no regular expression"),
)


@pytest.mark.parametrize(("chain", "says"), REFUSED)
def test_refused(folder, chain, says):
    refused(folder, chain, says)


def test_one_cicp_code(folder):
    """oiiotool sets all four to it."""
    run(shlex.split("rgb8.png --cicp 12,16,0,1 --cicp 9 -o cicp.png"), folder)
    codes = oiio.ImageBuf(str(folder / "cicp.png")).spec().getattribute("CICP")
    assert list(np.asarray(codes)) == [9, 16, 0, 1]


def test_origin_of_all_parts(folder):
    """oiiotool puts the first part's pixels into all."""
    run(shlex.split("parts.exr -a --origin +1+2 -o moved.exr"), folder)
    for n in (0, 1):
        np.testing.assert_array_equal(load(folder / "moved.exr", n), load(folder / "parts.exr", n))
        spec = oiio.ImageBuf(str(folder / "moved.exr"), n, 0).spec()
        assert (spec.x, spec.y) == (1, 2)
