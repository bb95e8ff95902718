# SPDX-License-Identifier: Apache-2.0
"""Stationarity as a cost (MJH17 section 3).

Plain numpy on rows that may be in a file: these are measures, not steps of a synthesis.
"""

from __future__ import annotations

from collections.abc import Callable

from ...engine.core.demand import SomeRows
from ...engine.core.window import Domain, Window
from ...engine.deferred import np
from .grid_statistics import Cells
from .row_bands import row_bands, rows_around
from .steerable import ORIENTATIONS, RADIUS, responses

BINS = 64
RANGES = ((0.0, 100.0), (-60.0, 60.0), (-60.0, 60.0))  # of L, a, b; fixed, so that costs of different images compare
RESPONSE_RANGES = ((-24.0, 23.25), (-12.0, 11.625), (-12.0, 11.625))  # of filter responses to L, a, b; 0 is a bin
SHARES = 64  # per bin: a value between two bins is split between them in integer shares
SITES = 32  # per axis, at which local statistics are compared
POWER_VARIANCES = (0.0, 1.0, 2.0, 15.0, 96.0)  # of x^p for a normal x: (2p - 1)!! - E[x^p]^2
FLAT = 1e-6  # Lab; a smaller deviation is rounding
_CELLS_PER_SIGMA = 8
_CELL_ROWS = 64  # of cells at a time


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
    from threadpoolctl import threadpool_limits  # not needed for help

    height, width = lab.shape[:2]
    wrap_x, wrap_y = (True, True) if domain is None else domain.wraps
    windows = _windows(height, sigma, wrap_y), _windows(width, sigma, wrap_x)
    if measure == "moments":
        with threadpool_limits(1, "blas"):
            return _moment_cost(lab, lab if like is None else like, order, *windows)
    ranges: tuple[tuple[float, float], ...] = RANGES
    halo = 0
    if measure == "steerable":
        ranges, halo = tuple(limits for limits in RESPONSE_RANGES for _ in range(ORIENTATIONS)), RADIUS

    def values(rows: slice) -> np.ndarray:
        if not halo:
            return lab[rows]
        around = rows_around(lab, rows, halo, wrap_y)
        return np.stack([p[halo:-halo] for c in range(3) for p in responses(around[..., c], (wrap_x, False))], -1)

    cells = Cells.for_sigma(Window(0, 0, width, height), sigma, _CELLS_PER_SIGMA)
    with threadpool_limits(1, "blas"):  # threads for small products wait for each other where cores are busy
        return _histogram_cost(cells, values, ranges, *windows)


def cell_histograms(
    values: np.ndarray, opaque: np.ndarray | None, cells: Cells, ranges: tuple[tuple[float, float], ...]
) -> np.ndarray:
    """Histograms with triangular bins (the Parzen window w_r of MJH17 eq. 3), (channels, across, BINS) int32.

    For values (height, width, >= channels) in one row of cells. A pixel counts `SHARES`. A range reaches from the
    center of the first bin to that of the last.
    """
    across = cells.across
    out = np.empty((len(ranges), across, BINS), np.int32)
    for c, (low, high) in enumerate(ranges):
        per_unit = np.float32((BINS - 1) * SHARES / (high - low))
        place = (values[..., c] - np.float32(low)) * per_unit
        place = np.rint(np.clip(place, 0, (BINS - 1) * SHARES)).astype(np.int32)
        lower = np.minimum(place >> 6, BINS - 2)
        share = place - (lower << 6)
        lower += BINS * cells.columns
        if opaque is not None:
            lower, share = lower[opaque], share[opaque]
        number = np.bincount(lower.ravel(), minlength=across * BINS).reshape(across, BINS)
        # integer sums, exact in doubles
        upper = np.bincount(lower.ravel(), share.ravel(), across * BINS).reshape(across, BINS).astype(np.int32)
        out[c] = number * SHARES - upper
        out[c, :, 1:] += upper[:, :-1]
    return out


def _histogram_cost(
    cells: Cells, values: Callable[[slice], np.ndarray], ranges: tuple[tuple[float, float], ...],
    down: np.ndarray, right: np.ndarray,
) -> float:  # fmt: skip
    """Earth mover's distances between local histograms of values (rows, width, channels).

    A Gaussian is nearly constant within a cell, so pixels are counted by cells. In one dimension the distance is the
    area between the cumulatives; per bin, the mean over all pairs is a Gini mean difference, which sorting gives
    exactly in N log N.
    """
    n = down.shape[0] * right.shape[0]
    widths = np.diff(cells.starts, append=cells.window.width)
    across = np.add.reduceat(right, cells.starts, axis=1) / (widths * SHARES)
    local = np.zeros((len(ranges), down.shape[0], BINS * right.shape[0]))  # histograms
    for top in range(0, cells.down, _CELL_ROWS):
        rows = range(top, min(top + _CELL_ROWS, cells.down))
        sums = np.empty((len(ranges), len(rows), right.shape[0], BINS))
        weights = np.empty((down.shape[0], len(rows)))
        for k, row in enumerate(rows):
            pixels = slice(row * cells.side, min((row + 1) * cells.side, cells.window.height))
            weights[:, k] = down[:, pixels].mean(1)
            sums[:, k] = across @ cell_histograms(values(pixels), None, cells, ranges)
        local += weights @ sums.reshape(len(ranges), len(rows), -1)
    below = local.reshape(len(ranges), down.shape[0], right.shape[0], BINS).cumsum(3)[..., :-1]
    ordered = np.sort(np.moveaxis(below, 3, 1).reshape(len(ranges), BINS - 1, n), -1)
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
