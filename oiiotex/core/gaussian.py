# SPDX-License-Identifier: Apache-2.0
"""Sampled Gaussians."""

from __future__ import annotations

import math

from ..deferred import np
from .elementary import exponential


def gaussian_taps(sigma: float, reach: float, most: int | None = None) -> np.ndarray:
    """Weights that sum to 1, (2 radius + 1,) float64.

    Parameters
    ----------
    sigma : float
        Standard deviation, in samples; above 0.
    reach : float
        The radius in sigmas: rounded up, 1 or more.
    most : int or None
        The radius in samples, at most.
    """
    radius = max(1, math.ceil(reach * sigma))
    radius = radius if most is None else min(radius, most)
    weights = exponential(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return weights / weights.sum()
