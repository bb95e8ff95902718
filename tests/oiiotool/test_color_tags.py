# SPDX-License-Identifier: Apache-2.0
"""After a conversion every color attribute of a file is true, or gone."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.color.config import DEFAULT_CONFIG
from oiiotex.engine.io.description import is_tagged
from oiiotex.oiiotool.cli.running.line_run import run

CONFIGS = (DEFAULT_CONFIG, "ocio://studio-config-v2.1.0_aces-v1.3_ocio-v2.3")
CONVERSIONS = {  # the line, and the space of its result
    "--tocolorspace ACES2065-1": "ACES2065-1",
    "--tocolorspace sRGB": "sRGB",
    "--colorconvert current ACEScct": "ACEScct",
    "--colorconvert ACEScg lin_rec709": "lin_rec709",
    "--ociolook:to=ACES2065-1 ''": "ACES2065-1",
    "--ociodisplay default default": "srgb_display",
    "--ociodisplay:inverse=1:from=ACES2065-1 default default": "ACES2065-1",
    "--iscolorspace lin_rec709": "lin_rec709",
    "--tocolorspace ACES2065-1 --flip --resize 50%": "ACES2065-1",
}
ICC = np.frombuffer(bytes(range(200)), np.uint8)


@pytest.fixture
def tagged(tmp_path: Path) -> Path:
    """An ACEScg image that says so in every way that a file has, and names a wrong average."""
    spec = oiio.ImageSpec(16, 12, 3, oiio.HALF)
    spec.attribute("oiio:ColorSpace", "lin_ap1_scene")
    spec.attribute("colorInteropID", "lin_ap1_scene")
    primaries = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), primaries)
    spec.attribute("AverageColor", "0.1,0.2,0.3")
    spec.attribute("ICCProfile", oiio.TypeDesc("uint8[200]"), ICC)
    buffer = oiio.ImageBuf(spec)
    oiio.ImageBufAlgo.fill(buffer, (0.2, 0.5, 0.7))
    assert buffer.write(str(tmp_path / "in.exr"))
    return tmp_path


@pytest.mark.parametrize("config", CONFIGS)
@pytest.mark.parametrize("line", CONVERSIONS)
@pytest.mark.parametrize("end", ["exr", "png", "tif", "jpg"])
def test_a_file_says_its_space_or_nothing(tagged, config, line, end):
    type_name = "half" if end == "exr" else "uint8"
    assert (
        run(["--colorconfig", config, "in.exr", *shlex.split(line), "-d", type_name, "-o", f"out.{end}"], tagged) == 0
    )
    path = tagged / f"out.{end}"
    spec, names = oiio.ImageBuf(str(path)).spec(), oiio.ColorConfig(DEFAULT_CONFIG)
    space = {"srgb_display": "srgb_rec709_display"}.get(CONVERSIONS[line], CONVERSIONS[line])
    said = [spec.get_string_attribute(name) for name in ("oiio:ColorSpace", "colorInteropID")]
    formats = {"exr": "openexr", "tif": "tiff", "jpg": "jpeg"}
    if not is_tagged(spec, formats.get(end, end), str(path)):
        said[0] = ""  # OpenImageIO's assumption, not the file's word
    for name in filter(None, said):
        same_code_values = space == "srgb_rec709_display" and name == "srgb_rec709_scene"
        assert names.equivalent(name, space) or same_code_values, name
    for name in ("chromaticities", "AverageColor", "oiio:AverageColor", "oiio:ConstantColor", "ICCProfile", "CICP"):
        assert spec.getattribute(name) is None, name


def test_exr_stores_aces_without_a_warning(tagged, caplog):
    run(["in.exr", "--tocolorspace", "ACES2065-1", "-o", "ap0.exr"], tagged)
    assert not caplog.records
    assert oiio.ImageBuf(str(tagged / "ap0.exr")).spec().get_string_attribute("oiio:ColorSpace") == "lin_ap0_scene"


@pytest.mark.parametrize("space", ["ACEScg", "lin_rec709"])
def test_the_average_of_a_texture_is_that_of_its_pixels(tagged, space):
    words = ["in.exr", "--iscolorspace", "sRGB", "-otex:incolorspace=sRGB:outcolorspace=" + space]
    run([*words[:3], "-d", "float", words[3], "out.tx"], tagged)
    buffer = oiio.ImageBuf(str(tagged / "out.tx"))
    average = [float(v) for v in buffer.nativespec().get_string_attribute("oiio:AverageColor").split(",")]
    np.testing.assert_allclose(average, buffer.getpixel(3, 3), rtol=1e-4)
    assert not np.allclose(average, (0.2, 0.5, 0.7), atol=0.02)
    said = buffer.spec().get_string_attribute("oiio:ColorSpace")
    assert not said or oiio.ColorConfig(DEFAULT_CONFIG).equivalent(said, space)
    run(["out.tx", "-o", "again.exr"], tagged)
    again = oiio.ImageBuf(str(tagged / "again.exr")).spec().get_string_attribute("oiio:ColorSpace")
    assert oiio.ColorConfig(DEFAULT_CONFIG).equivalent(again, space)


def test_the_inverse_of_a_display_needs_no_tag(tmp_path):
    run(["--pattern", "constant:color=0.2,0.5,0.7", "8x8", "3", "-d", "float", "-o", "in.exr"], tmp_path)
    assert run(["in.exr", "--ociodisplay:inverse=1", "default", "default", "-o", "out.exr"], tmp_path) == 0
    assert oiio.ImageBuf(str(tmp_path / "out.exr")).spec().get_string_attribute("oiio:ColorSpace") == "lin_ap1_scene"
