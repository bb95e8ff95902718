# SPDX-License-Identifier: Apache-2.0
"""A file's spec is checked where it is opened: channels, tiles and windows that contradict each other, no pixels."""

import shlex

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.image import channels_of
from oiiotex.engine.errors import Error, ImageError
from oiiotex.engine.io.reading import _checked, read
from oiiotex.oiiotool.cli.running.line_run import run
from tests.foreign_bytes import BY_SPECIFICATION


@pytest.fixture
def empty(tmp_path):
    """A FITS file whose first part has no pixels, as those of tables."""
    cards = [
        "SIMPLE  =                    T",
        "BITPIX  =                    8",
        "NAXIS   =                    0",
        "END",
    ]
    (tmp_path / "empty.fits").write_bytes("".join(card.ljust(80) for card in cards).ljust(2880).encode())
    return tmp_path


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("op", ["--texflatten", "--texsuperpixel", "--texlab", "--unpremult", "--ch R,G,B"])
def test_every_gif_is_an_image_like_others(tmp_path, channels, op):
    spec = oiio.ImageSpec(64, 48, channels, oiio.UINT8)
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, np.random.default_rng(1).random((48, 64, channels)).astype(np.float32))
    assert buffer.write(str(tmp_path / "a.gif")), buffer.geterror()
    first = read(tmp_path / "a.gif").first
    assert channels_of(first.spec).color == (0, 1, 2)
    assert channels_of(first.spec).alpha == (3 if first.spec.nchannels == 4 else None)
    assert run(shlex.split(f"--noprogress a.gif --iscolorspace sRGB {op} -o o.exr"), tmp_path) == 0


def test_fields_that_contradict_each_other_are_mended():
    spec = oiio.ImageSpec(8, 6, 4, oiio.UINT8)
    spec.channelnames = ("R", "G", "B", "A")
    spec.alpha_channel, spec.z_channel = 4, -7
    spec.tile_width = 16
    spec.full_width = spec.full_height = 0
    mended = _checked(spec, "a.gif")
    assert (mended.alpha_channel, mended.z_channel, mended.tile_width) == (3, -1, 0)
    assert (mended.full_width, mended.full_height) == (8, 6)
    spec.width = -3
    with pytest.raises(ImageError, match=r"a\.gif: the file is damaged: it says that the image has -3x6"):
        _checked(spec, "a.gif")


def test_a_consistent_spec_does_not_change():
    spec = oiio.ImageSpec(8, 6, 5, oiio.FLOAT)
    spec.channelnames = ("B", "G", "Z", "A", "R")
    spec.alpha_channel, spec.z_channel, spec.tile_width, spec.tile_height = 3, 2, 64, 32
    spec.full_x, spec.full_width = -3, 20
    before = spec.to_xml()
    assert _checked(spec, "a.exr").to_xml() == before


@pytest.mark.parametrize(
    "line",
    [
        "--stats empty.fits", "empty.fits --printstats", "empty.fits -o o.exr", "empty.fits --resize 8x8 -o o.exr",
        "empty.fits --iscolorspace sRGB --texflatten -o o.exr", "empty.fits --fit 8x8 -o o.exr",
        "empty.fits --trim -o o.exr", "empty.fits empty.fits --add -o o.exr", "empty.fits --rotate90 -o o.exr",
    ],
)  # fmt: skip
def test_a_file_without_pixels_is_refused_in_one_line(empty, line):
    with pytest.raises(Error, match="has no pixels") as error:
        run(shlex.split(line), empty)
    assert "\n" not in str(error.value)
    assert not (empty / "o.exr").exists()


@pytest.mark.parametrize("line", ["--info -v empty.fits", "empty.fits --printinfo", "--hash empty.fits"])
def test_information_about_a_file_without_pixels_is_printed(empty, line):
    assert run(shlex.split(line), empty) == 0


@pytest.mark.parametrize("order", ["big", "little"])
def test_user_data_that_a_cineon_file_does_not_hold_is_refused_before_it_is_allocated(tmp_path, order):
    BY_SPECIFICATION["rgb.cin"](tmp_path / "a.cin")
    data = bytearray((tmp_path / "a.cin").read_bytes())
    data[16:20] = (len(data) - 1024).to_bytes(4, "big")
    (tmp_path / "a.cin").write_bytes(data)
    assert read(tmp_path / "a.cin").first.pixels().any()
    data[:4] = data[:4] if order == "big" else data[3::-1]
    data[16:20] = (len(data) + 1).to_bytes(4, order)  # with 2 GB, the reader takes 6
    (tmp_path / "a.cin").write_bytes(data)
    with pytest.raises(ImageError, match=f"the file is damaged: it says that it has {len(data) + 1} bytes of user"):
        read(tmp_path / "a.cin")
