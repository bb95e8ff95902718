# SPDX-License-Identifier: Apache-2.0
"""Color is taken into CIE Lab as colour-science computes it; data is left alone."""

from __future__ import annotations

import numpy as np
import PyOpenColorIO as ocio
import pytest

from oiiotex.engine.color.config import DEFAULT_CONFIG, ColorConfig
from oiiotex.engine.core.demand import bands
from oiiotex.engine.errors import ImageError
from tests.colored import LINEAR, SRGB, image_of, lab, science, seen

D65 = np.array([0.3127, 0.3290])  # the white that sRGB (IEC 61966-2-1) is defined with


@pytest.fixture(autouse=True)
def no_config_of_the_machine(monkeypatch):
    monkeypatch.delenv("OCIO", raising=False)


@pytest.fixture(scope="module")
def config() -> ColorConfig:
    return ColorConfig(DEFAULT_CONFIG)


def xyz(linear: np.ndarray) -> np.ndarray:
    """Linear sRGB -> XYZ by the matrix that follows from the primaries, not the standard's one of four digits."""
    space = science().models.RGB_COLOURSPACE_sRGB.copy()
    space.use_derived_transformation_matrices(True)
    return linear.astype(np.float64) @ space.matrix_RGB_to_XYZ.T


def assert_is_lab_of(values: np.ndarray, linear: np.ndarray) -> None:
    """`values` are what colour-science says of `linear`, as closely as float32 and the two whites in use allow.

    L* = 116 f(Y) - 16, and a*, b* are 500 and 200 times a difference of two f. Computed in float32 through four steps,
    each f is right to a few parts in 10^7: 1e-4 in L* and 5e-4 in a*, b* per unit of f. White D65 is xy = (0.3127,
    0.3290) in sRGB and colour-science, and XYZ = (0.95047, 1, 1.08883) in CIE 15; they differ by 2.1e-4 in Z, so that
    b* may differ by 200 / 3 * 2.1e-4 = 0.014 per unit of f. That is one seventieth of a just noticeable difference.
    """
    expected = science().XYZ_to_Lab(xyz(linear), D65)
    f = np.maximum(1, np.cbrt(np.abs(xyz(linear))).max(axis=-1))
    error = np.abs(values - expected)
    assert (error[..., 0] <= 1e-4 * f).all(), (error[..., 0] / f).max()
    assert (error[..., 1:] <= 0.0145 * f[..., None]).all(), (error[..., 1:] / f[..., None]).max()


# --- Lab ---


def test_lab_of_linear_color_is_that_of_colour_science_from_small_negatives_to_64(config):
    random = np.random.default_rng(1)
    display = random.random((40, 50, 3))
    bright = 64 * random.random((40, 50, 3)) ** 4
    dark = random.uniform(-0.02, 0.02, (20, 50, 3))  # the linear foot of L*, and below
    corners = np.array([[c] * 50 for c in np.ndindex(2, 2, 2)]) * np.linspace(0, 64, 50)[:, None]
    pixels = np.concatenate([display, bright, dark, corners]).astype(np.float32)
    values = lab(pixels, config)
    assert (values.dtype, values.shape) == (np.float32, pixels.shape)
    assert (xyz(pixels) < 0).any()
    assert values[..., 0].max() > 400
    assert_is_lab_of(values, pixels)


def test_lab_of_encoded_srgb_is_that_of_its_linear_light(config):
    codes = np.random.default_rng(2).integers(0, 256, (30, 40, 3), np.uint8)
    linear = science().models.eotf_sRGB(codes / 255)
    error = np.abs(lab(codes, config, space=SRGB) - science().XYZ_to_Lab(xyz(linear), D65))
    assert error.max() < 0.02  # as above; OCIO's curve meets its foot 1e-7 beside the standard's


def test_diffuse_white_is_100_and_black_is_0(config):
    values = lab(np.float32([[[1, 1, 1], [0, 0, 0]]]), config)
    np.testing.assert_allclose(values[0, :, 0], [100, 0], atol=1e-4)
    np.testing.assert_array_equal(values[0, 1], 0)


def test_equal_channels_have_no_hue(config):
    grays = np.linspace(0, 1, 101, dtype=np.float32)[None, :, None].repeat(3, 2)
    for space in (LINEAR, SRGB, "ACEScg"):
        np.testing.assert_allclose(lab(grays, config, space=space)[..., 1:], 0, atol=2e-3)


def test_the_same_light_is_the_same_lab_from_any_space(config):
    linear = np.random.default_rng(3).random((9, 7, 3)).astype(np.float32)
    processor = ocio.Config.CreateFromFile(DEFAULT_CONFIG).getProcessor("Linear Rec.709 (sRGB)", "ACEScg")
    acescg = linear.copy()
    processor.getDefaultCPUProcessor().applyRGB(acescg)
    assert np.abs(acescg - linear).max() > 0.05
    np.testing.assert_allclose(lab(acescg, config, space="ACEScg"), lab(linear, config), atol=2e-3)


def test_gray_is_rgb_of_equal_channels(config):
    gray = np.random.default_rng(4).uniform(-0.1, 4, (9, 7, 1)).astype(np.float32)
    np.testing.assert_array_equal(lab(gray, config, "Y"), lab(gray.repeat(3, 2), config))


@pytest.mark.parametrize(
    ("dtype", "largest"), [("u1", 255), ("u2", 65535), ("u4", 2**32 - 1), ("i1", 127), ("i2", 32767)]
)
def test_integers_are_shares_of_their_types_largest_value(config, dtype, largest):
    codes = np.random.default_rng(5).integers(0, largest, (9, 7, 3), dtype, endpoint=True)
    codes[0, 0], codes[0, 1] = largest, 0
    np.testing.assert_allclose(lab(codes, config), lab((codes / largest).astype(np.float32), config), atol=2e-3)


@pytest.mark.parametrize("dtype", ["f2", "f8"])
def test_floats_of_any_width_are_taken_as_they_are(config, dtype):
    pixels = np.random.default_rng(6).uniform(-0.1, 4, (9, 7, 3)).astype(dtype)
    values = lab(pixels, config)
    assert values.dtype == np.float32
    np.testing.assert_array_equal(values, lab(pixels.astype(np.float32), config))


def test_color_is_rgb_by_name_and_other_channels_are_left_aside(config):
    pixels = np.random.default_rng(7).random((9, 7, 6)).astype(np.float32)
    expected = lab(pixels[..., [4, 2, 1]], config)
    np.testing.assert_array_equal(lab(pixels, config, ("Z", "B", "G", "mask", "R", "id")), expected)
    np.testing.assert_array_equal(lab(pixels[..., :4], config, ("x", "y", "z", "w")), lab(pixels[..., :3], config))


def test_every_band_of_a_large_image_is_converted(config):
    row = np.random.default_rng(8).random((1, 400, 3)).astype(np.float32)
    pixels = row.repeat(1800, 0)  # 8.6 MB
    image = image_of(pixels, space=LINEAR)
    assert len(list(bands(image.first))) > 1
    np.testing.assert_array_equal(seen(image, config)[0], lab(row, config).repeat(1800, 0))


def test_the_pixels_themselves_stay_as_they_are(config):
    pixels = np.random.default_rng(9).random((9, 7, 4)).astype(np.float32)
    before = pixels.copy()
    lab(pixels, config, "RGBA")
    np.testing.assert_array_equal(pixels, before)


# --- alpha ---


@pytest.mark.parametrize("names", ["RGBA", "ARGB", "BGRA"])
def test_lab_is_taken_of_unpremultiplied_color(config, names):
    random = np.random.default_rng(10)
    colors = random.random((9, 7, 3)).astype(np.float32)
    alpha = random.choice([0.25, 0.5, 1, 2], (9, 7)).astype(np.float32)  # powers of two: exact
    planes = {name: colors[..., i] * alpha for i, name in enumerate("RGB")} | {"A": alpha}
    pixels = np.stack([planes[name] for name in names], -1)
    values, opaque = seen(image_of(pixels, names, LINEAR), config)
    np.testing.assert_array_equal(values, lab(colors, config))
    assert opaque is None


def test_gray_is_unpremultiplied_too(config):
    gray = np.float32([[[0.1, 0.5], [0.2, 0.25]]])
    expected = lab(np.float32([[[0.2] * 3, [0.8] * 3]]), config)
    np.testing.assert_array_equal(lab(gray, config, "YA"), expected)


def test_integer_alpha_is_a_share_too(config):
    pixels = np.uint8([[[51, 51, 51, 51], [51, 102, 0, 102]]])
    expected = lab(np.float32([[[1, 1, 1], [0.5, 1, 0]]]), config)
    np.testing.assert_allclose(lab(pixels, config, "RGBA"), expected, atol=2e-3)


def test_pixels_of_alpha_0_are_not_opaque_and_spoil_nothing(config):
    pixels = np.full((9, 7, 4), 0.5, np.float32)
    pixels[2, 3, 3] = pixels[8, 6, 3] = 0
    pixels[5, 5, 3] = 1e-3
    values, opaque = seen(image_of(pixels, "RGBA", LINEAR), config)
    assert opaque.dtype == bool
    assert np.argwhere(~opaque).tolist() == [[2, 3], [8, 6]]
    assert np.isfinite(values).all()
    _, opaque = seen(image_of(pixels, "RGBA"), None)
    assert np.argwhere(~opaque).tolist() == [[2, 3], [8, 6]]


def test_an_image_without_transparent_pixels_has_no_mask(config):
    assert seen(image_of(np.ones((3, 3, 4), np.float32), "RGBA", LINEAR), config)[1] is None
    assert seen(image_of(np.ones((3, 3, 3), np.float32), "RGB", LINEAR), config)[1] is None


def test_an_alpha_next_to_nothing_leaves_finite_values(config):
    pixels = np.float32([[[0.5, 0.5, 0.5, 1e-40]]])
    assert np.isfinite(seen(image_of(pixels, "RGBA", LINEAR), config)[0]).all()


# --- NaN and Inf ---


@pytest.mark.parametrize("as_data", [False, True], ids=["color", "data"])
def test_nan_and_inf_are_counted_over_the_whole_image_in_the_refusal(config, as_data):
    pixels = np.zeros((1800, 400, 4), np.float32)  # two bands
    pixels[0, 0, 0] = pixels[0, 0, 1] = pixels[1799, 399, 3] = np.nan
    pixels[5, 5, 2] = np.inf
    pixels[1799, 0, 0] = -np.inf
    image = image_of(pixels, "RGBA", LINEAR)
    assert len(list(bands(image.first))) > 1
    with pytest.raises(ImageError) as caught:
        seen(image, None if as_data else config)
    assert str(caught.value) == "photo.exr has 3 NaN and 2 Inf values: add --fixnan box3 after it"


# --- data ---


def scaled(pixels: np.ndarray) -> np.ndarray:
    return (pixels - pixels.min()) / (pixels.max() - pixels.min()) * 100


def test_data_is_put_on_the_scale_of_lab_by_its_common_range():
    pixels = np.random.default_rng(11).uniform(-3, 5, (9, 7, 3)).astype(np.float32)
    values, opaque = seen(image_of(pixels, ("x", "y", "z")), None)
    np.testing.assert_allclose(values, scaled(pixels), atol=1e-4)
    assert opaque is None


def test_a_space_of_data_skips_lab(config):
    pixels = np.random.default_rng(12).uniform(-1, 1, (9, 7, 3)).astype(np.float32)
    for space in ("Raw", "data"):
        assert config.is_data(space)
        np.testing.assert_allclose(lab(pixels, config, space=space), scaled(pixels), atol=1e-4)
    assert not config.is_data(LINEAR)


def test_data_needs_neither_tag_nor_config():
    tag_of_nowhere = image_of(np.eye(3, dtype=np.float32)[..., None].repeat(3, 2), space="no such space")
    assert seen(tag_of_nowhere, None)[0].shape == (3, 3, 3)


def test_gray_data_is_three_times_the_same():
    gray = np.random.default_rng(13).random((9, 7, 1)).astype(np.float32)
    np.testing.assert_allclose(seen(image_of(gray, "Y"), None)[0], scaled(gray).repeat(3, 2), atol=1e-4)


def test_two_channels_of_data_have_their_own_range():
    pixels = np.random.default_rng(14).uniform(5, 10, (9, 7, 2)).astype(np.float32)
    values = seen(image_of(pixels, "UV"), None)[0]
    np.testing.assert_allclose(values[..., :2], scaled(pixels), atol=1e-4)
    assert np.ptp(values[..., 2]) == 0  # what is not there tells nothing apart


def test_constant_data_is_finite():
    values = seen(image_of(np.full((3, 3, 3), 7, np.float32)), None)[0]
    assert np.isfinite(values).all()
    assert np.ptp(values) == 0


def test_the_range_of_data_is_that_of_its_opaque_pixels():
    pixels = np.random.default_rng(15).uniform(0, 1, (4, 4, 4)).astype(np.float32)
    pixels[..., 3] = 1
    pixels[0, 0] = [1000, -1000, 0, 0]
    values = seen(image_of(pixels, ("x", "y", "z", "A")), None)[0]
    inside = np.ones((4, 4), bool)
    inside[0, 0] = False
    np.testing.assert_allclose(values[inside], scaled(pixels[inside][:, :3]), atol=1e-4)


@pytest.mark.parametrize("names", ["UV", "UVA", "A"])
def test_two_or_no_channels_are_no_color_but_may_be_data(config, names):
    image = image_of(np.ones((2, 2, len(names)), np.float32), names, LINEAR)
    count = len(names.replace("A", ""))
    with pytest.raises(ImageError) as caught:
        seen(image, config)
    assert str(caught.value) == (
        f"photo.exr has {count} channels without alpha: expected 1 or 3 color channels;"
        " add --iscolorspace data for maps other than color"
    )
    assert seen(image, None)[0].shape == (2, 2, 3)
    tagged_as_data = image_of(np.ones((2, 2, len(names)), np.float32), names, "Raw")
    assert seen(tagged_as_data, config)[0].shape == (2, 2, 3)
