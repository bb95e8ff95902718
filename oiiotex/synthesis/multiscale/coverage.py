# SPDX-License-Identifier: Apache-2.0
"""Parts of an analyzed exemplar graph that will not appear, predicted before synthesis: HRRG08 section 8.

Exemplars that never match best do not appear. Regions without a finer match appear with large changes of color, or
with the structure of something else.
"""

from __future__ import annotations

from typing import NamedTuple

from ...engine.color.lab_grid import FINE_STEPS
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from .candidate_sets import Analysis, neighborhoods
from .graph import Graph

FAR = 15.0  # Lab units between the means of two neighborhoods without similarity
RARE = 0.01  # an exemplar that is a candidate of a smaller share of the texels that it may replace does not appear
MUCH = 0.1  # share of an exemplar without a match that is visible


class Share(NamedTuple):
    """Share of the texels that an exemplar may replace of which it is a candidate, 0 to 1."""

    exemplar: int
    share: float


class Unmatched(NamedTuple):
    """The part of an exemplar's last level without a match.

    `share`: 0 to 1. (x, y): middle of the worst texel, in px of the exemplar. `away`: its color difference, Lab
    units.
    """

    exemplar: int
    share: float
    x: int
    y: int
    away: float


def shares(graph: Graph, analysis: Analysis) -> tuple[Share, ...]:
    """The shares of every exemplar that may replace another."""
    levels = analysis.stacks.levels
    of = np.array([exemplar for exemplar, _ in levels.stacks])
    entries = []
    for n in range(len(graph.names)):
        numbers = [m for m, onward in enumerate(levels.admissible) if of[m] != n and n in of[[k for k, _ in onward]]]
        if numbers:
            into = of[SourceMap(analysis.links[numbers], analysis.stacks.side_bits).number]
            entries.append(Share(n, float((into == n).any(-1).mean())))
    return tuple(entries)


def unmatched(analysis: Analysis) -> tuple[Unmatched, ...]:
    """For every exemplar that leads to others: texels whose first candidate's mean is more than `FAR` away."""
    stacks = analysis.stacks
    texels, side = stacks.planes[0].shape[0] ** 2, stacks.planes.shape[1]
    gaps = []
    for number, onward in enumerate(stacks.levels.admissible):
        exemplar = stacks.levels.stacks[number][0]
        if any(stacks.levels.stacks[to][0] == exemplar for to, _ in onward):
            continue
        means = {n: _means(analysis, n) for n in {number, *(to for to, _ in onward)}}
        link = SourceMap(analysis.links[number, :, 0], stacks.side_bits)
        target = np.empty((texels, 3))
        for to, _ in onward:
            here = link.number == to
            target[here] = means[to][link[here].flat(side)]
        away = np.sqrt(np.square(means[number] - target).sum(-1)) / FINE_STEPS
        away[~stacks.usable[number].ravel()] = 0
        y, x = divmod(int(away.argmax()), side)
        gaps.append(Unmatched(exemplar, float((away > FAR).mean()), x, y, float(away.max())))
    return tuple(gaps)


def _means(analysis: Analysis, number: int) -> np.ndarray:
    """(side^2, 3): means of the neighborhoods of a level."""
    stacks = analysis.stacks
    seen = neighborhoods(stacks.planes[number], stacks.levels.spacing(number), stacks.periodic[number])
    return seen.reshape(-1, 25, 3).mean(1)
