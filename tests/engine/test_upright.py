# SPDX-License-Identifier: Apache-2.0
"""Images are read as their Orientation says: the oracle is OpenImageIO's reorient, and oiiotool's of chains."""

import shlex
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.core import upright as module
from oiiotex.engine.io.reading import read
from oiiotex.oiiotool.cli.running.line_run import run
from tests.peer import same

ORIENTATIONS = range(1, 9)
KINDS = {
    "scanline": ("a.jpg", {}),
    "tiled": ("a.tif", {"tile_width": 32, "tile_height": 16}),
    "windows": ("a.exr", {"x": 5, "y": 3, "full_x": 2, "full_y": -4, "full_width": 90, "full_height": 70}),
}


def stored(path: Path, orientation: int, **windows: int) -> oiio.ImageBuf:
    """A file of 61 x 40 random pixels, read back by OpenImageIO."""
    spec = oiio.ImageSpec(61, 40, 3, oiio.UINT8 if path.suffix != ".exr" else oiio.FLOAT)
    for name, value in windows.items():
        setattr(spec, name, value)
    spec.attribute("Orientation", orientation)
    buffer = oiio.ImageBuf(spec)
    random = np.random.default_rng(orientation)
    buffer.set_pixels(buffer.roi, random.random((40, 61, 3)).astype(np.float32) * 0.8 + 0.1)
    assert buffer.write(str(path)), buffer.geterror()
    return oiio.ImageBuf(str(path))


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_is_read_upright_through_any_window(tmp_path, monkeypatch, kind, orientation):
    monkeypatch.setattr(module, "_IN_MEMORY", 1 << 10)  # through a temporary file
    name, windows = KINDS[kind]
    source = stored(tmp_path / name, orientation, **windows)
    part, expected = read(tmp_path / name).first, source.get_pixels(source.spec().format)
    if orientation > 4:
        expected = expected.swapaxes(0, 1)
    expected = expected[:: -1 if orientation in (3, 4, 7, 8) else 1, :: -1 if orientation in (2, 3, 6, 7) else 1]
    np.testing.assert_array_equal(part.pixels(), expected)
    assert part.spec.get_int_attribute("Orientation", 1) == 1
    corner = part.window._replace(left=part.window.right - 7, top=part.window.bottom - 9)
    np.testing.assert_array_equal(part.read(corner), expected[-9:, -7:])


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_pixels_and_display_size_are_those_of_reorient(tmp_path, orientation):
    source = stored(tmp_path / "a.tif", orientation)
    expected, part = oiio.ImageBufAlgo.reorient(source), read(tmp_path / "a.tif").first
    np.testing.assert_array_equal(part.pixels(), expected.get_pixels(oiio.UINT8))
    spec = expected.spec()
    assert (part.spec.full_width, part.spec.full_height) == (spec.full_width, spec.full_height)


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_a_filter_sees_and_returns_an_upright_photo(tmp_path, orientation):
    buffer = stored(tmp_path / "a.tif", orientation)
    expected = filters.flatten(oiio.ImageBufAlgo.reorient(buffer), colorspace="sRGB")
    for given in (buffer, str(tmp_path / "a.tif")):
        made = filters.flatten(given, colorspace="sRGB")
        np.testing.assert_array_equal(np.asarray(made), np.asarray(expected))
        assert made.spec().get_int_attribute("Orientation", 1) == 1


def test_a_pil_image_is_turned_as_its_exif_says(tmp_path):
    from PIL import Image

    stored(tmp_path / "a.png", 6)
    picture = Image.open(tmp_path / "a.png")
    assert picture.size == (61, 40)
    assert np.asarray(filters.flatten(picture, data=True)).shape == (61, 40, 3)


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_maps_of_a_material_and_masks_agree(tmp_path, orientation):
    """A photo as stored and its upright twin give the same tile with upright maps and masks."""
    turned = stored(tmp_path / "turned.tif", orientation)
    oiio.ImageBufAlgo.reorient(turned).write(str(tmp_path / "upright.tif"))
    height, width = read(tmp_path / "upright.tif").first.pixels().shape[:2]
    mask = np.zeros((height, width, 1), np.float32)
    mask[: height // 2] = 1
    for name, pixels in (("mask", mask), ("normal", np.random.default_rng(1).random((height, width, 3), np.float32))):
        buffer = oiio.ImageBuf(oiio.ImageSpec(width, height, pixels.shape[2], oiio.FLOAT))
        buffer.set_pixels(buffer.roi, pixels)
        buffer.write(str(tmp_path / f"{name}.exr"))
    line = (
        "--noprogress {0}.tif --iscolorspace sRGB normal.exr --iscolorspace data"
        " --texstationarize:kinds=color,normal:size=32x32:mask=mask.exr -o {0}_n.exr --pop -o {0}_c.exr"
    )
    for name in ("turned", "upright"):
        assert run(shlex.split(line.format(name)), tmp_path) == 0
    for which in "cn":
        one, other = (oiio.ImageBuf(str(tmp_path / f"{name}_{which}.exr")) for name in ("turned", "upright"))
        np.testing.assert_array_equal(one.get_pixels(oiio.FLOAT), other.get_pixels(oiio.FLOAT))
        assert one.spec().get_int_attribute("Orientation", 1) == 1


@pytest.mark.parametrize("line", ["a.tif --resize 30x20", "a.tif --flip", "--autoorient a.tif", "a.tif --reorient"])
def test_ops_of_oiiotool_leave_orientation_to_the_user(tmp_path, line):
    stored(tmp_path / "a.tif", 6)
    same(tmp_path, *line.split(), "-o", "OUT.tif")
