# SPDX-License-Identifier: Apache-2.0
"""A painting in files: labels as indexed PNGs with the legend in them; plans compared, enlarged."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..core.window import Window
from ..deferred import np
from ..graphcut.seam_overlay import TILE
from ..io.atomic import temporary_beside
from ..quilting.quilt_plan import Grid, Plan

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PAINTED = frozenset((".png", ".exr", ".tif", ".tiff"))
_MOST_OFFERED = 500


def write_indexed(
    path: Path, ids: np.ndarray, colours: dict[int, tuple[int, int, int]], legend: dict[str, Any]
) -> None:
    """Write ids, (height, width) uint8, as a PNG whose palette has their colours, and a legend as its text.

    OpenImageIO writes no palettes.

    Raises
    ------
    ImageError
        The file cannot be written.
    """
    height, width = ids.shape
    palette = bytes(channel for index in range(256) for channel in colours.get(index, (0, 0, 0)))
    rows = np.zeros((height, width + 1), np.uint8)  # each begins with the number of its filter, none
    rows[:, 1:] = ids
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)),
        (b"PLTE", palette),
        (b"tEXt", b"oiiotex:legend\0" + json.dumps(legend).encode()),
        (b"IDAT", zlib.compress(rows.tobytes(), 3)),
        (b"IEND", b""),
    )
    with temporary_beside(path) as temporary, open(temporary, "wb") as file:
        file.write(_SIGNATURE)
        for name, data in chunks:
            file.write(struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)))


def paintings_in(folders: Iterable[Path]) -> dict[str, Path]:
    """Files of folders that may be paintings, the first _MOST_OFFERED by name; links are none.

    X.fine.png is the fine layer of X.png, and no painting of its own.
    """
    entries = (entry for folder in dict.fromkeys(folders) if folder.is_dir() for entry in folder.iterdir())
    offered = sorted(
        entry
        for entry in entries
        if entry.suffix.lower() in _PAINTED and Path(entry.stem).suffix != ".fine"
        if entry.is_file() and not entry.is_symlink()
    )
    return {str(path): path for path in offered[:_MOST_OFFERED]}


def fine_of(path: Path) -> Path:
    """Where the fine layer of a painting is, if it has one."""
    return path.with_name(f"{path.stem}.fine{path.suffix}")


def enlarged(arrays: dict[str, np.ndarray], layer: str, times: int, path: Path) -> dict[str, np.ndarray]:
    """A layer's arrays."""
    plan, exemplar = Plan.of(arrays, path, layer)
    small = plan.grid
    grid = Grid(times * small.width, times * small.height, patch=small.patch, overlap=small.overlap)
    keys, guide = (arrays[f"{layer}{name}"] for name in ("keys", "guide"))
    rows, columns = small.shape
    corners = slice(0, times * (rows - 1) + 1, times), slice(0, times * (columns - 1) + 1, times)
    cells = {
        "offsets": np.zeros(grid.shape, np.uint32),
        "keys": np.full(grid.shape, -1, keys.dtype),  # is asked for nowhere
        "guide": np.zeros((*grid.shape, *guide.shape[2:]), guide.dtype),
    }
    for name, values in (("offsets", plan.offsets), ("keys", keys), ("guide", guide)):
        cells[name][corners] = values
    # cuts are made when their neighbours are, none of which is kept
    return Plan(grid, cells["offsets"], *np.zeros((2, *grid.shape, grid.patch), np.uint8)).arrays(exemplar) | cells


def changed_cells(old: dict[str, Any], new: dict[str, Any], layer: str) -> Window:
    """Around the pixels of cells that have another patch or another cut."""
    patch, overlap = map(int, new[f"{layer}facts"][3:5])
    differs = old[f"{layer}offsets"] != new[f"{layer}offsets"]
    for name in ("vertical", "horizontal"):
        cuts = old[f"{layer}{name}"] != new[f"{layer}{name}"]
        differs |= cuts.any(axis=tuple(range(2, cuts.ndim)))
    cells, pitch = around(differs), patch - overlap
    if cells.empty:
        return cells
    left, top, right, bottom = (pitch * n for n in cells)
    return Window(max(0, left - patch), max(0, top - patch), right + patch, bottom + patch)


def around(where: np.ndarray) -> Window:
    """The smallest window that has all of a mask."""
    rows, columns = (np.flatnonzero(where.any(axis)) for axis in (1, 0))
    if not len(rows):
        return Window(0, 0, 0, 0)
    return Window(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def grown(box: Window, by: int) -> Window:
    return box if box.empty else box.grown(by)


def both(one: Window, other: Window) -> Window:
    """Around two windows, of which either may have no pixel."""
    return other if one.empty else one if other.empty else one | other


def in_tiles(box: Window) -> Window:
    """Around all tiles that it touches, within which cuts hang together."""
    if box.empty:
        return box
    left, top, right, bottom = box
    return Window(left // TILE * TILE, top // TILE * TILE, -(-right // TILE) * TILE, -(-bottom // TILE) * TILE)
