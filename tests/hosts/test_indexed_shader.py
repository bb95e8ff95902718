# SPDX-License-Identifier: Apache-2.0
"""An indexed image in shaders: all MIP levels are those of the tile, in the textures and as a browser draws them."""

from __future__ import annotations

import base64
import re
import sys
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import util
from pathlib import Path

import numpy as np
import pytest

from oiiotex.engine.core.image import Image
from oiiotex.engine.core.piece_cache import PieceCache
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.io.reading import read
from tests.browser import DRAWING, chromium
from tests.engine.test_copies import PHOTO, material, photo, pieces, written
from tests.studio.test_wang_renderers import compiled, needs_glslang

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "hosts" / "shaders"
GLSL = (FOLDER / "sample_indexed.glsl").read_text()
_spec = util.spec_from_file_location("shader_textures", FOLDER / "textures.py")
shader_textures = sys.modules["shader_textures"] = util.module_from_spec(_spec)
_spec.loader.exec_module(shader_textures)

SIZES = {"even": (512, 256), "odd": (530, 291), "narrow": (64, 1)}
MAPS = {"map0": 3, "map1": 1, "map2": 4}  # channels
HALF = 2**-11  # of the largest value: what rounding to half may change


def boxes(values: np.ndarray) -> list[np.ndarray]:
    """All MIP levels of (height, width, channels), by integrals: any box may begin and end inside pixels."""
    levels = [values.astype(np.float64)]
    while max(levels[-1].shape[:2]) > 1:
        finer = levels[-1]
        for axis in (0, 1):
            count = finer.shape[axis]
            area = np.insert(np.cumsum(finer, axis), 0, 0, axis)
            at = np.linspace(0, count, max(1, count // 2) + 1)
            low = np.minimum(at.astype(int), count - 1)
            share = (at - low).reshape([-1 if n == axis else 1 for n in range(3)])
            ends = np.take(area, low, axis) * (1 - share) + np.take(area, low + 1, axis) * share
            finer = np.diff(ends, axis=axis) * max(1, count // 2) / count
        levels.append(finer)
    return levels


def bilinear(level: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """A level at places (n, 2) in tiles, repeated."""
    height, width = level.shape[:2]
    place = uv * (width, height) - 0.5
    corner = np.floor(place).astype(int)
    x, y = (place - corner).T[..., None]
    column, row = corner.T
    upper, lower = (
        (1 - x) * level[r % height, column % width] + x * level[r % height, (column + 1) % width]
        for r in (row, row + 1)
    )
    return (1 - y) * upper + y * lower


def filtered(levels: list[np.ndarray], uv: np.ndarray, lod: float) -> np.ndarray:
    """Values at places (n, 2) in tiles: bilinear in two levels, and linear between these."""
    low = min(int(lod), len(levels) - 1)
    high, share = min(low + 1, len(levels) - 1), lod - int(lod)
    return (1 - share) * bilinear(levels[low], uv) + share * bilinear(levels[high], uv)


@dataclass
class Tile:
    path: Path
    levels: dict[str, list[np.ndarray]]  # of the maps, as they should be


@pytest.fixture(scope="module", params=SIZES)
def tile(request, tmp_path_factory) -> Tile:
    """An indexed image of pieces, some of a single pixel, and its box-filtered levels."""
    folder = tmp_path_factory.mktemp("indexed")
    path = written(material(pieces(size=SIZES[request.param])), folder / "tile.oiiotex")
    return Tile(path, {part.name: boxes(part.pixels()) for part in read(path).parts})


# --- textures ---


def fetched(made, name: str, level: int) -> np.ndarray:
    """A level of a map as the shader fetches it: by the rules that the head of the GLSL file states."""
    index, layers = np.asarray(made.index[level]).astype(np.int64), np.asarray(made.maps[name])
    _, height, width, channels = layers.shape
    rows, columns = np.indices(index.shape) << level
    column, row = (columns + (index & 0xFFFF)) % width, (rows + (index >> 16)) % height
    number = np.where(index >> 31, index & 0x7FFFFFFF, (level * height + row) * width + column)
    return layers.reshape(-1, channels)[number]


def test_every_texel_of_every_level_is_the_mean_of_its_pixels(tile):
    made = shader_textures.textures(tile.path)
    assert len(made.index) == len(tile.levels["map0"])
    for name, levels in tile.levels.items():
        np.testing.assert_array_equal(fetched(made, name, 0), levels[0])
        for level, values in enumerate(levels):
            assert made.index[level].shape == values.shape[:2]
            np.testing.assert_allclose(fetched(made, name, level), values, atol=HALF)


def test_a_large_tile_takes_little_more_than_its_index(tmp_path):
    """Pieces of 128 px: their texels are those of the photo, filtered, and stored texels are few."""
    y, x = np.indices((1024, 1024))
    source = SourceMap.of((y + y // 128 * 11) % PHOTO[1], (x + x // 128 * 7) % PHOTO[0])
    made = shader_textures.textures(written(material(source), tmp_path / "tile.oiiotex"))
    texels = np.prod(made.maps["map0"].shape[:3])
    assert texels < 0.04 * 4 / 3 * 1024**2
    inside = [np.mean(np.asarray(level) < shader_textures.OWN) for level in made.index]
    assert inside[:5] == [1, 1, 1, 1, 1] and inside[5:] == [0] * 6  # from 32 x 32 on fewer texels than the photo has


def files_of(path: Path, folder: Path) -> dict[str, bytes]:
    shader_textures.write_textures(shader_textures.textures(path), folder)
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_bands_and_temporary_files_do_not_show(tile, tmp_path, monkeypatch):
    whole = files_of(tile.path, tmp_path / "whole")
    assert set(whole) == {"index.ktx2", *(f"{name}.ktx2" for name in MAPS)}
    monkeypatch.setattr(shader_textures, "_BAND_BYTES", 4000)  # of one row of a map, to a few of the index
    monkeypatch.setattr(shader_textures, "_HELD_BYTES", 0)
    assert files_of(tile.path, tmp_path / "bands") == whole


def test_memory_does_not_grow_with_the_tile(tmp_path, monkeypatch):
    """The index alone takes 16 MB, and a map of four channels at half the size as much."""
    y, x = np.indices((16384, 256), np.int32)
    source = SourceMap.of((y + y // 64 * 11) % PHOTO[1], (x + x // 64 * 7) % PHOTO[0])
    path, band = written(material(source), tmp_path / "tile.oiiotex"), 1 << 18
    monkeypatch.setattr(shader_textures, "_BAND_BYTES", band)
    monkeypatch.setattr(shader_textures, "_HELD_BYTES", band)
    monkeypatch.setattr(shader_textures, "read", lambda path: read(path, PieceCache(6 << 20)))
    del x, y, source
    tracemalloc.start()
    files_of(path, tmp_path / "out")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16 << 20  # 13; whole arrays take 65


@pytest.mark.parametrize(
    ("image", "text"),
    [
        (Image((photo(),)), "expected an indexed image"),
        (
            Image((pieces().parts("five", photo(5), "xy")["five"],)),
            "photo has 5 channels of type half: expected 1 to 4",
        ),
        (
            Image(tuple(replace(part, name=f"../../{part.name}") for part in material(pieces()).parts)),
            "map '../../map0': expected a printable name",
        ),
    ],
)
def test_what_has_no_textures_is_refused(tmp_path, capsys, monkeypatch, image, text):
    path = written(image, tmp_path / ("tile.exr" if "indexed" in text else "tile.oiiotex"))
    monkeypatch.setattr(sys, "argv", ["textures.py", str(path), str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        shader_textures.main()
    assert ended.value.code == 1 and text in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, capsys, monkeypatch):
    path = written(Image((pieces().parts("three", photo(3), "xy")["three"],)), tmp_path / "tile.oiiotex")
    monkeypatch.setattr(sys, "argv", ["textures.py", str(path), str(path)])
    before = path.read_bytes()
    with pytest.raises(SystemExit) as ended:
        shader_textures.main()
    assert ended.value.code == 1 and f"{path}: File exists\n" in capsys.readouterr().err
    assert path.read_bytes() == before


# --- shader ---


@needs_glslang
@pytest.mark.parametrize("version", ["300 es", "330"])
def test_the_function_compiles(tmp_path, version):
    main = """
        uniform usampler2D index; uniform sampler2DArray color; in vec2 uv; out vec4 shown;
        void main() {
            shown = indexed_value(color, indexed_texels(index, textureSize(color, 0), uv, indexed_lod(index, uv)));
        }"""
    assert compiled(f"#version {version}\n{GLSL}{main}", "frag", tmp_path) == ""


LOADER = re.search(r"```js\n(.*?)```", (ROOT / "docs/how-to/hosts.md").read_text(), re.DOTALL)[1]
DRAW = (
    LOADER
    + """
const shown = (kind, width, height) => {  // a target of a pixel type
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  const target = gl.createRenderbuffer();
  gl.bindRenderbuffer(gl.RENDERBUFFER, target);
  gl.renderbufferStorage(gl.RENDERBUFFER, kind, width, height);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, target);
  gl.viewport(0, 0, width, height);
};
const gl = document.createElement('canvas').getContext('webgl2');
gl.getExtension('EXT_color_buffer_float');
window.load = async (glsl, files) => {
  window.program = gl.createProgram();
  const add = (kind, text) => {
    const one = gl.createShader(kind);
    gl.shaderSource(one, text); gl.compileShader(one);
    if (!gl.getShaderParameter(one, gl.COMPILE_STATUS)) throw gl.getShaderInfoLog(one);
    gl.attachShader(program, one);
  };
  add(gl.VERTEX_SHADER, `#version 300 es
    void main() { gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1); }`);
  add(gl.FRAGMENT_SHADER, `#version 300 es
    ${glsl}
    uniform usampler2D index; uniform sampler2DArray map;
    uniform vec2 corner, size; uniform float lod; out vec4 c;
    void main() {
      vec2 uv = corner + gl_FragCoord.xy / size;
      float level = lod < 0.0 ? indexed_lod(index, uv) : lod;
      c = indexed_value(map, indexed_texels(index, textureSize(map, 0), uv, level));
    }`);
  gl.linkProgram(program); gl.useProgram(program);
  await Promise.all(files.map((url, unit) => loadTexture(gl, url, unit)));
  gl.uniform1i(gl.getUniformLocation(program, 'index'), 0);
};
window.draw = (unit, width, height, given, float) => {
  shown(float ? gl.RGBA32F : gl.RGBA8, width, height);
  gl.uniform1i(gl.getUniformLocation(program, 'map'), unit);
  gl.uniform2f(gl.getUniformLocation(program, 'size'), width, height);
  gl.uniform2f(gl.getUniformLocation(program, 'corner'), ...given.corner);
  gl.uniform1f(gl.getUniformLocation(program, 'lod'), given.lod);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const pixels = float ? new Float32Array(4 * width * height) : new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, float ? gl.FLOAT : gl.UNSIGNED_BYTE, pixels);
  if (gl.getError()) throw 'WebGL error';
  return btoa(Array.from(new Uint8Array(pixels.buffer), (byte) => String.fromCharCode(byte)).join(''));
};
"""
)


@pytest.fixture(scope="module")
def page(tile, tmp_path_factory) -> Iterator[object]:
    """A page that has loaded the tile's textures by the code of the docs."""
    folder = tmp_path_factory.mktemp("textures")
    shader_textures.write_textures(shader_textures.textures(tile.path), folder)
    files = [folder / f"{name}.ktx2" for name in ("index", *MAPS)]
    urls = [f"data:;base64,{base64.b64encode(file.read_bytes()).decode()}" for file in files]
    with chromium(DRAWING) as browser:
        page = browser.new_page()
        page.add_script_tag(content=DRAW)
        page.evaluate("([glsl, files]) => load(glsl, files)", [GLSL, urls])
        yield page


def drawn(page, name: str, size: tuple[int, int], floats: bool = True, **given: object) -> np.ndarray:
    """A picture of a map, (height, width, channels), from `corner` (in tiles), at a level of detail."""
    given = {"corner": (0, 0), "lod": -1} | given
    unit = 1 + list(MAPS).index(name)
    text = page.evaluate(
        "([unit, size, given, float]) => draw(unit, ...size, given, float)", [unit, size, given, floats]
    )
    values = np.frombuffer(base64.b64decode(text), np.float32 if floats else np.uint8)
    return values.reshape(size[1], size[0], 4)[..., : MAPS[name]] / (1 if floats else 255)


@pytest.mark.parametrize("name", MAPS)
def test_a_browser_draws_every_level(page, tile, name):
    """Within a quarter of 1/255 in float, and within 1/255 in 8 bits."""
    for level, values in enumerate(tile.levels[name]):
        height, width = values.shape[:2]
        shown = drawn(page, name, (width, height), lod=level)
        np.testing.assert_allclose(shown, values, atol=1 / 255 / 4)
        bytes_shown = drawn(page, name, (width, height), floats=False, lod=level)
        np.testing.assert_allclose(bytes_shown, values, atol=1 / 255)


def picture_places(corner: tuple[float, float], width: int, height: int) -> np.ndarray:
    """The centers of a picture's pixels, (n, 2) in tiles; it has the size of a tile."""
    columns, rows = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    return np.stack([corner[0] + columns, corner[1] + rows], -1).reshape(-1, 2)


@pytest.mark.parametrize("lod", [0.0, 0.3, 1.0, 2.5, 4.25, 7.75, 40.0])
def test_a_browser_filters_between_texels_and_levels(page, tile, lod):
    """Also across the tile's border."""
    levels, corner = tile.levels["map0"], (-0.4, 2.7)
    shown = drawn(page, "map0", (48, 40), corner=corner, lod=lod)
    wanted = filtered(levels, picture_places(corner, 48, 40), lod)
    np.testing.assert_allclose(shown.reshape(-1, 3), wanted, atol=1 / 255)


def test_the_level_follows_from_derivatives(page, tile):
    """Of the axis along which a pixel covers more of the tile."""
    levels, width, height = tile.levels["map0"], 50, 23
    places = picture_places((0.1, 0.2), width, height)
    lod = np.log2(max(levels[0].shape[1] / width, levels[0].shape[0] / height, 1))
    shown = drawn(page, "map0", (width, height), corner=(0.1, 0.2))
    np.testing.assert_allclose(shown.reshape(-1, 3), filtered(levels, places, lod), atol=1 / 255)
