# SPDX-License-Identifier: Apache-2.0
"""Which superpixels look alike: a sparse graph of similarities, and the random walk on it.

LSA16 section 4.1 and 4.4: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction
for Texture Synthesis, SIGGRAPH 2016. Departures from the paper:

1. The walk's matrix is made from a symmetric one, W = (K + K^T) / 2, so the chain is reversible: its spectrum is
   real, and a power of it is a product of two thin matrices.
2. Nearest neighbours are exact. Points lie on a grid of 1 / 1024, where squared distances are exact in float64: the
   same graph on every machine, for any number of threads and whatever the order of summation.
3. Points that are equal are one node with a multiplicity, so that flat pictures have neighbours that differ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg
from scipy.sparse.csgraph import connected_components

NEIGHBOURS = 256  # of a node in the graph: LSA16 section 4.1
PERSISTENCE = 0.95  # what is left of the largest eigenvalue below 1 after the steps: LSA16 section 4.4
EIGENVALUES = 40  # of D that are looked at: 64 move no score by .01
LOCAL = 6  # which neighbour's distance is the local scale: LSA16 eq. 4
_GRID = 1024.0
_FINEST = 0.1  # of a local scale: differences that no eye sees are not blown up
_LARGEST_R = 6.0  # of eq. 5's r: what lies 20 local scales apart stays apart, even where nothing lies between
_BLOCK = 1 << 20  # distances that a thread holds at once
_DENSE = 400  # nodes up to which a full eigendecomposition costs no more than a partial one
_ONE = 0.9999  # eigenvalues above count as 1: LSA16 section 4.4
_MOST_STEPS = 2000
SLOWEST = 0.98  # a faster walk is taken for one of this eigenvalue: LSA16's rule would stop it before it mixes at all
_DROPPED = 1e-3  # eigenvalues of D^s below are left out


Spread = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""(work, pieces) -> what `work` makes of each piece, in order: `map`, or `Session.spread`."""


@dataclass(frozen=True)
class AffinityGraph:
    """The similarity graph of m points, equal ones taken together: n nodes.

    Attributes
    ----------
    weights : (n, n) sparse, symmetric
        Similarities between nodes, counted for all the points that they stand for.
    node : (m,) int64
        The node of every point.
    counts : (n,) int64
        How many points a node stands for.
    r : float
        The global normalisation of LSA16 eq. 5.
    """

    weights: sparse.csr_array
    node: np.ndarray
    counts: np.ndarray
    r: float


def similarity_graph(points: np.ndarray, neighbours: int = NEIGHBOURS, spread: Spread = map) -> AffinityGraph:
    """LSA16 eq. 4 and 5 over the nearest neighbours of m points in d dimensions, (m, d) float.

    `spread` does pieces of work on several threads, as `Session.spread` does.
    """
    rounded = np.rint((points - points.mean(0)) * _GRID) / _GRID
    nodes, node, counts = np.unique(rounded, axis=0, return_inverse=True, return_counts=True)
    node, n = node.reshape(-1), len(nodes)
    counts = counts.astype(np.int64)
    if n == 1:
        return AffinityGraph(sparse.csr_array(np.array([[float(counts[0]) ** 2]])), node, counts, 0.0)
    index, squared = nearest(nodes, min(neighbours, n - 1), spread)
    scale = _local_scales(squared, counts, index)
    relative = squared / (scale[:, None] * scale[index])
    shares = counts[:, None] * counts[index].astype(np.float64)
    r = _global_scale(relative, shares, float((counts.astype(np.float64) ** 2).sum()))
    similar = np.exp(-relative * np.exp(-r)) * shares  # LSA16 eq. 4
    starts = np.arange(0, index.size + 1, index.shape[1])
    directed = sparse.csr_array((similar.ravel(), index.ravel(), starts), shape=(n, n))
    own = sparse.diags_array(counts.astype(np.float64) ** 2)
    return AffinityGraph(sparse.csr_array((directed + directed.T) * 0.5 + own), node, counts, r)


def nearest(points: np.ndarray, count: int, spread: Spread = map) -> tuple[np.ndarray, np.ndarray]:
    """The `count` nearest others of every point, nearest first: (index (n, count) int32, squared distances).

    Among equally far points, those of lower index come first: distance and index are one whole number, the key by
    which is chosen. In 15 dimensions a k-d tree looks at nearly all points; blocked matrix products look at all of
    them faster. Distances beyond what a key holds beside the index, of values no Lab has, are rounded in it.
    """
    n = len(points)
    squares = (points**2).sum(1)
    bits = n.bit_length()
    unit = min(_GRID**2, 2.0 ** (62 - bits) / (4.0 * float(squares.max()) + 1.0))  # of a distance in a key
    rows = max(1, _BLOCK // n)

    def block(first: int) -> tuple[np.ndarray, np.ndarray]:
        here = slice(first, min(n, first + rows))
        apart = points[here] @ points.T
        apart *= -2.0
        apart += squares
        apart += squares[here, None]
        keys = (apart * unit).astype(np.int64)
        keys <<= bits
        keys |= np.arange(n)
        keys[np.arange(len(keys)), np.arange(here.start, here.stop)] = np.iinfo(np.int64).max
        keys.partition(count - 1, axis=1)
        chosen = np.sort(keys[:, :count], axis=1) & ((1 << bits) - 1)
        return chosen.astype(np.int32), np.maximum(np.take_along_axis(apart, chosen, 1), 0.0)

    blocks = list(spread(block, range(0, n, rows)))
    return np.concatenate([index for index, _ in blocks]), np.concatenate([squared for _, squared in blocks])


def _local_scales(squared: np.ndarray, counts: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Distance from every node to the sixth closest point, its own copies counted, (n,)."""
    seen = counts[:, None] - 1 + np.cumsum(counts[index], axis=1)
    place = np.minimum((seen < LOCAL).sum(1), squared.shape[1] - 1)
    scale = np.sqrt(squared[np.arange(len(place)), place])
    scale[counts > LOCAL] = 0.0
    return np.maximum(scale, max(_FINEST, 1e-3 * float(scale.max())))


def _global_scale(relative: np.ndarray, shares: np.ndarray, diagonal: float) -> float:
    """The r at which the sum of similarities grows fastest: LSA16 eq. 5."""

    def slope(r: float) -> float:
        scaled = relative * np.exp(-r)
        similar = np.exp(-scaled) * shares
        return -float((scaled * similar).sum() / (diagonal + similar.sum()))

    r = min(np.arange(-6.0, _LARGEST_R, 0.5).tolist(), key=slope)
    for step in (0.5, 0.1, 0.02):  # the vertex of a parabola through three places
        low, middle, high = slope(r - step), slope(r), slope(r + step)
        bend = low - 2.0 * middle + high
        if bend > 0:
            r += float(np.clip(0.5 * (low - high) / bend, -1.0, 1.0)) * step
    return min(r, _LARGEST_R)


class Walk:
    """Steps of the random walk on a graph: D^s of LSA16 eq. 6 as A B^T, never formed.

    Attributes
    ----------
    mass : (n,)
        Column sums of the weights; what the walk tends to, but for a factor.
    steps : int
        s.
    eigenvalues : (q,)
        Of D, largest first.
    left, right : (n, k)
        A and B.
    norm : float
        |D^s|^2, Frobenius.
    """

    def __init__(self, weights: sparse.csr_array, persistence: float, slowest: float = SLOWEST):
        self.mass = np.asarray(weights.sum(axis=0)).ravel()
        self.n = weights.shape[0]
        root = np.sqrt(self.mass)
        scaled = sparse.diags_array(1.0 / root)
        self._transition = sparse.csr_array(weights @ sparse.diags_array(1.0 / self.mass))  # LSA16 eq. 6
        self.eigenvalues, vectors = _spectrum(sparse.csr_array(scaled @ weights @ scaled), root, weights)
        self.steps = steps_of(self.eigenvalues, persistence, slowest)
        powers = np.sign(self.eigenvalues) ** self.steps * np.abs(self.eigenvalues) ** self.steps
        kept = max(1, int((np.abs(powers) > _DROPPED).sum()))
        self.left = root[:, None] * vectors[:, :kept] * powers[:kept]
        self.right = vectors[:, :kept] / root[:, None]
        self.norm = float(((self.left.T @ self.left) * (self.right.T @ self.right)).sum())

    def step(self, start: np.ndarray) -> np.ndarray:
        """D p: where the walk is one step after p, (n,) or (n, k)."""
        return self._transition @ start

    def walk(self, start: np.ndarray) -> np.ndarray:
        """D^s p."""
        return self.left @ (self.right.T @ start)

    def back(self, end: np.ndarray) -> np.ndarray:
        """(D^s)^T p."""
        return self.right @ (self.left.T @ end)

    def column(self, node: int) -> np.ndarray:
        """D^s from one node: a map of how similar all are to it, a distribution, (n,)."""
        column = np.maximum(self.left @ self.right[node], 0.0)
        return column / column.sum()


def steps_of(eigenvalues: np.ndarray, persistence: float, slowest: float) -> int:
    """How long to walk: until that share of the largest eigenvalue below 1 is left. LSA16 section 4.4.

    An eigenvalue below `slowest` is taken for it; 0: the paper.
    """
    below = eigenvalues[(eigenvalues < _ONE) & (eigenvalues > 0)]
    if not below.size:
        return 1
    largest = max(float(below.max()), slowest)
    return int(np.clip(np.floor(np.log(persistence * largest) / np.log(largest)), 1, _MOST_STEPS))


def _spectrum(scaled: sparse.csr_array, root: np.ndarray, weights: sparse.csr_array) -> tuple[np.ndarray, np.ndarray]:
    """The largest eigenvalues of T^-1/2 W T^-1/2 and their vectors.

    A piece of the graph that nothing joins to the rest has an eigenvalue 1, whose vector is known. These are taken
    out first: iterations from one start would find one of several equal eigenvalues.
    """
    n = scaled.shape[0]
    if n <= _DENSE:
        values, vectors = np.linalg.eigh(scaled.toarray())
        return values[::-1], _oriented(vectors[:, ::-1])
    pieces, piece = connected_components(weights, directed=False)
    known = np.zeros((n, pieces))
    known[np.arange(n), piece] = root
    known /= np.sqrt((known**2).sum(0))
    if pieces >= EIGENVALUES:
        return np.ones(pieces), known

    def rest(x: np.ndarray) -> np.ndarray:
        return scaled @ x - known @ (known.T @ x)

    operator = scipy.sparse.linalg.LinearOperator((n, n), matvec=rest, matmat=rest, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(n)
    more = EIGENVALUES - pieces
    values, vectors = scipy.sparse.linalg.eigsh(
        operator, more, which="LA", v0=start, tol=1e-4, ncv=min(n, 2 * more + 1)
    )
    values = np.concatenate([np.ones(pieces), values[::-1]])
    return values, np.concatenate([known, _oriented(vectors[:, ::-1])], axis=1)


def _oriented(vectors: np.ndarray) -> np.ndarray:
    """Eigenvectors whose largest entry is positive: the sign that a solver gives is arbitrary."""
    largest = np.abs(vectors).argmax(0)
    return vectors * np.where(vectors[largest, np.arange(vectors.shape[1])] < 0, -1.0, 1.0)
