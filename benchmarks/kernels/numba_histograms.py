# SPDX-License-Identifier: Apache-2.0
"""The bound for cl/histograms.cl in benchmarks/kernels/test_kernels.py: the same work as compiled numba loops.

`BoundProjection` does what `Projection.project` does, sum for sum, in the toroidal case.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from benchmarks.kernels.numba_patchmatch import parallel, serial
from oiiotex.analysis.stationarity.grid_statistics import CellGrid
from oiiotex.synthesis.projections.histograms import BINS, INVERSE

# --- local histograms ---

ZERO, HALF, ONE, TOP = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(BINS - 1)
SHARES = np.float32(INVERSE)


# min, max and floor of floats handle NaN, which takes a third of the time of `match`


@serial
def clamp(value, low, high):
    """The nearest value from low to high."""
    value = low if value < low else value
    return high if value > high else value


@serial
def floor_int(value):
    """The floor as int32."""
    i = np.int32(value)
    return i - np.int32(value < np.float32(i))


@serial
def place_in_bins(value, low, per_bin):
    """A value's place among the bins, 0 .. BINS - 1."""
    return clamp((np.float32(value) - low) * per_bin, ZERO, TOP)


@serial
def shares_of_cell(center, pitch, size, places, shares):
    """The wrapped places of the pixels less than a cell away along an axis, and their shares; returns how many."""
    first, end = math.floor(center - pitch) + 1, math.ceil(center + pitch)
    for i in range(first, end):
        places[i - first] = i + size if i < 0 else i - size if i >= size else i
        shares[i - first] = ONE - abs(np.float32(i) - center) / pitch
    return end - first


@parallel
def gather(image, grid, low, per_bin):
    """Every pixel (height, width, 3) shared bilinearly among the cells (3, cells_y, cells_x, BINS) around it."""
    height, width, _ = image.shape
    _, cells_y, cells_x, _ = grid.shape
    pitch_x, pitch_y = np.float32(width) / np.float32(cells_x), np.float32(height) / np.float32(cells_y)
    most = np.int64(2 * max(pitch_x, pitch_y)) + 2
    for index in prange(3 * cells_y):
        c, cy = np.int64(index) // cells_y, np.int64(index) % cells_y
        least, scale = low[c], per_bin[c]
        places_x, places_y = np.empty(most, np.uint64), np.empty(most, np.uint64)
        shares_x, shares_y = np.empty(most, np.float32), np.empty(most, np.float32)
        n_y = shares_of_cell((np.float32(cy) + HALF) * pitch_y - HALF, pitch_y, height, places_y, shares_y)
        for cx in range(cells_x):
            histogram = grid[c, cy, cx]
            histogram[:] = np.float32(1e-6) * pitch_x * pitch_y
            n_x = shares_of_cell((np.float32(cx) + HALF) * pitch_x - HALF, pitch_x, width, places_x, shares_x)
            for j in range(n_y):
                row, share_y = image[places_y[j]], shares_y[j]
                for i in range(n_x):
                    weight = share_y * shares_x[i]
                    t = place_in_bins(row[places_x[i], np.uint64(c)], least, scale)
                    b = np.uint64(min(np.int32(t), np.int32(BINS - 2)))
                    upper = (t - np.float32(b)) * weight
                    histogram[b] += weight - upper
                    histogram[b + np.uint64(1)] += upper


@parallel
def row_sums(grid, sums):
    """Sums of a row of cells, bin by bin: (lines, cells_x, BINS) -> (lines, BINS)."""
    for index in prange(grid.shape[0]):
        line = np.int64(index)
        into = sums[line]
        into[:] = 0
        for x in range(grid.shape[1]):
            histogram = grid[line, x]
            for b in range(BINS):
                into[b] += histogram[b]


@parallel
def blur(grid, blurred, weights):
    """One wrapped axis of the Gaussian, along the second axis of (lines, n, length).

    Four taps in a pass keep a sum in its register for longer; it is summed in the order of taps all the same.
    """
    lines, n, length = grid.shape
    radius = weights.size // 2
    fours = weights.size // 4 * 4
    for index in prange(lines * n):
        job = np.int64(index)
        line, i = job // n, job % n
        first, into = i - radius, blurred[line, i]
        into[:] = 0
        for k in range(0, fours, 4):
            w0, w1, w2, w3 = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
            a0, a1 = grid[line, (first + k) % n], grid[line, (first + k + 1) % n]
            a2, a3 = grid[line, (first + k + 2) % n], grid[line, (first + k + 3) % n]
            for b in range(length):
                into[b] = into[b] + w0 * a0[b] + w1 * a1[b] + w2 * a2[b] + w3 * a3[b]
        for k in range(fours, weights.size):
            w0, a0 = weights[k], grid[line, (first + k) % n]
            for b in range(length):
                into[b] += w0 * a0[b]


@parallel
def cumulate(grid):
    """Histograms -> their cumulatives, normalized: (cells, BINS)."""
    for index in prange(grid.shape[0]):
        i = np.int64(index)
        histogram = grid[i]
        total = ZERO
        for b in range(BINS):
            total += histogram[b]
        scale, below = ONE / total, ZERO
        for b in range(BINS):
            share = histogram[b]
            histogram[b] = below * scale
            below += share


@serial
def around(place, cells):
    """The two cells around a place on a wrapped axis, and how far it lies on the way to the second."""
    first = floor_int(place)
    before = first + cells if first < 0 else first
    after = first + 1 - cells if first + 1 >= cells else first + 1
    return before, after, place - np.float32(first)


@serial
def share_below(cumulative, cell, b, inside):
    """The cumulative of one cell, linear inside the bin."""
    at = np.uint64(cell) * np.uint64(BINS) + np.uint64(b)
    upper = cumulative[at + np.uint64(1)] if b < BINS - 1 else ONE
    return cumulative[at] + (upper - cumulative[at]) * inside


@parallel
def match(image, cumulative, cells_y, cells_x, inverse, matched, low, per_bin, strength):
    """Pixels moved `strength` times the way to G^-1(F(c)); F is interpolated between the four cells around them."""
    height, width, _ = image.shape
    per_x, per_y = np.float32(cells_x) / np.float32(width), np.float32(cells_y) / np.float32(height)
    for index in prange(height):
        line, into = image[index], matched[index]
        above, below, lower = around((np.float32(index) + HALF) * per_y - HALF, cells_y)
        for c in range(np.uint64(3)):
            least, scale, g = low[c], per_bin[c], inverse[c]
            darkest, brightest = g[0], g[INVERSE]
            row_above = (np.int64(c) * cells_y + above) * cells_x
            row_below = (np.int64(c) * cells_y + below) * cells_x
            for x in range(np.uint64(width)):
                left, after, right = around((np.float32(x) + HALF) * per_x - HALF, cells_x)
                old = np.float32(line[x, c])
                t = place_in_bins(old, least, scale)
                b = np.int32(t + HALF)
                inside = t + HALF - np.float32(b)
                w0, w1 = (ONE - right) * (ONE - lower), right * (ONE - lower)
                w2, w3 = (ONE - right) * lower, right * lower
                share = w0 * share_below(cumulative, row_above + left, b, inside)
                share += w1 * share_below(cumulative, row_above + after, b, inside)
                share += w2 * share_below(cumulative, row_below + left, b, inside)
                share += w3 * share_below(cumulative, row_below + after, b, inside)
                share = share / (w0 + w1 + w2 + w3) * SHARES
                i = min(np.int32(share), np.int32(INVERSE - 1))
                g0, g1 = g[np.uint64(i)], g[np.uint64(i) + np.uint64(1)]
                value = old + strength * (g0 + (g1 - g0) * (share - np.float32(i)) - old)
                into[x, c] = np.int16(floor_int(clamp(value, darkest, brightest) + HALF))


class BoundProjection:
    """`Projection` for an image that wraps along both axes; parameters as there."""

    def __init__(self, grid: CellGrid, low: np.ndarray, high: np.ndarray):
        self._low, self._high = np.asarray(low, np.float32), np.asarray(high, np.float32)
        self._per_bin = ((BINS - 1) / np.maximum(self._high - self._low, np.float32(1.0))).astype(np.float32)
        self._weights = [taps.astype(np.float32) for taps in grid.taps()]
        self._grid = np.empty((3, grid.down, grid.across, BINS), np.float32)
        self._grid_next = np.empty_like(self._grid)
        self._row_sums = np.empty((3 * grid.down, BINS), np.float32)

    def project(self, image: np.ndarray, matched: np.ndarray, strength: float = 1.0) -> None:
        """Write to `matched` what lies `strength` times the way from `image` to its projection."""
        _, cells_y, cells_x, _ = self._grid.shape
        lines = (3 * cells_y, cells_x, BINS)
        columns = (3, cells_y, cells_x * BINS)
        gather(image, self._grid, self._low, self._per_bin)
        row_sums(self._grid.reshape(lines), self._row_sums)
        blur(self._grid.reshape(lines), self._grid_next.reshape(lines), self._weights[0])
        blur(self._grid_next.reshape(columns), self._grid.reshape(columns), self._weights[1])
        cumulate(self._grid.reshape(-1, BINS))
        inverse = self._inverse(self._row_sums.reshape(3, cells_y, BINS))
        cells = (self._grid.reshape(-1), np.int64(cells_y), np.int64(cells_x))
        match(image, *cells, inverse, matched, self._low, self._per_bin, np.float32(strength))

    def _inverse(self, sums: np.ndarray) -> np.ndarray:
        """G^-1 at INVERSE + 1 equidistant shares, as `Projection` finds it on the host."""
        shares = np.linspace(0.0, 1.0, INVERSE + 1)
        table = np.empty((3, INVERSE + 1), np.float32)
        for c in range(3):
            below = np.concatenate([[0.0], np.cumsum(sums[c].sum(axis=0, dtype=np.float64))])
            place = np.interp(shares, below / below[-1], np.arange(BINS + 1) - 0.5)
            low, high = float(self._low[c]), float(self._high[c])
            table[c] = np.clip(low + place * max(1.0, high - low) / (BINS - 1), low, high)
        return table
