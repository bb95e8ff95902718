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

import numpy as np

from ..device import Buffers, Device
from .histograms import BINS, INVERSE, Cells
from .pearson import KURTOSES, SCORES, SKEWNESSES, quantile_table, shares_below, table_place, table_shares

_SUMS = 6  # of a cell: weight, what powers are taken about, sums of powers 1 to 4
_HOST_BYTES = 8 * 5 * 5  # for every cell and channel: sums of powers in doubles, and copies of them


def layout(cells: Cells, channels: int = 3) -> dict[str, int]:
    """Memory of a projection, in bytes by name."""
    count = channels * cells.x * cells.y
    return {
        "sums": 4 * _SUMS * count + _HOST_BYTES * count,
        "local": 4 * 4 * count,
        "matched": 2 * channels * cells.width * cells.height,
    }


class MomentProjection:
    """As `histograms.Projection`, by moments up to `order`; `project` has the same meaning.

    Parameters
    ----------
    order : int
        2, 3 or 4.
    """

    def __init__(
        self, device: Device, buffers: Buffers, cells: Cells, sigma: float, low: np.ndarray, high: np.ndarray,
        wrap_x: bool, wrap_y: bool, order: int,
    ):  # fmt: skip
        self._device, self._buffers, self._cells, self._order = device, buffers, cells, order
        self.channels = len(low)
        self._run = device.program(
            "moments", INVERSE=INVERSE, SKEWNESSES=SKEWNESSES, KURTOSES=KURTOSES, SCORES=SCORES, CHANNELS=self.channels
        )
        self._wrap_x, self._wrap_y, self._sigma = wrap_x, wrap_y, sigma
        self._low, self._high = np.asarray(low, np.float64), np.asarray(high, np.float64)
        self._bin = np.maximum(1.0, self._high - self._low) / (BINS - 1)
        limits = (self._low, self._high, self._bin)
        self._limits = [device.upload(limit.astype(np.float32)) for limit in limits]
        tables = (quantile_table(), table_shares()) if order > 2 else (np.zeros(1), np.zeros(1))
        self._tables = [device.upload(table.astype(np.float32)) for table in tables]

    def project(self, image: str, matched: str, strength: float = 1.0) -> None:
        """Write to buffer `matched` what lies `strength` times the way from buffer `image` to its projection."""
        cells, b = self._cells, self._buffers
        size = (cells.width, cells.height, cells.x, cells.y, int(self._wrap_x), int(self._wrap_y))
        self._run("gather", (cells.x, cells.y, self.channels), b[image], b["sums"], *size)
        sums = self._device.read(b["sums"], (self.channels, cells.y, cells.x, _SUMS), np.float32).astype(np.float64)
        powers = self._about_the_middle(sums)
        overall = self._described(powers.sum(2).sum(1)[:, None, None])[:, 0, 0]
        self._device.write(b["local"], self._described(self._blurred(powers), overall).astype(np.float32))
        inverse = self._inverse(overall) if self._order > 2 else np.zeros(1)
        tables = (self._device.upload(t.astype(np.float32)) for t in (inverse, overall[:, :2]))
        self._run(
            "match", (cells.width, cells.height, self.channels), b[image], b["local"], *self._tables, *tables,
            b[matched], *self._limits, strength, int(self._order == 2), *size,
        )  # fmt: skip

    def _about_the_middle(self, sums: np.ndarray) -> np.ndarray:
        """Sums of powers 0 to 4 of values less the middle of their range: (channels, y, x, 5)."""
        powers = np.concatenate([sums[..., :1], sums[..., 2:]], -1)
        off = sums[..., 1] - 0.5 * (self._low + self._high)[:, None, None]
        return np.stack(
            [sum(math.comb(k, j) * off ** (k - j) * powers[..., j] for j in range(k + 1)) for k in range(5)], -1
        )

    def _blurred(self, powers: np.ndarray) -> np.ndarray:
        """By the Gaussian w_d of MJH17 eq. 2, along y and x; summed in one fixed order."""
        cells = self._cells
        for axis, n, size, wraps in ((1, cells.y, cells.height, self._wrap_y), (2, cells.x, cells.width, self._wrap_x)):
            sigma = math.sqrt(max(1e-4, (self._sigma * n / size) ** 2 - 1.0 / 3.0))  # as in histograms.Projection
            radius = max(1, math.ceil(3.2 * sigma))
            weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
            out, places = np.zeros_like(powers), np.arange(n)
            for step, weight in zip(range(-radius, radius + 1), weights / weights.sum(), strict=True):
                at = places + step
                seen = np.ones(n, bool) if wraps else (at >= 0) & (at < n)
                term = weight * np.take(powers, at % n, axis)
                out += term if seen.all() else term * seen.reshape((-1, 1, 1) if axis == 1 else (-1, 1))
            powers = out
        return powers

    def _described(self, powers: np.ndarray, overall: np.ndarray | None = None) -> np.ndarray:
        """Mean, deviation, and the table's places of skewness and kurtosis: (channels, y, x, 4).

        A place around which there is no pixel is described as the whole image is.
        """
        weight = powers[..., 0]
        known = weight > 0
        m1, m2, m3, m4 = (powers[..., k] / np.where(known, weight, 1.0) for k in range(1, 5))
        width = self._bin[:, None, None]
        # central moments, and what a triangle of variance w^2 / 6 and fourth moment w^4 / 15 adds to them
        central = np.maximum(m2 - m1**2, 0.0)
        variance = central + width**2 / 6
        third = m3 - 3 * m1 * m2 + 2 * m1**3
        fourth = m4 - 4 * m1 * m3 + 6 * m1**2 * m2 - 3 * m1**4 + width**2 * central + width**4 / 15
        skewness = third / variance**1.5
        kurtosis = 3 + 1.5 * skewness**2 if self._order == 3 else fourth / variance**2
        middle = 0.5 * (self._low + self._high)[:, None, None]
        found = np.stack([middle + m1, np.sqrt(variance), *table_place(skewness, kurtosis)], -1)
        return found if overall is None else np.where(known[..., None], found, overall[:, None, None])

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
