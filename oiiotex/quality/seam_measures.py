# SPDX-License-Identifier: Apache-2.0
"""How seamless, even and sharp a texture is, by numbers that any plane of gray has, in memory or not."""

from __future__ import annotations

from ..core.demand import SomeRows
from ..deferred import np
from ..stationarity.row_bands import row_bands, rows_around

_RADIUS = 4  # px; of a Gaussian of 1 px


def sharpness(gray: SomeRows) -> float:
    """mean |Y - G1 Y|, G1 a Gaussian of 1 px on the torus."""
    from scipy.ndimage import gaussian_filter  # when it is needed: it is slow to import

    total = 0.0
    for band in row_bands(gray):
        around = rows_around(gray, band, _RADIUS, wraps=True)
        apart = np.abs(around - gaussian_filter(around, 1, mode="wrap", radius=_RADIUS))
        total += float(apart[_RADIUS:-_RADIUS].sum(dtype=np.float64))
    return total / (gray.shape[0] * gray.shape[1])


def line_jumps(values: SomeRows, axis: int) -> np.ndarray:
    """The mean jump to each line from the one before, the first across the wrap: (lines,) float64.

    `values` (height, width) or (height, width, channels) float.
    """
    sums = np.zeros(values.shape[axis])
    before = values[len(values) - 1 : len(values)]
    for band in row_bands(values):
        rows = values[band]
        if axis == 1:
            sums += _sums_along(np.abs(rows - np.roll(rows, 1, axis=1)), 1)
        else:
            sums[band] = _sums_along(np.abs(np.diff(np.concatenate([before, rows]), axis=0)), 0)
            before = rows[-1:]
    return sums * len(sums) / float(np.prod(values.shape))


def _sums_along(values: np.ndarray, axis: int) -> np.ndarray:
    return values.sum(tuple(n for n in range(values.ndim) if n != axis), np.float64)


def seam_ratio(values: SomeRows, axis: int, cycles: float = 0.0) -> float:
    """Mean jump across the wrap over the mean jump inside: 1 is invisible.

    Of a lattice the wrap may be a joint as there are others inside: then the loudest lines inside, one for each period,
    are what it is compared with.

    Parameters
    ----------
    values, axis
        As of `line_jumps`.
    cycles : float
        Periods of a lattice per pixel along the axis; 0: there is none.
    """
    jumps, periods = line_jumps(values, axis), round(cycles * values.shape[axis])
    inside = np.sort(jumps[1:])[-periods:] if periods > 0 else jumps[1:]
    return float(jumps[0] / max(inside.mean(), 1e-12))


def wrap_percentile(gray: SomeRows, axis: int) -> float:
    """Share of the interior lines whose jump is smaller than the wrap line's, in percent: 50 is invisible."""
    jumps = line_jumps(gray, axis)
    return float(100.0 * (jumps[1:] < jumps[0]).mean())
