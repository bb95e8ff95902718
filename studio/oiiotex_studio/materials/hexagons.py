# SPDX-License-Identifier: Apache-2.0
"""A plane without a period from one tile: three pieces of it blended at every pixel, with the tile's histogram.

HN18 (Heitz, Neyret, High-Performance By-Example Noise using a Histogram-Preserving Blending Operator, HPG 2018): values
are made Gaussian, blended so that their variance stays, and brought back by a table. DH19 (Deliot, Heitz, Procedural
Stochastic Textures by Tiling and Blending, GPU Zen 2, 2019): one table for each principal component of the colors.

Departures. Weights are seventh powers of the barycentric ones, as in Mikkelsen, Practical Real-Time Hex-Tiling, JCGT
11(2), 2022: pieces are blended in narrow zones. Tables are piecewise linear with `KNOTS` knots and are not filtered for
coarser MIP levels. The random numbers of a hexagon are those of `cellnoise2d`, which MaterialX defines by integers, so
that every renderer shows the same plane. Hexagons have three colors: a slot of a shader changes its hexagon only
where that weighs nothing, so derivatives between pixels are right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from oiiotex.engine.deferred import np

from ..api.materials import LEAST, Fidelity, JudgedPhoto, SourceMap, bilinear

GRID = 2 * math.sqrt(3.0)  # hexagons to the tile's side
EXPONENT = 7
DEVIATION = 1 / 6  # of Gaussian values around 1/2
KNOTS = 32  # of a table, from 0 to 1: three deviations to either side
STREAM = 4096  # offset of the second hash of a hexagon
BLENDABLE = 0.77  # least fidelity of a plane to its tile: of 45 photos looked at, all above were right
_JUDGED = 256  # px, longer side of the tile and the plane that are judged


@dataclass(frozen=True)
class HexMap:
    """A tile for blending.

    Attributes
    ----------
    gaussian : (height, width, channels) float32
        Its values, 0 to 1, with a Gaussian histogram per principal component.
    table : (KNOTS, channels) float32
        Values of the components at Gaussian values from 0 to 1.
    axes : (channels, channels) float32
        The components as rows.
    """

    gaussian: np.ndarray
    table: np.ndarray
    axes: np.ndarray

    def shares(self) -> np.ndarray:
        """The part of each component in a pixel at the knots: (channels, KNOTS, channels) float32."""
        return (self.table.T[..., None] * self.axes[:, None]).astype(np.float32)

    def values(self, gaussian: np.ndarray) -> np.ndarray:
        """Pixels of blended Gaussian values, (..., channels)."""
        knots = np.linspace(0, 1, KNOTS)
        columns = [np.interp(gaussian[..., n], knots, column) for n, column in enumerate(self.table.T)]
        return np.stack(columns, -1) @ self.axes


def gaussianized(texels: np.ndarray) -> HexMap:
    """A tile (height, width, channels) of floats, made Gaussian."""
    from scipy.special import ndtr

    pixels = texels.reshape(-1, texels.shape[2]).astype(np.float64)
    axes = np.linalg.eigh(np.atleast_2d(np.cov(pixels.T)))[1].T[::-1]
    axes = axes * np.where(axes.sum(1, keepdims=True) < 0, -1.0, 1.0)
    components = pixels @ axes.T
    knots = np.linspace(0, 1, KNOTS)
    ranks = ndtr((knots - 0.5) / DEVIATION)
    ranks[[0, -1]] = 0, 1
    table = np.quantile(components, ranks, axis=0)
    gaussian = np.stack([np.interp(of, at, knots) for of, at in zip(components.T, table.T, strict=True)], -1)
    return HexMap(gaussian.reshape(texels.shape).astype(np.float32), table.astype(np.float32), axes.astype(np.float32))


def hexagons(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The three hexagons at places in tiles, v downwards: their integer names (3, ..., 2), and weights (3, ...).

    Slot n has the hexagons with (first - second) % 3 == n.
    """
    skewed = GRID * np.stack([u - v / math.sqrt(3), 2 * v / math.sqrt(3)], -1)
    base = np.floor(skewed)
    x, y = np.moveaxis(skewed - base, -1, 0)
    upper = x + y > 1
    names = np.stack([base + upper[..., None], base + np.array([1, 0]), base + np.array([0, 1])]).astype(np.int64)
    weights = np.stack([np.abs(1 - x - y), np.where(upper, 1 - y, x), np.where(upper, 1 - x, y)]) ** EXPONENT
    slots = np.argsort((names[..., 0] - names[..., 1]) % 3, axis=0)
    return np.take_along_axis(names, slots[..., None], 0), np.take_along_axis(weights, slots, 0)


def place_in_tile(u: np.ndarray, v: np.ndarray, names: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where a hexagon shows the tile at a place, in tiles."""
    first, second = names[..., 0], names[..., 1]
    center = first / GRID + second / (2 * GRID), second * (math.sqrt(3) / 2 / GRID)
    return u - center[0] + _cell_noise(first, second), v - center[1] + _cell_noise(first, second + STREAM)


def blended(tile: HexMap, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The plane at places in tiles, v downwards: (..., channels)."""
    names, weights = hexagons(u, v)
    sums = np.zeros((*u.shape, tile.gaussian.shape[2]))
    for name, weight in zip(names, weights, strict=True):
        sums += weight[..., None] * (bilinear(tile.gaussian, *place_in_tile(u, v, name)) - 0.5)
    return tile.values(0.5 + sums / np.sqrt(np.square(weights).sum(0))[..., None])


def _cell_noise(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """`cellnoise2d` of MaterialX at integers, 0 to 1: the final mix of Bob Jenkins' lookup3 (public domain, 2006)."""
    seed = np.uint32(0xDEADBEEF + (2 << 2) + 13)
    mixed, other, third = np.full(x.shape, seed), seed + y.astype(np.uint32), seed + x.astype(np.uint32)
    for turn in (14, 11, 25, 16, 4, 14, 24):
        mixed = (mixed ^ other) - (other << np.uint32(turn) | other >> np.uint32(32 - turn))
        mixed, other, third = third, mixed, other
    return other.astype(np.float32) / np.float32(0xFFFFFFFF)


def judged(lab: np.ndarray) -> Fidelity | None:
    """The fidelity of a plane to its tile, (height, width, 3) float32 CIE Lab; None: it is too small to measure.

    Cuts are those between the hexagons that weigh most.
    """
    height, width = lab.shape[:2]
    step = -(-max(height, width) // _JUDGED)
    lab = lab[: height // step * step, : width // step * step]
    lab = lab.reshape(height // step, step, width // step, step, 3).mean((1, 3), dtype=np.float32)
    height, width = lab.shape[:2]
    if min(height, width) < LEAST:
        return None
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    names, weights = hexagons(u, v)
    heaviest = np.take_along_axis(names, weights.argmax(0)[None, ..., None], 0)[0]
    x, y = (
        np.floor(n * side).astype(int) % side
        for n, side in zip(place_in_tile(u, v, heaviest), (width, height), strict=True)
    )
    plane = blended(gaussianized(lab), u, v).astype(np.float32)
    return JudgedPhoto(lab).fidelity(plane, (False, False), SourceMap.of(y, x))
