# SPDX-License-Identifier: Apache-2.0
"""project_steer of MJH17 section 4.3: local histograms of steerable responses are matched to those of the whole image.

Departures from the paper: its pyramid is Simoncelli's, here the filters are those of `stationarity/steerable.py`, and
the frequencies that they miss (low and high: the image minus the sum of its responses) are one residual, not two.
The residual is matched as well, as in Heeger and Bergen: matching the twelve responses alone keeps a photo's stains and
lighting gradients, which have lower frequencies. And changes are amplified when they are synthesized.
`literal` turns off both departures.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from ...analysis.stationarity.grid_statistics import CellGrid
from ...analysis.stationarity.steerable import ORIENTATIONS, RADIUS, filter_bank
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from . import histograms
from .histograms import Projection, RowSource

_BEFORE = tuple(f"before{o}" for o in range(ORIENTATIONS))
_AFTER = tuple(f"after{o}" for o in range(ORIENTATIONS))
_REST = ("rest", "rest_matched")
_LARGEST = 1344.0  # a response to int16 Lab of `lab_grid`: 1.12 times half of 300 Lab in steps of 1/8
_GAIN = 2.0  # amplification: on average a response changes by 0.7 of a change, and PatchMatch reverts a part
_SCALE = math.floor(32000 / math.sqrt(_LARGEST))  # of square roots kept in 16 bits


def layout(
    grid: CellGrid, channels: int, rows: int, cell_rows: int | None = None, name: str = "grid"
) -> dict[str, int]:
    """Device memory of a projection with that number of image rows, in bytes by name. Others as for histograms."""
    values = channels * grid.width * rows
    bands = dict.fromkeys((*_BEFORE, *_AFTER, *_REST), 2 * values)
    needed = {**bands, "derivatives": 4 * ORIENTATIONS * values}
    for own in _grids(name):
        needed |= histograms.layout(grid, channels, cell_rows, own, beyond=RADIUS)
    return needed


def _grids(name: str) -> list[str]:
    """Buffers of cells: one for each orientation, one for the residual."""
    return [f"{name}_{n}" for n in range(ORIENTATIONS + 1)]


class SteerableProjection:
    """As `histograms.Projection`, for four bands of every channel. It reads `2 RADIUS` rows above and below.

    `literal`: the residual is kept unchanged, and changes are not amplified.
    """

    looks_beyond = True

    def __init__(
        self, device: Device, buffers: Buffers, grid: CellGrid, low: np.ndarray, high: np.ndarray, name: str = "grid",
        literal: bool = False,
    ):  # fmt: skip
        self.channels = len(low)
        self._responses, self._literal = _Responses(device, buffers, grid, low, high, literal), literal
        self.held: int | None = self._responses.held  # maximum number of rows of the image that it can read at once
        largest = np.full(self.channels, math.ceil(_SCALE * math.sqrt(_LARGEST)))
        ranges = [(-largest, largest)] * ORIENTATIONS + [(low, high)]
        self._projections = [
            Projection(device, buffers, grid, least, most, own)
            for (least, most), own in zip(ranges, _grids(name), strict=True)
        ]

    def learning(self, image: RowSource) -> Iterator[None]:
        """As `histograms.Projection.learning`."""
        sources = self._responses.of(image)
        # in parallel, so that responses to rows are computed once
        for _ in zip(*(p.learning(one) for p, one in zip(self._projections, sources, strict=True)), strict=True):
            yield

    def last_row(self, top: int) -> int:
        """As `histograms.Projection.last_row`."""
        return min(p.last_row(top - RADIUS) for p in self._projections) - RADIUS

    def match(self, image: RowSource, top: int, bottom: int, matched: str, strength: float) -> int:
        """As `histograms.Projection.match`, for the learned image."""
        responses = self._responses
        *bands, rest = responses.around(top, bottom)
        *of_bands, of_rest = self._projections
        rows = responses.cut(top - RADIUS, bottom + RADIUS) if bottom - top < responses.height else (top, bottom)
        for projection, band, after in zip(of_bands, bands, _AFTER, strict=True):
            projection.match(band, *rows, after, 1.0)
        if not self._literal:
            of_rest.match(rest, top, bottom, _REST[1], 1.0)
        return responses.add_changes(top, bottom, matched, strength)


class _Responses:
    """The bands and the residual of an image, for the last requested rows: the residual of `top` to `bottom`, bands of
    `RADIUS` more rows above and below, from which they are synthesized.
    """

    def __init__(
        self, device: Device, buffers: Buffers, grid: CellGrid, low: np.ndarray, high: np.ndarray, literal: bool
    ):
        self._device, self._buffers, self._grid, self._channels = device, buffers, grid, len(low)
        self._gain, self._rest = (1.0, (_REST[0], _REST[0])) if literal else (_GAIN, _REST)
        self._run = device.program("steerable", RADIUS=RADIUS, CHANNELS=len(low))
        self._taps, self._angular, *self._range = (
            device.upload(table.astype(np.float32)) for table in (*filter_bank(), np.asarray(low), np.asarray(high))
        )
        self.image: RowSource  # the argument of `of`
        self.height = grid.height
        self.held = buffers["derivatives"].size // (4 * ORIENTATIONS * len(low) * grid.width)  # rows
        self._made = self._wanted = (0, 0)  # rows of the residual

    def of(self, image: RowSource) -> list[_Response]:
        """Bands and residual of an image, not yet computed."""
        self.image, self._made = image, (0, 0)
        return self.around(0, 0)

    def around(self, top: int, bottom: int) -> list[_Response]:
        """The same, with a request for rows top to bottom and those around them."""
        self._wanted = top, bottom
        if self.image.store is not None:  # others may have used the buffers
            self._made = 0, 0
        return [*(_Response(self, name, RADIUS) for name in _BEFORE), _Response(self, _REST[0], 0)]

    def cut(self, first: int, last: int) -> tuple[int, int]:
        """Clip rows to those that exist."""
        return (first, last) if self._grid.wrap_y else (max(0, first), min(self._grid.height, last))

    def load(self, first: int, last: int, more: int) -> int:
        """Compute rows of a response, with `more` rows than the residual. Returns the row at its buffer's start."""
        if self.image.store is None:
            if not any(self._made):
                self._make(0, self._grid.height)
            return 0
        for rows in (self._wanted, self._made, (first, last)):
            begin, end = self.cut(rows[0] - more, rows[1] + more)
            if rows[0] < rows[1] and begin <= first and last <= end:
                break
        if rows != self._made:
            self._make(*rows)
        return begin

    def _make(self, top: int, bottom: int) -> None:
        b, run, taps, width, height, held = self._buffers, self._run, self._taps, *self._grid.size, self.held
        first, last = self.cut(top - 2 * RADIUS, bottom + 2 * RADIUS)
        if self.image.store is None:
            first, last = 0, height
        self.image.load(first, last)
        begin, end = self._bands_of(top, bottom)
        rows, image, (along_x, along_y) = b["derivatives"], b[self.image.name], self._grid.wraps
        bands, responses = [b[name] for name in _BEFORE], (taps, self._angular)
        run("rows", self._shape(last - first), image, rows, taps, last - first, held, width, along_x)
        place = begin, end - begin, first, held, width, height, along_y
        run("columns", self._shape(end - begin), rows, *bands, *responses, float(_SCALE), *place)
        self._spread(top, bottom, 1.0 / _SCALE**2, 0)
        at = top - first, bottom - top, held, width, along_x
        run("rest", self._shape(bottom - top), image, rows, b[_REST[0]], taps, *at)
        self._made = top, bottom

    def add_changes(self, top: int, bottom: int, matched: str, strength: float) -> int:
        """Synthesize the changes by matching. Returns the row at the start of the image's buffer, and of `matched`."""
        self.load(top, bottom, 0)
        b, width = self._buffers, self._grid.width
        first = 0 if self.image.store is None else self.cut(top - 2 * RADIUS, bottom + 2 * RADIUS)[0]
        self._spread(top, bottom, self._gain / _SCALE**2, 1)
        place = top - first, 0 if self.image.store is not None else top, bottom - top, self.held, width
        self._run(
            "add", self._shape(bottom - top), b[self.image.name], b["derivatives"], *(b[name] for name in self._rest),
            b[matched], self._taps, *self._range, strength, *place, self._grid.wrap_x,
        )  # fmt: skip
        return first

    def _spread(self, top: int, bottom: int, unit: float, changes: int) -> None:
        bands = (self._buffers[name] for name in (*_BEFORE, *_AFTER))
        place = top, bottom - top, self._bands_of(top, bottom)[0], self.held, *self._grid.size, self._grid.wrap_y
        self._run(
            "spread", self._shape(bottom - top), *bands, self._buffers["derivatives"], self._taps, self._angular, unit,
            changes, *place,
        )  # fmt: skip

    def _bands_of(self, top: int, bottom: int) -> tuple[int, int]:
        """The rows of bands in their buffers."""
        return (0, self._grid.height) if self.image.store is None else self.cut(top - RADIUS, bottom + RADIUS)

    def _shape(self, rows: int) -> tuple[int, int]:
        wide = 1 if self._device.lanes == 1 else 16  # cl/steerable.cl, WIDE
        return math.ceil(self._channels * self._grid.width / wide), rows


class _Response:
    """A `RowSource` that computes a response to an image on demand."""

    def __init__(self, responses: _Responses, name: str, more: int):
        self._responses, self.name, self._more = responses, name, more

    @property
    def store(self) -> object:
        """None: the buffer holds all rows."""
        return self._responses.image.store

    def bands(self, first: int, last: int, most: int | None = None) -> Iterator[tuple[int, int]]:
        """As for the image, without the rows around them."""
        return self._responses.image.bands(first, last, most or self._responses.held - 4 * RADIUS)

    def load(self, first: int, last: int) -> int:
        """As for the image."""
        return self._responses.load(first, last, self._more)
