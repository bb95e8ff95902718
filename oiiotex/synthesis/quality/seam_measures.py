# SPDX-License-Identifier: Apache-2.0
"""Measures of how seamless and sharp a grayscale image is, in memory or not."""

from __future__ import annotations

from ...analysis.stationarity.row_bands import row_bands, rows_around
from ...engine.core.demand import SomeRows
from ...engine.core.elementary import gaussian_taps
from ...engine.deferred import np

_RADIUS = 4  # px; of a Gaussian of 1 px


def sharpness(gray: SomeRows) -> float:
    """mean |Y - G1 Y|, G1 a Gaussian of 1 px on the torus."""
    taps, total = gaussian_taps(1.0, _RADIUS).astype(np.float32), 0.0
    for band in row_bands(gray):
        around = rows_around(gray, band, _RADIUS, wraps=True)
        rows, width = around[_RADIUS:-_RADIUS], around.shape[1]
        down = sum(tap * around[k : k + len(rows)] for k, tap in enumerate(taps))
        wide = np.pad(down, ((0, 0), (_RADIUS, _RADIUS)), "wrap")
        total += float(
            np.abs(rows - sum(tap * wide[:, k : k + width] for k, tap in enumerate(taps))).sum(dtype=np.float64)
        )
    return total / (gray.shape[0] * gray.shape[1])


def line_jumps(values: SomeRows, axis: int) -> np.ndarray:
    """The mean jump from each line to the next, starting across the wrap: (lines,) float64.

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
    """Mean jump across the wrap relative to the mean interior jump: 1 is invisible.

    On a lattice, the wrap may be a joint like others: then it is compared with the strongest interior lines, one for
    each period.

    Parameters
    ----------
    values, axis
        As in `line_jumps`.
    cycles : float
        Periods of a lattice per pixel along the axis. 0: none.
    """
    jumps, periods = line_jumps(values, axis), round(cycles * values.shape[axis])
    inside = np.sort(jumps[1:])[-periods:] if periods > 0 else jumps[1:]
    return float(jumps[0] / max(inside.mean(), 1e-12))


def wrap_percentile(gray: SomeRows, axis: int) -> float:
    """Percentage of the interior lines whose jump is smaller than the wrap line's: 50 is invisible."""
    jumps = line_jumps(gray, axis)
    return float(100.0 * (jumps[1:] < jumps[0]).mean())
