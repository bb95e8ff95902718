# SPDX-License-Identifier: Apache-2.0
"""--texflatten:shadows=1: a cast shadow of known shape and light, and photos without one."""

from __future__ import annotations

import functools

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex import filters
from oiiotex.analysis.shadows.border_curves import BorderCurve, distances, traced
from oiiotex.analysis.shadows.cast_shadow import SURE, CastShadow, visible
from oiiotex.engine import errors
from oiiotex.engine.session import Session
from tests import pictures
from tests.any_filter import buffer, pixels

SKY = np.array([0.3, 0.34, 0.42])  # of all light
SIDE = 192


def texture(seed: int = 3) -> np.ndarray:
    """Gray grains with some color, linear, (SIDE, SIDE, 3) float32."""
    grains = 0.5 + 0.4 * pictures.smooth_noise(SIDE, SIDE, 4, seed) - 0.2 * pictures.noise(SIDE, SIDE, seed, 1)
    tint = 1 + 0.05 * (pictures.smooth_noise(SIDE, SIDE, 5, seed, 2)[..., None] - 0.5) * [1, 0, -1]
    return (0.6 * grains[..., None] * tint).astype(np.float32)


def visible_lamp() -> np.ndarray:
    """1 in full light, 0 in the umbra of a disc, (SIDE, SIDE)."""
    y, x = np.mgrid[:SIDE, :SIDE]
    return gaussian_filter((np.hypot(x - 90, y - 100) > 50).astype(float), 3.0)


def linear(picture: np.ndarray) -> oiio.ImageBuf:
    return buffer(picture, space="lin_rec709_scene", names=("R", "G", "B", "A")[: picture.shape[2]])


def shaded(clean: np.ndarray) -> np.ndarray:
    return (clean * (visible_lamp()[..., None] * (1 - SKY) + SKY)).astype(np.float32)


def relit(picture: np.ndarray, **modifiers: object) -> np.ndarray:
    return pixels(filters.flatten(linear(picture), shadows=True, flattening=0, **modifiers))


@functools.cache
def lit() -> np.ndarray:
    """The shaded texture without its shadow; fitting it takes a second."""
    return relit(shaded(texture()))


def test_a_shadow_gets_the_light_outside_across_its_penumbra():
    clean, k = texture(), visible_lamp()
    made = lit() / clean
    for region, tolerance in ((k < 0.01, 0.04), ((k > 0.01) & (k < 0.99), 0.08)):
        np.testing.assert_allclose(made[region].mean(0), 1, atol=tolerance)
    assert np.abs(np.log(gaussian_filter(made, (2, 2, 0)))).max() < 0.25  # of log(1 / .3) = 1.2: no bright or dark rim


def test_full_light_keeps_its_bits():
    photo, k = shaded(texture()), visible_lamp()
    made = lit()
    np.testing.assert_array_equal(made[:20], photo[:20])
    assert (made == photo)[k > 0.9999].mean() > 0.9


def test_the_result_does_not_depend_on_exposure():
    photo = shaded(texture())
    np.testing.assert_allclose(relit(photo * 16) / 16, lit(), rtol=0.02)


@pytest.mark.parametrize("photo", [texture(), pictures.pebbles(SIDE, SIDE, 2)])
def test_a_photo_without_a_shadow_is_not_changed(photo, caplog):
    photo = photo.astype(np.float32)
    np.testing.assert_array_equal(relit(photo), photo)
    assert "no cast shadow was found" in caplog.text


def test_a_reddish_dark_region_is_no_shadow():
    photo = (texture() * (visible_lamp()[..., None] * (1 - SKY[::-1]) + SKY[::-1])).astype(np.float32)
    np.testing.assert_array_equal(relit(photo), photo)


@pytest.mark.parametrize(
    ("sky", "gain", "sure"),
    [
        (SKY, SURE, True),
        (SKY, SURE - 1, False),
        ((0.4, 0.4, 0.4), 900, False),  # a gray shade
        ((0.31, 0.37, 0.32), 900, False),  # grass next to soil
        ((0.11, 0.21, 0.35), 900, False),  # a lit blue plate
    ],
)
def test_a_sure_shadow_explains_the_photo_and_is_lit_by_the_sky(sky, gain, sure):
    assert CastShadow(np.zeros((2, 2)), 1.0, np.array(sky), gain).is_sure == sure


def test_pixels_outside_a_mask_do_not_count():
    photo, allowed = shaded(texture()), np.ones((SIDE, SIDE, 1), np.float32)
    photo[10:40, 10:40], allowed[10:40, 10:40] = (0.01, 0.01, 0.05), 0
    masked = relit(photo, mask=buffer(allowed, names=("Y",)))
    np.testing.assert_allclose(masked[60:], lit()[60:], rtol=0.1)


def test_it_then_flattens_the_lit_photo():
    photo = shaded(texture())
    at_once = pixels(filters.flatten(linear(photo), shadows=True))
    np.testing.assert_array_equal(at_once, pixels(filters.flatten(linear(lit()))))


def test_threads_and_bands_do_not_show():
    photo = shaded(texture())
    np.testing.assert_array_equal(relit(photo, session=Session(threads=1)), lit())


def test_it_requires_a_color_image_that_does_not_tile():
    photo = linear(shaded(texture()))
    with pytest.raises(errors.ParameterError, match="requires a color image"):
        filters.flatten(photo, shadows=True, data=True)
    with pytest.raises(errors.ParameterError, match="conflicts with an image that tiles"):
        filters.flatten(photo, shadows=True, tiled="xy")


def test_curves_follow_a_disc_and_a_half():
    y, x = np.mgrid[:60, :70]
    for away in (np.hypot(y - 30, x - 33) - 15, x + 0.3 * y - 40.0):
        curves = [curve.smoothed(3.0).extended() for curve in traced(away < 0)]
        assert len(curves) == 1
        inner = (np.abs(away) < 8) & (np.abs(y - 30) < 22)  # the end of an open curve is less certain
        slant = 1.0 if curves[0].closed else np.hypot(1, 0.3)
        np.testing.assert_allclose(distances(curves, away.shape)[0][inner], (away / slant)[inner], atol=0.6)


def test_circles_and_lines_do_not_bend_unevenly():
    turn = np.linspace(0, 2 * np.pi, 75, endpoint=False)
    circle = BorderCurve(12 * np.stack([np.sin(turn), np.cos(turn)], 1), True).evened()
    uneven, reduction = circle.bending()
    assert np.abs(uneven).max() < 0.02
    assert np.abs(reduction @ np.ones(len(circle.points))).max() < 0.02  # a larger circle is one, too
    line = BorderCurve(np.stack([np.arange(30.0), 0.5 * np.arange(30.0)], 1), False).evened()
    assert np.abs(line.bending()[0]).max() < 1e-9


def test_the_penumbra_is_close_to_a_gaussians_and_ends():
    from scipy.special import ndtr

    at = np.linspace(-5, 5, 101)
    np.testing.assert_allclose(visible(at), ndtr(at), atol=0.01)
    assert (np.diff(visible(at)) >= 0).all()
    assert visible(np.array([-4.0, 4.0])).tolist() == [0.0, 1.0]
