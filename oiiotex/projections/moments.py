# SPDX-License-Identifier: Apache-2.0
"""project_mom of MJH17 section 4.3: local moments are matched to the image's own.

The paper describes a local histogram by its moments: it fits a normal distribution to two, a Pearson distribution to
three or four, samples it into bins, and matches as with histograms. Here the cumulatives are matched themselves, but
bins keep their width: moments are those of values spread over a triangle as wide as the histogram measure's window
w_r, and a cumulative is a mean over a bin. So a place where all values are one has a distribution, too (a triangle),
kurtosis stays above its bound, and flat places are not stretched without end.

Three moments have one Pearson distribution with the kurtosis 3 + 1.5 skewness^2: type III, or the normal one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ..deferred import np
from ..opencl.buffers import Buffers
from ..opencl.device import Device
from ..stationarity.grid_statistics import CellGrid, correlated
from .histograms import ALL_ROWS, BINS, INVERSE, Source
from .pearson_table import KURTOSES, SCORES, SKEWNESSES, quantile_table, shares_below, table_place, table_shares

if TYPE_CHECKING:
    import pyopencl as cl

_SUMS = 6  # of a cell: weight, what powers are taken about, sums of powers 1 to 4
_HOST_BYTES = 8 * 5 * 5  # for every cell and channel: sums of powers in doubles, and copies of them


def layout(grid: CellGrid, channels: int = 3, name: str = "local") -> dict[str, int]:
    """Memory of a projection, in bytes by name; in buffer `name` lies what no other may use."""
    count = channels * grid.across * grid.down
    return {"sums": 4 * _SUMS * count + _HOST_BYTES * count, name: 4 * 4 * count}


class MomentProjection:
    """As `histograms.Projection`, by moments up to `order`.

    Parameters
    ----------
    order : int
        2, 3 or 4.
    """

    looks_beyond = False
    held = None

    def __init__(
        self, device: Device, buffers: Buffers, grid: CellGrid, low: np.ndarray, high: np.ndarray, order: int,
        name: str = "local",
    ):  # fmt: skip
        self._device, self._buffers, self._grid, self._order, self._name = device, buffers, grid, order, name
        self._overall: list[cl.Buffer] = []
        self.channels = len(low)
        self._run = device.program(
            "moments", INVERSE=INVERSE, SKEWNESSES=SKEWNESSES, KURTOSES=KURTOSES, SCORES=SCORES, CHANNELS=self.channels
        )
        self._low, self._high = np.asarray(low, np.float64), np.asarray(high, np.float64)
        self._bin = np.maximum(1.0, self._high - self._low) / (BINS - 1)
        limits = (self._low, self._high, self._bin)
        self._limits = [device.upload(limit.astype(np.float32)) for limit in limits]
        tables = (quantile_table(), table_shares()) if order > 2 else (np.zeros(1), np.zeros(1))
        self._tables = [device.upload(table.astype(np.float32)) for table in tables]

    def learning(self, image: Source) -> Iterator[None]:
        """As `histograms.Projection.learning`."""
        grid, b = self._grid, self._buffers
        rows, begin_end = self.channels * grid.down, grid.rows_of_cells(0, grid.down)
        self._device.fill(b["sums"], np.float32(0), _SUMS * grid.across * rows)
        for powers in (2, 5):
            for begin, end in image.bands(*begin_end):
                first = image.load(begin, end)
                self._run(
                    "gather", (grid.across, grid.down, self.channels), b[image.name], b["sums"], powers, begin, end,
                    first, 0, grid.down, *grid.arguments,
                )  # fmt: skip
                yield
            if powers == 2:
                self._run("about", (grid.across, rows), b["sums"], grid.across, rows)
        sums = self._device.read(b["sums"], (self.channels, grid.down, grid.across, _SUMS), np.float32)
        powers = self._about_the_middle(sums.astype(np.float64))
        # one cell after the other, whichever way numpy adds what lies side by side: the order is part of the bits
        whole = np.ascontiguousarray(np.moveaxis(powers, 0, -1)).sum(2).sum(1)
        overall = self._described(np.moveaxis(whole[:, None, None], -1, 0))[:, 0, 0]
        # the Gaussian w_d of MJH17 eq. 2
        local = correlated(powers, *reversed(grid.taps()), axes=(2, 3), wraps=(grid.wrap_y, grid.wrap_x))
        self._device.write(b[self._name], self._described(local, overall).astype(np.float32))
        inverse = self._inverse(overall) if self._order > 2 else np.zeros(1)
        self._overall = [self._device.upload(t.astype(np.float32)) for t in (inverse, overall[:, :2])]

    def last_row(self, top: int) -> int:
        """As `histograms.Projection.last_row`."""
        return ALL_ROWS

    def match(self, image: Source, top: int, bottom: int, matched: str, strength: float) -> int:
        """As `histograms.Projection.match`."""
        grid, b, first = self._grid, self._buffers, image.load(top, bottom)
        self._run(
            "match", (grid.width, bottom - top, self.channels), b[image.name], b[self._name], *self._tables,
            *self._overall, b[matched], *self._limits, strength, int(self._order == 2), top, bottom - top,
            first, 0, grid.down, *grid.arguments,
        )  # fmt: skip
        return first

    def _about_the_middle(self, sums: np.ndarray) -> np.ndarray:
        """Sums of powers 0 to 4 of values less the middle of their range: (5, channels, y, x)."""
        powers = np.moveaxis(sums[..., [0, 2, 3, 4, 5]], -1, 0).copy()
        off = sums[..., 1] - 0.5 * (self._low + self._high)[:, None, None]
        offs = [np.ones_like(off), off, off * off]  # halves of whole numbers: their powers are exact
        offs += [offs[2] * off, offs[2] * offs[2]]
        return np.stack([sum(math.comb(k, j) * offs[k - j] * powers[j] for j in range(k + 1)) for k in range(5)])

    def _described(self, powers: np.ndarray, overall: np.ndarray | None = None) -> np.ndarray:
        """Mean, deviation, and the table's places of skewness and kurtosis: (channels, y, x, 4).

        Of sums (5, channels, y, x) as by `_about_the_middle`. A place around which there is no pixel is described as
        the whole image is. Of two moments nothing reads the places.
        """
        weight = powers[0]
        known = weight > 0
        m1, m2, m3, m4 = powers[1:] / np.where(known, weight, 1.0)
        width = self._bin[:, None, None]
        # central moments, and what a triangle of variance w^2 / 6 and fourth moment w^4 / 15 adds to them
        central = np.maximum(m2 - m1**2, 0.0)
        variance = central + width**2 / 6
        places = np.zeros((2, *weight.shape))
        if self._order > 2:
            third = m3 - 3 * m1 * m2 + 2 * m1**3
            fourth = m4 - 4 * m1 * m3 + 6 * m1**2 * m2 - 3 * m1**4 + width**2 * central + width**4 / 15
            skewness = third / variance**1.5
            places = table_place(skewness, 3 + 1.5 * skewness**2 if self._order == 3 else fourth / variance**2)
        middle = 0.5 * (self._low + self._high)[:, None, None]
        descriptions = np.stack([middle + m1, np.sqrt(variance), *places], -1)
        return descriptions if overall is None else np.where(known[..., None], descriptions, overall[:, None, None])

    def _inverse(self, overall: np.ndarray) -> np.ndarray:
        """G^-1 at INVERSE + 1 equidistant shares, (channels, INVERSE + 1), in grid steps."""
        wanted = np.linspace(0.0, 1.0, INVERSE + 1)
        table = np.empty((self.channels, INVERSE + 1))
        for c, (mean, deviation, *at) in enumerate(overall):
            values = np.linspace(self._low[c], self._high[c], INVERSE + 1)
            half = 0.25 * self._bin[c]
            below = sum(0.5 * shares_below((values + off - mean) / deviation, *at) for off in (-half, half))
            moving = np.diff(below) > 0  # of equal shares, the values next to where they change
            kept = np.append(moving, False) | np.insert(moving, 0, False)
            table[c] = np.interp(wanted, below[kept], values[kept]) if kept.any() else mean
        return table
