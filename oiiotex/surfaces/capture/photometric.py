# SPDX-License-Identifier: Apache-2.0
"""Normals and albedo from photos of one surface under several lights, without highlights and shadows.

Photometric stereo (Woodham, Photometric method for determining surface orientation from multiple images, Optical
Engineering 19(1), 1980) by iteratively reweighted least squares: an observation that the matte surface of the last
round does not explain counts less, first mildly, then strictly. Weights are those of Geman and McClure, as in graduated
non-convexity (Black and Rangarajan, On the unification of line processes, outlier rejection, and robust statistics,
IJCV 19(1), 1996). Only sums, products and roots in a fixed order are used, so that bits do not depend on the CPU.

Vectors: x right, y up, z towards the camera, as in OpenGL normal maps.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

from ...engine.deferred import np

FEWEST, MOST = 3, 16  # photos
STEEPEST = 8.0  # slopes are clipped to this: 83 degrees
_LOOSE, _STRICT = 0.5, 0.03  # residuals, relative to the brightest matte observation, that count a quarter
_ROUNDS = 8
_HIGHLIGHT = 0.5  # times the tolerance of observations that are too dark: highlights are frequent, and never dark
_BRIGHTEST = 0.1  # first weight of the brightest of few photos
_FLAT = 1e-4  # weight of a surface that faces the camera, relative to the light: decides where nothing is seen


@dataclass(frozen=True)
class Fit:
    """A matte surface that explains what several photos show.

    `weights`: of the n photos, 0 (a highlight or a shadow) to 1.
    """

    normals: np.ndarray  # (3, pixels) float32, of length 1
    albedo: np.ndarray  # (pixels,) float32: luminance under a light of 1 that the surface faces
    weights: np.ndarray  # (n, pixels) float32


def fitted(seen: np.ndarray, toward: np.ndarray, valid: np.ndarray) -> Fit:
    """Normals and albedo.

    Parameters
    ----------
    seen : (n, pixels) float32
        Linear luminance, divided by the light's intensity.
    toward : (n, 3) or (n, 3, pixels) float32
        Unit vectors towards the lights.
    valid : (n, pixels) bool
        False where a photo is clipped: at least as bright as it says.
    """
    toward = toward[..., None] if toward.ndim == 2 else toward
    trust = np.where(valid, np.float32(1), np.float32(1e-3))
    weights = _by_rank(seen) * trust
    surface = Solver(toward, weights).surface(seen)
    for tolerance in np.geomspace(_LOOSE, _STRICT, _ROUNDS).astype(np.float32):
        matte = np.maximum(_shading(surface, toward), 0)
        scale = np.float32(tolerance) * np.maximum(matte.max(0), np.float32(1e-6))
        away = (seen - matte) / scale
        away = np.where(away > 0, away / np.float32(_HIGHLIGHT), away)
        weights = 1 / (1 + away * away)
        weights *= weights * trust
        weights = np.where(_shading(surface, toward) > 0, weights, np.float32(0))
        surface = Solver(toward, weights).surface(seen)
    return fit_of(surface, weights)


def reweighted(seen: np.ndarray, expected: np.ndarray, lit: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Weights of photos (n, pixels) by what a surface is expected to show, as in the last round of `fitted`."""
    scale = np.float32(_STRICT) * np.maximum(expected.max(0), np.float32(1e-6))
    away = (seen - expected) / scale
    away = np.where(away > 0, away / np.float32(_HIGHLIGHT), away)
    weights = 1 / (1 + away * away)
    return np.where(lit, weights * weights * np.where(valid, np.float32(1), np.float32(1e-3)), np.float32(0))


def fit_of(surface: np.ndarray, weights: np.ndarray) -> Fit:
    """The fit with this albedo times normal, (3, pixels) float32."""
    albedo = np.sqrt(surface[0] * surface[0] + surface[1] * surface[1] + surface[2] * surface[2])
    return Fit(_facing(surface / np.maximum(albedo, np.float32(1e-12))), albedo, weights)


def albedo_of(color: Sequence[np.ndarray], normals: np.ndarray, toward: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The albedo of one channel: least squares over the photos that show the matte surface.

    `color` (n) of (pixels,) float32; the others as in `fitted`. Returns (pixels,) float32.
    """
    toward = toward[..., None] if toward.ndim == 2 else toward
    above, below = np.zeros_like(color[0]), np.zeros_like(color[0])
    for seen, shade, weight in zip(color, _shading(normals, toward), weights, strict=True):
        lit = np.maximum(shade, 0)
        above += weight * lit * seen
        below += weight * lit * lit
    return above / np.maximum(below, np.float32(1e-6))


def slopes_of(normals: np.ndarray) -> np.ndarray:
    """Slopes (right, down) of the heights of a surface with these normals, at most `STEEPEST`; (2, pixels) float32."""
    up = np.maximum(normals[2], np.float32(1e-6))
    return np.clip(np.stack([-normals[0] / up, normals[1] / up]), np.float32(-STEEPEST), np.float32(STEEPEST))


def _by_rank(seen: np.ndarray) -> np.ndarray:
    """First weights, (n, pixels): the brightest of four photos or more may be a highlight, the darkest a shadow."""
    count = len(seen)
    ranks = np.zeros(seen.shape, np.float32)
    for one in range(count):
        for other in range(count):
            if one != other:
                ranks[one] += (seen[other] < seen[one]) | ((seen[other] == seen[one]) & (other < one))
    few = count < 6
    low, high = (0, count - (count > 3)) if few else (count // 4, count - (count + 2) // 6)
    return np.where((ranks >= low) & (ranks < high), np.float32(1), np.float32(_BRIGHTEST if few else 0))


def _shading(surface: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Dot products of vectors (3, pixels) with directions (n, 3, pixels or 1): (n, pixels)."""
    return toward[:, 0] * surface[0] + toward[:, 1] * surface[1] + toward[:, 2] * surface[2]


def _normal_matrix(toward: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, ...]:
    """The inverse of the matrix of weighted least squares, by its adjugate: xx, xy, xz, yy, yz, zz, (pixels,)."""
    sums = np.zeros((6, weights.shape[1]), np.float64)
    for light, weight in zip(toward, weights, strict=True):
        x, y, z = (each.astype(np.float64) for each in light)
        for n, product in enumerate((x * x, x * y, x * z, y * y, y * z, z * z)):
            sums[n] += weight * product
    sums[[0, 3, 5]] += _FLAT * len(toward)
    xx, xy, xz, yy, yz, zz = sums
    c00, c01, c02 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    c11, c12, c22 = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    scale = 1 / np.maximum(xx * c00 + xy * c01 + xz * c02, 1e-12)
    return tuple(each * scale for each in (c00, c01, c02, c11, c12, c22))


@dataclass(frozen=True)
class Solver:
    """Weighted least squares for albedo times normal, of several values under the same lights with the same weights."""

    toward: np.ndarray  # (n, 3, pixels or 1) float32
    weights: np.ndarray  # (n, pixels) float32

    @functools.cached_property
    def _inverse(self) -> tuple[np.ndarray, ...]:
        return _normal_matrix(self.toward, self.weights)

    def surface(self, seen: np.ndarray) -> np.ndarray:
        """Albedo times normal, (3, pixels) float32, of values (n, pixels)."""
        x, y, z = np.zeros((3, seen.shape[1]), np.float64)
        for light, weight, value in zip(self.toward, self.weights, seen, strict=True):
            weighted = weight * value
            x += weighted * light[0]
            y += weighted * light[1]
            z += weighted * light[2] + _FLAT * value
        xx, xy, xz, yy, yz, zz = self._inverse
        sides = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
        return np.stack(sides).astype(np.float32)


def _facing(normals: np.ndarray) -> np.ndarray:
    """Normals turned towards the camera where noise turned them away; (3, pixels)."""
    least = np.float32(1 / STEEPEST)
    up = np.maximum(normals[2], least)
    length = np.sqrt(normals[0] * normals[0] + normals[1] * normals[1] + up * up)
    return np.stack([normals[0], normals[1], up]) / length
