# SPDX-License-Identifier: Apache-2.0
"""Unknown lights: their intensities, and their directions as far as photos tell them.

Photos of a matte surface have rank three: they are pseudo-normals times lights, up to a linear map (Hayakawa,
Photometric stereo under a light source with arbitrary motion, JOSA A 11(11), 1994). Slopes of a surface have no curl,
which leaves the generalized bas-relief ambiguity (Belhumeur, Kriegman and Yuille, The bas-relief ambiguity, IJCV 35(1),
1999; Yuille and Snow, Shape and albedo from multiple images using integrability, CVPR 1997): a tilt, the strength of
the relief, and whether it is raised or recessed. The surface is taken to face the camera on average, which is true of
materials and decides the tilt. The two others are not in the photos: the caller chooses them.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ...engine.deferred import np
from .lights import Lights
from .photometric import fitted

_ROUNDS = 10
_DIM = 0.2  # of the light of the photo that is brightest there: less says little of an intensity
_KEPT = 0.5  # share of the pixels, those without highlights and shadows, that decides directions
_SELECTED = 20  # rounds in which they are selected
_GRID = 1 << 14  # directions are rounded to its inverse, so that bits do not depend on the solver's
_BLUR = 1.0  # px of the reduced photos, before differences


def with_intensities(lights: Lights, photos: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[Lights, float]:
    """The lights with the intensities for which the surface faces the camera on average; their geometric mean is 1.

    Alternates between surface and intensities, as semi-calibrated photometric stereo does (Cho, Matsushita, Tai and
    Kweon, Photometric stereo under non-uniform light intensities and exposures, ECCV 2016). Without the mean slope, a
    flat surface would leave the intensities open.

    Parameters
    ----------
    lights : Lights
    photos : (n, pixels) float32
        Linear luminance of pixels that are valid in all photos.
    x, y : (pixels,) float64
        Their places, px.

    Returns
    -------
    lights : Lights
    agreed : float
        Mean weight of the photos: the share that one matte surface explains.
    """
    toward, falloff = lights.at(x, y)
    seen = photos / falloff
    power = seen.mean(1, dtype=np.float64) / lights.directions[:, 2]
    for _ in range(_ROUNDS):
        power /= np.exp(np.log(np.maximum(power, 1e-9)).mean())
        fit = fitted(seen / power[:, None].astype(np.float32), toward, np.ones(seen.shape, bool))
        shade = fit.albedo * (toward * _level(fit.normals.astype(np.float64), fit.albedo)).sum(1)
        for n, (one, expected) in enumerate(zip(seen, shade, strict=True)):
            lit = expected > _DIM * shade.max(0)
            power[n] = np.median(one[lit] / expected[lit]) if lit.any() else power[n]  # of all: weights would agree
    power /= np.exp(np.log(np.maximum(power, 1e-9)).mean())
    return replace(lights, intensities=np.round(power * _GRID) / _GRID), float(fit.weights.mean())


def _level(normals: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Normals (3, pixels) turned so that their weighted mean faces the camera."""
    mean = (normals * weights).sum(1)
    mean /= max(float(np.linalg.norm(mean)), 1e-12)
    axis = np.cross(mean, [0, 0, 1])  # Rodrigues' rotation, whose angle has the cosine mean[2]
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + skew + skew @ skew / (1 + max(mean[2], 0))
    leveled: np.ndarray = turn @ normals
    return leveled


def found_directions(photos: np.ndarray, first: float) -> np.ndarray | None:
    """Directions towards the lights, 45 degrees high on average; None if the photos do not tell.

    Parameters
    ----------
    photos : (n, height, width) float
        Linear luminance of a reduced surface; NaN where it is not seen.
    first : float
        Direction of the first photo's light, degrees counterclockwise from the right: decides between raised and
        recessed.
    """
    from scipy.ndimage import binary_erosion  # slow to import

    seen = np.isfinite(photos).all(0)
    pseudo, lights, matte = _of_rank_three(photos[:, seen])
    field, trusted = np.zeros((*seen.shape, 3)), seen.copy()
    field[seen], trusted[seen] = pseudo, matte
    linear = _integrable(field, binary_erosion(seen, iterations=3) & trusted)
    if linear is None:
        return None
    a1, a2, a3 = linear
    mean = pseudo.mean(0)
    if mean @ a3 < 0:
        a3 = -a3
    a1, a2 = (a - a3 * (mean @ a) / (mean @ a3) for a in (a1, a2))
    found = np.linalg.solve(np.stack([a1, a2, a3], 1), lights).T  # photos = pseudo @ lights = (pseudo A) (A^-1 lights)
    flat = np.hypot(found[:, 0], found[:, 1])
    if not (np.isfinite(found).all() and (found[:, 2] > 0).all() and (flat > 0).any()):
        return None
    found[:, 2] *= np.median(flat / found[:, 2])
    if found[0, 0] * math.cos(math.radians(first)) + found[0, 1] * math.sin(math.radians(first)) < 0:
        found[:, :2] *= -1
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return np.round(found * _GRID) / _GRID


def _of_rank_three(seen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pseudo-normals (pixels, 3) and lights (3, n) whose product is closest to the photos, and where it is close."""
    values = seen.astype(np.float64)
    matte = np.ones(seen.shape[1], bool)
    for share in np.linspace(1, _KEPT, _SELECTED):
        lights = np.linalg.eigh(values[:, matte] @ values[:, matte].T)[1][:, -3:].T
        pseudo = values.T @ lights.T
        misfit = ((values - (pseudo @ lights).T) ** 2).sum(0) / np.maximum((values**2).sum(0), 1e-12)
        matte = misfit <= np.quantile(misfit, share)
    return pseudo, lights, matte


def _integrable(field: np.ndarray, trusted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Columns of a matrix that turns pseudo-normals (height, width, 3) into those of a surface, up to the ambiguity.

    With columns a1, a2, a3, the curl of the slopes is (b x db/dy) . (a3 x a1) - (b x db/dx) . (a3 x a2).
    """
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(field, (_BLUR, _BLUR, 0))
    right, up = np.gradient(smooth, axis=1), -np.gradient(smooth, axis=0)
    size = np.maximum((smooth[trusted] ** 2).sum(-1, keepdims=True), 1e-12)
    system = np.concatenate([np.cross(smooth, up)[trusted] / size, -np.cross(smooth, right)[trusted] / size], 1)
    if len(system) < 6:
        return None
    u, v = np.split(np.linalg.eigh(system.T @ system)[1][:, 0], 2)  # a3 x a1, a3 x a2
    a3 = np.cross(u, v)
    square = float(a3 @ a3)
    if square < 1e-18:
        return None
    return np.cross(u, a3) / square, np.cross(v, a3) / square, a3
