# SPDX-License-Identifier: Apache-2.0
"""--texflatten corrects light, and keeps materials, objects and the range of the photo."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex import filters
from tests import pictures
from tests.analysis.test_flatten import lab_of, linear
from tests.any_filter import buffer, pixels

SATURATED = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1), (0.02, 0, 0), (0, 0, 0.02))


def card() -> np.ndarray:
    """A gray ramp above squares of saturated and near-black colors, 0 to 1."""
    y, x = np.mgrid[:96, :128]
    image = np.repeat((x / 127.0)[..., None], 3, 2)
    image[40:] = np.array(SATURATED)[x[40:] // 16]
    return image * (0.95 + 0.05 * np.random.default_rng(0).random((96, 128, 1)))


@pytest.mark.parametrize("space", ["srgb_rec709_scene", "lin_rec709_scene"])
def test_a_test_card_stays_within_what_light_does(space):
    made = pixels(filters.flatten(buffer(card(), space=space)))
    assert made.min() >= 0
    if space == "lin_rec709_scene":  # channel ratios are kept: what was zero is zero
        squares = np.broadcast_to(np.array(SATURATED)[np.arange(128) // 16] == 0, (56, 128, 3))
        assert np.abs(made[40:][squares]).max() < 0.01 * made[40:].max()
    assert lab_of(made, space)[..., 0].max() < 101  # no brighter than the card


def test_bright_rings_stay_within_their_range_in_half():
    y, x = np.mgrid[:200, :200]
    rings = np.repeat((0.5 + 1024 * ((np.hypot(y - 100, x - 100) % 25) < 4))[..., None], 3, 2)
    rings[..., 1] *= 1 + 0.05 * np.sin(x / 9)
    made = pixels(filters.flatten(buffer(rings, oiio.HALF, "lin_rec709_scene")))
    assert np.isfinite(made).all() and made.min() > 0.4 and made.max() < 1.15 * rings.max()


def test_nearly_transparent_pixels_are_no_evidence():
    """A glow whose skirt has alpha 1e-4: color over it is a quotient of small numbers."""
    moss = pictures.moss(96, 96, 1) ** 2.2
    alpha = np.ones((96, 96, 1))
    alpha[:, 64:] = 1e-4
    made = []
    for skirt in (0.0, 50.0):
        given = np.concatenate([moss * alpha, alpha], -1)
        given[:, 64:, :3] += skirt * 1e-4
        made.append(pixels(filters.flatten(linear(given))))
    np.testing.assert_array_equal(made[0][:, :64], made[1][:, :64])
    assert np.isfinite(made[1]).all() and made[1][..., :3].max() < 1


def test_a_light_is_removed_with_its_effect_on_color():
    """A lamp whose light is 4 times as strong on one side, and warmer: what is left is far below what was added."""
    clean = pictures.bricks(160, 200, 1) ** 2.2
    x = np.linspace(0, 1, 200)[None, :, None]
    lamp = 4**x * (1 + x * [0.1, 0, -0.1]) / 2
    made, before, clean = (lab_of(v) for v in (pixels(filters.flatten(linear(clean * lamp))), clean * lamp, clean))
    left, added = (np.abs(gaussian_filter(v - clean, (30, 30, 0), mode="nearest")).mean((0, 1)) for v in (made, before))
    assert (left < [3, 2, 3]).all() and (added > 1.5 * left).all()


def test_two_materials_keep_their_colors():
    """Rust on turquoise paint: lightness is evened out, colors stay apart."""
    rng = np.random.default_rng(0)
    red = gaussian_filter(rng.standard_normal((200, 260)), 25) > 0
    photo = np.where(red[..., None], [0.45, 0.09, 0.03], [0.15, 0.4, 0.38]) * rng.uniform(0.8, 1.2, (200, 260, 1))
    made = lab_of(pixels(filters.flatten(linear(photo))))
    before = lab_of(photo)
    apart, was = (np.hypot(*(v[red].mean(0) - v[~red].mean(0))[1:]) for v in (made, before))
    assert apart > 0.85 * was


def test_a_mixture_of_two_materials_is_not_tinted():
    """White paint on rust, more of it to the right: it stays nearly white (by the level alone it gets 6 and 21)."""
    rng = np.random.default_rng(1)
    heights, x = gaussian_filter(rng.standard_normal((200, 260)), 3), np.linspace(0, 1, 260)
    paint = heights > np.quantile(heights, 1 - 0.05 - 0.4 * x)[None]
    photo = np.where(paint[..., None], [0.8, 0.8, 0.8], [0.25, 0.07, 0.03]) * rng.uniform(0.9, 1.1, (200, 260, 1))
    made = lab_of(pixels(filters.flatten(linear(photo))))
    for side, most in ((slice(None, 80), 3), (slice(-80, None), 10)):
        assert np.hypot(*made[:, side][paint[:, side]].mean(0)[1:]) < most


def test_dark_windows_stay_dark():
    """Two windows in a wall that is lit from one side: they are no shade."""
    wall = pictures.bricks(240, 320, 2) ** 2.2 * np.linspace(0.6, 1.4, 320)[None, :, None]
    for x in (60, 200):
        wall[70:130, x : x + 40] = 0.004
    made = lab_of(pixels(filters.flatten(linear(wall))))
    assert max(made[80:120, x + 8 : x + 32, 0].mean() for x in (60, 200)) < 8
    left, right = made[150:, :80, 0].mean(), made[150:, -80:, 0].mean()
    assert abs(left - right) < 2
