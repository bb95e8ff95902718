# SPDX-License-Identifier: Apache-2.0
"""Small images of all kinds, for chains that are run through oiiotool and through oiiotex."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from tests.conftest import save
from tests.pictures import bricks, noise, smooth_noise


def write_inputs(folder: Path) -> Path:
    """Write them all; returns the folder.

    rgb.exr (half), rgb8.png, rgba8.png, rgba.exr (float, window within a larger display window), b.exr (like it, but
    elsewhere), gray.exr (half), two.exr, five.exr (RGBA and Z), far.exr (the same, other depths), nan.exr, parts.exr.
    """
    color = bricks(24, 40, 1)
    alpha = np.clip(1.6 * smooth_noise(24, 40, 6, 2) - 0.3, 0, 1)
    depth = 1 + 5 * smooth_noise(24, 40, 5, 3)
    depth[:4] = 0
    wide = color * 3 - 0.4
    save(wide, folder / "rgb.exr", "half")
    save(color, folder / "rgb8.png")
    save(np.dstack([color, alpha]), folder / "rgba8.png")
    rgba = np.dstack([wide * alpha[..., None], alpha])
    save(rgba, folder / "rgba.exr", "float", x=5, y=-3, full_x=0, full_y=0, full_width=48, full_height=32)
    save(
        rgba[::-1, ::-1] * 0.7, folder / "b.exr", "float", x=-4, y=6, full_x=-4, full_y=0, full_width=50, full_height=30
    )
    save(smooth_noise(24, 40, 4, 4)[..., None], folder / "gray.exr", "half", x=2, y=1)
    save(np.dstack([wide[..., 0], noise(24, 40, 5)]), folder / "two.exr", "float")
    _save_named(np.dstack([rgba, depth]), folder / "five.exr", "R,G,B,A,Z")
    _save_named(np.dstack([rgba[::-1], 7 - depth]), folder / "far.exr", "R,G,B,A,Z")
    broken = wide.copy()
    broken[3, 4, 1] = broken[0, 0] = broken[23, 39, 2] = np.nan
    broken[10, 0, 0], broken[12, 20, 2] = np.inf, -np.inf
    save(broken, folder / "nan.exr", "float", x=3, y=2)
    save(broken, folder / "nanhalf.exr", "half")
    _save_parts([wide, color[::-1]], folder / "parts.exr")
    return folder


def _save_named(pixels: np.ndarray, path: Path, names: str) -> None:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.channelnames = tuple(names.split(","))
    spec.alpha_channel = next((n for n, c in enumerate(spec.channelnames) if c == "A"), -1)
    spec.z_channel = next((n for n, c in enumerate(spec.channelnames) if c == "Z"), -1)
    spec.attribute("Artist", "who")
    spec.attribute("Orientation", 3)
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels, np.float32))
    assert buffer.write(str(path)), buffer.geterror()


def _save_parts(pictures: list[np.ndarray], path: Path) -> None:
    specs = [oiio.ImageSpec(p.shape[1], p.shape[0], p.shape[2], oiio.HALF) for p in pictures]
    for n, spec in enumerate(specs):
        spec.attribute("oiio:subimagename", f"layer{n}")
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), tuple(specs)), out.geterror()
    for n, picture in enumerate(pictures):
        assert n == 0 or out.open(str(path), specs[n], "AppendSubimage"), out.geterror()
        assert out.write_image(np.ascontiguousarray(picture, np.float32)), out.geterror()
    out.close()
