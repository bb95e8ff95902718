# SPDX-License-Identifier: Apache-2.0
"""The extension in Blender itself: its tile is the program's, in the image's color space, with the line that makes it.

Requires bpy as test_cryptomatte_blender does. Blender hangs where it ends, so it is left by os._exit.
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
from tests.browser import end_resident
from tests.conftest import save
from tests.hosts.test_cryptomatte_blender import BLENDER, needs_blender

BUILD = Path(__file__).parents[2] / "hosts" / "blender" / "build.py"
SCRIPT = """
import os, sys
import numpy as np
folder, python = sys.argv[1:]
import bpy
bpy.ops.extensions.package_install_files(
    filepath=folder + "/extension.zip", repo="user_default", enable_on_install=True
)
preferences = bpy.context.preferences.addons["bl_ext.user_default.oiiotex_blender"].preferences
preferences.python = python
image = bpy.data.images.load(folder + "/photo.png")
with bpy.context.temp_override(edit_image=image):
    print(bpy.ops.oiiotex.make_tile(width=48, height=32, seed=5))
tile = bpy.data.images["photo.png tile"]
print(tile.colorspace_settings.name, tile["oiiotex"], sep="|")
normal = bpy.data.images.load(folder + "/normal.png")
normal.colorspace_settings.name = "Non-Color"
bpy.ops.mesh.primitive_cube_add()
cube = bpy.context.active_object
material = bpy.data.materials.new("wall")
material.use_nodes = True
cube.data.materials.append(material)
nodes, links = material.node_tree.nodes, material.node_tree.links
surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
color, bumps, between = (nodes.new("ShaderNode" + kind) for kind in ("TexImage", "TexImage", "NormalMap"))
color.image, bumps.image = image, normal
links.new(color.outputs["Color"], surface.inputs["Base Color"])
links.new(bumps.outputs["Color"], between.inputs["Color"])
links.new(between.outputs["Normal"], surface.inputs["Normal"])
with bpy.context.temp_override(edit_image=image):
    for make in (bpy.ops.oiiotex.flatten, bpy.ops.oiiotex.dominant_mask, bpy.ops.oiiotex.label_masks):
        print(make())
    print(bpy.ops.oiiotex.cryptomatte(filepath=folder + "/labels.exr"))
    print(bpy.ops.oiiotex.make_material(width=40, height=40, seed=2))
    print(color.image.name, bumps.image.name, bumps.image.colorspace_settings.name, bumps.image["oiiotex"], sep="|")
    panel = bpy.context.scene.oiiotex
    panel.width, panel.height, panel.seed, panel.preset, panel.sigma, panel.lattice = 40, 32, 7, "EVEN", 9, 0.25
    with bpy.context.temp_override(edit_image=tile):  # its photo is used
        print(bpy.ops.oiiotex.next_seed())
    print(bpy.ops.oiiotex.cancel(), panel.seed)
    print(bpy.data.images["photo.png tile.002"]["oiiotex"])
    print(bpy.ops.oiiotex.texture_mesh(width=64, height=64, seed=1))
    print(cube.active_material.name)
    cube.data.uv_layers.remove(cube.data.uv_layers[0])
    try:
        bpy.ops.oiiotex.texture_mesh(width=64, height=64)
    except RuntimeError as error:
        print(error)
for one in bpy.data.images:
    if one.has_data and one.source != "VIEWER":
        values = np.empty(len(one.pixels), np.float32)
        one.pixels.foreach_get(values)
        np.save(folder + "/" + one.name + ".npy", values.reshape(one.size[1], one.size[0], 4)[::-1])
missing = bpy.data.images.new("missing", 8, 8)
missing.source, missing.filepath = "FILE", "/nowhere/missing.png"
with bpy.context.temp_override(edit_image=missing):
    try:
        bpy.ops.oiiotex.make_tile()
    except RuntimeError as error:
        print(error)
preferences.python = "/bin/false"
for space in ("sRGB", "Linear Rec.2020"):
    image.colorspace_settings.name = space
    with bpy.context.temp_override(edit_image=image):
        try:
            bpy.ops.oiiotex.make_tile()
        except RuntimeError as error:
            print(error)
image.colorspace_settings.name, preferences.python = "sRGB", python
bpy.ops.ed.undo_push(message="before")
counts = [len(bpy.data.images)]
with bpy.context.temp_override(edit_image=image):
    bpy.ops.oiiotex.flatten("EXEC_DEFAULT", True)  # with an undo step, as in the panel
counts.append(len(bpy.data.images))
bpy.ops.ed.undo()
counts.append(len(bpy.data.images))
print("images by undo", counts[1] - counts[0], counts[2] - counts[0])
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
        save(np.full((64, 80, 3), (0.5, 0.5, 1.0)), path / "normal.png")
        subprocess.run([sys.executable, BUILD, path / "extension.zip"], check=True)
        yield path
        end_resident(path / "run")


WITHOUT_BLENDER = """
import sys
folder, python = sys.argv[1:]
sys.path.insert(0, folder)
import numpy as np
from oiiotex_blender.process import Failed, Process
assert "oiiotex" not in sys.modules
photo = np.load(folder + "/photo.npy")
job = Process(python).begin("stationarize", [(photo, None)], {"size": "48x32", "data": 1})
job.wait()
np.save(folder + "/tile.npy", job.result()[0][0][1])
wrong = Process(python).begin("stationarize", [(photo, None)], {"size": "0x32"})
long = Process(python).begin("stationarize", [(photo, None)], {"iterations": 1000, "data": 1})
long.cancel()
for job in (wrong, long):
    job.wait()
    try:
        job.result()
    except Failed as error:
        print(error)
"""


def test_what_speaks_to_the_process_needs_neither_blender_nor_our_package(folder):
    zipfile.ZipFile(folder / "extension.zip").extractall(folder / "oiiotex_blender")
    (folder / "oiiotex_blender" / "__init__.py").write_text("")  # which wants bpy
    photo = pictures.bricks(64, 80, seed=1).astype(np.float32)
    np.save(folder / "photo.npy", photo)
    line = [sys.executable, "-c", WITHOUT_BLENDER, str(folder), sys.executable]
    done = subprocess.run(line, cwd=folder / "run", capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    same = filters.stationarize(photo, size=(48, 32), data=True).get_pixels(oiio.FLOAT)
    np.testing.assert_array_equal(np.load(folder / "tile.npy"), same)
    assert done.stdout.splitlines()[0].startswith("size=0x32: expected pow2 or WIDTHxHEIGHT")
    assert done.stdout.splitlines()[1] == "canceled"


@needs_blender
def test_a_tile_is_the_programs(folder):
    line = [BLENDER, "-c", SCRIPT, str(folder), sys.executable]
    there = os.environ | {"BLENDER_USER_RESOURCES": str(folder / "user")}
    done = subprocess.run(line, capture_output=True, text=True, timeout=200, env=there)
    assert done.returncode == 0, done.stdout + done.stderr
    photo, normal = (oiio.ImageBuf(str(folder / name)) for name in ("photo.png", "normal.png"))
    space = {"colorspace": "srgb_rec709_scene"}
    tiles = filters.stationarize(photo, maps=[normal], kinds=["color", "normal"], size=(40, 40), seed=2, **space)
    for name, same in {
        "photo.png tile": filters.stationarize(photo, size=(48, 32), seed=5, **space),
        "photo.png flat": filters.flatten(photo, **space),
        "photo.png tile.001": tiles[0],
        "photo.png tile.002": filters.stationarize(
            photo, size=(40, 32), seed=8, preset="even", sigma=9, lattice=0.25, **space
        ),
        "normal.png tile": tiles[1],
        "photo.png dominant": filters.dominant(photo, **space),
    }.items():
        found = np.rint(np.load(folder / f"{name}.npy") * 255).astype(np.uint8)
        assert (found[..., :3] == same.get_pixels(oiio.UINT8)).all(), name  # of a mask the one channel thrice
        assert (found[..., 3] == 255).all()  # Blender's images have an alpha
    said = done.stdout.splitlines()
    assert said.count("{'FINISHED'}") == 8 and "{'FINISHED'} 8" in said
    line = "oiiotex photo.png --iscolorspace srgb_rec709_scene"
    assert f"sRGB|{line} --texstationarize:size=48x32:seed=5" in said
    assert f"{line} --texstationarize:size=40x32:seed=8:preset=even:sigma=9:lattice=0.25" in said
    assert any(
        one.endswith(f"|{line} normal.png --texstationarize:size=40x40:seed=2:kinds=color,normal") for one in said
    )
    assert "images by undo 1 0" in said
    masks = [np.load(path)[..., 0] for path in sorted(folder.glob("photo.png label*.npy"))]
    assert len(masks) >= 2 and (sum(masks) == 1).all()
    parts = [oiio.ImageBuf(str(folder / "labels.exr"), n, 0).spec() for n in range(9)]
    assert any("cryptomatte/" in attribute.name for spec in parts for attribute in spec.extra_attribs)
    assert any(one.startswith("photo.png on Cube") for one in said)
    for text in (
        "Warning: --texstationarize: size 40x40 px stretches a lattice",
        "missing has no readable pixels; its file may be missing",
        "/bin/false cannot start oiiotex",
        "has no UV map; add one, for example with Smart UV Project",
        "photo.png: color space Linear Rec.2020: expected sRGB, Linear Rec.709, Non-Color",
    ):
        assert any(text in one for one in said), done.stdout
