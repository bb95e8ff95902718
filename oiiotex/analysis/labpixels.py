# SPDX-License-Identifier: Apache-2.0
"""Lab of an image on an integer grid in the host's memory, reduced by a whole factor where the image is large."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..color import BrokenValues
from ..images import Image
from ..session import Session
from ..tiles import BAND_BYTES, bands, stream
from ..working import Lens
from .labgrid import STEPS, to_grid

_PIECE_PIXELS = 1 << 16


@dataclass(frozen=True)
class LabPixels:
    """Means of `factor` x `factor` pixels; squares at the right and bottom border may be smaller.

    Attributes
    ----------
    lab : (h, w, 3) float32
        CIE Lab on a grid of 1 / (8 factor^2); what is not seen has the mean of what is.
    seen : (h, w) bool
        Where a pixel of the square is opaque.
    factor : int
    opaque : (height, width // 8) uint8 or None
        A bit for every pixel of the image, 1 where alpha is not 0; None: everywhere.
    width, height : int
        Of the image, px.
    """

    lab: np.ndarray
    seen: np.ndarray
    factor: int
    opaque: np.ndarray | None
    width: int
    height: int

    def opaque_rows(self, top: int, bottom: int) -> np.ndarray | None:
        """Rows of the image as (bottom - top, width) bool, None where all are opaque."""
        if self.opaque is None:
            return None
        return np.unpackbits(self.opaque[top:bottom], axis=1, count=self.width).astype(bool)


def reduction(width: int, height: int, most: int) -> int:
    """The smallest whole factor that leaves at most so many pixels."""
    return max(1, math.ceil(math.sqrt(width * height / most)))


def lab_pixels(
    image: Image, lens: Lens, session: Session, factor: int = 1, allowed: np.ndarray | None = None
) -> LabPixels:
    """The image's first part in Lab, looked at once on all threads.

    What is not `allowed`, (height, width) bool, is as if it were transparent.

    Equal Lab gives equal integers, and sums of integers do not depend on bands, so what follows from them is the same
    on every device.

    Raises
    ------
    BrokenValues
        NaN or Inf: all are counted.
    """
    part = image.first
    width, height = part.window.width, part.window.height
    across, down = -(-width // factor), -(-height // factor)
    sums = np.zeros((down, across, 4), np.int32)
    bits, transparent, broken = np.zeros((height, -(-width // 8)), np.uint8), False, None

    def look(rows: np.ndarray) -> np.ndarray | BrokenValues:
        try:
            return to_grid(*lens.values(rows))
        except BrokenValues as error:
            return error

    columns = np.arange(0, width, factor)
    for band, pixels in stream(part, bands(part, BAND_BYTES)):
        pieces = list(band.cells(band.width, max(1, _PIECE_PIXELS // band.width)))
        made = session.spread(look, [pixels[piece.inside(band)] for piece in pieces])
        for piece, found in zip(pieces, made, strict=True):
            if isinstance(found, BrokenValues):
                broken = found.counts if broken is None else broken + found.counts
                continue
            top = piece.top - part.window.top
            if allowed is not None:
                found *= allowed[top : top + len(found), :, None]
            solid = found[..., 3] > 0
            bits[top : top + len(found)] = np.packbits(solid, axis=1)
            transparent |= not solid.all()
            if factor == 1:
                sums[top : top + len(found)] = found
                continue
            rows = np.arange(top, top + len(found)) // factor
            starts = np.flatnonzero(np.diff(rows, prepend=-1))
            summed = np.add.reduceat(found, columns, axis=1, dtype=np.int32)
            sums[rows[starts]] += np.add.reduceat(summed, starts, axis=0)
    if broken is not None:
        raise BrokenValues(lens.name, broken)
    seen = sums[..., 3] > 0
    lab = (sums[..., :3] / (STEPS * np.maximum(sums[..., 3:], 1))).astype(np.float32)
    if not seen.all() and seen.any():
        lab[~seen] = lab[seen].mean(0, dtype=np.float64)
    return LabPixels(lab, seen, factor, bits if transparent else None, width, height)
