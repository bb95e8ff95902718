# SPDX-License-Identifier: Apache-2.0
"""A sphere rendered by the GLSL that MaterialX generates from a delivered document.

MaterialX's wheel contains a renderer, which needs OpenGL and a display; without one, Xvfb is started. It runs in a
separate process, because a graphics driver can end its process. Its image loader reads only 8-bit files.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from oiiotex.engine.deferred import np, oiio
from oiiotex.engine.errors import Error, one_line, present

from ..api.images import Image, Resources, decoded, encoded
from ..api.lines import program, start, start_python
from ..api.materials import GROUND, LIGHTS, SKY
from .documents import loaded_libraries, materialx
from .naming import COLORS
from .preview import linear_of, reduced, values

_MOST = 1024  # px; longest side of a map
_AROUND, _HIGH = 96, 48  # faces of the sphere
_FINE = 2  # supersampling
_TIMEOUT = 120  # s
_SKY_ROWS, _SAMPLES = 16, 16
# Mesa's anisotropic filter blurs the magnified index image of Wang tiles, and MaterialX requests it for every image
_PLAIN_FILTER = {"MESA_EXTENSION_OVERRIDE": "-GL_EXT_texture_filter_anisotropic -GL_ARB_texture_filter_anisotropic"}


def shaded_sphere(
    document: Path,
    maps: Mapping[str, Image],
    resources: Resources,
    side: int,
    tile: tuple[float, float] = (1.0, 1.0),
    columns: int = 1,
) -> np.ndarray:
    """The first material of a document on a sphere with four tiles around: linear Rec. 709, (side, side, 4).

    Parameters
    ----------
    document : Path
        Its files are replaced by 8-bit copies of the maps of their roles; others are read as they are.
    maps : mapping of role to Image
    side : int
        Size of the picture, px.
    tile : (float, float)
        Width and height of a tile in units of texture coordinates.
    columns : int
        Tiles along a side of the maps.

    Returns
    -------
    (side, side, 4) float32
        The last channel is 1 on the sphere.

    Raises
    ------
    Error
        There is neither a display nor Xvfb, or MaterialX or OpenGL fails.
    """
    mx = materialx()
    with tempfile.TemporaryDirectory(prefix="oiiotex") as text, _display() as environment:
        work = Path(text)
        content = mx.createDocument()
        mx.readFromXmlFile(content, str(document))
        content.setColorSpace("lin_rec709")  # of the picture
        for one in content.traverseTree():
            if one.isA(mx.Input) and one.getType() == "filename" and one.getValueString():
                role = PurePosixPath(one.getValueString()).stem
                if role not in maps:
                    one.setValueString(str(document.parent / one.getValueString()))
                    continue
                picture = linear_of(maps[role].first, resources) if role in COLORS else values(maps[role])
                picture = np.clip(reduced(picture, _MOST, columns), 0, 1)
                _write_png(encoded(picture) if role in COLORS else picture, work / f"{role}.png")
                one.setValueString(str(work / f"{role}.png"))
                one.setColorSpace("srgb_texture" if role in COLORS else "none")
        mx.writeToXmlFile(content, str(work / "shaded.mtlx"))
        (work / "sphere.obj").write_text(_sphere(*tile))
        words = str(work), str(document.parent), str(_FINE * side)
        process = start_python(
            __name__, *words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        try:
            said, _ = process.communicate(timeout=_TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            said = process.communicate()[0] + f"\nno picture within {_TIMEOUT} s"
        if process.returncode or not (work / "shaded.png").is_file():
            last = one_line(said.strip().splitlines()[-1] if said.strip() else f"exit code {process.returncode}")
            raise Error(f"{document.name}: MaterialX cannot render it: {last}; set shader = false")
        shown = present(oiio.ImageBuf(str(work / "shaded.png")).get_pixels(oiio.FLOAT))[..., :3]
    at = np.abs((np.arange(_FINE * side) + 0.5) / (_FINE * side) * 2.1 - 1.05)
    inside = (np.hypot(*np.meshgrid(at, at)) < 1).astype(np.float32)[..., None]
    picture = np.concatenate([decoded(shown) * inside, inside], axis=-1)
    return picture.reshape(side, _FINE, side, _FINE, 4).mean((1, 3))


@contextlib.contextmanager
def _display() -> Iterator[dict[str, str]]:
    """The environment of a process with a display, for a block."""
    environment = {**os.environ, **_PLAIN_FILTER}
    if sys.platform != "linux" or os.environ.get("DISPLAY"):
        yield environment
        return
    server = program("Xvfb")
    if server is None:
        raise Error("shader = true requires a display, or Xvfb (apt install xvfb); install it, or set shader = false")
    words = [server, "-displayfd", "1", "-screen", "0", "64x64x24", "-nolisten", "tcp"]
    process = start(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        number = present(process.stdout).readline().strip()
        if not number:
            raise Error("Xvfb does not start; set shader = false")
        yield environment | {"DISPLAY": f":{number}"}
    finally:
        process.terminate()
        process.wait()
        present(process.stdout).close()


def _sphere(width: float, height: float) -> str:
    """A unit sphere as OBJ, with four tiles around and two from pole to pole; the seam is at the back."""
    lines = []
    for row in range(_HIGH + 1):
        for column in range(_AROUND + 1):
            down, turn = np.pi * row / _HIGH, 2 * np.pi * column / _AROUND - np.pi
            point = f"{np.sin(down) * np.sin(turn):.6f} {np.cos(down):.6f} {np.sin(down) * np.cos(turn):.6f}"
            u, v = 4 * width * column / _AROUND, 2 * height * (1 - row / _HIGH)
            lines += [f"v {point}", f"vn {point}", f"vt {u:.6f} {v:.6f}"]

    def corner(row: int, column: int) -> str:
        return "/".join([str(row * (_AROUND + 1) + column + 1)] * 3)

    for row in range(_HIGH):
        for column in range(_AROUND):
            a, b, c, d = (corner(row + y, column + x) for y, x in ((0, 0), (1, 0), (1, 1), (0, 1)))
            lines += [f"f {a} {b} {c}", f"f {a} {c} {d}"]
    return "\n".join(lines)


def _write_png(picture: np.ndarray, path: Path) -> None:
    pixels = np.rint(255 * picture).astype(np.uint8)
    buffer = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.UINT8))
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels))
    if not buffer.write(str(path)):
        raise Error(f"{path}: {buffer.geterror()}")


# --- in its own process ---


def _render(work: Path, folder: str, side: int) -> None:
    """Render `shaded.mtlx` of a folder to `shaded.png`. `folder`: of the document, with its GLSL."""
    mx = materialx()
    from MaterialX import PyMaterialXGenGlsl, PyMaterialXGenShader, PyMaterialXRender, PyMaterialXRenderGlsl

    document = mx.createDocument()
    mx.readFromXmlFile(document, str(work / "shaded.mtlx"))
    document.setDataLibrary(loaded_libraries())
    renderer = PyMaterialXRenderGlsl.GlslRenderer.create(side, side, PyMaterialXRender.BaseType.UINT8)
    renderer.initialize()
    search = mx.getDefaultDataSearchPath()
    search.append(folder)
    images = PyMaterialXRenderGlsl.GLTextureHandler.create(PyMaterialXRender.StbImageLoader.create())
    renderer.setImageHandler(images)
    shapes = renderer.getGeometryHandler()
    shapes.addLoader(PyMaterialXRender.TinyObjLoader.create())
    shapes.loadGeometry(mx.FilePath(str(work / "sphere.obj")), False)
    generator = PyMaterialXGenGlsl.GlslShaderGenerator.create()
    generator.registerTypeDefs(document)
    context = PyMaterialXGenShader.GenContext(generator)
    context.registerSourceCodeSearchPath(search)
    colors = PyMaterialXGenShader.DefaultColorManagementSystem.create(generator.getTarget())
    colors.loadLibrary(document)
    generator.setColorManagementSystem(colors)
    options = context.getOptions()
    options.hwSpecularEnvironmentMethod = PyMaterialXGenShader.HwSpecularEnvironmentMethod.SPECULAR_ENVIRONMENT_FIS
    options.fileTextureVerticalFlip = True
    options.hwSrgbEncodeOutput = False  # the framebuffer does it
    options.hwMaxActiveLightSources = len(LIGHTS)
    renderer.setLightHandler(_lights(document, context))
    camera, at, axis = renderer.getCamera(), mx.Vector3(0, 0, 5), mx.Vector3(0, 1, 0)
    camera.setViewMatrix(PyMaterialXRender.Camera.createViewMatrix(at, mx.Vector3(0, 0, 0), axis))
    camera.setProjectionMatrix(PyMaterialXRender.Camera.createOrthographicMatrix(-1.05, 1.05, -1.05, 1.05, 0.1, 20))
    renderer.createProgram(generator.generate("shaded", document.getMaterialNodes()[0], context))
    renderer.render()
    images.saveImage(mx.FilePath(str(work / "shaded.png")), renderer.captureImage(None), True)


def _lights(document: Any, context: Any) -> Any:
    """The lights and the sky of the previews without a renderer."""
    mx = materialx()
    from MaterialX import PyMaterialXRender

    handler, lights = PyMaterialXRender.LightHandler.create(), []
    for number, (towards, strength) in enumerate(LIGHTS):
        light = document.addNode("directional_light", f"light{number}", "lightshader")
        light.setInputValue("direction", mx.Vector3(*(-n / float(np.linalg.norm(towards)) for n in towards)))
        light.setInputValue("color", mx.Color3(1, 1, 1))
        light.setInputValue("intensity", float(strength))
        lights.append(light)
    handler.registerLights(document, lights, context)
    handler.setLightSources(lights)
    sky = PyMaterialXRender.Image.create(1, _SKY_ROWS, 3, PyMaterialXRender.BaseType.FLOAT)
    sky.createResourceBuffer()
    for row in range(_SKY_ROWS):
        value = GROUND + (SKY - GROUND) * (0.5 + 0.5 * np.cos(np.pi * (row + 0.5) / _SKY_ROWS))
        sky.setTexelColor(0, row, mx.Color4(value, value, value, 1))
    handler.setEnvRadianceMap(sky)
    handler.setEnvIrradianceMap(sky)
    handler.setEnvSampleCount(_SAMPLES)
    return handler


if __name__ == "__main__":
    _render(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
