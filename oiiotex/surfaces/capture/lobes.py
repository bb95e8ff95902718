# SPDX-License-Identifier: Apache-2.0
"""Highlights in several photos of a matte surface, and the roughness that their width tells.

A lobe of Trowbridge and Reitz (GGX) with Smith's shadowing (Walter, Marschner, Li and Torrance, Microfacet models for
refraction through rough surfaces, EGSR 2007) of a surface that mirrors 4 %, as nearly all do but metals, is compared
with the residuals of the matte surface, for each of several widths. Few lights sample a lobe too sparsely for
one pixel, so that the pixels of a cell decide together.
"""

from __future__ import annotations

from ...engine.deferred import np
from .photometric import Fit, Solver, fit_of, reweighted, shading, summed, trusted

FEWEST = 6  # photos that tell roughness
CELL = 8  # px
WIDTHS = 8
_NARROWEST, _WIDEST = 0.15, 0.95  # roughness, the root of GGX's alpha
_MIRRORED = 0.04  # share of the light
_TAKEN = 0.5  # share of the lobes that is subtracted: exposures are unknown, and too much costs more than too little
_STEPS = 3  # of the fit of surface and highlights
_STEP = 0.5  # of the albedo: longest step
_TURN = 0.02  # radians, for derivatives
_DARKEST = 0.02  # albedo
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
    misfits, solver, excess = [], Solver(toward, fit.weights), 2 * over
    angles = _angles(fit.normals, toward)
    for roughness in _widths():
        left = _lobes(angles, roughness * roughness)
        left -= shading(solver.surface(left), toward)
        change = left - excess
        change *= lit
        misfits.append(summed(left, change))
    return np.stack(misfits)


def shown_by(cells: np.ndarray, shape: tuple[int, int], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Whether the pixels of a piece of (height, width) show highlights, 0 or 1, and alpha; (pixels,) float32."""
    best = cells.argmin(0)
    found = (cells.min(0) < 0) & ((count >= FEWEST) | (_widths()[best] > _PLACED))
    strength = np.where(found, np.float32(1), np.float32(0))

    def at_pixels(values: np.ndarray) -> np.ndarray:
        return values.repeat(CELL, 0).repeat(CELL, 1)[: shape[0], : shape[1]].ravel()

    return at_pixels(strength), at_pixels(_widths()[best] ** 2)


def subtracted(
    seen: np.ndarray, toward: np.ndarray, fit: Fit, shown: tuple[np.ndarray, np.ndarray]
) -> tuple[Fit, np.ndarray]:
    """The matte surface without a share of the highlights, and that share, (n, pixels) float32."""
    bright = _lobes(_angles(fit.normals, toward), shown[1], np.float32(_TAKEN) * shown[0])
    return fit_of(Solver(toward, fit.weights).surface(seen - bright), fit.weights), bright


def refined(
    seen: np.ndarray, toward: np.ndarray, valid: np.ndarray, fit: Fit, shown: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Normals that explain the photos along with their highlights, (3, pixels) float32.

    A wide highlight alone looks like a steeper matte surface, above all on dark ones. Both are fitted by a few steps of
    Gauss and Newton, with the lobe's derivatives along two tangents of the normal.

    Parameters
    ----------
    seen, toward, valid
        As in `fitted`, with directions (n, 3, pixels or 1).
    fit : Fit
        Of the matte surface alone.
    shown : (strength, alpha)
        Of the lobe, (pixels,) float32.
    """
    strength, alpha = shown
    trust = trusted(valid)
    for _ in range(_STEPS):
        normals, surface = fit.normals, fit.normals * fit.albedo
        least = np.maximum(fit.albedo, np.float32(_DARKEST))
        lobes = _lobes(_angles(normals, toward), alpha, strength)
        ahead = np.maximum(np.sqrt(normals[0] * normals[0] + normals[2] * normals[2]), np.float32(_TURN))
        right = np.stack([normals[2], np.zeros_like(ahead), -normals[0]]) / ahead
        up = np.cross(normals, right, axis=0)
        rates = np.zeros((len(seen), 3, seen.shape[1]), np.float32)
        for tangent in (right, up):
            turned = normals + np.float32(_TURN) * tangent
            turned /= np.sqrt((turned * turned).sum(0))
            change = _lobes(_angles(turned, toward), alpha, strength)
            change -= lobes
            rates += change[:, None] * (tangent / (np.float32(_TURN) * least))
        shade = shading(surface, toward)
        lit = shade > 0
        np.maximum(shade, 0, out=shade)
        shade += lobes
        weights = reweighted(seen, shade, lit, trust)
        matte = np.subtract(seen, lobes, out=lobes)
        matte += shading(surface, rates)
        rates += toward
        step = Solver(rates, weights).surface(matte) - surface
        far = np.sqrt((step * step).sum(0)) / (np.float32(_STEP) * least)
        fit = fit_of(surface + step / np.maximum(far, 1), weights)
    return fit.normals


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


def _angles(normals: np.ndarray, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines of normals with half vectors and lights, (n, pixels) float32, and with the camera, (pixels,)."""
    to_half, to_light = shading(normals, _halves(toward)), shading(normals, toward)
    return np.maximum(to_half, 0, out=to_half), np.maximum(to_light, 0, out=to_light), normals[2]


def _halves(toward: np.ndarray) -> np.ndarray:
    """Unit vectors halfway between the lights and the camera."""
    half = toward + np.array([[0], [0], [1]], np.float32)
    half /= np.sqrt((half * half).sum(1, keepdims=True))
    return half


def _lobes(
    angles: tuple[np.ndarray, np.ndarray, np.ndarray],
    alpha: np.ndarray | np.float32,
    strength: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Highlights under each light, relative to white that faces it, (n, pixels) float32."""
    (to_half, to_light, to_eye), square = angles, alpha * alpha

    def masking(cosine: np.ndarray) -> np.ndarray:  # twice the inverse of Smith's
        root = cosine * cosine
        root *= 1 - square
        root += square
        root = np.sqrt(root, out=root)
        root += cosine
        return root

    below = to_half * to_half
    below *= square - 1
    below += 1
    below *= below
    below *= masking(to_light)
    lobes = to_light * (strength * square * np.float32(_MIRRORED) / masking(to_eye))
    lobes /= below
    return lobes
