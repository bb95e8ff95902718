# SPDX-License-Identifier: Apache-2.0
"""Photos of a known material under known lights: matte and GGX, with cast shadows and the noise of a sensor."""

from __future__ import annotations

import numpy as np

from tests.reference import reliefs


def lights(count: int, elevation: float = 50.0, turn: float = 20.0) -> np.ndarray:
    """Directions around a surface, every second one higher, (count, 3)."""
    return np.array([reliefs.light(turn + 360 * n / count, elevation + (12 if n % 2 else 0)) for n in range(count)])


def shadowed(heights: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Where a point of a relief that tiles is lit, (height, width) bool."""
    high, wide = heights.shape
    y, x = np.mgrid[:high, :wide]
    flat = np.hypot(*toward[:2])
    if flat < 1e-6:
        return np.ones(heights.shape, bool)
    lit, rise = np.ones(heights.shape, bool), toward[2] / flat
    for step in range(1, int(np.ptp(heights) / max(rise, 1e-3)) + 2):
        v, u = y - step * toward[1] / flat, x + step * toward[0] / flat
        j, i = np.floor(v).astype(int), np.floor(u).astype(int)
        v, u = v - j, u - i
        top = heights[j % high, i % wide] * (1 - u) + heights[j % high, (i + 1) % wide] * u
        low = heights[(j + 1) % high, i % wide] * (1 - u) + heights[(j + 1) % high, (i + 1) % wide] * u
        lit &= top * (1 - v) + low * v <= heights + rise * step + 0.05
    return lit


def highlight(normals: np.ndarray, toward: np.ndarray, roughness: np.ndarray, mirrored: float = 0.04) -> np.ndarray:
    """GGX with Smith's shadowing (Walter and others 2007), seen from above, times pi: 1 is a white matte surface."""
    alpha = np.maximum(roughness, 0.03) ** 2
    half = np.add(toward, [0, 0, 1])
    half = half / np.linalg.norm(half)
    to_half, to_light, to_eye = np.maximum(0, normals @ half), np.maximum(0, normals @ toward), normals[..., 2]
    spread = alpha**2 / (np.pi * (to_half**2 * (alpha**2 - 1) + 1) ** 2)
    fresnel = mirrored + (1 - mirrored) * (1 - half[2]) ** 5

    def masked(cosine: np.ndarray) -> np.ndarray:
        return 2 * cosine / (cosine + np.sqrt(alpha**2 + (1 - alpha**2) * cosine**2) + 1e-9)

    return np.pi * fresnel * spread * masked(to_light) * masked(to_eye) / np.maximum(4 * to_eye, 1e-6)


def photo(
    heights: np.ndarray,
    albedo: np.ndarray,
    toward: np.ndarray,
    roughness: np.ndarray | float = 1.0,
    mirrored: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """A linear photo (height, width, 3) under a light of 1; `noise` is that of white, which grows with the root."""
    normals = reliefs.normals(heights)
    shade = np.maximum(0, normals @ toward)[..., None] * albedo
    if mirrored:
        shade = shade + highlight(normals, toward, np.broadcast_to(roughness, heights.shape), mirrored)[..., None]
    shade = shade * shadowed(heights, toward)[..., None]
    grain = np.random.default_rng(seed).normal(0, 1, shade.shape)
    return np.maximum(0, shade + noise * grain * np.sqrt(shade + 1e-3))


def degrees_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angles between unit vectors in the last axis."""
    return np.degrees(np.arccos(np.clip((one * other).sum(-1), -1, 1)))
