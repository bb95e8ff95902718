# SPDX-License-Identifier: Apache-2.0
"""Estimates of maps that are missing, against what the tests render: the figures of the docs are held here."""

from __future__ import annotations

import functools

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import convolve1d, gaussian_filter
from scipy.stats import skew

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.core.attributes import ESTIMATE, HEIGHT_PX
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.session import Session
from oiiotex.surfaces.capture.fine_detail import fine_detail, skewness
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import oiiotex, save
from tests.reference import reliefs
from tests.refusals import refused

SIDE = 192
RELIEFS = {"hills": reliefs.hills(SIDE, 1), "stones": reliefs.stones(SIDE, 1), "courses": reliefs.courses(SIDE)}


@functools.cache
def sky(relief: str) -> np.ndarray:
    return reliefs.visible_sky(RELIEFS[relief], 16, 64)


def gray(values: np.ndarray, space: str = "lin_rec709_scene") -> oiio.ImageBuf:
    return buffer(np.repeat(values[..., None], 3, 2), space=space)


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def without_slow(heights: np.ndarray) -> np.ndarray:
    """What is smaller than the estimate's own sigma: the rest it does not claim to see."""
    return heights - gaussian_filter(heights, SIDE / 8, mode="wrap")


def height_of(photo: np.ndarray, **more: object) -> np.ndarray:
    made = filters.estimateheight(gray(photo), **more)
    return without_slow(pixels(made)[..., 0].astype(float) * made.spec().getattribute(HEIGHT_PX))


# --- heights ---


@pytest.mark.parametrize(
    ("relief", "azimuth", "least"),
    [
        ("hills", 135, 0.68), ("hills", 180, 0.78), ("stones", 90, 0.62), ("courses", 90, 0.87), ("courses", 135, 0.83),
    ],
)  # fmt: skip
def test_heights_under_one_light(relief, azimuth, least):
    heights = RELIEFS[relief]
    assert correlation(height_of(reliefs.lit(heights, azimuth), light=azimuth), without_slow(heights)) > least


@pytest.mark.parametrize(("relief", "least"), [("hills", 0.28), ("stones", 0.93)])
def test_heights_under_an_overcast_sky(relief, least):
    assert correlation(height_of(sky(relief), overcast=True), without_slow(RELIEFS[relief])) > least


@pytest.mark.parametrize("azimuth", [45, 90, 135])
def test_where_light_comes_from_is_found(azimuth):
    made = filters.estimateheight(gray(reliefs.lit(RELIEFS["hills"], azimuth)))
    said = made.spec().get_string_attribute(ESTIMATE)
    assert said.startswith("height from shading, light from ")
    assert float(said.split()[-2]) == pytest.approx(azimuth, abs=12)


@pytest.mark.parametrize(("relief", "least"), [("stones", 0.7), ("courses", 0.76)])
def test_heights_where_nothing_is_said_of_the_light(relief, least):
    heights = RELIEFS[relief]
    assert correlation(height_of(reliefs.lit(heights, 135)), without_slow(heights)) > least


def test_light_without_a_direction_is_an_overcast_sky():
    made = filters.estimateheight(gray(sky("hills")))
    assert made.spec().get_string_attribute(ESTIMATE).endswith("an overcast sky")


def test_light_from_the_other_end_turns_the_relief_over():
    photo = reliefs.lit(RELIEFS["hills"], 90)
    assert correlation(height_of(photo, light=90.0), height_of(photo, light=270.0)) < -0.999


def test_invert_turns_the_relief_over_and_bright_joints_are_not_guessed():
    photo = reliefs.stones(SIDE, 1)
    photo = 0.3 + 0.1 * photo / np.abs(photo).max()
    assert correlation(height_of(photo, overcast=True), height_of(photo, overcast=True, negate=True)) < -0.999
    y, x = np.mgrid[:SIDE, :SIDE] % 24
    mortar = np.where((x < 6) | (y < 6), 0.6, 0.15) + np.random.default_rng(1).normal(0, 0.01, (SIDE, SIDE))
    with pytest.raises(errors.ImageError, match=r"joints.*overcast=True.*negate=True"):
        filters.estimateheight(gray(mortar))
    assert correlation(height_of(mortar, overcast=True, negate=True), -mortar) > 0.5
    with pytest.raises(errors.ImageError, match="two materials"):
        filters.estimateheight(gray(np.where((x < 12) ^ (y < 12), 0.6, 0.15)))  # a chessboard
    filters.estimateheight(gray(np.where((x < 3) | (y < 3), 0.15, 0.6)))  # dark joints


def test_slow_light_and_exposure_are_no_relief():
    photo = reliefs.lit(RELIEFS["stones"], 90)
    slow = 0.2 * (1 + 0.5 * np.cos(2 * np.pi * np.arange(SIDE) / SIDE))[None]
    plain, dimmed = (height_of(p, light=90.0, tiled="xy") for p in (photo, photo * slow))
    assert correlation(plain, dimmed) > 0.98


def test_a_photo_that_tiles_has_heights_that_tile():
    photo = reliefs.lit(RELIEFS["hills"], 135)
    made = pixels(filters.estimateheight(gray(photo), light=135.0, tiled="xy"))
    turned = pixels(filters.estimateheight(gray(np.roll(photo, (37, 81), (0, 1))), light=135.0, tiled="xy"))
    np.testing.assert_allclose(np.roll(made, (37, 81), (0, 1)), turned, atol=1e-3)


def test_normals_are_those_of_the_heights():
    photo = gray(reliefs.lit(RELIEFS["hills"], 135))
    made = filters.estimateheight(photo, light=135.0, tiled="xy", normal=True)
    heights = pixels(made["height"])[..., 0] * made["height"].spec().getattribute(HEIGHT_PX)
    np.testing.assert_allclose(2 * pixels(made["normal"]) - 1, reliefs.normals(heights), atol=2e-3)
    assert correlation(reliefs.normals(RELIEFS["hills"])[..., 0], pixels(made["normal"])[..., 0]) > 0.6
    assert correlation(reliefs.normals(RELIEFS["hills"])[..., 1], pixels(made["normal"])[..., 1]) > 0.6
    down = filters.estimateheight(photo, light=135.0, tiled="xy", normal=True, normals="directx")["normal"]
    np.testing.assert_allclose(pixels(down)[..., 1], 1 - pixels(made["normal"])[..., 1], atol=1e-6)


@pytest.mark.parametrize("light", [{"light": 90}, {"overcast": True}])
def test_strength_multiplies_the_heights(light):
    photo = reliefs.lit(RELIEFS["hills"], 90)
    once, twice = (height_of(photo, strength=strength, **light) for strength in (1, 2))
    np.testing.assert_allclose(twice, 2 * once, atol=1e-4 * np.ptp(once))


def test_a_lower_light_is_the_tangent_of_its_elevation():
    low = height_of(reliefs.lit(0.1 * RELIEFS["hills"], 90, elevation=30), light=90, strength=np.tan(np.pi / 6))
    high = height_of(reliefs.lit(0.1 * RELIEFS["hills"], 90, elevation=45), light=90)
    assert 0.9 < low.std() / high.std() < 1.1


def test_what_contradicts_itself_or_does_not_fit_is_refused():
    photo = gray(np.ones((64, 64)))
    with pytest.raises(errors.ParameterError, match="conflicts with overcast=True"):
        filters.estimateheight(photo, light=90.0, overcast=True)
    with refused(errors.ImageError, task="heights of 64x64", budget=262144):
        filters.estimateheight(photo, session=Session(budget=1 << 18))


def test_a_photo_without_shading_is_flat():
    made = filters.estimateheight(gray(np.full((32, 40), 0.4)), normal=True)
    assert np.ptp(pixels(made["height"])) < 1e-6
    np.testing.assert_allclose(pixels(made["normal"]) - np.float32([0.5, 0.5, 1]), 0, atol=1e-6)


@pytest.mark.parametrize("value", [0.0, -0.3])
@pytest.mark.parametrize("more", [{"light": 90.0}, {"overcast": True}], ids=["light", "overcast"])
def test_a_black_photo_is_flat(value, more):
    assert np.ptp(pixels(filters.estimateheight(gray(np.full((32, 40), value)), **more))) < 1e-6


def test_a_photo_of_which_nothing_is_to_be_seen_is_refused():
    with pytest.raises(errors.ImageError, match="alpha is 0 everywhere"):
        filters.estimateheight(buffer(np.zeros((16, 16, 4))))


# --- ambient occlusion ---


@pytest.mark.parametrize("relief", list(RELIEFS))
def test_ambient_occlusion_is_what_rays_say(relief):
    heights = RELIEFS[relief][:96, :96] if relief != "hills" else reliefs.hills(96, 3)
    made = pixels(filters.estimateao(gray(heights, "data"), radius=12, relief=1.0, tiled="xy"))[..., 0]
    rays = reliefs.visible_sky(heights, 12)
    assert correlation(made, rays) > 0.99
    assert np.sqrt(((made - rays) ** 2).mean()) < 0.02


def test_a_plane_and_a_slope_see_their_sky():
    for slope in (0.0, 1.0):
        heights = slope * np.arange(64)[None].repeat(64, 0)
        made = pixels(filters.estimateao(gray(heights, "data"), radius=8, relief=1.0))[16:-16, 16:-16]
        share = (1 + 1 / np.sqrt(1 + slope**2)) / 2  # a tilted plane sees that much, above the horizon, of its light
        np.testing.assert_allclose(made, share, atol=0.01)


@pytest.mark.parametrize("said", ["12.5", 12.5, "junk", float("nan"), -3.0])
def test_how_high_the_heights_are_is_read_as_a_file_says_it(said):
    heights = gray(np.indices((32, 32)).sum(0) / 62, "data")
    wanted = pixels(filters.estimateao(heights, radius=4, relief=12.5 if said in ("12.5", 12.5) else 1.0))
    heights.specmod().attribute(HEIGHT_PX, said)
    np.testing.assert_array_equal(pixels(filters.estimateao(heights, radius=4)), wanted)


def test_how_high_the_heights_are_comes_with_them(tmp_path):
    save(reliefs.lit(RELIEFS["stones"], 90)[..., None] * np.ones(3), tmp_path / "p.exr", "float", "lin_rec709_scene")
    chain = ["p.exr", "--texestimateheight:light=90", "-o", "h.exr", "--texestimateao:radius=8", "-o", "ao.exr"]
    done = oiiotex(*chain, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    high = oiio.ImageBuf(str(tmp_path / "h.exr"))
    px = high.spec().getattribute(HEIGHT_PX)
    assert px > 2
    same = pixels(filters.estimateao(high, radius=8, relief=px))
    np.testing.assert_array_equal(pixels(oiio.ImageBuf(str(tmp_path / "ao.exr"))), same)
    other = pixels(filters.estimateao(high, radius=8, relief=px / 4))
    assert other.mean() > same.mean() + 0.01


@pytest.mark.parametrize("tile", ["x", "y"])
def test_occlusion_looks_around_what_tiles(tile):
    heights = np.zeros((48, 48))
    heights[:, 0] = heights[0, :] = 8.0  # a wall along the left and the upper border
    made = pixels(filters.estimateao(gray(heights, "data"), radius=6, relief=1.0, tiled=tile))[..., 0]
    behind = {"x": made[24, -2], "y": made[-2, 24]}
    assert behind.pop(tile) < 0.75 and next(iter(behind.values())) > 0.95


@pytest.mark.parametrize(("value", "text"), [(np.nan, "1 NaN and 0 Inf"), (-np.inf, "0 NaN and 1 Inf")])
def test_occlusion_of_broken_heights_is_refused(value, text):
    heights = np.zeros((24, 24))
    heights[0, 5] = value  # which lies beyond the border too
    with pytest.raises(errors.ImageError, match=f"{text} values: repair them with"):
        pixels(filters.estimateao(gray(heights, "data"), radius=4))


def test_occlusion_of_huge_heights_is_that_of_high_ones():
    heights = np.zeros((32, 32))
    heights[8:12, 8:12], heights[20:24, 8:12] = 1.0, -1.0
    huge, high = (pixels(filters.estimateao(gray(heights * v, "data"), radius=4, relief=1e6)) for v in (3e38, 1e6))
    np.testing.assert_allclose(huge, high, atol=1e-4)


# --- roughness ---


@pytest.mark.parametrize(("relief", "least"), [("hills", 0.55), ("stones", 0.05), ("courses", 0.25)])
def test_roughness_goes_with_what_was_rendered(relief, least):
    """A weak guess, as the docs say: the mean of three maps of roughness."""
    found = []
    for seed in (1, 2, 3):
        roughness = 0.2 + 0.6 * pictures.smooth_noise(SIDE, SIDE, 64, seed)
        photo = reliefs.glossy(RELIEFS[relief], roughness, 135)
        found.append(correlation(pixels(filters.estimateroughness(gray(photo), sigma=12.0))[..., 0], roughness))
    assert np.mean(found) > least


@pytest.mark.parametrize("relief", list(RELIEFS))
def test_roughness_of_a_photo_without_highlights_is_a_constant(relief, caplog):
    """Matte under the same light, or with highlights as before: the finest detail is skewed by them alone."""
    assert (
        pixels(filters.estimateroughness(gray(reliefs.lit(RELIEFS[relief], 135)), middle=0.4)) == np.float32(0.4)
    ).all()
    assert "the photo shows no highlights (skewness of its fine detail -0." in caplog.text
    caplog.clear()
    for seed in (1, 2, 3):
        roughness = 0.2 + 0.6 * pictures.smooth_noise(SIDE, SIDE, 64, seed)
        filters.estimateroughness(gray(reliefs.glossy(RELIEFS[relief], roughness, 135)))
    assert "highlights" not in caplog.text


def test_skewness_is_that_of_the_differences_from_the_surroundings():
    photo = np.random.default_rng(5).gamma(2.0, 0.1, (61, 83))
    taps = np.array([1, 4, 6, 4, 1]) / 16
    around = convolve1d(convolve1d(photo, taps, 0, mode="wrap"), taps, 1, mode="wrap")
    image = from_buffer(buffer(np.repeat(photo[..., None], 3, 2), space="lin_rec709_scene"))
    lens = lens_of(image, Session().resources)
    assert skewness(fine_detail(image.first, lens, "xy")) == pytest.approx(skew((photo - around).ravel()), abs=0.01)


def test_roughness_is_the_middle_where_nothing_is_to_be_seen():
    made = pixels(filters.estimateroughness(gray(np.full((40, 32), 0.3)), middle=0.7))
    np.testing.assert_array_equal(made, np.float32(0.7))


def test_roughness_stays_within_its_amount():
    photo = reliefs.glossy(RELIEFS["hills"], 0.2 + 0.6 * pictures.smooth_noise(SIDE, SIDE, 64, 1), 135)
    made = pixels(filters.estimateroughness(gray(photo), middle=0.5))
    assert 0.2 <= made.min() < made.max() <= 0.8


def test_photos_of_huge_values_have_finite_estimates():
    photo = gray(np.where(np.indices((64, 64)).sum(0) % 7 < 3, 1e35, 0.1))
    for made in (filters.estimateroughness(photo), filters.estimateheight(photo, light=45.0)):
        assert np.isfinite(pixels(made)).all()
