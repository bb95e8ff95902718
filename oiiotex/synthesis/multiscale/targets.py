# SPDX-License-Identifier: Apache-2.0
"""The input of an exemplar graph's analysis: its stack levels, and the texels that may be jumped to."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ...engine.deferred import np
from .candidate_sets import Stacks
from .graph import Graph
from .stacks import Exemplar, blurred, grid_stack, seen_values, sigma_of
from .superexemplar import LEAST_TURN, Levels, unrolled, with_long_turns

_EARLIER = 0.98  # of the gain: factor that justifies an early turn
_DULL = 0.75  # share of a level's texels that are not jumped to in a loop


def stacks_of(
    graph: Graph, exemplars: Sequence[Exemplar], literal: bool = False, rooted: bool = False, first: int = 0
) -> Stacks:
    """The stack levels that synthesis can reach, and which of their texels may be candidates. Others: `unrolled`."""
    root = exemplars[graph.root]
    finest = root.side.bit_length() - 1
    levels = unrolled(graph, finest, () if literal else _left_early(graph, exemplars, finest), literal, rooted, first)
    seen = root.values if root.opaque is None else root.values[root.opaque]
    middle = seen[..., :3].reshape(-1, 3).mean(0, dtype=np.float64)
    planes = np.empty((len(levels.stacks), root.side, root.side, 4), np.int16)
    usable = np.ones(planes.shape[:3], bool)
    for n, exemplar in enumerate(exemplars):
        numbers = [m for m, (i, _) in enumerate(levels.stacks) if i == n]
        planes[numbers] = grid_stack(exemplar, middle, [levels.stacks[m][1] for m in numbers], finest)
        if exemplar.opaque is not None:
            usable[numbers] = exemplar.opaque
    periodic = tuple(exemplars[i].periodic for i, _ in levels.stacks)
    loops = [] if literal else [n for n in range(len(exemplars)) if graph.in_loop(n)]
    lively = usable & lively_texels(levels, planes, periodic, loops)
    targets = np.where(lively.any((1, 2), keepdims=True), lively, usable)
    return Stacks(levels, planes, usable, targets, periodic)


def _left_early(graph: Graph, exemplars: Sequence[Exemplar], finest: int) -> list[int]:
    """Exemplars with an edge to themselves that is better taken a level before the finest.

    A turn of two octaves shows only their detail. In a photo whose finest octave is blurred, or with flat ground, most
    places gain nothing from it, and the two octaves before it are used. The quarter with the smallest gain decides,
    since it spreads in a zoom. Longer turns have enough detail.
    """
    early = []
    for i, j, r in with_long_turns(graph, finest).edges:
        if i == j and r == LEAST_TURN and finest > r + 2:
            late, soon = (_gain(exemplars[i], finest, end) for end in (finest, finest - 1))
            if soon > _EARLIER * late:
                early.append(i)
    return early


def _gain(exemplar: Exemplar, finest: int, end: int) -> float:
    """Gain of the quarter of an exemplar with the smallest gain, in a turn that ends on a level: rms, Lab units."""
    coarse, fine = (
        blurred(seen_values(exemplar), sigma_of(k, finest), exemplar.opaque, exemplar.periodic)
        for k in (end - LEAST_TURN, end)
    )
    power = np.square(fine - coarse).sum(-1, keepdims=True)
    local = blurred(power, 1.5 * (1 << (finest - end + LEAST_TURN)), periodic=exemplar.periodic)
    return float(np.sqrt(max(np.quantile(local, 0.25), 0.0)))


def lively_texels(levels: Levels, planes: np.ndarray, periodic: Sequence[bool], loops: Collection[int]) -> np.ndarray:
    """Texels with much detail on finer levels of their exemplar. For exemplars without loops: all.

    In an endless zoom, flat areas match flat areas, and every turn of the loop increases them (HRRG08 has no solution:
    with its candidates a zoom loses contrast). So in a loop only those texels are jumped to that have more detail
    to come than `_DULL` of all: squared differences to the level where they turn, summed over a
    neighborhood.

    `planes` (levels, side, side, 4) int16; returns (levels, side, side) bool.
    """
    lively = np.ones(planes.shape[:3], bool)
    for number, (exemplar, level) in enumerate(levels.stacks):
        last = [n for n, at in enumerate(levels.stacks) if at[0] == exemplar and levels.turns(n)]
        end = min(last, key=lambda n: levels.stacks[n][1], default=number)
        if exemplar in loops and level < levels.stacks[end][1]:
            away = planes[end].astype(np.float64) - planes[number]
            power = np.square(away).sum(-1, keepdims=True)
            detail = blurred(power, 1.5 * levels.spacing(number), periodic=periodic[number])[..., 0]
            lively[number] = detail >= np.quantile(detail, _DULL)
    return lively
