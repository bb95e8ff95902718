# SPDX-License-Identifier: Apache-2.0
"""Reliefs that tile, and what a camera above them sees: by one light, by an overcast sky, with highlights."""

from __future__ import annotations

import numpy as np

from tests.pictures import noise


def hills(side: int, seed: int, slope: float = 0.4) -> np.ndarray:
    """Fractal hills whose spectrum falls by the power 2, (side, side) px; `slope` is their root mean square slope."""
    spectrum = np.fft.rfft2(noise(side, side, seed))
    away = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)[None])
    spectrum *= np.where(away > 0, np.maximum(away, 1e-9) ** -2.0, 0)
    return _sloped(np.fft.irfft2(spectrum, (side, side)), slope)


def stones(side: int, seed: int, cell: int = 24, slope: float = 0.7) -> np.ndarray:
    """Domes on a jittered grid."""
    y, x = np.mgrid[:side, :side]
    count, nearest = side // cell, np.full((side, side), np.inf)
    shift = noise(count, 2 * count, seed) - 0.5
    for j in range(count):
        for i in range(count):
            down = (y - (j + 0.5 + 0.5 * shift[j, i]) * cell + side / 2) % side - side / 2
            right = (x - (i + 0.5 + 0.5 * shift[j, i + count]) * cell + side / 2) % side - side / 2
            nearest = np.minimum(nearest, np.hypot(down, right))
    return _sloped(np.sqrt(np.maximum(0, (0.7 * cell) ** 2 - nearest**2)), slope)


def courses(side: int, slope: float = 0.5) -> np.ndarray:
    """Bricks of 32 x 16 px with bevelled edges, in a running bond."""
    y, x = np.mgrid[:side, :side]
    along = x + 16 * (y // 16 % 2)
    edge = np.minimum(np.minimum(y % 16, 15 - y % 16), np.minimum(along % 32, 31 - along % 32))
    return _sloped(np.clip(edge, 0, 4).astype(float), slope)


def _sloped(heights: np.ndarray, slope: float) -> np.ndarray:
    right, down = slopes(heights)
    return heights * slope / np.sqrt((right**2 + down**2).mean())


def slopes(heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Central differences to the right and down, on a torus."""
    return (
        (np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) / 2,
        (np.roll(heights, -1, 0) - np.roll(heights, 1, 0)) / 2,
    )


def normals(heights: np.ndarray) -> np.ndarray:
    """Unit vectors: x right, y up, z towards the camera. (height, width, 3)."""
    right, down = slopes(heights)
    vectors = np.stack([-right, down, np.ones_like(heights)], -1)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def light(azimuth: float, elevation: float = 45.0) -> np.ndarray:
    """The direction towards a light, degrees; azimuth counterclockwise from the right."""
    a, e = np.radians((azimuth, elevation))
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


def lit(heights: np.ndarray, azimuth: float, elevation: float = 45.0) -> np.ndarray:
    """A matt surface under one light (Lambert), 1 where it shines straight down."""
    return np.maximum(0, normals(heights) @ light(azimuth, elevation))


def glossy(heights: np.ndarray, roughness: np.ndarray, azimuth: float) -> np.ndarray:
    """Half matt, half of it highlights (Walter and others 2007, GGX, without shadowing) under one light."""
    n, toward = normals(heights), light(azimuth)
    half = toward + np.array([0, 0, 1])
    cosine = np.maximum(0, n @ (half / np.linalg.norm(half)))
    alpha = roughness**4
    highlight = alpha / (np.pi * (cosine**2 * (alpha - 1) + 1) ** 2)
    return np.maximum(0, n @ toward) * (0.3 + 0.04 * highlight / (4 * n[..., 2]))


def visible_sky(heights: np.ndarray, radius: int, rays: int = 256) -> np.ndarray:
    """Light from an even sky by rays, marched pixel by pixel, 1 where nothing is around."""
    side, normal, out = heights.shape[0], normals(heights), np.zeros(heights.shape)
    y, x = np.mgrid[:side, :side]
    for ray in range(rays):
        up, turn = (ray + 0.5) / rays, 2 * np.pi * (ray * 0.6180339887 % 1)
        flat = np.sqrt(1 - up * up)
        right, down = np.cos(turn), np.sin(turn)
        seen = 2 * np.maximum(0, normal @ [flat * right, -flat * down, up])
        for step in range(1, radius + 1):
            v, u = y + down * step, x + right * step
            j, i = np.floor(v).astype(int), np.floor(u).astype(int)
            v, u = v - j, u - i
            top = heights[j % side, i % side] * (1 - u) + heights[j % side, (i + 1) % side] * u
            low = heights[(j + 1) % side, i % side] * (1 - u) + heights[(j + 1) % side, (i + 1) % side] * u
            seen = np.where(top * (1 - v) + low * v > heights + up / flat * step + 1e-6, 0, seen)
        out += seen
    return out / rays
