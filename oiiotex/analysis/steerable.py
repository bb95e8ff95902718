# SPDX-License-Identifier: Apache-2.0
"""Steerable filters of MJH17 eq. 4: third derivatives of a Gaussian, seen at four angles.

The paper takes one scale and four orientations of Simoncelli's pyramid. These are Freeman & Adelson's own steerable
filters (1991, its reference for F_o,m), in the band in which the finest scale of the pyramid lies. They are sums of
products of 13 taps along x and y, so they stream with a halo of six rows, and they come back to themselves: the sum
over the orientations of |F_o|^2 depends on the frequency's length alone, as a collapsed pyramid asks for.
"""

from __future__ import annotations

import math

import numpy as np

ORIENTATIONS = 4
RADIUS = 6  # px; of the taps
_PEAK = math.pi / 2  # rad/px: the finest band of the pyramid goes from pi/4 to pi and is strongest here
_SIGMA = math.sqrt(3.0) / _PEAK  # |w|^3 exp(-(sigma w)^2 / 2) is strongest at sqrt(3) / sigma


def _gaussian_derivatives() -> np.ndarray:
    """Of order 0 to 3, (4, 13), sampled."""
    z = np.arange(-RADIUS, RADIUS + 1) / _SIGMA
    return np.stack([np.ones_like(z), -z, z**2 - 1.0, 3.0 * z - z**3]) * np.exp(-0.5 * z**2)


def _angular() -> np.ndarray:
    """(orientation, order along x): (cos d/dx + sin d/dy)^3 is a sum over k of these times d^k/dx d^(3 - k)/dy."""
    angle = np.arange(ORIENTATIONS)[:, None] * math.pi / ORIENTATIONS
    order = np.arange(4)
    return np.array([1.0, 3.0, 3.0, 1.0]) * np.cos(angle) ** order * np.sin(angle) ** (3 - order)


def _normalised() -> tuple[np.ndarray, np.ndarray]:
    """Taps and angular weights such that the sum of |F_o|^2 over the orientations is 1 at most."""
    taps, angular = _gaussian_derivatives(), _angular()
    # the sum is the same in all directions: along x, where only the third derivative along x has a part
    largest = np.abs(np.fft.fft(taps[3], 4096)).max() * abs(taps[0].sum())
    return taps, angular / (largest * math.sqrt((angular[:, 3] ** 2).sum()))


TAPS, ANGULAR = _normalised()


def responses(plane: np.ndarray, wrap_x: bool = False, wrap_y: bool = False) -> np.ndarray:
    """The filters' responses to a plane, F_o * f of MJH17 eq. 4.

    Parameters
    ----------
    plane : (height, width) float
    wrap_x, wrap_y : bool
        The plane is a torus along that axis; else it is mirrored about its border pixels.

    Returns
    -------
    (ORIENTATIONS, height, width) float64
        In the plane's unit.
    """
    from scipy.ndimage import correlate1d  # when it is needed: it is slow to import

    modes = ["wrap" if wraps else "mirror" for wraps in (wrap_y, wrap_x)]
    plane = np.asarray(plane, np.float64)
    out = np.zeros((ORIENTATIONS, *plane.shape))
    for order in range(4):
        along_x = correlate1d(plane, TAPS[order], 1, mode=modes[1])
        both = correlate1d(along_x, TAPS[3 - order], 0, mode=modes[0])
        for o in range(ORIENTATIONS):
            out[o] += ANGULAR[o, order] * both
    return out
