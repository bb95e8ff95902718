# SPDX-License-Identifier: Apache-2.0
"""Superpixels of a large image: seeds converge on means of squares, then pixels choose among the nearby seeds.

LSA16 section 3.1 reads all pixels in every iteration. Its superpixels grow with the image (sigma_1 is 2 % of the
shorter side), so 16 to 32 squares across one are enough to place its seed. The image itself is read twice, for the
squares and for the borders. A pixel chooses among the seeds that its own square and the eight around it have chosen, so
pixels inside a superpixel belong to it: noise makes no tiny pieces there. Squares are 1 px wide up to sigma = 32 px,
where this step does not exist.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ...engine.color.lab_grid import FINE_STEPS
from ...engine.color.lab_on_device import Band
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.session.resources import Resources

WIDEST = 128  # px, of a square: its pixels are counted in 16 bits
_PADDING = 128  # bytes past the end that wide registers may read: 16 pixels
_AT_ONCE = 4 << 20  # bytes of sums downloaded at a time


@dataclass(frozen=True)
class Reduced:
    """The image in squares, the initial level of the Gaussian stack."""

    side: int  # of a square, px
    sums: np.ndarray  # (down, across, 4) int32: L, a, b in steps of 1/8, and number, of a square's opaque pixels

    def contrast(self, rows: np.ndarray, columns: np.ndarray) -> float:
        """Median over cells of the standard deviation of Lab in a cell, Lab units; sums are exact integers.

        `rows`, `columns`: first square of every cell, and the end. 0 if nothing is opaque.
        """
        deviations = [np.zeros(0)]
        for top, bottom in itertools.pairwise(rows.tolist()):
            count = self.sums[top:bottom, :, 3]
            known = count > 0
            lab = self.sums[top:bottom, :, :3] // np.maximum(count, 1)[..., None]
            values = np.concatenate([lab, lab.astype(np.int64) ** 2, known[..., None]], -1).sum(0)
            sums = np.add.reduceat(values, columns[:-1])  # cells x (L, a, b, their squares, number)
            n = sums[:, 6]
            spread = n * sums[:, 3:6].sum(1) - (sums[:, :3] ** 2).sum(1)
            deviations.append(np.sqrt(spread[n > 0]) / n[n > 0])
        known_cells = np.concatenate(deviations)
        return float(np.median(known_cells)) / FINE_STEPS if len(known_cells) else 0.0


class LabelSquares:
    """Sums and means of squares, gathered while the image is read. A `LabGrid` of squares, released by `with`.

    `width`, `height`: of the image, px; `side`: of a square, px. Bands begin at multiples of it.
    """

    def __init__(self, width: int, height: int, side: int, resources: Resources, means: bool):
        self._device, self._image = resources.device, (width, height)
        self.width, self.height = -(-width // side), -(-height // side)
        self.band_rows = self.height
        self._rows = max(1, min(self.height, _AT_ONCE // (16 * self.width)))
        asker, self._means = "the image in squares", means
        size = 8 * self.width * self.height + _PADDING if means else 0
        self._buffers = Buffers(self._device, {"lab": size}, resources.budget, asker)
        self._sums = Buffers(self._device, {"sums": 16 * self.width * self._rows}, resources.budget, asker)
        self.reduced = Reduced(side, np.zeros((self.height, self.width, 4), np.int32))

    def __enter__(self) -> LabelSquares:
        return self

    def __exit__(self, *_: object) -> None:
        self._sums.__exit__()
        self._buffers.__exit__()

    def look(self, band: Band) -> None:
        """Add a band of the image."""
        side, run, sums = self.reduced.side, self._device.program("superpixels"), self._sums["sums"]
        (width, height), end = self._image, -(-band.bottom // side)
        for first in range(band.top // side, end, self._rows):
            count = min(self._rows, end - first)
            numbers = width, band.top, band.bottom - band.top, side, self.width, first, count
            run("reduce", (self.width, count), band.lab, sums, *numbers)
            if self._means:
                run("means", (self.width, count), sums, self._buffers["lab"], side, self.width, first, count)
            self.reduced.sums[first : first + count] = self._device.read(sums, (count, self.width, 4), np.int32)
        if band.bottom == height:  # all are on the host
            self._sums.__exit__()

    def bands(self, wanted: Callable[[int, int], bool] = lambda top, bottom: True) -> Iterator[Band]:
        """One band: all squares as pixels, if `wanted(top, bottom)`."""
        if wanted(0, self.height):
            yield Band(0, self.height, self._buffers["lab"])
