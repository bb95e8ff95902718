# SPDX-License-Identifier: Apache-2.0
"""Clique partitioning: grouping of vertices with the largest sum of weights inside the groups.

CZF02 section III: Caenen, Zalesny, Ferrari, Van Gool, Unsupervised Texture Segmentation by clique partitioning.
Positive weights attract two vertices, negative weights repel them, and the number of groups follows from the weights.
The exact problem is NP-hard; this is the paper's heuristic, with a refinement by single moves.

Departures from the paper: ties, which it does not mention, go to the lower vertex, so that some pair of cliques is
always mutually best; and after the heuristic, single vertices move as long as that increases the score.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from scipy.sparse import csr_array, issparse

Weights: TypeAlias = Any  # a numpy array or a scipy sparse array

SWEEPS = 50  # maximum of the refinement; it also ends by itself, since each sweep increases the score
_WIDE = 8192  # vertices above which the copy of a dense matrix is float32
_ROWS = 256  # rows of a dense matrix per block
_COLUMNS = 1024  # columns of it that are summed at once
_NEAR = 16  # candidates kept for each clique in case the best ones are removed
_LEAST = 1e-9  # of the largest weight: a smaller gain is a rounding error


def partition(weights: Weights, refine: bool = True) -> np.ndarray:
    """Vertices grouped into cliques of large total weight.

    Parameters
    ----------
    weights : (n, n) array or scipy sparse array
        Symmetric; positive if two vertices should be in one clique, negative if not. Missing entries of a sparse array
        are 0. The diagonal is ignored. Needs memory for a copy of a dense array, or twice the size of a sparse one.
    refine : bool
        Move single vertices and merge cliques until the score no longer increases. False: only the paper's heuristic.

    Returns
    -------
    (n,) int64
        The clique of each vertex, numbered from 0 by first vertices.

    Raises
    ------
    ValueError
        The weights are not square, not symmetric, or not finite.

    References
    ----------
    CZF02 section III B.
    """
    weights = _checked(weights)
    labels = numbered(_merged(weights))
    if refine:
        for _ in range(SWEEPS):
            moved = _moved(weights, labels)
            labels = numbered(labels)
            joined = _merged(contracted(weights, labels))
            labels = numbered(joined[labels])
            if not moved and joined.max(initial=-1) + 1 == len(joined):
                break
    return labels


def joined_to(weights: Weights, labels: np.ndarray, count: int) -> np.ndarray:
    """Merge cliques, the pair with the largest mean weight first, until at most `count` are left.

    Not in the paper, which finds the number. Weights and labels are those of `partition`.
    """
    while (left := int(labels.max(initial=-1)) + 1) > count:
        between = contracted(weights, labels)
        between = between.toarray() if issparse(between) else between
        sizes = np.bincount(labels).astype(np.float64)
        mean = between / np.outer(sizes, sizes)
        np.fill_diagonal(mean, -np.inf)
        a, b = divmod(int(mean.argmax()), left)
        labels = numbered(np.where(labels == b, a, labels))
    return labels


def contracted(weights: Weights, labels: np.ndarray) -> Weights:
    """Weights between cliques: sums over pairs of their vertices; the diagonal is 0."""
    count = int(labels.max(initial=-1)) + 1
    if issparse(weights):
        entries = weights.tocoo()
        a, b = labels[entries.row], labels[entries.col]
        apart = a != b
        between = csr_array((entries.data[apart], (a[apart], b[apart])), shape=(count, count))
        between.sum_duplicates()
        return between
    if count == 0:
        return np.zeros((0, 0))
    between = _summed(_summed(weights, labels, count).T, labels, count)
    np.fill_diagonal(between, 0)
    return between


def _summed(matrix: np.ndarray, labels: np.ndarray, count: int) -> np.ndarray:
    """Sums of the rows of each clique in their order, (count, columns) float64; by blocks of columns."""
    member = csr_array((np.ones(len(labels)), (labels, np.arange(len(labels)))), shape=(count, len(labels)))
    sums = np.empty((count, matrix.shape[1]))
    for first in range(0, matrix.shape[1], _COLUMNS):
        columns = slice(first, first + _COLUMNS)
        sums[:, columns] = member @ np.ascontiguousarray(matrix[:, columns], np.float64)
    return sums


def _checked(weights: Weights) -> Weights:
    if weights.ndim != 2 or weights.shape[0] != weights.shape[1]:
        raise ValueError(f"weights have shape {weights.shape}: expected a square matrix")
    if issparse(weights):
        matrix = csr_array(weights, dtype=np.float64)
        matrix.sum_duplicates()
        if not np.isfinite(matrix.data).all() or abs(matrix - matrix.T).max() > 1e-6 * max(1.0, abs(matrix).max()):
            raise ValueError("weights must be finite and symmetric")
        return matrix
    matrix = np.asarray(weights)
    matrix = matrix if matrix.dtype in (np.float32, np.float64) else matrix.astype(np.float64)
    blocks = [slice(first, first + 512) for first in range(0, len(matrix), 512)]  # fit the cache, without a second copy
    for n, rows in enumerate(blocks):
        for columns in blocks[n:]:
            here, there = matrix[rows, columns], matrix[columns, rows].T
            if not (np.abs(here - there) <= 1e-6 * (1 + np.abs(there))).all():  # false also for NaN and Inf
                raise ValueError("weights must be finite and symmetric")
    return matrix


def numbered(labels: np.ndarray) -> np.ndarray:
    """The same groups, numbered by first vertices."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


# --- the heuristic ---


def _merged(weights: Weights) -> np.ndarray:
    """CZF02 section III B: merge all pairs of cliques that (1, 2) are each other's best choice and (3) gain by it."""
    return _merged_sparse(weights) if issparse(weights) else _merged_dense(weights)


def _merged_dense(weights: np.ndarray) -> np.ndarray:
    count = len(weights)
    clique = np.arange(count)  # for each vertex, its row of `cost`
    if count < 2:
        return clique
    state = _Cost(weights)
    while True:
        a = np.flatnonzero(state.alive & (state.best > 0) & (state.choice[state.choice] == np.arange(len(state.cost))))
        a = a[a < state.choice[a]]
        b = state.choice[a]
        if not len(a):
            return clique
        into = np.arange(len(state.cost))
        into[b] = a
        clique = into[clique]
        state.alive[b] = False
        if state.cost is weights or 16 * len(a) > len(into) or 4 * np.count_nonzero(state.alive) < 3 * len(into):
            clique = (np.cumsum(state.alive) - 1)[clique]
            state = _Cost(state.joined(a, b))
        else:
            state.join(a, b)


class _Cost:
    """c(a, b) of the paper for all pairs of cliques, and the best choice of each clique.

    Updates write only rows: columns are scattered over memory, so they become stale, and readers of other rows take the
    current value from the changed row. In addition to the best choice the next ones are kept: all with a cost above
    `floor` are in `near`, so a row is searched again only when all of these have been removed.
    """

    def __init__(self, cost: np.ndarray):
        count = len(cost)
        self.cost, self.alive = cost, np.ones(count, bool)
        self.stale = np.zeros(0, np.int64)
        self.choice, self.best = np.empty(count, np.int64), np.empty(count)
        self.near = np.zeros((count, min(_NEAR, count)), np.int64)
        self.near_cost, self.floor = np.full(self.near.shape, -np.inf), np.empty(count)
        for first in range(0, count, _ROWS):  # only the best, which is much faster: many rows are not searched again
            which = np.arange(first, min(first + _ROWS, count))
            rows = self._choose(which)
            rows[np.arange(len(which)), self.choice[which]] = -np.inf
            self._keep(which, self.choice[which, None], self.best[which, None], rows.max(1))

    def rows(self, which: np.ndarray) -> np.ndarray:
        """Rows with current values, without the diagonal and removed cliques."""
        rows = self.cost[which]
        rows[:, self.stale] = self.cost[np.ix_(self.stale, which)].T
        rows[:, ~self.alive] = -np.inf
        rows[np.arange(len(which)), which] = -np.inf
        return rows

    def _choose(self, which: np.ndarray) -> np.ndarray:
        """Find the best choice of some cliques; returns their rows."""
        rows = self.rows(which)
        self.choice[which] = rows.argmax(1)
        self.best[which] = rows[np.arange(len(which)), self.choice[which]]
        return rows

    def _choose_several(self, which: np.ndarray) -> None:
        """Find the best choices of some cliques."""
        rows, size = self._choose(which), self.near.shape[1]
        near = np.argpartition(rows, -size, 1)[:, -size:]
        cost = np.take_along_axis(rows, near, 1)
        self._keep(which, near, cost, cost.min(1))

    def _keep(self, which: np.ndarray, near: np.ndarray, cost: np.ndarray, floor: np.ndarray) -> None:
        """Keep choices (rows, choices) with a cost above all others, which is at most `floor` in each row."""
        self.floor[which] = floor
        self.near[which, : near.shape[1]] = near
        self.near_cost[which] = -np.inf
        self.near_cost[which, : near.shape[1]] = np.where(cost > floor[:, None], cost, -np.inf)

    def _sums(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Incremental update of rows: c(a + b, k) = c(a, k) + c(b, k)."""
        self.alive[b] = True
        rows = self.rows(np.concatenate([a, b]))
        self.alive[b] = False
        sums = rows[: len(a)] + rows[len(a) :]
        sums[:, a] += sums[:, b]
        sums[:, b] = -np.inf
        return sums

    def join(self, a: np.ndarray, b: np.ndarray) -> None:
        """Merge b into a; only rows whose choices get worse are searched again."""
        rows = self._sums(a, b)
        self.stale = np.union1d(self.stale[self.alive[self.stale]], a)
        self.cost[a] = rows
        self.cost[np.ix_(self.stale, a)] = rows[:, self.stale].T
        changed = np.zeros(len(self.cost), bool)
        changed[a] = changed[b] = True
        self.near_cost[changed[self.near]] = -np.inf
        offered = np.flatnonzero(self.alive & ~changed & (rows.max(0) > self.floor))
        self._offer(offered, a, rows[:, offered].T)
        self.best = self.near_cost.max(1)
        highest = self.near_cost == self.best[:, None]
        self.choice = np.where(highest, self.near, len(self.cost)).min(1)  # ties to the lowest
        lost = self.alive & np.isneginf(self.best)
        lost[a] = True
        self._choose_several(np.flatnonzero(lost))

    def _offer(self, which: np.ndarray, a: np.ndarray, cost: np.ndarray) -> None:
        """Add `a` to the choices of some cliques where its cost exceeds that of all choices that are not kept."""
        cost = np.where(cost > self.floor[which, None], cost, -np.inf)
        cost = np.concatenate([self.near_cost[which], cost], 1)
        near = np.concatenate([self.near[which], np.broadcast_to(a, (len(which), len(a)))], 1)
        size = self.near.shape[1]
        order = np.argpartition(cost, -size, 1)
        gone = np.take_along_axis(cost, order[:, :-size], 1).max(1, initial=-np.inf)
        near, cost = (np.take_along_axis(of, order[:, -size:], 1) for of in (near, cost))
        self._keep(which, near, cost, np.maximum(self.floor[which], gone))

    def joined(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """New matrix of the remaining cliques after merging b into a, by blocks of rows."""
        kept = np.flatnonzero(self.alive)
        matrix = np.empty((len(kept), len(kept)), np.float32 if len(self.cost) > _WIDE else np.float64)
        place, partner = np.searchsorted(kept, a), np.full(len(self.cost), -1)
        partner[a] = b
        wanted = np.concatenate([kept, b])  # columns
        known = np.full(len(self.cost), -1)
        known[wanted] = np.arange(len(wanted))
        stale = self.stale[known[self.stale] >= 0]

        def columns(which: np.ndarray) -> np.ndarray:
            rows = np.take(self.cost[which], wanted, 1)
            rows[:, known[stale]] = self.cost[np.ix_(stale, which)].T
            return rows.astype(matrix.dtype, copy=False)

        for first in range(0, len(kept), _ROWS):
            here = kept[first : first + _ROWS]
            rows = columns(here)
            paired = np.flatnonzero(partner[here] >= 0)
            if len(paired):
                rows[paired] += columns(partner[here[paired]])
            block = matrix[first : first + _ROWS]
            block[:] = rows[:, : len(kept)]
            block[:, place] += rows[:, len(kept) :]
        np.fill_diagonal(matrix, -np.inf)
        return matrix


def _merged_sparse(weights: csr_array) -> np.ndarray:
    clique = np.arange(weights.shape[0])
    cost = contracted(weights, clique)
    while True:
        best, choice = _best_sparse(cost)
        a = np.flatnonzero((best > 0) & (choice[choice] == np.arange(len(choice))))
        a = a[a < choice[a]]
        if not len(a):
            return clique
        alive = np.ones(len(choice), bool)
        alive[choice[a]] = False
        into = np.cumsum(alive) - 1
        into[choice[a]] = into[a]
        clique = into[clique]
        cost = contracted(cost, into)


def _best_sparse(cost: csr_array) -> tuple[np.ndarray, np.ndarray]:
    """Largest entry of each row, and the first column that has it; 0 and the row itself for an empty row."""
    count = cost.shape[0]
    best, choice = np.zeros(count), np.arange(count)
    filled = np.flatnonzero(np.diff(cost.indptr))
    if len(filled):
        starts = cost.indptr[filled]
        best[filled] = np.maximum.reduceat(cost.data, starts)
        highest = cost.data == np.repeat(best, np.diff(cost.indptr))
        choice[filled] = np.minimum.reduceat(np.where(highest, cost.indices, count), starts)
    return best, choice


# --- the refinement ---


def _moved(weights: Weights, labels: np.ndarray) -> int:
    """One sweep: single vertices move to the clique with the largest gain, or to a new one; modifies `labels`.

    Candidates are found for all vertices at once, and checked again before each move, so the score only increases.
    """
    count = len(labels)
    if count == 0:
        return 0
    cliques = free = int(labels.max()) + 1
    least = _LEAST * max(1.0, float(weights.max()), -float(weights.min()))
    if issparse(weights):
        member = csr_array((np.ones(count), (np.arange(count), labels)), shape=(count, cliques))
        pull = (weights @ member).tocsr()
        pull.sum_duplicates()
        most = np.maximum(_best_sparse(pull)[0], 0.0)
        own = pull.multiply(member).sum(1) - weights.diagonal()
    else:
        pull = _summed(weights, labels, cliques).T
        own = pull[np.arange(count), labels] - weights.diagonal()
        pull[np.arange(count), labels] = own
        most = np.maximum(pull.max(1), 0.0)
    moved = 0
    for v in np.flatnonzero(most > own + least).tolist():
        near, strength = _row(weights, v)
        gain = np.bincount(labels[near], strength, free + 1)  # last: a new clique
        to = int(gain.argmax())
        if gain[to] > gain[labels[v]] + least:
            labels[v] = to
            free += to == free
            moved += 1
    return moved


def _row(weights: Weights, v: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices with weights to v, and these weights, without v itself."""
    if issparse(weights):
        entries = slice(weights.indptr[v], weights.indptr[v + 1])
        near, strength = weights.indices[entries], weights.data[entries]
        return near[near != v], strength[near != v]
    strength = weights[v].astype(np.float64)
    strength[v] = 0
    return np.arange(len(strength)), strength
