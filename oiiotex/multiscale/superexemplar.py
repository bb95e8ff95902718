# SPDX-License-Identifier: Apache-2.0
"""Which stack levels take part, and which may replace which: HRRG08 section 3.3 and its appendix.

The superexemplar unrolls an exemplar graph into a tree without end where there are loops. Nothing depends on how deep
in the tree a level stands but which levels it meets, so that its vertices are kept once each: (exemplar, level).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from .graph import Edge, Graph

FIRST_CORRECTED = 2  # level; coarser ones have less than a neighborhood of the root
LEAST_TURN = 2  # octaves


@dataclass(frozen=True)
class Levels:
    """The stack levels that synthesis can come to, numbered.

    Attributes
    ----------
    finest : int
        L, the number of each exemplar's finest level.
    stacks : tuple of (exemplar, level)
        Number 0 is the root's coarsest.
    admissible : tuple of tuples of (number, octaves)
        A(E): levels that may replace each, and by how much finer in its own exemplar's octaves; itself first.
    finer : tuple of int
        The number of the next finer level of the same exemplar, the level itself where its stack ends or is left.
    literal : bool
        HRRG08 by the letter: nothing is done for the contrast of zooms without end.
    """

    finest: int
    stacks: tuple[tuple[int, int], ...]
    admissible: tuple[tuple[tuple[int, int], ...], ...]
    finer: tuple[int, ...]
    literal: bool = False

    def spacing(self, number: int) -> int:
        """h = 2^(L - k), px: how far apart a level's texels stand in a neighborhood."""
        return 1 << (self.finest - self.stacks[number][1])

    def turns(self, number: int) -> bool:
        """Whether the only way on from a level is to coarser ones of its own exemplar: a zoom's next turn."""
        exemplar = self.stacks[number][0]
        return not self.literal and all(r > 0 and self.stacks[to][0] == exemplar for to, r in self.admissible[number])


def unrolled(graph: Graph, finest: int, early: Collection[int] = (), literal: bool = False) -> Levels:
    """All levels that are reached from the root's coarsest by refining (red edges) and replacing (black edges).

    Parameters
    ----------
    finest : int
        L.
    early : collection of int
        Exemplars whose two finest levels lead nowhere, not one.
    literal : bool
        Without the departures that are named here; of every exemplar the finest level leads nowhere.
    """
    graph = graph if literal else with_long_turns(graph, finest)
    left_out = (1,) * len(graph.names) if literal else _left_out(graph, early)
    first, last = (graph.root, 0), [finest - n for n in left_out]
    order, waiting = {first: 0}, [first]
    onward: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    refined: dict[tuple[int, int], tuple[int, int]] = {}
    while waiting:
        at = waiting.pop(0)
        exemplar, level = at
        onward[at] = _admissible(graph, at, last, literal)
        stays = level < FIRST_CORRECTED or (exemplar, level, 0) in onward[at]  # else correction takes it elsewhere
        refined[at] = exemplar, min(level + stays, finest)
        for to in [*((t, k) for t, k, _ in onward[at]), refined[at]]:
            if to not in order:
                order[to] = len(order)
                waiting.append(to)
    admissible = tuple(tuple((order[t, k], r) for t, k, r in onward[at]) for at in order)
    return Levels(finest, tuple(order), admissible, tuple(order[refined[at]] for at in order), literal)


def with_long_turns(graph: Graph, finest: int) -> Graph:
    """Edges of r = 1 from an exemplar to itself, taken twice: what is alike twice of itself is alike four times.

    Departure from HRRG08: of one octave, what a zoom adds in a turn is too little, and it goes flat.
    """
    if finest - 3 < LEAST_TURN:  # r_max
        return graph
    edges = (Edge(i, j, max(r, LEAST_TURN)) if i == j else Edge(i, j, r) for i, j, r in graph.edges)
    return replace(graph, edges=tuple(dict.fromkeys(edges)))


def _admissible(graph: Graph, at: tuple[int, int], last: list[int], literal: bool) -> list[tuple[int, int, int]]:
    """A(E_k^i) as (exemplar, level, r): HRRG08 section 3.3; the level itself where nothing else is admissible.

    `last` says the finest level of each exemplar that may be used. Departure: an edge from an exemplar to itself is
    taken where its levels end, not before. A zoom that may turn at any level stays at the coarse ones, which are
    alike twice of themselves because they hold nothing, and never comes to the fine ones.
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
    """How many of each exemplar's finest levels lead nowhere, so that synthesis goes on to the next exemplar.

    Departure from HRRG08, where it is one of every exemplar: none where no edge leaves an exemplar, because its own
    pixels are what is wanted there; more before edges with r = 0, or an exemplar would be left when it is too late.
    """
    count = range(len(graph.names))
    least = [2 if n in early else int(graph.leads_on(n)) for n in count]
    counts = list(least)
    for _ in count:
        for n in count:
            onward = [counts[j] + 1 - r for i, j, r in graph.edges if i == n]
            counts[n] = max(least[n], min(onward, default=0))
    return tuple(counts)
