# SPDX-License-Identifier: Apache-2.0
"""Hex tiling, a peer of --texstationarize at render time: three pieces of the photo are blended at every pixel.

`hextiled` is MaterialX's node `hextiledimage` (Mikkelsen, Practical Real-Time Hex-Tiling, JCGT 11(3), 2022): pieces lie
on a triangle grid, each moved, and with `turned` also rotated and scaled, at random; weights are the barycentric ones
to the seventh power, times luminance as far as `CONTRAST` goes. `by_histogram` is the way it comes from (Heitz, Neyret,
High-Performance By-Example Noise using a Histogram-Preserving Blending Operator, HPG 2018): values are made Gaussian,
blended so that the variance holds, and brought back; per principal component of the colors (Deliot, Heitz 2019).
Written from these papers. A photo that does not tile shows its seam within a piece, as it does in a renderer; with
`inside` pieces keep away from it. Rotations, scales and moves are drawn separately; the node uses two numbers for all.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.special import ndtri

from oiiotex.engine.color.srgb import LUMA

GRID = 2 * np.sqrt(3.0)  # edges of the triangle grid to the photo's side
EXPONENT, CONTRAST = 7.0, 0.5
SCALES = (0.5, 2.0)  # MaterialX's default
DEVIATION = 1 / 6  # of the Gaussian values about 1/2


def hextiled(photo: np.ndarray, side: int, seed: int, turned: bool) -> np.ndarray:
    """A plane (side, side, 3) of linear light from a photo (n, n, 3) of linear light."""
    weights, samples = _pieces(photo, side, seed, turned, inside=False)
    luminance = samples @ np.array(LUMA)
    weights = (1 - CONTRAST + CONTRAST * luminance) * weights**EXPONENT
    return ((weights / weights.sum(0))[..., None] * samples).sum(0)


def by_histogram(photo: np.ndarray, side: int, seed: int) -> np.ndarray:
    """A plane (side, side, 3) from a photo (n, n, 3), by histogram-preserving blending, pieces away from its border."""
    colors = photo.reshape(-1, 3)
    mean = colors.mean(0)
    axes = np.linalg.eigh(np.cov((colors - mean).T))[1]
    values = (colors - mean) @ axes
    ranks = (values.argsort(0).argsort(0) + 0.5) / len(values)
    gaussian = 0.5 + DEVIATION * ndtri(ranks)
    weights, samples = _pieces(gaussian.reshape(photo.shape), side, seed, turned=False, inside=True)
    weights = weights[..., None]
    blended = 0.5 + ((samples - 0.5) * weights).sum(0) / np.sqrt((weights**2).sum(0))
    at = np.sort(gaussian, axis=0), np.sort(values, axis=0)
    back = np.stack([np.interp(blended[..., c], at[0][:, c], at[1][:, c]) for c in range(3)], -1)
    return back @ axes.T + mean


def _pieces(photo: np.ndarray, side: int, seed: int, turned: bool, inside: bool) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric weights (3, side, side), and what the three pieces show (3, side, side, 3)."""
    n = photo.shape[0]
    y, x = (np.mgrid[0:side, 0:side] + 0.5) / n
    skewed = GRID * (x - y / np.sqrt(3.0)), GRID * y * 2 / np.sqrt(3.0)
    base = [np.floor(s).astype(np.int64) for s in skewed]
    fx, fy = skewed[0] - base[0], skewed[1] - base[1]
    third = 1 - fx - fy
    low = third > 0
    weights = np.stack([np.abs(third), np.where(low, fy, 1 - fy), np.where(low, fx, 1 - fx)])
    steps = ((0, 0), (0, 1), (1, 0)), ((1, 1), (1, 0), (0, 1))  # the corners in a lower and in an upper triangle
    least = base[0].min()
    lots = np.random.default_rng(seed).random((base[0].max() - least + 2, base[1].max() + 2, 4))  # of every vertex
    samples = []
    for first, second in zip(*steps, strict=True):
        u = base[0] + np.where(low, first[0], second[0])
        v = base[1] + np.where(low, first[1], second[1])
        lot = lots[u - least, v]
        center_y = v * np.sqrt(3.0) / 2 / GRID
        center_x = u / GRID + v / 2 / GRID
        dx, dy = x - center_x, y - center_y
        if turned:
            angle, scale = 2 * np.pi * lot[..., 2], SCALES[0] + (SCALES[1] - SCALES[0]) * lot[..., 3]
            cos, sin = np.cos(angle) / scale, np.sin(angle) / scale
            dx, dy = cos * dx - sin * dy, sin * dx + cos * dy
        reach = 1 / GRID + 1 / n  # of a piece from its center
        if inside:
            to_x, to_y = (reach + (1 - 2 * reach) * lot[..., c] for c in (0, 1))
        else:
            to_x, to_y = center_x + lot[..., 0], center_y + lot[..., 1]
        at = [(to_y + dy) * n - 0.5, (to_x + dx) * n - 0.5]
        samples.append(np.stack([map_coordinates(photo[..., c], at, order=1, mode="grid-wrap") for c in range(3)], -1))
    return weights, np.stack(samples)
