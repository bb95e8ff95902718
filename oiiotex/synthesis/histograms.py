# SPDX-License-Identifier: Apache-2.0
"""Global and local histogram matching: MJH17 sections 3.2, 4.2 and 4.3.

Images are (height, width, channels) int16 arrays of Lab (and of further maps of a material) on the integer grid of
`patchmatch.grid_steps`, so a global match is one table per channel and every histogram of it is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..device import Buffers, Device

BINS = 64
INVERSE = 2048  # samples of an inverse cumulative
OUTSIDE = np.int16(-32768)  # a value that no histogram counts; the grid of Lab ends far from it
_CELLS_PER_SIGMA = 2.5


def value_counts(image: np.ndarray, first: int, entries: int) -> np.ndarray:
    """How often each value occurs in (..., channels) int16: (channels, entries) int64, entry i for value first + i."""
    flat = image.reshape(-1, image.shape[-1])
    return np.stack([np.bincount(values - np.int32(first), minlength=entries) for values in flat.T])


def matching_table(counts: np.ndarray, target: np.ndarray, first: int, alpha: float) -> np.ndarray:
    """Table value -> c' = alpha G^-1(F(c)) + (1 - alpha) c per channel (MJH17 section 4.2).

    Blending values at equal shares is blending along the x axis of the cumulatives.

    Parameters
    ----------
    counts, target : (channels, entries) int64
        Histograms of the image (F) and of what to match (G), as by `value_counts`.
    first : int
        Value of entry 0.
    alpha : float
        0 keeps the image, 1 gives it the target's histogram.

    Returns
    -------
    (channels, entries) int16
    """
    channels, entries = counts.shape
    values = first + np.arange(entries)
    edges = first + np.arange(entries + 1) - 0.5
    table = np.empty((channels, entries), np.int16)
    for c in range(channels):
        below = np.concatenate([[0.0], np.cumsum(counts[c])]) / counts[c].sum()
        below_target = np.concatenate([[0.0], np.cumsum(target[c] + 1e-9)])
        below_target /= below_target[-1]
        matched = np.interp(0.5 * (below[:-1] + below[1:]), below_target, edges)
        table[c] = np.rint(np.clip(alpha * matched + (1.0 - alpha) * values, first, first + entries - 1))
    return table


def apply_table(device: Device, buffers: Buffers, image: str, pixels: int, table: np.ndarray, first: int) -> None:
    """Replace every value v of buffer `image` by table[channel, v - first]."""
    run = device.program("histograms", BINS=BINS, INVERSE=INVERSE, CHANNELS=len(table))
    run("table", (pixels,), buffers[image], device.upload(table), first, table.shape[1], pixels)


@dataclass(frozen=True)
class Cells:
    """The grid on which the local histograms of an image stand: cells sigma / 2.5 apart, at least one pixel."""

    width: int
    height: int
    x: int
    y: int

    @staticmethod
    def of(width: int, height: int, sigma: float) -> Cells:
        """Cells for an image of this size and a Gaussian of `sigma` px."""
        pitch = max(1.0, sigma / _CELLS_PER_SIGMA)
        return Cells(width, height, *(max(4, min(n, round(n / pitch))) for n in (width, height)))

    def layout(self, channels: int = 3) -> dict[str, int]:
        """Device memory of a projection, in bytes by name."""
        grid = 4 * channels * self.x * self.y * BINS
        matched = 2 * channels * self.width * self.height
        return {"grid": grid, "grid_next": grid, "row_sums": 4 * channels * self.y * BINS, "matched": matched}


class Projection:
    """project_histo of MJH17 section 4.3: every local histogram is matched to the image's own.

    Parameters
    ----------
    device : Device
    buffers : Buffers
        At least `Cells.layout()`.
    cells : Cells
    sigma : float
        Standard deviation of the Gaussian neighbourhood, px.
    low, high : (channels,) int
        Range of values, in grid steps. What lies outside is taken as the nearest.
    wrap_x, wrap_y : bool
        The image is a torus along that axis; else nothing lies beyond its border.
    """

    def __init__(
        self,
        device: Device,
        buffers: Buffers,
        cells: Cells,
        sigma: float,
        low: np.ndarray,
        high: np.ndarray,
        wrap_x: bool,
        wrap_y: bool,
    ):
        self._device, self._buffers, self._cells = device, buffers, cells
        self.channels = len(low)
        self._run = device.program("histograms", BINS=BINS, INVERSE=INVERSE, CHANNELS=self.channels)
        self._wrap = (int(wrap_x), int(wrap_y))
        self._low, self._high = np.asarray(low, np.float32), np.asarray(high, np.float32)
        per_bin = (BINS - 1) / np.maximum(self._high - self._low, np.float32(1.0))
        self._bins = (device.upload(self._low), device.upload(per_bin.astype(np.float32)))
        self._kernels = [
            self._gaussian(sigma * n / size) for n, size in ((cells.x, cells.width), (cells.y, cells.height))
        ]

    def project(self, image: str, matched: str, strength: float = 1.0) -> None:
        """Write to buffer `matched` what lies `strength` times the way from buffer `image` to its projection.

        Pixels of value `OUTSIDE` belong to no histogram; what is written for them means nothing.
        """
        cells, channels, b = self._cells, self.channels, self._buffers
        size = (cells.width, cells.height, cells.x, cells.y, *self._wrap)
        self._run("gather", (cells.x, cells.y, channels), b[image], b["grid"], *self._bins, *size)
        bin_parts = BINS if self._device.lanes == 1 else BINS // 16  # cl/histograms.cl, BIN_LANES
        self._run("row_sums", (bin_parts, channels * cells.y), b["grid"], b["row_sums"], cells.x, channels * cells.y)
        (weights_x, radius_x), (weights_y, radius_y) = self._kernels
        self._run(
            "blur", (bin_parts, cells.x, channels * cells.y), b["grid"], b["grid_next"], weights_x, radius_x,
            cells.x, 1, cells.y, cells.x, self._wrap[0],
        )  # fmt: skip
        self._run(
            "blur", (bin_parts, cells.y, channels * cells.x), b["grid_next"], b["grid"], weights_y, radius_y,
            cells.y, cells.x, cells.x, 1, self._wrap[1],
        )  # fmt: skip
        self._run("cumulate", (channels * cells.x * cells.y,), b["grid"], channels * cells.x * cells.y)
        rows = self._device.read(b["row_sums"], (channels, cells.y, BINS), np.float32)
        inverse = self._device.upload(self._inverse(rows))
        self._run(
            "match",
            (cells.width, cells.height, channels),
            b[image],
            b["grid"],
            inverse,
            b[matched],
            *self._bins,
            strength,
            *size,
        )

    def _gaussian(self, sigma: float) -> tuple[object, int]:
        """Weights over cells and their radius; the tents of gathering and reading blur by 1/3 cell^2 already."""
        sigma = math.sqrt(max(1e-4, sigma**2 - 1.0 / 3.0))
        radius = max(1, math.ceil(3.2 * sigma))
        weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
        return self._device.upload((weights / weights.sum()).astype(np.float32)), radius

    def _inverse(self, row_sums: np.ndarray) -> np.ndarray:
        """G^-1 at equidistant shares, (channels, INVERSE + 1) float32 in grid steps; G is the whole image's."""
        shares = np.linspace(0.0, 1.0, INVERSE + 1)
        table = np.empty((self.channels, INVERSE + 1), np.float32)
        for c in range(self.channels):
            # one row after the other: the order is part of the promise that bits do not change
            total = np.add.reduce(row_sums[c].astype(np.float64), axis=0)
            below = np.concatenate([[0.0], np.cumsum(total)])
            place = np.interp(shares, below / below[-1], np.arange(BINS + 1) - 0.5)
            low, high = float(self._low[c]), float(self._high[c])
            table[c] = np.clip(low + place * max(1.0, high - low) / (BINS - 1), low, high)
        return table
