# SPDX-License-Identifier: Apache-2.0
"""Procedural textures on a known lattice, every cell of its own shade: (height, width, 3) floats in 0 .. 1."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from oiiotex.synthesis.patchmatch.field import hash_at
from tests.pictures import noise, stained

# shortest vectors, px, x and y; stripes have one
VECTORS: dict[str, list[list[float]]] = {
    "square": [[19.3, 0.0], [0.0, 19.3]],
    "oblique": [[22.4, 5.1], [-4.2, 17.8]],
    "hexagonal": [[21.0, 0.0], [10.5, 18.19]],
    "stripes": [[11.6, 3.2]],
    "bricks": [[27.5, 0.0], [13.75, 12.6]],
    "weave": [[12.2, 12.2], [-12.2, 12.2]],
    "courses": [[0.0, 13.4]],
    "parquet": [[16.3, 16.3], [-16.3, 16.3]],
}
_SAMPLES = 4  # of a pixel, along an axis


def _phases(name: str, y: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Cell along both vectors, and where in it, 0 to 1."""
    vectors = np.array(VECTORS[name])
    u, v = np.tensordot(np.linalg.inv(vectors).T, np.stack([x, y]), 1)
    return np.floor(u).astype(int), np.floor(v).astype(int), u % 1, v % 1


def _shade(seed: int, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    return 0.4 + 0.3 * hash_at(seed, 11, j + 1000, i + 1000) / 2.0**32


def _tiles(name: str, y: np.ndarray, x: np.ndarray, seed: int) -> np.ndarray:
    """Cells with light joints along their borders."""
    i, j, u, v = _phases(name, y, x)
    return np.where((u < 0.09) | (v < 0.11), 0.85, _shade(seed, i, j))


def _dots(name: str, y: np.ndarray, x: np.ndarray, seed: int) -> np.ndarray:
    """A dark disc of its own shade in every cell."""
    i, j, u, v = _phases(name, y, x)
    vectors = np.array(VECTORS[name])
    away = np.hypot(*np.tensordot(vectors.T, np.stack([u - 0.5, v - 0.5]), 1))
    return np.where(away < 0.36 * np.linalg.norm(vectors[0]), _shade(seed, i, j) - 0.2, 0.75)


def _bricks(name: str, y: np.ndarray, x: np.ndarray, seed: int) -> np.ndarray:
    """Courses, each half a brick beside the one below."""
    (length, _), (_, course) = VECTORS[name]
    row = np.floor(y / course).astype(int)
    along = x / length + 0.5 * (row % 2)
    mortar = (y % course < 1.6) | (along % 1 < 0.06)
    return np.where(mortar, 0.85, _shade(seed, np.floor(along).astype(int), row))


def _stripes(name: str, y: np.ndarray, x: np.ndarray, seed: int) -> np.ndarray:
    (step,) = np.array(VECTORS[name])
    phase = (x * step[0] + y * step[1]) / (step @ step)
    return np.where(phase % 1 < 0.35, 0.75, 0.35)


def _courses(name: str, y: np.ndarray, x: np.ndarray, seed: int) -> np.ndarray:
    """Rows of stones of any length: regular across them alone."""
    ((_, course),) = VECTORS[name]
    row = np.floor(y / course).astype(int)
    place = np.floor(x / 13).astype(int)
    joint = 12.0 * hash_at(seed, 12, row, place) / 2.0**32  # anywhere in a stretch
    beyond = x % 13 > joint
    mortar = (y % course < 1.6) | (np.abs(x % 13 - joint) < 0.7)
    return np.where(mortar, 0.85, _shade(seed, place + beyond, row) - 0.05)


def _weave(name: str, y: np.ndarray, x: np.ndarray, seed: int) -> np.ndarray:
    """Threads over and under each other: a checkerboard of two gradients."""
    side = VECTORS[name][0][0]
    i, j = np.floor(x / side).astype(int), np.floor(y / side).astype(int)
    over = (i + j) % 2 == 0
    across = np.where(over, y / side % 1, x / side % 1)
    return np.where(over, 0.55, 0.35) * (0.5 + np.sin(np.pi * across)) + 0.15 * (_shade(seed, i, j) - 0.5)


def _parquet(name: str, y: np.ndarray, x: np.ndarray, seed: int) -> np.ndarray:
    """Squares of strips, lying and standing in turn."""
    side = VECTORS[name][0][0]
    i, j = np.floor(x / side).astype(int), np.floor(y / side).astype(int)
    lying = (i + j) % 2 == 0
    across = np.where(lying, y / side % 1, x / side % 1)
    strip = np.floor(across * 4).astype(int)
    edge = (x % side < 1) | (y % side < 1) | (across * 4 % 1 < 0.12)
    return np.where(edge, 0.2, _shade(seed, 4 * i + strip, 4 * j + lying))


_MAKERS: dict[str, Callable[[str, np.ndarray, np.ndarray, int], np.ndarray]] = {
    "square": _tiles,
    "oblique": _tiles,
    "hexagonal": _dots,
    "stripes": _stripes,
    "bricks": _bricks,
    "weave": _weave,
    "courses": _courses,
    "parquet": _parquet,
}


def regular(name: str, height: int, width: int, seed: int) -> np.ndarray:
    """A texture on the lattice of that name, with noise and a stain."""
    y, x = np.mgrid[0:height, 0:width]
    within = (np.arange(_SAMPLES) + 0.5) / _SAMPLES  # of a pixel: edges between pixels, and not on them
    gray = sum(_MAKERS[name](name, y + j, x + i, seed) for j in within for i in within) / _SAMPLES**2
    gray = gray + 0.12 * (noise(height, width, seed, 13) - 0.5)
    return stained(np.clip(gray[..., None] * [1.0, 0.8, 0.6], 0, 1))
