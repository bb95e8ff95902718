# SPDX-License-Identifier: Apache-2.0
"""The exemplar graph as a document: exemplars, the root, and how their scales relate (HRRG08 section 3.1).

A graph is a small JSON file (YAML where PyYAML is installed):

    {"exemplars": [{"id": "land", "file": "land.png"}, {"id": "river", "file": "river.png"}],
     "root": "land",
     "edges": [{"from": "land", "to": "river", "r": 2}],
     "jitter": [0, 0.6, 0.6], "seed": 7}

`r` is log2 of how many times smaller a pixel of `to` is; `scale` says the ratio itself, and `to` is resampled to the
nearest power of two. Both together say to which, and `"resample": true` allows more than sqrt(2). `wrap` of an exemplar
says what is at its borders, `periodic` or `mirror`; what it looks like when left out. `nodes` may stand for
`exemplars`, and `title`, `note` and where a photo was taken from are passed over.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

from ..core.parameters import nearest
from ..errors import ImageError
from ..io.documents import read_document

_TOP = ("exemplars", "nodes", "root", "edges", "jitter", "seed", "resample", "title", "note")
_NODE = ("id", "file", "wrap", "title", "note", "pixel_size", "origin_px", "origin_fullres_px", "grain_um")
_EDGE = ("from", "to", "r", "scale", "note", "to_origin_in_from_px")
LOOP_R = 1  # of an exemplar to itself where nobody says it
_ALIKE = 0.02  # of an octave: ratios this close to a power of two are one


class Edge(NamedTuple):
    """Pixels of exemplar `destination` are 2^r times smaller than those of `source`: (i, j, r) of HRRG08."""

    source: int
    destination: int
    r: int


@dataclass(frozen=True)
class Graph:
    """A checked exemplar graph. Exemplars are numbered in the order of the document.

    Attributes
    ----------
    edges : tuple of Edge
        Those with r = 0 from an exemplar to itself, which HRRG08 implies, are left out.
    factors : tuple of float
        How much larger each exemplar is to be resampled, so that all ratios are powers of two; within sqrt(2) unless
        the document asks for more.
    wraps : tuple of str or None
        "periodic" or "mirror": what is at the borders of each exemplar; None: what they look like.
    jitter : tuple of float or None
        rho by level; the last holds for all finer ones.
    """

    names: tuple[str, ...]
    files: tuple[Path, ...]
    root: int
    edges: tuple[Edge, ...]
    factors: tuple[float, ...]
    wraps: tuple[str | None, ...]
    jitter: tuple[float, ...] | None = None
    seed: int | None = None

    @classmethod
    def single(cls, name: str) -> Graph:
        """One exemplar without scale edges: Lefebvre & Hoppe 2005."""
        return cls((name,), (Path(name),), 0, (), (1.0,), (None,))

    @classmethod
    def loop(cls, name: str, r: int) -> Graph:
        """One exemplar with an edge to itself: a zoom that never ends (HRRG08 figure 3)."""
        return cls((name,), (Path(name),), 0, (Edge(0, 0, r),), (1.0,), (None,))

    def leads_on(self, exemplar: int) -> bool:
        """Whether an edge leaves that exemplar."""
        return any(edge.source == exemplar for edge in self.edges)

    def in_loop(self, exemplar: int) -> bool:
        """Whether edges lead from that exemplar back to it."""
        onward = _onward(self.edges)
        return exemplar in _reached(onward, onward.get(exemplar, ()))

    def depth(self) -> int:
        """The most octaves that lie between the root and an exemplar.

        Of several ways the longest counts; within exemplars that lead back to each other, where ways have no end, the
        first (to ask for the longest that passes none twice takes a time factorial in their number).
        """
        onward = _onward(self.edges)
        reached = {n: _reached(onward, [n]) for n in range(len(self.names))}
        octaves = dict.fromkeys(reached, -1) | {self.root: 0}
        placed: set[int] = set()
        # an exemplar reaches all that comes behind it, so who reaches more comes first
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
        """How many octaves each exemplar is below the root, by the first way that leads there."""
        by_exemplar = _first_ways(self.edges, self.root, 0)
        return tuple(by_exemplar[n] for n in range(len(self.names)))

    def require_levels(self, finest: int, where: str) -> None:
        """Refuse edges over more octaves than the stacks of 2^finest px exemplars overlap.

        Raises
        ------
        ImageError
            r > r_max = L - 3 (HRRG08 section 3.1).
        """
        for edge in self.edges:
            if edge.r > finest - 3:
                raise ImageError(
                    f"{where}: edge {self._named(edge)}: r={edge.r} is more than r_max = L - 3 = {finest - 3}"
                    f" of exemplars that are {1 << finest} px wide"
                )

    def _named(self, edge: Edge) -> str:
        return f"{self.names[edge.source]} -> {self.names[edge.destination]}"


def read_graph(path: str | Path) -> Graph:
    """The graph that a file holds; exemplars' files are looked up beside it.

    Raises
    ------
    ImageError
        It cannot be read, or something in it is wrong; the text says what.
    """
    path = Path(path)
    return parse_graph(read_document(path), path)


def parse_graph(document: Any, path: Path) -> Graph:
    """The graph that a document says; raises as `read_graph` does."""
    where = str(path)
    top = _mapping(document, _TOP, where)
    if "exemplars" in top and "nodes" in top:
        raise ImageError(f"{where}: exemplars and nodes are the same: say one of them")
    nodes = _listed(top, "exemplars" if "exemplars" in top else "nodes", where)
    if not nodes:
        raise ImageError(f"{where}: there is no exemplar")
    names, files, wraps = _exemplars(nodes, path)
    drawn = [_edge(entry, names, where) for entry in _listed(top, "edges", where)]
    root = _root(top.get("root"), names, [(edge.source, edge.destination) for edge in drawn], where)
    resample = top.get("resample", False)
    if not isinstance(resample, bool):
        raise ImageError(f"{where}: resample={resample}: allowed is true or false")
    edges, factors = _placed(drawn, root, names, resample, where)
    seed = top.get("seed")
    if seed is not None and (not _whole(seed) or not 0 <= seed < 2**32):
        raise ImageError(f"{where}: seed={seed}: allowed is a whole number >= 0 and <= 4294967295")
    return Graph(names, files, root, edges, factors, wraps, _jitter(top.get("jitter"), where), seed)


def _mapping(entry: Any, known: tuple[str, ...], where: str) -> dict[str, Any]:
    if not isinstance(entry, dict):
        raise ImageError(f"{where}: an object of {', '.join(known[:4])} is wanted, not {type(entry).__name__}")
    for name in entry:
        if name not in known:
            raise ImageError(f"{where}: unknown '{name}'{nearest(str(name), known)}; there is {', '.join(known)}")
    return entry


def _listed(top: dict[str, Any], name: str, where: str) -> list[Any]:
    entries = top.get(name, [])
    if not isinstance(entries, list):
        raise ImageError(f"{where}: {name} is a list, not {type(entries).__name__}")
    return entries


def _exemplars(nodes: list[Any], path: Path) -> tuple[tuple[str, ...], tuple[Path, ...], tuple[str | None, ...]]:
    names: list[str] = []
    files: list[Path] = []
    wraps: list[str | None] = []
    for n, entry in enumerate(nodes):
        node = _mapping(entry, _NODE, f"{path}: exemplar {n}")
        file = node.get("file")
        name = node.get("id", file)
        if not isinstance(name, str) or not name:
            raise ImageError(f"{path}: exemplar {n} has no id")
        if not isinstance(file, str) or not file:
            raise ImageError(f"{path}: exemplar '{name}' has no file")
        if name in names:
            raise ImageError(f"{path}: there are two exemplars '{name}'")
        wrap = node.get("wrap")
        if wrap not in (None, "periodic", "mirror"):
            raise ImageError(f"{path}: exemplar '{name}': wrap={wrap}: allowed is periodic or mirror")
        names.append(name)
        files.append(path.parent / file)
        wraps.append(wrap)
    return tuple(names), tuple(files), tuple(wraps)


class _Drawn(NamedTuple):
    """An edge as a document says it."""

    source: int
    destination: int
    ratio: float  # log2 of how many times smaller the pixels of the destination's file are
    r: int | None  # what that is to become

    def named(self, names: tuple[str, ...]) -> str:
        """For messages."""
        return f"edge {names[self.source]} -> {names[self.destination]}"


def _edge(entry: Any, names: tuple[str, ...], where: str) -> _Drawn:
    edge = _mapping(entry, _EDGE, f"{where}: edge")
    ends = []
    for end in ("from", "to"):
        if edge.get(end) not in names:
            other = f"'{edge[end]}'" if end in edge else f"named by '{end}'"
            raise ImageError(f"{where}: edge {_said(edge)}: there is no exemplar {other}; there is {', '.join(names)}")
        ends.append(names.index(edge[end]))
    if "r" not in edge and "scale" not in edge:
        raise ImageError(f"{where}: edge {_said(edge)}: r or scale says how their pixels relate")
    r, scale = edge.get("r"), edge.get("scale")
    if "r" in edge and (not _whole(r) or r < 0):
        raise ImageError(
            f"{where}: edge {_said(edge)}: r={r}: allowed is a whole number >= 0; a ratio is said by scale"
        )
    if "scale" not in edge:
        return _Drawn(ends[0], ends[1], float(edge["r"]), None)
    if isinstance(scale, bool) or not isinstance(scale, (int, float)) or not 1 <= scale < 2**30:
        raise ImageError(f"{where}: edge {_said(edge)}: scale={scale}: allowed is a number >= 1")
    return _Drawn(ends[0], ends[1], math.log2(scale), r)


def _said(edge: dict[str, Any]) -> str:
    return f"{edge.get('from', '?')} -> {edge.get('to', '?')}"


def _whole(value: Any) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _root(wanted: Any, names: tuple[str, ...], edges: list[tuple[int, int]], where: str) -> int:
    if wanted is not None:
        if wanted not in names:
            raise ImageError(f"{where}: root '{wanted}' is no exemplar; there is {', '.join(names)}")
        root = names.index(wanted)
    else:
        ends = {destination for source, destination in edges if source != destination}
        free = [n for n in range(len(names)) if n not in ends]
        if len(free) != 1:
            could = " or ".join(names[n] for n in free) or "every exemplar is the end of an edge"
            raise ImageError(f"{where}: there is no root: say root, {could}")
        root = free[0]
    reached = _reached(_onward(edges), [root])
    for n, name in enumerate(names):
        if n not in reached:
            raise ImageError(f"{where}: no edges lead from root '{names[root]}' to exemplar '{name}'")
    return root


def _onward(edges: Iterable[tuple[int, ...]]) -> dict[int, set[int]]:
    """Where edges lead to, by where they start."""
    onward: dict[int, set[int]] = {}
    for edge in edges:
        onward.setdefault(edge[0], set()).add(edge[1])
    return onward


def _reached(onward: dict[int, set[int]], first: Iterable[int]) -> set[int]:
    """What edges lead to from there, with where they start."""
    reached = set(first)
    open_ends = list(reached)
    while open_ends:
        further = onward.get(open_ends.pop(), set()) - reached
        reached |= further
        open_ends += further
    return reached


def _first_ways(edges: Iterable[Edge], start: int, octave: int) -> dict[int, int]:
    """The octave of each exemplar that edges lead to, by the way of fewest edges; `start` lies at `octave`."""
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
    drawn: list[_Drawn], root: int, names: tuple[str, ...], resample: bool, where: str
) -> tuple[tuple[Edge, ...], tuple[float, ...]]:
    """Whole r for all edges, and how exemplars are resampled for it.

    The first edge to an exemplar places it: the ratio is rounded to whole octaves counted from the root, so that
    roundings do not add up. Every other edge then says a ratio that must be a power of two.
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
                        f"{where}: {edge.named(names)}: for r={edge.r} exemplar '{names[to]}' would be resampled"
                        f' {2 ** away[to]:.4g} times, more than sqrt(2): say "resample": true, or a nearer r'
                    )
                waiting.append(to)
    edges = []
    for edge in drawn:
        exact = edge.ratio + away[edge.destination] - away[edge.source]
        r = round(exact)
        if abs(exact - r) > _ALIKE:
            raise ImageError(
                f"{where}: {edge.named(names)}: scale={2**edge.ratio:.4g} is no power of two"
                " and closes a loop or a second way, so that no resampling makes it one"
            )
        if edge.r not in (None, r):
            raise ImageError(f"{where}: {edge.named(names)}: r={edge.r}, but by the other edges it is {r}")
        if r < 0:
            raise ImageError(f"{where}: {edge.named(names)} leads to larger pixels")
        placed = Edge(edge.source, edge.destination, r)
        if placed != Edge(edge.source, edge.source, 0) and placed not in edges:
            edges.append(placed)
    factors = tuple(1.0 if abs(away[n]) < _ALIKE else 2.0 ** away[n] for n in range(len(names)))
    return tuple(edges), factors


def _jitter(value: Any, where: str) -> tuple[float, ...] | None:
    if value is None:
        return None
    rhos = value if isinstance(value, list) else [value]
    for rho in rhos:
        if isinstance(rho, bool) or not isinstance(rho, (int, float)) or not 0 <= rho <= 1:
            raise ImageError(f"{where}: jitter {rho}: allowed is a number >= 0 and <= 1, or one per level")
    if not rhos:
        raise ImageError(f"{where}: jitter has no levels")
    return tuple(float(rho) for rho in rhos)
