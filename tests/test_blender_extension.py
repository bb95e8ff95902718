# SPDX-License-Identifier: Apache-2.0
"""The extension in Blender itself: its tile is the program's, in the image's colour space, with the line that makes it.

Wants bpy as test_cryptomatte_blender does. Blender hangs where it ends, so it is left by os._exit.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from tests import pictures
from tests.conftest import save
from tests.test_cryptomatte_blender import BLENDER

BUILD = Path(__file__).parents[1] / "hosts" / "blender" / "build.py"
SCRIPT = """
import os, sys
import numpy as np
folder, python = sys.argv[1:]
sys.path.insert(0, folder)
import bpy
import oiiotex_blender
oiiotex_blender.register()
oiiotex_blender.Process = lambda _, Process=oiiotex_blender.Process: Process(python)  # as preferences say it
image = bpy.data.images.load(folder + "/photo.png")
with bpy.context.temp_override(edit_image=image):
    print(bpy.ops.oiiotex.make_tile(width=48, height=32, seed=5))
tile = bpy.data.images["photo.png tile"]
pixels = np.empty(48 * 32 * 4, np.float32)
tile.pixels.foreach_get(pixels)
np.save(folder + "/tile.npy", pixels.reshape(32, 48, 4)[::-1])
print(tile.colorspace_settings.name, tile["oiiotex"], sep="|")
python = "/bin/false"
for space in ("sRGB", "Linear Rec.2020"):
    image.colorspace_settings.name = space
    with bpy.context.temp_override(edit_image=image):
        try:
            bpy.ops.oiiotex.make_tile()
        except RuntimeError as error:
            print(error)
sys.stdout.flush()
os._exit(0)
"""


@pytest.fixture
def folder(monkeypatch):
    with tempfile.TemporaryDirectory(prefix="oxb") as name:
        path = Path(name)
        (path / "run").mkdir(mode=0o700)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(path / "run"))
        save(pictures.stained(pictures.bricks(64, 80, seed=1)), path / "photo.png", space="srgb_rec709_scene")
        subprocess.run([sys.executable, BUILD, path / "extension.zip"], check=True)
        zipfile.ZipFile(path / "extension.zip").extractall(path / "oiiotex_blender")
        yield path


def test_what_it_says_to_the_process_needs_no_package_of_ours(folder):
    """In a Python without oiiotex the zip's own modules are enough."""
    line = "import sys; sys.path.insert(0, sys.argv[1]); import oiiotex_blender.process"
    (folder / "oiiotex_blender" / "__init__.py").write_text("")  # which wants bpy
    done = subprocess.run([sys.executable, "-I", "-S", "-c", line, folder], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(BLENDER is None, reason="no bpy: pip install bpy, or OIIOTEX_BLENDER=/path/to/python")
def test_a_tile_is_the_programs(folder):
    line = [BLENDER, "-c", SCRIPT, str(folder), sys.executable]
    done = subprocess.run(line, capture_output=True, text=True, timeout=200, env=dict(os.environ))
    assert done.returncode == 0, done.stdout + done.stderr
    photo = oiio.ImageBuf(str(folder / "photo.png")).get_pixels(oiio.FLOAT)
    photo = np.dstack([photo, np.ones(photo.shape[:2], np.float32)])  # Blender adds an alpha
    same = filters.stationarize(photo, size=(48, 32), seed=5, colorspace="srgb_rec709_scene").get_pixels(oiio.UINT8)
    found = np.load(folder / "tile.npy")
    np.testing.assert_array_equal(np.rint(found * 255).astype(np.uint8), same)
    said = done.stdout
    assert "{'FINISHED'}" in said
    assert "sRGB|oiiotex photo.png --iscolorspace srgb_rec709_scene --texstationarize:size=48x32:seed=5\n" in said
    assert "/bin/false cannot start oiiotex" in said
    assert "photo.png: colour space Linear Rec.2020: allowed are sRGB, Linear Rec.709, Non-Color" in said
