# SPDX-License-Identifier: Apache-2.0
"""How seamless, even and sharp a texture is, by numbers that any plane of gray has.

Plain numpy on whole images: these are reports, not steps of a synthesis.
"""

from __future__ import annotations

from ..deferred import np


def sharpness(gray: np.ndarray) -> float:
    """mean |Y - G1 Y|, G1 a Gaussian of 1 px on the torus."""
    from scipy.ndimage import gaussian_filter  # when it is needed: it is slow to import

    return float(np.abs(gray - gaussian_filter(gray, 1, mode="wrap")).mean())


def seam_ratio(values: np.ndarray, axis: int, cycles: float = 0.0) -> float:
    """Mean jump across the wrap over the mean jump inside: 1 is invisible.

    Of a lattice the wrap may be a joint as there are others inside: then the loudest lines inside, one for each period,
    are what it is compared with.

    Parameters
    ----------
    values : (height, width) or (height, width, channels) float
    axis : int
        0: top against bottom; 1: left against right.
    cycles : float
        Periods of a lattice per pixel along the axis; 0: there is none.
    """
    others = tuple(n for n in range(values.ndim) if n != axis)
    lines = np.abs(np.diff(values, axis=axis)).mean(axis=others, dtype=np.float64)
    periods = round(cycles * values.shape[axis])
    inside = (np.sort(lines)[-periods:] if periods > 0 else lines).mean()
    first, last = np.take(values, 0, axis=axis), np.take(values, -1, axis=axis)
    return float(np.abs(first - last).mean() / max(inside, 1e-12))


def wrap_percentile(gray: np.ndarray, axis: int) -> float:
    """Share of the interior lines whose jump is smaller than the wrap line's, in percent: 50 is invisible."""
    jumps = np.abs(gray - np.roll(gray, 1, axis=axis)).mean(axis=1 - axis)
    return float(100.0 * (jumps[1:] < jumps[0]).mean())
