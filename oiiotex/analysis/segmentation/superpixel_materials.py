# SPDX-License-Identifier: Apache-2.0
"""Materials: superpixels split by color and texture energy where their distribution has two modes.

Not from a paper. Stone and mortar, or moss and rock, are one texture for methods that compare neighborhoods, because
they are interspersed. Here each superpixel counts by itself. Its mean color and the mean energy of its texture are
projected to each of `_axes`, and the density along each axis is estimated with Silverman's bandwidth (Density
Estimation, 1986, eq. 3.31). A valley between two modes splits the superpixels if it is deeper than sampling explains.
The deepest valley of all axes is used, and both parts are tested in turn. Nothing is split that has one mode.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from ...engine.core.elementary import gaussian_taps
from ...engine.session.resources import Resources
from ..labels.features import SmallLab
from ..superpixels.superpixels import Superpixels

_DEPTH = 2  # splits of splits: at most four materials
_SIGMAS = 4.0  # by which counts of a mode exceed those of a valley; sixteen axes are tried
_LEAST = 0.05  # of all superpixels: the smallest material
_STEPS = 16  # bins per standard deviation
_FAR = 6  # standard deviations
_TAPS = 4096  # steps of a weight: smoothed counts are exact integers
_FINEST = 0.5  # Lab units, and standard deviations of energy: smaller deviations are noise


def superpixel_materials(superpixels: Superpixels, small: SmallLab, resources: Resources) -> np.ndarray:
    """Material of each superpixel, (n,) int64 from 0; all 0 if there is one mode.

    `small`: the reduced image, so that the original is not read again.
    """
    responses = small.texture(resources).responses
    energy = responses[:-3].astype(np.int32).sum(0).reshape(small.ids.shape)
    sums, counts = small.sums(np.concatenate([small.lab, energy[..., None] / (64.0 * 18)], -1).astype(np.float64))
    points = sums / counts[:, None]
    labels = np.zeros(superpixels.count, np.int64)
    for _ in range(_DEPTH):
        for label in range(int(labels.max()) + 1):
            own = np.flatnonzero(labels == label)
            upper = divided(points[own], max(2, round(_LEAST * len(labels))))
            if upper is not None:
                labels[own[upper]] = labels.max() + 1
    return labels


def divided(points: np.ndarray, least: int) -> np.ndarray | None:
    """Which of the points (n, d) are on the upper side of the deepest valley, (n,) bool; None if there is none.

    `least`: number of points on either side.
    """
    spread = np.maximum(points.std(0), _FINEST)
    steps = np.rint(np.clip((points - points.mean(0)) / spread, -_FAR, _FAR) * _STEPS).astype(np.int64)
    best, upper = _SIGMAS, None
    for axis in _axes(points.shape[1]):
        values = steps @ axis
        depth, at = _valley(values, least)
        if depth > best:
            best, upper = depth, values > at
    return upper


def _axes(count: int) -> list[np.ndarray]:
    """Single coordinates, and sums and differences of two: eigenvectors would not be the same everywhere."""
    unit = np.eye(count, dtype=np.int64)
    pairs = itertools.combinations(unit, 2)
    return [*unit, *(one + sign * other for one, other in pairs for sign in (1, -1))]


def _valley(values: np.ndarray, least: int) -> tuple[float, int]:
    """Depth of the deepest valley of the density of integers, in standard deviations of its counts, and its place."""
    low = int(values.min())
    histogram = np.bincount(values - low)
    quartiles = np.sort(values)[[len(values) // 4, 3 * len(values) // 4]]
    width = min(float(values.std()), float(quartiles[1] - quartiles[0]) / 1.34)
    sigma = max(1.0, 0.9 * width * len(values) ** -0.2)
    taps = np.rint(_TAPS * gaussian_taps(sigma, 3.0)).astype(np.int64)
    padded = np.pad(histogram, len(taps) // 2)
    density = sum(int(tap) * padded[n : n + len(histogram)] for n, tap in enumerate(taps))
    counts = density * (2.0 * math.sqrt(math.pi) * sigma / _TAPS)  # in the kernel's effective width
    mode = np.minimum(np.maximum.accumulate(counts), np.maximum.accumulate(counts[::-1])[::-1])
    depth = (mode - counts) / np.sqrt(mode + counts + 1.0)
    below = histogram.cumsum()
    depth[(below < least) | (below > len(values) - least)] = 0.0
    at = int(depth.argmax())
    return float(depth[at]), at + low
