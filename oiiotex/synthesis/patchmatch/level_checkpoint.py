# SPDX-License-Identifier: Apache-2.0
"""Checkpoints of finished pyramid levels, next to the output file, from which an interrupted run resumes.

A level passes its field and the flatness multipliers to the next one. All else follows from the exemplar.
"""

from __future__ import annotations

from collections.abc import Sequence

from ... import __version__
from ...engine.core.demand import SomeRows
from ...engine.core.scratch import RowStore
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import present
from ...engine.io.checkpoint import Checkpoint
from ...engine.io.disk_cache import hash_of
from .constraints import Constraints
from .field import Geometry
from .recipe import Recipe

_PIECE = 1 << 21  # matches written at a time


class LevelCheckpoint:
    """The checkpoint of one synthesis."""

    def __init__(
        self, keeper: Checkpoint, exemplar: SomeRows, allowed: np.ndarray | None, recipe: Recipe,
        constraints: Constraints,
    ):  # fmt: skip
        facts: list[object] = [constraints.weight, constraints.sigmas]
        if constraints.fixed is not None:
            fixed = constraints.fixed
            places = None if fixed.places is None else fixed.places.packed
            facts += [fixed.where, places, fixed.values]
        if recipe.in_step is not None:  # NumPy abbreviates large arrays when it prints them
            facts += recipe.in_step.facts()
        self._keeper, self._key = keeper, hash_of(__version__, exemplar, allowed, recipe, *facts)

    def latest(self, geometries: Sequence[Geometry]) -> int:
        """The finest complete level in the checkpoint. -1: none."""
        for level, geometry in reversed(list(enumerate(geometries))):
            key = self._of(level)
            if all(self._keeper.holds(key, place) for place in (_beside(geometry), *_pieces(geometry))):
                return level
        return -1

    def field(self, level: int, geometry: Geometry, out: np.ndarray | RowStore) -> SourceMap:
        """The field of a level in the checkpoint, read into `out` (rows, columns)."""
        for place in _pieces(geometry):
            out[place.top : place.bottom] = present(self._keeper.kept(self._of(level), place))
        return SourceMap.of_rows(out)

    def prices(self, level: int, geometry: Geometry) -> np.ndarray:
        """The `prices` kept with a level in the checkpoint."""
        return present(self._keeper.kept(self._of(level), _beside(geometry)))

    def keep(self, level: int, geometry: Geometry, field: SourceMap, prices: np.ndarray) -> None:
        """Write a level: its field, (rows, columns), and an array of whatever else it passes on."""
        for place in _pieces(geometry):
            self._keeper.keep(self._of(level), place, field.packed[place.top : place.bottom])
        self._keeper.keep(self._of(level), _beside(geometry), prices)

    def _of(self, level: int) -> str:
        return hash_of(self._key, level)


def _pieces(geometry: Geometry) -> list[Window]:
    rows = max(1, _PIECE // geometry.columns)
    return [Window(0, top, geometry.columns, min(top + rows, geometry.rows)) for top in range(0, geometry.rows, rows)]


def _beside(geometry: Geometry) -> Window:
    """A window that no piece of the field has."""
    return Window(0, -1, geometry.columns, 0)
