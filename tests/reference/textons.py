# SPDX-License-Identifier: Apache-2.0
"""Texton histograms and their comparison, place by place: the oracle of segmentation/textons.py."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter


def disc_histogram(counts: np.ndarray, y: int, x: int, radius: float) -> np.ndarray:
    """CZF02 eq. 2 and the scaling to a sum of 1: the histogram of one place."""
    rows, columns = np.mgrid[0 : counts.shape[0], 0 : counts.shape[1]]
    total = counts[(rows - y) ** 2 + (columns - x) ** 2 <= radius * radius].sum(0).astype(np.float64)
    return total / max(total.sum(), 1)


def bhattacharyya(p: np.ndarray, q: np.ndarray) -> float:
    """CZF02 eq. 3."""
    return float(np.sqrt(p * q).sum())


def weights(values: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """CZF02 eq. 1 with sums of 1; sigma^2 is the mean quantization error: (n, d), (k, d) -> (n, k)."""
    apart = ((values[:, None] - centers) ** 2).sum(-1)
    found = np.exp(-apart / (2 * apart.min(1).mean()))
    return found / found.sum(1, keepdims=True)


def best_match(counts: np.ndarray, i: tuple[int, int], j: tuple[int, int], radius: float, shift: float) -> float:
    """CZF02 section II B: the best coefficient of i with any place within `shift` of j, by looking at all of them."""
    here = disc_histogram(counts, *i, radius)
    best = 0.0
    for y in range(counts.shape[0]):
        for x in range(counts.shape[1]):
            if (y - j[0]) ** 2 + (x - j[1]) ** 2 <= shift * shift:
                best = max(best, bhattacharyya(here, disc_histogram(counts, y, x, radius)))
    return best


def members(values: np.ndarray, labels: np.ndarray, sigma: float, couplings: tuple, updates: int) -> np.ndarray:
    """Mean field of a Potts model with Gaussian neighborhoods: (h, w, k) counts, (h, w) -> (h, w, n) float64."""
    member = np.eye(labels.max() + 1)[labels]
    for coupling in couplings:
        chances = np.einsum("yxn,yxk->nk", member, values) + 5
        likely = values @ np.log(chances / chances.sum(1, keepdims=True)).T / values.sum(-1).max()
        likely = _blurred(likely - likely.max(-1, keepdims=True), 1.0)
        for _ in range(updates):
            pull = np.exp(likely + coupling * _blurred(member, sigma))
            member = pull / pull.sum(-1, keepdims=True)
    return member


def _blurred(values: np.ndarray, sigma: float) -> np.ndarray:
    return np.stack([gaussian_filter(v, sigma, truncate=2.5) for v in np.moveaxis(values, -1, 0)], -1)
