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
from typing import TypeAlias

import numpy as np

from ...engine.errors import present
from ...engine.opencl.buffers import Buffers
from ...engine.session.resources import Resources
from .products import LANES, TASK, padded, product, wide_of
from .random_walk import Walk

_ROUNDS = 30  # alternations of F and G
_INNER = 8  # steps of either in a round
_FIRST = 100  # steps of the first G
_FRUITLESS, _COMBINED = 55, 5  # of the authors' program
_GAIN = 1e-2  # least relative decrease of the error in a round; a tenth of it changes no score by .01
_SETTLED = 1e-6  # greatest change of a converged membership
_BOUNDS = 20  # iterations of the bound of a norm
Power: TypeAlias = "Walk | _Dense"  # a left-stochastic matrix left right^T to factor


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
        with Descent(walk, F, None, resources) as descent:
            descent.move_G(_FIRST)
            fruitless = 0 if descent.error < least else fruitless + 1
            if descent.error < least:
                least, best = descent.error, (F, descent.G)
    return present(best)


def _descended(walk: Power, resources: Resources, F: np.ndarray, G: np.ndarray | None = None) -> Factors:
    """Alternate both, until the error no longer decreases."""
    with Descent(walk, F, G, resources) as descent:
        previous, steps = np.inf, _FIRST
        for _ in range(_ROUNDS):
            descent.move_G(steps)
            if previous - descent.error < _GAIN * previous:
                break
            previous, steps = descent.error, _INNER
            descent.move_F()
        F, G = (factor.astype(np.float64) for factor in (descent.F, descent.G))
        return Factors(F / F.sum(0), G / G.sum(0), descent.error)


class Descent:
    """Both factors and their products with the walk, on the device; only products of labels are read.

    Attributes
    ----------
    error : float
        |D^s - F G|^2 / |D^s|^2 after a step of G.
    """

    def __init__(self, walk: Power, F: np.ndarray, G: np.ndarray | None, resources: Resources):
        self._device, self._norm = resources.device, walk.norm
        (self._n, self._r), self._k = F.shape, walk.left.shape[1]
        n, r, k = self._n, self._r, self._k
        self._run = self._device.program("factorization")
        self._wide = wide_of(resources)
        G = np.full((r, n), 1.0 / r, np.float32) if G is None else G
        start = {"F": padded(F), "G": padded(G.T), "rows": padded(F.T)}
        self._width, self._long, self._tall = start["F"].shape[1], start["rows"].shape[1], k + -k % LANES
        tables = {
            "left": padded(walk.left), "right": padded(walk.right), "across": padded(walk.left.T),
            "inverse": (1.0 / np.maximum(np.arange(max(n, r) + 8), 1)).astype(np.float32),
            "momentum": _momentum(_FIRST),
        }  # fmt: skip
        nodes, labels, thin = 4 * n * self._width, 4 * self._width * self._long, 4 * self._tall * self._width
        layout = {name: array.nbytes for name, array in start.items()}
        layout |= {"ahead_G": 2 * nodes, "linear_G": nodes}
        layout |= {"ahead_F": labels, "linear_F": labels, "trial_F": labels}
        layout |= {"from": thin, "to": thin, "overlap": 4 * self._width**2, "shared": 4 * self._width**2}
        self._buffers = Buffers(self._device, layout, resources.budget, TASK, tables=tables)
        for name, array in start.items():
            self._device.write(self._buffers[name], array)
        self._moved_F()

    def __enter__(self) -> Descent:
        return self

    def __exit__(self, *_: object) -> None:
        self._buffers.__exit__()

    @property
    def F(self) -> np.ndarray:
        """(n, r) float32."""
        return self._read("F", self._n, self._r)

    @property
    def G(self) -> np.ndarray:
        """(r, n) float32."""
        return self._read("G", self._n, self._r).T

    def move_G(self, steps: int) -> None:
        """Move the columns of G towards the best ones for this F, in `steps` of FISTA."""
        n, r, width = self._n, self._r, self._width
        across = -(-width // self._wide)
        self._call("product", (across, n), ("right", "from", "linear_G"), n, self._k, self._tall, width)
        names = ("overlap", "linear_G", "inverse", "momentum", "G", "ahead_G")
        self._call("memberships", (n,), names, n, r, width, steps, 1.0 / _largest(self._overlap), _SETTLED, group=16)
        self._gram("right", "G", "to", n, self._tall, width)
        self._gram("G", "G", "shared", n, width, width)
        self._shared = self._read("shared", r, r).astype(np.float64)
        to_labels = self._read("to", self._k, r)
        both = (self._overlap * self._shared).sum() - 2.0 * (self._from_labels * to_labels).sum()
        self.error = max(self._norm + float(both), 0.0) / self._norm

    def move_F(self) -> None:
        """Move the columns of F by a few steps of FISTA."""
        r, width, long = self._r, self._width, self._long
        self._gram("to", "across", "linear_F", self._k, width, long)  # (D^s G^T)^T
        step, ahead = 1.0 / _largest(self._shared), "rows"
        for momentum in _momentum(_INNER)[1:].tolist():
            names = ("shared", "linear_F", ahead, "trial_F")
            self._call("advance", (-(-long // self._wide), r), names, r, width, long, step)
            names = ("trial_F", "inverse", "rows", "ahead_F")
            self._call("project", (r,), names, r, self._n, long, momentum, group=1)
            ahead = "ahead_F"
        self._call("transposed", (width, self._n), ("rows", "F"), r, long, self._n, width)
        self._moved_F()

    def _moved_F(self) -> None:
        """Products of F."""
        self._gram("left", "F", "from", self._n, self._tall, self._width)
        self._gram("F", "F", "overlap", self._n, self._width, self._width)
        self._overlap = self._read("overlap", self._r, self._r).astype(np.float64)
        self._from_labels = self._read("from", self._k, self._r).astype(np.float64)

    def _gram(self, a: str, b: str, out: str, rows: int, tall: int, width: int) -> None:
        """a^T b, (rows, tall) and (rows, width)."""
        self._call("gram", (-(-width // self._wide), -(-tall // self._wide)), (a, b, out), rows, tall, width)

    def _call(
        self, kernel: str, shape: tuple[int, ...], names: tuple[str, ...], *numbers: float, group: int = 64
    ) -> None:
        self._run(kernel, shape, *(self._buffers[name] for name in names), *numbers, group=group)

    def _read(self, name: str, rows: int, columns: int) -> np.ndarray:
        wide = self._width
        return self._device.read(self._buffers[name], (rows, wide), np.float32)[:, :columns]


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
    matrix = matrix + 1e-30
    vector = np.ones(len(matrix))
    for _ in range(_BOUNDS - 1):
        image = np.add.reduce(matrix * vector, 1)
        vector = image / np.maximum.reduce(image)
    return float((np.add.reduce(matrix * vector, 1) / vector).max())


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
        """As `Walk.step`."""
        return product(self._once, start[:, None], self._resources)[:, 0]

    def column(self, node: int) -> np.ndarray:
        """As `Walk.column`."""
        return self.left[:, node]
