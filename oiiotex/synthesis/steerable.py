# SPDX-License-Identifier: Apache-2.0
"""project_steer of MJH17 section 4.3: the local histograms of steerable responses are matched to the image's own.

Departures from the paper: its pyramid is Simoncelli's, here the filters are those of `analysis/steerable.py`. What is
no response (the low and high frequencies) stays as it is, so adding what the changed responses weigh to the image is
the collapse of Heeger and Bergen's pyramid with its residuals.
"""

from __future__ import annotations

import math

import numpy as np

from ..analysis.steerable import ANGULAR, ORIENTATIONS, RADIUS, TAPS
from ..device import Buffers, Device
from .histograms import Cells, Projection

_BEFORE = tuple(f"before{o}" for o in range(ORIENTATIONS))
_AFTER = tuple(f"after{o}" for o in range(ORIENTATIONS))
_LARGEST = 1344.0  # a response to int16 Lab of `patchmatch.to_grid`: 1.12 times half of 300 Lab in steps of 1/8
_SCALE = math.floor(32000 / math.sqrt(_LARGEST))  # of the roots that are kept in 16 bits


def layout(cells: Cells, channels: int = 3) -> dict[str, int]:
    """Device memory of a projection, in bytes by name."""
    values = channels * cells.width * cells.height
    bands = dict.fromkeys((*_BEFORE, *_AFTER), 2 * values)
    return {**cells.layout(channels), **bands, "derivatives": 4 * ORIENTATIONS * values}


class SteerableProjection:
    """As `histograms.Projection`, of four bands of every channel; `project` has the same meaning."""

    def __init__(
        self, device: Device, buffers: Buffers, cells: Cells, sigma: float, low: np.ndarray, high: np.ndarray,
        wrap_x: bool, wrap_y: bool,
    ):  # fmt: skip
        self._device, self._buffers, self._cells = device, buffers, cells
        self.channels = len(low)
        self._run = device.program("steerable", RADIUS=RADIUS, CHANNELS=self.channels)
        self._wrap_x, self._wrap_y = int(wrap_x), int(wrap_y)
        largest = np.full(self.channels, math.ceil(_SCALE * math.sqrt(_LARGEST)))
        self._bands = Projection(device, buffers, cells, sigma, -largest, largest, wrap_x, wrap_y)
        self._taps, self._angular, *self._range = (
            device.upload(table.astype(np.float32)) for table in (TAPS, ANGULAR, np.asarray(low), np.asarray(high))
        )

    def project(self, image: str, matched: str, strength: float = 1.0) -> None:
        """Write to buffer `matched` what lies `strength` times the way from buffer `image` to its projection."""
        b, run, taps, angular = self._buffers, self._run, self._taps, self._angular
        width, height = self._cells.width, self._cells.height
        wide = 1 if self._device.lanes == 1 else 16  # cl/steerable.cl, WIDE
        shape, rows = (math.ceil(self.channels * width / wide), height), b["derivatives"]
        before, after = [b[n] for n in _BEFORE], [b[n] for n in _AFTER]
        run("rows", shape, b[image], rows, taps, width, height, self._wrap_x)
        run("columns", shape, rows, *before, taps, angular, float(_SCALE), width, height, self._wrap_y)
        for one, other in zip(_BEFORE, _AFTER, strict=True):
            self._bands.project(one, other)
        run("spread", shape, *before, *after, rows, taps, angular, 1.0 / _SCALE**2, width, height, self._wrap_y)
        run("add", shape, b[image], rows, b[matched], taps, *self._range, strength, width, height, self._wrap_x)
