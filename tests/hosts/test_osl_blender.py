# SPDX-License-Identifier: Apache-2.0
"""Open Shading Language, as Blender has it: MaterialX's OSL compiles, and a shader in Cycles reads an `.oiiotex` plane.

Requires bpy as test_cryptomatte_blender does.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from tests.browser import end_resident
from tests.hosts.test_cryptomatte_blender import BLENDER, needs_blender
from tests.hosts.test_openimageio_plugin import HOST, without_compiler
from tests.studio.test_wang_renderers import endless, folder, generated  # noqa: F401

pytestmark = needs_blender
HEADERS = "3.0.10.1"  # the version on PyPI that is nearest to Blender's 3.0.9.1
LEFT, TOP, WIDE, HIGH, DENSE = 100, 200, 60, 40, 5  # texels of the plane, and pixels of the render for each
COMPILE = """
import sys
import bpy, _cycles
for path in sys.argv[1:]:
    print(_cycles.osl_compile(path, path[:-3] + "oso"), flush=True)
import os
os._exit(0)
"""
SHADER = """
shader plane(string file = "", vector place = vector(0), output color shown = color(0))
{
    shown = texture(file, place[0], place[1], 0, 0, 0, 0, "interp", "closest");
}
"""
RENDER = """
import os, sys
from pathlib import Path
folder = sys.argv[1]
left, top, wide, high, dense = map(int, sys.argv[2:])
import bpy
bpy.ops.wm.read_homefile(use_empty=True)
bpy.ops.mesh.primitive_plane_add(size=1)
plane = bpy.context.active_object
for corner in plane.data.uv_layers.active.data:  # v downwards, as OpenImageIO counts
    corner.uv = ((left + corner.uv.x * wide) / 4096, (top + (1 - corner.uv.y) * high) / 4096)
plane.scale = (wide / high, 1, 1)
material = bpy.data.materials.new("plane")
material.use_nodes = True
plane.data.materials.append(material)
nodes, links = material.node_tree.nodes, material.node_tree.links
nodes.clear()
scene = bpy.context.scene
scene.render.engine, scene.cycles.shading_system = "CYCLES", True
script, place = nodes.new("ShaderNodeScript"), nodes.new("ShaderNodeTexCoord")
glow, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
sys.path.append(str(next(Path(bpy.utils.resource_path("LOCAL")).rglob("oslquery")).parent))
from cycles import osl
script.mode, script.filepath = "EXTERNAL", folder + "/plane.osl"
osl.update_script_node(script, print)
script.inputs["file"].default_value = folder + "/color.oiiotex"
links.new(place.outputs["UV"], script.inputs["place"])
links.new(script.outputs["shown"], glow.inputs["Color"])
links.new(glow.outputs["Emission"], output.inputs["Surface"])
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", wide / high, (0, 0, 1)
scene.collection.objects.link(camera)
scene.camera = camera
scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.pixel_filter_type = 1, False, "BOX"
scene.render.resolution_x, scene.render.resolution_y = wide * dense, high * dense
scene.render.filepath, scene.view_settings.view_transform = folder + "/shown.png", "Raw"
bpy.ops.render.render(write_still=True)
sys.stdout.flush()
os._exit(0)
"""


def test_osl_compiles(folder, tmp_path):  # noqa: F811
    import MaterialX as mx

    paths = []
    for name in ("a wall", "a wall_standard"):
        (text,) = generated(folder / "out" / f"{name}.mtlx", "osl")
        include = mx.getDefaultDataSearchPath().find("libraries/stdlib/genosl/include/mx_funcs.h").asString()
        text = text.replace('#include "mx_funcs.h"', f'#include "{include}"')
        paths += [tmp_path / f"{name[6:]}_.osl", tmp_path / f"{name[6:]}_wrong.osl"]
        paths[-2].write_text(text)
        paths[-1].write_text(re.sub(r"\btexcoord\b", "nowhere", text, count=1))
    done = subprocess.run([BLENDER, "-c", COMPILE, *paths], capture_output=True, text=True, timeout=100)
    assert [line for line in done.stdout.splitlines() if line in ("True", "False")] == ["True", "False"] * 2, (
        done.stdout + done.stderr
    )


@pytest.mark.slow
def test_a_shader_in_cycles_reads_a_plane(folder, tmp_path, monkeypatch):  # noqa: F811
    missing = without_compiler()
    if missing:
        pytest.skip(f"THE PLUGIN IS NOT BUILT: {missing}")
    asked = "import bpy; print(bpy.utils.resource_path('LOCAL'))"
    found = subprocess.run([BLENDER, "-c", asked], capture_output=True, text=True, check=True).stdout.split()[-1]
    (library,) = Path(found).parent.rglob("libOpenImageIO.so.3.0")
    line = [sys.executable, HOST / "build.py", "--library", library, "--headers", HEADERS]
    built = subprocess.run([*line, "--into", tmp_path, "--work", tmp_path / "work"], capture_output=True, text=True)
    if "No matching distribution" in built.stderr:
        pytest.skip(f"THE PLUGIN IS NOT BUILT: no source of OpenImageIO {HEADERS}")
    assert built.returncode == 0, built.stdout + built.stderr
    texture = endless(folder, "color")
    (folder / "plane.osl").write_text(SHADER)
    words = [str(n) for n in (LEFT, TOP, WIDE, HIGH, DENSE)]
    monkeypatch.setenv("OPENIMAGEIO_PLUGIN_PATH", str(tmp_path / "lib" / "oiiotex"))
    with tempfile.TemporaryDirectory(prefix="oxo") as runtime:  # short: sockets lie in it
        monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
        done = subprocess.run([BLENDER, "-c", RENDER, folder, *words], capture_output=True, text=True, timeout=200)
        end_resident(Path(runtime))
    assert (folder / "shown.png").exists(), done.stdout + done.stderr
    shown = oiio.ImageBuf(str(folder / "shown.png")).get_pixels(oiio.UINT8)[DENSE // 2 :: DENSE, DENSE // 2 :: DENSE]
    wanted = texture.tile(0, Window.sized(LEFT, TOP, WIDE, HIGH), Session())
    assert (np.abs(shown[..., :3].astype(int) - wanted).max(-1) <= 1).all()
