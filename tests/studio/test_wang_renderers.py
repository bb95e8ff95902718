# SPDX-License-Identifier: Apache-2.0
"""What renderers get of an atlas of Wang tiles: documents that generate, shaders that compile, pixels that agree.

No compiler of Metal or MDL has a package. Those of OSL and EEVEE are in Blender: test_wang_blender.
"""

from __future__ import annotations

import ctypes
import json
import logging
import shutil
import subprocess
from importlib import util
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from oiiotex_studio.library.commands import run
from oiiotex_studio.materials.documents import (
    Described,
    loaded_libraries,
    materialx_faults,
    usd_faults,
    write_materialx,
)

from oiiotex.engine import errors
from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from oiiotex.oiiotool.service.texture_file import read_texture_file
from oiiotex.oiiotool.service.textures import OpenTexture
from oiiotex.synthesis.quality.seam_measures import sharpness
from oiiotex.synthesis.wang.viewer import shader
from tests.any_filter import buffer
from tests.browser import DRAWING, chromium
from tests.peer import OIIOTOOL
from tests.reference.materialx_graphs import evaluated

TILE = 16  # px
ROLES = {"color": "srgb_rec709_scene", "normal": "", "roughness": "", "metal": "", "height": "", "opacity": ""}
GLSLANG = shutil.which("glslangValidator")
RASTER = ("glsl", "essl", "vulkan", "wgsl")  # MaterialX's WGSL is a Vulkan GLSL that others translate
needs_glslang = pytest.mark.skipif(GLSLANG is None, reason="NOT RUN: no glslangValidator (glslang-tools)")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A delivered material, and the atlas of noise it is made of."""
    path = tmp_path_factory.mktemp("wang")
    rng = np.random.default_rng(4)
    for role, space in ROLES.items():
        channels = 3 if role in ("color", "normal") else 1
        image = buffer(np.rint(255 * rng.random((4 * TILE, 4 * TILE, channels))) / 255, oiio.UINT8, space)
        image.specmod().attribute("oiiotex:atlas", "4x4")
        assert image.write(str(path / f"{role}.png"))
    maps = [f"{role}={path / role}.png" for role in ROLES]
    given = ["--name", "a wall", "--seed", "3", "--size", "2x0.5", "--relief", "0.25", "--normals", "directx"]
    log = logging.getLogger("oiiotex")
    level = log.level
    assert run(["wang", str(path / "out"), *maps, *given]) == 0
    log.setLevel(level)  # which the program sets, for all tests that follow
    return path


def generated(path: Path, target: str, number: int = 0) -> list[str]:
    """The sources of one of a document's materials in a language; raises an exception of MaterialX."""
    mx = pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    import MaterialX.PyMaterialXGenGlsl as glsl
    import MaterialX.PyMaterialXGenMdl as mdl
    import MaterialX.PyMaterialXGenMsl as msl
    import MaterialX.PyMaterialXGenOsl as osl
    import MaterialX.PyMaterialXGenShader as gen
    import MaterialX.PyMaterialXGenSlang as slang

    makers = {
        "glsl": glsl.GlslShaderGenerator, "essl": glsl.EsslShaderGenerator, "vulkan": glsl.VkShaderGenerator,
        "wgsl": glsl.WgslShaderGenerator, "osl": osl.OslShaderGenerator, "mdl": mdl.MdlShaderGenerator,
        "msl": msl.MslShaderGenerator, "slang": slang.SlangShaderGenerator,
    }  # fmt: skip
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(path))
    document.setDataLibrary(loaded_libraries())
    generator = makers[target].create()
    context = gen.GenContext(generator)
    search = mx.getDefaultDataSearchPath()
    search.append(str(path.parent))
    context.registerSourceCodeSearchPath(search)
    generator.registerTypeDefs(document)
    colors = gen.DefaultColorManagementSystem.create(generator.getTarget())
    colors.loadLibrary(document)
    generator.setColorManagementSystem(colors)
    units, registry = gen.UnitSystem.create(generator.getTarget()), mx.UnitConverterRegistry.create()
    for kind in ("distance", "angle"):
        definition = document.getUnitTypeDef(kind)
        registry.addUnitConverter(definition, mx.LinearUnitConverter.create(definition))
    units.loadLibrary(document)
    units.setUnitConverterRegistry(registry)
    generator.setUnitSystem(units)
    context.getOptions().targetDistanceUnit = "meter"
    made = generator.generate("wall", document.getMaterialNodes()[number], context)
    assert made is not None
    stages = [gen.PIXEL_STAGE, gen.VERTEX_STAGE] if target in ("glsl", "essl", "vulkan") else [gen.PIXEL_STAGE]
    return [made.getSourceCode(stage) for stage in stages]


def compiled(text: str, suffix: str, folder: Path, *flags: str) -> str:
    """What glslang says against a shader; '' if it accepts it."""
    path = folder / f"shader.{suffix}"
    path.write_text(text)
    done = subprocess.run([GLSLANG, *flags, str(path)], capture_output=True, text=True)
    return "" if done.returncode == 0 else done.stdout


def slang_faults(text: str, folder: Path) -> str:
    """What the Slang compiler says against a fragment shader; '' if it makes SPIR-V of it. No device is needed."""
    found = util.find_spec("slangpy")
    if found is None:
        pytest.skip("NOT RUN: no slangpy (pip install oiiotex[hosts])")
    library = ctypes.CDLL(str(next(Path(found.origin).parent.glob("libslang-compiler.so*"))))
    for name in ("spCreateSession", "spCreateCompileRequest"):
        getattr(library, name).restype = ctypes.c_void_p
    library.spGetDiagnosticOutput.restype = ctypes.c_char_p
    path = folder / "shader.slang"
    path.write_text(text)
    words = [str(path), "-target", "spirv", "-entry", "fragmentMain", "-stage", "fragment"]
    given = (ctypes.c_char_p * len(words))(*(word.encode() for word in words))
    session = ctypes.c_void_p(library.spCreateSession(None))
    request = ctypes.c_void_p(library.spCreateCompileRequest(session))
    assert library.spProcessCommandLineArguments(request, given, len(words)) == 0
    said = library.spGetDiagnosticOutput(request).decode() if library.spCompile(request) else ""
    library.spDestroyCompileRequest(request)
    library.spDestroySession(session)
    return said


@pytest.mark.parametrize("target", [*RASTER, "osl", "mdl", "msl", "slang"])
@pytest.mark.parametrize("name", ["a wall", "a wall_standard"])
def test_documents_generate_every_language(folder, tmp_path, target, name):
    sources = generated(folder / "out" / f"{name}.mtlx", target)
    own = name == "a wall" and target not in ("osl", "mdl")
    # raster languages: one sample of each map, with gradients of the unbroken coordinate
    assert sources[0].count("textureGrad(") >= 3 * own
    calls = [line for line in sources[0].splitlines() if "    oiiotex_image_" in line and line.endswith(";")]
    assert len(calls) == (len(ROLES) if own else 0)
    if GLSLANG and target in RASTER:
        vulkan = ["-V", "--auto-map-locations", "--auto-map-bindings", "-o", "/dev/null"]
        for text, stage in zip(sources, ("frag", "vert"), strict=False):
            assert compiled(text, stage, tmp_path, *(vulkan if target in ("vulkan", "wgsl") else [])) == ""


@pytest.mark.parametrize("target", [*RASTER, "osl", "mdl", "msl", "slang"])
@pytest.mark.parametrize("name", ["plain", "plain_standard"])
def test_documents_of_one_tile_generate_every_language(tmp_path, target, name):
    maps = {role: f"{role}.exr" for role in ("color", "normal", "roughness", "metal", "opacity", "emission")}
    write_materialx(Described("plain", maps, "lin_rec709_scene", "directx"), tmp_path)
    sources = generated(tmp_path / f"{name}.mtlx", target)
    images = [f"{role}_image_file" for role in maps]
    assert target == "mdl" or all(image in sources[0] for image in images)  # MDL names its own textures
    if GLSLANG and target in RASTER:
        vulkan = ["-V", "--auto-map-locations", "--auto-map-bindings", "-o", "/dev/null"]
        for text, stage in zip(sources, ("frag", "vert"), strict=False):
            assert compiled(text, stage, tmp_path, *(vulkan if target in ("vulkan", "wgsl") else [])) == ""


@pytest.mark.parametrize("name", ["a wall", "a wall_standard"])
def test_slang_compiles(folder, tmp_path, name):
    (source,) = generated(folder / "out" / f"{name}.mtlx", "slang")
    assert "texcoord" in slang_faults(source.replace("texcoord", "nowhere", 1), tmp_path)
    assert slang_faults(source, tmp_path) == ""


def test_documents_are_valid_and_connect_every_map(folder):
    mx = pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    out = folder / "out"
    documents = {}
    for name in ("a wall", "a wall_standard"):
        assert materialx_faults(out / f"{name}.mtlx") == []
        documents[name] = mx.createDocument()
        mx.readFromXmlFile(documents[name], str(out / f"{name}.mtlx"))
    own, standard = (document.getNodeGraph("maps_a_wall") for document in documents.values())
    images = [node for node in own.getNodes() if node.getCategory() == "oiiotex_image"]
    assert sorted(n.getInputValue("file") for n in images) == sorted(f"a wall_{role}.png" for role in ROLES)
    assert {n.getConnectedNodeName("texcoord") for n in images} == {"place_in_atlas"}
    surface = documents["a wall"].getNode("surface_a_wall")
    assert surface.getCategory() == "open_pbr_surface"
    assert {i.getName() for i in surface.getInputs()} == {
        "base_color", "geometry_normal", "specular_roughness", "base_metalness", "geometry_opacity",
    }  # fmt: skip
    moved = documents["a wall"].getNode("displacement_a_wall")
    assert moved.getInputValue("scale") == 0.25 and moved.getInput("displacement").getOutputString() == "height"
    assert own.getNode("in_tiles").getInput("in2").getValueString() == "0.5, -2"
    # for old hosts: nothing of ours, nothing of OpenPBR
    everything = {e.getCategory() for e in documents["a wall_standard"].traverseTree()}
    assert not {c for c in everything if "open_pbr" in c or "oiiotex" in c} and "standard_surface" in everything
    old = documents["a wall_standard"].getNode("surface_a_wall")
    assert old.getInput("normal").getOutputString() == "normal"
    assert standard.getNode("index_image").getInputValue("filtertype") == "closest"


def test_the_graph_gives_the_pixels_of_an_endless_texture(folder):
    mx = pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(folder / "out/a wall_standard.mtlx"))
    y, x = np.indices((150, 200)) - 40
    uv = np.stack([(x + 0.5) / TILE * 2, -(y + 0.5) / TILE * 0.5], axis=-1)  # a tile is 2 x 0.5 units
    for role in ("color", "height"):
        shown = evaluated(document.getNodeGraph("maps_a_wall").getNode(f"{role}_image"), uv, folder / "out")
        wanted = endless(folder, role).tile(0, Window.sized(-40, -40, 200, 150), Session())
        np.testing.assert_allclose(255 * shown, wanted, atol=0.01)


def endless(folder: Path, role: str) -> OpenTexture:
    """The plane of an atlas, as an .oiiotex file shows it."""
    document = folder / f"{role}.oiiotex"
    document.write_text(json.dumps({"oiiotex": 1, "tiles": f"{role}.png", "size": "4096x4096", "seed": 3}))
    return OpenTexture(read_texture_file(str(document)).text(), Session(budget=1 << 28))


def test_usd_shows_an_ordinary_tile_in_its_real_size(folder):
    pxr = pytest.importorskip("pxr.UsdShade", reason="NOT RUN: no usd-core")
    from pxr import Usd

    path = folder / "out/a wall.usda"
    assert usd_faults(path) == []
    stage = Usd.Stage.Open(str(path))
    surface = pxr.Material(stage.GetDefaultPrim()).ComputeSurfaceSource()[0]
    texture = pxr.Shader(surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source.GetPrim())
    assert texture.GetInput("file").Get().path == "./a wall_tile_color.png"
    scaled = pxr.Shader(texture.GetInput("st").GetConnectedSources()[0][0].source.GetPrim())
    assert scaled.GetIdAttr().Get() == "UsdTransform2d" and scaled.GetInput("scale").Get() == (0.5, 2)
    tile, turned, given = (
        oiio.ImageBuf(str(folder / name)).get_pixels(oiio.UINT8).astype(int)
        for name in ("out/a wall_tile_color.png", "out/a wall_tile_normal.png", "normal.png")
    )
    np.testing.assert_array_equal(turned, np.abs(given[:TILE, :TILE] - [0, 255, 0]))  # y upwards
    assert tile.shape == (TILE, TILE, 3)
    assert "references = @./a wall.mtlx@</MaterialX/Materials/a_wall>" in path.read_text()


@needs_glslang
@pytest.mark.parametrize("flipped", ["", "#define WANG_FLIPPED\n"])
def test_functions_for_engines_compile(tmp_path, flipped):
    head = f"#version 300 es\nprecision highp float;\n{flipped}"
    main = "uniform sampler2D a, p; in vec2 uv; out vec4 c; void main() { c = sample_wang(a, p, 4.0, uv); }"
    assert compiled(head + shader("sample_wang.glsl") + main, "frag", tmp_path) == ""
    main = (
        "Texture2D a; Texture2D p; SamplerState s;"
        "float4 main(float2 uv : TEXCOORD0) : SV_Target { return sample_wang(a, s, p, 4.0, uv); }"
    )
    flags = ["-D", "-e", "main", "-S", "frag", "-V", "-o", "/dev/null"]
    assert compiled(flipped + shader("sample_wang.hlsl") + main, "hlsl", tmp_path, *flags) == ""
    assert "sample_wang" in compiled(flipped + main, "hlsl", tmp_path, *flags)


def test_a_browser_draws_the_pixels_of_an_endless_texture(folder):
    """The same GLSL as engines use, on software GL: equal within 1/255 on 99.9 %, and as sharp as the tiles."""
    texture = endless(folder, "color")
    with chromium(DRAWING) as browser:
        page = browser.new_page()
        page.add_init_script("window.held = true")  # no animation, which takes minutes on a CPU
        faults = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto((folder / "out/a wall.html").as_uri())
        page.wait_for_selector("html[data-ready]", state="attached", timeout=120_000)
        for left, top in ((0, 0), (-40, 4000)):  # the second across the period's border
            shown = np.array(page.evaluate(f"pixels(2, {left}, {top}, 200, 150)"), np.uint8).reshape(150, 200, 4)
            wanted = texture.tile(0, Window.sized(left, top, 200, 150), Session())
            apart = np.abs(shown[..., :3].astype(int) - wanted.astype(int)).max(-1)
            assert (apart <= 1).mean() >= 0.999
        ways = [np.array(page.evaluate(f"pixels({way}, 0, 0, 200, 150)"), float).reshape(150, 200, 4) for way in (1, 2)]
        hexagons, wang = (sharpness(way[..., 1]) for way in ways)
        tiles = sharpness(oiio.ImageBuf(str(folder / "color.png")).get_pixels(oiio.UINT8)[..., 1].astype(float))
        assert wang >= 0.97 * tiles and hexagons < 0.9 * tiles
        assert faults == []


def test_wgsl_compiles_in_a_browser(folder):
    with chromium(DRAWING) as browser:
        page = browser.new_page()
        page.goto((folder / "out/a wall_tile_color.png").as_uri())  # a page of a secure context
        script = """async text => {
          const adapter = await navigator.gpu?.requestAdapter();
          const device = await adapter?.requestDevice();
          const module = device?.createShaderModule({code: text});
          return module ? (await module.getCompilationInfo()).messages.map(m => m.message) : null;
        }"""
        told = page.evaluate(script, shader("sample_wang.wgsl"))
        if told is None:
            pytest.skip("NOT RUN: Chromium has no WebGPU adapter")
        assert told == []
        assert page.evaluate(script, shader("sample_wang.wgsl").replace("floor", "flor")) != []


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["color=a.png"], "a.png is not an atlas"),
        (["color=two.exr"], "two.exr has 2 parts: expected only the atlas"),
        (["color=color.png", "normal=small.png"], "small.png does not have the size of .*color.png"),
        (["color=color.png", "normal=roughness.png"], "roughness.png has 1 channels: expected a normal map"),
        (["color=first.png", "normal=later.png"], "later.png and first.png are from different runs"),
        (["color=color.png", "arm=color.png"], "arm=color.png: expected ROLE=FILE, once for each of color"),
        (["color=color.png", "--relief", "0.1"], "--relief 0.1: requires height=FILE"),
        (["normal=normal.png"], "normal: expected color=FILE"),
        (["color"], "color: expected ROLE=FILE, once for each of color, normal"),
        (["color=color.png", "--size", "2x0"], "--size 2x0: expected WIDTHxHEIGHT"),
        (["color=color.png", "--relief", "nan"], "--relief nan: expected a number >= 0"),
        (["color=color.png", "--seed", "4294967296"], "--seed 4294967296: expected an integer from 0 to 4294967295"),
        (["color=color.png", "--name", "../up"], "--name '../up': expected a printable name of at most 200 bytes"),
    ],
)
def test_what_cannot_be_delivered_is_one_line(folder, monkeypatch, words, says):
    monkeypatch.chdir(folder)
    for name, grid in (("a.png", "3x3"), ("small.png", "4x4")):
        image = buffer(np.zeros((32, 32, 3)), oiio.UINT8)
        image.specmod().attribute("oiiotex:atlas", grid)
        image.write(name)
    for name, source in (("first.png", "color.png"), ("later.png", "normal.png")):
        image = oiio.ImageBuf(source)
        image.specmod().attribute("oiiotex:parameters", f"seed={len(source)}")
        image.write(name)
    subprocess.run([OIIOTOOL, "color.png", "color.png", "--siappend", "-o", "two.exr"], check=True)
    with pytest.raises(errors.Error, match=says):
        run(["wang", "nowhere", *words])
    assert not Path("nowhere").exists()
