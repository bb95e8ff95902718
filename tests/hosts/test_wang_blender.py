# SPDX-License-Identifier: Apache-2.0
"""Blender's node group of Wang tiles: Cycles and EEVEE show the pixels of an endless texture.

Requires bpy as test_cryptomatte_blender does. EEVEE runs on software OpenGL.
"""

from __future__ import annotations

import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from oiiotex_studio.library.commands import run

from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from tests.any_filter import buffer
from tests.hosts.test_cryptomatte_blender import BLENDER, needs_blender
from tests.studio.test_wang_renderers import TILE, endless

BUILD = Path(__file__).parents[2] / "hosts" / "blender" / "build.py"
WIDE, HIGH, DENSE = 60, 40, 5  # texels of the render, and its pixels for each
SCRIPT = """
import os, sys
folder, engine, wide, high, dense, tile = *sys.argv[1:3], *map(int, sys.argv[3:])
import bpy
bpy.ops.extensions.package_install_files(
    filepath=folder + "/extension.zip", repo="user_default", enable_on_install=True
)
bpy.ops.wm.read_homefile(use_empty=True)
bpy.ops.mesh.primitive_plane_add(size=1)
plane = bpy.context.active_object
for corner in plane.data.uv_layers.active.data:  # a tile is a unit; a part on both sides of the origin
    corner.uv = (corner.uv.x * wide / tile - 1, corner.uv.y * high / tile - 1)
plane.scale = (wide / high, 1, 1)
print(bpy.ops.oiiotex.wang_material(filepath=folder + "/out/wall_index.png", relief=0.5, eevee=True))
material = plane.active_material
nodes, links = material.node_tree.nodes, material.node_tree.links
surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
moved = next(node for node in nodes if node.type == "DISPLACEMENT")
print(sorted(link.from_node.name for link in links if link.to_node == surface), moved.inputs["Scale"].default_value)
glow, output = nodes.new("ShaderNodeEmission"), next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
print(nodes["color"].interpolation)  # with rays of a pixel jittered, exact only if Closest
links.new(nodes["color"].outputs["Color"], glow.inputs["Color"])
links.new(glow.outputs["Emission"], output.inputs["Surface"])
links.remove(output.inputs["Displacement"].links[0])
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", wide / high, (0, 0, 1)
scene = bpy.context.scene
scene.collection.objects.link(camera)
scene.camera, scene.render.engine = camera, engine
scene.eevee.taa_render_samples = 1
scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.pixel_filter_type = 1, False, "BOX"
scene.render.resolution_x, scene.render.resolution_y = wide * dense, high * dense
scene.render.resolution_percentage, scene.render.filepath = 100, folder + "/shown.png"
scene.view_settings.view_transform = "Standard"
scene.render.image_settings.file_format = "PNG"
bpy.ops.render.render(write_still=True)
try:
    bpy.ops.oiiotex.wang_material(filepath=folder + "/color.png")
except RuntimeError as error:
    print(error)
sys.stdout.flush()
os._exit(0)
"""


@needs_blender
@pytest.mark.parametrize("engine", ["CYCLES", pytest.param("BLENDER_EEVEE", marks=pytest.mark.slow)])
def test_blender_shows_the_pixels_of_an_endless_texture(tmp_path, engine):
    if engine != "CYCLES" and find_library("EGL") is None:
        pytest.skip("NOT RUN: no libEGL for EEVEE (apt-get install libegl1)")
    rng = np.random.default_rng(4)
    maps = []
    for role, channels in (("color", 3), ("normal", 3), ("height", 1)):
        image = buffer(np.rint(255 * rng.random((4 * TILE, 4 * TILE, channels))) / 255, oiio.UINT8)
        image.specmod().attribute("oiiotex:atlas", "4x4")
        assert image.write(str(tmp_path / f"{role}.png"))
        maps.append(f"{role}={tmp_path / role}.png")
    assert run(["wang", str(tmp_path / "out"), *maps, "--name", "wall", "--seed", "3"]) == 0
    subprocess.run([sys.executable, BUILD, tmp_path / "extension.zip"], check=True)
    words = [str(n) for n in (WIDE, HIGH, DENSE, TILE)]
    done = subprocess.run(
        [BLENDER, "-c", SCRIPT, tmp_path, engine, *words], capture_output=True, text=True, timeout=300
    )
    assert "{'FINISHED'}" in done.stdout, done.stdout + done.stderr
    assert "['Normal Map', 'color'] 0.5" in done.stdout and "Closest" in done.stdout
    assert "color.png: expected NAME_index.png next to NAME_color" in done.stdout
    shown = oiio.ImageBuf(str(tmp_path / "shown.png")).get_pixels(oiio.UINT8)[DENSE // 2 :: DENSE, DENSE // 2 :: DENSE]
    place = Window.sized(-TILE, TILE - HIGH, WIDE, HIGH)
    wanted = endless(tmp_path, "color").tile(0, place, Session())
    assert (np.abs(shown[..., :3].astype(int) - wanted).max(-1) <= 1).mean() >= 0.999
