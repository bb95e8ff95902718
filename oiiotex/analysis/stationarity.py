# SPDX-License-Identifier: Apache-2.0
"""What stationary means, measured (MJH17 section 3), beside how faithful and how seamless a texture is.

Plain numpy on whole images: these are reports, not steps of a synthesis.
"""

from __future__ import annotations

import numpy as np

BINS = 64
RANGES = ((0.0, 100.0), (-60.0, 60.0), (-60.0, 60.0))  # of L, a, b; fixed, so that costs of different images compare
SITES = 32  # per axis, where local histograms are compared


def stationarity_cost(lab: np.ndarray, sigma: float, wrap_x: bool = True, wrap_y: bool = True) -> float:
    """MJH17 eq. 1 with histograms (eq. 3) and the earth mover's distance: 0 where a texture looks the same everywhere.

    The mean over all pairs of `SITES` x `SITES` places of the one-dimensional distance between the local histograms
    there, summed over L, a and b. In one dimension it is the area between the cumulatives; per bin, the mean over all
    pairs is a Gini mean difference, which sorting gives exactly in N log N.

    Parameters
    ----------
    lab : (height, width, 3) float
        CIE Lab.
    sigma : float
        Standard deviation of the Gaussian window, px.
    wrap_x, wrap_y : bool
        The image is a torus along that axis; else windows end at its border.

    Returns
    -------
    float
        In Lab units.
    """
    height, width = lab.shape[:2]
    down, right = _windows(height, sigma, wrap_y), _windows(width, sigma, wrap_x)
    n = down.shape[0] * right.shape[0]
    rank = 2.0 * np.arange(1, n + 1) - n - 1.0
    total = 0.0
    for c, (low, high) in enumerate(RANGES):
        bin_width = (high - low) / (BINS - 1)
        place = np.clip((lab[..., c] - low) / bin_width, 0.0, BINS - 1.0)
        lower = np.minimum(place.astype(np.int64), BINS - 2)
        upper_share = (place - lower).astype(np.float32)
        below = np.zeros(n)
        for b in range(BINS - 1):  # the cumulative of the last bin is 1 everywhere
            member = np.where(lower == b, 1.0 - upper_share, 0.0) + np.where(lower == b - 1, upper_share, 0.0)
            if member.any():
                below += (down @ member.astype(np.float32) @ right.T).ravel()
            total += (rank * np.sort(below)).sum() / (n * (n - 1) / 2.0) * bin_width
    return float(total)


def texture_cost(
    lab: np.ndarray, exemplar: np.ndarray, match_y: np.ndarray, match_x: np.ndarray, patch: int = 11
) -> float:
    """MJH17 eq. 5 for a given field of matches: how unlike the exemplar the texture is, seen through patches.

    With matches found by PatchMatch it is an upper bound of the cost, which takes the best ones.

    Parameters
    ----------
    lab : (height, width, 3) float
    exemplar : (h, w, 3) float
    match_y, match_x : (rows, columns) int
        Top-left pixel of the exemplar patch matched to the texture patch whose top-left pixel is there. Patches that
        cross the border of the texture wrap.
    patch : int
        Side of a patch.

    Returns
    -------
    float
        Mean squared Lab difference per patch pixel.
    """
    rows, columns = match_y.shape
    y, x = np.arange(rows), np.arange(columns)
    total = 0.0
    for dy in range(patch):
        for dx in range(patch):
            here = lab[np.ix_((y + dy) % lab.shape[0], (x + dx) % lab.shape[1])]
            total += float(((here - exemplar[match_y + dy, match_x + dx]).astype(np.float64) ** 2).sum())
    return total / (rows * columns * patch * patch)


def seam_ratio(values: np.ndarray, axis: int) -> float:
    """Mean jump across the wrap over the mean jump inside: 1 is invisible.

    Parameters
    ----------
    values : (height, width) or (height, width, channels) float
    axis : int
        0: top against bottom; 1: left against right.
    """
    inside = np.abs(np.diff(values, axis=axis)).mean()
    first, last = np.take(values, 0, axis=axis), np.take(values, -1, axis=axis)
    return float(np.abs(first - last).mean() / max(inside, 1e-12))


def _windows(size: int, sigma: float, wrap: bool) -> np.ndarray:
    """Normalised Gaussian weights of all pixels of one axis, a row for every site: (sites, size) float32."""
    sites = np.arange(min(SITES, size)) * size / min(SITES, size)
    away = np.abs(np.arange(size)[None, :] - sites[:, None])
    if wrap:
        turns = np.arange(-1 - int(5 * sigma / size), 2 + int(5 * sigma / size)) * size
        weights = np.exp(-0.5 * ((away[..., None] + turns) / sigma) ** 2).sum(-1)
    else:
        weights = np.exp(-0.5 * (away / sigma) ** 2)
    return (weights / weights.sum(1, keepdims=True)).astype(np.float32)
