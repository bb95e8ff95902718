# SPDX-License-Identifier: Apache-2.0
"""Roughness from the width of highlights: what several photos show beyond the matte surface.

A lobe of Trowbridge and Reitz (GGX) with Smith's shadowing (Walter, Marschner, Li and Torrance, Microfacet models for
refraction through rough surfaces, EGSR 2007) is fitted to the light that the matte surface leaves, for each of several
widths. Six lights sample a lobe too sparsely for one pixel, so that the pixels of a cell and its neighbors decide
together.
"""

from __future__ import annotations

from ...engine.deferred import np

FEWEST = 6  # photos
CELL = 8  # px
COUNT = 12  # widths
SUMS = 2 * COUNT + 1  # of a cell
_NARROWEST, _WIDEST = 0.1, 1.0  # roughness, the root of GGX's alpha
_REACH = 1.0  # cells: sigma of the neighborhood that decides together
_FAINT = 1e-3  # energy of a lobe, relative to the matte surface, below which none is seen
_UNSEEN = 0.8  # roughness where none is seen: the middle of those whose lobes look like a matte surface


def lobe_sums(excess: np.ndarray, normals: np.ndarray, toward: np.ndarray, matte: np.ndarray) -> np.ndarray:
    """What cells need to know of their pixels: (SUMS, pixels) float32.

    Parameters
    ----------
    excess : (n, pixels) float32
        Light beyond the matte surface; 0 where there is a shadow.
    normals : (3, pixels) float32
    toward : (n, 3, pixels or 1) float32
        Directions of the lights.
    matte : (n, pixels) float32
        Light of the matte surface.
    """
    sums = np.zeros((SUMS, excess.shape[1]), np.float32)
    for light, over, dull in zip(toward, excess, matte, strict=True):
        half = light + np.array([[0], [0], [1]], np.float32)
        half = half / np.sqrt((half * half).sum(0))
        cosines = [np.maximum((normals * each).sum(0), 0) for each in (half, light)]
        for n, roughness in enumerate(_widths()):
            lobe = np.where(dull > 0, _lobe(*cosines, normals[2], np.float32(roughness**2)), 0)
            sums[2 * n] += over * lobe
            sums[2 * n + 1] += lobe * lobe
        sums[-1] += dull * dull
    return sums


def roughness_of(sums: np.ndarray) -> np.ndarray:
    """Roughness of cells (rows, columns), `_UNSEEN` without a highlight, from their sums (SUMS, rows, columns); float32."""
    from scipy.ndimage import gaussian_filter

    near = gaussian_filter(sums, (0, _REACH, _REACH), mode="nearest")
    explained = np.maximum(near[0:-1:2], 0) ** 2 / np.maximum(near[1:-1:2], 1e-20)
    best = explained.argmax(0)
    inner = np.clip(best, 1, COUNT - 2)
    low, middle, high = (np.take_along_axis(explained, (inner + n)[None], 0)[0] for n in (-1, 0, 1))
    bend = np.maximum(2 * middle - low - high, 1e-20)
    place = np.where(best == inner, inner + np.clip((high - low) / (2 * bend), -0.5, 0.5), best)
    found = _NARROWEST * (_WIDEST / _NARROWEST) ** (place / (COUNT - 1))
    seen = explained.max(0) > _FAINT * near[-1]
    return np.where(seen, found, _UNSEEN).astype(np.float32)


def _widths() -> np.ndarray:
    return np.geomspace(_NARROWEST, _WIDEST, COUNT)


def _lobe(to_half: np.ndarray, to_light: np.ndarray, to_eye: np.ndarray, alpha: np.float32) -> np.ndarray:
    """GGX times the light that falls on the surface, without its constants."""
    square = alpha * alpha
    below = to_half * to_half * (square - 1) + 1

    def masked(cosine: np.ndarray) -> np.ndarray:
        return 2 / (cosine + np.sqrt(square + (1 - square) * cosine * cosine))

    return square / (below * below) * masked(to_light) * to_light * masked(to_eye)


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
