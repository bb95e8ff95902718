# SPDX-License-Identifier: Apache-2.0
"""The stack levels in use, and which may replace which: HRRG08 section 3.3 and its appendix.

The superexemplar unrolls an exemplar graph into a tree, which is infinite if there are loops. Only the levels that a
vertex is compared with depend on its depth, so each vertex is kept once: (exemplar, level).
"""

from __future__ import annotations

import itertools
from collections.abc import Collection
from dataclasses import dataclass, replace

from .graph import Edge, Graph

FIRST_CORRECTED = 2  # level; coarser ones are smaller than a neighborhood of the root
LEAST_TURN = 2  # octaves


@dataclass(frozen=True)
class Levels:
    """The stack levels that synthesis can reach, numbered.

    Attributes
    ----------
    finest : int
        L, the index of each exemplar's finest level.
    stacks : tuple of (exemplar, level)
        Index 0 is the root's coarsest that is refined.
    admissible : tuple of tuples of (number, octaves)
        A(E): levels that may replace each, and how much finer they are in octaves of their exemplar. Itself first.
    finer : tuple of int
        Index of the next finer level of the same exemplar. The level itself where its stack ends or is left.
    literal : bool
        The paper's settings: endless zooms lose contrast.
    first_finer, first_left : tuple of int
        `finer` up to L on a plane that contains the root itself: as far as L is shown, and where finer levels follow.
        In the former, the root's finest levels are copies that nothing replaces. Otherwise both are `finer`.
    """

    finest: int
    stacks: tuple[tuple[int, int], ...]
    admissible: tuple[tuple[tuple[int, int], ...], ...]
    finer: tuple[int, ...]
    literal: bool = False
    first_finer: tuple[int, ...] = ()
    first_left: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in ("first_finer", "first_left"):
            object.__setattr__(self, name, getattr(self, name) or self.finer)

    def spacing(self, number: int) -> int:
        """h = 2^(L - k), px: spacing of a level's texels in a neighborhood."""
        return 1 << (self.finest - self.stacks[number][1])

    @property
    def shown(self) -> tuple[tuple[int, int], ...]:
        """The stack levels, then the root's coarser ones, which are only shown."""
        root, first = self.stacks[0]
        return (*self.stacks, *((root, level) for level in range(first)))

    def starts(self, number: int) -> bool:
        """Whether planes start on a level, so that its texels are never corrected."""
        return number == 0 and self.stacks[0][1] > 0

    def turns(self, number: int) -> bool:
        """Whether a level leads only to coarser ones of the same exemplar: a zoom's next turn."""
        exemplar = self.stacks[number][0]
        return not self.literal and all(r > 0 and self.stacks[to][0] == exemplar for to, r in self.admissible[number])


def unrolled(
    graph: Graph, finest: int, early: Collection[int] = (), literal: bool = False, rooted: bool = False, first: int = 0
) -> Levels:
    """All levels reached from the root's `first` by refining (red edges) and replacing (black edges).

    Parameters
    ----------
    finest : int
        L.
    early : collection of int
        Exemplars whose two finest levels, not one, lead nowhere.
    literal : bool
        Without the departures described here: the finest level of every exemplar leads nowhere.
    rooted : bool
        The plane contains the root itself: up to L, its levels only lead to each other.
    first : int
        The root's coarsest level that is refined.
    """
    graph = graph if literal else with_long_turns(graph, finest)
    left_out = (1,) * len(graph.names) if literal else _left_out(graph, early)
    last = [finest - n for n in left_out]
    order = {at: n for n, at in enumerate([(graph.root, first), (graph.root, finest)][: 1 + rooted])}
    waiting = list(order)
    onward: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    refined: dict[tuple[int, int], tuple[int, int]] = {}
    while waiting:
        at = waiting.pop(0)
        exemplar, level = at
        onward[at] = _admissible(graph, at, last, literal)
        stays = level < FIRST_CORRECTED or (exemplar, level, 0) in onward[at]  # otherwise correction leaves it
        refined[at] = exemplar, min(level + stays, finest)
        for to in [*((t, k) for t, k, _ in onward[at]), refined[at]]:
            if to not in order:
                order[to] = len(order)
                waiting.append(to)
    admissible = tuple(tuple((order[t, k], r) for t, k, r in onward[at]) for at in order)
    levels = Levels(finest, tuple(order), admissible, tuple(order[refined[at]] for at in order), literal)
    return _rooted(levels, graph.root, last[graph.root]) if rooted else levels


def _rooted(levels: Levels, root: int, last: int) -> Levels:
    """The levels with copies of the root's that are finer than `last`, which nothing replaces.

    Departure: HRRG08 leaves the finest level at once, so that a zoom into a photo never shows the photo.
    """
    finest, count = levels.finest, len(levels.stacks)
    copies = {level: count + n for n, level in enumerate(range(last + 1, finest + 1))}
    numbers = [levels.stacks.index((root, level)) for level in range(last + 1)] + list(copies.values())
    shown = [*levels.finer, *copies.values()]
    for coarse, fine in itertools.pairwise(numbers):
        shown[coarse] = fine
    left = [levels.stacks.index((root, finest)) if n == copies[finest] else n for n in shown]
    return replace(
        levels,
        stacks=(*levels.stacks, *((root, level) for level in copies)),
        admissible=(*levels.admissible, *(((n, 0),) for n in copies.values())),
        finer=(*levels.finer, *copies.values()),
        first_finer=tuple(shown),
        first_left=tuple(left),
    )


def with_long_turns(graph: Graph, finest: int) -> Graph:
    """Edges of r = 1 from an exemplar to itself, doubled: a texture similar at twice its scale is also at four times.

    Departure from HRRG08: turns of one octave add too little, and the zoom becomes flat.
    """
    if finest - 3 < LEAST_TURN:  # r_max
        return graph
    edges = (Edge(i, j, max(r, LEAST_TURN)) if i == j else Edge(i, j, r) for i, j, r in graph.edges)
    return replace(graph, edges=tuple(dict.fromkeys(edges)))


def _admissible(graph: Graph, at: tuple[int, int], last: list[int], literal: bool) -> list[tuple[int, int, int]]:
    """A(E_k^i) as (exemplar, level, r): HRRG08 section 3.3. The level itself if nothing else is admissible.

    `last`: the finest usable level of each exemplar. Departure: an edge from an exemplar to itself is taken only where
    its levels end. A zoom that may turn at any level stays on the coarse ones, which are self-similar because they are
    almost empty, and never reaches the fine ones.
    """
    exemplar, level = at
    admissible = [(exemplar, level, 0)] if level <= last[exemplar] else []
    for source, destination, r in graph.edges:
        to = (destination, level - r, r)
        early = source == destination and level <= last[exemplar] and not literal
        if source == exemplar and r <= level <= last[destination] + r and not early and to not in admissible:
            admissible.append(to)
    return admissible or [(exemplar, level, 0)]


def _left_out(graph: Graph, early: Collection[int]) -> tuple[int, ...]:
    """Number of each exemplar's finest levels that lead nowhere, so that synthesis continues with the next exemplar.

    Departure from HRRG08, where it is one for every exemplar: none if no edge leaves an exemplar, because its own
    pixels are required there. More before edges with r = 0, or an exemplar would be left too late.
    """
    count = range(len(graph.names))
    least = [2 if n in early else int(graph.leads_on(n)) for n in count]
    counts = list(least)
    for _ in count:
        for n in count:
            onward = [counts[j] + 1 - r for i, j, r in graph.edges if i == n]
            counts[n] = max(least[n], min(onward, default=0))
    return tuple(counts)
