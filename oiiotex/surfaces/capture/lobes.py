# SPDX-License-Identifier: Apache-2.0
"""Highlights in several photos of a matte surface, and the roughness that their width tells.

A lobe of Trowbridge and Reitz (GGX) with Smith's shadowing (Walter, Marschner, Li and Torrance, Microfacet models for
refraction through rough surfaces, EGSR 2007) of a surface that mirrors 4 %, as nearly all do but metals, is compared
with the residuals of the matte surface, for each of several widths. Few lights sample a lobe too sparsely for
one pixel, so that the pixels of a cell decide together.
"""

from __future__ import annotations

from ...engine.deferred import np
from .photometric import Fit, Solver

FEWEST = 6  # photos that tell roughness
CELL = 8  # px
WIDTHS = 8
_NARROWEST, _WIDEST = 0.15, 0.95  # roughness, the root of GGX's alpha
_MIRRORED = 0.04  # share of the light
_TAKEN = 0.5  # share of the lobes that is subtracted: exposures are unknown, and too much costs more than too little
_PLACED = 0.5  # roughness below which few photos show too little of a lobe to place it: reweighting leaves it out
_REACH = 1.0  # cells: sigma of the neighborhood that decides on roughness together


def lobe_misfits(over: np.ndarray, lit: np.ndarray, fit: Fit, toward: np.ndarray) -> np.ndarray:
    """Squared error with a lobe of each width, less that without one, (WIDTHS, pixels) float32.

    The matte fit takes up a part of every lobe, all the more of a wide one. The residuals of a lobe are compared
    with those of the photos, which gives the error of a fit of both (Frisch and Waugh, Partial time regressions as
    compared with individual trends, Econometrica 1(4), 1933).

    Parameters
    ----------
    over : (n, pixels) float32
        Light beyond the matte surface.
    lit : (n, pixels) bool
        Where it is neither in shadow nor clipped.
    fit : Fit
    toward : (n, 3, pixels or 1) float32
        Directions of the lights.
    """
    misfits, solver = np.zeros((WIDTHS, over.shape[1]), np.float32), Solver(toward, fit.weights)
    for misfit, roughness in zip(misfits, _widths(), strict=True):
        lobes = _lobes(fit.normals, toward, roughness * roughness)
        taken = solver.surface(lobes)
        for light, lobe, excess, seen in zip(toward, lobes, over, lit, strict=True):
            left = lobe - (light * taken).sum(0)
            misfit += np.where(seen, left * (left - 2 * excess), np.float32(0))
    return misfits


def highlights(cells: np.ndarray, shape: tuple[int, int], fit: Fit, toward: np.ndarray) -> np.ndarray:
    """The highlights to subtract from a piece of (height, width), (n, pixels) float32, by its cells' misfits."""
    best = cells.argmin(0)
    found = (cells.min(0) < 0) & ((len(toward) >= FEWEST) | (_widths()[best] > _PLACED))
    strength = np.where(found, np.float32(_TAKEN), np.float32(0))

    def at_pixels(values: np.ndarray) -> np.ndarray:
        return values.repeat(CELL, 0).repeat(CELL, 1)[: shape[0], : shape[1]].ravel()

    return at_pixels(strength) * _lobes(fit.normals, toward, at_pixels(_widths()[best] ** 2))


def roughness_of(cells: np.ndarray) -> np.ndarray:
    """Roughness of cells, (rows, columns) float32, from their misfits (WIDTHS, rows, columns)."""
    from scipy.ndimage import gaussian_filter  # slow to import

    near = gaussian_filter(cells, (0, _REACH, _REACH), mode="nearest")
    best = near.argmin(0)
    inner = np.clip(best, 1, WIDTHS - 2)
    low, middle, high = (np.take_along_axis(near, (inner + n)[None], 0)[0] for n in (-1, 0, 1))
    bend = np.maximum(low + high - 2 * middle, 1e-20)
    place = np.where(best == inner, inner + np.clip((low - high) / (2 * bend), -0.5, 0.5), best)
    found = _NARROWEST * (_WIDEST / _NARROWEST) ** (place / (WIDTHS - 1))
    return np.where(near.min(0) < 0, found, _WIDEST).astype(np.float32)


def in_cells(values: np.ndarray) -> np.ndarray:
    """Sums over cells of `CELL` px, the last ones cropped: (..., height, width) to (..., rows, columns)."""
    for axis in (-2, -1):
        values = np.add.reduceat(values, np.arange(0, values.shape[axis], CELL), axis)
    return values


def between_cells(cells: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Values of cells (rows, columns), linear between their middles, at places counted in px; clamped at the border."""
    values = cells
    for axis, places in enumerate((rows, columns)):
        at = np.clip((places + 0.5) / CELL - 0.5, 0, cells.shape[axis] - 1)
        first = np.minimum(at.astype(int), max(cells.shape[axis] - 2, 0))
        share = np.expand_dims((at - first).astype(np.float32), 1 - axis)
        after = np.minimum(first + 1, cells.shape[axis] - 1)
        values = np.take(values, first, axis) * (1 - share) + np.take(values, after, axis) * share
    return values


def _widths() -> np.ndarray:
    return np.geomspace(_NARROWEST, _WIDEST, WIDTHS).astype(np.float32)


def _lobes(normals: np.ndarray, toward: np.ndarray, alpha: np.ndarray | np.float32) -> np.ndarray:
    """Highlights under each light, relative to white that faces it, (n, pixels) float32."""
    square = alpha * alpha
    to_eye, found = normals[2], []

    def masked(cosine: np.ndarray) -> np.ndarray:
        return 2 / (cosine + np.sqrt(square + (1 - square) * cosine * cosine))

    for light in toward:
        half = light + np.array([[0], [0], [1]], np.float32)
        half = half / np.sqrt((half * half).sum(0))
        to_half, to_light = (np.maximum((normals * each).sum(0), 0) for each in (half, light))
        below = to_half * to_half * (square - 1) + 1
        spread = np.float32(_MIRRORED / 4) * square / (below * below)
        found.append(spread * masked(to_light) * to_light * masked(to_eye))
    return np.stack(found)
