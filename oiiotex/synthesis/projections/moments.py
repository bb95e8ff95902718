# SPDX-License-Identifier: Apache-2.0
"""project_mom of MJH17 section 4.3: local moments are matched to those of the whole image.

The paper describes a local histogram by its moments: it fits a normal distribution to two, a Pearson distribution to
three or four, samples it into bins, and matches as with histograms. Here the cumulatives are matched directly, but
bins keep their width: moments are those of values spread over a triangle as wide as the histogram measure's window
w_r, and a cumulative is a mean over a bin. So a place with a single value has a distribution too (a triangle),
kurtosis stays above its bound, and flat places are not stretched without limit.

Three moments define a Pearson distribution with the kurtosis 3 + 1.5 skewness^2: type III, or the normal one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from ...analysis.stationarity.grid_statistics import CellGrid, correlated
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from ...engine.opencl.rows import unwrapped
from .held_cells import HeldCells, cell_rows_held, seen_cells
from .histograms import BINS, INVERSE, RowSource
from .pearson_table import KURTOSES, SCORES, SKEWNESSES, quantile_table, shares_below, table_place, table_shares

if TYPE_CHECKING:
    import pyopencl as cl

_SUMS = 6  # per cell: weight, center of the powers, sums of powers 1 to 4
_HOST_BYTES = 8 * 5 * 5  # per cell and channel: sums of powers in doubles, and copies of them


def layout(grid: CellGrid, channels: int = 3, cell_rows: int | None = None, name: str = "local") -> dict[str, int]:
    """Memory of a projection, in bytes by name. Buffer `name` must be unique for each projection.

    `cell_rows` is that of `histograms.layout`.
    """
    count = channels * grid.across * cell_rows_held(grid, cell_rows)
    return {"sums": 4 * _SUMS * count + _HOST_BYTES * count + 8 * 5 * channels * grid.down, name: 4 * 4 * count}


class MomentProjection(HeldCells):
    """As `histograms.Projection`, by moments up to `order`. If not all cells are kept, they are gathered twice."""

    def __init__(
        self, device: Device, buffers: Buffers, grid: CellGrid, low: np.ndarray, high: np.ndarray, order: int,
        name: str = "local",
    ):  # fmt: skip
        held = buffers[name].size // (4 * 4 * len(low) * grid.across)
        super().__init__(device, buffers, grid, len(low), name, held)
        self._order = order
        self._overall: list[cl.Buffer] = []
        self._taps = grid.taps()
        self._described_overall = np.zeros(0)
        self._run = device.program(
            "moments", INVERSE=INVERSE, SKEWNESSES=SKEWNESSES, KURTOSES=KURTOSES, SCORES=SCORES, CHANNELS=self.channels
        )
        self._low, self._high = np.asarray(low, np.float64), np.asarray(high, np.float64)
        self._bin = np.maximum(1.0, self._high - self._low) / (BINS - 1)
        limits = (self._low, self._high, self._bin)
        self._limits = [device.upload(limit.astype(np.float32)) for limit in limits]
        tables = (quantile_table(), table_shares()) if order > 2 else (np.zeros(1), np.zeros(1))
        self._tables = [device.upload(table.astype(np.float32)) for table in tables]

    def learning(self, image: RowSource) -> Iterator[None]:
        """As `histograms.Projection.learning`."""
        grid, powers = self._grid, np.zeros(0)
        rows = np.empty((self.channels, grid.down, 5))
        for top in range(0, grid.down, self._held):
            count = min(self._held, grid.down - top)
            yield from self._gather(image, top, top + count)
            powers = self._powers(count)
            # one cell after the other, however numpy adds adjacent values: results are bit-identical
            rows[:, top : top + count] = np.ascontiguousarray(np.moveaxis(powers, 0, -1)).sum(2)
        overall = self._described(np.moveaxis(rows.sum(1)[:, None, None], -1, 0))[:, 0, 0]
        self._described_overall = overall
        if self.whole:
            self._describe(powers, 0, grid.down, grid.wrap_y)
        inverse = self._inverse(overall) if self._order > 2 else np.zeros(1)
        self._overall = [self._device.upload(t.astype(np.float32)) for t in (inverse, overall[:, :2])]

    def match(self, image: RowSource, top: int, bottom: int, matched: str, strength: float) -> int:
        """As `histograms.Projection.match`."""
        grid, b = self._grid, self._buffers
        if not self.whole:
            self._describe_around(image, top, bottom)
        first = image.load(top, bottom)
        self._run(
            "match", (grid.width, bottom - top, self.channels), b[image.name], b[self._name], *self._tables,
            *self._overall, b[matched], *self._limits, strength, int(self._order == 2), top, bottom - top,
            first, self._first_cells, self._held, *grid.arguments,
        )  # fmt: skip
        return first

    def _describe_around(self, image: RowSource, top: int, bottom: int) -> None:
        """Compute the descriptions of the cells around rows of pixels."""
        above, below, first, last = seen_cells(self._grid, top, bottom)
        for _ in self._gather(image, first, last):
            pass
        self._describe(self._powers(last - first), above - first, below - first, False)
        self._first_cells = above

    def _gather(self, image: RowSource, first: int, last: int) -> Iterator[None]:
        """Sum rows of cells. Beyond a wrapped border their numbering continues."""
        grid, b, all_rows = self._grid, self._buffers, self.channels * self._held
        self._device.fill(b["sums"], np.float32(0), _SUMS * grid.across * all_rows)
        for powers in (2, 5):
            for top, count, at in unwrapped(grid.down, first, last):
                for begin, end in image.bands(*grid.rows_of_cells(top, top + count)):
                    loaded = image.load(begin, end)
                    self._run(
                        "gather", (grid.across, count, self.channels), b[image.name], b["sums"], powers, begin, end,
                        top, count, at, loaded, 0, self._held, *grid.arguments,
                    )  # fmt: skip
                    yield
            if powers == 2:
                self._run("about", (grid.across, all_rows), b["sums"], grid.across, all_rows)

    def _powers(self, count: int) -> np.ndarray:
        """Sums of powers of the first stored rows of cells, (5, channels, count, across)."""
        shape = self.channels, self._held, self._grid.across, _SUMS
        sums = self._device.read(self._buffers["sums"], shape, np.float32)[:, :count]
        return self._about_the_middle(sums.astype(np.float64))

    def _describe(self, powers: np.ndarray, first: int, last: int, wraps: bool) -> None:
        """Write the descriptions of rows `first` to `last` of cells, from `powers` of these and their surroundings."""
        # the Gaussian w_d of MJH17 eq. 2
        around = correlated(powers, self._taps[1], self._taps[0], axes=(2, 3), wraps=(wraps, self._grid.wrap_x))
        described = np.zeros((self.channels, self._held, self._grid.across, 4), np.float32)
        described[:, : last - first] = self._described(around[:, :, first:last], self._described_overall)
        self._device.write(self._buffers[self._name], described)

    def _about_the_middle(self, sums: np.ndarray) -> np.ndarray:
        """Sums of powers 0 to 4 of values minus the middle of their range: (5, channels, y, x)."""
        powers = np.moveaxis(sums[..., [0, 2, 3, 4, 5]], -1, 0).copy()
        off = sums[..., 1] - 0.5 * (self._low + self._high)[:, None, None]
        offs = [np.ones_like(off), off, off * off]  # halves of integers: their powers are exact
        offs += [offs[2] * off, offs[2] * offs[2]]
        return np.stack([sum(math.comb(k, j) * offs[k - j] * powers[j] for j in range(k + 1)) for k in range(5)])

    def _described(self, powers: np.ndarray, overall: np.ndarray | None = None) -> np.ndarray:
        """Mean, deviation, and the table's indices of skewness and kurtosis: (channels, y, x, 4).

        From sums (5, channels, y, x) of `_about_the_middle`. A place without any pixel around it is described as
        the whole image. With two moments the indices are unused.
        """
        weight = powers[0]
        known = weight > 0
        m1, m2, m3, m4 = powers[1:] / np.where(known, weight, 1.0)
        width = self._bin[:, None, None]
        # central moments, plus those of a triangle of variance w^2 / 6 and fourth moment w^4 / 15
        central = np.maximum(m2 - m1**2, 0.0)
        variance = central + width**2 / 6
        places: Iterable[np.ndarray] = np.zeros((2, *weight.shape))
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
            left, right = (0.5 * shares_below((values + off - mean) / deviation, *at) for off in (-half, half))
            below = left + right
            moving = np.diff(below) > 0  # of equal shares, the values next to where they change
            kept = np.append(moving, False) | np.insert(moving, 0, False)
            table[c] = np.interp(wanted, below[kept], values[kept]) if kept.any() else mean
        return table
