# SPDX-License-Identifier: Apache-2.0
"""Lab of an image on an integer grid in the host's memory, reduced by an integer factor if the image is large."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..core.image import Image, Part
from ..core.window import Window
from ..deferred import np, oiio
from ..scan import scan
from ..session.resources import Resources
from .lab_grid import mean_lab, seen_on_grid
from .lens import Lens


@dataclass(frozen=True)
class LabPixels:
    """Means over squares of `factor` x `factor` pixels; squares at the right and bottom border may be smaller.

    Attributes
    ----------
    lab : (h, w, 3) float32
        CIE Lab on a grid of 1 / (8 factor^2); transparent squares have the mean of the others.
    seen : (h, w) bool
        Whether any pixel of the square is opaque.
    factor : int
    opaque : (height, width // 8) uint8 or None
        One bit per pixel of the image, 1 where alpha is not 0; None: everywhere.
    width, height : int
        Size of the image, px.
    """

    lab: np.ndarray
    seen: np.ndarray
    factor: int
    opaque: np.ndarray | None
    width: int
    height: int

    def part(self, name: str, spec: oiio.ImageSpec, values: np.ndarray) -> Part:
        """Values (h, w, channels) of the squares, enlarged to the image's windows in `spec`; 0 where alpha is 0."""
        whole = Window.data(spec)

        def fetch(window: Window) -> np.ndarray:
            rows, columns = window.inside(whole)
            y, x = (np.arange(s.start, s.stop) // self.factor for s in (rows, columns))
            if self.opaque is None:
                return values[np.ix_(y, x)]
            opaque = np.unpackbits(self.opaque[rows], axis=1, count=self.width)[:, columns, None]
            return np.where(opaque, values[np.ix_(y, x)], values.dtype.type(0))

        return Part(name, spec, fetch, ready=True)


def reduction(width: int, height: int, most: int) -> int:
    """The smallest integer factor that leaves at most `most` pixels."""
    return max(1, math.ceil(math.sqrt(width * height / most)))


def lab_pixels(
    image: Image, lens: Lens, resources: Resources, factor: int = 1, allowed: np.ndarray | None = None
) -> LabPixels:
    """The image's first part in Lab, in one pass on all threads.

    Equal Lab yields equal integers, and sums of integers do not depend on bands, so results are the same on every
    device.

    Parameters
    ----------
    image, lens
    factor : int
        Side of the squares whose means are taken, px.
    allowed : (height, width) bool, optional
        Other pixels are treated as transparent.

    Raises
    ------
    BrokenValues
        NaN or Inf; all are counted.
    """
    part = image.first
    width, height = part.window.width, part.window.height
    across, down = -(-width // factor), -(-height // factor)
    sums = np.zeros((down, across, 4), np.int32)
    bits, columns = np.zeros((height, -(-width // 8)), np.uint8), np.arange(0, width, factor)

    def look(values: np.ndarray, opaque: np.ndarray | None, _: Window) -> np.ndarray:
        return seen_on_grid(values, opaque)

    def keep(piece: Window, grid: np.ndarray) -> None:
        top = piece.top - part.window.top
        if allowed is not None:
            grid *= allowed[top : top + len(grid), :, None]
        bits[top : top + len(grid)] = np.packbits(grid[..., 3] > 0, axis=1)
        if factor == 1:
            sums[top : top + len(grid)] = grid
            return
        rows = np.arange(top, top + len(grid)) // factor
        starts = np.flatnonzero(np.diff(rows, prepend=-1))
        summed = np.add.reduceat(grid, columns, axis=1, dtype=np.int32)
        sums[rows[starts]] += np.add.reduceat(summed, starts, axis=0)

    scan(part, lens, resources, look, keep)
    seen = sums[..., 3] > 0
    lab = mean_lab(sums)
    if not seen.all() and seen.any():
        lab[~seen] = lab[seen].mean(0, dtype=np.float64)
    clear = sums[..., 3].sum(dtype=np.int64) == width * height
    return LabPixels(lab, seen, factor, None if clear else bits, width, height)
