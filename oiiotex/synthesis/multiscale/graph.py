# SPDX-License-Identifier: Apache-2.0
"""The exemplar graph as a document: exemplars, the root, and the ratios of their scales (HRRG08 section 3.1).

A graph is a small JSON file (YAML if PyYAML is installed):

    {"exemplars": [{"id": "land", "file": "land.png"}, {"id": "river", "file": "river.png"}],
     "root": "land",
     "edges": [{"from": "land", "to": "river", "r": 2}],
     "jitter": [0, 0.6, 0.6], "seed": 7}

`r` is log2 of the ratio of the pixel sizes of `from` and `to`. `scale` is the ratio itself, and `to` is resampled to
the nearest power of two. With both, it is resampled to `r`, and `"resample": true` allows more than sqrt(2). `wrap` of
an exemplar sets its borders, `periodic` or `mirror`. Default: from the image. `nodes` is an alias of `exemplars`.
`title`, `note` and the source of a photo are ignored.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from ...engine.errors import ImageError
from ...engine.io.documents import read_document
from ...engine.io.schema import Allowed, Fraction, Seed, read_as

LOOP_R = 1  # from an exemplar to itself, if not given
_ALIKE = 0.02  # octaves: ratios this close to a power of two count as one


class Edge(NamedTuple):
    """Pixels of exemplar `destination` are 2^r times smaller than those of `source`: (i, j, r) of HRRG08."""

    source: int
    destination: int
    r: int


_NonEmpty = Annotated[str, Allowed(pattern="(?s).+", words="of one character or more")]


@dataclass(frozen=True, kw_only=True)
class _ExemplarEntry:
    """An exemplar in a document."""

    file: _NonEmpty
    id: _NonEmpty | None = None
    wrap: Literal["periodic", "mirror"] | None = None
    title: Any = None
    note: Any = None
    pixel_size: Any = None
    origin_px: Any = None
    origin_fullres_px: Any = None
    grain_um: Any = None


@dataclass(frozen=True, kw_only=True)
class _EdgeEntry:
    """An edge in a document."""

    source: str = field(metadata={"key": "from"})
    destination: str = field(metadata={"key": "to"})
    r: Annotated[int, Allowed(0)] | None = None
    scale: Annotated[float, Allowed(1, 2**30)] | None = None
    note: Any = None
    to_origin_in_from_px: Any = None


@dataclass(frozen=True, kw_only=True)
class _GraphDocument:
    """The whole document."""

    exemplars: tuple[_ExemplarEntry, ...] | None = None
    nodes: tuple[_ExemplarEntry, ...] | None = None
    root: str | None = None
    edges: tuple[_EdgeEntry, ...] = ()
    jitter: Fraction | tuple[Fraction, ...] | None = None
    seed: Seed | None = None
    resample: bool = False
    title: Any = None
    note: Any = None


@dataclass(frozen=True)
class Graph:
    """A checked exemplar graph. Exemplars are numbered in the order of the document."""

    names: tuple[str, ...]
    files: tuple[Path, ...]
    root: int
    edges: tuple[Edge, ...]  # without r = 0 from an exemplar to itself, which HRRG08 implies
    factors: tuple[float, ...]  # resampling factor of each, so that all ratios are powers of two
    wraps: tuple[str | None, ...]  # borders of each: periodic or mirror; None: detected
    jitter: tuple[float, ...] | None = None  # rho by level; the last holds for all finer ones
    seed: int | None = None

    @classmethod
    def single(cls, name: str) -> Graph:
        """One exemplar without scale edges: Lefebvre & Hoppe 2005."""
        return cls((name,), (Path(name),), 0, (), (1.0,), (None,))

    @classmethod
    def loop(cls, name: str, r: int) -> Graph:
        """One exemplar with an edge to itself: an endless zoom (HRRG08 figure 3)."""
        return cls((name,), (Path(name),), 0, (Edge(0, 0, r),), (1.0,), (None,))

    def leads_on(self, exemplar: int) -> bool:
        """Whether an edge leaves that exemplar."""
        return any(edge.source == exemplar for edge in self.edges)

    def in_loop(self, exemplar: int) -> bool:
        """Whether edges lead from that exemplar back to it."""
        onward = _onward(self.edges)
        return exemplar in _reached(onward, onward.get(exemplar, ()))

    def depth(self) -> int:
        """The maximum number of octaves between the root and an exemplar.

        The longest path counts. Within exemplars that lead back to each other, where paths are infinite, the first one
        counts (the longest path without repetition takes a time factorial in their number).
        """
        onward = _onward(self.edges)
        reached = {n: _reached(onward, [n]) for n in range(len(self.names))}
        octaves = dict.fromkeys(reached, -1) | {self.root: 0}
        placed: set[int] = set()
        # ancestors reach more exemplars, so they come first
        for n in sorted(reached, key=lambda n: -len(reached[n])):
            if n in placed:
                continue
            together = {m for m in reached[n] if n in reached[m]}
            placed |= together
            entered = max(together, key=lambda m: octaves[m])
            inside = [edge for edge in self.edges if {edge.source, edge.destination} <= together]
            octaves |= _first_ways(inside, entered, octaves[entered])
            for edge in self.edges:
                if edge.source in together and edge.destination not in together:
                    octaves[edge.destination] = max(octaves[edge.destination], octaves[edge.source] + edge.r)
        return max(octaves.values())

    def octaves(self) -> tuple[int, ...]:
        """The number of octaves of each exemplar below the root, along the first path to it."""
        by_exemplar = _first_ways(self.edges, self.root, 0)
        return tuple(by_exemplar[n] for n in range(len(self.names)))

    def require_levels(self, finest: int, where: str) -> None:
        """Refuse edges over more octaves than stacks of 2^finest px support: r > r_max = L - 3 (HRRG08 section 3.1)."""
        for edge in self.edges:
            if edge.r > finest - 3:
                problem = f"r={edge.r} is more than r_max = L - 3 = {finest - 3} of exemplars of {1 << finest} px"
                hint = "increase exemplarside, or reduce r"
                named = f"{self.names[edge.source]} -> {self.names[edge.destination]}"
                raise ImageError(f"{where}: edge {named}: {problem}", hint=hint)


def read_graph(path: str | Path) -> Graph:
    """Read a graph from a file. Exemplar files are relative to it.

    Raises
    ------
    ImageError
        It cannot be read, or its contents are wrong. The message gives the details.
    """
    path = Path(path)
    return parse_graph(read_document(path), path)


def parse_graph(document: Any, path: Path) -> Graph:
    """The graph in a document. Raises the errors of `read_graph`."""
    where = str(path)
    top: _GraphDocument = read_as(_GraphDocument, document, where)
    if top.exemplars is not None and top.nodes is not None:
        raise ImageError(f"{where}: exemplars conflicts with nodes: expected only one of them")
    nodes = top.exemplars or top.nodes
    if not nodes:
        raise ImageError(f"{where}: no exemplars: expected at least one")
    names = tuple(node.file if node.id is None else node.id for node in nodes)
    for n, name in enumerate(names):
        if name in names[:n]:
            raise ImageError(f"{where}: duplicate exemplar '{name}'")
    drawn = [_drawn(edge, names, where) for edge in top.edges]
    root = _root(top.root, names, [(edge.source, edge.destination) for edge in drawn], where)
    edges, factors = _placed(drawn, root, names, top.resample, where)
    jitter = (top.jitter,) if isinstance(top.jitter, float) else top.jitter
    if jitter == ():
        raise ImageError(f"{where}: jitter is empty: expected at least one level")
    files, wraps = tuple(path.parent / node.file for node in nodes), tuple(node.wrap for node in nodes)
    return Graph(names, files, root, edges, factors, wraps, jitter, top.seed)


class _DrawnEdge(NamedTuple):
    """An edge as written in a document."""

    source: int
    destination: int
    ratio: float  # log2 of the ratio of pixel sizes
    r: int | None  # target of that ratio after resampling

    def named(self, names: tuple[str, ...]) -> str:
        """Text for messages."""
        return f"edge {names[self.source]} -> {names[self.destination]}"


def _drawn(edge: _EdgeEntry, names: tuple[str, ...], where: str) -> _DrawnEdge:
    said = f"{where}: edge {edge.source} -> {edge.destination}"
    for end in (edge.source, edge.destination):
        if end not in names:
            raise ImageError(f"{said}: unknown exemplar '{end}': expected one of {', '.join(names)}")
    source, destination = names.index(edge.source), names.index(edge.destination)
    if edge.scale is not None:
        return _DrawnEdge(source, destination, math.log2(edge.scale), edge.r)
    if edge.r is None:
        raise ImageError(f"{said}: expected r or scale, the ratio of their pixel sizes")
    return _DrawnEdge(source, destination, float(edge.r), None)


def _root(wanted: Any, names: tuple[str, ...], edges: list[tuple[int, int]], where: str) -> int:
    if wanted is not None:
        if wanted not in names:
            raise ImageError(f"{where}: unknown root '{wanted}': expected one of {', '.join(names)}")
        root = names.index(wanted)
    else:
        ends = {destination for source, destination in edges if source != destination}
        free = [n for n in range(len(names)) if n not in ends]
        if len(free) != 1:
            could = " or ".join(names[n] for n in free) or "every exemplar is the end of an edge"
            raise ImageError(f"{where}: the root is ambiguous ({could}): set root")
        root = free[0]
    reached = _reached(_onward(edges), [root])
    for n, name in enumerate(names):
        if n not in reached:
            raise ImageError(f"{where}: no edges lead from root '{names[root]}' to exemplar '{name}'")
    return root


def _onward(edges: Iterable[tuple[int, ...]]) -> dict[int, set[int]]:
    """Destinations of edges by their sources."""
    onward: dict[int, set[int]] = {}
    for edge in edges:
        onward.setdefault(edge[0], set()).add(edge[1])
    return onward


def _reached(onward: dict[int, set[int]], first: Iterable[int]) -> set[int]:
    """Everything that edges reach from there, including the start."""
    reached = set(first)
    open_ends = list(reached)
    while open_ends:
        further = onward.get(open_ends.pop(), set()) - reached
        reached |= further
        open_ends += further
    return reached


def _first_ways(edges: Iterable[Edge], start: int, octave: int) -> dict[int, int]:
    """The octave of each exemplar reached, along the path of fewest edges. `start` is at `octave`."""
    onward: dict[int, list[Edge]] = {}
    for edge in edges:
        onward.setdefault(edge.source, []).append(edge)
    octaves, waiting = {start: octave}, deque([start])
    while waiting:
        at = waiting.popleft()
        for edge in onward.get(at, ()):
            if edge.destination not in octaves:
                octaves[edge.destination] = octaves[at] + edge.r
                waiting.append(edge.destination)
    return octaves


def _placed(
    drawn: list[_DrawnEdge], root: int, names: tuple[str, ...], resample: bool, where: str
) -> tuple[tuple[Edge, ...], tuple[float, ...]]:
    """Integer r for all edges, and the resampling factors of exemplars that this requires.

    The first edge to an exemplar places it: the ratio is rounded to whole octaves from the root, so that
    rounding errors do not accumulate. The ratio of every other edge must then be a power of two.
    """
    octaves = {root: 0}  # of the resampled exemplar, finer than the root
    away = {root: 0.0}  # log2 of the resampling factor
    waiting = [root]
    while waiting:
        at = waiting.pop(0)
        for edge in drawn:
            to = edge.destination
            if edge.source == at and to not in octaves:
                exact = octaves[at] - away[at] + edge.ratio
                octaves[to] = math.floor(exact + 0.5) if edge.r is None else octaves[at] + edge.r
                away[to] = octaves[to] - exact
                if abs(away[to]) > 0.5 + _ALIKE and not resample:
                    raise ImageError(
                        f"{where}: {edge.named(names)}: r={edge.r} would resample exemplar '{names[to]}'"
                        f" {2 ** away[to]:.4g} times: expected at most sqrt(2)",
                        hint='set "resample": true, or use a nearer r',
                    )
                waiting.append(to)
    edges = []
    for edge in drawn:
        exact = edge.ratio + away[edge.destination] - away[edge.source]
        r = round(exact)
        if abs(exact - r) > _ALIKE:
            raise ImageError(
                f"{where}: {edge.named(names)}: scale={2**edge.ratio:.4g} closes a loop or a second path, where"
                " resampling cannot adapt it: expected a power of two"
            )
        if edge.r not in (None, r):
            raise ImageError(f"{where}: {edge.named(names)}: r={edge.r} conflicts with r={r} from the other edges")
        if r < 0:
            raise ImageError(f"{where}: {edge.named(names)} leads to larger pixels: expected smaller or equal ones")
        placed = Edge(edge.source, edge.destination, r)
        if placed != Edge(edge.source, edge.source, 0) and placed not in edges:
            edges.append(placed)
    factors = tuple(1.0 if abs(away[n]) < _ALIKE else 2.0 ** away[n] for n in range(len(names)))
    return tuple(edges), factors
