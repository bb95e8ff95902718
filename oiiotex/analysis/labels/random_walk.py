# SPDX-License-Identifier: Apache-2.0
"""The random walk on a graph: D^s of LSA16 eq. 6, never formed explicitly.

With S = T^-1/2 W T^-1/2, D^s = T^1/2 S^s T^-1/2. S^s is V (V^T S V)^s V^T in the subspace V of its largest eigenvalues,
computed by subspace iteration with Chebyshev polynomials (Zhou, Saad, Tiago, Chelikowsky, Journal of Computational
Physics 219, 2006). Products with S are kernels, and the remaining matrices are 48 x 48. No eigenvectors are computed,
since those of equal eigenvalues are arbitrary, and no sum depends on a library's order of summation.
"""

from __future__ import annotations

import math

import numpy as np

from ...engine.core.elementary import logarithm
from ...engine.errors import present
from ...engine.session.resources import Resources
from .affinity_graph import AffinityGraph
from .products import Spread, gram, product

PERSISTENCE = 0.95  # remaining power of the largest eigenvalue below 1 after the walk: LSA16 section 4.4
SLOWEST = 0.98  # floor of this eigenvalue: for faster walks LSA16's rule would stop before they mix at all
DIMENSIONS = 48  # of the subspace: 64 change no score by .01
_ONE = 0.9999  # eigenvalues above count as 1: LSA16 section 4.4
_MOST_STEPS = 2000
_POWERS, _DEGREES = 4, (6, 6, 6)  # initial powers of S, then degrees of the polynomials
_BISECTIONS = 16  # of an interval of eigenvalues
_NOISE = 1e-5  # of a distribution's maximum: smaller values are zeroed
_LOST = 1e-6  # of a column's length: a smaller remainder after projection is linear dependence


class Walk:
    """Steps of the random walk on a graph.

    `n`: nodes; `mass` (n,) float64: proportional to the stationary distribution; `steps`: s; `left`, `right` (n, k)
    float32: D^s is left right^T; `norm`: |D^s|^2, Frobenius.
    """

    def __init__(self, graph: AffinityGraph, resources: Resources, persistence: float, slowest: float = SLOWEST):
        self.mass, self.n = graph.mass, len(graph.mass)
        self._root = np.sqrt(self.mass).astype(np.float32)
        self._spread = Spread(graph.scaled, DIMENSIONS, resources)
        basis, inside = _subspace(self._spread, self._root, resources)
        self.steps = steps_of(_largest_below_one(inside, slowest), persistence, slowest)
        self.left = self._root[:, None] * product(basis, _power(inside, self.steps).astype(np.float32), resources)
        self.right = basis / self._root[:, None]
        squares = gram(self.left, self.left, resources).astype(np.float64) * gram(self.right, self.right, resources)
        self.norm = float(squares.sum())

    def step(self, start: np.ndarray) -> np.ndarray:
        """D p: distribution one step after p, (n,) float32."""
        return self._root * self._spread.once(start / self._root)

    def column(self, node: int) -> np.ndarray:
        """D^s from one node: its similarity to all nodes as a distribution, (n,) float32."""
        column = (self.left * self.right[node]).sum(1)
        column[column < np.float32(_NOISE) * column.max()] = 0
        total = column.sum(dtype=np.float64)
        if total <= 0:  # outside of the subspace the walk stays at the node
            return (np.arange(self.n) == node).astype(np.float32)
        return column / np.float32(total)


def steps_of(largest: float, persistence: float, slowest: float) -> int:
    """Number of steps until the largest eigenvalue below 1 has decayed to `persistence`. LSA16 section 4.4.

    A value below `slowest` (0: the paper) is raised to it; for 0, no eigenvalue, the walk takes one step.
    """
    largest = max(largest, slowest)
    if largest <= 0:
        return 1
    share = float(logarithm(np.array(persistence * largest)) / logarithm(np.array(largest)))
    return int(min(max(math.floor(share), 1), _MOST_STEPS))


def _subspace(spread: Spread, root: np.ndarray, resources: Resources) -> tuple[np.ndarray, np.ndarray]:
    """Subspace of S's largest eigenvalues: V (n, 48) float32, orthonormal, and V^T S V (48, 48) float64."""
    n = len(root)
    bits = np.random.Philox(key=0).random_raw(n)[:, None] >> np.arange(DIMENSIONS, dtype=np.uint64)
    start = np.where(bits & np.uint64(1), 1.0, -1.0)
    start[:, 0] = root  # the eigenvector of eigenvalue 1
    start /= np.sqrt((start**2).sum(0))

    def inside(basis: np.ndarray) -> np.ndarray:
        spread.start(basis)
        spread.step(1.0, 0.0, 0.0)
        return _symmetric(gram(basis, spread.now(), resources))

    spread.start(start.astype(np.float32))
    for _ in range(_POWERS):
        spread.step(1.0, 0.0, 0.0)
    basis = _orthonormal(spread.now(), resources)
    for degree in _DEGREES:
        edge = float(np.diagonal(inside(basis)).min())  # some eigenvalues lie below it
        spread.start(basis)
        _filtered(spread, degree, min(max(edge, -0.5), 0.9))
        basis = _orthonormal(spread.now(), resources)
    return basis, inside(basis)


def _filtered(spread: Spread, degree: int, edge: float) -> None:
    """Apply the Chebyshev polynomial of S that is small from -1 to `edge` and 1 at 1."""
    middle, half = (edge - 1.0) / 2.0, (edge + 1.0) / 2.0
    first = sigma = half / (1.0 - middle)
    spread.step(sigma / half, -middle * sigma / half, 0.0)
    for _ in range(degree - 1):
        following = 1.0 / (2.0 / first - sigma)
        spread.step(2.0 * following / half, -2.0 * following * middle / half, -sigma * following)
        sigma = following


def _orthonormal(columns: np.ndarray, resources: Resources) -> np.ndarray:
    """An orthonormal basis of the span of columns, (n, k) float32; 0 for linearly dependent columns.

    By a Cholesky factor of their products, twice, because the first is of single precision.
    """
    for _ in range(2):
        products = _symmetric(gram(columns, columns, resources))
        length = np.sqrt(np.maximum(np.diagonal(products), 0.0))
        inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
        turned = _inverse_of_factor(products * inverse[:, None] * inverse) * inverse[:, None]
        columns = product(columns, turned, resources)
    return columns


def _inverse_of_factor(products: np.ndarray) -> np.ndarray:
    """R^-1 where R^T R = products, upper triangular with unit diagonal; columns of 0 for linear dependence."""
    n = len(products)
    both, pivots = np.concatenate([products, np.eye(n)], 1), np.ones(n)
    for k in range(n):  # elimination, applied to the unit matrix as well
        pivot = both[k, k]
        if pivot <= _LOST:
            both[k] = 0.0
            continue
        factors = both[k + 1 :, k] / pivot
        both[k + 1 :] -= factors[:, None] * both[k]
        pivots[k] = pivot
    return (both[:, n:] / np.sqrt(pivots)[:, None]).T


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return (matrix.astype(np.float64) + matrix.T) / 2.0


def _multiplied(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """A b of small matrices, in a fixed order of summation, which BLAS does not guarantee."""
    made = np.zeros((len(a), b.shape[1]))
    for k in range(len(b)):
        made += a[:, k, None] * b[k]
    return made


def _power(matrix: np.ndarray, exponent: int) -> np.ndarray:
    """A power by repeated squaring."""
    result, square = None, matrix
    while True:
        if exponent & 1:
            result = square if result is None else _multiplied(result, square)
        exponent >>= 1
        if not exponent:
            return present(result)
        square = _multiplied(square, square)


# --- eigenvalues of small symmetric matrices ---


def _fewer(matrix: np.ndarray, bound: float) -> int:
    """Number of eigenvalues below a bound: the negative pivots of elimination (Sylvester's law of inertia)."""
    left, negative = matrix - bound * np.eye(len(matrix)), 0
    for k in range(len(left)):
        pivot = left[k, k] if abs(left[k, k]) > 1e-12 else -1e-12
        negative += pivot < 0
        left[k + 1 :, k + 1 :] -= (left[k + 1 :, k, None] / pivot) * left[k, k + 1 :]
    return negative


def _bisected(matrix: np.ndarray, rank: int, low: float, high: float) -> float:
    """The eigenvalue with `rank` others below it, between low and high, by bisection."""
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2.0
        if _fewer(matrix, middle) <= rank:
            low = middle
        else:
            high = middle
    return low


def _largest_below_one(matrix: np.ndarray, slowest: float) -> float:
    """The largest eigenvalue below 1 and above `slowest`, else 0."""
    fewer = _fewer(matrix, _ONE)
    if fewer == 0 or _fewer(matrix, slowest) == fewer:
        return 0.0
    return _bisected(matrix, fewer - 1, slowest, _ONE)
