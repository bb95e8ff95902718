# SPDX-License-Identifier: Apache-2.0
"""Clique partitioning solved exactly: the oracle of segmentation/clique_partition.py, and CZF02's instances."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linear_sum_assignment, milp
from scipy.sparse import csr_array, issparse

from oiiotex.analysis.segmentation.clique_partition import Weights


def score(weights: Weights, labels: np.ndarray) -> float:
    """What is maximized, CZF02 eq. 5: the sum of the weights of all pairs within a clique."""
    if issparse(weights):
        held = weights.tocoo()
        inside = (labels[held.row] == labels[held.col]) & (held.row != held.col)
        return float(held.data[inside].sum(dtype=np.float64) / 2)
    total = sum(
        float(np.asarray(weights)[np.ix_(inside, inside)].sum(dtype=np.float64))
        for inside in (np.flatnonzero(labels == c) for c in np.unique(labels))
    )
    return (total - float(np.trace(weights))) / 2


def best_partition(weights: np.ndarray) -> np.ndarray:
    """CZF02 eq. 5 with triangle inequalities added where the solution so far violates them; up to about 30 vertices."""
    n = len(weights)
    a, b = np.triu_indices(n, 1)
    edge = np.zeros((n, n), int)
    edge[a, b] = edge[b, a] = np.arange(len(a))
    i, j, k = np.array(list(itertools.combinations(range(n), 3))).reshape(-1, 3).T
    sides = edge[i, j], edge[j, k], edge[i, k]
    every = np.concatenate([np.stack([sides[(t + s) % 3] for s in range(3)], 1) for t in range(3)])
    held = np.zeros((0, 3), int)
    whole = 0
    while True:
        rows = np.repeat(np.arange(len(held)), 3)
        matrix = csr_array((np.tile([1.0, 1.0, -1.0], len(held)), (rows, held.ravel())), shape=(len(held), len(a)))
        constraints = [LinearConstraint(matrix, -np.inf, 1)] if len(held) else []
        found = milp(-weights[a, b], constraints=constraints, integrality=np.full(len(a), whole), bounds=Bounds(0, 1))
        assert found.success, found.message
        violated = every[found.x[every] @ [1.0, 1.0, -1.0] > 1 + 1e-6]
        if len(violated):
            held = np.unique(np.concatenate([held, violated]), axis=0)
        elif np.abs(found.x - np.rint(found.x)).max(initial=0) > 1e-6:
            whole = 1
        else:
            break
    together = np.eye(n, dtype=bool)
    together[a, b] = together[b, a] = found.x > 0.5
    return np.unique(together.argmax(0), return_inverse=True)[1]


def merged_by_definition(weights: np.ndarray) -> np.ndarray:
    """CZF02 section III B, word for word: sets of vertices, costs added up anew in every iteration."""
    cliques = [frozenset([v]) for v in range(len(weights))]
    while True:
        cost = [[-np.inf if p is q else sum(weights[u, v] for u in p for v in q) for q in cliques] for p in cliques]
        choice = [int(np.argmax(row)) for row in cost]
        pairs = [(p, q) for p, q in enumerate(choice) if p < q and choice[q] == p and cost[p][q] > 0]
        if len(cliques) < 2 or not pairs:
            break
        for p, q in pairs:
            cliques[p] |= cliques[q]
        cliques = [c for n, c in enumerate(cliques) if n not in {q for _, q in pairs}]
    labels = np.empty(len(weights), int)
    for n, clique in enumerate(sorted(cliques, key=min)):
        labels[list(clique)] = n
    return labels


def instance(vertices: int, cliques: int, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights and truth as in CZF02 section III C: uniform in [-a, 9] inside cliques, in [-9, a] between them.

    The paper states noise levels and a = 3 .. 5.5; noise = a / (a + 9) meets every pair of them.
    """
    random = np.random.default_rng([seed, vertices, cliques, round(1000 * noise)])
    a = 9 * noise / (1 - noise)
    truth = random.permutation(np.repeat(np.arange(cliques), vertices // cliques))
    drawn = np.triu(random.random((vertices, vertices)) * (9 + a), 1)
    drawn += drawn.T
    weights = np.where(truth[:, None] == truth, drawn - a, drawn - 9)
    np.fill_diagonal(weights, 0)
    return weights, truth


def misplaced(found: np.ndarray, truth: np.ndarray) -> int:
    """How few vertices must change their clique to make the one the other (CZF02 section III C)."""
    table = np.zeros((found.max() + 1, truth.max() + 1), int)
    np.add.at(table, (found, truth), 1)
    return len(found) - int(table[linear_sum_assignment(-table)].sum())
