# SPDX-License-Identifier: Apache-2.0
"""Stationarity as a cost (MJH17 section 3), and the texture cost compared with an exemplar.

Plain numpy on rows that may be in a file: these are measures, not steps of a synthesis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from ..core.demand import SomeRows
from ..core.source_map import SourceMap
from ..core.window import Domain
from ..deferred import np
from .row_bands import row_bands, rows_around
from .steerable import ORIENTATIONS, RADIUS, responses

BINS = 64
RANGES = ((0.0, 100.0), (-60.0, 60.0), (-60.0, 60.0))  # of L, a, b; fixed, so that costs of different images compare
RESPONSE_RANGES = ((-24.0, 23.25), (-12.0, 11.625), (-12.0, 11.625))  # of filter responses to L, a, b; 0 is a bin
SITES = 32  # per axis, at which local statistics are compared
POWER_VARIANCES = (0.0, 1.0, 2.0, 15.0, 96.0)  # of x^p for a normal x: (2p - 1)!! - E[x^p]^2
FLAT = 1e-6  # Lab; a smaller deviation is rounding
PATCHES = 1 << 18  # patches of a texture cost; the standard error of the mean is then far below its last digit
PATCHES_AT_ONCE = 1 << 15
_EXEMPLAR_BYTES = 16 << 20  # of the exemplar's rows in memory at a time


def stationarity_cost(
    lab: SomeRows,
    sigma: float,
    domain: Domain | None = None,
    measure: str = "histogram",
    order: int = 2,
    like: SomeRows | None = None,
) -> float:
    """MJH17 eq. 1: 0 for a stationary texture.

    The mean, over all pairs of `SITES` x `SITES` places, of the difference between their statistics in a Gaussian
    window: the earth mover's distance between histograms of colors (eq. 3) or of the responses of steerable filters
    (eq. 4), or the squared difference of moments (eq. 2), summed over channels, filters and orders.

    Moments of different order have different units and depend on the origin. So they are computed from values less
    their overall mean, in units of the overall deviation. Squared differences are divided by the variance of the power
    under a normal distribution and multiplied by the overall variance (departure): every order counts in squared Lab
    units, with equal weight. A channel of variance 0 costs nothing.

    Parameters
    ----------
    lab : (height, width, 3) float
        CIE Lab.
    sigma : float
        Standard deviation of the Gaussian window, px.
    domain : Domain or None
        Domain of the image. Windows end at the border of an axis that does not wrap. None: a torus.
    measure : str
        histogram, moments or steerable.
    order : int
        Highest order of moments.
    like : (n, m, 3) float or None
        Image whose overall mean and deviation normalize moments, so that costs compare. None: `lab` itself.

    Returns
    -------
    float
        In Lab units. Moments: in squared Lab units.
    """
    height, width = lab.shape[:2]
    wrap_x, wrap_y = (True, True) if domain is None else domain.wraps
    windows = _windows(height, sigma, wrap_y), _windows(width, sigma, wrap_x)
    if measure == "moments":
        return _moment_cost(lab, lab if like is None else like, order, *windows)
    ranges: Iterable[tuple[float, float]] = RANGES

    def planes(band: slice) -> Iterable[np.ndarray]:
        return np.moveaxis(lab[band], 2, 0)

    def filtered(band: slice) -> Iterable[np.ndarray]:
        around = rows_around(lab, band, RADIUS, wrap_y)
        return (p[RADIUS:-RADIUS] for c in range(3) for p in responses(around[..., c], (wrap_x, False)))

    if measure == "steerable":
        ranges = [limits for limits in RESPONSE_RANGES for _ in range(ORIENTATIONS)]
    return _histogram_cost(row_bands(lab), filtered if measure == "steerable" else planes, list(ranges), *windows)


def _histogram_cost(
    bands: Iterable[slice], planes: Callable[[slice], Iterable[np.ndarray]], ranges: list[tuple[float, float]],
    down: np.ndarray, right: np.ndarray,
) -> float:  # fmt: skip
    """Earth mover's distances between local histograms of planes.

    In one dimension it is the area between the cumulatives; per bin, the mean over all pairs is a Gini mean
    difference, which sorting gives exactly in N log N.
    """
    from scipy.sparse import csc_array  # slow to import

    n = down.shape[0] * right.shape[0]
    local = np.zeros((len(ranges), down.shape[0], BINS * right.shape[0]))  # histograms
    for band in bands:
        for k, (plane, (low, high)) in enumerate(zip(planes(band), ranges, strict=True)):
            place = np.clip((plane.T - low) / ((high - low) / (BINS - 1)), 0.0, BINS - 1.0)
            first = np.minimum(place.astype(np.int32), BINS - 2)  # a value between two bins is shared by them
            share, width, height = place - first, *place.shape
            bins = (first + np.arange(height, dtype=np.int32) * BINS)[..., None] + np.arange(2, dtype=np.int32)
            shares = np.stack([1.0 - share, share], -1).astype(np.float64)
            begins = np.arange(width + 1) * (2 * height)
            members = csc_array((shares.ravel(), bins.ravel(), begins), (height * BINS, width))
            local[k] += down[:, band] @ (members @ right.T).reshape(height, -1)
    below = local.reshape(len(ranges), down.shape[0], BINS, -1).cumsum(2)[:, :, :-1]
    ordered = np.sort(np.moveaxis(below, 2, 1).reshape(len(ranges), BINS - 1, n), -1)
    pairs = (ordered @ (2.0 * np.arange(1, n + 1) - n - 1.0)).sum(1) / max(n * (n - 1) / 2.0, 1.0)
    return float(sum(apart * (high - low) / (BINS - 1) for apart, (low, high) in zip(pairs, ranges, strict=True)))


def _moment_cost(lab: SomeRows, unit: SomeRows, order: int, down: np.ndarray, right: np.ndarray) -> float:
    """Squared differences between local moments of channels: over all pairs, twice their variance."""
    mean, deviation = _mean_and_deviation(unit)
    varies = np.flatnonzero(deviation > FLAT).tolist()
    local = np.zeros((3, order, down.shape[0], right.shape[0]))
    for band in row_bands(lab):
        for c in varies:
            z = (lab[band][..., c] - mean[c]) / deviation[c]
            for p in range(1, order + 1):
                local[c, p - 1] += down[:, band] @ (z**p @ right.T)
    n = down.shape[0] * right.shape[0]
    spreads = (local.var((2, 3)) / POWER_VARIANCES[1 : order + 1]).sum(1)
    return float((deviation**2 * spreads).sum() * 2.0 * n / max(n - 1, 1))


def _mean_and_deviation(rows: SomeRows) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation of each channel, float64. A constant channel has deviation 0 exactly."""
    count, start = rows.shape[0] * rows.shape[1], rows[0:1][0, 0].astype(np.float64)
    sums, squares = np.zeros((2, 3))
    for band in row_bands(rows):
        away = (rows[band] - start).reshape(-1, 3)
        sums, squares = sums + away.sum(0), squares + (away * away).sum(0)
    mean = sums / count
    return start + mean, np.sqrt(np.maximum(squares / count - mean * mean, 0.0))


def texture_cost(
    lab: np.ndarray, exemplar: SomeRows, matches: SourceMap, patch: int = 11, most: int = PATCHES
) -> float:
    """MJH17 eq. 5 for a given field of matches: mean distance of the texture's patches from the exemplar's.

    With matches found by PatchMatch this is an upper bound of the cost, which takes the best matches.

    Parameters
    ----------
    lab : (height, width, 3) float
    exemplar : (h, w, 3) float
    matches : SourceMap
        (rows, columns): top-left pixel of the exemplar patch matched to the texture patch with the top-left pixel at
        that place. Patches across the border of the texture wrap.
    patch : int
        Side of a patch.
    most : int
        If there are at least that many patches, only those on a grid are compared.

    Returns
    -------
    float
        Mean squared Lab difference per patch pixel.
    """
    step = max(1, math.isqrt(matches.packed.size // most))
    chosen = matches[::step, ::step]
    height, width = lab.shape[:2]
    high, total = max(1, _EXEMPLAR_BYTES // (12 * exemplar.shape[1])), 0.0
    for band in row_bands(chosen.packed, PATCHES_AT_ONCE):
        places: np.ndarray = np.indices(chosen.packed[band].shape) + np.array([band.start, 0])[:, None, None]
        (y, x), (match_y, match_x) = places * step, chosen[band].yx
        for top in range(0, exemplar.shape[0] - patch + 1, high):
            near, here = exemplar[top : top + high + patch - 1], (match_y >= top) & (match_y < top + high)
            own_y, own_x, other_y, other_x = y[here], x[here], match_y[here] - top, match_x[here]
            for dy in range(patch):
                for dx in range(patch):
                    own = lab[(own_y + dy) % height, (own_x + dx) % width]
                    total += float(((own - near[other_y + dy, other_x + dx]).astype(np.float64) ** 2).sum())
    return total / (chosen.packed.size * patch * patch)


def _windows(size: int, sigma: float, wrap: bool) -> np.ndarray:
    """Normalized Gaussian weights of all pixels of one axis, one row per site: (sites, size) float64."""
    sites = np.arange(min(SITES, size)) * size / min(SITES, size)
    away = np.abs(np.arange(size)[None, :] - sites[:, None])
    if wrap:
        turns = np.arange(-1 - int(5 * sigma / size), 2 + int(5 * sigma / size)) * size
        weights = np.exp(-0.5 * ((away[..., None] + turns) / sigma) ** 2).sum(-1)
    else:
        weights = np.exp(-0.5 * (away / sigma) ** 2)
    return np.asarray(weights / weights.sum(1, keepdims=True))
