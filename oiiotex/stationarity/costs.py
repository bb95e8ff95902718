# SPDX-License-Identifier: Apache-2.0
"""What stationary means, measured (MJH17 section 3), beside how faithful a texture is.

Plain numpy on whole images: these are reports, not steps of a synthesis.
"""

from __future__ import annotations

import math

from ..core.source_map import SourceMap
from ..core.window import Domain
from ..deferred import np
from .steerable import responses

BINS = 64
RANGES = ((0.0, 100.0), (-60.0, 60.0), (-60.0, 60.0))  # of L, a, b; fixed, so that costs of different images compare
RESPONSE_RANGES = ((-24.0, 23.25), (-12.0, 11.625), (-12.0, 11.625))  # of responses to them; a bin stands at 0
SITES = 32  # per axis, where local statistics are compared
POWER_VARIANCES = (0.0, 1.0, 2.0, 15.0, 96.0)  # of x^p for a normal x: (2p - 1)!! - E[x^p]^2
FLAT = 1e-6  # Lab; a deviation that is rounding
_PATCHES = 1 << 18  # that a texture cost compares; of 2^18 the mean has a standard error far below its last digit


def stationarity_cost(
    lab: np.ndarray,
    sigma: float,
    domain: Domain | None = None,
    measure: str = "histogram",
    order: int = 2,
    like: np.ndarray | None = None,
) -> float:
    """MJH17 eq. 1: 0 where a texture looks the same everywhere.

    The mean over all pairs of `SITES` x `SITES` places of the difference between what is seen there through a Gaussian:
    the earth mover's distance between histograms of colours (eq. 3) or of the responses of steerable filters (eq. 4),
    or the squared difference of moments (eq. 2), summed over channels, filters and orders.

    Moments of different order have units that do not add, and are ruled by where zero lies. So they are taken of values
    less their overall mean in units of their overall deviation, and squared differences are divided by the variance
    that the power has under a normal distribution and multiplied by the overall one (departure): every order counts in
    squared Lab units, and as much. A channel of variance 0 costs nothing.

    Parameters
    ----------
    lab : (height, width, 3) float
        CIE Lab.
    sigma : float
        Standard deviation of the Gaussian window, px.
    domain : Domain or None
        Of the image: windows end at the border of an axis that does not wrap. None: it is a torus.
    measure : str
        histogram, moments or steerable.
    order : int
        Moments up to this one.
    like : (n, m, 3) float or None
        Whose overall mean and deviation moments are measured by, so that costs compare; the image's own when left out.

    Returns
    -------
    float
        In Lab units; moments in squared Lab units.
    """
    height, width = lab.shape[:2]
    wrap_x, wrap_y = (True, True) if domain is None else domain.wraps
    windows = _windows(height, sigma, wrap_y), _windows(width, sigma, wrap_x)
    if measure == "moments":
        unit = lab if like is None else like
        return sum(_moment_cost(lab[..., c], unit[..., c], order, *windows) for c in range(3))
    if measure == "steerable":
        planes = ((p, RESPONSE_RANGES[c]) for c in range(3) for p in responses(lab[..., c], (wrap_x, wrap_y)))
    else:
        planes = ((lab[..., c], RANGES[c]) for c in range(3))
    return sum(_histogram_cost(plane, *limits, *windows) for plane, limits in planes)


def _histogram_cost(plane: np.ndarray, low: float, high: float, down: np.ndarray, right: np.ndarray) -> float:
    """Earth mover's distances between local histograms of a plane.

    In one dimension it is the area between the cumulatives; per bin, the mean over all pairs is a Gini mean
    difference, which sorting gives exactly in N log N.
    """
    n = down.shape[0] * right.shape[0]
    rank = 2.0 * np.arange(1, n + 1) - n - 1.0
    bin_width = (high - low) / (BINS - 1)
    place = np.clip((plane - low) / bin_width, 0.0, BINS - 1.0).astype(np.float32)
    total = 0.0
    for b in range(int(place.min()), min(BINS - 1, int(place.max()) + 1)):  # elsewhere all cumulatives are 0 or 1
        below = down @ np.clip(np.float32(b + 1) - place, np.float32(0), np.float32(1)) @ right.T
        total += (rank * np.sort(below, axis=None)).sum() / max(n * (n - 1) / 2.0, 1.0) * bin_width
    return float(total)


def _moment_cost(plane: np.ndarray, unit: np.ndarray, order: int, down: np.ndarray, right: np.ndarray) -> float:
    """Squared differences between local moments of a plane: over all pairs, twice their variance."""
    mean, deviation = float(unit.mean(dtype=np.float64)), float(unit.std(dtype=np.float64))
    if deviation <= FLAT:
        return 0.0
    z = (plane.astype(np.float64) - mean) / deviation
    n = down.shape[0] * right.shape[0]
    spreads = ((down @ z**p @ right.T).var() / POWER_VARIANCES[p] for p in range(1, order + 1))
    return float(deviation**2 * sum(spreads) * 2.0 * n / max(n - 1, 1))


def texture_cost(lab: np.ndarray, exemplar: np.ndarray, matches: SourceMap, patch: int = 11) -> float:
    """MJH17 eq. 5 for a given field of matches: how unlike the exemplar the texture is, seen through patches.

    With matches found by PatchMatch it is an upper bound of the cost, which takes the best ones.

    Parameters
    ----------
    lab : (height, width, 3) float
    exemplar : (h, w, 3) float
    matches : SourceMap
        (rows, columns): top-left pixel of the exemplar patch matched to the texture patch whose top-left pixel is
        there. Patches that cross the border of the texture wrap.
    patch : int
        Side of a patch.

    Returns
    -------
    float
        Mean squared Lab difference per patch pixel; of `_PATCHES` patches or more, of those on a grid.
    """
    step = max(1, math.isqrt(matches.packed.size // _PATCHES))
    rows, columns = matches.packed.shape
    match_y, match_x = matches[::step, ::step].yx
    y, x = np.arange(0, rows, step), np.arange(0, columns, step)
    total = 0.0
    for dy in range(patch):
        for dx in range(patch):
            here = lab[np.ix_((y + dy) % lab.shape[0], (x + dx) % lab.shape[1])]
            total += float(((here - exemplar[match_y + dy, match_x + dx]).astype(np.float64) ** 2).sum())
    return total / (y.size * x.size * patch * patch)


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
