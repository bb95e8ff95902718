# SPDX-License-Identifier: Apache-2.0
"""Cuts of a new patch against existing pixels: minimum cuts on a grid, including old seams' costs (KSE03 §3).

All arithmetic is in integers, and of all minimum cuts the one with the fewest old pixels is taken. It is unique, so
the result depends neither on the flow that a library finds nor on the library.

Departures from KSE03: the gradients of eq. 2 are differences between the two pixels of an edge. The seam nodes of
figure 5 are folded into the arcs of the pixels: a seam node costs min(old seam, both new seams), a function of
two pixels that arcs can represent without a node.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from ...engine.deferred import np

if TYPE_CHECKING:
    from ...engine.core.scratch import TileStore

COST_STEPS = 64  # integer steps per unit of KSE03 eq. 2, a ratio of differences to gradients
MOST_COST = 1 << 13  # per edge; sums over a patch of 512 x 512 stay below 2^31
_FLOOR = 8.0  # grid steps added to gradients: else small differences in flat areas would have unbounded costs
NEIGHBORS = ((0, 1), (1, 0))  # (y, x) from a pixel to its neighbor along an edge
LARGE = 1024  # pixels, from which on a cut may be made from coarse to fine
FEW = 256  # pixels, at most, of a cut by which placements are compared
BAND = 4  # px to each side of a coarse border, in which it is cut


def lengths(values: np.ndarray) -> np.ndarray:
    """Euclidean lengths of (..., 3) integers below 2^14, exact but for the last rounding, so equal everywhere."""
    v = values.astype(np.int32, copy=False)
    return np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2 + v[..., 2] ** 2, dtype=np.float64)


@dataclass(frozen=True)
class SeamPhoto:
    """The exemplar of seams: (height, width, 3) int16 Lab in grid steps, an array or in tiles."""

    lab: np.ndarray | TileStore

    def at(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Colors at pixels, clamped to the border."""
        y, x = (np.minimum(np.maximum(at, 0), n - 1) for at, n in zip((y, x), self.lab.shape, strict=False))
        if isinstance(self.lab, np.ndarray) and self.lab.flags.c_contiguous:  # faster than two indices
            return self.lab.reshape(-1, 3).take(y * self.lab.shape[1] + x, 0)
        return self.lab[y, x]

    def costs(self, a: np.ndarray, b: np.ndarray, step: tuple[int, int]) -> np.ndarray:
        """M(s, t, A, B) of KSE03 eq. 2 as integers, for edges from s to t = s + step.

        `a`, `b` (2, ...) int; returns (...) int64.
        """
        offset = np.reshape(step, (2,) + (1,) * (a.ndim - 1))
        apart = (a + offset != b).any(axis=0)
        if 2 * np.count_nonzero(apart) > apart.size:
            return np.where(apart, self._apart(a, b, offset), 0)
        out = np.zeros(apart.shape, np.int64)
        out[apart] = self._apart(a[:, apart], b[:, apart], offset.reshape(2, 1))
        return out

    def _apart(self, a: np.ndarray, b: np.ndarray, step: np.ndarray) -> np.ndarray:
        return seam_cost(*(self.at(*p).astype(np.int32) for p in (a, a + step, b - step, b)))


def seam_cost(
    a_s: np.ndarray, a_t: np.ndarray, b_s: np.ndarray, b_t: np.ndarray, *, gradients: float = 0.0, floor: float = _FLOOR
) -> np.ndarray:
    """KSE03 eq. 2 for colors of A and B at both pixels of edges, (n, 3) int32 each: (n,) int64.

    `gradients`: weight of the difference of gradients, which is added to those of colors (Agarwala et al. 2004,
    "colors & gradients"); `floor`: grid steps that are added to gradients.
    """
    difference = lengths(a_s - b_s) + lengths(a_t - b_t)
    if gradients:
        difference += gradients * lengths((a_s - a_t) - (b_s - b_t))
    gradient = 2.0 * (lengths(a_s - a_t) + lengths(b_s - b_t)) + floor
    return _ratio(difference, gradient)


def _ratio(difference: np.ndarray, gradient: np.ndarray) -> np.ndarray:
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


def ends_of(step: tuple[int, int]) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Both ends (s, t) of all edges of a grid in a direction, as slices of the grid."""
    y, x = step
    return (slice(-y or None), slice(-x or None)), (slice(y, None), slice(x, None))


def seam_costs(
    source: SeamPhoto,
    places: np.ndarray,
    filled: np.ndarray,
    others: np.ndarray | None = None,
    present: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Costs of existing seams: to the right (h, w - 1) and below (h - 1, w).

    `places` (2, h, w) int; `filled` (h, w) bool. `others`, `present`: as these, for the second pixel of an edge.
    """
    others, present = places if others is None else others, filled if present is None else present
    costs = []
    for step in NEIGHBORS:
        s, t = ends_of(step)
        costs.append(np.where(filled[s] & present[t], source.costs(places[:, *s], others[:, *t], step), 0))
    return costs[0], costs[1]


class EdgeCosts(NamedTuple):
    """Costs of the edges of a window in a direction, int64 each: if both pixels are old, if one of them is new."""

    both_old: np.ndarray
    t_new: np.ndarray
    s_new: np.ndarray


def crossing_costs(
    source: SeamPhoto, places: np.ndarray, filled: np.ndarray, patch: np.ndarray, covers: np.ndarray
) -> Iterator[EdgeCosts]:
    """For each of `NEIGHBORS`, what a new patch costs in a window: as `seam_costs`.

    Where neither what is there nor the patch has a seam, both ways cost the same.

    `places` (2, h, w) int; `filled` (h, w) bool; `patch` (2, h, w) int; `covers` (h, w) bool.
    """
    old, fresh = (source.at(*at) for at in (places, patch))
    same, apart = (places == patch).all(0), lengths(np.subtract(old, fresh, dtype=np.int32))

    def across(step: tuple[int, int]) -> EdgeCosts:
        s, t = ends_of(step)
        jumps = [(at[:, *s] + np.reshape(step, (2, 1, 1)) != at[:, *t]).any(0) for at in (places, patch)]
        changes = [lengths(np.subtract(one[s], one[t], dtype=np.int32)) for one in (old, fresh)]
        gradient = 2.0 * (changes[0] + changes[1]) + _FLOOR
        plain = np.where(same[s], 0, _ratio(apart[s] + apart[t], gradient))
        both_old, jump = np.zeros_like(plain), jumps[0] | jumps[1]
        t_new, s_new = (np.where(exist, plain, 0) for exist in (filled[s] & covers[t], covers[s] & filled[t]))
        seams = (
            (both_old, places, places, jumps[0] & filled[s] & filled[t]),
            (t_new, places, patch, jump & filled[s] & covers[t]),
            (s_new, patch, places, jump & covers[s] & filled[t]),
        )
        begins, ends = (
            np.concatenate([seam[n][:, *at][:, seam[3]] for seam in seams], 1) for n, at in ((1, s), (2, t))
        )
        found = iter(np.split(source.costs(begins, ends, step), np.cumsum([seam[3].sum() for seam in seams])))
        for costs, _, _, edges_there in seams:
            costs[edges_there] = next(found)
        return EdgeCosts(both_old, t_new, s_new)

    return map(across, NEIGHBORS)


def cut(costs: Iterable[EdgeCosts], filled: np.ndarray, covers: np.ndarray) -> np.ndarray:
    """A mask of the pixels of a window that a new patch replaces, at the least cost: see `PatchCut`."""
    made = PatchCut.of(costs, filled, covers)
    return made.new | made.grid.chosen()


@dataclass(frozen=True)
class PatchCut:
    """What it costs to take pixels of a new patch in a window.

    Unfilled pixels take the patch where it covers them. Pixels outside the patch are kept.

    Attributes
    ----------
    new : (h, w) bool
        The unfilled pixels that take the patch.
    kept : int
        Cost of all seams if no other pixel takes it.
    grid : GridCut
        The pixels that may take it.
    """

    new: np.ndarray
    kept: int
    grid: GridCut

    @classmethod
    def of(cls, costs: Iterable[EdgeCosts], filled: np.ndarray, covers: np.ndarray) -> PatchCut:
        """`costs`: as `crossing_costs`; `filled`, `covers` (h, w) bool: where pixels exist, and the patch has some."""
        new, free = covers & ~filled, covers & filled
        lean = np.zeros(free.shape, np.int64)  # cost of being new minus cost of being old
        kept, arcs = 0, []
        for step, (both_old, t_new, s_new) in zip(NEIGHBORS, costs, strict=True):
            s, t = ends_of(step)
            for fixed, other, if_kept, change in ((t, s, t_new, s_new), (s, t, s_new, t_new)):
                lean[other] += np.where(new[fixed], -if_kept, np.where(covers[fixed], 0, change - both_old))
                kept += int(if_kept[new[fixed]].sum())
            pair = free[s] & free[t]
            node = np.where(pair, np.minimum(both_old, t_new + s_new), 0)  # cost of a seam node
            kept += int(node.sum()) + int(both_old[~pair].sum())
            # the cost of keeping both pixels is split so that arcs in both directions are as equal as possible: most
            # pixels then have no terminal arc, and a flow has little to cancel
            of_t = np.where(pair, np.clip(-(node // 2), -s_new, t_new - node), 0)
            lean[s] -= node + of_t
            lean[t] += of_t
            arcs.append((np.where(pair, t_new - node - of_t, 0), np.where(pair, s_new + of_t, 0)))
        return cls(new, kept, GridCut(free, lean, arcs))

    def estimate(self) -> int:
        """Cost of all seams after the best cut of a grid of few pixels."""
        grid = self.grid
        while np.count_nonzero(grid.free) > FEW:
            grid = grid.half
        return self.kept + grid.cost(grid.chosen())

    def banded(self) -> np.ndarray:
        """The pixels that are taken, (h, w) bool, cut from coarse to fine: Lombaert, Sun, Grady, Xu 2005.

        A large grid is first solved at half its size, then in a band around the borders found.
        """
        grid = self.grid
        if np.count_nonzero(grid.free) < LARGE:
            return self.new | grid.chosen()
        height, width = self.new.shape
        guess = grid.half.chosen().repeat(2, 0).repeat(2, 1)[:height, :width] & grid.free
        return self.new | grid.within(near_border(guess | self.new, BAND) & grid.free, guess)


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
    pairs = []
    for one in costs:
        s, t, begins, ends = one.s, one.t, one.begins, one.ends
        for free_one, other, if_chosen, if_not in ((t, s, begins, ends), (s, t, ends, begins)):
            alone = flat[free_one] & ~flat[other]
            # next to a chosen pixel, it costs not to be chosen, and the other way round
            np.add.at(lean, free_one[alone], np.where(others[other], -if_not, if_chosen)[alone])
        pair = flat[s] & flat[t]
        pairs.append(GridEdges(number[s[pair]], number[t[pair]], begins[pair], ends[pair]))
    out = others.copy()
    if flat.any():
        out[flat] = minimum_cut(int(flat.sum()), pairs, lean[flat])
    return out.reshape(free.shape)


def minimum_cut(count: int, pairs: list[GridEdges], lean: np.ndarray) -> np.ndarray:
    """The choice of `count` nodes that costs the least, the one with the most chosen ones: (count,) bool.

    `pairs`: edges in a few directions, in each of which a node begins one edge at most, and ends one. `lean` (count,)
    int64: cost of choosing a node.
    """
    from scipy.sparse import csr_array  # slow to import
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    top, bottom = count, count + 1
    (dear,), (cheap,) = np.nonzero(lean > 0), np.nonzero(lean < 0)
    if not len(dear):
        return np.ones(count, bool)
    # arcs of a node by direction, which is the order of the nodes that they lead to, then the one from or to an end
    ends = np.empty((count, 2 * len(pairs) + 1), np.int32)
    capacity, present = np.zeros(ends.shape, np.int32), np.zeros(ends.shape, bool)
    for n, one in enumerate(pairs):
        exist = one.begins + one.ends > 0
        forth, back = len(pairs) + n, len(pairs) - 1 - n
        for s, t, costs, place in ((one.s, one.t, one.begins, forth), (one.t, one.s, one.ends, back)):
            ends[s, place], capacity[s, place], present[s, place] = t, costs, exist
    ends[:, -1], capacity[:, -1], present[:, -1] = np.where(lean > 0, top, bottom), np.maximum(-lean, 0), lean != 0
    begins = np.concatenate([[0], present.sum(1), [len(dear), len(cheap)]]).cumsum(dtype=np.int32)
    indices = np.concatenate([ends[present], dear.astype(np.int32), cheap.astype(np.int32)])
    values = np.concatenate([capacity[present], lean[dear].astype(np.int32), np.zeros(len(cheap), np.int32)])
    graph = csr_array((values, indices, begins), shape=(count + 2, count + 2))
    graph.sum_duplicates()  # of a closed strip of two columns
    residual = graph - maximum_flow(graph, top, bottom).flow
    residual.eliminate_zeros()
    reached = breadth_first_order(residual, top, return_predecessors=False)
    ones = np.ones(count + 2, bool)
    ones[reached] = False
    return ones[:count]


def near_border(choice: np.ndarray, by: int) -> np.ndarray:
    """The pixels at most `by` px along both axes from the border of a choice, (h, w) bool each."""
    from scipy import ndimage  # slow to import

    side = 2 * by + 1
    return np.asarray(ndimage.maximum_filter(choice, side) != ndimage.minimum_filter(choice, side))


@dataclass(frozen=True)
class GridCut:
    """Pixels of a grid to be chosen at the least cost.

    Attributes
    ----------
    free : (h, w) bool
        The pixels that are decided.
    lean : (h, w) int64
        Cost of choosing a pixel.
    arcs : list of (array, array)
        For each of `NEIGHBORS`, costs if only the second, or only the first pixel of an edge is chosen: 0 unless both
        are free.
    """

    free: np.ndarray
    lean: np.ndarray
    arcs: list[tuple[np.ndarray, np.ndarray]]

    def chosen(self) -> np.ndarray:
        """(h, w) bool; of equal choices, the largest."""
        return self.within(self.free, np.zeros(self.free.shape, bool))

    def within(self, band: np.ndarray, choice: np.ndarray) -> np.ndarray:
        """As `chosen`, if pixels outside the band are chosen as in `choice`; (h, w) bool each."""
        costs = []
        for step, (begins, ends) in zip(NEIGHBORS, self.arcs, strict=True):
            s, t = edges_at(band, step)
            at = np.divmod(s, band.shape[1])
            costs.append(GridEdges(s, t, begins[at], ends[at]))
        return chosen(band, choice, self.lean.flatten(), costs)

    def cost(self, choice: np.ndarray) -> int:
        """What a choice costs."""
        total = int(self.lean[self.free & choice].sum())
        for step, (begins, ends) in zip(NEIGHBORS, self.arcs, strict=True):
            s, t = ends_of(step)
            total += int(begins[choice[t] & ~choice[s]].sum()) + int(ends[choice[s] & ~choice[t]].sum())
        return total

    @functools.cached_property
    def half(self) -> GridCut:
        """Of squares of 2 x 2 pixels. The border between two may lie between them, or inside the first: the cheaper."""

        def pooled(values: np.ndarray, fold: np.ufunc) -> np.ndarray:
            rows = fold.reduceat(values, np.arange(0, len(values), 2))
            return fold.reduceat(rows, np.arange(0, values.shape[1], 2), 1)

        def between(costs: np.ndarray, both: np.ndarray) -> np.ndarray:
            """Of squares along the second axis."""
            count = costs.shape[1] // 2
            lines = np.where(both, costs, 2 * MOST_COST)[:, : 2 * count].reshape(-1, count, 2)
            least = np.where(both[:, 1 : 2 * count : 2], lines.min(2), 0)
            return np.add.reduceat(least, np.arange(0, len(least), 2))

        arcs = []
        for step, pair in zip(NEIGHBORS, self.arcs, strict=True):
            s, t = ends_of(step)
            both = self.free[s] & self.free[t]
            begins, ends = (between(c.T, both.T).T if step[0] else between(c, both) for c in pair)
            arcs.append((begins, ends))
        return GridCut(pooled(self.free, np.logical_or), pooled(np.where(self.free, self.lean, 0), np.add), arcs)
