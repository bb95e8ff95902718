# SPDX-License-Identifier: Apache-2.0
"""The memory plan of a synthesis: a whole tile on the device if it fits, else bands, with the rest on the host."""

from __future__ import annotations

import bisect
import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...analysis.stationarity.grid_statistics import CellGrid
from ...engine.core.demand import resized
from ...engine.core.window import Domain
from ...engine.deferred import np
from ...engine.errors import DeviceError, MemoryBudgetError
from ...engine.opencl.buffers import require_room
from ...engine.opencl.device import DeviceMemory
from ..projections.histograms import ValueCounts
from ..projections.projection import layout as projection_layout
from . import use_prices
from .constraints import Constraints, VaryingProjection, sigma_octaves
from .exemplar_rows import LEAST_ROWS, piece_halo
from .field import Geometry
from .level_rows import halo

if TYPE_CHECKING:
    from .recipe import Recipe

COUNTED_ROWS = 64  # rows of an exemplar in pieces, per histogram step
BAND_BYTES = 160 << 20  # maximum size of a band: larger ones are not faster
CELLS_SHARE = 1 / 4  # share of the budget for the cells of local histograms
ROWS_SHARE = 1 / 3  # share of the rest for a band
OUT_OF_CORE_SHARE = 5 / 8  # of the budget, for a plan in bands: the rest is decoded pieces, libraries and temporaries
_FIELD_BYTES = 12  # per target pixel on the host: two fields, and the resulting places
_TEMPORARIES = 64 << 20  # bytes, maximum, of temporaries by bands on the host
_PIXEL_TEMPORARIES = 128  # per pixel
_WEIGHT_BYTES = 12  # per exemplar pixel: its weight, the weight of its patch, and the resulting cost
_MASK_BYTES = 4  # the same for masks of usable pixels and patches; 1 if all are usable
_MOST = 1 << 20  # maximum number of rows to search


@dataclass(frozen=True)
class ExemplarHeld:
    """What is in memory of an exemplar under any plan.

    Attributes
    ----------
    values : bool
        Its pixels. Otherwise they are in a file.
    masked : bool
        The mask of usable pixels.
    """

    values: bool = True
    masked: bool = False


@dataclass(frozen=True)
class MemoryPlan:
    """Memory of a synthesis.

    `exemplar_whole`: the exemplar's planes are in memory. Otherwise they pass through the device in pieces, from files.
    """

    layout: dict[str, int]  # of the device, bytes by name
    on_host: int  # bytes of host memory
    stores: int  # bytes of these for planes that the device does not hold; the rest is in a file
    exemplar_whole: bool = True


def level_sigmas(constraints: Constraints, geometry: Geometry, scale: float) -> np.ndarray | None:
    """The map of sigmas on a level, (height, width) float32."""
    if constraints.sigmas is None:
        return None
    return np.exp(resized(np.log(constraints.sigmas)[..., None], *geometry.size)[..., 0]) * np.float32(scale)


def plan_memory(
    device: DeviceMemory, shape: tuple[int, ...], recipe: Recipe, geometries: list[Geometry], scales: list[float],
    constraints: Constraints, budget: int, held: ExemplarHeld,
) -> MemoryPlan:  # fmt: skip
    """The fastest memory plan that fits. If none fits, one that `Buffers` refuses.

    `budget`: bytes.
    """
    grids = grids_of(recipe, geometries, scales, constraints)

    def needed(rows: int | None, cell_rows: int | None, exemplar_rows: int | None = None) -> dict[str, int]:
        return layout(recipe, geometries, grids, constraints, rows, cell_rows, exemplar_rows)

    def size(*held: int | None) -> int:
        return sum(needed(*held).values())

    pixels, of_exemplar = recipe.width * recipe.height, shape[0] * shape[1]
    common = 0
    if constraints.fixed is not None:
        common += 2 * shape[2] * 4 * pixels
    if constraints.sigmas is not None:
        common += 2 * 4 * pixels
    if constraints.weight is not None:
        common += _WEIGHT_BYTES * of_exemplar
    on_host = common + min(_TEMPORARIES, _PIXEL_TEMPORARIES * pixels) + 2 * 4 * shape[2] * of_exemplar
    on_host += 4 * (shape[2] + held.masked) * of_exemplar // 3  # octaves
    if recipe.complete:  # activity of patches
        on_host += 4 * of_exemplar
    least, none = halo(recipe.patch) + LEAST_ROWS, size(None, 1)
    cells = None
    if size(None, None) - none > budget * CELLS_SHARE:
        cells = _most(lambda n: size(None, n) - none <= budget * CELLS_SHARE, 1)
    whole = needed(None, cells)
    with contextlib.suppress(DeviceError, MemoryBudgetError):
        require_room(device, whole, budget, "", on_host + _FIELD_BYTES * pixels)
        return MemoryPlan(whole, on_host + _FIELD_BYTES * pixels, 0)

    beside = budget - int(OUT_OF_CORE_SHARE * budget)

    def room_beside(on_host: int) -> int:
        return device.memory_budget(budget) - device.taken - (0 if device.own_memory else on_host + beside)

    def banded(on_host: int, rows: int | None, exemplar_rows: int | None = None) -> MemoryPlan:
        layout = needed(rows, cells, exemplar_rows)
        left = max(0, budget - beside - on_host - (0 if device.own_memory else sum(layout.values())))
        return MemoryPlan(layout, on_host + left, left, exemplar_rows is None)

    def rows_in(room: float, *exemplar_rows: int) -> int:
        rows = _most(lambda n: size(n, cells, *exemplar_rows) - size(least, cells, *exemplar_rows) <= room, least)
        return min(rows, recipe.height)

    rows = rows_in(min((room_beside(on_host) - size(least, cells)) * ROWS_SHARE, BAND_BYTES))
    plan = banded(on_host, rows)
    with contextlib.suppress(DeviceError, MemoryBudgetError):
        require_room(device, plan.layout, budget, "", on_host)
        return plan

    on_host = common + min(_TEMPORARIES, _PIXEL_TEMPORARIES * max(pixels, of_exemplar))
    on_host += (_MASK_BYTES if held.masked else 1) * of_exemplar
    if held.values:
        on_host += 4 * shape[2] * of_exemplar
    room, least_piece = room_beside(on_host), piece_halo(recipe.patch) + LEAST_ROWS
    target: int | None = None
    if size(None, cells, least_piece) + _FIELD_BYTES * pixels > room / 2:
        target = rows_in(max(0, room - size(least, cells, least_piece)) / 2, least_piece)
    else:
        on_host += _FIELD_BYTES * pixels
        room -= _FIELD_BYTES * pixels
    pieces = _most(lambda n: size(target, cells, n) <= room, least_piece)
    in_pieces = banded(on_host, target, min(pieces, shape[0]))
    return min(in_pieces, plan, key=lambda one: max(budget, one.on_host + sum(one.layout.values())))


def _most(fits: Callable[[int], bool], least: int) -> int:
    """The largest number, at least `least`, that fits."""
    return least + bisect.bisect_left(range(1, _MOST), True, key=lambda more: not fits(least + more))


Grids = tuple[list[CellGrid], CellGrid | None]
"""The cells of the target's projections on a level, and those of the exemplar's."""


def grids_of(recipe: Recipe, geometries: list[Geometry], scales: list[float], constraints: Constraints) -> list[Grids]:
    """The grids of every level."""
    if recipe.sigma is None:
        return [([], None)] * len(scales)
    grids = []
    for geometry, scale in zip(geometries, scales, strict=True):
        sigmas = level_sigmas(constraints, geometry, scale)
        stack = [recipe.sigma * scale] if sigmas is None else sigma_octaves(sigmas)
        plane = Domain(geometry.exemplar_width, geometry.exemplar_height)
        own = CellGrid.of(plane, recipe.sigma * scale) if recipe.contrast > 0 and recipe.flat else None
        grids.append(([CellGrid.of(geometry, sigma) for sigma in stack], own))
    return grids


def layout(
    recipe: Recipe, geometries: list[Geometry], grids: list[Grids], constraints: Constraints,
    rows: int | None = None, cell_rows: int | None = None, exemplar_rows: int | None = None,
) -> dict[str, int]:  # fmt: skip
    """Device memory that fits every level, in bytes by name.

    A projection is written to `target`, which is unused between two searches, and then swapped with `image`: both have
    the same size.
    """
    finest, channels = geometries[-1], geometries[-1].channels
    held = finest.height if rows is None else rows
    counted = rows if exemplar_rows is None else halo(recipe.patch) + COUNTED_ROWS
    needed = finest.layout(rows, exemplar_rows) | ValueCounts.layout(channels)
    if constraints.sigmas is not None:
        needed |= VaryingProjection.layout(finest.width, held, channels)
    if recipe.complete:
        needed |= use_prices.layout(finest, exemplar_rows)
    if constraints.fixed is not None:
        needed |= {"fixed": 2 * channels * finest.width * held, "ease": finest.width * held}
    for geometry, (own, of_exemplar) in zip(geometries, grids, strict=True):
        at_once = geometry.height if rows is None else min(geometry.height, held * finest.width // geometry.width)
        uses = [(grid, at_once, number) for number, grid in enumerate(own)]
        if of_exemplar is not None:
            least = of_exemplar.height if counted is None else min(of_exemplar.height, counted)
            uses.append((of_exemplar, least, 0))
        for grid, n, number in uses:
            for name, need in projection_layout(recipe.measure, grid, channels, n, cell_rows, number).items():
                needed[name] = max(needed.get(name, 0), need)
    both = max(needed["image"], needed["target"])
    if recipe.contrast > 0:  # the exemplar's histogram is computed there
        pixels = finest.exemplar_width * min(finest.exemplar_height, counted or finest.exemplar_height)
        both = max(both, 2 * channels * pixels)
    return needed | {"image": both, "target": both}
