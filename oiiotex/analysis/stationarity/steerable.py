# SPDX-License-Identifier: Apache-2.0
"""Steerable filters of MJH17 eq. 4: third derivatives of a Gaussian at four angles.

The paper uses one scale and four orientations of Simoncelli's pyramid. These are Freeman & Adelson's original steerable
filters (1991, the paper's reference for F_o,m), in the band of the pyramid's finest scale. They are sums of
products of 13 taps along x and y, so they can be streamed with a halo of six rows. They are self-inverting: the sum
over the orientations of |F_o|^2 depends on the length of the frequency alone, as collapsing a pyramid requires.
"""

from __future__ import annotations

import functools
import math

from ...engine.core.window import Window
from ...engine.deferred import np

ORIENTATIONS = 4
RADIUS = 6  # px, radius of the taps
_PEAK = math.pi / 2  # rad/px: the finest band of the pyramid spans pi/4 to pi and peaks here
_SIGMA = math.sqrt(3.0) / _PEAK  # |w|^3 exp(-(sigma w)^2 / 2) peaks at sqrt(3) / sigma


def _gaussian_derivatives() -> np.ndarray:
    """Derivatives of order 0 to 3, sampled: (4, 13)."""
    z = np.arange(-RADIUS, RADIUS + 1) / _SIGMA
    return np.stack([np.ones_like(z), -z, z**2 - 1.0, 3.0 * z - z**3]) * np.exp(-0.5 * z**2)


def _angular() -> np.ndarray:
    """(orientation, order along x): (cos d/dx + sin d/dy)^3 is a sum over k of these times d^k/dx d^(3 - k)/dy."""
    angle = np.arange(ORIENTATIONS)[:, None] * math.pi / ORIENTATIONS
    order = np.arange(4)
    return np.array([1.0, 3.0, 3.0, 1.0]) * np.cos(angle) ** order * np.sin(angle) ** (3 - order)


@functools.cache
def filter_bank() -> tuple[np.ndarray, np.ndarray]:
    """Taps (order, 13), and angular weights (orientation, order along x).

    Normalized to a maximum of 1 for the sum of |F_o|^2 over the orientations.
    """
    taps, angular = _gaussian_derivatives(), _angular()
    # the sum is isotropic: along x, only the third derivative along x contributes
    largest = np.abs(np.fft.fft(taps[3], 4096)).max() * abs(taps[0].sum())
    return taps, angular / (largest * math.sqrt((angular[:, 3] ** 2).sum()))


def responses(plane: np.ndarray, wraps: tuple[bool, bool] = (False, False)) -> np.ndarray:
    """Filter responses to a plane, F_o * f of MJH17 eq. 4.

    `plane` (height, width) float; returns (ORIENTATIONS, height, width) float64.
    """
    from scipy.ndimage import correlate1d  # slow to import

    along_x, along_y = ("wrap" if closed else "mirror" for closed in wraps)
    taps, angular = filter_bank()
    plane = np.asarray(plane, np.float64)
    out = np.zeros((ORIENTATIONS, *plane.shape))
    for order in range(4):
        rows = correlate1d(plane, taps[order], 1, mode=along_x)
        both = correlate1d(rows, taps[3 - order], 0, mode=along_y)
        for o in range(ORIENTATIONS):
            out[o] += angular[o, order] * both
    return out


def responses_in(
    values: np.ndarray, opaque: np.ndarray | None, piece: Window, whole: Window
) -> tuple[np.ndarray, np.ndarray | None]:
    """Responses at a piece's pixels, and which of them cover no pixel of alpha 0.

    `values` (rows, width, channels) float32; `opaque` (rows, width) bool or None; returns (height, width, 4 channels)
    float32, (height, width) bool or None.
    """
    from scipy.ndimage import minimum_filter  # slow to import

    above = piece.top - max(whole.top, piece.top - RADIUS)
    rows = slice(above, above + piece.height)
    # rows missing in `values` lie beyond the border, where the filters mirror
    planes = [responses(values[..., c])[:, rows] for c in range(values.shape[-1])]
    filtered = np.concatenate(planes).transpose(1, 2, 0).astype(np.float32)
    if opaque is None:
        return filtered, None
    return filtered, minimum_filter(opaque.astype(np.uint8), 2 * RADIUS + 1, mode="mirror")[rows].astype(bool)
