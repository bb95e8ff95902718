# SPDX-License-Identifier: Apache-2.0
"""-o:udim= cuts an image into tiles."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from tests import pictures
from tests.conftest import load, oiiotex, save


@pytest.fixture
def picture(tmp_path):
    return save(pictures.moss(48, 96, 1), tmp_path / "all.exr", "half", x=-3, y=7, full_x=-3, full_y=7)


def test_tiles_are_numbered_from_the_lower_left_to_the_right_and_up(picture, tmp_path):
    done = oiiotex(picture.name, "-o:udim=3x2", "t.<UDIM>.exr", "-o", "whole.exr", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    whole = load(tmp_path / "whole.exr")
    np.testing.assert_array_equal(whole, load(picture))
    rows = [[load(tmp_path / f"t.{1001 + u + 10 * v}.exr") for u in range(3)] for v in (1, 0)]
    np.testing.assert_array_equal(np.block([[[tile] for tile in row] for row in rows]), whole)
    spec = oiio.ImageBuf(str(tmp_path / "t.1012.exr")).spec()
    assert (spec.x, spec.y, spec.full_width, spec.full_height) == (0, 0, 32, 24)
    again = oiiotex("t.<UDIM>.exr", "-o", "copy.<UDIM>.exr", cwd=tmp_path)
    assert again.returncode == 0 and (tmp_path / "copy.1013.exr").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-o:udim=2x2", "t.exr"), "udim=2x2 requires <UDIM> in the file name, which is 't.exr'"),
        (("-o:udim=5x2", "t.<UDIM>.exr"), "udim=5x2 cannot divide 96x48 px into tiles of equal size"),
        (("-o:udim=2x2:all=1", "t%d.<UDIM>.exr"), "udim conflicts with all"),
        (("-o:udim=11x1", "t.<UDIM>.exr"), "udim=11x1: expected"),
    ],
)
def test_what_cannot_be_cut_is_said(picture, tmp_path, words, said):
    done = oiiotex(picture.name, *words, cwd=tmp_path)
    assert done.returncode == 1 and said in done.stderr
    assert not list(tmp_path.glob("t*"))
