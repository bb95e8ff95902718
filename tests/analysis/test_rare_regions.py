# SPDX-License-Identifier: Apache-2.0
"""What looks like nothing else in a photo is found, and is not copied into its tile."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.analysis.drift.correction import Correction
from oiiotex.analysis.drift.rare_regions import rare_regions
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.op import Space
from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from tests import pictures
from tests.any_filter import buffer, pixels

SIDE = 192
KNOT = np.s_[60:84, 100:124]


def found_in(picture: np.ndarray) -> np.ndarray:
    """The pixels of a picture, 0 to 1 in sRGB, that stand out."""
    image, session = from_buffer(buffer(picture)), Session()
    regions = rare_regions(image, lens_of(image, session.resources, Space.LAB), session.resources)
    return np.zeros(picture.shape[:2], bool) if regions is None else regions


def with_knots(picture: np.ndarray, *corners: tuple[int, int]) -> np.ndarray:
    """The picture with rings, 24 px wide, that are about as light as it is; and their corners."""
    y, x = np.mgrid[:24, :24] - 11.5
    away = np.hypot(y, x)
    rings = np.where(away < 11, 1 + np.cos(away * np.pi / 4), 1.0)[..., None]
    picture = picture.copy()
    for top, left in corners:
        picture[top : top + 24, left : left + 24] *= rings
    return np.clip(picture, 0, 1)


@pytest.mark.parametrize("texture", [pictures.moss, pictures.bricks, pictures.pebbles])
def test_a_texture_alone_has_nothing_that_stands_out(texture):
    assert not found_in(texture(SIDE, SIDE, 3)).any()


@pytest.mark.parametrize("scale", [1, 2])
def test_a_knot_is_found_with_a_narrow_margin(scale):
    picture = with_knots(pictures.moss(SIDE, SIDE, 3), (60, 100)).repeat(scale, 0).repeat(scale, 1)
    found = found_in(picture)[::scale, ::scale]
    assert found[64:80, 104:120].all()
    around = np.pad(np.zeros((SIDE - 48, SIDE - 48), bool), 24)
    around[60 - 12 : 84 + 12, 100 - 12 : 124 + 12] = True
    assert not found[~around].any()


def test_many_alike_are_the_texture():
    corners = [(y, x) for y in range(4, SIDE - 24, 40) for x in range(4, SIDE - 24, 40)]
    assert not found_in(with_knots(pictures.moss(SIDE, SIDE, 3), *corners)).any()


def test_a_joint_across_the_photo_is_structure():
    picture = pictures.moss(SIDE, SIDE, 3)
    picture[:, 90:98] *= 0.2
    assert not found_in(picture).any()


def shown(picture: np.ndarray, **modifiers: object) -> float:
    """Share of a tile's pixels that come from the knot."""
    tile = filters.stationarize(buffer(picture), st=True, sigma=24.0, **modifiers)
    x, y = np.moveaxis(pixels(tile.get("st"))[..., :2], -1, 0) * SIDE
    rows, columns = KNOT
    return float(((y > rows.start + 4) & (y < rows.stop - 4) & (x > columns.start + 4) & (x < columns.stop - 4)).mean())


def test_a_tile_does_not_repeat_it_unless_a_mask_allows_it(caplog):
    picture = with_knots(pictures.moss(SIDE, SIDE, 3), (60, 100))
    caplog.set_level(logging.INFO)
    assert shown(picture) == 0
    assert "of the photo stands out and is not copied" in caplog.text
    assert shown(picture, mask=buffer(np.ones((SIDE, SIDE, 1)), names=("Y",), space="data")) > 0
    assert shown(picture, flattening=0.5) > 0


def test_a_tile_corrects_its_photo_once(monkeypatch):
    rows, apply = [], Correction.apply

    def counted(self: Correction, values: np.ndarray, window: Window) -> None:
        rows.append(window.height)
        apply(self, values, window)

    monkeypatch.setattr(Correction, "apply", counted)
    pixels(filters.stationarize(buffer(pictures.moss(SIDE, SIDE, 3)), sigma=24.0))
    assert sum(rows) == SIDE


def test_transparent_pixels_do_not_stand_out():
    moss = pictures.moss(SIDE, SIDE, 3)
    given = np.concatenate([moss, np.ones((SIDE, SIDE, 1))], -1)
    given[80:112, 80:121] = 0
    assert not found_in(given).any()
    assert not found_in(given * 0).any()
