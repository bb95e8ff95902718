# SPDX-License-Identifier: Apache-2.0
"""Labels from a random walk: D^s ~ F G with left-stochastic F and G, whose rank is found (LSA16 section 4.2).

F, (n, r): column c is the distribution of the walk from label c. G, (r, n): column j is the membership of node j in the
labels. The paper leaves its solver of eq. 8 to a supplement; the authors' program, published under the MIT license,
shows it. This one consists of:

- start: heat diffuses from an uncovered node of the largest mass; all nodes that lose more of it than they gain belong
  to the same source, and are covered (probe cover). Without restarts it is deterministic. `thorough`, as the authors:
  probes in random order, and G by least squares, until `_FRUITLESS` tries in a row do not reduce the error.
- descent: alternating F and G, each a least-squares problem on the simplex (FISTA, with Newton's method for the
  threshold of the projection). Columns of G are independent problems with separate restarts.
- boosting (`tries` > 0): starts from several random orders of probes are stacked, and the walk between their labels is
  factored in turn, `_COMBINED` times.

Departure from the authors: they factor about 30 r nodes and extend the result to the others, to save time. Here D^s is
known by thin factors, and all nodes are factored.

Large matrices are processed by kernels in single precision with a fixed order of summation; only matrices of the size
of the labels are left to the host.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..errors import present
from ..opencl.buffers import Buffers
from ..session.resources import Resources
from .products import TASK, gram, padded, product, wide_of

_ROUNDS = 30  # alternations of F and G
_INNER = 8  # steps of either in a round
_FIRST = 100  # steps of the first G
_FRUITLESS, _COMBINED = 55, 5  # of the authors' program
_GAIN = 1e-2  # least relative decrease of the error in a round; a tenth of it changes no score by .01
_SETTLED = 1e-6  # greatest change of a converged membership
_FAR = -1e37  # value of padding, which a projection removes
_BOUNDS = 20  # iterations of the bound of a norm


class Power(Protocol):
    """A left-stochastic matrix left right^T to factor, such as `random_walk.Walk`."""

    n: int
    norm: float
    mass: np.ndarray
    left: np.ndarray
    right: np.ndarray

    def step(self, start: np.ndarray) -> np.ndarray:
        """One step of the walk."""

    def column(self, node: int) -> np.ndarray:
        """One column of the matrix."""


@dataclass(frozen=True)
class Factors:
    """A factorization.

    F : (n, r) float64
        Distribution of the walk from each label; columns sum to 1.
    G : (r, n) float64
        Membership of nodes in labels; columns sum to 1.
    error : float
        |D^s - F G|^2 / |D^s|^2.
    """

    F: np.ndarray
    G: np.ndarray
    error: float


def factored(
    walk: Power, resources: Resources, seed: int = 0, tries: int = 0, thorough: bool = False
) -> Factors:  # fmt: skip
    """The stochastic factorization of LSA16 eq. 8."""
    random = np.random.default_rng(seed)
    known: dict[Power, dict[int, np.ndarray]] = {}

    def run(of: Power) -> Factors:
        if not thorough:
            return _descended(of, resources, probe_cover(of, random))
        return _descended(of, resources, *_best_start(of, resources, random, known.setdefault(of, {})))

    factors = run(walk) if thorough else _descended(walk, resources, probe_cover(walk))
    if tries == 0:
        return factors
    runs = [factors] + [run(walk) for _ in range(tries)]
    stacked_F = np.concatenate([run.F for run in runs], axis=1)
    stacked_G = np.concatenate([run.G for run in runs]) / len(runs)
    between = _Dense(product(stacked_G, stacked_F, resources), resources)
    joined = min((run(between) for _ in range(_COMBINED)), key=lambda f: f.error)
    F, G = product(stacked_F, joined.F, resources), product(joined.G, stacked_G, resources)
    return _descended(walk, resources, F, G)


def probe_cover(
    walk: Power, random: np.random.Generator | None = None, known: dict[int, np.ndarray] | None = None
) -> np.ndarray:
    """Distributions from successive probes, until each node is covered: the start of F, (n, r).

    With p = D^s e_j and q = D p, nodes with q < p still lose heat to the others: they share the source of j. `known`
    keeps, for each probed node, the others as bits.
    """
    known = {} if known is None else known
    unused = np.ones(walk.n, bool)
    columns = []
    while unused.any():
        left = np.flatnonzero(unused)
        node = int(left[np.argmax(walk.mass[left])] if random is None else random.choice(left))
        heat = walk.column(node)
        columns.append(heat)
        if node not in known:
            known[node] = np.packbits(walk.step(heat) >= heat)
        unused &= np.unpackbits(known[node], count=walk.n).view(bool)
        unused[node] = False
        last = np.flatnonzero(unused)
        if len(last) == 1 and max(column[last[0]] for column in columns) > 0:  # no label for a node that others reach
            break
    return np.stack(columns, axis=1)


def _best_start(
    walk: Power, resources: Resources, random: np.random.Generator, known: dict[int, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """F and G of the lowest error, from random orders of probes, until `_FRUITLESS` of them in a row gain nothing."""
    least, fruitless, best = np.inf, 0, None
    while fruitless < _FRUITLESS:
        F = probe_cover(walk, random, known)
        from_labels, overlap = gram(walk.left, F, resources), gram(F, F, resources)
        start = np.full((walk.n, F.shape[1]), 1.0 / F.shape[1], np.float32)
        linear = product(walk.right, from_labels, resources)
        memberships = memberships_of(start, overlap, linear, _inverse(walk.n, F.shape[1]), _FIRST, resources)
        to_labels, shared = gram(walk.right, memberships, resources), gram(memberships, memberships, resources)
        error = _error(walk, from_labels, to_labels, overlap, shared)
        fruitless = 0 if error < least else fruitless + 1
        if error < least:
            least, best = error, (F, memberships.T)
    return present(best)


def _inverse(n: int, r: int) -> np.ndarray:
    """1 / k for k up to the length of any row or column, float32."""
    return (1.0 / np.maximum(np.arange(max(n, r) + 8), 1)).astype(np.float32)


def _descended(walk: Power, resources: Resources, F: np.ndarray, G: np.ndarray | None = None) -> Factors:
    """Alternate both, until the error no longer decreases."""
    r = F.shape[1]
    F = np.asarray(F, np.float32)
    memberships = np.full((walk.n, r), 1.0 / r, np.float32) if G is None else np.ascontiguousarray(G.T, np.float32)
    right = np.ascontiguousarray(walk.left.T)
    inverse = _inverse(walk.n, r)
    from_labels, overlap = gram(walk.left, F, resources), gram(F, F, resources)
    previous, steps = np.inf, _FIRST
    for _ in range(_ROUNDS):
        linear = product(walk.right, from_labels, resources)  # (D^s)^T F
        memberships = memberships_of(memberships, overlap, linear, inverse, steps, resources)
        to_labels, shared = gram(walk.right, memberships, resources), gram(memberships, memberships, resources)
        error = _error(walk, from_labels, to_labels, overlap, shared)
        if previous - error < _GAIN * previous:
            break
        previous, steps = error, _INNER
        linear = product(np.ascontiguousarray(to_labels.T), right, resources)  # (D^s G^T)^T
        F = distributions(F, shared, linear, inverse, resources)
        from_labels, overlap = gram(walk.left, F, resources), gram(F, F, resources)
    wide_F, wide_G = F.astype(np.float64), memberships.T.astype(np.float64)
    return Factors(wide_F / wide_F.sum(0), wide_G / wide_G.sum(0), error)


def _error(
    walk: Power, from_labels: np.ndarray, to_labels: np.ndarray, overlap: np.ndarray, shared: np.ndarray
) -> float:
    """|D^s - F G|^2 / |D^s|^2 from products of thin matrices."""
    both = (overlap.astype(np.float64) * shared).sum() - 2.0 * (from_labels.astype(np.float64) * to_labels).sum()
    return max(walk.norm + float(both), 0.0) / walk.norm


def memberships_of(
    start: np.ndarray, quadratic: np.ndarray, linear: np.ndarray, inverse: np.ndarray, steps: int, resources: Resources
) -> np.ndarray:
    """Rows x on the simplex that minimize x Q x^T / 2 - x c^T, (n, r) float32.

    `start` (n, r) float32; `quadratic` (r, r) float32; `linear` (n, r) float32; `inverse` (r + 8,) float32.
    """
    device, (n, r) = resources.device, start.shape
    at, tables = padded(start), {"quadratic": padded(quadratic), "linear": padded(linear, _FAR)}
    tables |= {"inverse": inverse, "momentum": _momentum(steps)}
    width = at.shape[1]
    with Buffers(device, {"at": at.nbytes, "ahead": 2 * at.nbytes}, resources.budget, TASK, tables=tables) as buffers:
        device.write(buffers["at"], at)
        arguments = [buffers[name] for name in (*tables, "at", "ahead")]
        numbers = n, r, width, steps, 1.0 / _largest(quadratic), _SETTLED
        device.program("factorization")("memberships", (n,), *arguments, *numbers, group=16)
        return device.read(buffers["at"], at.shape, np.float32)[:, :r]


def distributions(
    start: np.ndarray, quadratic: np.ndarray, linear: np.ndarray, inverse: np.ndarray, resources: Resources
) -> np.ndarray:
    """Columns on the simplex, F (n, r) float32, that minimize tr(F Q F^T) / 2 - tr(F C), by a few steps.

    `start` (n, r) float32; `quadratic` (r, r) float32; `linear` (r, n) float32; `inverse` (n + 8,) float32.
    """
    device, (n, r) = resources.device, start.shape
    at = padded(start.T)
    tables = {"quadratic": padded(quadratic), "linear": padded(linear, _FAR), "inverse": inverse}
    width, run = at.shape[1], device.program("factorization")
    layout = {"at": at.nbytes, "ahead": at.nbytes, "trial": at.nbytes}
    step, momentum = 1.0 / _largest(quadratic), _momentum(_INNER).tolist()
    with Buffers(device, layout, resources.budget, TASK, tables=tables) as buffers:
        for name in ("at", "ahead"):
            device.write(buffers[name], at)
        down = [buffers[name] for name in ("quadratic", "linear", "ahead", "trial")]
        onto = [buffers[name] for name in ("trial", "inverse", "at", "ahead")]
        for ahead in momentum[1:]:
            run("advance", (-(-width // wide_of(resources)), r), *down, r, tables["quadratic"].shape[1], width, step)
            run("project", (r,), *onto, r, width, ahead, group=1)
        return np.ascontiguousarray(device.read(buffers["at"], at.shape, np.float32)[:, :n].T)


def _momentum(steps: int) -> np.ndarray:
    """Momentum, (steps + 1,) float32 by steps since a restart: Beck and Teboulle 2009, eq. 4.2."""
    factors, t = [0.0], 1.0
    for _ in range(steps):
        following = (1.0 + math.sqrt(1.0 + 4.0 * t * t)) / 2.0
        factors.append((t - 1.0) / following)
        t = following
    return np.array(factors, np.float32)


def _largest(matrix: np.ndarray) -> float:
    """Upper bound of the largest eigenvalue of a symmetric nonnegative matrix (Collatz 1942)."""
    matrix = matrix.astype(np.float64) + 1e-30
    vector = np.ones(len(matrix))
    for _ in range(_BOUNDS):
        image = (matrix * vector).sum(1)
        bound, vector = float((image / vector).max()), image / image.max()
    return bound


class _Dense:
    """The second power of a small left-stochastic matrix."""

    def __init__(self, matrix: np.ndarray, resources: Resources):
        positive = np.maximum(matrix, 0.0).astype(np.float64)
        self._once, self._resources = (positive / positive.sum(0)).astype(np.float32), resources
        self.n = len(matrix)
        self.left = product(self._once, self._once, resources)
        self.right = np.eye(self.n, dtype=np.float32)
        self.norm = float((self.left.astype(np.float64) ** 2).sum())
        far = self.left
        for _ in range(7):  # 2^7 times 2 steps
            far = product(far, far, resources)
        self.mass = far.mean(1, dtype=np.float64)

    def step(self, start: np.ndarray) -> np.ndarray:
        return product(self._once, start[:, None], self._resources)[:, 0]

    def column(self, node: int) -> np.ndarray:
        return self.left[:, node]
