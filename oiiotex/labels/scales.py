# SPDX-License-Identifier: Apache-2.0
"""Labels at several scales: which scales, by the way up; a tree of labels, by the way down (LSA16 section 4.3).

Levels are numbered as in the paper, rho_1 < rho_2 < ...: level 1 is the finest. Departures:

1. The paper goes on to the first scale at which *every* superpixel overlaps two labels; one superpixel that does not
   ends the search. Here a `share` of them is enough (1: the paper).
2. A coarsest level may be given, which no walk has found (`label_maps`).
3. The walk gets longer from level to level: what is left of the largest eigenvalue below 1 is `persistence` to the
   power of the level, so that larger patterns come with fewer labels. The paper leaves 0.95 at every level.
4. A node has at most n / 13 neighbors: the paper's 256 of n at fine scales would be all of them at coarse ones.
5. Above `MOST` superpixels a fixed sample of them is factored, and the others take the mean membership of those
   that are nearest to them.
6. The paper cuts a label wherever a coarser border crosses it, which leaves rings of crumbs where two levels do not
   quite agree. Here a label is a child of the coarser one that has most of it, and of others that have a fair share;
   a superpixel in none of its children takes the likeliest (`literal`: the paper). So do superpixels
   among others: G is multiplied by what its neighbors are, a Potts step.

`literal` takes back 3, 4 and 6, the floor of the walk's eigenvalue, and that superpixels of large images settle on
squares; with share 1 and no level given, the levels are the paper's.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..color.lab import Lens
from ..core.image import Image
from ..core.window import Window
from ..errors import ImageError
from ..session.progress import Progress
from ..session.resources import Resources
from ..superpixels.hierarchy import Hierarchy, hierarchy
from ..superpixels.slic import SeedGrid
from ..superpixels.superpixels import COMPACTNESS, Superpixels, finest_scale, superpixels
from .affinity_graph import NEIGHBORS, AffinityGraph, similarity_graph
from .features import WORKING_PIXELS, Features, SmallLab, features_of, small_lab
from .potts import UNLIKELY, settled
from .random_walk import PERSISTENCE, SLOWEST, Walk
from .stochastic_nmf import Factors, factored

MOST = 20000  # superpixels up to which all are nodes of the graph
_PIXEL_BYTES, _EDGE_BYTES = 300, 80  # held at once, per pixel of the reduced image and per edge of the graph
_NEAREST = 6  # sampled superpixels that one which was left out looks at
_NODES_PER_NEIGHBOR, _FEWEST_NEIGHBORS = 13, 8
_PART = 0.25  # of a label that lies in a coarser one, for it to be a child of that


@dataclass(frozen=True, kw_only=True)
class LabelSettings:
    """How labels are found; see `filters.label` for what each does."""

    cluster: str = "nmf"
    neighbors: int = NEIGHBORS
    persistence: float = PERSISTENCE
    share: float = 0.5
    literal: bool = False
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
    parents : (count,) int64
        The label of the next coarser level that holds label i + 1; 0 at the coarsest.
    features : (m, d)
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
    F: np.ndarray
    G: np.ndarray


@dataclass(frozen=True)
class LabelMaps:
    """All that is known of an image's labels.

    Attributes
    ----------
    superpixels : Superpixels
        n finest ones.
    levels : tuple of LabelLevel
        Finest first.
    """

    superpixels: Superpixels
    levels: tuple[LabelLevel, ...]


def label_maps(
    image: Image,
    lens: Lens,
    resources: Resources,
    progress: Progress,
    features: str = "textons",
    settings: LabelSettings | None = None,
    *,
    runs: int = 1,
    minsize: int | None = None,
    coarsest: Callable[[Superpixels, SmallLab, Resources], np.ndarray] | None = None,
) -> LabelMaps:
    """Label maps of the image's first part.

    Parameters
    ----------
    image, lens
    features : str
        One of `features.KINDS`.
    runs, minsize
        As `superpixels` takes them.
    coarsest : callable, optional
        Gives a coarsest level of its own: the label of every superpixel, (n,) int64, 0 .. r - 1, none of them empty.

    Raises
    ------
    ImageError
        Alpha is 0 everywhere, NaN or Inf, or what does not fit.
    """
    settings = settings or LabelSettings()
    window = image.first.window
    seeds = SeedGrid.of(window.width, window.height, finest_scale(window), COMPACTNESS).count
    _require(resources, window, seeds, settings)  # there will hardly be fewer superpixels: it is said before the work
    total = 2 * runs + 3

    def advance(done: int, _: int) -> None:
        progress.advance(done, total)

    with resources.in_background(_import_scipy), resources.stats.time("superpixels"):
        finest = superpixels(image, lens, resources, runs=runs, minsize=minsize, seed=settings.seed, advance=advance,
                             literal=settings.literal, powers=features == "moments")  # fmt: skip
        if not finest.count:
            raise ImageError(f"{image.source}: alpha is 0 everywhere: there is nothing to label")
    _require(resources, finest.window, finest.count, settings)
    small = small_lab(finest)
    # One BLAS thread: the products are thin, waiting threads would spin, and sums must not depend on their number.
    with threadpool_limits(1, "blas"):
        with (
            resources.in_background(functools.partial(hierarchy, finest, resources)) as tree,
            resources.stats.time("describe superpixels"),
        ):
            described = features_of(features, finest, small, resources)
        progress.advance(total - 1, total)
        top = (lambda: None) if coarsest is None else functools.partial(coarsest, finest, small, resources)
        with resources.in_background(top) as coarse, resources.stats.time("label superpixels"):
            levels = label_levels(tree(), described, settings, finest.edges, resources, coarse)
    progress.advance(total, total)
    return LabelMaps(finest, levels)


def _import_scipy() -> None:
    """What superpixels look for later: it takes a fifth of a second, in which kernels can be at work."""
    import scipy.ndimage
    import scipy.sparse.csgraph  # noqa: F401


def _require(resources: Resources, window: Window, count: int, settings: LabelSettings) -> None:
    """Refuse what `count` superpixels of a window need, where it does not fit."""
    pixels = min(window.width * window.height, WORKING_PIXELS)
    need = pixels * _PIXEL_BYTES + min(count, MOST) * settings.neighbors * _EDGE_BYTES
    resources.require(need, "labeling", "take fewer :neighbors=")


def label_levels(
    hierarchy: Hierarchy,
    features: Features,
    settings: LabelSettings,
    edges: np.ndarray,
    resources: Resources,
    coarsest: Callable[[], np.ndarray | None] = lambda: None,
) -> tuple[LabelLevel, ...]:
    """The levels of labels, finest first, as a tree.

    `edges` (m, 2) int.
    """
    levels = _bottom_up(hierarchy, features, settings, edges, resources)
    top = coarsest()
    if top is not None:
        levels.append(_given(hierarchy, features, top))
    return top_down(levels, settings.literal)


# --- one scale ---


def labeled(points: np.ndarray, settings: LabelSettings, level: int, resources: Resources) -> Factors:
    """Labels of m points, (m, d), found at that level (0: the finest). Every label has a point."""
    m = len(points)
    if m > MOST:
        return _labeled_by_sample(points, settings, level, resources)
    neighbors, persistence, slowest = settings.neighbors, settings.persistence, SLOWEST
    if settings.literal:
        slowest = 0.0
    else:
        neighbors = min(neighbors, max(_FEWEST_NEIGHBORS, m // _NODES_PER_NEIGHBOR))
        persistence = persistence ** (level + 1)
    graph = similarity_graph(points, neighbors, resources)
    walk = Walk(graph, resources, persistence=persistence, slowest=slowest)
    factors = factored(walk, resources, settings.seed, settings.tries)
    F, G = factors.F[graph.node] / graph.counts[graph.node, None], factors.G[:, graph.node]
    if settings.cluster != "nmf" and F.shape[1] > 1:
        labels = _by_scikit_learn(settings, points, graph, F.shape[1])
        G = (labels == np.arange(labels.max() + 1)[:, None]).astype(np.float64)
        F = (G / G.sum(1, keepdims=True)).T
    return _without_empty(F, G, factors.error)


def _without_empty(F: np.ndarray, G: np.ndarray, error: float) -> Factors:
    """Labels that are nobody's most likely one go; what they had goes to the others."""
    used = np.unique(G.argmax(0))
    kept = G[used]
    kept = kept / np.maximum(kept.sum(0), 1e-300)
    return Factors(F[:, used], kept, error)


def _by_scikit_learn(settings: LabelSettings, points: np.ndarray, graph: AffinityGraph, count: int) -> np.ndarray:
    """The paper's comparison (figure 3d): as many clusters as our own way finds."""
    try:
        from sklearn.cluster import KMeans, SpectralClustering
    except ImportError:
        raise ImageError(
            f"cluster={settings.cluster} needs scikit-learn: pip install 'oiiotex[cluster]'; cluster=nmf does not"
        ) from None
    if settings.cluster == "kmeans":
        return KMeans(count, n_init=10, random_state=settings.seed).fit(points).labels_
    if len(graph.counts) <= count:  # as many kinds as clusters
        return graph.node
    model = SpectralClustering(count, affinity="precomputed", random_state=settings.seed, assign_labels="kmeans")
    return np.unique(model.fit(graph.weights()).labels_, return_inverse=True)[1][graph.node]


def _labeled_by_sample(points: np.ndarray, settings: LabelSettings, level: int, resources: Resources) -> Factors:
    from scipy.spatial import cKDTree  # of very long images alone

    random = np.random.default_rng(settings.seed)
    chosen = np.sort(random.choice(len(points), MOST, replace=False))
    small = labeled(points[chosen], settings, level, resources)
    _, near = cKDTree(points[chosen]).query(points, _NEAREST)
    G = small.G[:, near].mean(2)
    F = small.F[near].mean(1)
    G[:, chosen], F[chosen] = small.G, small.F
    return _without_empty(F / F.sum(0), G, small.error)


# --- up ---


def _bottom_up(
    hierarchy: Hierarchy, features: Features, settings: LabelSettings, edges: np.ndarray, resources: Resources
) -> list[LabelLevel]:
    """Levels labeled each for itself, finest first; neither parents nor intersections yet."""
    levels: list[LabelLevel] = []
    at = 0
    while True:
        levels.append(_level(hierarchy, features, settings, edges, at, len(levels), resources))
        following = _next_scale(hierarchy, levels[-1].labels, at, settings.share)
        if following is None:
            return levels
        at = following


def _level(
    hierarchy: Hierarchy,
    features: Features,
    settings: LabelSettings,
    edges: np.ndarray,
    at: int,
    level: int,
    resources: Resources,
) -> LabelLevel:
    groups = hierarchy.partition(at)
    values = features(groups)
    factors = labeled(values, settings, level, resources)
    count, likely = len(factors.G), factors.G[:, groups]
    labels = likely.argmax(0) if settings.literal else settled(likely, edges, resources)
    scale, parents = float(hierarchy.sigmas[at]), np.zeros(count, np.int64)
    return LabelLevel(scale, groups, labels + 1, count, parents, values, factors.F, factors.G)


def _given(hierarchy: Hierarchy, features: Features, labels: np.ndarray) -> LabelLevel:
    """A level that no walk has found: every superpixel is a group, and wholly a member of its label."""
    groups, count = np.arange(len(labels), dtype=np.int32), int(labels.max()) + 1
    G = (labels == np.arange(count)[:, None]).astype(np.float64)
    F = (G / G.sum(1, keepdims=True)).T
    scale, parents = float(hierarchy.sigmas[-1]), np.zeros(count, np.int64)
    return LabelLevel(scale, groups, labels + 1, count, parents, features(groups), F, G)


def _next_scale(hierarchy: Hierarchy, labels: np.ndarray, at: int, share: float) -> int | None:
    """The finest level above `at` of whose superpixels at least that share overlaps two labels.

    Superpixels only merge, and a merged one overlaps what its pieces did: the search may halve.
    """
    low, high = at, len(hierarchy.sigmas)
    while high - low > 1:
        middle = (low + high) // 2
        if _mixed_share(hierarchy.partition(middle), labels) >= share:
            high = middle
        else:
            low = middle
    return high if high < len(hierarchy.sigmas) else None


def _mixed_share(groups: np.ndarray, labels: np.ndarray) -> float:
    """The share of groups in which there are two labels or more."""
    pairs = np.unique(np.stack([groups, labels], axis=1), axis=0)
    return float((np.bincount(pairs[:, 0]) >= 2).mean())


# --- down ---


def top_down(levels: list[LabelLevel], literal: bool = False) -> tuple[LabelLevel, ...]:
    """LSA16 algorithm 2: every label is intersected with those of the next coarser level; see departure 6."""
    intersected: list[LabelLevel] = []
    above = np.zeros(len(levels[-1].labels), np.int64)
    for level in reversed(levels):
        own = level.labels - 1 if literal or not intersected else _within(above, level)
        pairs, labels = np.unique(np.stack([above, own], axis=1), axis=0, return_inverse=True)
        above = labels.reshape(-1) + 1
        intersected.append(replace(level, labels=above, count=len(pairs), parents=pairs[:, 0]))
    return tuple(reversed(intersected))


def _within(above: np.ndarray, level: LabelLevel) -> np.ndarray:
    """Of every superpixel a label of that level that is a child of its coarser label, (n,) 0 .. r - 1."""
    own = level.labels - 1
    table = np.zeros((above.max() + 1, len(level.G)))
    np.add.at(table, (above, own), 1.0)
    whole = np.maximum(table.sum(0), 1.0)
    child = (table >= _PART * whole) & (table > 0)
    child[table.argmax(0), np.arange(len(whole))] = table.max(0) > 0
    childless = np.flatnonzero(~child.any(1))
    child[childless, table[childless].argmax(1)] = True
    outside = np.flatnonzero(~child[above, own])
    likely = level.G[:, level.groups[outside]].T + 1e-9 * table[above[outside]] + UNLIKELY
    own[outside] = np.where(child[above[outside]], likely, 0.0).argmax(1)
    return own
