# SPDX-License-Identifier: Apache-2.0
"""Peers of our superpixels: scikit-image's SLIC, and hierarchical segmenters that install.

The latter stand in for Arbelaez's (LSA16 figure 3b), whose code does not install. Both begin with all basins of the
gradient's watershed and merge neighbors with scikit-image's `merge_hierarchical` until one is left, so that partitions
of all counts are nested. `by_boundary` merges where the mean gradient along the common border is least, which
is Arbelaez's construction (an ultrametric contour map) without his learned boundaries. `by_color` merges where the sum
of squared distances to mean colors grows least (Ward), which depends on sizes: by far the better of the two at our
counts. Felzenszwalb's segments are omitted: they form no hierarchy, because a coarse one may cut a fine one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_gradient_magnitude

COMPACTNESS = 20.0  # Lab units per sigma, as ours
_BLUR = 2.0  # px, of the gradient: what is finer is noise


@dataclass(frozen=True)
class Dendrogram:
    """Basins (h, w), and in which order they merge: (n - 1, 2), the first into the second."""

    basins: np.ndarray
    merges: np.ndarray

    def partition_of(self, count: int) -> np.ndarray:
        """The partition (h, w) into `count` regions."""
        parent = np.arange(self.basins.max() + 1)
        for a, b in self.merges[: max(0, len(self.merges) + 1 - count)][::-1].tolist():
            parent[a] = parent[b]
        return parent[self.basins]


def _watershed(lab: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradient's magnitude over all channels, and its basins."""
    from skimage.segmentation import watershed

    gradient = np.sqrt(sum(gaussian_gradient_magnitude(lab[..., c], _BLUR) ** 2 for c in range(3)))
    return gradient, watershed(gradient)


def _merged(basins: np.ndarray, rag: object, join: Callable, weight: Callable) -> Dendrogram:
    from skimage.graph import merge_hierarchical

    order: list[tuple[int, int]] = []

    def noted(graph: object, source: int, target: int) -> None:
        order.append((source, target))
        join(graph, source, target)

    merge_hierarchical(
        basins, rag, thresh=np.inf, rag_copy=False, in_place_merge=True, merge_func=noted, weight_func=weight
    )
    return Dendrogram(basins, np.array(order, np.int64).reshape(-1, 2))


def by_boundary(lab: np.ndarray) -> Dendrogram:
    """Basins of Lab (h, w, 3), merged by the mean gradient along common borders."""
    from skimage.graph import rag_boundary

    gradient, basins = _watershed(lab)

    def weight(graph: object, source: int, target: int, other: int) -> dict[str, float]:
        none = {"weight": 0.0, "count": 0}
        a, b = graph[source].get(other, none), graph[target].get(other, none)
        count = a["count"] + b["count"]
        return {"count": count, "weight": (a["count"] * a["weight"] + b["count"] * b["weight"]) / count}

    return _merged(basins, rag_boundary(basins, gradient), lambda *_: None, weight)


def by_color(lab: np.ndarray) -> Dendrogram:
    """Basins of Lab (h, w, 3), merged by Ward's cost."""
    from skimage.graph import rag_mean_color

    _, basins = _watershed(lab)
    rag = rag_mean_color(lab, basins)

    def cost(graph: object, a: int, b: int) -> float:
        a, b = graph.nodes[a], graph.nodes[b]
        sizes = a["pixel count"] * b["pixel count"] / (a["pixel count"] + b["pixel count"])
        return float(sizes * ((a["mean color"] - b["mean color"]) ** 2).sum())

    def join(graph: object, source: int, target: int) -> None:
        a, b = graph.nodes[source], graph.nodes[target]
        b["total color"] = a["total color"] + b["total color"]
        b["pixel count"] = a["pixel count"] + b["pixel count"]
        b["mean color"] = b["total color"] / b["pixel count"]

    for a, b, edge in rag.edges(data=True):
        edge["weight"] = cost(rag, a, b)
    return _merged(basins, rag, join, lambda graph, source, target, other: {"weight": cost(graph, target, other)})


def scikit_slic(lab: np.ndarray, count: int, iterations: int = 10, connected: bool = True) -> np.ndarray:
    """scikit-image's SLIC of Lab (h, w, 3) with our compactness.

    It stretches its input to 0 .. 1 before it compares anything: a compactness in Lab units would make a bare grid.
    """
    from skimage.segmentation import slic

    stretched = COMPACTNESS / max(float(lab.max() - lab.min()), 1e-9)
    return slic(lab, count, stretched, iterations, convert2lab=False, enforce_connectivity=connected, channel_axis=-1)
