# SPDX-License-Identifier: Apache-2.0
"""Cuts of a new patch against existing pixels: minimum cuts on a grid, including old seams' costs (KSE03 §3).

All arithmetic is in integers, and of all minimum cuts the one with the fewest old pixels is taken. It is unique, so
the result depends neither on the flow that a library finds nor on the library.

Departures from KSE03: the gradients of eq. 2 are differences between the two pixels of an edge. The seam nodes of
figure 5 are folded into the arcs of the pixels: a seam node costs min(old seam, both new seams), a function of
two pixels that arcs can represent without a node.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...engine.deferred import np

if TYPE_CHECKING:
    from ...engine.core.scratch import TileStore

COST_STEPS = 64  # integer steps per unit of KSE03 eq. 2, a ratio of differences to gradients
MOST_COST = 1 << 13  # per edge; sums over a patch of 512 x 512 stay below 2^31
_FLOOR = 8.0  # grid steps added to gradients: else small differences in flat areas would have unbounded costs
NEIGHBORS = ((0, 1), (1, 0))  # (y, x) from a pixel to its neighbor along an edge


def lengths(values: np.ndarray) -> np.ndarray:
    """Euclidean lengths of (..., 3) integers below 2^14, exact but for the last rounding, so equal everywhere."""
    v = values.astype(np.int32)
    return np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2 + v[..., 2] ** 2, dtype=np.float64)


@dataclass(frozen=True)
class SeamPhoto:
    """The exemplar of seams: (height, width, 3) int16 Lab in grid steps, an array or in tiles."""

    lab: np.ndarray | TileStore

    def at(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Colors at pixels, clamped to the border."""
        return self.lab[np.clip(y, 0, self.lab.shape[0] - 1), np.clip(x, 0, self.lab.shape[1] - 1)]

    def costs(self, a: np.ndarray, b: np.ndarray, step: tuple[int, int]) -> np.ndarray:
        """M(s, t, A, B) of KSE03 eq. 2 as integers, for edges from s to t = s + step.

        `a` (2, n) int; `b` (2, n) int; returns (n,) int64.
        """
        offset = np.array(step)[:, None]
        same = (a + offset == b).all(axis=0)
        out = np.zeros(same.shape, np.int64)
        apart = np.flatnonzero(~same)
        if len(apart):
            out[apart] = self._apart(a[:, apart], b[:, apart], offset)
        return out

    def _apart(self, a: np.ndarray, b: np.ndarray, step: np.ndarray) -> np.ndarray:
        return seam_cost(*(self.at(*p).astype(np.int32) for p in (a, a + step, b - step, b)))


def seam_cost(a_s: np.ndarray, a_t: np.ndarray, b_s: np.ndarray, b_t: np.ndarray) -> np.ndarray:
    """KSE03 eq. 2 for colors of A and B at both pixels of edges, (n, 3) int32 each: (n,) int64."""
    difference = lengths(a_s - b_s) + lengths(a_t - b_t)
    gradient = 2.0 * (lengths(a_s - a_t) + lengths(b_s - b_t)) + _FLOOR
    # a seam between equal colors is not free: the shorter one of two equal seams is better
    return np.clip(np.rint(COST_STEPS * difference / gradient).astype(np.int64), 1, MOST_COST)


def edges(shape: tuple[int, int], step: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices (s, t) of all edges of a grid in a direction."""
    index = np.arange(shape[0] * shape[1]).reshape(shape)
    return index[: shape[0] - step[0], : shape[1] - step[1]].ravel(), index[step[0] :, step[1] :].ravel()


def edges_at(pixels: np.ndarray, step: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices (s, t) of the edges of a grid in a direction, from or to some pixels, (h, w) bool."""
    height, width = pixels.shape
    y, x = (at.astype(np.int64) for at in np.nonzero(pixels))
    begin = (y + step[0] < height) & (x + step[1] < width)
    end = (y >= step[0]) & (x >= step[1])
    end[end] = ~pixels[y[end] - step[0], x[end] - step[1]]  # the others begin at one of the pixels
    here, apart = y * width + x, step[0] * width + step[1]
    return np.concatenate([here[begin], here[end] - apart]), np.concatenate([here[begin] + apart, here[end]])


def seam_costs(source: SeamPhoto, places: np.ndarray, filled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Costs of existing seams: to the right (h, w - 1) and below (h - 1, w).

    `places` (2, h, w) int; `filled` (h, w) bool.
    """
    flat, there, shape = places.reshape(2, -1), filled.ravel(), filled.shape
    costs = []
    for step in NEIGHBORS:
        s, t = edges(shape, step)
        cost = np.where(there[s] & there[t], source.costs(flat[:, s], flat[:, t], step), 0)
        costs.append(cost.reshape(shape[0] - step[0], shape[1] - step[1]))
    return costs[0], costs[1]


def cut(source: SeamPhoto, places: np.ndarray, filled: np.ndarray, patch: np.ndarray, covers: np.ndarray) -> np.ndarray:
    """A mask of the pixels of a window that a new patch replaces.

    Unfilled pixels take the patch where it covers them. Pixels outside the patch are kept.

    `places` (2, h, w) int; `filled` (h, w) bool; `patch` (2, h, w) int; `covers` (h, w) bool; returns (h, w) bool.
    """
    shape = filled.shape
    there, covered = filled.ravel(), covers.ravel()
    new = covered & ~there
    free = covered & there
    number = np.cumsum(free) - 1
    count = int(free.sum())
    if count == 0:
        return new.reshape(shape)
    old_at, new_at = places.reshape(2, -1), patch.reshape(2, -1)
    leans: list[tuple[np.ndarray, np.ndarray]] = []  # indices of pixels; cost of being new minus cost of being old
    arcs: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for step in NEIGHBORS:
        s, t = edges(shape, step)
        kept = (free[s] & (there[t] | covered[t])) | (free[t] & (there[s] | covered[s]))
        s, t = s[kept], t[kept]
        # costs of an edge if both pixels are old, if t is new, if s is new; both new costs nothing
        both_old = np.where(there[s] & there[t], source.costs(old_at[:, s], old_at[:, t], step), 0)
        t_new = np.where(there[s] & covered[t], source.costs(old_at[:, s], new_at[:, t], step), 0)
        s_new = np.where(covered[s] & there[t], source.costs(new_at[:, s], old_at[:, t], step), 0)
        for fixed, other, old, change in ((t, s, t_new, s_new), (s, t, s_new, t_new)):
            alone = free[other] & new[fixed]
            leans.append((other[alone], -old[alone]))
            alone = free[other] & ~covered[fixed]
            leans.append((other[alone], change[alone] - both_old[alone]))
        pair = free[s] & free[t]
        s, t, t_new, s_new = s[pair], t[pair], t_new[pair], s_new[pair]
        old = np.minimum(both_old[pair], t_new + s_new)  # cost of a seam node
        # the cost of keeping both pixels is split so that arcs in both directions are as equal as possible: most pixels
        # then have no terminal arc, and a flow has little to cancel
        of_t = np.clip(-(old // 2), -s_new, t_new - old)
        leans += (s, -old - of_t), (t, of_t)
        arcs += (number[s], number[t], t_new - old - of_t), (number[t], number[s], s_new + of_t)
    pixels, values = (np.concatenate(part) for part in zip(*leans, strict=True))
    lean = np.bincount(pixels, values, len(free)).astype(np.int64)  # integers, exact in doubles
    taken = minimum_cut(count, arcs, lean[free])
    out = new.copy()
    out[free] = taken
    return out.reshape(shape)


@dataclass(frozen=True)
class GridEdges:
    """What it costs if two neighboring pixels of a grid differ.

    Attributes
    ----------
    s, t : (n,) int
        Flat indices of the pixels.
    begins, ends : (n,) int64
        Cost if only `t`, or only `s`, is chosen.
    """

    s: np.ndarray
    t: np.ndarray
    begins: np.ndarray
    ends: np.ndarray


def chosen(free: np.ndarray, fixed: np.ndarray, lean: np.ndarray, costs: list[GridEdges]) -> np.ndarray:
    """Which pixels of a grid are chosen at the least cost; of equal choices, the largest.

    Parameters
    ----------
    free : (h, w) bool
        The pixels that are decided.
    fixed : (h, w) bool
        Whether the others are chosen.
    lean : (h * w,) int64
        Cost of choosing a pixel; it is overwritten.
    costs : list of GridEdges

    Returns
    -------
    (h, w) bool
    """
    flat, others = free.ravel(), fixed.ravel()
    number = np.cumsum(flat) - 1
    arcs = []
    for one in costs:
        s, t, begins, ends = one.s, one.t, one.begins, one.ends
        for free_one, other, if_chosen, if_not in ((t, s, begins, ends), (s, t, ends, begins)):
            alone = flat[free_one] & ~flat[other]
            # next to a chosen pixel, it costs not to be chosen, and the other way round
            np.add.at(lean, free_one[alone], np.where(others[other], -if_not, if_chosen)[alone])
        pair = flat[s] & flat[t]
        arcs += [
            (number[s[pair]], number[t[pair]], begins[pair]), (number[t[pair]], number[s[pair]], ends[pair])
        ]  # fmt: skip
    out = others.copy()
    if flat.any():
        out[flat] = minimum_cut(int(flat.sum()), arcs, lean[flat])
    return out.reshape(free.shape)


def minimum_cut(count: int, arcs: list[tuple[np.ndarray, np.ndarray, np.ndarray]], lean: np.ndarray) -> np.ndarray:
    """x in {0, 1}^count that minimizes sum lean_i x_i + sum capacity_st (1 - x_s) x_t, the one with the most ones.

    `lean` (count,) int64; returns (count,) bool.
    """
    from scipy.sparse import csr_array  # slow to import
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    node = np.arange(count)
    top, bottom = count, count + 1
    dear, cheap = lean > 0, lean < 0
    start = [*(a[0] for a in arcs), np.full(int(dear.sum()), top), node[cheap]]
    end = [*(a[1] for a in arcs), node[dear], np.full(int(cheap.sum()), bottom)]
    capacity = np.concatenate([*(a[2] for a in arcs), lean[dear], -lean[cheap]])
    graph = csr_array(
        (capacity.astype(np.int32), (np.concatenate(start), np.concatenate(end))), shape=(count + 2, count + 2)
    )
    graph.eliminate_zeros()
    if graph.nnz == 0:
        return np.ones(count, bool)
    flow = maximum_flow(graph, top, bottom).flow
    residual = graph - flow
    residual.eliminate_zeros()
    reached = breadth_first_order(residual, top, return_predecessors=False)
    ones = np.ones(count + 2, bool)
    ones[reached] = False
    return ones[:count]
