# SPDX-License-Identifier: Apache-2.0
"""--texsheet: a sheet over seeds and values of one modifier."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.surfaces.charts.drawing import GAP, TEXT
from tests import pictures
from tests.any_filter import buffer, pixels

PHOTO = pictures.stained(pictures.bricks(64, 72, seed=2))


def panel(sheet: np.ndarray, row: int, column: int, height: int, width: int) -> np.ndarray:
    """The pixels of a result in a sheet."""
    top = GAP + row * (height + TEXT + 2 * GAP) + TEXT + GAP
    left = GAP + column * (max(width, 220) + GAP)
    return sheet[top : top + height, left : left + width]


def test_every_panel_is_what_the_filter_makes_alone():
    photo = buffer(np.rint(255 * PHOTO) / 255)
    sheet = pixels(filters.sheet(photo, op="quilt", count=2, seed=5, vary="patch", over=["16", "24"]))
    for row, patch in enumerate((16, 24)):
        for column, seed in enumerate((5, 6)):
            alone = pixels(filters.quilt(photo, patch=patch, seed=seed))
            shown = panel(sheet, row, column, 64, 72)
            np.testing.assert_allclose(shown / 255, alone, atol=0.006)  # sRGB in 8 bits, by way of Lab
    captions = [panel(sheet, row, column, 64, 72) for row in range(2) for column in range(2)]
    assert all((a != b).any() for n, a in enumerate(captions) for b in captions[:n])


def test_without_vary_there_is_one_row():
    view = filters.sheet(buffer(PHOTO), op="quilt", count=3)
    assert view.spec().format == oiio.TypeDesc("uint8")
    assert view.spec().height == 2 * GAP + 64 + TEXT + 2 * GAP - GAP
    assert filters.sheet(buffer(PHOTO), op="quilt", count=1, panel=32).spec().width == GAP + 220 + GAP


def test_sizes_may_differ():
    sheet = pixels(filters.sheet(buffer(PHOTO), op="cut", count=1, vary="size", over=["40x40", "60x50"]))
    first = panel(sheet, 0, 0, 50, 60)
    assert (first[:, 40:] == first[-1, -1]).all() and (first[:40, :40] != first[-1, -1]).any()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"vary": "sigma"}, "vary and over require each other"),
        ({"over": ["1"]}, "vary and over require each other"),
        ({"vary": "sgima", "over": ["1"]}, "did you mean 'sigma'"),
        ({"vary": "seed", "over": ["1"]}, "vary='seed': expected a modifier of filters.stationarize"),
        ({"vary": "sigma", "over": ["8", "x"]}, "sigma='x': expected a number"),
        ({"vary": "sigma", "over": ["8", "0"]}, "sigma='0': expected a number"),
        ({"op": "warp"}, "op='warp': expected one of 'stationarize'"),
    ],
)
def test_what_makes_no_sense_is_refused_before_the_work(given, said):
    with pytest.raises(errors.ParameterError, match=said):
        filters.sheet(buffer(PHOTO), **given)
