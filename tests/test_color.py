# SPDX-License-Identifier: Apache-2.0
"""Colour is taken from where the user said it, into CIE Lab as colour-science computes it; never guessed."""

from __future__ import annotations

import warnings
from importlib import resources
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import PyOpenColorIO as ocio
import pytest

from oiiotex.color import DEFAULT_CONFIG, TAG, ColorConfig, Working, space_of, working_values
from oiiotex.errors import ColorError, ImageError
from oiiotex.images import Image, from_pixels, read, tagged

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # it misses matplotlib
    import colour

LINEAR = "lin_rec709_scene"
SRGB = "srgb_rec709_scene"
D65 = np.array([0.3127, 0.3290])  # the white that sRGB (IEC 61966-2-1) is defined with
KINDS = {"B": "uint8", "b": "int8", "H": "uint16", "h": "int16", "I": "uint", "e": "half", "f": "float", "d": "double"}

CONFIG = """\
ocio_profile_version: 2
search_path: ""
strictparsing: true
roles:
  aces_interchange: ACES2065-1
  default: raw
  scene_linear: plain
file_rules:
  - !<Rule> {name: plain, pattern: "*_plain*", extension: "*", colorspace: scene_linear}
  - !<Rule> {name: half, pattern: "*_half*", extension: "*", colorspace: half as bright}
  - !<Rule> {name: normals, pattern: "*_nrm*", extension: "*", colorspace: raw}
  - !<Rule> {name: Default, colorspace: default}
displays:
  none:
    - !<View> {name: Raw, colorspace: raw}
colorspaces:
  - !<ColorSpace> {name: ACES2065-1}
  - !<ColorSpace>
    name: plain
    aliases: [nickname]
  - !<ColorSpace>
    name: half as bright
    to_scene_reference: !<MatrixTransform> {matrix: [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]}
  - !<ColorSpace>
    name: from a lost file
    to_scene_reference: !<FileTransform> {src: lost.spi1d}
  - !<ColorSpace> {name: raw, isdata: true}
"""


@pytest.fixture(autouse=True)
def no_config_of_the_machine(monkeypatch):
    monkeypatch.delenv("OCIO", raising=False)


@pytest.fixture(scope="module")
def config() -> ColorConfig:
    return ColorConfig(DEFAULT_CONFIG)


@pytest.fixture
def studio(tmp_path) -> Path:
    path = tmp_path / "studio.ocio"
    path.write_text(CONFIG)
    return path


def image_of(pixels, names: str | tuple[str, ...] = "RGB", space: str = "", source: str = "photo.exr") -> Image:
    """(h, w, c) pixels with channels of these names; 'A' is alpha."""
    pixels = np.asarray(pixels)
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, oiio.TypeDesc(KINDS[pixels.dtype.char]))
    spec.channelnames = tuple(names)
    spec.alpha_channel = names.index("A") if "A" in names else -1
    if space:
        spec.attribute(TAG, space)
    return Image((from_pixels("part0", pixels, spec),), source)


def lab(pixels, config: ColorConfig, names: str | tuple[str, ...] = "RGB", space: str = LINEAR) -> np.ndarray:
    return working_values(image_of(pixels, names, space), config).values


def xyz(linear: np.ndarray) -> np.ndarray:
    """Linear sRGB -> XYZ by the matrix that follows from the primaries, not the standard's one of four digits."""
    space = colour.models.RGB_COLOURSPACE_sRGB.copy()
    space.use_derived_transformation_matrices(True)
    return linear.astype(np.float64) @ space.matrix_RGB_to_XYZ.T


def assert_is_lab_of(values: np.ndarray, linear: np.ndarray) -> None:
    """`values` are what colour-science says of `linear`, as closely as float32 and the two whites in use allow.

    L* = 116 f(Y) - 16, and a*, b* are 500 and 200 times a difference of two f. Computed in float32 through four steps,
    each f is right to a few parts in 10^7: 1e-4 in L* and 5e-4 in a*, b* per unit of f. White D65 is xy = (0.3127,
    0.3290) in sRGB and colour-science, and XYZ = (0.95047, 1, 1.08883) in CIE 15; they differ by 2.1e-4 in Z, so that
    b* may differ by 200 / 3 * 2.1e-4 = 0.014 per unit of f. That is one seventieth of a just noticeable difference.
    """
    expected = colour.XYZ_to_Lab(xyz(linear), D65)
    f = np.maximum(1, np.cbrt(np.abs(xyz(linear))).max(axis=-1))
    error = np.abs(values - expected)
    assert (error[..., 0] <= 1e-4 * f).all(), (error[..., 0] / f).max()
    assert (error[..., 1:] <= 0.0145 * f[..., None]).all(), (error[..., 1:] / f[..., None]).max()


# --- Lab ---


def test_lab_of_linear_colour_is_that_of_colour_science_from_small_negatives_to_64(config):
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
    linear = colour.models.eotf_sRGB(codes / 255)
    error = np.abs(lab(codes, config, space=SRGB) - colour.XYZ_to_Lab(xyz(linear), D65))
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


def test_colour_is_rgb_by_name_and_other_channels_are_left_aside(config):
    pixels = np.random.default_rng(7).random((9, 7, 6)).astype(np.float32)
    expected = lab(pixels[..., [4, 2, 1]], config)
    np.testing.assert_array_equal(lab(pixels, config, ("Z", "B", "G", "mask", "R", "id")), expected)
    np.testing.assert_array_equal(lab(pixels[..., :4], config, ("x", "y", "z", "w")), lab(pixels[..., :3], config))


def test_every_band_of_a_large_image_is_converted(config):
    row = np.random.default_rng(8).random((1, 400, 3)).astype(np.float32)
    pixels = row.repeat(1800, 0)  # 8.6 MB
    image = image_of(pixels, space=LINEAR)
    assert len(list(image.first.bands())) > 1
    np.testing.assert_array_equal(working_values(image, config).values, lab(row, config).repeat(1800, 0))


def test_the_pixels_themselves_stay_as_they_are(config):
    pixels = np.random.default_rng(9).random((9, 7, 4)).astype(np.float32)
    before = pixels.copy()
    lab(pixels, config, "RGBA")
    np.testing.assert_array_equal(pixels, before)


# --- alpha ---


@pytest.mark.parametrize("names", ["RGBA", "ARGB", "BGRA"])
def test_lab_is_taken_of_unpremultiplied_colour(config, names):
    random = np.random.default_rng(10)
    colours = random.random((9, 7, 3)).astype(np.float32)
    alpha = random.choice([0.25, 0.5, 1, 2], (9, 7)).astype(np.float32)  # powers of two: exact
    planes = {name: colours[..., i] * alpha for i, name in enumerate("RGB")} | {"A": alpha}
    pixels = np.stack([planes[name] for name in names], -1)
    working = working_values(image_of(pixels, names, LINEAR), config)
    np.testing.assert_array_equal(working.values, lab(colours, config))
    assert working.opaque is None


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
    working = working_values(image_of(pixels, "RGBA", LINEAR), config)
    assert working.opaque.dtype == bool
    assert np.argwhere(~working.opaque).tolist() == [[2, 3], [8, 6]]
    assert np.isfinite(working.values).all()
    for data in (working_values(image_of(pixels, "RGBA"), None),):
        assert np.argwhere(~data.opaque).tolist() == [[2, 3], [8, 6]]


def test_an_image_without_transparent_pixels_has_no_mask(config):
    assert working_values(image_of(np.ones((3, 3, 4), np.float32), "RGBA", LINEAR), config).opaque is None
    assert working_values(image_of(np.ones((3, 3, 3), np.float32), "RGB", LINEAR), config).opaque is None


def test_an_alpha_next_to_nothing_leaves_finite_values(config):
    pixels = np.float32([[[0.5, 0.5, 0.5, 1e-40]]])
    assert np.isfinite(working_values(image_of(pixels, "RGBA", LINEAR), config).values).all()


# --- NaN and Inf ---


@pytest.mark.parametrize("as_data", [False, True], ids=["colour", "data"])
def test_nan_and_inf_are_counted_over_the_whole_image_in_the_refusal(config, as_data):
    pixels = np.zeros((1800, 400, 4), np.float32)  # two bands
    pixels[0, 0, 0] = pixels[0, 0, 1] = pixels[1799, 399, 3] = np.nan
    pixels[5, 5, 2] = np.inf
    pixels[1799, 0, 0] = -np.inf
    image = image_of(pixels, "RGBA", LINEAR)
    assert len(list(image.first.bands())) > 1
    with pytest.raises(ImageError) as caught:
        working_values(image, None if as_data else config)
    assert str(caught.value) == "photo.exr has 3 NaN and 2 Inf values: add --fixnan box3 after it"


# --- which space ---


def test_an_untagged_image_is_refused_with_what_to_add(config):
    with pytest.raises(ColorError) as caught:
        working_values(image_of(np.zeros((2, 2, 3), np.float32)), config)
    text = str(caught.value)
    assert text.startswith("photo.exr does not say its colour space")
    assert "--iscolorspace NAME" in text
    assert ":data=1" in text
    assert f"'{TAG}'" in text
    assert "\n" not in text


@pytest.mark.parametrize("name", ["banana", "", "lin_rec709_scenes"])
def test_an_unknown_space_is_refused_with_the_configs_name(config, name):
    with pytest.raises(ColorError) as caught:
        config.resolve(name)
    assert str(caught.value) == f"colour space '{name}' is not in {DEFAULT_CONFIG}"
    if name:
        with pytest.raises(ColorError, match=name):
            working_values(image_of(np.zeros((2, 2, 3), np.float32), space=name), config)


@pytest.mark.parametrize(
    ("name", "own"),
    [
        ("srgb_rec709_scene", "sRGB Encoded Rec.709 (sRGB)"),
        ("lin_rec709_scene", "Linear Rec.709 (sRGB)"),
        ("lin_ap1_scene", "ACEScg"),
        ("ACEScg", "ACEScg"),
        ("scene_linear", "ACEScg"),  # a role
        ("sRGB", "sRGB Encoded Rec.709 (sRGB)"),  # OpenImageIO's old name
        ("Linear", "Linear Rec.709 (sRGB)"),
        ("data", "Raw"),
    ],
)
def test_tags_roles_and_aliases_are_resolved_to_the_configs_own_names(config, name, own):
    assert config.resolve(name) == own
    assert space_of(image_of(np.zeros((2, 2, 3), np.float32), space=name), config) == own


def test_a_tag_of_openimageio_on_a_file_is_understood(config, tmp_path):
    spec = oiio.ImageSpec(4, 3, 3, oiio.UINT8)
    spec.attribute(TAG, SRGB)
    out = oiio.ImageOutput.create(str(tmp_path / "a.png"))
    assert out.open(str(tmp_path / "a.png"), spec)
    assert out.write_image(np.zeros((3, 4, 3), np.uint8))
    out.close()
    assert space_of(read(tmp_path / "a.png"), config) == "sRGB Encoded Rec.709 (sRGB)"


def test_what_the_user_says_of_a_space_is_what_counts(config):
    image = tagged(image_of(np.full((1, 1, 3), 0.5, np.float32), space=SRGB), TAG, config.resolve("ACEScg"))
    assert space_of(image, config) == "ACEScg"


# --- data ---


def scaled(pixels: np.ndarray) -> np.ndarray:
    return (pixels - pixels.min()) / (pixels.max() - pixels.min()) * 100


def test_data_is_put_on_the_scale_of_lab_by_its_common_range():
    pixels = np.random.default_rng(11).uniform(-3, 5, (9, 7, 3)).astype(np.float32)
    working = working_values(image_of(pixels, ("x", "y", "z")), None)
    np.testing.assert_allclose(working.values, scaled(pixels), atol=1e-4)
    assert working.opaque is None


def test_a_space_of_data_skips_lab(config):
    pixels = np.random.default_rng(12).uniform(-1, 1, (9, 7, 3)).astype(np.float32)
    for space in ("Raw", "data"):
        assert config.is_data(space)
        np.testing.assert_allclose(lab(pixels, config, space=space), scaled(pixels), atol=1e-4)
    assert not config.is_data(LINEAR)


def test_data_needs_neither_tag_nor_config():
    tag_of_nowhere = image_of(np.eye(3, dtype=np.float32)[..., None].repeat(3, 2), space="no such space")
    assert isinstance(working_values(tag_of_nowhere, None), Working)


def test_gray_data_is_three_times_the_same():
    gray = np.random.default_rng(13).random((9, 7, 1)).astype(np.float32)
    np.testing.assert_allclose(working_values(image_of(gray, "Y"), None).values, scaled(gray).repeat(3, 2), atol=1e-4)


def test_two_channels_of_data_have_their_own_range():
    pixels = np.random.default_rng(14).uniform(5, 10, (9, 7, 2)).astype(np.float32)
    values = working_values(image_of(pixels, "UV"), None).values
    np.testing.assert_allclose(values[..., :2], scaled(pixels), atol=1e-4)
    assert np.ptp(values[..., 2]) == 0  # what is not there tells nothing apart


def test_constant_data_is_finite():
    values = working_values(image_of(np.full((3, 3, 3), 7, np.float32)), None).values
    assert np.isfinite(values).all()
    assert np.ptp(values) == 0


def test_the_range_of_data_is_that_of_its_opaque_pixels():
    pixels = np.random.default_rng(15).uniform(0, 1, (4, 4, 4)).astype(np.float32)
    pixels[..., 3] = 1
    pixels[0, 0] = [1000, -1000, 0, 0]
    values = working_values(image_of(pixels, ("x", "y", "z", "A")), None).values
    inside = np.ones((4, 4), bool)
    inside[0, 0] = False
    np.testing.assert_allclose(values[inside], scaled(pixels[inside][:, :3]), atol=1e-4)


@pytest.mark.parametrize("names", ["UV", "UVA", "A"])
def test_two_or_no_channels_are_no_colour_but_may_be_data(config, names):
    image = image_of(np.ones((2, 2, len(names)), np.float32), names, LINEAR)
    count = len(names.replace("A", ""))
    with pytest.raises(ImageError) as caught:
        working_values(image, config)
    assert str(caught.value) == f"photo.exr has {count} channels beside alpha: no colour; add :data=1"
    assert working_values(image, None).values.shape == (2, 2, 3)
    tagged_as_data = image_of(np.ones((2, 2, len(names)), np.float32), names, "Raw")
    assert working_values(tagged_as_data, config).values.shape == (2, 2, 3)


# --- configs ---


def test_the_config_is_the_given_one_else_the_environments_else_the_built_in(studio, tmp_path, monkeypatch):
    other = tmp_path / "other.ocio"
    other.write_text(CONFIG)
    assert ColorConfig().path == DEFAULT_CONFIG
    monkeypatch.setenv("OCIO", str(other))
    assert ColorConfig().path == str(other)
    assert ColorConfig(str(studio)).path == str(studio)
    assert ColorConfig().resolve("nickname") == "plain"
    monkeypatch.setenv("OCIO", "")
    assert ColorConfig().path == DEFAULT_CONFIG


def test_a_users_config_meets_lab_at_its_own_reference(studio, config):
    own = ColorConfig(str(studio))
    pixels = np.random.default_rng(16).random((9, 7, 3)).astype(np.float32)
    expected = lab(pixels, config, space="ACES2065-1")
    np.testing.assert_allclose(lab(pixels, own, space="plain"), expected, atol=2e-3)
    np.testing.assert_allclose(lab(pixels / 2, own, space="half as bright"), expected, atol=2e-3)
    np.testing.assert_allclose(lab(pixels, own, space="nickname"), expected, atol=2e-3)


def test_a_users_config_has_its_own_spaces_alone(studio):
    with pytest.raises(ColorError, match=rf"^colour space 'ACEScg' is not in {studio}$"):
        ColorConfig(str(studio)).resolve("ACEScg")


@pytest.mark.parametrize(
    ("source", "space"), [("/shots/a_plain.exr", "plain"), ("a_half.tif", "half as bright"), ("a_nrm.png", "raw")]
)
def test_file_rules_name_the_space_where_autocc_asks_for_them(studio, source, space):
    own = ColorConfig(str(studio))
    pixels = np.random.default_rng(17).random((9, 7, 3)).astype(np.float32)
    untagged = image_of(pixels, source=source)
    assert own.resolve(space_of(untagged, own, autocc=True)) == space
    expected = working_values(image_of(pixels, space=space), own).values
    np.testing.assert_array_equal(working_values(untagged, own, autocc=True).values, expected)
    with pytest.raises(ColorError, match="does not say its colour space"):
        working_values(untagged, own)


def test_the_default_rule_is_a_guess_and_does_not_count(studio):
    own = ColorConfig(str(studio))
    assert own.space_by_file_rules("photo.exr") is None
    with pytest.raises(ColorError, match="--iscolorspace"):
        space_of(image_of(np.zeros((2, 2, 3), np.float32)), own, autocc=True)


def test_a_tag_comes_before_a_file_rule(studio):
    own = ColorConfig(str(studio))
    image = image_of(np.zeros((2, 2, 3), np.float32), space="plain", source="a_half.exr")
    assert space_of(image, own, autocc=True) == "plain"


@pytest.mark.parametrize(
    "text",
    ["nonsense", "", "ocio_profile_version: 2\ncolorspaces: 5\n", "ocio_profile_version: 99\n", None],
    ids=["no config", "empty", "broken", "of the future", "missing"],
)
def test_a_config_that_cannot_be_loaded_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / "broken.ocio"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ColorError) as caught:
        ColorConfig(str(path))
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_an_unknown_built_in_config_is_refused():
    with pytest.raises(ColorError, match=r"^ocio://nothing: "):
        ColorConfig("ocio://nothing")


def test_a_config_without_a_way_to_lab_is_refused_when_colour_is_asked_for(studio):
    studio.write_text(CONFIG.replace("  aces_interchange: ACES2065-1\n", ""))
    own = ColorConfig(str(studio))
    with pytest.raises(ColorError, match=r"^no way from 'plain' to CIE Lab: "):
        lab(np.zeros((2, 2, 3), np.float32), own, space="plain")


def test_a_space_that_lacks_its_file_is_refused(studio):
    own = ColorConfig(str(studio))
    with pytest.raises(ColorError, match=r"lost\.spi1d"):
        lab(np.zeros((2, 2, 3), np.float32), own, space="from a lost file")


def test_our_own_config_is_valid_and_holds_the_working_space():
    own = ocio.Config.CreateFromStream((resources.files("oiiotex.ocio") / "oiiotex.ocio").read_text())
    own.validate()
    assert (own.getMajorVersion(), own.getMinorVersion()) == (2, 0)
    assert own.getColorSpace("Lab") is not None
    assert own.hasRole("aces_interchange")
    assert own.hasRole("cie_xyz_d65_interchange")
    there = own.getProcessor("ACES2065-1", "Lab").getOptimizedCPUProcessor(ocio.OPTIMIZATION_LOSSLESS)
    back = own.getProcessor("Lab", "ACES2065-1").getOptimizedCPUProcessor(ocio.OPTIMIZATION_LOSSLESS)
    pixels = np.random.default_rng(18).uniform(-0.01, 8, (500, 3)).astype(np.float32)
    values = pixels.copy()
    there.applyRGB(values)
    assert np.abs(values - pixels).max() > 10
    back.applyRGB(values)
    np.testing.assert_allclose(values, pixels, rtol=1e-4, atol=1e-5)
