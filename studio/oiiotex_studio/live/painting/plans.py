# SPDX-License-Identifier: Apache-2.0
"""Plans of paintings: where two of them differ, and a plan of another size from an existing one (LSA16 6.2)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from oiiotex.engine.deferred import np

from ...api.images import Window
from ...api.painting import TILE, Grid, QuiltPlan, read_arrays


def regridded(path: Path, budget: int, times: int = 1, size: tuple[int, int] | None = None) -> dict[str, np.ndarray]:
    """A larger or smaller plan with the patches of a painting's plan, as the arrays of its file.

    Patches are photo pixels and are not scaled. `times` larger: a cell becomes times x times cells, of which all but
    the first are free. Another `size`: patches keep their places, and cells beyond are free. As `fromplan=` of
    --texpaint, the patches whose labels are still demanded there are kept.

    Parameters
    ----------
    path : Path
        Plan of the painting.
    budget : int
        Memory budget in bytes.
    size : (int, int), optional
        Width and height, px. Default: those of the painting times `times`.

    Raises
    ------
    ImageError
        The plan cannot be read.
    """
    arrays = read_arrays(path, budget)
    layers = [layer for layer in ("", "fine_") if f"{layer}facts" in arrays]
    larger: dict[str, np.ndarray] = {}
    for layer in layers:
        larger |= {f"{layer}{name}": array for name, array in _regridded(arrays, layer, times, size, path).items()}
    return larger


def _regridded(
    arrays: dict[str, np.ndarray], layer: str, times: int, size: tuple[int, int] | None, path: Path
) -> dict[str, np.ndarray]:
    """A layer's arrays."""
    plan, exemplar = QuiltPlan.of(arrays, path, layer)
    small = plan.grid
    width, height = size or (times * small.width, times * small.height)
    grid = Grid(width, height, patch=small.patch, overlap=small.overlap)
    keys, guide = (arrays[f"{layer}{name}"] for name in ("keys", "guide"))
    rows, columns = (min(a, -(-b // times)) for a, b in zip(small.shape, grid.shape, strict=True))
    corners = slice(0, times * (rows - 1) + 1, times), slice(0, times * (columns - 1) + 1, times)
    cuts = np.zeros((2, *grid.shape, grid.patch), np.uint8)
    cells = {
        "offsets": np.zeros(grid.shape, np.uint32),
        "keys": np.full(grid.shape, -1, keys.dtype),  # never demanded
        "guide": np.zeros((*grid.shape, *guide.shape[2:]), guide.dtype),
    }
    for name, values in (("offsets", plan.offsets), ("keys", keys), ("guide", guide)):
        cells[name][corners] = values[:rows, :columns]
    if times == 1:  # else no neighbor is kept, and cuts are made with the neighbors
        for cut, old in zip(cuts, (plan.vertical, plan.horizontal), strict=True):
            cut[corners] = old[:rows, :columns]
    return QuiltPlan(grid, cells["offsets"], *cuts).arrays(exemplar) | cells


def changed_box(before: Path, after: Path, fine: tuple[np.ndarray, np.ndarray], budget: int) -> Window | None:
    """The bounding box of the pixels that differ between two paintings. None: their sizes differ.

    Pixels outside cannot differ: they depend on equal patches, and on a cut within an equal tile.

    Parameters
    ----------
    before, after : Path
        Plans of the paintings.
    fine : 2 x (height, width) uint8
        Their fine layers. 0: not painted.
    budget : int
        Memory budget in bytes.

    Raises
    ------
    ImageError
        A plan cannot be read.
    """
    old, new = (read_arrays(path, budget) for path in (before, after))
    if not np.array_equal(old["facts"], new["facts"]):
        return None
    whole, box = Window(0, 0, *map(int, new["facts"][1:3])), _changed_cells(old, new, "")
    seen, was = (layer > 0 for layer in fine)
    either = _around(seen | was)
    if not either.empty:
        over = either if "fine_facts" not in old or "fine_facts" not in new else _changed_cells(old, new, "fine_")
        band = TILE // 4  # maximum distance of a cut from the painted border, `SeamOverlay.band`
        over = _both(over & _grown(either, band), _grown(_around(seen ^ was), band))
        box = _in_tiles(_both(box, over))
    return box & whole


def _changed_cells(old: dict[str, Any], new: dict[str, Any], layer: str) -> Window:
    """Bounding box of the pixels of cells with another patch or another cut."""
    patch, overlap = map(int, new[f"{layer}facts"][3:5])
    differs = old[f"{layer}offsets"] != new[f"{layer}offsets"]
    for name in ("vertical", "horizontal"):
        cuts = old[f"{layer}{name}"] != new[f"{layer}{name}"]
        differs |= cuts.any(axis=tuple(range(2, cuts.ndim)))
    cells, pitch = _around(differs), patch - overlap
    if cells.empty:
        return cells
    left, top, right, bottom = (pitch * n for n in cells)
    return Window(max(0, left - patch), max(0, top - patch), right + patch, bottom + patch)


def _around(where: np.ndarray) -> Window:
    """Bounding box of a mask."""
    rows, columns = (np.flatnonzero(where.any(axis)) for axis in (1, 0))
    if not len(rows):
        return Window(0, 0, 0, 0)
    return Window(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def _grown(box: Window, by: int) -> Window:
    return box if box.empty else box.grown(by)


def _both(one: Window, other: Window) -> Window:
    """Bounding box of two windows, either of which may be empty."""
    return other if one.empty else one if other.empty else one | other


def _in_tiles(box: Window) -> Window:
    """Bounding box of all tiles that it touches: cuts are made per tile."""
    if box.empty:
        return box
    left, top, right, bottom = box
    return Window(left // TILE * TILE, top // TILE * TILE, -(-right // TILE) * TILE, -(-bottom // TILE) * TILE)
