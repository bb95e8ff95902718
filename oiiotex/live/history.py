# SPDX-License-Identifier: Apache-2.0
"""A painting's steps on disk: labels of its layers as indexed PNGs with the legend in them, each step's plan beside."""

from __future__ import annotations

import os
import re
from pathlib import Path

from ..core.window import Window
from ..deferred import np
from ..errors import ImageError
from ..graphcut.seam_overlay import TILE
from ..io.atomic import temporary_beside
from ..io.documents import read_arrays
from .painting import around, both, changed_cells, enlarged, fine_of, grown, in_tiles

_STEP = re.compile(r"(\d{6})\.png")
_OWN = re.compile(r"\d{6}(\.fine)?\.png|\d{6}(\.x\d+)?\.npz")


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
                larger |= {f"{layer}{name}": array for name, array in enlarged(arrays, layer, times, path).items()}
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
        whole, box = Window(0, 0, *map(int, new["facts"][1:3])), changed_cells(old, new, "")
        seen, was = (layer > 0 for layer in fine)
        either = around(seen | was)
        if not either.empty:
            over = either if "fine_facts" not in old or "fine_facts" not in new else changed_cells(old, new, "fine_")
            band = TILE // 4  # the farthest that a cut strays from what is painted, `SeamOverlay.band`
            over = both(over & grown(either, band), grown(around(seen ^ was), band))
            box = in_tiles(both(box, over))
        return box & whole
