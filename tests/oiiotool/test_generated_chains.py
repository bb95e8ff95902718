# SPDX-License-Identifier: Apache-2.0
"""Chains that a generator makes agree with oiiotool, but for what docs/reference/differences.md lists."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.generated_chains import chain, difference, make_images
from tests.peer import OIIOTOOL

DIFFERENCES = (Path(__file__).parents[2] / "docs" / "reference" / "differences.md").read_text()
LISTED = {  # numbers of chains that differ, by the words that list why
    "An untagged image where a color space is needed": (34, 39, 42, 46, 50, 58, 68),
    "options that require more images than there are": (15, 75),
    "`--rotate90` and `--rotate270` misplace pixels of display windows off the": (5, 82),
    "`--fit` forgets the origin of `WxH+X+Y` and of display windows": (25, 55),
    "`--max` and `--mad` of images with different channel counts": (91,),
    "**The type of computed images** follows": (43,),
}
UNLIKE = {number for numbers in LISTED.values() for number in numbers}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    if not OIIOTOOL.exists():
        pytest.skip("no oiiotool")
    path = tmp_path_factory.mktemp("chains")
    make_images(path)
    return path


def test_what_is_listed_is_in_the_page():
    assert [words for words in LISTED if words not in DIFFERENCES] == []


@pytest.mark.parametrize("first", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (20, 40, 60, 80))])
def test_generated_chains_agree(folder, first):
    unlike = {}
    for number in range(first, first + 20):
        text = difference(chain(number), folder)
        if bool(text) != (number in UNLIKE):
            unlike[number] = text
    assert unlike == {}


def test_color_is_gray_only_where_there_is_no_other(folder):
    words = "a.png --minchan a.png --add --iscolorspace sRGB --tocolorspace lin_rec709_scene -d float -o OUT.exr"
    assert difference(words.split(), folder) == ""
