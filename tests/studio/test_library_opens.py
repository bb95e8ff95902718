# SPDX-License-Identifier: Apache-2.0
"""A folder that was ingested with `wang = true` opens in other programs, without a hand on it.

Blender's own USD has the plugin UsdMtlx, which usd-core's wheels lack, so it checks the MaterialX variant of stages.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from oiiotex_studio.library.commands import run
from oiiotex_studio.library.wang import write_wang
from oiiotex_studio.materials.preview import Looks
from oiiotex_studio.materials.shaded import shaded_sphere

from oiiotex.engine.io.reading import read
from oiiotex.engine.session import Session
from tests import pictures
from tests.any_filter import buffer
from tests.browser import DRAWING, chromium
from tests.conftest import save
from tests.hosts.test_cryptomatte_blender import BLENDER, needs_blender
from tests.hosts.test_wang_blender import BUILD
from tests.library_makings import bumps
from tests.studio.test_wang_renderers import GLSLANG, compiled, generated

pytestmark = pytest.mark.slow
RECIPE = """
schema = 1
[[product]]
name = "tile"
line = "$maps --texstationarize:kinds=$kinds:variants=16:size=52x52:pack=atlas:iterations=1 $outputs"
[deliver]
wang = true
"""
NAMES = ("bricks", "gravel", "wall")
SCRIPT = """
import json, os, sys
import bpy
zipped, *folders = sys.argv[1:]
bpy.utils.expose_bundled_modules()
from pxr import Usd, UsdShade, UsdValidation
validators = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
bpy.ops.extensions.package_install_files(filepath=zipped, repo="user_default", enable_on_install=True)
bpy.ops.mesh.primitive_plane_add(size=1)
plane = bpy.context.active_object
told = {}
for folder in folders:
    name = next(entry[:-5] for entry in os.listdir(folder) if entry.endswith(".usda"))
    stage = Usd.Stage.Open(f"{folder}/{name}.usda")
    stage.SetEditTarget(stage.GetSessionLayer())
    prim, own = stage.GetDefaultPrim(), {"errors": []}
    for variant in ("preview", "materialx"):
        prim.GetVariantSet("shading").SetVariantSelection(variant)
        surface = UsdShade.Material(prim).ComputeSurfaceSource("mtlx")[0]
        own[variant] = surface.GetIdAttr().Get() if surface else None
        own["errors"] += [error.GetMessage() for error in validators.Validate(stage)]
    shaders = [shader for shader in map(UsdShade.Shader, stage.Traverse()) if shader]
    own["unknown"] = [str(s.GetPath()) for s in shaders if not s.GetShaderNodeForSourceType("mtlx")]
    own["files"] = sorted(
        i.Get().path for s in shaders for i in s.GetInputs() if i.GetTypeName() == "asset" and i.Get()
    )
    own["missing"] = [
        i.Get().path for s in shaders for i in s.GetInputs()
        if i.GetTypeName() == "asset" and i.Get() and not os.path.isfile(i.Get().resolvedPath)
    ]
    own["imported"] = list(bpy.ops.wm.usd_import(filepath=f"{folder}/{name}.usda", import_all_materials=True))
    bpy.context.view_layer.objects.active = plane
    own["wang"] = list(bpy.ops.oiiotex.wang_material(filepath=f"{folder}/tile/index.png"))
    nodes = plane.material_slots[-1].material.node_tree.nodes
    own["images"] = sorted(node.image.size[0] for node in nodes if node.type == "TEX_IMAGE")
    told[name] = own
print("TOLD" + json.dumps(told))
sys.stdout.flush()
os._exit(0)
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library of two photos and a scanned material of four maps, by the program."""
    path = tmp_path_factory.mktemp("opens")
    (path / "photos").mkdir()
    (path / "recipe.toml").write_text(RECIPE)
    save(pictures.bricks(96, 96, 1), path / "photos/bricks.png")
    save(pictures.pebbles(96, 96, 2), path / "photos/gravel.png")
    save(pictures.bricks(96, 96, 3), path / "photos/wall_color.png")
    save(bumps(96), path / "photos/wall_nor_gl.png")
    for number, role in enumerate(("rough", "height")):
        save(pictures.smooth_noise(96, 96, 4, number)[..., None], path / f"photos/wall_{role}.png")
    words = ["ingest", str(path / "photos"), str(path / "library"), "--recipe", str(path / "recipe.toml"), "-q"]
    assert run([*words, "--workers", "1"]) == 0
    assert run(["check", str(path / "library")]) == 0  # MaterialX's and USD's own validators
    return path / "library"


def folders(library: Path) -> dict[str, Path]:
    return {path.parent.parent.name: path.parent for path in sorted(library.glob("assets/*/*/asset.json"))}


@needs_blender
def test_usd_with_materialx_and_blender_open_every_asset(library, tmp_path):
    subprocess.run([sys.executable, BUILD, tmp_path / "extension.zip"], check=True)
    words = [BLENDER, "-c", SCRIPT, tmp_path / "extension.zip", *folders(library).values()]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    line = next((line for line in done.stdout.splitlines() if line.startswith("TOLD")), None)
    assert line, done.stdout + done.stderr
    told = json.loads(line.removeprefix("TOLD"))
    assert tuple(told) == NAMES
    for name, own in told.items():
        assert own["errors"] == own["unknown"] == own["missing"] == []
        assert (own["preview"], own["materialx"]) == ("UsdPreviewSurface", "ND_open_pbr_surface_surfaceshader")
        roles = ["color", "height", "normal", "roughness"] if name == "wall" else ["color"]
        assert sorted(Path(file).name for file in own["files"]) == sorted(
            ["index.png", *(f"{role}.tx" for role in roles)]
        )
        assert own["imported"] == own["wang"] == ["FINISHED"]
        assert own["images"] == [4 * 52] * len(roles)


def test_materialx_generates_shaders_that_compile(library, tmp_path):
    for name, folder in folders(library).items():
        for document in (name, f"{name}_standard"):
            sources = generated(folder / f"{document}.mtlx", "essl")
            for text, stage in zip(sources, ("frag", "vert"), strict=True):
                assert GLSLANG is None or compiled(text, stage, tmp_path) == ""


def test_the_report_and_every_plane_open_in_a_browser(library, tmp_path):
    shutil.copytree(library, tmp_path / "moved")  # links are relative
    faults = []
    with chromium(DRAWING) as browser:
        page = browser.new_page(viewport={"width": 800, "height": 600})
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.add_init_script("window.held = true")
        page.goto((tmp_path / "moved/report.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= 800
        links = page.eval_on_selector_all("a", "links => links.map(link => [link.textContent, link.href])")
        planes = [link for text, link in links if text == "plane"]
        assert len(planes) == len(NAMES)
        for plane in planes:
            page.goto(plane)
            page.wait_for_selector("html[data-ready]", state="attached", timeout=120_000)
            page.evaluate("fromAbove()")
            assert len(set(page.evaluate("pixels(2, 0, 0, 16, 16)"))) > 8
    assert faults == []


def test_the_generated_shader_shows_the_tiles_of_the_plane(tmp_path):
    """MaterialX's GLSL, on software OpenGL: every tile of a color of its own, at its place on the sphere."""
    pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    if not (shutil.which("Xvfb") or os.environ.get("DISPLAY")):
        pytest.skip("NOT RUN: no Xvfb (apt-get install xvfb)")
    hues = np.stack([0.5 + 0.4 * np.cos(2 * np.pi * (np.arange(16) / 16 + n / 3)) for n in range(3)], -1)
    atlas = buffer(np.kron(hues.reshape(4, 4, 3), np.ones((32, 32, 1))), oiio.FLOAT, "lin_rec709_scene")
    atlas.specmod().attribute("oiiotex:atlas", "4x4")
    assert atlas.write(str(tmp_path / "color.exr"))
    wang = write_wang({"color": "color.exr"}, tmp_path, "hues", 3, (2.0, 0.5), 0.0, "")
    maps = {"color": read(str(tmp_path / "color.exr"))}
    shown = shaded_sphere(tmp_path / "hues.mtlx", maps, Session().resources, 64, wang.size_m, 4)
    assert shown.shape == (64, 64, 4) and shown[0, 0, 3] == 0 and shown[32, 32, 3] == 1
    plain = Looks.of(maps, Session().resources, "", 4, wang.plane).sphere(64, 0, 64)[..., :3]
    inside = shown[..., 3] == 1
    assert shown[inside][:, :3].mean() == pytest.approx(plain[inside].mean(), rel=0.15)  # under the same lights
    numbers = wang.plane[..., 2]
    for x, y in ((1, -2), (2, -2), (1, -1), (2, -1)):  # around the middle: u = 2, v = 1
        place = 32 + 10 * (2 * (y >= -1) - 1), 32 + 10 * (2 * (x >= 2) - 1)
        color = shown[place][:3] - shown[place][:3].mean()  # without gray reflections
        wanted = hues - hues.mean(-1, keepdims=True)
        likeness = wanted @ color / np.linalg.norm(wanted, axis=-1) / np.linalg.norm(color)
        assert likeness.argmax() == numbers[y % 256, x % 256]
