# SPDX-License-Identifier: Apache-2.0
"""Indexed images through the plugin of hosts/openimageio: every map is a subimage with the bits of an EXR file."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from oiiotex.engine.io.reading import read
from tests.conftest import load
from tests.engine.test_copies import RESULT, material, spoiled, with_index, written
from tests.hosts.test_openimageio_plugin import BIN, Shell, folder, plugin, python, shell  # noqa: F401


@pytest.fixture
def tile(folder: Path) -> Path:  # noqa: F811
    """An indexed image, and an EXR file of the same result."""
    written(material(), folder / "tile.exr")
    return written(material(), folder / "tile.oiiotex")


def test_oiiotool_reads_every_map(shell, tile):  # noqa: F811
    told = shell(BIN / "oiiotool", "-a", "--info", "tile.oiiotex").stdout
    assert "530 x  290, 3 channel, half oiiotexfile (3 subimages)" in told and "4 channel" in told
    made = shell(BIN / "oiiotool", "-a", "tile.oiiotex", "-o", "back.exr")
    assert made.returncode == 0, made.stdout + made.stderr
    for number in range(3):
        back, plain = (load(tile.with_name(name), number) for name in ("back.exr", "tile.exr"))
        np.testing.assert_array_equal(back, plain)


def test_a_cache_reads_windows_of_every_map_and_makes_their_levels(python, tile):  # noqa: F811
    python("""
        cache = oiio.ImageCache()
        kind, whole = oiio.TypeDesc("half"), {}
        for number in range(3):
            plain = oiio.ImageBuf("tile.exr", number, 0).get_pixels(oiio.HALF)
            for left, top, right, bottom in ((250, 100, 260, 290), (0, 0, 1, 1), (500, 256, 530, 290)):
                found = cache.get_pixels("tile.oiiotex", number, 0, left, right, top, bottom, 0, 1, kind)
                np.testing.assert_array_equal(found, plain[top:bottom, left:right], cache.geterror())
        textures = oiio.TextureSystem()
        textures.attribute("automip", 1)
        textures.attribute("forcefloat", 1)
        options = oiio.TextureOpt()
        options.subimage = 1
        for width in (0, 1 / 64, 1 / 8):
            asked = options, 0.4, 0.7, width, 0, 0, width, 1
            ours, theirs = (textures.texture(name, *asked) for name in ("tile.oiiotex", "tile.exr"))
            assert ours == theirs, (width, ours, theirs, textures.geterror())
    """)


def test_the_program_needs_no_process_to_read_it(shell, tile):  # noqa: F811
    line = sys.executable, "-m", "oiiotex", "tile.oiiotex", "-o", "own.exr"
    done = shell(*line, OIIOTEX_PYTHON="/bin/false")
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(load(tile.with_name("own.exr"), 2), load(tile.with_name("tile.exr"), 2))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("damaged.oiiotex", "the index is damaged"),
        ("cut.oiiotex", "cut.oiiotex"),
        ("tile.oiiotex?seed=7", "an indexed image has no settings: expected no query"),
    ],
)
def test_what_is_wrong_is_one_line(shell, tile, tmp_path, name, text):  # noqa: F811
    shutil.copy(spoiled(tmp_path, with_index((4000, 0))), tile.with_name("damaged.oiiotex"))
    tile.with_name("cut.oiiotex").write_bytes(tile.read_bytes()[:3000])
    done = shell(BIN / "oiiotool", name, "-o", "bad.exr")
    said = [line for line in (done.stdout + done.stderr).splitlines() if "oiiotex ERROR: " in line]
    assert done.returncode != 0 and len(said) == 1 and text in said[0], done.stdout + done.stderr


def test_a_file_that_is_changed_while_it_is_open_is_refused(python, tile):  # noqa: F811
    said = python("""
        import os
        image = oiio.ImageInput.open("tile.oiiotex")
        os.utime("tile.oiiotex", ns=(1, 1))
        assert image.read_tile(0, 0, 0, oiio.HALF) is None
        print(image.geterror())
    """)
    assert "changed" in said and said.count("\n") == 1
    assert read(tile).first.window.size == RESULT
