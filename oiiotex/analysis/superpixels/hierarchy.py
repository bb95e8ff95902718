# SPDX-License-Identifier: Apache-2.0
"""Superpixels merged from fine to coarse: LSA16 section 3.3, algorithm 1.

A heap in plain Python is fast enough: there are fewer merges than superpixels, whose number does not grow with the
image (a few thousand), and costs are recomputed for the remaining graph, about n log(n) edges over all levels.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable
from dataclasses import dataclass

from ...engine.deferred import np
from ...engine.session.resources import Resources
from .gaussian_stack import blurred_sums
from .superpixels import Superpixels

COARSEST = 0.2  # sigma_Gamma as a share of the shorter side: LSA16 section 3.4
STEP = 3.0  # px from level to level: LSA16 section 3.4
MOST_LEVELS = 128
_COMPACTNESS = 1.0  # m_gamma of LSA16 section 3.4


@dataclass(frozen=True)
class Hierarchy:
    """Partitions at increasing scales, each a union of superpixels of the finer ones.

    Attributes
    ----------
    merges : (n - counts[-1], 2) int32
        In order: b is merged into a. Both are identified by their smallest finest superpixel, 0-based. a < b.
    sigmas : (levels,) float64
        Scale of each level, px.
    counts : (levels,) int64
        Number of superpixels of each level. counts[0] = n.
    """

    merges: np.ndarray
    sigmas: np.ndarray
    counts: np.ndarray

    def partition(self, level: int) -> np.ndarray:
        """The superpixel of each finest superpixel at a level.

        (n,) int32: 0 .. counts[level] - 1, numbered by their smallest finest superpixel.
        """
        return self.partition_of(int(self.counts[level]))

    def partition_of(self, count: int) -> np.ndarray:
        """The partition into `count` superpixels, from counts[-1] to n, as from `partition`."""
        n = int(self.counts[0])
        parent = list(range(n))  # faster than an array, one by one
        for a, b in self.merges[: n - count][::-1].tolist():  # backwards, so that the root of a is known
            parent[b] = parent[a]
        _, number = np.unique(parent, return_inverse=True)
        return number.astype(np.int32)

    def level_of(self, sigma: float) -> int:
        """The level with the nearest scale. Ties: the finer one."""
        return int(np.abs(self.sigmas - sigma).argmin())


def scales(finest: float, coarsest: float) -> np.ndarray:
    """sigma_1 .. sigma_Gamma, px: LSA16 section 3.4.

    Every 3 px as in the paper up to 128 levels, which is up to about 2100 px. Beyond that, the same number of
    levels in geometric progression: 3 px at a scale of 200 px make no difference.
    """
    if (coarsest - finest) / STEP < MOST_LEVELS:
        return finest + STEP * np.arange(max(1, math.floor((coarsest - finest) / STEP + 1e-9) + 1))
    return finest * (coarsest / finest) ** (np.arange(MOST_LEVELS) / (MOST_LEVELS - 1))


def hierarchy(superpixels: Superpixels, resources: Resources, sigmas: np.ndarray | None = None) -> Hierarchy:
    """Merge superpixels by eq. 2, guided by the Gaussian stack.

    Parameters
    ----------
    superpixels
    sigmas : (levels,) float, optional
        Scales, px, increasing from that of the superpixels. Default: `scales`.
    """
    window = superpixels.window
    if sigmas is None:
        sigmas = scales(superpixels.sigma, COARSEST * min(window.width, window.height))
    levels = blurred_sums(superpixels, sigmas.tolist(), resources)
    places = superpixels.positions
    if any(superpixels.periods):
        places = _on_torus(places, superpixels.periods)
    return merged(superpixels.sizes, places, superpixels.edges, sigmas, levels)


def _on_torus(positions: np.ndarray, periods: tuple[int, int]) -> np.ndarray:
    """Positions, (n, 2), as points (n, 4) whose distances are those on a torus, but for far ones, which are shorter.

    An axis that tiles becomes a circle of that circumference.
    """
    places = _in_space(positions)
    for axis, period in enumerate(periods):
        if period:
            radius = period / (2 * math.pi)
            angle = positions[:, axis] / radius
            places[:, axis], places[:, axis + 2] = radius * np.cos(angle), radius * np.sin(angle)
    return places


def _in_space(positions: np.ndarray) -> np.ndarray:
    """Points of up to four coordinates as points of four, (n, 4) float64."""
    places = np.zeros((len(positions), 4))
    places[:, : positions.shape[1]] = positions
    return places


def merged(
    sizes: np.ndarray, positions: np.ndarray, edges: np.ndarray, sigmas: np.ndarray, levels: Iterable[np.ndarray]
) -> Hierarchy:
    """Algorithm 1.

    `positions` (n, 2) or (n, 4) float64; `sigmas` (levels,) float; `levels` iterable of (n, 3) float64.
    """
    graph = _RegionGraph(sizes, positions, edges)
    counts = [len(sizes)]
    area = int(sizes.sum())
    for sigma, sums in zip(sigmas[1:].tolist(), levels, strict=False):
        graph.merge_until(int(area / sigma**2), sums, (_COMPACTNESS / sigma) ** 2)
        counts.append(graph.alive)
    counts += [graph.alive] * (len(sigmas) - len(counts))
    merges = np.array(graph.merges, np.int32).reshape(-1, 2)
    return Hierarchy(merges, np.asarray(sigmas, np.float64), np.array(counts, np.int64))


class _RegionGraph:
    """The remaining region adjacency graph."""

    def __init__(self, sizes: np.ndarray, positions: np.ndarray, edges: np.ndarray):
        self._sizes = sizes.astype(np.float64)
        self._places = _in_space(positions) * self._sizes[:, None]
        self._edges = edges.astype(np.int64)
        self._root = np.arange(len(sizes))
        self._near: list[set[int]] = [set() for _ in range(len(sizes))]
        for a, b in edges.tolist():
            self._near[a].add(b)
            self._near[b].add(a)
        self.alive = len(sizes)
        self.merges: list[tuple[int, int]] = []

    def merge_until(self, target: int, colors: np.ndarray, weight: float) -> None:
        """Merge the pair with the lowest cost until at most `target` are left, or no neighbors."""
        if self.alive <= target or not len(self._edges):
            return
        root, n = self._root, len(self._root)
        columns = (self._sizes, *colors.T, *self._places.T)
        sums = np.stack([np.bincount(root, column, n) for column in columns], 1)  # superpixels x (size, L, a, b, place)
        size = np.maximum(sums[:, 0], 1.0)
        means = sums[:, 1:] / size[:, None]
        ends = np.sort(root[self._edges], 1)
        ends = ends[ends[:, 0] != ends[:, 1]]
        pairs = np.unique(ends[:, 0] * n + ends[:, 1])
        a, b = pairs // n, pairs % n
        self._edges = np.stack([a, b], 1)
        d = (means[a] - means[b]) ** 2
        cost = size[a] * size[b] / (size[a] + size[b]) * (d[:, 0] + d[:, 1] + d[:, 2] + weight * d[:, 3:].sum(1))
        # ties go to the lower ids; an entry is stale if one of its two has changed since
        heap = list(zip(cost.tolist(), a.tolist(), b.tolist(), [0] * len(a), [0] * len(a), strict=True))
        heapq.heapify(heap)
        left = np.flatnonzero(root == np.arange(n))
        sizes, centers = (dict(zip(left.tolist(), of[left].tolist(), strict=True)) for of in (size, means))
        self._pop(heap, target, sizes, centers, weight)

    def _pop(
        self, heap: list[tuple[float, int, int, int, int]], target: int, size: dict[int, float],
        means: dict[int, list[float]], weight: float,
    ) -> None:  # fmt: skip
        near, changes, dead = self._near, dict.fromkeys(size, 0), set()
        while self.alive > target and heap:
            _, a, b, seen_a, seen_b = heapq.heappop(heap)
            if a in dead or b in dead or changes[a] != seen_a or changes[b] != seen_b:
                continue
            both = size[a] + size[b]
            mean = [(u * size[a] + v * size[b]) / both for u, v in zip(means[a], means[b], strict=True)]
            size[a], means[a] = both, mean
            changes[a] += 1
            dead.add(b)
            self.merges.append((a, b))
            self.alive -= 1
            for c in near[b]:
                near[c].discard(b)
                if c != a:
                    near[c].add(a)
                    near[a].add(c)
            near[b] = set()
            l0, a0, b0, x0, y0, u0, v0 = mean
            for c in near[a]:
                l1, a1, b1, x1, y1, u1, v1 = means[c]
                # LSA16 eq. 2, with the distances to the common mean written out
                away = (l0 - l1) ** 2 + (a0 - a1) ** 2 + (b0 - b1) ** 2
                away += weight * ((x0 - x1) ** 2 + (y0 - y1) ** 2 + (u0 - u1) ** 2 + (v0 - v1) ** 2)
                cost = both * size[c] / (both + size[c]) * away
                low, high = (a, c) if a < c else (c, a)
                heapq.heappush(heap, (cost, low, high, changes[low], changes[high]))
        for a, b in self.merges[-len(dead) :][::-1] if dead else ():
            self._root[b] = self._root[a]
        self._root = self._root[self._root]
