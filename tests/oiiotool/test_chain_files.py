# SPDX-License-Identifier: Apache-2.0
"""Parts, types of channels, thumbnails, and attributes of OpenImageIO itself: as oiiotool reads and writes them."""

from __future__ import annotations

import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest

from oiiotex.engine.io import writing
from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.conftest import save
from tests.peer import OIIOTOOL, process_as_before, refused, same

pytestmark = pytest.mark.skipif(not OIIOTOOL.exists(), reason="no oiiotool")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A photo, an EXR whose parts have different types and channels, and files with thumbnails."""
    folder = tmp_path_factory.mktemp("files")
    save(pictures.bricks(40, 52, seed=1), folder / "a.png")
    alpha = np.full((8, 9, 4), (0.5, 0.25, 0.1, 0.5), np.float32)
    save(alpha, folder / "alpha.png")
    for line in (
        "a.png --pattern constant:color=42 52x40 1 --chnames Z --siappend -d half -d Z=float -o parts.exr",
        "a.png --ch R,Z=G --mulc 1,1e9 -d half -d Z=float -o mixed.exr",
        "a.png --ch R,G,B,R,G,B -d half -o six.exr",
        "six.exr -d half -otex mip.exr",
        "a.png --dup --resize 20x15 --thumbnail-set -o small.tga",
        "a.png --attrib camera:lens 50 --attrib camera:stop 2 --attrib weather sun -o meta.exr",
        "a.png --caption hello --attrib Foo bar -o told.jpg",
    ):
        subprocess.run([OIIOTOOL, *shlex.split(line)], cwd=folder, check=True)
    return folder


@pytest.fixture(autouse=True)
def as_before():
    with process_as_before():
        yield


LINES = [
    # parts without a name, and types of their channels
    "--create 20x16 3 --create 20x16 1 --siappend -d half -o OUT.exr",
    "--create 20x16 3 --dup --dup --siappendall -d half -d subimage01.*=float -o OUT.exr",
    "--create 20x16 3 --dup --siappend -d half -d subimage01.G=float -o OUT.exr",
    "--create 9x8 3 --attrib oiio:subimagename A --create 9x8 3 --attrib oiio:subimagename B --siappendall"
    " -d half -d B.*=float -o OUT.exr",
    # channels chosen while reading keep the file's types
    "-i:ch=R,G,B parts.exr -o OUT.exr",
    "-i:ch=Z parts.exr -o OUT.exr",
    "-i:ch=R,Z parts.exr -o OUT.exr",
    "-i:ch=R,Z parts.exr -a --addc 1 -o OUT.exr",
    "-i:ch=R a.png --addc .1 -o OUT.tif",
    "-i:ch=B,G mip.exr -o OUT.exr",
    # a channel under the name of another one has not got its type
    "parts.exr --subimage 1 --addc 1 --chnames R -o OUT.exr",
    "mixed.exr --chnames Z,R --addc 0 -o OUT.exr",
    "mixed.exr --addc 0 --chnames Z,R -d Z=half -o OUT.exr",
    "mixed.exr -d R=half --addc 0 --chnames X -o OUT.exr",
    # modifiers and values as oiiotool reads them
    "a.png --clamp:min=0.2:max=,,0.5 -o OUT.tif",
    "a.png --clamp:min=,0.4:max=0.7,,0.6 -o OUT.tif",
    "meta.exr a.png --pastemeta:merge=1:pattern=^camera: -o OUT.exr",
    "meta.exr a.png --pastemeta:pattern=^weather$ -o OUT.exr",
    # thumbnails
    "a.png --dup --resize 20x15 --thumbnail-set -o OUT.tga",
    "a.png --dup --resize 20x15 --thumbnail-set -o OUT.tif",
    "small.tga -o OUT.tga",
    "small.tga --attrib shot 3 --origin +4+4 -o OUT.tga",
    "small.tga --addc 0.1 -o OUT.tga",
    "small.tga --thumbnail-get --addc 0.1 -o OUT.tif",
    "-i:get_thumbnail=1 small.tga -o OUT.tif",
    "-i:get_thumbnail=1:fail=0 a.png -o OUT.tif",
    "a.png --resize 300x400 --crop 250x380-20-10 --thumbnail-get:fail=0 -o OUT.tif",
    "small.tga a.png --thumbnail-set --thumbnail-get -o OUT.tif",
    # attributes of OpenImageIO
    "--oiioattrib limits:channels 5000 six.exr -o OUT.exr",
    "--oiioattrib jpeg:com_attributes 0 told.jpg -o OUT.exr",
    "--oiioattrib png:linear_premult 1 alpha.png -o OUT.exr",
]


@pytest.mark.parametrize("line", LINES)
def test_the_same_chain_writes_the_same_file(folder, line):
    for old in folder.glob("*ours*"):
        old.unlink()
    same(folder, *shlex.split(line))


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("--oiioattrib limits:channels 2 a.png -o o.exr", 'exceeds "limits:channels" = 2'),
        ("--oiioattrib limits:chanels 2 a.png -o o.exr", "expected an attribute of OpenImageIO of type int"),
        ("small.tga --addc 0.1 --thumbnail-get -o o.exr", "expected an image with a thumbnail"),
        ("a.png --thumbnail-set -o o.exr", "expected 2 image(s) on the stack, found 1"),
    ],
)
def test_refused(folder, line, says):
    refused(folder, line, says)


def test_an_attribute_of_openimageio_holds_from_its_place_on(folder):
    """The line is looked through first: that must not leave the limit behind for the file before it."""
    assert run(shlex.split("a.png --flip -o late.png --oiioattrib limits:channels 2"), folder) == 0


@pytest.mark.parametrize("tiles", ["", "--tile 32 32"])
def test_rows_from_the_bottom_up(folder, monkeypatch, tiles):
    """OpenEXR ends the process where it is given them in another order."""
    monkeypatch.setattr(writing, "BAND_BYTES", 1 << 16)
    same(folder, *shlex.split(f"--pattern noise 64x600 3 --attrib openexr:lineOrder decreasingY {tiles} -o OUT.exr"))
