# SPDX-License-Identifier: Apache-2.0
"""A painting's steps on disk: ids of labels as indexed PNG with the legend in it, the plan of each step beside it."""

from __future__ import annotations

import json
import re
import shutil
import struct
import zlib
from pathlib import Path
from typing import Any

from ..deferred import np
from ..io.atomic import temporary_beside
from ..io.documents import read_arrays

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_STEP = re.compile(r"(\d{6})\.png")


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


class Steps:
    """The steps of a painting, without end in both directions: files NNNNNN.png and .npz of a folder.

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

    def plan(self, step: int) -> Path:
        """With which patches it was made."""
        return self.folder / f"{step:06d}.npz"

    @property
    def last(self) -> int:
        """The last step that there is; -1: none."""
        if not self.folder.is_dir():
            return -1
        found = (_STEP.fullmatch(entry.name) for entry in self.folder.iterdir())
        whole = [int(match[1]) for match in found if match and self.plan(int(match[1])).exists()]
        return max(whole, default=-1)

    def begin(self) -> None:
        """Make the folder, empty: a new painting."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()

    def drop_after(self, step: int) -> None:
        """Forget what was undone: something else is painted instead."""
        for later in range(step + 1, self.last + 1):
            self.picture(later).unlink(missing_ok=True)
            self.plan(later).unlink(missing_ok=True)

    def join(self, first: int, last: int) -> None:
        """Make one step, the one after `first`, of all up to `last`."""
        for path in (self.picture, self.plan):
            path(last).replace(path(first + 1))
        self.drop_after(first + 1)

    def changed(self, before: int, after: int, budget: int) -> tuple[int, int, int, int] | None:
        """(left, top, right, bottom) around the pixels that differ between two steps; None where they are of two sizes.

        No pixel beyond may: it hangs on patches that are the same.
        """
        old, new = (read_arrays(self.plan(step), budget) for step in (before, after))
        if not np.array_equal(old["facts"], new["facts"]):
            return None
        _, width, height, patch, overlap = map(int, new["facts"][:5])
        differs = old["offsets"] != new["offsets"]
        for name in ("vertical", "horizontal"):
            cuts = old[name] != new[name]
            differs |= cuts.any(axis=tuple(range(2, cuts.ndim)))
        rows, columns = np.nonzero(differs)
        if not len(rows):
            return 0, 0, 0, 0
        pitch = patch - overlap
        left, top = (max(0, int(n.min()) * pitch - patch) for n in (columns, rows))
        return (
            left,
            top,
            min(width, int(columns.max() + 1) * pitch + patch),
            min(height, int(rows.max() + 1) * pitch + patch),
        )
