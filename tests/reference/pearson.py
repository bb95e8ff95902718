# SPDX-License-Identifier: Apache-2.0
"""The Pearson system in closed form (Johnson & Kotz 1970, as MJH17 section 4.3 has it): a distribution by four moments.

All here are standardized: mean 0, variance 1. Types I to III and V to VII, and the normal distribution, are scipy's;
type IV, which scipy lacks, has a closed density whose cumulative is summed up.

`python -m tests.reference.pearson` writes the table that `oiiotex.synthesis.projections.pearson_table` reads.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy import special, stats

from oiiotex.synthesis.projections import pearson_table
from oiiotex.synthesis.projections.pearson_table import (
    HALF_EXCESS,
    HALF_SKEWNESS,
    KURTOSES,
    MOST_EXCESS,
    MOST_SKEWNESS,
    SCORES,
    SKEWNESSES,
    TABLE_FILE,
    bent,
)

_SCORE = 4.0  # shares of the table are those below normal scores from -4 to 4, in equal steps
_NEAR = 1e-6  # to a border between two types, relative: there the neighbor's formula loses its digits
_PLACES, _FAR = 4097, 10.0  # at which the density of type IV is summed: up to sinh(10) deviations away


def pearson_ppf(shares: np.ndarray, skewness: float, kurtosis: float) -> np.ndarray:
    """The value below which a share lies, of the distribution with these moments.

    Parameters
    ----------
    shares : (n,) float
        Between 0 and 1.
    skewness : float
        Third standardized moment.
    kurtosis : float
        Fourth standardized moment, 3 for the normal distribution. At its bound 1 + skewness^2, and below, where no
        distribution has it, this is the two values that have just this skewness.

    Returns
    -------
    (n,) float
        In standard deviations from the mean.
    """
    shares = np.asarray(shares, np.float64)
    if skewness < 0:
        return -pearson_ppf(1.0 - shares, -skewness, kurtosis)
    if kurtosis <= (1.0 + skewness**2) * (1.0 + _NEAR):
        return _two_values(shares, skewness)
    # p' / p = -(d u + c1) / (c0 + c1 u + c2 u^2): Pearson's equation for these moments
    squared = skewness**2
    c0, c1, c2 = 4 * kurtosis - 3 * squared, skewness * (kurtosis + 3), 2 * kurtosis - 3 * squared - 6
    d = 10 * kurtosis - 12 * squared - 18
    if abs(c2) < _NEAR * c0:
        return stats.pearson3.ppf(shares, skewness)  # type III; the normal distribution at skewness 0
    if skewness < _NEAR and c2 > 0:
        return _student(shares, kurtosis)
    discriminant = c1**2 - 4 * c0 * c2
    if abs(discriminant) < _NEAR * c1**2:
        return _inverse_gamma(shares, -c1 / (2 * c2), c1, c2, d)
    if discriminant < 0:
        return _fourth_type(shares, c0, c1, c2, d)
    root = math.sqrt(discriminant)
    first, second = sorted(((-c1 - root) / (2 * c2), (-c1 + root) / (2 * c2)))
    # p = (u - first)^m1 (u - second)^m2
    m1 = -(d * first + c1) / (c2 * (first - second))
    m2 = -(d * second + c1) / (c2 * (second - first))
    if c2 < 0:  # type I, and II where it is symmetric
        return first + (second - first) * stats.beta.ppf(shares, m1 + 1, m2 + 1)
    return second + (second - first) * stats.betaprime.ppf(shares, m2 + 1, -m1 - m2 - 1)  # type VI


def _two_values(shares: np.ndarray, skewness: float) -> np.ndarray:
    root = math.sqrt(skewness**2 + 4)
    low, high = (skewness - root) / 2, (skewness + root) / 2
    return np.where(shares < high / (high - low), low, high)


def _student(shares: np.ndarray, kurtosis: float) -> np.ndarray:
    """Type VII."""
    freedom = 4 + 6 / (kurtosis - 3)
    return stats.t.ppf(shares, freedom) / math.sqrt(freedom / (freedom - 2))


def _inverse_gamma(shares: np.ndarray, root: float, c1: float, c2: float, d: float) -> np.ndarray:
    """Type V: p = (u - root)^(-d / c2) exp((d root + c1) / (c2 (u - root)))."""
    return root + stats.invgamma.ppf(shares, d / c2 - 1, scale=-(d * root + c1) / c2)


def _fourth_type(shares: np.ndarray, c0: float, c1: float, c2: float, d: float) -> np.ndarray:
    """Type IV: p = ((u - middle)^2 + width^2)^(-d / (2 c2)) exp(-lean arctan((u - middle) / width))."""
    middle, width = -c1 / (2 * c2), math.sqrt(4 * c0 * c2 - c1**2) / (2 * c2)
    lean = (d * middle + c1) / (c2 * width)
    steps = np.linspace(-_FAR, _FAR, _PLACES)
    u = np.sinh(steps)
    log_density = -d / (2 * c2) * np.log((u - middle) ** 2 + width**2) - lean * np.arctan((u - middle) / width)
    density = np.exp(log_density - log_density.max()) * np.cosh(steps)
    below = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    return np.sinh(np.interp(shares, below / below[-1], steps))


def tabulated() -> dict[str, np.ndarray]:
    """What `pearson_table.TABLE_FILE` holds, made anew: its shares, and the quantiles there of every distribution."""
    shares = special.ndtr(np.linspace(-_SCORE, _SCORE, SCORES))
    quantiles = np.empty((SKEWNESSES, KURTOSES, SCORES), np.float32)
    for i, skewness in enumerate(_evenly_bent(MOST_SKEWNESS, HALF_SKEWNESS, SKEWNESSES)):
        for j, excess in enumerate(_evenly_bent(MOST_EXCESS, HALF_EXCESS, KURTOSES)):
            quantiles[i, j] = pearson_ppf(shares, skewness, 1 + skewness**2 + excess)
    return {"shares": shares, "quantiles": quantiles}


def _evenly_bent(most: float, half: float, count: int) -> np.ndarray:
    """Values from 0 to `most` that `bent` makes even steps of."""
    steps = np.linspace(0, bent(most, half), count)
    return half * steps / (1 - steps)


if __name__ == "__main__":
    np.savez_compressed(Path(pearson_table.__file__).parent / TABLE_FILE, **tabulated())
