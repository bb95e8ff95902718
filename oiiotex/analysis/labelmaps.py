# SPDX-License-Identifier: Apache-2.0
"""Labels at several scales: which scales, by the way up; a tree of labels, by the way down (LSA16 section 4.3).

Levels are numbered as in the paper, rho_1 < rho_2 < ...: level 1 is the finest. Departures:

1. The paper goes on to the first scale at which *every* superpixel overlaps two labels; one superpixel that does not
   ends the search. Here a `share` of them is enough (1: the paper).
2. The scale at the end of the hierarchy is labelled too, where it is not reached otherwise (`coarsest`).
3. The walk gets longer from level to level: what is left of the largest eigenvalue below 1 is `persistence` to the
   power of the level, so that larger patterns come with fewer labels. The paper leaves 0.95 at every level.
4. A node has at most n / 13 neighbours: the paper's 256 of n at fine scales would be all of them at coarse ones.
5. Above `MOST` superpixels a fixed sample of them is factored, and the others take the mean membership of those
   that are nearest to them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from ..errors import ImageError
from ..images import Image
from ..session import Session
from ..working import Lens
from .factorization import Factors, factored
from .features import WORKING_PIXELS, Features, features_of
from .hierarchy import Hierarchy, hierarchy
from .similarity import NEIGHBOURS, Walk, similarity_graph
from .superpixels import Superpixels, superpixels

MOST = 20000  # superpixels up to which all are nodes of the graph
_PIXEL_BYTES, _EDGE_BYTES = 300, 80  # held at once, per pixel of the reduced image and per edge of the graph
_NEAREST = 6  # sampled superpixels that one which was left out looks at
_NODES_PER_NEIGHBOUR, _FEWEST_NEIGHBOURS = 13, 8


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How labels are found; see `filters.label` for what each does."""

    cluster: str = "nmf"
    neighbours: int = NEIGHBOURS
    persistence: float = 0.95
    share: float = 0.5
    coarsest: bool = True
    tries: int = 0
    seed: int = 0


@dataclass(frozen=True)
class LabelLevel:
    """Labels at one scale.

    Attributes
    ----------
    scale : float
        rho, px.
    groups : (n,) int32
        The level's superpixel of every finest superpixel, 0 .. m - 1.
    labels : (n,) int64
        The label of every finest superpixel, 1 .. count; none of them is empty.
    count : int
    parents : (count,) int64
        The label of the next coarser level that holds label i + 1; 0 at the coarsest.
    features : (m, d)
    alone : (m,) int64
        The label 0 .. r - 1 of every superpixel before levels were intersected.
    F : (m, r)
        Where the walk goes from a label; divided by its column's largest value it says how well a superpixel fits.
    G : (r, m)
        Which label a superpixel belongs to.
    """

    scale: float
    groups: np.ndarray
    labels: np.ndarray
    count: int
    parents: np.ndarray
    features: np.ndarray
    alone: np.ndarray
    F: np.ndarray
    G: np.ndarray


@dataclass(frozen=True)
class LabelMaps:
    """All that is known of an image's labels.

    Attributes
    ----------
    superpixels : Superpixels
        n finest ones.
    hierarchy : Hierarchy
    levels : tuple of LabelLevel
        Finest first.
    """

    superpixels: Superpixels
    hierarchy: Hierarchy
    levels: tuple[LabelLevel, ...]


def label_maps(
    image: Image,
    lens: Lens,
    session: Session,
    features: str = "textons",
    settings: Settings | None = None,
    *,
    runs: int = 1,
    minsize: int | None = None,
) -> LabelMaps:
    """Label maps of the image's first part.

    Parameters
    ----------
    image, lens, session
    features : str
        One of `features.KINDS`.
    settings : Settings, optional
    runs, minsize
        As `superpixels` takes them.

    Raises
    ------
    ImageError
        Alpha is 0 everywhere, NaN or Inf, or what does not fit.
    """
    settings = settings or Settings()
    total = 2 * runs + 3

    def advance(done: int, _: int) -> None:
        session.advance(done, total)

    with session.stats.time("superpixels"):
        found = superpixels(image, lens, session, runs=runs, minsize=minsize, seed=settings.seed, advance=advance)
        if not found.count:
            raise ImageError(f"{image.source}: alpha is 0 everywhere: there is nothing to label")
        levels = hierarchy(found, session)
    pixels = min(found.window.width * found.window.height, WORKING_PIXELS)
    need = pixels * _PIXEL_BYTES + min(found.count, MOST) * settings.neighbours * _EDGE_BYTES
    session.require(need, "labelling", "take fewer :neighbours=")
    # One BLAS thread: the products are thin, waiting threads would spin, and sums must not depend on their number.
    with threadpool_limits(1, "blas"), session.stats.time("describe superpixels"):
        described = features_of(features, found, session)
    session.advance(total - 1, total)
    with threadpool_limits(1, "blas"), session.stats.time("label superpixels"):
        made = label_levels(levels, described, settings)
    session.advance(total, total)
    return LabelMaps(found, levels, made)


def label_levels(hierarchy: Hierarchy, features: Features, settings: Settings) -> tuple[LabelLevel, ...]:
    """The levels of labels, finest first, as a tree."""
    return top_down(bottom_up(hierarchy, features, settings))


# --- one scale ---


def labelled(points: np.ndarray, settings: Settings, level: int) -> Factors:
    """Labels of m points, (m, d), found at that level (0: the finest). Every label has a point.

    Raises
    ------
    ImageError
        Clusters are asked for that need scikit-learn, and it is not there.
    """
    m = len(points)
    if m > MOST:
        return _labelled_by_sample(points, settings, level)
    neighbours = min(settings.neighbours, max(_FEWEST_NEIGHBOURS, m // _NODES_PER_NEIGHBOUR))
    graph = similarity_graph(points, neighbours)
    walk = Walk(graph.weights, persistence=settings.persistence ** (level + 1))
    found = factored(walk, settings.seed, settings.tries)
    F, G = found.F[graph.node] / graph.counts[graph.node, None], found.G[:, graph.node]
    if settings.cluster != "nmf" and F.shape[1] > 1:
        labels = _by_scikit_learn(settings, points, graph.weights, F.shape[1], graph.node)
        G = (labels == np.arange(labels.max() + 1)[:, None]).astype(np.float64)
        F = (G / G.sum(1, keepdims=True)).T
    return _without_empty(F, G, found.error)


def _without_empty(F: np.ndarray, G: np.ndarray, error: float) -> Factors:
    """Labels that are nobody's most likely one go; what they had goes to the others."""
    used = np.unique(G.argmax(0))
    kept = G[used]
    kept = kept / np.maximum(kept.sum(0), 1e-300)
    return Factors(F[:, used], kept, error)


def _by_scikit_learn(
    settings: Settings, points: np.ndarray, weights: object, count: int, node: np.ndarray
) -> np.ndarray:
    """The paper's comparison (figure 3d): as many clusters as our own way finds."""
    try:
        from sklearn.cluster import KMeans, SpectralClustering
    except ImportError:
        raise ImageError(
            f"cluster={settings.cluster} needs scikit-learn: pip install 'oiiotex[cluster]'; cluster=nmf does not"
        ) from None
    if settings.cluster == "kmeans":
        return KMeans(count, n_init=10, random_state=settings.seed).fit(points).labels_
    if weights.shape[0] <= count:  # as many kinds as clusters
        return node
    by_rows = weights.tocsr()
    by_rows.indices, by_rows.indptr = by_rows.indices.astype(np.int32), by_rows.indptr.astype(np.int32)
    model = SpectralClustering(count, affinity="precomputed", random_state=settings.seed, assign_labels="kmeans")
    return np.unique(model.fit(by_rows).labels_, return_inverse=True)[1][node]


def _labelled_by_sample(points: np.ndarray, settings: Settings, level: int) -> Factors:
    random = np.random.default_rng(settings.seed)
    chosen = np.sort(random.choice(len(points), MOST, replace=False))
    small = labelled(points[chosen], settings, level)
    _, near = cKDTree(points[chosen]).query(points, _NEAREST)
    G = small.G[:, near].mean(2)
    F = small.F[near].mean(1)
    G[:, chosen], F[chosen] = small.G, small.F
    return _without_empty(F / F.sum(0), G, small.error)


# --- up ---


def bottom_up(hierarchy: Hierarchy, features: Features, settings: Settings) -> list[LabelLevel]:
    """Levels labelled each for itself, finest first; neither parents nor intersections yet."""
    last = len(hierarchy.sigmas) - 1
    found: list[LabelLevel] = []
    at = 0
    while True:
        found.append(_level(hierarchy, features, settings, at, len(found)))
        following = _next_scale(hierarchy, found[-1].labels, at, settings.share)
        if following is None:
            if settings.coarsest and at < last:
                found.append(_level(hierarchy, features, settings, last, len(found)))
            return found
        at = following


def _level(hierarchy: Hierarchy, features: Features, settings: Settings, at: int, level: int) -> LabelLevel:
    groups = hierarchy.partition(at)
    values = features(groups)
    found = labelled(values, settings, level)
    alone = found.G.argmax(0)
    count = found.G.shape[0]
    parents = np.zeros(count, np.int64)
    return LabelLevel(
        float(hierarchy.sigmas[at]), groups, alone[groups] + 1, count, parents, values, alone, found.F, found.G
    )


def _next_scale(hierarchy: Hierarchy, labels: np.ndarray, at: int, share: float) -> int | None:
    """The finest level above `at` of whose superpixels at least that share overlaps two labels.

    Superpixels only merge, and a merged one overlaps what its pieces did: the search may halve.
    """
    low, high = at, len(hierarchy.sigmas)
    while high - low > 1:
        middle = (low + high) // 2
        if mixed_share(hierarchy.partition(middle), labels) >= share:
            high = middle
        else:
            low = middle
    return high if high < len(hierarchy.sigmas) else None


def mixed_share(groups: np.ndarray, labels: np.ndarray) -> float:
    """The share of groups in which there are two labels or more."""
    pairs = np.unique(np.stack([groups, labels], axis=1), axis=0)
    return float((np.bincount(pairs[:, 0]) >= 2).mean())


# --- down ---


def top_down(levels: list[LabelLevel]) -> tuple[LabelLevel, ...]:
    """LSA16 algorithm 2: every label is intersected with those of the next coarser level."""
    above = levels[-1].labels
    made = [levels[-1]]
    for level in reversed(levels[:-1]):
        pairs, labels = np.unique(np.stack([above, level.labels], axis=1), axis=0, return_inverse=True)
        above = labels.reshape(-1) + 1
        made.append(replace(level, labels=above, count=len(pairs), parents=pairs[:, 0]))
    return tuple(reversed(made))
