# SPDX-License-Identifier: Apache-2.0
"""--texlab: the numbers of CIE Lab, and the way back."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from tests.any_filter import buffer, pixels
from tests.colored import science

RNG = np.random.default_rng(0)


def test_it_is_lab_as_the_cie_says():
    rgb = RNG.random((23, 31, 3))
    made = filters.lab(buffer(rgb, space="lin_rec709_scene"))
    colour = science()
    white = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
    xyz = colour.RGB_to_XYZ(rgb, "sRGB", apply_cctf_decoding=False)
    np.testing.assert_allclose(pixels(made), colour.XYZ_to_Lab(xyz, white), atol=0.02)


@pytest.mark.parametrize("space", ["lin_rec709_scene", "srgb_rec709_scene", "ACEScg", "ACEScct", "Linear P3-D65"])
@pytest.mark.parametrize("alpha", [False, True])
def test_there_and_back(space, alpha):
    """HDR, negatives and glows included: within 1e-5 of a pixel's brightest channel, more where a curve is steep."""
    scale, near = {"ACEScct": (1.0, 2e-3), "srgb_rec709_scene": (1.5, 3e-4)}.get(space, (60.0, 1e-5))
    rgb = RNG.random((40, 50, 3)) * scale - 0.1
    if alpha:
        a = np.round(RNG.random((40, 50, 1)), 1)  # some are 0
        rgb = np.concatenate([rgb * np.where(a, a, 1), a], -1)
    given = buffer(rgb, space=space, names=tuple("RGBA")[: rgb.shape[2]])
    lab = filters.lab(given)
    back = filters.lab(lab, inverse=True)
    brightest = np.abs(pixels(given)[..., :3]).max(-1, keepdims=True)
    away = np.abs(pixels(back) - pixels(given))
    assert (away / np.maximum(brightest, 1e-2)).max() < near
    if alpha:
        np.testing.assert_array_equal(pixels(back)[..., 3], pixels(given)[..., 3])
        np.testing.assert_array_equal(pixels(lab)[..., 3], pixels(given)[..., 3])
    assert back.spec().get_string_attribute("oiio:ColorSpace") == space
    assert back.spec().get_string_attribute("oiiotex:labFrom") == ""


@pytest.mark.parametrize("kind", [oiio.UINT8, oiio.UINT16, oiio.HALF], ids=str)
def test_values_of_a_type_come_back(kind):
    """Bytes to the bit; dark 16-bit ones of a steep curve may come back as their neighbor."""
    most = {oiio.UINT8: 255, oiio.UINT16: 4095, oiio.HALF: 4095}[kind]
    ramp = np.stack([np.arange(most + 1), np.arange(most, -1, -1), np.full(most + 1, most // 3)], -1) / most
    given = buffer(ramp[None], kind)
    back = filters.lab(filters.lab(given), inverse=True)
    away = np.abs(back.get_pixels(kind).astype(float) - given.get_pixels(kind).astype(float))
    assert away.max() <= {oiio.UINT8: 0, oiio.UINT16: 1, oiio.HALF: 2e-5}[kind]


def test_channels_keep_names_order_and_what_is_no_color():
    many = RNG.random((20, 30, 6))
    many[3, 4, 0] = np.inf  # a depth
    given = buffer(many, oiio.HALF, "lin_rec709_scene", ("Z", "B", "G", "R", "A", "id"))
    given.specmod().alpha_channel = 4
    made = filters.lab(given)
    assert (made.spec().channelnames, made.spec().format) == (given.spec().channelnames, oiio.FLOAT)
    source, found = pixels(given).astype(np.float32), pixels(made)
    np.testing.assert_array_equal(found[..., [0, 4, 5]], source[..., [0, 4, 5]])
    plain = pixels(filters.lab(buffer(source[..., [3, 2, 1]] / source[..., 4:5], space="lin_rec709_scene")))
    np.testing.assert_allclose(found[..., [3, 2, 1]], plain, atol=1e-4)


@pytest.mark.parametrize("names", [("Y",), ("Y", "A"), ("Z", "Y", "A")])
def test_gray_becomes_three_channels(names):
    gray = RNG.random((20, 30, len(names)))
    made = filters.lab(buffer(gray, space="srgb_rec709_scene", names=names))
    wanted = [n for name in names for n in (("R", "G", "B") if name == "Y" else (name,))]
    assert list(made.spec().channelnames) == wanted
    assert made.spec().alpha_channel == (wanted.index("A") if "A" in wanted else -1)
    assert np.abs(pixels(made)[..., [wanted.index("G"), wanted.index("B")]]).max() < 0.01
    back = pixels(filters.lab(made, inverse=True))
    for channel in "RGB":
        np.testing.assert_allclose(back[..., wanted.index(channel)], gray[..., names.index("Y")], atol=1e-4)


def test_lab_is_tagged_so_that_nobody_takes_it_for_rgb(tmp_path):
    made = filters.lab(buffer(RNG.random((20, 30, 3))))
    assert made.write(str(tmp_path / "lab.exr"), "float")
    again = oiio.ImageBuf(str(tmp_path / "lab.exr"))
    assert again.spec().get_string_attribute("oiio:ColorSpace") == "data"
    back = filters.lab(again, inverse=True)
    assert back.spec().get_string_attribute("oiio:ColorSpace") == "srgb_rec709_scene"


def test_what_makes_no_sense_is_refused():
    photo = buffer(RNG.random((20, 30, 3)))
    lab = filters.lab(photo)
    with pytest.raises(errors.ColorError, match=r"is already in Lab.*inverse=True"):
        filters.lab(lab)
    with pytest.raises(errors.ColorError, match="expected Lab"):
        filters.lab(photo, inverse=True)
    with pytest.raises(errors.ColorError, match="expected its name in the attribute oiiotex:labFrom"):
        filters.lab(buffer(RNG.random((4, 4, 3)), space=""), inverse=True)
    for space, said in (("nonsense", "nonsense"), ("Raw", "expected a color space, not data")):
        lab.specmod().attribute("oiiotex:labFrom", space)
        with pytest.raises(errors.ColorError, match=said):
            filters.lab(lab, inverse=True)
    gray = buffer(RNG.random((4, 4, 1)), space="data")
    gray.specmod().attribute("oiiotex:labFrom", "ACEScg")
    with pytest.raises(errors.ImageError, match="expected the 3 of Lab"):
        filters.lab(gray, inverse=True)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (300, 2)])
def test_tiny_images(size):
    given = buffer(RNG.random((*size, 3)))
    np.testing.assert_allclose(pixels(filters.lab(filters.lab(given), inverse=True)), pixels(given), atol=1e-4)
