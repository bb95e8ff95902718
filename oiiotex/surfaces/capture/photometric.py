# SPDX-License-Identifier: Apache-2.0
"""Normals and albedo from photos of one surface under several lights, without highlights and shadows.

Photometric stereo (Woodham, Photometric method for determining surface orientation from multiple images, Optical
Engineering 19(1), 1980) by iteratively reweighted least squares: an observation that the matte surface of the last
round does not explain counts less, first mildly, then strictly. Weights are those of Geman and McClure, as in graduated
non-convexity (Black and Rangarajan, On the unification of line processes, outlier rejection, and robust statistics,
IJCV 19(1), 1996). Only sums, products and roots in a fixed order are used, so that bits do not depend on the CPU:
`einsum` adds photos in their order, which a product of matrices would not. Each step is one call for all photos, in
arrays that are reused: with one for each photo, a fit takes twice as long.

Vectors: x right, y up, z towards the camera, as in OpenGL normal maps.
"""

from __future__ import annotations

import functools
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
    trust = trusted(valid)
    weights = _by_rank(seen)
    if trust is not None:
        weights *= trust
    surface = Solver(toward, weights).surface(seen)
    for tolerance in np.geomspace(_LOOSE, _STRICT, _ROUNDS):
        shade = shading(surface, toward)
        lit = shade > 0
        weights = reweighted(seen, np.maximum(shade, 0, out=shade), lit, trust, float(tolerance))
        surface = Solver(toward, weights).surface(seen)
    return fit_of(surface, weights)


def trusted(valid: np.ndarray) -> np.ndarray | None:
    """Factors of the weights of photos that may be clipped, (n, pixels) float32; None: 1."""
    return None if valid.all() else np.where(valid, np.float32(1), np.float32(1e-3))


def reweighted(
    seen: np.ndarray, expected: np.ndarray, lit: np.ndarray, trust: np.ndarray | None, tolerance: float = _STRICT
) -> np.ndarray:
    """Weights of photos (n, pixels) by what a surface is expected to show; `trust` as by `trusted`."""
    scale = np.float32(tolerance) * np.maximum(expected.max(0), np.float32(1e-6))
    away = seen - expected
    away /= scale
    np.maximum(away, away * np.float32(1 / _HIGHLIGHT), out=away)
    away *= away
    away += 1
    weights = np.divide(1, away, out=away)
    weights *= weights
    weights *= lit
    if trust is not None:
        weights *= trust
    return weights


def fit_of(surface: np.ndarray, weights: np.ndarray) -> Fit:
    """The fit with this albedo times normal, (3, pixels) float32."""
    albedo = np.sqrt(surface[0] * surface[0] + surface[1] * surface[1] + surface[2] * surface[2])
    return Fit(_facing(surface / np.maximum(albedo, np.float32(1e-12))), albedo, weights)


def albedo_of(color: np.ndarray, normals: np.ndarray, toward: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The albedo of each channel: least squares over the photos that show the matte surface.

    `color` (n, channels, pixels) float32; the others as in `fitted`. Returns (channels, pixels) float32.
    """
    toward = toward[..., None] if toward.ndim == 2 else toward
    lit = shading(normals, toward)
    np.maximum(lit, 0, out=lit)
    weighted = weights * lit
    below = np.maximum(summed(weighted, lit), np.float32(1e-6))
    return np.stack([summed(weighted, color[:, n]) / below for n in range(color.shape[1])])


def slopes_of(normals: np.ndarray) -> np.ndarray:
    """Slopes (right, down) of the heights of a surface with these normals, at most `STEEPEST`; (2, pixels) float32."""
    up = np.maximum(normals[2], np.float32(1e-6))
    return np.clip(np.stack([-normals[0] / up, normals[1] / up]), np.float32(-STEEPEST), np.float32(STEEPEST))


def _by_rank(seen: np.ndarray) -> np.ndarray:
    """First weights, (n, pixels): the brightest of four photos or more may be a highlight, the darkest a shadow."""
    count = len(seen)
    ranks = np.zeros(seen.shape, np.uint8)
    for one in range(count):
        for other in range(one):
            below = seen[other] <= seen[one]
            ranks[one] += below
            ranks[other] += ~below
    few = count < 6
    low, high = (0, count - (count > 3)) if few else (count // 4, count - (count + 2) // 6)
    return np.where((ranks >= low) & (ranks < high), np.float32(1), np.float32(_BRIGHTEST if few else 0))


def shading(surface: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Dot products of vectors (3, pixels) with directions (n, 3, pixels or 1): (n, pixels)."""
    shade: np.ndarray = np.einsum("nkp,kp->np", toward, surface)
    return shade


def summed(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Sums of the products of photos (n, pixels), in their order: (pixels,)."""
    total: np.ndarray = np.einsum("np,np->p", one, other)
    return total


@dataclass(frozen=True)
class Solver:
    """Weighted least squares for albedo times normal, of several values under the same lights with the same weights."""

    toward: np.ndarray  # (n, 3, pixels or 1) float32
    weights: np.ndarray  # (n, pixels) float32

    @functools.cached_property
    def _factors(self) -> tuple[np.ndarray, ...]:
        """Factors of the matrix, L D L': yx, zx and zy of L, and the inverses of D, each (pixels,)."""
        axes = [self.toward[:, n] for n in range(3)]
        products = [summed(self.weights, axes[n] * axes[k]) for n in range(3) for k in range(n, 3)]
        xx, xy, xz, yy, yz, zz = products
        for each in (xx, yy, zz):
            each += np.float32(_FLAT * len(self.toward))
        x = 1 / xx
        yx, zx = xy * x, xz * x
        y = 1 / (yy - yx * xy)
        rest = yz - zx * xy
        zy = rest * y
        return yx, zx, zy, x, y, 1 / (zz - zx * xz - zy * rest)

    def surface(self, seen: np.ndarray) -> np.ndarray:
        """Albedo times normal, (3, pixels) float32, of values (n, pixels)."""
        weighted = self.weights * seen
        x, y, z = (summed(weighted, self.toward[:, n]) for n in range(3))
        z += np.float32(_FLAT) * seen.sum(0)
        yx, zx, zy, *scale = self._factors
        y -= yx * x
        z -= zx * x + zy * y
        x, y, z = x * scale[0], y * scale[1], z * scale[2]
        y -= zy * z
        x -= yx * y + zx * z
        return np.stack([x, y, z])


def _facing(normals: np.ndarray) -> np.ndarray:
    """Normals turned towards the camera where noise turned them away; (3, pixels)."""
    least = np.float32(1 / STEEPEST)
    up = np.maximum(normals[2], least)
    length = np.sqrt(normals[0] * normals[0] + normals[1] * normals[1] + up * up)
    return np.stack([normals[0], normals[1], up]) / length
