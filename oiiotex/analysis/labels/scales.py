# SPDX-License-Identifier: Apache-2.0
"""Labels at several scales: scales are chosen bottom-up, and a tree of labels is built top-down (LSA16 section 4.3).

Levels are numbered as in the paper, rho_1 < rho_2 < ...: level 1 is the finest. Departures from the paper:

1. The paper proceeds to the first scale at which *every* superpixel overlaps two labels. Here a `share` is enough.
2. Coarser levels from other methods may be given (`label_maps`).
3. The walk gets longer from level to level, so that larger patterns have fewer labels: the largest eigenvalue below 1
   decays to `persistence` to the power of the level. In the paper it decays to 0.95 at all levels.
4. A node has at most n / 13 neighbors: the paper's 256 would be all of n nodes at coarse scales.
5. Above `MOST` superpixels a fixed sample of them is factored, and the others take the mean membership of the sampled
   superpixels nearest to them.
6. The paper splits a label wherever a coarser border crosses it. Here a label stays whole and has several parents: the
   coarser labels that contain at least `_PART` of it, or consist of it to that part. A superpixel in no parent of its
   label takes the most likely label that has its parent. G is smoothed over neighbors by a Potts step.
7. A level that equals the next finer one is dropped, and one of a single label, unless it is the coarsest.
8. The factorization has no restarts (`stochastic_nmf`).

`literal` reverts 3, 4, 6, 7 and 8, the floor of the walk's eigenvalue, and the settling of superpixels of large
images on squares. With share 1 and without a given level, the levels are the paper's. The authors' program (`authors`)
has scales of 2 % to 30 % of the longer side instead of 2 % to 20 % of the shorter, and always the coarsest as a level.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ...engine.color.lens import Lens
from ...engine.core.image import Image
from ...engine.core.window import Window
from ...engine.errors import ImageError
from ...engine.session.facts import Facts
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from ..superpixels.hierarchy import COARSEST, Hierarchy, hierarchy, scales
from ..superpixels.slic import SeedGrid
from ..superpixels.superpixels import COMPACTNESS, Superpixels, finest_scale, require_superpixels, superpixels
from .affinity_graph import NEIGHBORS, similarity_graph
from .features import WORKING_PIXELS, Features, SmallLab, features_of, small_lab
from .legend import numbers_by_color
from .potts import UNLIKELY, settled
from .random_walk import PERSISTENCE, SLOWEST, Walk
from .stochastic_nmf import Factors, factored

MOST = 20000  # superpixels up to which all are nodes of the graph
_PIXEL_BYTES, _EDGE_BYTES = 300, 80  # peak, per pixel of the reduced image and per edge of the graph
_RUN_BYTES = 40  # peak, per run of the label map while the hierarchy is built
_DESCRIBED, _LABELED = 550, 800  # time for each superpixel, in that of cutting a pixel
_NEAREST = 6  # sampled superpixels from which another one takes its membership
_NODES_PER_NEIGHBOR, _FEWEST_NEIGHBORS = 13, 8
AUTHORS_COARSEST = 0.3  # of the longer side: the coarsest scale of the authors' program
_PART = 0.05  # of a label in a coarser one, or of that in the label, from which the coarser one is a parent


@dataclass(frozen=True, kw_only=True)
class LabelSettings:
    """Settings of label maps; see `filters.label`."""

    neighbors: int = NEIGHBORS
    persistence: float = PERSISTENCE
    share: float = 0.5
    literal: bool = False
    authors: bool = False
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
        Superpixel at this level for each finest superpixel, 0 to m - 1.
    labels : (n,) int64
        Label of each finest superpixel, 1 to count; none is empty.
    parents : count tuples of int
        Labels of the next coarser level that contain label i + 1, most of it first; none at the coarsest.
    features : (m, d)
    F : (m, r)
        Distribution of the walk from each label; divided by its column's maximum, the fit of each superpixel.
    G : (r, m)
        Membership of superpixels in labels.
    """

    scale: float
    groups: np.ndarray
    labels: np.ndarray
    count: int
    parents: tuple[tuple[int, ...], ...]
    features: np.ndarray
    F: np.ndarray
    G: np.ndarray


@dataclass(frozen=True)
class LabelMaps:
    """Label maps of an image.

    Attributes
    ----------
    superpixels : Superpixels
        The n finest superpixels.
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
    features: str = "both",
    settings: LabelSettings | None = None,
    *,
    runs: int = 1,
    minsize: int | None = None,
    compactness: float | None = None,
    coarsest: Sequence[Callable[[Superpixels, SmallLab, Resources], np.ndarray]] = (),
) -> LabelMaps:
    """Label maps of the image's first part.

    Parameters
    ----------
    image, lens
    features : str
        One of `features.KINDS`.
    runs, minsize, compactness
        As for `superpixels`.
    coarsest : sequence of callable
        Each gives a separate coarser level: the label of each superpixel, (n,) int64, 0 to r - 1, none empty.

    Raises
    ------
    ImageError
        Alpha is 0 everywhere, values are NaN or Inf, or memory is insufficient.
    """
    settings = settings or LabelSettings()
    window = image.first.window
    side, sigma = _finest(window, settings)
    sigmas = scales(sigma, (AUTHORS_COARSEST if settings.authors else COARSEST) * side)
    seeds = SeedGrid.of(window.width, window.height, sigma, COMPACTNESS).count
    require_memory(image, resources, settings)
    cutting, describing, labeling = progress.stages(
        runs * window.width * window.height, _DESCRIBED * seeds, _LABELED * seeds
    )
    with resources.stats.time("superpixels"):
        finest = superpixels(
            image, lens, resources, sigma=sigma, compactness=compactness, runs=runs, seed=settings.seed,
            minsize=minsize, advance=cutting.advance, literal=settings.literal, powers=features in ("both", "moments"),
        )  # fmt: skip
        if not finest.count:
            raise ImageError(f"{image.source}: alpha is 0 everywhere: expected opaque pixels")
    resources.cache.forget()  # everything has been read
    _require(resources, finest.window, finest.count, settings)
    small, tree_bytes = small_lab(finest), _RUN_BYTES * len(finest.runs.left)
    # One BLAS thread: products are thin, waiting threads would spin, and sums must not depend on the number of threads.
    with threadpool_limits(1, "blas"):
        with (
            resources.in_background(lambda: hierarchy(finest, resources, sigmas), tree_bytes) as tree,
            resources.stats.time("describe superpixels"),
        ):
            described = features_of(features, finest, small, resources)
        describing.advance(1, 1)
        resources.cache.forget()

        def top() -> list[np.ndarray]:
            return [level(finest, small, resources) for level in coarsest]

        with resources.in_background(top) as coarse, resources.stats.time("label superpixels"):
            levels = label_levels(tree(), described, settings, finest.edges, resources, coarse)
    labeling.advance(1, 1)
    resources.cache.forget()
    return LabelMaps(finest, levels)


def _finest(window: Window, settings: LabelSettings) -> tuple[int, float]:
    """The side of an image from which scales follow, and the finest scale, px."""
    side = max(window.size) if settings.authors else min(window.size)
    return side, finest_scale(side)


def require_memory(image: Image, facts: Facts, settings: LabelSettings) -> None:
    """Refuse what exceeds the memory budget by sizes alone: there will hardly be fewer superpixels than seeds."""
    window = image.first.window
    sigma = _finest(window, settings)[1]
    _require(facts, window, SeedGrid.of(window.width, window.height, sigma, COMPACTNESS).count, settings)
    require_superpixels(image.first, facts, sigma, literal=settings.literal)


def _require(facts: Facts, window: Window, count: int, settings: LabelSettings) -> None:
    """Raise an error if `count` superpixels of a window exceed the memory budget."""
    pixels = min(window.width * window.height, WORKING_PIXELS)
    need = pixels * _PIXEL_BYTES + min(count, MOST) * settings.neighbors * _EDGE_BYTES
    facts.require(need, "labeling")


def label_levels(
    hierarchy: Hierarchy,
    features: Features,
    settings: LabelSettings,
    edges: np.ndarray,
    resources: Resources,
    coarsest: Callable[[], Sequence[np.ndarray]] = lambda: (),
) -> tuple[LabelLevel, ...]:
    """Levels of labels, finest first, as a tree.

    `edges` (m, 2) int.
    """
    levels = _bottom_up(hierarchy, features, settings, edges, resources)
    given = [_given(hierarchy, features, top) for top in coarsest()]
    levels += [level for level in given if level.count > 1] or given[:1]  # a wall of bricks is one texture
    return top_down(levels, settings.literal)


# --- one scale ---


def labeled(points: np.ndarray, settings: LabelSettings, level: int, resources: Resources) -> Factors:
    """Labels of m points, (m, d), at a level (0: the finest). No label is empty."""
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
    factors = factored(walk, resources, settings.seed, settings.tries, settings.literal)
    F, G = factors.F[graph.node] / graph.counts[graph.node, None], factors.G[:, graph.node]
    return _without_empty(Factors(F, G, factors.error))


def _without_empty(factors: Factors) -> Factors:
    """Without labels that are the most likely one of no node."""
    return _only(factors, np.unique(factors.G.argmax(0)))


def _only(factors: Factors, used: np.ndarray) -> Factors:
    """Some of the labels, renormalized."""
    kept = factors.G[used]
    return Factors(factors.F[:, used], kept / np.maximum(kept.sum(0), 1e-300), factors.error)


def _labeled_by_sample(points: np.ndarray, settings: LabelSettings, level: int, resources: Resources) -> Factors:
    from scipy.spatial import cKDTree  # only for very large images

    random = np.random.default_rng(settings.seed)
    chosen = np.sort(random.choice(len(points), MOST, replace=False))
    small = labeled(points[chosen], settings, level, resources)
    _, near = cKDTree(points[chosen]).query(points, _NEAREST)
    G = small.G[:, near].mean(2)
    F = small.F[near].mean(1)
    G[:, chosen], F[chosen] = small.G, small.F
    return _without_empty(Factors(F / F.sum(0), G, small.error))


# --- bottom-up ---


def _bottom_up(
    hierarchy: Hierarchy, features: Features, settings: LabelSettings, edges: np.ndarray, resources: Resources
) -> list[LabelLevel]:
    """Independent levels, finest first, without parents or intersections."""
    levels: list[LabelLevel] = []
    at = 0
    while True:
        levels.append(_level(hierarchy, features, settings, edges, at, len(levels), resources))
        following = _next_scale(hierarchy, levels[-1].labels, at, settings.share, settings.authors)
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
    factors, scale = labeled(values, settings, level, resources), float(hierarchy.sigmas[at])
    likely = factors.G[:, groups]
    labels = likely.argmax(0) if settings.literal else settled(likely, edges, resources)
    used, labels = np.unique(labels, return_inverse=True)
    factors = _only(factors, used)
    return LabelLevel(scale, groups, labels + 1, len(used), (), values, factors.F, factors.G)


def _given(hierarchy: Hierarchy, features: Features, labels: np.ndarray) -> LabelLevel:
    """A level from another method: each superpixel is a group with full membership in its label."""
    groups, count = np.arange(len(labels), dtype=np.int32), int(labels.max()) + 1
    G = (labels == np.arange(count)[:, None]).astype(np.float64)
    F = (G / G.sum(1, keepdims=True)).T
    return LabelLevel(float(hierarchy.sigmas[-1]), groups, labels + 1, count, (), features(groups), F, G)


def _next_scale(hierarchy: Hierarchy, labels: np.ndarray, at: int, share: float, given: bool) -> int | None:
    """The finest level above `at` at which a proportion `share` of superpixels overlaps two labels.

    Superpixels only merge, and a merged one overlaps all labels of its parts, so bisection applies. `given`: the
    coarsest level needs no such share.
    """
    low, high = at, len(hierarchy.sigmas) - (given and at < len(hierarchy.sigmas) - 1)
    while high - low > 1:
        middle = (low + high) // 2
        if _mixed_share(hierarchy.partition(middle), labels) >= share:
            high = middle
        else:
            low = middle
    return high if high < len(hierarchy.sigmas) else None


def _mixed_share(groups: np.ndarray, labels: np.ndarray) -> float:
    """Proportion of groups with two or more labels."""
    count = int(labels.max()) + 1
    pairs = np.unique(groups.astype(np.int64) * count + labels)
    return float((np.bincount(pairs // count) >= 2).mean())


# --- top-down ---


def top_down(levels: list[LabelLevel], literal: bool = False) -> tuple[LabelLevel, ...]:
    """Levels, given finest first, whose labels know their parents; see departures 6 and 7.

    `literal`: LSA16 algorithm 2, which intersects each label with those of the next coarser level.
    """
    if not literal:
        end = max((n for n, level in enumerate(levels, 1) if level.count > 1), default=0)
        levels = [level for level in levels[:end] if level.count > 1] + levels[end : end + 1]
    tree: list[LabelLevel] = []  # coarsest first
    for level in reversed(levels):
        if tree and not literal and _are_equal(level, tree[-1]):
            tree.pop()
        tree.append((_intersected if literal else _placed)(level, tree[-1] if tree else None))
    return tuple(reversed(tree))


def _intersected(level: LabelLevel, above: LabelLevel | None) -> LabelLevel:
    coarse = np.zeros(len(level.labels), np.int64) if above is None else above.labels
    pairs, labels = np.unique(np.stack([coarse, level.labels], axis=1), axis=0, return_inverse=True)
    parents = tuple((coarse,) if coarse else () for coarse in pairs[:, 0].tolist())
    return replace(level, labels=labels.reshape(-1) + 1, count=len(pairs), parents=parents)


def _are_equal(level: LabelLevel, other: LabelLevel) -> bool:
    """Whether both have the same labels, whatever their numbers."""
    pairs = len(np.unique(level.labels * (other.count + 1) + other.labels))
    return pairs == level.count == other.count


def _placed(level: LabelLevel, above: LabelLevel | None) -> LabelLevel:
    """The level with the parents of its labels; a superpixel outside of those takes the most likely label inside.

    Labels are renumbered so that their colors are close to those of their main parents.
    """
    if above is None:
        return replace(level, parents=((),) * level.count)
    own, coarse = level.labels - 1, above.labels - 1
    table = np.zeros((above.count, level.count))
    np.add.at(table, (coarse, own), 1.0)
    inside = (table >= _PART * table.sum(0)) | (table >= _PART * table.sum(1, keepdims=True))
    inside &= table > 0
    inside[table.argmax(0), np.arange(level.count)] = inside[np.arange(above.count), table.argmax(1)] = True
    moved = np.flatnonzero(~inside[coarse, own])
    likely = level.G[:, level.groups[moved]].T + 1e-9 * table[coarse[moved]] + UNLIKELY
    labels = level.labels.copy()
    labels[moved] = np.where(inside[coarse[moved]], likely, 0.0).argmax(1) + 1
    most = np.argsort(-table, axis=0, kind="stable")
    parents = [tuple((most[inside[most[:, n], n], n] + 1).tolist()) for n in range(level.count)]
    order = numbers_by_color(table.sum(0), most[0] + 1).argsort()
    number = order.argsort() + 1
    return replace(
        level,
        labels=number[labels - 1],
        parents=tuple(parents[n] for n in order),
        F=level.F[:, order],
        G=level.G[order],
    )
