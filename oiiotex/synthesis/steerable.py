# SPDX-License-Identifier: Apache-2.0
"""project_steer of MJH17 section 4.3: the local histograms of steerable responses are matched to the image's own.

Departures from the paper: its pyramid is Simoncelli's, here the filters are those of `analysis/steerable.py`, and what
none of them sees (low and high frequencies: the image less its own responses) is one rest instead of two residuals.
The rest is matched as well, as Heeger and Bergen match theirs: the twelve responses alone leave a photo's stains and
gradients of light, which are slower than what they see, as they are.
"""

from __future__ import annotations

import math

import numpy as np

from ..analysis.steerable import ANGULAR, ORIENTATIONS, RADIUS, TAPS
from ..device import Buffers, Device
from .histograms import Cells, Projection

_BEFORE = tuple(f"before{o}" for o in range(ORIENTATIONS))
_AFTER = tuple(f"after{o}" for o in range(ORIENTATIONS))
_REST = ("rest", "rest_matched")
_LARGEST = 1344.0  # a response to int16 Lab of `patchmatch.to_grid`: 1.12 times half of 300 Lab in steps of 1/8
_GAIN = (
    2.0  # changes come back weakened: a response sees 0.7 of what it gave in the mean, and PatchMatch takes some back
)
_SCALE = math.floor(32000 / math.sqrt(_LARGEST))  # of the roots that are kept in 16 bits


def layout(cells: Cells, channels: int = 3) -> dict[str, int]:
    """Device memory of a projection, in bytes by name."""
    pixels = cells.width * cells.height
    bands = dict.fromkeys((*_BEFORE, *_AFTER, *_REST), 2 * channels * pixels)
    return {**cells.layout(channels), **bands, "derivatives": 4 * ORIENTATIONS * channels * pixels}


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
        what = (device, buffers, cells, sigma)
        self._bands = Projection(*what, -largest, largest, wrap_x, wrap_y)
        self._rest = Projection(*what, low, high, wrap_x, wrap_y)
        self._taps, self._angular, *self._range = (
            device.upload(table.astype(np.float32)) for table in (TAPS, ANGULAR, np.asarray(low), np.asarray(high))
        )

    def project(self, image: str, matched: str, strength: float = 1.0) -> None:
        """Write to buffer `matched` what lies `strength` times the way from buffer `image` to its projection."""
        b, run, taps, angular = self._buffers, self._run, self._taps, self._angular
        width, height = self._cells.width, self._cells.height
        along_x, along_y = (width, height, self._wrap_x), (width, height, self._wrap_y)
        wide = 1 if self._device.lanes == 1 else 16  # cl/steerable.cl, WIDE
        shape, rows, unit = (math.ceil(self.channels * width / wide), height), b["derivatives"], 1.0 / _SCALE**2
        before, after, rest = ([b[n] for n in names] for names in (_BEFORE, _AFTER, _REST))
        run("rows", shape, b[image], rows, taps, *along_x)
        run("columns", shape, rows, *before, taps, angular, float(_SCALE), *along_y)
        run("spread", shape, *before, *after, rows, taps, angular, unit, 0, *along_y)
        run("rest", shape, b[image], rows, rest[0], taps, *along_x)
        for one, other in zip(_BEFORE, _AFTER, strict=True):
            self._bands.project(one, other)
        self._rest.project(*_REST)
        run("spread", shape, *before, *after, rows, taps, angular, _GAIN * unit, 1, *along_y)
        run("add", shape, b[image], rows, *rest, b[matched], taps, *self._range, strength, *along_x)
