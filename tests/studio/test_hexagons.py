# SPDX-License-Identifier: Apache-2.0
"""Planes of hexagons: the histogram stays, nothing repeats, and every language draws the plane of `blended`."""

from __future__ import annotations

import json

import numpy as np
import pytest
from oiiotex_studio.library.catalog import Catalog
from oiiotex_studio.library.hexes import LEAST, hex_measures, write_hexes
from oiiotex_studio.library.upkeep import check
from oiiotex_studio.materials.documents import Described, materialx_faults, write_materialx
from oiiotex_studio.materials.hexagons import blended, gaussianized, hexagons, judged
from oiiotex_studio.recipes.recipe import Deliver

from oiiotex.engine.core.image import from_array, tagged
from oiiotex.engine.errors import ParameterError
from oiiotex.engine.session import Session
from oiiotex.synthesis.wang.viewer import shader
from tests import pictures
from tests.any_filter import buffer
from tests.browser import DRAWING, chromium
from tests.conftest import load, save
from tests.library_makings import LINE, brought_in, recipe
from tests.library_makings import here as here
from tests.reference.materialx_graphs import evaluated
from tests.studio.test_wang_renderers import RASTER, compiled, generated, needs_glslang

SIDE = 64
LINEAR, SRGB = "lin_rec709_scene", "srgb_rec709_scene"


def places(left: float, top: float, count: int, step: float = 1 / SIDE) -> tuple[np.ndarray, np.ndarray]:
    """Places in tiles, (count, count)."""
    steps = (np.arange(count) + 0.5) * step
    return tuple(np.meshgrid(left + steps, top + steps))


@pytest.fixture(scope="module")
def moss():
    return pictures.moss(SIDE, SIDE, 3).astype(np.float32)


@pytest.fixture(scope="module")
def delivered(tmp_path_factory, moss):
    """A material with its documents and hexagons: the folder, and the tiles."""
    folder = tmp_path_factory.mktemp("hexagons")
    maps = {
        "color": moss, "roughness": moss[..., :1] ** 2, "normal": 0.5 + 0.2 * (moss - 0.5),
        "opacity": moss[..., 1:2], "gloss": moss[..., 2:],
    }  # fmt: skip
    images = {role: tagged(from_array(np.ascontiguousarray(one)), LINEAR) for role, one in maps.items()}
    hexes = write_hexes(images, folder, LINEAR, Session().resources)
    for role, one in maps.items():
        assert buffer(one).write(str(folder / f"{role}.exr"))
    files = {role: f"{role}.exr" for role in maps}
    described = Described("a moss", files, LINEAR, "directx", hexes=hexes, tile_m=(2.0, 0.5))
    write_materialx(described, folder)
    return folder, maps


# --- the plane ---


def test_the_histogram_stays(moss):
    """As HN18 promises; plain blending of as many pieces loses contrast."""
    u, v = places(100.0, -40.0, 4 * SIDE)
    plane = blended(gaussianized(moss), u, v)
    at = np.linspace(0.01, 0.99, 50)
    apart = np.abs(np.quantile(plane, at, axis=(0, 1)) - np.quantile(moss, at, axis=(0, 1)))
    assert apart.max() < 0.06 * np.ptp(moss)
    assert plane.std() == pytest.approx(moss.std(), rel=0.05)


def test_where_one_hexagon_is_alone_the_tile_is_seen(moss):
    """At the center of a hexagon the others weigh nothing, and a table undoes what made the values Gaussian."""
    tile = gaussianized(moss)
    np.testing.assert_allclose(tile.values(tile.gaussian), moss, atol=0.02)
    names, weights = hexagons(np.array([0.0]), np.array([0.0]))
    assert sorted(weights[:, 0]) == pytest.approx([0, 0, 1], abs=1e-6)
    assert [0, 0] in names[:, 0].tolist()


def test_the_plane_has_no_period(moss):
    """Nothing of the tile is found again a tile, or two hexagons, further; a repeated tile is."""
    u, v = places(3.0, 5.0, 4 * SIDE)
    plane = blended(gaussianized(moss), u, v)[..., 1]
    plane = plane - plane.mean()
    spectrum = np.abs(np.fft.rfft2(plane)) ** 2
    alike = np.fft.irfft2(spectrum, plane.shape)
    alike /= alike[0, 0]
    far = np.hypot(*np.meshgrid(*[np.minimum(np.arange(4 * SIDE), 4 * SIDE - np.arange(4 * SIDE))] * 2)) > SIDE / 2
    assert alike[far].max() < 0.3
    assert not np.allclose(plane[:SIDE, :SIDE], plane[SIDE : 2 * SIDE, :SIDE], atol=0.05)


def test_a_slot_changes_only_where_it_weighs_nothing():
    """So that derivatives between pixels are right: in steps of a hundredth of a hexagon."""
    u, v = places(-2.0, 7.0, 1500, 1 / 700)
    names, weights = hexagons(u, v)
    for axis in (1, 2):
        changes = np.diff(names, axis=axis).any(-1)
        lower = np.minimum(*(np.take(weights, range(n, weights.shape[axis] - 1 + n), axis) for n in (0, 1)))
        assert changes.any() and lower[changes].max() < 1e-9


@pytest.mark.parametrize("kind, right", [("moss", True), ("pebbles", True), ("bricks", False), ("stripes", False)])
def test_the_judge_says_which_tiles_are_right(kind, right):
    """Those without lines, whose objects are small compared with hexagons. Stripes are cut everywhere."""
    if kind == "stripes":
        light = np.tile(0.5 + 0.4 * np.sin(np.arange(256) / 256 * 2 * np.pi * 8), (256, 1))
    else:
        light = getattr(pictures, kind)(256, 256, 1)
    picture = np.broadcast_to(light if light.ndim == 3 else light[..., None], (256, 256, 3))
    found = hex_measures(tagged(from_array(np.ascontiguousarray(picture, np.float32)), SRGB), Session().resources)
    assert (found["hex_fidelity"] >= LEAST) == right, found


def test_a_small_tile_is_not_judged():
    assert judged(np.zeros((40, 40, 3), np.float32)) is None


# --- what renderers get ---


def test_the_graph_gives_the_plane(delivered):
    """Within 1/255, also far away: color, a gray map, one that is converted, and normals without a table."""
    mx = pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    folder, maps = delivered
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(folder / "a moss_standard.mtlx"))
    graph = document.getNodeGraph("maps_a_moss_hextiled")
    u, v = places(-3.0, 1000.0, 40)
    uv = np.stack([2 * u, -0.5 * v], -1)  # a tile is 2 x 0.5 units
    for role in ("color", "roughness", "opacity"):
        shown = evaluated(graph.getNode(graph.getOutput(role).getNodeName()), uv, folder)
        wanted = blended(gaussianized(maps[role]), u, v)
        np.testing.assert_allclose(shown, np.broadcast_to(wanted, shown.shape), atol=1 / 255)
    assert materialx_faults(folder / "a moss.mtlx") == []


@pytest.mark.parametrize("target", [*RASTER, "osl", "mdl", "msl", "slang"])
def test_every_language_is_generated(delivered, tmp_path, target):
    folder, _ = delivered
    sources = generated(folder / "a moss.mtlx", target, 1)
    assert target == "mdl" or sources[0].count("cellnoise2d") >= 6
    for text, stage in zip(sources, ("frag", "vert"), strict=False):
        if target in RASTER:
            flags = ["-V", "--auto-map-locations", "--auto-map-bindings", "-o", "/dev/null"]
            assert compiled(text, stage, tmp_path, *(flags if target in ("vulkan", "wgsl") else [])) == ""


@needs_glslang
@pytest.mark.parametrize("flipped", ["", "#define HEX_FLIPPED\n"])
def test_functions_for_engines_compile(tmp_path, flipped):
    head = f"#version 300 es\nprecision highp float;\n{flipped}"
    main = "uniform sampler2D g, t; in vec2 uv; out vec4 c; void main() { c = vec4(sample_hex(g, t, uv), 1.0); }"
    assert compiled(head + shader("sample_hex.glsl") + main, "frag", tmp_path) == ""
    main = (
        "Texture2D g; Texture2D t; SamplerState s;"
        "float4 main(float2 uv : TEXCOORD0) : SV_Target { return float4(sample_hex(g, s, t, uv), 1.0); }"
    )
    flags = ["-D", "-e", "main", "-S", "frag", "-V", "-o", "/dev/null"]
    assert compiled(flipped + shader("sample_hex.hlsl") + main, "hlsl", tmp_path, *flags) == ""


DRAW = """([glsl, gaussian, side, table, left, top, count]) => {
  const gl = document.createElement('canvas').getContext('webgl2');
  gl.getExtension('EXT_color_buffer_float'); gl.getExtension('OES_texture_float_linear');
  const program = gl.createProgram();
  const add = (kind, text) => {
    const one = gl.createShader(kind); gl.shaderSource(one, text); gl.compileShader(one);
    if (!gl.getShaderParameter(one, gl.COMPILE_STATUS)) throw gl.getShaderInfoLog(one);
    gl.attachShader(program, one);
  };
  add(gl.VERTEX_SHADER, `#version 300 es
    void main() { gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1); }`);
  add(gl.FRAGMENT_SHADER, `#version 300 es
    precision highp float; precision highp int;
    uniform sampler2D g, t; uniform vec2 corner; uniform float side; out vec4 c;
    ${glsl}
    void main() { c = vec4(sample_hex(g, t, corner + gl_FragCoord.xy / side), 1.0); }`);
  gl.linkProgram(program); gl.useProgram(program);
  const texture = (unit, width, height, values, filter) => {
    gl.activeTexture(gl.TEXTURE0 + unit); gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, new Float32Array(values));
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
  };
  texture(0, side, side, gaussian, gl.LINEAR); texture(1, 32, 3, table, gl.NEAREST);
  gl.activeTexture(gl.TEXTURE0 + 7);
  const target = gl.createTexture(); gl.bindTexture(gl.TEXTURE_2D, target);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, count, count);
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, count, count);
  gl.uniform1i(gl.getUniformLocation(program, 'g'), 0); gl.uniform1i(gl.getUniformLocation(program, 't'), 1);
  gl.uniform2f(gl.getUniformLocation(program, 'corner'), left, top);
  gl.uniform1f(gl.getUniformLocation(program, 'side'), side);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const pixels = new Float32Array(4 * count * count);
  gl.readPixels(0, 0, count, count, gl.RGBA, gl.FLOAT, pixels);
  return Array.from(pixels);
}"""


def test_a_browser_draws_the_plane(moss, tmp_path):
    """The GLSL function on software GL, within 1/255 on 99.9 % of pixels."""
    tile, count = gaussianized(moss), 96

    def rgba(values: np.ndarray) -> list[float]:
        return np.pad(values, ((0, 0), (0, 0), (0, 1))).ravel().tolist()

    (tmp_path / "page.html").write_text("<!doctype html>")
    with chromium(DRAWING) as browser:
        page = browser.new_page()
        page.goto((tmp_path / "page.html").as_uri())
        for left, top in ((0.0, 0.0), (-20.0, 300.0)):
            given = [shader("sample_hex.glsl"), rgba(tile.gaussian), SIDE, rgba(tile.shares()), left, top, count]
            shown = np.array(page.evaluate(DRAW, given)).reshape(count, count, 4)[..., :3]
            apart = np.abs(shown - blended(tile, *places(left, top, count))).max(-1)
            assert (apart <= 1 / 255).mean() >= 0.999, json.dumps([float(apart.max()), float((apart > 1 / 255).mean())])


def test_a_plane_of_hexagons_is_delivered_where_it_is_right(tmp_path, here):
    """Soil gets one, and bricks do not; both say how much of the tile it preserves."""
    photos = tmp_path / "photos"
    photos.mkdir()
    save(pictures.moss(256, 256, 1), photos / "soil_diff_1k.png")
    save(pictures.bricks(256, 256, 1), photos / "wall_diff_1k.png")
    save(pictures.moss(256, 256, 2)[..., :1], photos / "soil_rough_1k.png")
    brought_in(photos, tmp_path / "library", recipe(LINE + "[deliver]\nhex = true\ntx = false\n"))
    (soil,), (wall,) = ((tmp_path / "library").glob(f"assets/{name}/*") for name in ("soil", "wall"))
    assert {path.name for path in (soil / "hex").iterdir()} == {
        "color.exr", "color_table.exr", "roughness.exr", "roughness_table.exr",
        "sample_hex.glsl", "sample_hex.hlsl", "sample_hex.wgsl",
    }  # fmt: skip
    assert "hex/color.exr" in (soil / "soil.mtlx").read_text() and not (wall / "hex").exists()
    height, width = load(soil / "compared.jpg").shape[:2]
    assert width > 2 * height and not (wall / "compared.jpg").exists()
    assert "hextiled" not in (wall / "wall.mtlx").read_text()
    with Catalog(tmp_path / "library") as catalog:
        assert catalog.measures()["wall"]["hex_fidelity"] < 0.7 < 0.77 <= catalog.measures()["soil"]["hex_fidelity"]
        assert list(check(catalog)) == []


def test_what_conflicts_is_said():
    with pytest.raises(ParameterError, match="hex = true requires materialx = true, wang = false"):
        Deliver(hex=True, wang=True)
    with pytest.raises(ParameterError, match="hex = true"):
        Deliver(hex=True, materialx=False)
