# SPDX-License-Identifier: Apache-2.0
"""Exponentials, logarithms and roots from + - * / only, and sampled Gaussians.

IEEE 754 defines these four operations exactly, but not exp and log, whose last bits differ between processors and C
libraries. Where results are used in decisions, as with labels from spectra, such a difference can become large.
"""

from __future__ import annotations

import functools
import math

from ..deferred import np

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 0.693147180369123816490  # 32 bits: its product with any exponent is exact
_LN2_LOW = 1.90821492927058770002e-10
_DEGREE = 13  # of the polynomial for the exponential, within half an octave
_TERMS = 11  # of the series for the logarithm
_LARGEST = 700.0


def exponential(x: np.ndarray) -> np.ndarray:
    """e^x with a relative error of 1e-15, float64; x is clamped to -700 .. 700."""
    x = np.clip(np.asarray(x, np.float64), -_LARGEST, _LARGEST)
    octave = np.rint(x * _LOG2_E)
    rest = (x - octave * _LN2_HIGH) - octave * _LN2_LOW
    value = np.full_like(rest, 1.0 / math.factorial(_DEGREE))
    for k in range(_DEGREE - 1, -1, -1):
        value *= rest
        value += 1.0 / math.factorial(k)
    return np.ldexp(value, octave.astype(np.int32))


def logarithm(x: np.ndarray) -> np.ndarray:
    """The natural logarithm of x > 0 with an error of 1e-15, float64."""
    share, octave = np.frexp(np.asarray(x, np.float64))
    low = share < math.sqrt(0.5)
    share, octave = np.where(low, 2.0 * share, share), octave - low
    ratio = (share - 1.0) / (share + 1.0)  # log(share) = 2 artanh(ratio), for shares from sqrt(1/2) to sqrt(2)
    square, value = ratio * ratio, np.full_like(ratio, 1.0 / (2 * _TERMS + 1))
    for k in range(_TERMS - 1, -1, -1):
        value *= square
        value += 1.0 / (2 * k + 1)
    return octave * _LN2_HIGH + (octave * _LN2_LOW + 2.0 * ratio * value)


def root(x: np.ndarray, k: int) -> np.ndarray:
    """The kth root of x >= 0 with a relative error of 1e-14, float64."""
    x = np.asarray(x, np.float64)
    above = np.maximum(x, 1e-300)
    return np.where(x > 0, exponential(logarithm(above) / k), 0.0)


@functools.lru_cache(64)  # a memory plan asks for the same ones for each height of its bands
def gaussian_taps(sigma: float, reach: float, most: int | None = None) -> np.ndarray:
    """Weights that sum to 1, (2 radius + 1,) float64, read-only.

    Parameters
    ----------
    sigma : float
        Standard deviation, in samples; above 0.
    reach : float
        The radius in sigmas, rounded up; at least 1 sample.
    most : int or None
        The maximum radius in samples.
    """
    radius = max(1, math.ceil(reach * sigma))
    radius = radius if most is None else min(radius, most)
    weights = exponential(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    weights /= weights.sum()
    weights.setflags(write=False)
    return weights
