# SPDX-License-Identifier: Apache-2.0
"""Procedural textures that the tests make: (height, width, 3) floats in 0 .. 1, the same for a seed on any machine."""

from __future__ import annotations

import atexit
import functools
import shutil
import tempfile
from pathlib import Path

import numpy as np

from oiiotex.synthesis.patchmatch.field import hash_at


def noise(height: int, width: int, seed: int, step: int = 0) -> np.ndarray:
    """White noise in 0 .. 1 from a counter-based hash, (height, width)."""
    y, x = np.mgrid[0:height, 0:width]
    return hash_at(seed, step, y, x) / 2.0**32


def smooth_noise(height: int, width: int, cell: int, seed: int, step: int = 0) -> np.ndarray:
    """Noise interpolated between points `cell` px apart, (height, width)."""
    points = noise(height // cell + 2, width // cell + 2, seed, step)
    y, x = np.mgrid[0:height, 0:width] / cell
    j, i = y.astype(int), x.astype(int)
    v, u = y - j, x - i
    top = points[j, i] * (1 - u) + points[j, i + 1] * u
    bottom = points[j + 1, i] * (1 - u) + points[j + 1, i + 1] * u
    return top * (1 - v) + bottom * v


def bricks(height: int, width: int, seed: int) -> np.ndarray:
    """A wall: courses of 8 px, bricks of 16 px, light mortar, every brick of its own shade."""
    y, x = np.mgrid[0:height, 0:width]
    course = y // 8
    along = x + 8 * (course % 2)
    shade = 0.35 + 0.3 * hash_at(seed, 1, course, along // 16) / 2.0**32
    mortar = (y % 8 < 1) | (along % 16 < 1)
    gray = np.where(mortar, 0.75, shade) + 0.08 * (noise(height, width, seed, 2) - 0.5)
    return np.clip(gray[..., None] * [1.0, 0.7, 0.55], 0, 1)


def pebbles(height: int, width: int, seed: int) -> np.ndarray:
    """Round stones on a jittered grid, shaded towards their rims."""
    y, x = np.mgrid[0:height, 0:width]
    cell = 12
    best = np.full((height, width), np.inf)
    shade = np.zeros((height, width))
    for dj in (-1, 0, 1):
        for di in (-1, 0, 1):
            j, i = y // cell + dj + 1, x // cell + di + 1
            cy = (j - 0.5 + 0.6 * (hash_at(seed, 3, j, i) / 2.0**32 - 0.5)) * cell
            cx = (i - 0.5 + 0.6 * (hash_at(seed, 4, j, i) / 2.0**32 - 0.5)) * cell
            away = np.hypot(y - cy, x - cx)
            shade = np.where(away < best, 0.3 + 0.5 * hash_at(seed, 5, j, i) / 2.0**32, shade)
            best = np.minimum(best, away)
    gray = shade * np.clip(1.3 - best / cell, 0.15, 1.0)
    return np.clip(gray[..., None] * [1.0, 0.97, 0.9], 0, 1)


def moss(height: int, width: int, seed: int) -> np.ndarray:
    """Green tufts of two sizes."""
    fine, coarse = smooth_noise(height, width, 3, seed, 6), smooth_noise(height, width, 9, seed, 7)
    gray = 0.2 + 0.5 * fine * coarse + 0.15 * noise(height, width, seed, 8)
    return np.clip(gray[..., None] * [0.6, 1.0, 0.35], 0, 1)


def stained(picture: np.ndarray) -> np.ndarray:
    """A gradient of light and a stain over a picture."""
    height, width = picture.shape[:2]
    y, x = np.mgrid[0:height, 0:width]
    y, x = y / height, x / width
    light = 1.25 - 0.5 * (x + y) / 2
    spill = np.exp(-((((x - 0.65) / 0.18) ** 2 + ((y - 0.4) / 0.15) ** 2) ** 2))
    return np.clip(picture * light[..., None] * (1 - spill[..., None] * (1 - np.array([0.8, 0.55, 0.35]))), 0, 1)


def cube_obj(side: float = 1.0) -> str:
    """A cube as the text of an OBJ: six charts, one for each side, a gap between them."""
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = [f"v {side * x} {side * y} {side * z}" for x, y, z in corners]
    for n, around in enumerate(sides):
        left, low = n % 3 / 3 + 0.02, n // 3 / 2 + 0.02
        lines += [f"vt {left + u * 0.29:.6f} {low + v * 0.29:.6f}" for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))]
        point, at = [c + 1 for c in around], [4 * n + k + 1 for k in range(4)]
        lines += [" ".join(["f", *(f"{point[k]}/{at[k]}" for k in three)]) for three in ((0, 1, 2), (0, 2, 3))]
    return "\n".join(lines) + "\n"


@functools.cache
def cube_file() -> Path:
    """The cube in a file that lies as long as the tests run."""
    folder = tempfile.mkdtemp(prefix="oiiotex-cube-")
    atexit.register(shutil.rmtree, folder, True)
    path = Path(folder) / "cube.obj"
    path.write_text(cube_obj())
    return path
