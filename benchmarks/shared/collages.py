# SPDX-License-Identifier: Apache-2.0
"""Collages of the tests' procedural pictures, with exact truth; benchmarks.shared.mosaics has more kinds."""

from __future__ import annotations

import functools

import numpy as np
import OpenImageIO as oiio

from benchmarks.labels.levels import Case
from benchmarks.shared.measures import data_folder
from oiiotex.engine.core.image import from_buffer
from tests import pictures


def layout(side: int, count: int, seed: int) -> np.ndarray:
    """(side, side) fields 0 .. count - 1 around points, with wavy borders; every field has a fair share."""
    random = np.random.default_rng([seed, count])
    y, x = np.mgrid[0:side, 0:side] / side
    wave = 0.12 * (pictures.smooth_noise(side, side, side // 6, seed, 31) - 0.5)
    other = 0.12 * (pictures.smooth_noise(side, side, side // 6, seed, 32) - 0.5)
    while True:
        points = random.random((count, 2))
        apart = (y[..., None] + wave[..., None] - points[:, 0]) ** 2 + (
            x[..., None] + other[..., None] - points[:, 1]
        ) ** 2
        fields = apart.argmin(-1)
        if np.bincount(fields.ravel(), minlength=count).min() > 0.4 / count * side * side:
            return fields


@functools.cache
def _photo(name: str, gray: bool) -> np.ndarray:
    pixels = oiio.ImageBuf(str(data_folder() / "photos" / name)).get_pixels(oiio.FLOAT)[..., :3]
    if pixels.shape[2] == 1:
        pixels = np.repeat(pixels, 3, axis=2)
    return np.repeat(pixels.mean(-1, keepdims=True), 3, -1) if gray else pixels


def drawn_collage(seed: int, side: int = 384) -> Case:
    """Five of the tests' procedural textures."""
    fields = layout(side, 5, seed)
    looks = [p(side, side, seed) for p in (pictures.bricks, pictures.pebbles, pictures.moss)]
    looks.append(pictures.bricks(side, side, seed + 7).transpose(1, 0, 2)[..., ::-1] * 0.7)
    looks.append(pictures.pebbles(side, side, seed + 9)[..., [1, 2, 0]] ** 2)
    return _case(f"collage_drawn_{seed}", np.stack(looks)[fields, *np.mgrid[0:side, 0:side]], fields)


def _case(name: str, picture: np.ndarray, fields: np.ndarray) -> Case:
    spec = oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, oiio.FLOAT)
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(picture, np.float32))
    return Case(name, from_buffer(buffer), fields + 1)
