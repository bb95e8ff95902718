# SPDX-License-Identifier: Apache-2.0
"""Local moment matching at every pixel, MJH17 section 4.3 to the letter: the oracle of projections/moments.py."""

from __future__ import annotations

import numpy as np
from scipy import special

from tests.reference.histograms import gaussian_rows
from tests.reference.pearson import pearson_ppf


def local_moments(image: np.ndarray, sigma: float, wrap_x: bool, wrap_y: bool) -> np.ndarray:
    """Mean, variance, third and fourth central moment around every pixel of a plane: (4, height, width)."""
    down, right = gaussian_rows(image.shape[0], sigma, wrap_y), gaussian_rows(image.shape[1], sigma, wrap_x)
    raw = [down @ (image.astype(np.float64) - 400) ** k @ right.T for k in range(1, 5)]
    return central(*raw)


def central(m1: np.ndarray, m2: np.ndarray, m3: np.ndarray, m4: np.ndarray) -> np.ndarray:
    return np.stack([
        400 + m1, m2 - m1**2, m3 - 3 * m1 * m2 + 2 * m1**3, m4 - 4 * m1 * m3 + 6 * m1**2 * m2 - 3 * m1**4,
    ])  # fmt: skip


def softened(moments: np.ndarray, width: float) -> np.ndarray:
    """Of the values spread over triangles of that half width: a numeric convolution of two-point-like moments."""
    grid = np.linspace(-width, width, 4001)
    weight = (1 - np.abs(grid) / width) / (1 - np.abs(grid) / width).sum()
    second, fourth = (weight * grid**2).sum(), (weight * grid**4).sum()
    mean, m2, m3, m4 = moments
    return np.stack([mean, m2 + second, m3, m4 + 6 * m2 * second + fourth])


def project(
    image: np.ndarray, sigma: float, low: float, high: float, bins: int, wrap_x: bool, wrap_y: bool, order: int,
    places: list[tuple[int, int]],
) -> np.ndarray:  # fmt: skip
    """c' = G^-1(F(c)) at some places of a plane, each cumulative a Pearson distribution's sampled into bins."""
    width = max(1.0, high - low) / (bins - 1)
    local = softened(local_moments(image, sigma, wrap_x, wrap_y), width)
    overall = softened(central(*[((image.astype(np.float64) - 400) ** k).mean() for k in range(1, 5)]), width)
    values = np.linspace(low, high, 4001)
    goal = cumulative(values, overall, order, width)

    def matched(value: float, moments: np.ndarray) -> float:
        if order == 2:
            return overall[0] + np.sqrt(overall[1] / moments[1]) * (value - moments[0])
        share = cumulative(np.array([value]), moments, order, width)[0]
        return float(np.interp(share, goal, values))

    return np.array([np.clip(matched(float(image[at]), local[:, *at]), low, high) for at in places])


def cumulative(values: np.ndarray, moments: np.ndarray, order: int, width: float) -> np.ndarray:
    mean, deviation = moments[0], np.sqrt(moments[1])
    skewness = moments[2] / moments[1] ** 1.5
    kurtosis = 3 + 1.5 * skewness**2 if order == 3 else moments[3] / moments[1] ** 2
    shares = special.ndtr(np.linspace(-5, 5, 1001))
    quantiles = pearson_ppf(shares, skewness, kurtosis)
    ends = [(values + off - mean) / deviation for off in (-width / 4, width / 4)]
    return np.mean([np.interp(u, quantiles, shares, left=0, right=1) for u in ends], 0)
