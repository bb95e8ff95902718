# SPDX-License-Identifier: Apache-2.0
"""Labels from a random walk: D^s ~ F G with F and G left-stochastic, the number of labels found (LSA16 section 4.2).

F, (n, r): column c says where the walk goes from label c; G, (r, n): column j says how likely node j belongs to each
label. How the paper solves eq. 8 is in its supplement, which is not public; what is built here:

- start: heat spreads from an uncovered node of the largest mass; all nodes that it still flows into from outside
  are the same source, and covered (probe cover). Without restarts it is deterministic.
- descent: F and G in turn, each a least-squares problem on the simplex (FISTA with restarts, Newton for the threshold
  of the projection).
- boosting (`tries` > 0): the starts of several runs, probed in random order, are stacked, and the walk between their
  labels is factored in turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

_ROUNDS = 30  # of F and G in turn
_INNER = 8  # steps of either within a round
_FIRST = 100  # steps of the first G
_SORTED = 64  # longest row that is sorted
_GAIN = 1e-2  # of the error, relative: less ends the descent; a tenth of it moves no score by .01


class Power(Protocol):
    """What is factored: a left-stochastic matrix, seen through its products (`affinity_graph.Walk` is one)."""

    n: int
    norm: float
    mass: np.ndarray

    def step(self, start: np.ndarray) -> np.ndarray:
        """One step of the walk."""

    def walk(self, start: np.ndarray) -> np.ndarray:
        """The matrix times `start`."""

    def back(self, end: np.ndarray) -> np.ndarray:
        """Its transpose times `end`."""

    def column(self, node: int) -> np.ndarray:
        """One column."""


@dataclass(frozen=True)
class Factors:
    """Attributes.

    F : (n, r)
        Where the walk goes from a label; columns add up to 1.
    G : (r, n)
        Which label a node belongs to; columns add up to 1.
    error : float
        |D^s - F G|^2 / |D^s|^2.
    """

    F: np.ndarray
    G: np.ndarray
    error: float


def factored(walk: Power, seed: int = 0, tries: int = 0) -> Factors:
    """The stochastic factorization of LSA16 eq. 8.

    Parameters
    ----------
    walk : Power
    seed : int
        Of the random starts.
    tries : int
        0: one deterministic start; else so many random ones, joined by boosting.
    """
    factors = _descended(walk, probe_cover(walk))
    if tries == 0:
        return factors
    random = np.random.default_rng(seed)
    runs = [factors] + [_descended(walk, probe_cover(walk, random)) for _ in range(tries)]
    stacked_F = np.concatenate([run.F for run in runs], axis=1)
    stacked_G = np.concatenate([run.G for run in runs]) / len(runs)
    between = _Dense(stacked_G @ stacked_F)
    joined = min((_descended(between, probe_cover(between, random)) for _ in range(5)), key=lambda f: f.error)
    return _descended(walk, stacked_F @ joined.F, joined.G @ stacked_G)


def probe_cover(walk: Power, random: np.random.Generator | None = None) -> np.ndarray:
    """Distributions from one probe after another, until every node is covered by one: the start of F, (n, r).

    With p = D^s e_j and q = D p, nodes with q < p still give heat away to the rest: they share j's source.
    """
    unused = np.ones(walk.n, bool)
    columns = []
    while unused.any():
        left = np.flatnonzero(unused)
        node = int(left[np.argmax(walk.mass[left])] if random is None else random.choice(left))
        heat = walk.column(node)
        columns.append(heat)
        unused &= walk.step(heat) >= heat
        unused[node] = False
        last = np.flatnonzero(unused)
        if len(last) == 1 and max(column[last[0]] for column in columns) > 0:  # no label for what others reach
            break
    return np.stack(columns, axis=1)


def _descended(walk: Power, F: np.ndarray, G: np.ndarray | None = None) -> Factors:
    """Both in turn, until the error falls no more."""
    r = F.shape[1]
    Ft = np.ascontiguousarray(F.T)  # rows on the simplex
    start = np.full((walk.n, r), 1.0 / r) if G is None else np.ascontiguousarray(G.T)
    Gt = _least_squares(start, Ft @ F, walk.back(F), _FIRST)
    previous = np.inf
    for _ in range(_ROUNDS):
        forward = walk.walk(Gt)  # D^s G^T
        error = _error(walk, Ft, Gt, forward)
        if previous - error < _GAIN * previous:
            break
        previous = error
        Ft = _least_squares(Ft, Gt.T @ Gt, forward.T, _INNER, across=True)
        Gt = _least_squares(Gt, Ft @ Ft.T, walk.back(Ft.T), _INNER)
    return Factors(Ft.T, Gt.T, _error(walk, Ft, Gt, walk.walk(Gt)))


def _error(walk: Power, Ft: np.ndarray, Gt: np.ndarray, forward: np.ndarray) -> float:
    """|D^s - F G|^2 / |D^s|^2 from products of thin matrices."""
    squared = walk.norm + float(((Ft @ Ft.T) * (Gt.T @ Gt)).sum() - 2.0 * (Ft.T * forward).sum())
    return max(squared, 0.0) / walk.norm


def _least_squares(
    start: np.ndarray, quadratic: np.ndarray, linear: np.ndarray, steps: int, across: bool = False
) -> np.ndarray:
    """Rows on the simplex that minimise tr(X Q X^T) / 2 - tr(X C^T); `across`: tr(X^T Q X) / 2 - tr(X^T C).

    FISTA (Beck and Teboulle 2009) with the adaptive restart of O'Donoghue and Candes (2015).
    """
    step = 1.0 / (np.linalg.norm(quadratic, 2) + 1e-300)
    at = ahead = start
    momentum = 1.0
    for _ in range(steps):
        slope = (quadratic @ ahead if across else ahead @ quadratic) - linear
        new = on_simplex(ahead - step * slope)
        moved = new - at
        if np.vdot(ahead - new, moved) > 0:
            momentum, ahead = 1.0, new
        else:
            following = (1.0 + np.sqrt(1.0 + 4.0 * momentum**2)) / 2.0
            ahead = new + (momentum - 1.0) / following * moved
            momentum = following
        at = new
        if np.abs(moved).max() < 1e-9:
            break
    return at


def on_simplex(rows: np.ndarray) -> np.ndarray:
    """The nearest non-negative rows that add up to 1, (m, n).

    What is taken off every value is found in a short row by sorting (Held, Wolfe, Crowder 1974), in a long one by
    Newton's iteration (Michelot 1986).
    """
    if rows.shape[1] <= _SORTED:
        falling = -np.sort(-rows, axis=1)
        thresholds = (np.cumsum(falling, axis=1) - 1.0) / np.arange(1, rows.shape[1] + 1)
        last = (falling > thresholds).sum(1) - 1
        threshold = thresholds[np.arange(len(rows)), last]
    else:
        threshold = (rows.sum(1) - 1.0) / rows.shape[1]
        for _ in range(100):
            above = rows > threshold[:, None]
            new = (np.where(above, rows, 0.0).sum(1) - 1.0) / above.sum(1)
            settled = new - threshold <= 1e-12 * np.maximum(1.0, np.abs(new))
            threshold = new
            if settled.all():
                break
    out = np.maximum(rows - threshold[:, None], 0.0)
    return out / out.sum(1, keepdims=True)


class _Dense:
    """The second power of a small left-stochastic matrix."""

    def __init__(self, matrix: np.ndarray):
        self._once = np.maximum(matrix, 0.0) / np.maximum(matrix, 0.0).sum(0)
        self._twice = self._once @ self._once
        self.n = len(matrix)
        self.norm = float((self._twice**2).sum())
        self.mass = np.linalg.matrix_power(self._once, 256).mean(1)

    def step(self, start: np.ndarray) -> np.ndarray:
        return self._once @ start

    def walk(self, start: np.ndarray) -> np.ndarray:
        return self._twice @ start

    def back(self, end: np.ndarray) -> np.ndarray:
        return self._twice.T @ end

    def column(self, node: int) -> np.ndarray:
        return self._twice[:, node]
