# SPDX-License-Identifier: Apache-2.0
"""What a synthesis holds where: all of a tile on the device where it fits, else bands, and the rest on the host."""

from __future__ import annotations

import bisect
import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..core.image import resized
from ..core.window import Domain
from ..deferred import np
from ..errors import DeviceError
from ..opencl.buffers import require_room
from ..opencl.device import Device
from ..projections.histograms import ValueCounts
from ..projections.projection import layout as projection_layout
from ..stationarity.grid_statistics import CellGrid
from . import use_prices
from .constraints import Constraints, VaryingProjection, octaves
from .field import Geometry
from .level_rows import halo

if TYPE_CHECKING:
    from .recipe import Recipe

LEAST_ROWS = 16  # of a band
BAND_BYTES = 160 << 20  # of a band, beyond which nothing is gained
CELLS_SHARE = 1 / 4  # of the budget, for the cells of local histograms
ROWS_SHARE = 1 / 3  # of what is left, for a band
_FIELD_BYTES = 12  # of a target pixel on the host: two fields, and the places that come of them
_TEMPORARIES = 64 << 20  # bytes, at most, of what is worked on by bands on the host
_PIXEL_TEMPORARIES = 128  # of a pixel
_MOST = 1 << 20  # rows that are looked for


@dataclass(frozen=True)
class Plan:
    """Memory of a synthesis.

    Attributes
    ----------
    layout : dict of name to bytes
        Of the device.
    on_host : int
        Bytes beside it.
    stores : int
        Of these, for what the device does not hold; more goes to a file.
    """

    layout: dict[str, int]
    on_host: int
    stores: int


def level_sigmas(constraints: Constraints, geometry: Geometry, scale: float) -> np.ndarray | None:
    """The map of sigmas on a level, (height, width) float32."""
    if constraints.sigmas is None:
        return None
    return np.exp(resized(np.log(constraints.sigmas)[..., None], *geometry.size)[..., 0]) * np.float32(scale)


def plan_memory(
    device: Device, shape: tuple[int, ...], recipe: Recipe, geometries: list[Geometry], scales: list[float],
    constraints: Constraints, budget: int,
) -> Plan:  # fmt: skip
    """The plan that makes the least copies of those that fit; where none does, one that `Buffers` refuses.

    Parameters
    ----------
    device : Device
    shape : (int, int, int)
        Of the exemplar: height, width, channels.
    recipe : Recipe
    geometries, scales : list
        Of the levels.
    constraints : Constraints
    budget : int
        Bytes.
    """
    grids = grids_of(recipe, geometries, scales, constraints)

    def needed(rows: int | None, cell_rows: int | None) -> dict[str, int]:
        return layout(recipe, geometries, grids, constraints, rows, cell_rows)

    def size(rows: int | None, cell_rows: int | None) -> int:
        return sum(needed(rows, cell_rows).values())

    pixels = recipe.width * recipe.height
    on_host = 2 * 4 * shape[0] * shape[1] * shape[2] + min(_TEMPORARIES, _PIXEL_TEMPORARIES * pixels)
    if recipe.complete:  # the activity of patches
        on_host += 4 * shape[0] * shape[1]
    if constraints.fixed is not None:
        on_host += 2 * shape[2] * 4 * pixels
    if constraints.sigmas is not None:
        on_host += 2 * 4 * pixels
    least, none = halo(recipe.patch) + LEAST_ROWS, size(None, 1)
    cells = None
    if size(None, None) - none > budget * CELLS_SHARE:
        cells = _most(lambda n: size(None, n) - none <= budget * CELLS_SHARE, 1)
    whole = needed(None, cells)
    with contextlib.suppress(DeviceError):
        require_room(device, whole, budget, "", on_host + _FIELD_BYTES * pixels)
        return Plan(whole, on_host + _FIELD_BYTES * pixels, 0)
    room = device.memory_budget(budget) - device.taken - (0 if device.own_memory else on_host)
    room = (room - size(least, cells)) * ROWS_SHARE
    rows = _most(lambda n: size(n, cells) - size(least, cells) <= min(room, BAND_BYTES), least)
    banded = needed(min(rows, recipe.height), cells)
    left = budget - on_host - (0 if device.own_memory else sum(banded.values()))
    return Plan(banded, on_host + max(0, left), max(0, left))


def _most(fits: Callable[[int], bool], least: int) -> int:
    """The largest number, `least` or more, that fits."""
    return least + bisect.bisect_left(range(1, _MOST), True, key=lambda more: not fits(least + more))


Grids = tuple[list[CellGrid], CellGrid | None]
"""The cells of the target's projections on a level, and of the exemplar's."""


def grids_of(recipe: Recipe, geometries: list[Geometry], scales: list[float], constraints: Constraints) -> list[Grids]:
    """Those of every level."""
    if recipe.sigma is None:
        return [([], None)] * len(scales)
    grids = []
    for geometry, scale in zip(geometries, scales, strict=True):
        sigmas = level_sigmas(constraints, geometry, scale)
        stack = [recipe.sigma * scale] if sigmas is None else octaves(sigmas)
        plane = Domain(geometry.exemplar_width, geometry.exemplar_height)
        own = CellGrid.of(plane, recipe.sigma * scale) if recipe.contrast > 0 and recipe.flat else None
        grids.append(([CellGrid.of(geometry, sigma) for sigma in stack], own))
    return grids


def layout(
    recipe: Recipe, geometries: list[Geometry], grids: list[Grids], constraints: Constraints,
    rows: int | None = None, cell_rows: int | None = None,
) -> dict[str, int]:  # fmt: skip
    """Device memory that every level fits into, in bytes by name.

    A projection goes into `target`, which stands empty between two searches, and changes places with `image`: they are
    of one size.

    Parameters
    ----------
    recipe : Recipe
    geometries : list of Geometry
    grids : list of Grids
        Of the levels.
    constraints : Constraints
    rows : int or None
        Of the finest level that are held; None: all.
    cell_rows : int or None
        As of `histograms.layout`.
    """
    finest, channels = geometries[-1], geometries[-1].channels
    held = finest.height if rows is None else rows
    needed = finest.layout(rows) | ValueCounts.layout(channels)
    if constraints.sigmas is not None:
        needed |= VaryingProjection.layout(finest.width, held, channels)
    if recipe.complete:
        needed |= use_prices.layout(finest)
    if constraints.fixed is not None:
        needed |= {"fixed": 2 * channels * finest.width * held, "ease": finest.width * held}
    for geometry, (own, of_exemplar) in zip(geometries, grids, strict=True):
        at_once = geometry.height if rows is None else min(geometry.height, held * finest.width // geometry.width)
        uses = [(grid, at_once, number) for number, grid in enumerate(own)]
        if of_exemplar is not None:
            least = of_exemplar.height if rows is None else min(of_exemplar.height, held)
            uses.append((of_exemplar, least, 0))
        for grid, n, number in uses:
            for name, need in projection_layout(recipe.measure, grid, channels, n, cell_rows, number).items():
                needed[name] = max(needed.get(name, 0), need)
    both = max(needed["image"], needed["target"])
    if recipe.contrast > 0:  # the exemplar is counted there
        pixels = finest.exemplar_width * (finest.exemplar_height if rows is None else min(finest.exemplar_height, held))
        both = max(both, 2 * channels * pixels)
    return needed | {"image": both, "target": both}
