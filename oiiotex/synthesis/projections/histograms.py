# SPDX-License-Identifier: Apache-2.0
"""Global and local histogram matching: MJH17 sections 3.2, 4.2 and 4.3.

Images are (height, width, channels) int16 arrays of Lab (and of further maps of a material) on the integer grid of
`lab_grid`, so a global match is one table per channel and every histogram of it is exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from ...analysis.stationarity.grid_statistics import CellGrid
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from ...engine.opencl.rows import unwrapped
from .held_cells import HeldCells, cell_rows_held, seen_cells

BINS = 64
INVERSE = 2048  # samples of an inverse cumulative
OUTSIDE = -32768  # excluded from histograms; far outside the Lab grid
MOST_VALUES = 4096  # maximum number of values that `patchmatch.to_grid` distinguishes
_CELL_GROUP = 4  # cells that a CPU's thread sums at a time: there may be few, and each is much work
_SHARES = 64  # cl/histograms.cl, SHARES
_COUNT_PARTS = 32  # of an image whose values are counted


class RowSource(Protocol):
    """An image whose rows are available in buffer `name`: `patchmatch.rows.Rows`."""

    name: str

    @property
    def store(self) -> object:
        """None: the buffer holds all rows."""

    def bands(self, first: int, last: int, most: int | None = None) -> Iterator[tuple[int, int]]:
        """Split rows first to last into bands to load, of at most `most` rows. One band if all are loaded."""

    def load(self, first: int, last: int) -> int:
        """Load rows. Returns the row at the buffer's start."""


class ValueCounts:
    """Counts of each value in an image, and the table that gives it another image's histogram. All stay on the device.

    Parameters
    ----------
    buffers : Buffers
        With at least `layout()`.
    first, entries : int
        Entry i counts value first + i. The image has no other values.
    """

    def __init__(self, device: Device, buffers: Buffers, first: int, entries: int, channels: int):
        self._buffers = buffers
        self._first, self._entries, self._channels = first, entries, channels
        self._run = device.program("histograms", BINS=BINS, INVERSE=INVERSE, CHANNELS=channels)
        self._counters = 256 if device.lanes == 1 else 1  # cl/histograms.cl, COUNTERS

    @staticmethod
    def layout(channels: int = 3) -> dict[str, int]:
        """Device memory, in bytes by name."""
        values = channels * MOST_VALUES
        return {
            "value_parts": 4 * _COUNT_PARTS * values,
            "counts": 4 * values,
            "goal_counts": 4 * values,
            "value_table": 2 * values,
        }

    def add(
        self, counts: str, image: str, size: tuple[int, int], *, more: bool, at: int = 0, free: str | None = None,
        seen: str | None = None,
    ) -> None:  # fmt: skip
        """Set buffer `counts`, (channels, entries) uint32, to the counts in rows of buffer `image`.

        Parameters
        ----------
        counts : str
            `counts` or `goal_counts`.
        image : str
            Name of a buffer of int16.
        size : (int, int)
            Width, and number of rows.
        more : bool
            Add to the counts of other rows.
        at : int
            First row in the buffer.
        free : str or None
            Buffer of the same size: only pixels that are `OUTSIDE` in it count.
        seen : str or None
            Buffer of the same size: only pixels that are not `OUTSIDE` in it count. Conflicts with `free`.
        """
        b, counters = self._buffers, self._counters
        parts, which = min(_COUNT_PARTS, size[1]), 1 if free else 2 if seen else 0  # COUNT_FREE, COUNT_SEEN
        self._run(
            "values", (counters * parts, self._channels), b[image], b[free or seen or image], b["value_parts"],
            self._first, self._entries, *size, at, which, group=counters,
        )  # fmt: skip
        total = self._channels * self._entries
        self._run("values_sum", (total,), b["value_parts"], b[counts], self._entries, parts, more)

    def match(self, alpha: float) -> None:
        """Set buffer `value_table`, (channels, entries) int16, from both counts; see cl/histograms.cl.

        `alpha`: 0: keep the image. 1: give it the goal's histogram.
        """
        b = self._buffers
        self._run(
            "matching", (self._counters, self._channels), b["counts"], b["goal_counts"], b["value_table"],
            self._first, self._entries, float(alpha), group=self._counters,
        )  # fmt: skip

    def apply(self, image: str, matched: str, size: tuple[int, int]) -> None:
        """Write to buffer `matched` value_table[channel, v - first] for every value v of buffer `image`.

        Both are buffers of `size` (width, height).
        """
        b = self._buffers
        self._run("table", size, b[image], b["value_table"], b[matched], self._first, self._entries, *size)


def layout(
    grid: CellGrid, channels: int = 3, cell_rows: int | None = None, name: str = "grid", beyond: int = 0
) -> dict[str, int]:
    """Device memory of a projection, in bytes by name.

    Parameters
    ----------
    cell_rows : int or None
        Number of rows of cells to keep, or more if one row of pixels requires it. None: all.
    name : str
        Name of the buffer of cells, unique for each projection.
    beyond : int
        Additional rows above and below that are matched as well.
    """
    histograms = 4 * channels * grid.across * BINS * cell_rows_held(grid, cell_rows, beyond)
    inverse = {"bin_totals": 8 * channels * BINS, f"{name}_inverse": 4 * channels * (INVERSE + 1)}
    return {name: histograms, "grid_next": histograms, f"{name}_sums": 4 * channels * grid.down * BINS, **inverse}


class Projection(HeldCells):
    """project_histo of MJH17 section 4.3: match every local histogram to the image's overall one.

    If not all cells are kept, those around the rows to match are gathered and blurred again for matching.

    `low`, `high` (channels,) int.
    """

    def __init__(
        self, device: Device, buffers: Buffers, grid: CellGrid, low: np.ndarray, high: np.ndarray, name: str = "grid"
    ):  # fmt: skip
        held = min(buffers[n].size for n in (name, "grid_next")) // (4 * len(low) * grid.across * BINS)
        super().__init__(device, buffers, grid, len(low), name, held)
        self._sums, self._inverse = f"{name}_sums", f"{name}_inverse"
        self._run = device.program("histograms", BINS=BINS, INVERSE=INVERSE, CHANNELS=self.channels)
        low, high = np.asarray(low, np.float32), np.asarray(high, np.float32)
        per_bin = ((BINS - 1) / np.maximum(high - low, np.float32(1.0))).astype(np.float32)
        self._bins, self._most = (device.upload(low), device.upload(per_bin)), device.upload(high)
        self._taps = [(device.upload(taps.astype(np.float32)), len(taps) // 2) for taps in grid.taps()]

    def learning(self, image: RowSource) -> Iterator[None]:
        """Read the whole image, some of its rows per step. After the last step, `match` may be called."""
        grid, b = self._grid, self._buffers
        for top in range(0, grid.down, self._held):
            count = min(self._held, grid.down - top)
            self._clear()
            yield from self._gather(image, top, count, 0)
            self._run(
                "row_sums", (self._bin_parts, count, self.channels), b[self._name], b[self._sums], grid.across,
                self._held, count, top, grid.down,
            )  # fmt: skip
        self.invert()
        if self.whole:
            self._blur(grid.down, 0, grid.down, grid.wrap_y)

    def invert(self) -> None:
        """G^-1 at equidistant shares, from the sums of all rows of cells. G: the image's cumulative."""
        b, (low, per_bin) = self._buffers, self._bins
        self._run("totals", (BINS, self.channels), b[self._sums], b["bin_totals"], self._grid.down)
        runs = INVERSE // _SHARES + 1
        self._run("inverse", (runs, self.channels), b["bin_totals"], b[self._inverse], low, self._most, per_bin)

    def match(self, image: RowSource, top: int, bottom: int, matched: str, strength: float) -> int:
        """Match rows of the learned image. Returns the row at the start of its buffer."""
        if not self.whole:
            self._gather_around(image, top, bottom)
        first = image.load(top, bottom)
        self._run(
            "match", (self._grid.width, bottom - top), self._buffers[image.name], self._buffers[self._name],
            self._buffers[self._inverse], self._buffers[matched], *self._bins, strength, top, bottom - top,
            first, self._first_cells, self._held, *self._grid.arguments,
        )  # fmt: skip
        return first

    def _gather_around(self, image: RowSource, top: int, bottom: int) -> None:
        """Cumulatives of the cells around rows of pixels, from the cells around those."""
        above, below, first, last = seen_cells(self._grid, top, bottom)
        self._clear()
        for cell, count, at in unwrapped(self._grid.down, first, last):
            for _ in self._gather(image, cell, count, at):
                pass
        self._blur(last - first, above - first, below - first, False)
        self._first_cells = first

    def _clear(self) -> None:
        """Initialize every bin with a small count, so that cumulatives increase strictly."""
        grid, size = self._grid, self.channels * self._held * self._grid.across * BINS
        pitch_x, pitch_y = (np.float32(n) / np.float32(cells) for n, cells in zip(grid.size, grid.counts, strict=True))
        self._device.fill(self._buffers[self._name], np.float32(1e-6) * pitch_x * pitch_y, size)

    def _gather(self, image: RowSource, top: int, count: int, at: int) -> Iterator[None]:
        """Sum rows of cells, stored from row `at`."""
        grid, narrow = self._grid, self._device.lanes == 1
        # a work group per channel and cell, otherwise an item per cell
        shape, group = (
            ((BINS * grid.across, count, self.channels), BINS) if narrow else ((grid.across, count), _CELL_GROUP)
        )
        for begin, end in image.bands(*grid.rows_of_cells(top, top + count)):
            first = image.load(begin, end)
            self._run(
                "gather", shape, self._buffers[image.name], self._buffers[self._name], *self._bins, begin, end,
                top, count, at, first, 0, self._held, *grid.arguments, group=group,
            )  # fmt: skip
            yield

    def _blur(self, rows: int, first: int, last: int, wraps: bool) -> None:
        """Cumulatives of rows `first` to `last`, from the stored rows `rows`."""
        b, channels, across, parts = self._buffers, self.channels, self._grid.across, self._bin_parts
        taps_x, taps_y = self._taps
        plane = self._held * across
        self._run(
            "blur", (parts, across, channels * rows), b[self._name], b["grid_next"], *taps_x, across, 1, rows, across,
            plane, 0, across, self._grid.wrap_x,
        )  # fmt: skip
        self._run(
            "blur", (parts, last - first, channels * across), b["grid_next"], b[self._name], *taps_y, rows, across,
            across, 1, plane, first, last, wraps,
        )  # fmt: skip
        self._run("cumulate", (across, channels * self._held), b[self._name], across, channels * self._held)

    @property
    def _bin_parts(self) -> int:
        return BINS // (4 if self._device.lanes == 1 else 16)  # cl/histograms.cl, BIN_LANES
