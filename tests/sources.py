# SPDX-License-Identifier: Apache-2.0
"""Small image files with everything that geometry can get wrong: windows, types, alpha, several parts, orientation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex.engine.core.window import Window


def write(path: Path, *specs: oiio.ImageSpec, seed: int = 0) -> None:
    """Write random pixels, some beyond 1 or below 0 where the type holds them."""
    random = np.random.default_rng(seed)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), specs) if len(specs) > 1 else output.open(str(path), specs[0]), output.geterror()
    for number, spec in enumerate(specs):
        if number:
            assert output.open(str(path), spec, "AppendSubimage"), output.geterror()
        pixels = random.random((spec.height, spec.width, spec.nchannels), np.float32)
        if spec.format in (oiio.TypeDesc("float"), oiio.TypeDesc("half")):
            pixels = pixels * 3 - 0.5
            if spec.alpha_channel >= 0:
                pixels[..., spec.alpha_channel] = random.integers(0, 3, pixels.shape[:2]) / 2
        assert output.write_image(np.ascontiguousarray(pixels)), output.geterror()
    output.close()


def spec_of(data: Window, display: Window | None = None, channels: int = 3, type: str = "float") -> oiio.ImageSpec:
    """A spec with these windows."""
    display = display or data
    spec = oiio.ImageSpec(data.width, data.height, channels, type)
    spec.x, spec.y = data.left, data.top
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = *display[:2], display.width, display.height
    return spec


def _renamed(spec: oiio.ImageSpec, names: str) -> oiio.ImageSpec:
    spec.channelnames = tuple(names)
    spec.alpha_channel = -1
    return spec


def sources(folder: Path) -> Path:
    """Write them all.

    plain.tif uint8 RGB; alpha.exr half RGBA; inset.exr float, data inside the display window, both off the origin;
    over.exr half RGBA overscan with negative origin; origin.exr inset, display window at the origin; gray.tif
    uint16; parts.exr three parts; turned5.tif and others by their Orientation; st.exr coordinates; dark.exr mostly 0;
    four.exr and five.exr with channels of no meaning; tiled.tif.
    """
    display = Window.sized(0, 0, 31, 23)
    write(folder / "plain.tif", spec_of(Window.sized(0, 0, 37, 23), type="uint8"), seed=1)
    write(folder / "alpha.exr", spec_of(display, channels=4, type="half"), seed=2)
    write(folder / "inset.exr", spec_of(Window.sized(3, 9, 20, 13), Window.sized(-2, 5, 33, 27)), seed=3)
    write(folder / "over.exr", spec_of(display.grown(5, 3), display, 4, "half"), seed=4)
    write(folder / "origin.exr", spec_of(Window.sized(3, 4, 20, 13), display), seed=5)
    write(folder / "gray.tif", spec_of(Window.sized(0, 0, 19, 31), channels=1, type="uint16"), seed=6)
    named = [spec_of(display), spec_of(Window.sized(2, 1, 11, 17), display, 4, "half"), spec_of(display, channels=1)]
    for name, spec in zip(("first", "second", "third"), named, strict=True):
        spec.attribute("oiio:subimagename", name)
    write(folder / "parts.exr", *named, seed=7)
    for orientation in range(1, 9):
        spec = spec_of(Window.sized(0, 0, 17, 11), type="uint8")
        spec.attribute("Orientation", orientation)
        write(folder / f"turned{orientation}.tif", spec, seed=8)
    write(folder / "four.exr", _renamed(spec_of(display, channels=4), "RGBX"), seed=10)
    write(folder / "five.exr", _renamed(spec_of(display, channels=5), "RGBXY"), seed=11)
    tiled = spec_of(Window.sized(0, 0, 37, 23), type="uint8")
    tiled.tile_width = tiled.tile_height = 16
    buffer = oiio.ImageBuf(tiled)
    oiio.ImageBufAlgo.noise(buffer, "uniform", 0.1, 0.9)
    buffer.write(str(folder / "tiled.tif"))
    st = spec_of(Window.sized(1, 2, 31, 22), display)
    write(folder / "st.exr", st, seed=9)
    dark = oiio.ImageBuf(spec_of(Window.sized(2, 1, 21, 17), display))
    oiio.ImageBufAlgo.zero(dark)
    oiio.ImageBufAlgo.render_box(dark, 7, 5, 14, 9, (0.25, 0, -1))
    dark.write(str(folder / "dark.exr"))
    return folder
