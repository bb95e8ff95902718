# SPDX-License-Identifier: Apache-2.0
"""Maps of normals that a file does not call so are warned of; names of spaces that a config has under another name."""

from __future__ import annotations

import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.color.config import DEFAULT_CONFIG, ColorConfig
from oiiotex.engine.color.normal_maps import looks_like_normals, named_as_normals
from oiiotex.engine.core.attributes import TAG
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.errors import ColorError, Error
from oiiotex.engine.io.reading import read
from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.any_filter import buffer
from tests.conftest import save
from tests.synthesis.test_materials import NORMAL

PHOTO = pictures.bricks(64, 80, 2)
ACES_1 = """\
ocio_profile_version: 1
strictparsing: true
roles: {default: Utility - Raw, scene_linear: ACES - ACEScg, reference: ACES - ACES2065-1}
displays: {none: [!<View> {name: Raw, colorspace: Utility - Raw}]}
colorspaces:
  - !<ColorSpace> {name: ACES - ACES2065-1}
  - !<ColorSpace> {name: ACES - ACEScg}
  - !<ColorSpace>
    name: Utility - sRGB - Texture
    to_reference: !<ExponentTransform> {value: [2.2, 2.2, 2.2, 1]}
  - !<ColorSpace> {name: Utility - Raw, isdata: true}
"""


@pytest.fixture(autouse=True)
def no_config_of_the_machine(monkeypatch):
    monkeypatch.delenv("OCIO", raising=False)


def untagged(pixels: np.ndarray, path) -> None:
    """A PNG without a word on its colors, as most programs write it."""
    save(pixels, path, space="data")
    assert read(path).first.spec[TAG] == "srgb_rec709_scene"  # which OpenImageIO assumes


# --- normals ---


@pytest.mark.parametrize(("name", "pixels", "said"), [
    ("stone.png", NORMAL, "stone.png looks like a normal map"),
    ("stone_nor_gl_1k.png", PHOTO, "stone_nor_gl_1k.png is named like a normal map"),
    ("stone.png", PHOTO, None), ("paranormal_n1.png", PHOTO, None),
])  # fmt: skip
def test_an_untagged_png_that_seems_to_hold_normals_is_warned_of_once(tmp_path, caplog, name, pixels, said):
    untagged(pixels, tmp_path / name)
    with caplog.at_level(logging.WARNING):
        assert run([name, "--texflatten", "--texquilt:size=40x32", "-o", "out.exr"], tmp_path) == 0
    assert len(caplog.messages) == (said is not None)
    if said:
        line = caplog.messages[0]
        assert line.startswith(said) and "has no color space tag" in line and "data=1" in line


def test_a_tag_that_every_tool_writes_says_little_where_name_and_look_are_one(tmp_path, caplog):
    save(NORMAL, tmp_path / "stone_nor.png", space="srgb_rec709_scene")
    with caplog.at_level(logging.WARNING):
        assert run(["stone_nor.png", "--texflatten", "-o", "out.exr"], tmp_path) == 0
    assert caplog.messages[0].startswith("stone_nor.png looks like a normal map, but is tagged sRGB")


@pytest.mark.parametrize("words", [
    ["n.png", "--texflatten:data=1"], ["n.png", "--iscolorspace", "sRGB", "--texflatten"],
    ["n.png", "--iscolorspace", "data", "--texflatten"], ["tagged.png", "--texflatten"],
    ["n.png", "--colorconvert", "sRGB", "ACEScg"], ["n.exr", "--texflatten"],
])  # fmt: skip
def test_who_says_what_a_map_holds_is_not_warned(tmp_path, caplog, words):
    untagged(NORMAL, tmp_path / "n.png")
    save(NORMAL, tmp_path / "tagged.png", space="srgb_rec709_scene")
    save(NORMAL, tmp_path / "n.exr", "half", "lin_rec709_scene")
    with caplog.at_level(logging.WARNING):
        assert run([*words, "-o", "out.exr"], tmp_path) == 0
    assert not caplog.messages


@pytest.mark.parametrize(("name", "normals"), [
    ("brick_n.png", True), ("T_Brick_N.tga", True), ("brickNormal.png", True), ("brick-normal-ogl.png", True),
    ("NRM/brick.png", False), ("brick_nrm2.png", True), ("n.png", False), ("minor.png", False), ("brick.png", False),
    ("normandy.png", False), ("brick_n_1k.png", True),
])  # fmt: skip
def test_names_of_normal_maps(name, normals):
    assert named_as_normals(name) == normals


def test_what_looks_like_normals():
    def look(pixels, kind=oiio.UINT8):
        return looks_like_normals(from_buffer(buffer(pixels, kind)).first)

    islands = NORMAL.copy()
    islands[:, 20:60] = 0
    assert look(NORMAL) and look(NORMAL, oiio.UINT16) and look(NORMAL, oiio.FLOAT) and look(islands)
    assert not look(PHOTO)
    assert not look(np.zeros((64, 80, 3)))
    assert not look(np.full((64, 80, 3), 0.5))
    assert not look(1 - NORMAL)
    sky = np.broadcast_to([0.45, 0.62, 0.9], (64, 80, 3)) + np.linspace(0, 0.1, 64)[:, None, None]
    assert not look(sky)


# --- names of spaces ---


@pytest.mark.parametrize(
    ("name", "near"), [("sRGBB", "sRGB"), ("acescgg", "ACEScg"), ("lin_rec709_scenes", "lin_rec709_scene")]
)
@pytest.mark.parametrize("option", ["--iscolorspace", "--tocolorspace"])
def test_an_unknown_space_is_refused_with_the_nearest_and_where_all_are_listed(tmp_path, option, name, near):
    save(PHOTO, tmp_path / "a.png")
    with pytest.raises(Error) as caught:
        run(["a.png", option, name, "-o", "o.exr"], tmp_path)
    assert f"color space '{name}' is not in {DEFAULT_CONFIG}, did you mean '{near}'?" in str(caught.value)
    assert "oiiotex --colorconfiginfo lists them" in str(caught.value)


def test_aces_older_names_are_understood_where_the_config_has_the_space(tmp_path):
    names = {
        "Utility - sRGB - Texture": "sRGB Encoded Rec.709 (sRGB)",
        "Utility - Raw": "Raw",
        "ACES - ACEScg": "ACEScg",
    }
    config = ColorConfig(DEFAULT_CONFIG)
    assert {name: config.resolve(name) for name in names} == names
    (tmp_path / "small.ocio").write_text(
        ACES_1.replace("Utility - sRGB - Texture", "srgb_texture").replace("ACES - ACEScg", "ACEScg")
    )
    small = ColorConfig(str(tmp_path / "small.ocio"))
    assert small.resolve("Utility - sRGB - Texture") == "srgb_texture"
    assert small.resolve("Input - Generic - sRGB - Texture") == "srgb_texture"
    assert small.resolve("ACES - ACEScg") == "ACEScg"
    for unknown in ("Utility - Linear - P3-D65", "color_timing"):  # a space and a role that it lacks
        with pytest.raises(ColorError, match="is not in"):
            small.resolve(unknown)


def test_what_files_say_is_understood_by_a_config_of_the_older_names(tmp_path):
    (tmp_path / "aces.ocio").write_text(ACES_1)
    config = ColorConfig(str(tmp_path / "aces.ocio"))
    assert config.resolve("srgb_rec709_scene") == "Utility - sRGB - Texture"
    assert config.resolve("lin_ap1_scene") == "ACES - ACEScg"
    assert config.resolve("data") == "Utility - Raw" and config.is_data("data")


def test_the_hosts_conversions_take_the_older_names_too(tmp_path):
    (tmp_path / "small.ocio").write_text(ACES_1.replace("Utility - sRGB - Texture", "srgb_texture"))
    save(PHOTO, tmp_path / "a.png")
    for space, name in (("srgb_texture", "own.exr"), ("Utility - sRGB - Texture", "older.exr")):
        words = ["--colorconfig", "small.ocio", "a.png", "--iscolorspace", space, "-d", "float"]
        assert run([*words, "--colorconvert", space, "ACES - ACEScg", "-o", name], tmp_path) == 0
        assert run([*words, "--tocolorspace", "ACEScg", "-o", f"to_{name}"], tmp_path) == 0
    own = read(tmp_path / "own.exr").first.pixels()
    assert not np.array_equal(own, read(tmp_path / "a.png").first.pixels())
    for name in ("older.exr", "to_own.exr", "to_older.exr"):
        np.testing.assert_array_equal(read(tmp_path / name).first.pixels(), own)
