# SPDX-License-Identifier: Apache-2.0
"""Levels that are finished, kept beside the file that is being made, so that a run that was killed goes on after them.

A level hands the next one its field and the prices of what is flat; all else follows from the exemplar.
"""

from __future__ import annotations

from collections.abc import Sequence

from .. import __version__
from ..core.demand import SomeRows
from ..core.scratch import RowStore
from ..core.source_map import SourceMap
from ..core.window import Window
from ..deferred import np
from ..errors import present
from ..io.checkpoint import Checkpoint
from ..io.disk_cache import hash_of
from .constraints import Constraints
from .field import Geometry
from .recipe import Recipe

_PIECE = 1 << 21  # matches kept at a time


class LevelCheckpoint:
    """What is kept of one synthesis."""

    def __init__(
        self, keeper: Checkpoint, exemplar: SomeRows, allowed: np.ndarray | None, recipe: Recipe,
        constraints: Constraints,
    ):  # fmt: skip
        facts: list[object] = [constraints.weight, constraints.sigmas]
        if constraints.fixed is not None:
            facts += [constraints.fixed.where, constraints.fixed.places.packed, constraints.fixed.is_goal]
        if recipe.in_step is not None:  # large arrays print in part alone
            facts += recipe.in_step.facts()
        self._keeper, self._key = keeper, hash_of(__version__, exemplar, allowed, recipe, *facts)

    def latest(self, geometries: Sequence[Geometry]) -> int:
        """The finest level of which all is there; -1 where there is none."""
        for level, geometry in reversed(list(enumerate(geometries))):
            key = self._of(level)
            if all(self._keeper.holds(key, place) for place in (_beside(geometry), *_pieces(geometry))):
                return level
        return -1

    def field(self, level: int, geometry: Geometry, out: np.ndarray | RowStore) -> SourceMap:
        """The field of a level that is there, put into `out` (rows, columns)."""
        for place in _pieces(geometry):
            out[place.top : place.bottom] = present(self._keeper.kept(self._of(level), place))
        return SourceMap.of_rows(out)

    def prices(self, level: int, geometry: Geometry) -> np.ndarray:
        """What was kept as `prices` of a level that is there."""
        return present(self._keeper.kept(self._of(level), _beside(geometry)))

    def keep(self, level: int, geometry: Geometry, field: SourceMap, prices: np.ndarray) -> None:
        """Keep a level: its field, (rows, columns), and any array of what else it hands on."""
        for place in _pieces(geometry):
            self._keeper.keep(self._of(level), place, field.packed[place.top : place.bottom])
        self._keeper.keep(self._of(level), _beside(geometry), prices)

    def _of(self, level: int) -> str:
        return hash_of(self._key, level)


def _pieces(geometry: Geometry) -> list[Window]:
    rows = max(1, _PIECE // geometry.columns)
    return [Window(0, top, geometry.columns, min(top + rows, geometry.rows)) for top in range(0, geometry.rows, rows)]


def _beside(geometry: Geometry) -> Window:
    """A place that no piece of the field has."""
    return Window(0, -1, geometry.columns, 0)
