# SPDX-License-Identifier: Apache-2.0
"""Input images that may be left out: a part by its name, the next image of the stack, a file, a Python keyword."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex, save
from tests.everything import Everything

pytestmark = pytest.mark.usefixtures("few_places")
OP = "--texpatchmatch:size=40x36:iterations=2"
PHOTO = pictures.bricks(64, 72, seed=4)
LEFT = (np.indices((64, 72))[1] < 40)[..., None]


@pytest.fixture
def folder(tmp_path):
    save(PHOTO, tmp_path / "photo.exr", "half", "ACEScg")
    save(LEFT * 1.0, tmp_path / "left.png")
    words = ["photo.exr", "left.png", "--attrib", "oiio:subimagename", "left", "--siappend", "-o", "both.exr"]
    done = oiiotex(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    return tmp_path


def test_a_modifier_asks_for_it_and_says_where_it_is():
    mask = Everything.optional_images()[0]
    asked = {text: mask.parse(text) for text in ("1", "0", "dominant", "a.exr")}
    assert asked == {"1": True, "0": None, "dominant": "dominant", "a.exr": "a.exr"}
    assert [i.name for i in Everything.images()] == ["source"]
    assert [Everything.arity(values, 9) for values in ({}, {"mask": True}, {"mask": "a.exr"})] == [1, 2, 1]
    with pytest.raises(errors.ParameterError, match="the name of a part"):
        mask.parse("")


def test_part_stack_file_and_keyword_are_the_same(folder):
    lines = (
        ("both.exr", f"{OP}:mask=left"),
        ("photo.exr", "left.png", f"{OP}:mask=1"),
        ("photo.exr", f"{OP}:mask=left.png"),
        ("photo.exr", f'{OP}:mask="{folder}/left.png"'),
        ("photo.exr", f"{OP}:mask=1", "left.png"),  # an op in front of its operands waits for them
    )
    found = []
    for n, line in enumerate(lines):
        done = oiiotex(*line, "-o", f"{n}.exr", cwd=folder)
        assert done.returncode == 0, done.stderr
        found.append(load(folder / f"{n}.exr"))
    photo, left = oiio.ImageBuf(str(folder / "photo.exr")), buffer(LEFT * 1.0)
    for given in ({"mask": left}, {"mask": {"any name": left}}):
        found.append(pixels(filters.patchmatch(photo, size=(40, 36), iterations=2, **given)))
    found.append(pixels(filters.patchmatch({"a": photo, "m": left}, size=(40, 36), iterations=2, mask="m")))
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])
    allowed = {p.tobytes() for p in load(folder / "photo.exr")[LEFT[..., 0]]}
    assert {p.tobytes() for p in found[0].reshape(-1, 3)} <= allowed


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ((f"{OP}:mask=nope",), "neither a part (the image has part0) nor a file"),
        ((f"{OP}:mask=1",), "expected 2 image(s) on the stack, found 1"),
        (("--texcut:label=1",), "no label parts"),
        (("--texcut:labellevel=1",), "labellevel=1: requires label"),
        (("left.png", "--resize", "30x30", f"{OP}:mask=1"), "mask is 30x30, but the exemplar is 72x64"),
        (("left.png", "--mulc", "0", f"{OP}:mask=1"), "mask selects no pixel"),
        ((f"{OP}:masc=1",), "did you mean 'mask'"),
    ],
)
def test_what_is_wrong_is_said(folder, line, said):
    done = oiiotex("photo.exr", *line, "-o", "out.exr", cwd=folder)
    assert done.returncode == 1 and said in done.stderr and done.stderr.count("\n") == 1
    assert not (folder / "out.exr").exists()


def test_python_says_what_is_wrong():
    photo = buffer(PHOTO)
    with pytest.raises(
        errors.ParameterError, match=r"mask='nope': expected a part of the image \(part0\) or an existing file"
    ):
        filters.patchmatch(photo, mask="nope")
    with pytest.raises(errors.ParameterError, match="not list"):
        filters.patchmatch(photo, mask=LEFT.tolist())
    with pytest.raises(errors.ImageError, match="at least one part"):
        filters.patchmatch({})


def test_pages_name_them():
    shown = oiiotex("--help", "texpatchmatch").stdout
    assert ":mask" in shown and "the name of a part of the first image" in shown
