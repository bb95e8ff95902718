# SPDX-License-Identifier: Apache-2.0
"""A painting's steps on disk: labels of its layers as indexed PNGs with the legend in them, each step's plan beside."""

from __future__ import annotations

import json
import os
import re
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..core.window import Window
from ..deferred import np
from ..errors import ImageError
from ..graphcut.seam_overlay import TILE
from ..io.atomic import temporary_beside
from ..io.documents import read_arrays
from ..quilting.quilt_plan import Grid, Plan

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PAINTED = frozenset((".png", ".exr", ".tif", ".tiff"))
_MOST_OFFERED = 500
_STEP = re.compile(r"(\d{6})\.png")
_OWN = re.compile(r"\d{6}(\.fine)?\.png|\d{6}(\.x\d+)?\.npz")


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


class Steps:
    """The steps of a painting, without end in both directions: files NNNNNN.png and .npz of a folder.

    NNNNNN.fine.png is there where something is painted in the fine layer.

    Parameters
    ----------
    folder : Path
        Made when the first step is.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def picture(self, step: int) -> Path:
        """The painting after a step."""
        return self.folder / f"{step:06d}.png"

    def fine(self, step: int) -> Path:
        """Its fine layer, if there is anything in it."""
        return fine_of(self.picture(step))

    def plan(self, step: int) -> Path:
        """With which patches it was made."""
        return self.folder / f"{step:06d}.npz"

    @property
    def last(self) -> int:
        """The last step that there is; -1: none."""
        if not self._there:
            return -1
        found = (_STEP.fullmatch(entry.name) for entry in self.folder.iterdir())
        whole = [int(match[1]) for match in found if match and self.plan(int(match[1])).exists()]
        return max(whole, default=-1)

    @property
    def _there(self) -> bool:
        """A link is no folder of ours: it may lead anywhere."""
        return self.folder.is_dir() and not self.folder.is_symlink()

    def begin(self) -> None:
        """Make the folder, without steps: a new painting. What else lies there is the user's, and stays.

        Raises
        ------
        ImageError
            There is something of its name that is no folder, or it cannot be written.
        """
        if os.path.lexists(self.folder) and not self._there:
            raise ImageError(f"{self.folder}: is no folder, and steps of the painting go there: give it another name")
        try:
            self.folder.mkdir(exist_ok=True)
            for path in self.folder.iterdir():
                if _OWN.fullmatch(path.name) and not path.is_dir():
                    path.unlink()
        except OSError as error:
            raise ImageError(f"{self.folder}: {error.strerror}") from error

    def drop_after(self, step: int) -> None:
        """Forget what was undone: something else is painted instead."""
        for later in range(step + 1, self.last + 1):
            self.forget(later)

    def forget(self, step: int) -> None:
        """Take a step's files away."""
        for path in self.folder.glob(f"{step:06d}.*"):
            path.unlink()

    def join(self, first: int, last: int) -> None:
        """Make one step, the one after `first`, of all up to `last`."""
        if last > first + 1:
            self.forget(first + 1)
            for path in (self.picture, self.fine, self.plan):
                if path(last).exists():
                    path(last).replace(path(first + 1))
        self.drop_after(first + 1)

    def enlarged(self, step: int, times: int, budget: int) -> Path:
        """A plan of the painting so many times larger: each patch of the step's lies where its corner has moved.

        Patches are of the photo's pixels and do not grow: one cell has become times x times, and all of them but the
        first are free. As `before=` of --texpaint it keeps of the former those whose labels are still asked for there.

        Raises
        ------
        ImageError
            The plan cannot be read within `budget` bytes.
        """
        arrays, path = read_arrays(self.plan(step), budget), self.folder / f"{step:06d}.x{times}.npz"
        larger: dict[str, np.ndarray] = {}
        for layer in ("", "fine_"):
            if f"{layer}facts" in arrays:
                larger |= {f"{layer}{name}": array for name, array in _enlarged(arrays, layer, times, path).items()}
        with temporary_beside(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, **larger)
        return path

    def changed(self, before: int, after: int, fine: tuple[np.ndarray, np.ndarray], budget: int) -> Window | None:
        """Around the pixels that differ between two steps; None where these are of two sizes.

        No pixel beyond may: it hangs on patches that are the same, and on a cut within a tile that is.

        Parameters
        ----------
        before, after : int
        fine : 2 x (height, width) uint8
            Their fine layers; 0: nothing is painted.
        budget : int
            Bytes that may be held.
        """
        old, new = (read_arrays(self.plan(step), budget) for step in (before, after))
        if not np.array_equal(old["facts"], new["facts"]):
            return None
        whole, box = Window(0, 0, *map(int, new["facts"][1:3])), _changed_cells(old, new, "")
        seen, was = (layer > 0 for layer in fine)
        either = _around(seen | was)
        if not either.empty:
            over = either if "fine_facts" not in old or "fine_facts" not in new else _changed_cells(old, new, "fine_")
            band = TILE // 4  # the farthest that a cut strays from what is painted, `SeamOverlay.band`
            over = _both(over & _grown(either, band), _grown(_around(seen ^ was), band))
            box = _in_tiles(_both(box, over))
        return box & whole


def _enlarged(arrays: dict[str, np.ndarray], layer: str, times: int, path: Path) -> dict[str, np.ndarray]:
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


def _changed_cells(old: dict[str, Any], new: dict[str, Any], layer: str) -> Window:
    """Around the pixels of cells that have another patch or another cut."""
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
    """The smallest window that has all of a mask."""
    rows, columns = (np.flatnonzero(where.any(axis)) for axis in (1, 0))
    if not len(rows):
        return Window(0, 0, 0, 0)
    return Window(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def _grown(box: Window, by: int) -> Window:
    return box if box.empty else box.grown(by)


def _both(one: Window, other: Window) -> Window:
    """Around two windows, of which either may have no pixel."""
    return other if one.empty else one if other.empty else one | other


def _in_tiles(box: Window) -> Window:
    """Around all tiles that it touches, within which cuts hang together."""
    if box.empty:
        return box
    left, top, right, bottom = box
    return Window(left // TILE * TILE, top // TILE * TILE, -(-right // TILE) * TILE, -(-bottom // TILE) * TILE)
