# SPDX-License-Identifier: Apache-2.0
"""Studios' configs: OCIO v1, v2 file rules, context variables, the default by its versioned name."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.color.config import DEFAULT_CONFIG, ColorConfig
from oiiotex.engine.errors import ColorError
from tests.colored import science
from tests.conftest import load, oiiotex, save

LEGACY = """\
ocio_profile_version: 1
search_path: luts
strictparsing: true
luma: [0.2126, 0.7152, 0.0722]
roles: {default: raw, scene_linear: lin, reference: lin}
displays:
  sRGB:
    - !<View> {name: Film, colorspace: gamma22}
active_displays: [sRGB]
active_views: [Film]
colorspaces:
  - !<ColorSpace> {name: lin, bitdepth: 32f, isdata: false, allocation: uniform}
  - !<ColorSpace> {name: raw, bitdepth: 32f, isdata: true, allocation: uniform}
  - !<ColorSpace>
    name: gamma22
    bitdepth: 8ui
    isdata: false
    from_reference: !<ExponentTransform> {value: [2.2, 2.2, 2.2, 1], direction: inverse}
"""

MODERN = """\
ocio_profile_version: 2
environment: {SHOT: dim}
search_path: luts
strictparsing: true
roles: {default: raw, scene_linear: lin, aces_interchange: aces, cie_xyz_d65_interchange: xyz}
file_rules:
  - !<Rule> {name: plates, pattern: "*plate*", extension: "*", colorspace: graded}
  - !<Rule> {name: ColorSpaceNamePathSearch}
  - !<Rule> {name: Default, colorspace: default}
displays:
  none:
    - !<View> {name: raw, colorspace: raw}
view_transforms:
  - !<ViewTransform>
    name: plain
    from_scene_reference: !<BuiltinTransform> {style: UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD}
display_colorspaces:
  - !<ColorSpace> {name: xyz}
colorspaces:
  - !<ColorSpace> {name: aces}
  - !<ColorSpace> {name: raw, isdata: true}
  - !<ColorSpace>
    name: lin
    from_scene_reference: !<MatrixTransform> {matrix: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
  - !<ColorSpace>
    name: graded
    to_scene_reference: !<FileTransform> {src: $SHOT.spi1d}
"""


def ramp(top: float) -> str:
    return f"Version 1\nFrom 0.0 1.0\nLength 2\nComponents 1\n{{\n0.0\n{top}\n}}\n"


@pytest.fixture
def legacy(tmp_path: Path) -> Path:
    path = tmp_path / "legacy.ocio"
    path.write_text(LEGACY)
    return path


@pytest.fixture
def modern(tmp_path: Path) -> Path:
    (tmp_path / "luts").mkdir()
    (tmp_path / "luts" / "dim.spi1d").write_text(ramp(0.5))
    (tmp_path / "luts" / "bright.spi1d").write_text(ramp(2.0))
    path = tmp_path / "modern.ocio"
    path.write_text(MODERN)
    return path


def lab_of(config: ColorConfig, space: str, rgb: list[float]) -> np.ndarray:
    values = np.array([[rgb]], np.float32)
    config.to_lab(space)(values)
    return values[0, 0]


def test_a_legacy_config_meets_lab_at_the_space_that_the_option_names(legacy):
    found = lab_of(ColorConfig(str(legacy), ("lin", "lin_rec709")), "gamma22", [0.2, 0.7, 0.1])
    colour = science()
    white = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
    xyz = colour.RGB_to_XYZ(np.array([0.2, 0.7, 0.1]) ** 2.2, "sRGB", white)
    np.testing.assert_allclose(found, colour.XYZ_to_Lab(xyz, white), atol=0.01)


def test_a_legacy_config_without_the_option_is_refused_with_what_to_add(legacy):
    with pytest.raises(ColorError, match="--interchange SPACE lin_rec709"):
        lab_of(ColorConfig(str(legacy)), "gamma22", [0.2, 0.7, 0.1])


@pytest.mark.parametrize("pair", [("nothing", "lin_rec709"), ("lin", "nothing")])
def test_interchange_spaces_that_are_not_there_are_refused(legacy, pair):
    with pytest.raises(ColorError, match="nothing"):
        ColorConfig(str(legacy), pair)


def test_the_program_takes_a_legacy_config_from_the_environment(tmp_path, legacy, photo):
    environment = {**os.environ, "OCIO": str(legacy)}
    words = [photo, "--iscolorspace", "gamma22", "--texpatchmatch:iterations=2", "-o", "out.png"]
    line = oiiotex(*words, cwd=tmp_path, env=environment)
    assert line.returncode == 1 and "--interchange" in line.stderr
    done = oiiotex("--interchange", "lin", "lin_rec709", *words, cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr


def test_file_rules_name_the_space_where_autocc_asks_for_them(tmp_path, modern):
    save(np.full((8, 8, 3), 0.25), tmp_path / "my_plate.exr", "float")
    save(np.full((8, 8, 3), 0.25), tmp_path / "other.exr", "float")
    for name, factor in (("my_plate.exr", 0.5), ("other.exr", 1.0)):
        done = oiiotex("--colorconfig", modern, "--autocc", name, "--addc", "0", "-o", "out.exr", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        np.testing.assert_allclose(load(tmp_path / "out.exr"), 0.25 * factor, rtol=1e-6)


def test_context_variables_of_the_environment_choose_the_lut(modern, monkeypatch):
    dim = lab_of(ColorConfig(str(modern)), "graded", [0.4, 0.4, 0.4])
    monkeypatch.setenv("SHOT", "bright")
    bright = lab_of(ColorConfig(str(modern)), "graded", [0.4, 0.4, 0.4])
    xyz_ratio = ((bright[0] + 16) / (dim[0] + 16)) ** 3
    assert xyz_ratio == pytest.approx(4.0, rel=1e-3)


def test_context_variables_of_the_option_choose_the_lut(tmp_path, modern):
    save(np.full((8, 8, 3), 0.25), tmp_path / "a.exr", "float")
    words = ["--colorconfig", modern, "a.exr", "--colorconvert:key=SHOT:value=bright", "graded", "lin", "-o", "out.exr"]
    done = oiiotex(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(load(tmp_path / "out.exr"), 0.5, rtol=1e-6)


def test_the_default_config_is_pinned_by_its_version_and_both_libraries_read_it(monkeypatch):
    monkeypatch.delenv("OCIO", raising=False)
    config = ColorConfig()
    assert config.path == DEFAULT_CONFIG and "_ocio-v2.5" in DEFAULT_CONFIG
    assert "ACEScg" in oiio.ColorConfig(DEFAULT_CONFIG).getColorSpaceNames()
    np.testing.assert_allclose(lab_of(config, "lin_rec709_scene", [1.0, 1.0, 1.0]), [100, 0, 0], atol=2e-3)
