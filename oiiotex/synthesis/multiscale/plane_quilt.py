# SPDX-License-Identifier: Apache-2.0
"""The start of a single exemplar's plane: a torus of patches that the plane repeats (Efros & Freeman 2001; `quilting`).

Not in HRRG08, where a plane starts from one texel and jitter. Neighborhoods of 5 x 5 pixels of a level cannot put
together again what jitter has cut on a coarser one, so bricks lose their ends and pebbles are chained. Patches keep
objects whole; the levels from the start on heal their seams. Any window of a torus is known, however far away it is.
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
from ..quilting.quilt_plan import Grid
from ..quilting.quilter import Demand, Quilt, QuiltExemplar, Rules
from .stacks import Exemplar

OCTAVES = 1
LEAST_PATCH = 8  # px
_SIDES = 4  # of the exemplar: period of an unbounded plane
_MOST_SIDES = 8  # of a larger period: it is divided
_CANDIDATES, _REACH = 1024, 4
_STRIP = 1 << 20  # px of a quilt that are rendered at once


@dataclass(frozen=True)
class PlaneQuilt:
    """Texels of a level's torus.

    Attributes
    ----------
    level : int
        Of the plane. Coarser levels show every second of its pixels, and so on.
    key : str
        A hash of the torus.
    source : SourceMap
        (rows, columns): pixels of the exemplar.
    """

    level: int
    key: str
    source: SourceMap = field(repr=False, compare=False)

    def texels(self, level: int, window: Window, bits: int, shown: tuple[tuple[int, int], ...]) -> np.ndarray:
        """The texels of a window of its level or a coarser one, of a stack with these levels: (height, width)."""
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
    """Period of the start for a plane of an exemplar of that side, px: it divides the plane's, if that repeats."""
    return (_SIDES * side,) * 2 if around is None else (_divided(side, around[0]), _divided(side, around[1]))


def _divided(side: int, period: int) -> int:
    """The period in as few equal parts as are small enough; in one if these would be small."""
    step = 1 << OCTAVES
    parts = math.ceil(period / (_MOST_SIDES * side))
    while period % (step * parts):
        parts += 1
    return period // parts if period // parts >= 2 * side else period


def patch_of(exemplar: Exemplar, share: int, period: tuple[int, int]) -> int:
    """Side of a patch, px: the photo's shorter side / `share`, if such patches are valid and fit into the period."""
    usable = _usable(exemplar)
    most = min(exemplar.place.size) if usable is None else largest_window(usable)
    return min(1 << max(3, round(math.log2(min(exemplar.place.size) / share))), most, *period, 256)


def _usable(exemplar: Exemplar) -> np.ndarray | None:
    usable = None if exemplar.opaque is None else exemplar.opaque[exemplar.photo]
    return None if usable is None or usable.all() else usable


def quilted(
    device: Device, budget: int, exemplar: Exemplar, grid: Grid, seed: int, in_step: InStep | InCourses | None
) -> PlaneQuilt:
    """The start of a plane, on the torus of a grid."""
    lab = to_grid(exemplar.values[exemplar.photo][..., :3], COARSE_STEPS)
    table = content_table(*window_keys(np.ones(lab.shape[:2], np.uint8), grid.patch, _usable(exemplar)), grid.patch)
    rules = Rules(seed=seed, candidates=_CANDIDATES, reach=min(_REACH, grid.patch // 16))
    demand = Demand(np.zeros(grid.shape, np.int32))
    quilt = Quilt(device, QuiltExemplar(lab, table), grid, demand, rules, budget, in_step=in_step)
    step = 1 << OCTAVES
    rows = max(1, _STRIP // (grid.width * step)) * step
    strips = [
        quilt.sources(Window(0, top, grid.width, min(top + rows, grid.height))).packed[step // 2 :: step, step // 2 :: step]
        for top in range(0, grid.height, rows)
    ]
    source = SourceMap(np.concatenate(strips))
    return PlaneQuilt(exemplar.side.bit_length() - 1 - OCTAVES, hash_of(source.packed), source)
