# SPDX-License-Identifier: Apache-2.0
"""Merging of an oversegmentation by evidence, until all pairs of regions are more likely two textures than one.

Not in CZF02, whose discs mix textures in patches narrower than they are. Three measures of a pair say whether it is one
texture: the similarity of its textons; how finely it is interspersed, like stones and joints; and the size of its
smaller region, since small regions differ by chance. Their weights are a logistic regression over 1400 merges: of
mosaics (the half "tune" of benchmarks.shared.mosaics), of quarters of mosaics, and of single textures of 128 to 512 px.
In addition, a merge must pay for what it saves. With k regions left, the label of a place costs log k to name, so
merging is easier while there are many, and the last two regions become one only on strong evidence.
"""

from __future__ import annotations

import math

import numpy as np

from ...engine.core.elementary import logarithm
from ...engine.session.resources import Resources
from ..labels.filter_bank import blurred_layers, codebook
from ..labels.products import gram

_MOST = 20  # initial regions
_ROOM = 8**2  # cells: least mean area of an initial region
_POOLED = 3.5  # cells: sigma over which textons are pooled for the initial regions
_AMONG = 16.0  # cells: sigma over which interspersed regions are measured
_POOLED_PART, _AMONG_PART = 8, 4  # limits: shorter side divided by these
_SAMPLE = 4096  # places from which the initial regions are learned
_TRIALS = 4  # candidates for each of their centers: with one, covering depends on the draw (.625 to .642)
_ROOTS = 2047  # steps of a root of a proportion: products of two histograms are integers that a float32 holds exactly
_REACH = 2.5  # radius of Gaussians, sigmas
_WEIGHTS = (2.7, -3.6, 0.48)  # of `_Regions.evidence`, nats
_BIAS = 6.5
_NAMING, _USUAL = 1.2, 3.0  # nats of evidence per nat of naming a label; number of regions at which it has no effect
_WIDE = 128.0**2  # cells: the unit of areas
_LEAST = 1e-3  # least distance between distributions


def fine_regions(values: np.ndarray, resources: Resources, least: int = 1) -> np.ndarray:
    """Oversegmentation by k-means of the roots of pooled textons.

    `values` (h, w, k) float32: of cells; returns (h, w) int64.
    """
    height, width = values.shape[:2]
    sigma = min(_POOLED, min(height, width) / _POOLED_PART)
    shares = blurred_layers(np.ascontiguousarray(np.moveaxis(values, -1, 0)), sigma, _REACH, resources)
    points = np.rint(np.sqrt(shares.reshape(len(shares), -1).T) * np.float32(_ROOTS)).astype(np.int16)
    seen = np.flatnonzero(values.any(-1))
    count = max(least, min(_MOST, len(seen) // _ROOM))
    centers = codebook(points[seen[:: max(1, len(seen) // _SAMPLE)]], count, _TRIALS).astype(np.float32)
    products = points.astype(np.float32) @ centers.T  # exact
    return (2 * products.astype(np.float64) - (centers.astype(np.float64) ** 2).sum(1)).argmax(1).reshape(height, width)


def merged(
    values: np.ndarray, labels: np.ndarray, threshold: float, resources: Resources, count: int | None = None
) -> np.ndarray:
    """Merge the most likely pair of regions repeatedly.

    `values` (h, w, k) float32 and `labels` (h, w) int64: of cells; `threshold`: least probability, 0 to 1, that two
    regions are one texture; returns (h, w) int64.
    """
    seen = values.any(-1)
    names, inverse = np.unique(labels[seen], return_inverse=True)
    regions = np.full(labels.shape, -1)
    regions[seen] = inverse
    state = _Regions(values, regions, len(names), resources)
    odds = math.inf if threshold <= 0 else -math.inf if threshold >= 1 else math.log((1 - threshold) / threshold)
    joined = np.arange(len(names))
    pairs = {(a, b): state.evidence(a, b) for b in range(len(names)) for a in range(b)}
    while pairs:
        a, b = min(pairs, key=lambda pair: (pairs[pair], pair))
        left = len(np.unique(joined))
        if left <= count if count is not None else pairs[a, b] - naming_cost(left) >= odds:
            break
        joined[joined == b] = a
        state.join(a, b)
        pairs = {pair: at for pair, at in pairs.items() if a not in pair and b not in pair}
        others = np.unique(joined)
        pairs |= {(min(a, c), max(a, c)): state.evidence(a, c) for c in others[others != a].tolist()}
    groups = np.where(seen, joined[regions], joined[0])
    return np.unique(groups, return_inverse=True)[1].reshape(labels.shape)


def naming_cost(count: int) -> float:
    """Evidence, in nats, that two of `count` regions need in addition to stay two; it decreases with their number."""
    return _NAMING * float(logarithm(np.array(count / _USUAL)))


class _Regions:
    """Measures of all regions: additive sums."""

    def __init__(self, values: np.ndarray, regions: np.ndarray, count: int, resources: Resources):
        height, width = regions.shape
        among = max(1.0, min(_AMONG, min(height, width) / _AMONG_PART))
        inside = regions == np.arange(count)[:, None, None]
        self.areas = inside.sum((1, 2)).tolist()
        self.textons = [values[i].sum(0, dtype=np.float64) for i in inside]
        around = blurred_layers(inside.astype(np.float32), among, _REACH, resources).reshape(count, -1).T
        around = np.ascontiguousarray(around)
        self.among = gram(around, around, resources).astype(np.float64)

    def evidence(self, a: int, b: int) -> float:
        """Logarithm of the odds that two regions are two textures, nats."""
        p, q = self.textons[a], self.textons[b]
        apart = 1.0 - float(np.sqrt(p * q).sum()) / math.sqrt(p.sum() * q.sum())  # CZF02 eq. 3
        among = self.among[a, b] / math.sqrt(self.among[a, a] * self.among[b, b])
        smaller = min(self.areas[a], self.areas[b]) / _WIDE
        unlike, small = logarithm(np.array([max(apart, 0.0) + _LEAST, smaller])).tolist()
        return (unlike * _WEIGHTS[0] + float(among) * _WEIGHTS[1]) + (small * _WEIGHTS[2] + _BIAS)

    def join(self, a: int, b: int) -> None:
        """Merge b into a."""
        self.areas[a] += self.areas[b]
        self.textons[a] = self.textons[a] + self.textons[b]
        self.among[a] += self.among[b]
        self.among[:, a] += self.among[:, b]
