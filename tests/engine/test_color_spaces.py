# SPDX-License-Identifier: Apache-2.0
"""Color is taken from where the user said it, and never guessed; configs are the user's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import PyOpenColorIO as ocio
import pytest

from oiiotex.engine.color.config import DEFAULT_CONFIG, TAG, ColorConfig, space_of
from oiiotex.engine.core.image import tagged
from oiiotex.engine.errors import ColorError
from oiiotex.engine.io.reading import read
from oiiotex.engine.shipped import shipped
from tests.colored import SRGB, image_of, lab, seen

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


# --- which space ---


def test_an_untagged_image_is_refused_with_what_to_add(config):
    with pytest.raises(ColorError) as caught:
        seen(image_of(np.zeros((2, 2, 3), np.float32)), config)
    text = str(caught.value)
    assert text.startswith("photo.exr has no color space tag")
    assert "--iscolorspace NAME" in text
    assert "--iscolorspace data" in text and "data=1" not in text  # not all ops have that
    assert f"'{TAG}'" in text
    assert "\n" not in text


@pytest.mark.parametrize("name", ["banana", "", "lin_rec709_scenes"])
def test_an_unknown_space_is_refused_with_the_configs_name(config, name):
    with pytest.raises(ColorError) as caught:
        config.resolve(name)
    assert str(caught.value).startswith(f"color space '{name}' is not in {DEFAULT_CONFIG}")
    if name:
        with pytest.raises(ColorError, match=name):
            seen(image_of(np.zeros((2, 2, 3), np.float32), space=name), config)


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
    said = rf"^color space 'ACEScg' is not in {studio}; oiiotex --colorconfiginfo lists them$"
    with pytest.raises(ColorError, match=said):
        ColorConfig(str(studio)).resolve("ACEScg")


@pytest.mark.parametrize(
    ("source", "space"), [("/shots/a_plain.exr", "plain"), ("a_half.tif", "half as bright"), ("a_nrm.png", "raw")]
)
def test_file_rules_name_the_space_where_autocc_asks_for_them(studio, source, space):
    own = ColorConfig(str(studio))
    pixels = np.random.default_rng(17).random((9, 7, 3)).astype(np.float32)
    untagged = image_of(pixels, source=source)
    assert own.resolve(space_of(untagged, own, autocc=True)) == space
    expected = seen(image_of(pixels, space=space), own)[0]
    np.testing.assert_array_equal(seen(untagged, own, autocc=True)[0], expected)
    with pytest.raises(ColorError, match="has no color space tag"):
        seen(untagged, own)


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


def test_a_config_without_a_way_to_lab_is_refused_when_color_is_asked_for(studio):
    studio.write_text(CONFIG.replace("  aces_interchange: ACES2065-1\n", ""))
    own = ColorConfig(str(studio))
    with pytest.raises(ColorError, match=r"^cannot convert from 'plain' to CIE Lab: "):
        lab(np.zeros((2, 2, 3), np.float32), own, space="plain")


def test_a_space_that_lacks_its_file_is_refused(studio):
    own = ColorConfig(str(studio))
    with pytest.raises(ColorError, match=r"lost\.spi1d"):
        lab(np.zeros((2, 2, 3), np.float32), own, space="from a lost file")


def test_our_own_config_is_valid_and_holds_the_working_space():
    own = ocio.Config.CreateFromStream((shipped("ocio", "ocio") / "oiiotex.ocio").read_text())
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
