# SPDX-License-Identifier: Apache-2.0
"""The start of a single exemplar's plane: a torus of patches that the plane repeats (Efros & Freeman 2001; `quilting`).

Not in HRRG08, where a plane starts from one texel and jitter. Neighborhoods of 5 x 5 pixels of a level cannot put
together again what jitter has cut on a coarser one, so bricks lose their ends and pebbles are chained. Patches keep
objects whole, and correction on finer levels heals their seams. Any window of a torus is known, however far away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ...analysis.labels.content_table import content_table, largest_window, window_keys
from ...analysis.regularity.courses import InCourses
from ...analysis.regularity.offset_prices import InStep
from ...engine.color.lab_grid import COARSE_STEPS, to_grid
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.io.disk_cache import hash_of
from ...engine.opencl.device import Device
from ..quilting.quilt_plan import MOST_PATCH, Grid
from ..quilting.quilter import Demand, Quilt, QuiltExemplar, Rules
from .stacks import Exemplar

OCTAVES = 1
LEAST_PATCH = 8  # px
_SIDES = 4  # of the exemplar: period of an unbounded plane
_MOST_SIDES = 8  # of a larger period: it is divided
_CANDIDATES, _REACH = 1024, 4  # patches compared per cell; px by which the best may be moved
_STRIP = 1 << 20  # px of a quilt that are rendered at once
_PICKED = slice((1 << OCTAVES) // 2, None, 1 << OCTAVES)  # of them: the middles of the start's pixels, rounded up


@dataclass(frozen=True)
class PlaneQuilt:
    """Texels of a level's torus.

    Attributes
    ----------
    level : int
        Of the plane. The next coarser one shows every second pixel along x and y, and so on.
    key : str
        A hash of the torus.
    source : SourceMap
        (rows, columns): pixels of the exemplar.
    """

    level: int
    key: str
    source: SourceMap = field(repr=False, compare=False)

    def texels(self, level: int, window: Window, bits: int, shown: tuple[tuple[int, int], ...]) -> np.ndarray:
        """The texels of a window of its level or a coarser one, (height, width) uint32.

        `bits`: log2 of the exemplar's side. `shown`: the stack levels, by number.
        """
        apart = 1 << (self.level - level)
        rows, columns = (
            (np.arange(*ends) * apart + apart // 2) % size
            for ends, size in zip(
                ((window.top, window.bottom), (window.left, window.right)), self.source.packed.shape, strict=True
            )
        )
        number = [at for _, at in shown].index(level)
        packed = SourceMap.of(*self.source[np.ix_(rows, columns)].yx, bits=bits).packed
        return packed | np.uint32(number << 2 * bits)


def period_of(side: int, around: tuple[int, int] | None) -> tuple[int, int]:
    """Period of the start of a plane, px: of a plane that repeats after `around` px, a part of that.

    `side`: of the exemplar, px.
    """
    return (_SIDES * side,) * 2 if around is None else (_part(side, around[0]), _part(side, around[1]))


def _part(side: int, period: int) -> int:
    """One of as few equal parts of a period as are small enough; the whole if parts would be small."""
    parts = math.ceil(period / (_MOST_SIDES * side))
    while period % (parts << OCTAVES) and period >= 2 * side * parts:
        parts += 1
    return period // parts if period >= 2 * side * parts else period


def patch_of(exemplar: Exemplar, share: float, period: tuple[int, int]) -> int:
    """Side of a patch, px: about the photo's shorter side / `share`, and such that valid patches exist."""
    shorter, valid = min(exemplar.place.size), _valid(exemplar)
    side = 1 << round(math.log2(max(LEAST_PATCH, shorter / share)))
    return min(side, shorter if valid is None else largest_window(valid), *period, MOST_PATCH)


def _valid(exemplar: Exemplar) -> np.ndarray | None:
    """Pixels of the photo that patches may hold, (height, width) bool; None: all.

    All if they hold no patch: correction replaces those that are not opaque.
    """
    if exemplar.opaque is None:
        return None
    valid = exemplar.opaque[exemplar.photo]
    return None if valid.all() or largest_window(valid) < LEAST_PATCH else valid


def quilted(
    device: Device, budget: int, exemplar: Exemplar, grid: Grid, seed: int, in_step: InStep | InCourses | None
) -> PlaneQuilt:
    """The start of a plane, on the torus of a grid in pixels of the exemplar.

    `in_step`: lattice or courses of the photo, if the plane keeps them.
    """
    lab = to_grid(exemplar.values[exemplar.photo][..., :3], COARSE_STEPS)
    table = content_table(*window_keys(np.ones(lab.shape[:2], np.uint8), grid.patch, _valid(exemplar)), grid.patch)
    rules = Rules(seed=seed, candidates=_CANDIDATES, reach=min(_REACH, grid.patch // 16))
    demand = Demand(np.zeros(grid.shape, np.int32))
    quilt = Quilt(device, QuiltExemplar(lab, table), grid, demand, rules, budget, in_step=in_step)
    rows = max(1, _STRIP // (grid.width << OCTAVES)) << OCTAVES
    strips = [
        quilt.sources(Window(0, top, grid.width, min(top + rows, grid.height))).packed[_PICKED, _PICKED]
        for top in range(0, grid.height, rows)
    ]
    source = SourceMap(np.concatenate(strips))
    return PlaneQuilt(exemplar.side.bit_length() - 1 - OCTAVES, hash_of(source.packed), source)
