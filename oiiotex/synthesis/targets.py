# SPDX-License-Identifier: Apache-2.0
"""What is analysed of an exemplar graph: its stack levels, and which of their texels may be jumped to."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from .candidates import Stacks
from .exemplars import Graph
from .stacks import Exemplar, blurred, grid_stack
from .superexemplar import Levels, unrolled

_DULL = 0.75  # share of a level's texels that are not jumped to in a loop


def stacks_of(graph: Graph, exemplars: Sequence[Exemplar]) -> Stacks:
    """The stack levels that synthesis can come to, and which of their texels may be candidates.

    Parameters
    ----------
    graph : Graph
    exemplars : sequence of Exemplar
        All of one side.
    """
    root = exemplars[graph.root]
    finest = root.side.bit_length() - 1
    levels = unrolled(graph, finest)
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
    loops = [n for n in range(len(exemplars)) if graph.in_loop(n)]
    lively = usable & lively_texels(levels, planes, periodic, loops)
    targets = np.where(lively.any((1, 2), keepdims=True), lively, usable)
    return Stacks(levels, planes, usable, targets, periodic)


def lively_texels(levels: Levels, planes: np.ndarray, periodic: Sequence[bool], loops: Collection[int]) -> np.ndarray:
    """Texels that hold much of what their exemplar has finer than their level; all, of exemplars in no loop.

    Where a zoom never ends, flat matches flat, and every turn of the loop makes more of it (HRRG08 leaves this open:
    with its candidates a zoom loses its contrast). So in a loop only those texels are jumped to that have more detail
    to come than `_DULL` of all: squared differences to the finest level, summed up over what a neighbourhood sees.
    """
    found = np.ones(planes.shape[:3], bool)
    for number, (exemplar, level) in enumerate(levels.stacks):
        finest = (exemplar, levels.finest)
        if exemplar in loops and level < levels.finest and finest in levels.stacks:
            away = planes[levels.stacks.index(finest)].astype(np.float64) - planes[number]
            power = np.square(away).sum(-1, keepdims=True)
            detail = blurred(power, 1.5 * levels.spacing(number), periodic=periodic[number])[..., 0]
            found[number] = detail >= np.quantile(detail, _DULL)
    return found
