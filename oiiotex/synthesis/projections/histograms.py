# SPDX-License-Identifier: Apache-2.0
"""Global and local histogram matching: MJH17 sections 3.2, 4.2 and 4.3.

Images are (height, width, channels) int16 arrays of Lab (and of further maps of a material) on the integer grid of
`lab_grid`, so a global match is one table per channel and every histogram of it is exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

from ...analysis.stationarity.grid_statistics import CellGrid
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device, Download
from ...engine.opencl.rows import unwrapped
from .held_cells import HeldCells, cell_rows_held, seen_cells

if TYPE_CHECKING:
    import pyopencl as cl

BINS = 64
INVERSE = 2048  # samples of an inverse cumulative
OUTSIDE = -32768  # excluded from histograms; far outside the Lab grid
MOST_VALUES = 4096  # maximum number of values that `patchmatch.to_grid` distinguishes
_CELL_GROUP = 4  # cells that a CPU's thread sums at a time: there may be few, and each is much work
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


def matching_table(counts: np.ndarray, target: np.ndarray, first: int, alpha: float) -> np.ndarray:
    """Table value -> c' = alpha G^-1(F(c)) + (1 - alpha) c per channel (MJH17 section 4.2).

    Blending values at equal shares is the same as blending along the x axis of the cumulatives.

    Parameters
    ----------
    counts, target : (channels, entries) int64
        Histograms of the image (F) and of the target (G), from `ValueCounts`.
    first : int
        Value of entry 0.
    alpha : float
        0: keep the image. 1: give it the target's histogram.

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


class ValueCounts:
    """Counts of each value in an image on the device. The host reads nothing else of it.

    Parameters
    ----------
    buffers : Buffers
        With at least `layout()`.
    first, entries : int
        Entry i counts value first + i. The image has no other values.
    """

    def __init__(self, device: Device, buffers: Buffers, first: int, entries: int, channels: int):
        self._device, self._buffers = device, buffers
        self._first, self._entries, self._channels = first, entries, channels
        self._run = device.program("histograms", BINS=BINS, INVERSE=INVERSE, CHANNELS=channels)

    @staticmethod
    def layout(channels: int = 3) -> dict[str, int]:
        """Device memory, in bytes by name."""
        return {"value_counts": 4 * _COUNT_PARTS * channels * MOST_VALUES}

    def of(
        self, image: str, size: tuple[int, int], *, at: int = 0, free: str | None = None, seen: str | None = None
    ) -> np.ndarray:
        """The counts in rows of buffer `image`: (channels, entries) int64. Counts of bands can be added.

        Parameters
        ----------
        image : str
            Name of a buffer of int16.
        size : (int, int)
            Width, and number of rows.
        at : int
            First row in the buffer.
        free : str or None
            Buffer of the same size: only pixels that are `OUTSIDE` in it count.
        seen : str or None
            Buffer of the same size: only pixels that are not `OUTSIDE` in it count. Conflicts with `free`.
        """
        b, counters = self._buffers, 256 if self._device.lanes == 1 else 1  # cl/histograms.cl, COUNTERS
        parts, which = min(_COUNT_PARTS, size[1]), 1 if free else 2 if seen else 0  # COUNT_FREE, COUNT_SEEN
        self._run(
            "values", (counters * parts, self._channels), b[image], b[free or seen or image], b["value_counts"],
            self._first, self._entries, *size, at, which, group=counters,
        )  # fmt: skip
        self._run("values_sum", (self._channels * self._entries,), b["value_counts"], self._entries, parts)
        counts = self._device.read(b["value_counts"], (self._channels, self._entries), np.int32)
        return counts.astype(np.int64)


def apply_table(
    device: Device, buffers: Buffers, image: str, matched: str, size: tuple[int, int], table: np.ndarray, first: int
) -> None:  # fmt: skip
    """Write to buffer `matched` table[channel, v - first] for every value v of buffer `image`.

    Parameters
    ----------
    image, matched : str
        Names of buffers of `size` (width, height).
    size : (int, int)
    table : (channels, entries) int16
    first : int
        Value of entry 0.
    """
    run = device.program("histograms", BINS=BINS, INVERSE=INVERSE, CHANNELS=len(table))
    run("table", size, buffers[image], device.upload(table), buffers[matched], first, table.shape[1], *size)


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
    return {name: histograms, "grid_next": histograms, "row_sums": 4 * channels * grid.down * BINS}


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
        self._run = device.program("histograms", BINS=BINS, INVERSE=INVERSE, CHANNELS=self.channels)
        self._low, self._high = np.asarray(low, np.float32), np.asarray(high, np.float32)
        per_bin = (BINS - 1) / np.maximum(self._high - self._low, np.float32(1.0))
        self._bins = (device.upload(self._low), device.upload(per_bin.astype(np.float32)))
        self._taps = [(device.upload(taps.astype(np.float32)), len(taps) // 2) for taps in grid.taps()]
        self._inverse: cl.Buffer | None = None

    def learning(self, image: RowSource) -> Iterator[None]:
        """Read the whole image, some of its rows per step. After the last step, `match` may be called."""
        grid, sums = self._grid, np.empty((self.channels, self._grid.down, BINS), np.float32)
        for top in range(0, grid.down, self._held):
            count = min(self._held, grid.down - top)
            self._clear()
            yield from self._gather(image, top, count, 0)
            coming = self._row_sums()
            if not self.whole:
                sums[:, top : top + count] = coming.array()[:, :count]
        if self.whole:
            self._blur(grid.down, 0, grid.down, grid.wrap_y)
            sums = coming.array()
        self._inverse = self._device.upload(self._inverse_of(sums))

    def match(self, image: RowSource, top: int, bottom: int, matched: str, strength: float) -> int:
        """Match rows of the learned image. Returns the row at the start of its buffer."""
        if not self.whole:
            self._gather_around(image, top, bottom)
        first = image.load(top, bottom)
        self._run(
            "match", (self._grid.width, bottom - top), self._buffers[image.name], self._buffers[self._name],
            self._inverse, self._buffers[matched], *self._bins, strength, top, bottom - top,
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

    def _row_sums(self) -> Download:
        rows, b = self.channels * self._held, self._buffers
        self._run("row_sums", (self._bin_parts, rows), b[self._name], b["row_sums"], self._grid.across, rows)
        return self._device.read_later(b["row_sums"], (self.channels, self._held, BINS), np.float32)

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

    def _inverse_of(self, row_sums: np.ndarray) -> np.ndarray:
        """G^-1 at equidistant shares, (channels, INVERSE + 1) float32 in grid steps. G: the image's cumulative."""
        table, shares = np.empty((self.channels, INVERSE + 1), np.float32), np.linspace(0.0, 1.0, INVERSE + 1)
        for c in range(self.channels):
            # one row after the other: results are promised to be bit-identical
            total = np.add.reduce(row_sums[c].astype(np.float64), axis=0)
            below = np.concatenate([[0.0], np.cumsum(total)])
            place = np.interp(shares, below / below[-1], np.arange(BINS + 1) - 0.5)
            low, high = float(self._low[c]), float(self._high[c])
            table[c] = np.clip(low + place * max(1.0, high - low) / (BINS - 1), low, high)
        return table
