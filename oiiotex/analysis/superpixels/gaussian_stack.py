# SPDX-License-Identifier: Apache-2.0
"""Mean colors of superpixels in a Gaussian stack of the image: LSA16 section 3.3.

I_g = G_dsigma * I_(g-1), so level g has a total blur of sqrt(sum of dsigma^2) px. The paper blurs the whole
image. Here squares of pixels are blurred, doubled in size whenever the blur is three squares wide: a level costs
milliseconds, and memory does not grow with the image. A square's own width counts as part of the blur.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Iterator, Sequence

from ...engine.color.lab_grid import FINE_STEPS
from ...engine.core.elementary import gaussian_taps
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers, offset_table
from ...engine.opencl.device import Download
from ...engine.session.resources import Resources
from .run_length import OUTSIDE
from .squares import WIDEST
from .superpixels import Superpixels

_MARGIN = 16  # squares of zeros around the image: maximum radius of taps, and room for wide registers
_AHEAD = 4  # levels on which the device works ahead while the host merges
_BLUR_IN_SQUARES = 3.0  # a blur of that width allows squares of twice the side


def blurred_sums(superpixels: Superpixels, sigmas: Sequence[float], resources: Resources) -> Iterator[np.ndarray]:
    """Sums of L, a, b over each superpixel in the blurred image, for every level after the first.

    `sigmas`: scales of the levels, px, increasing; returns (n, 3) float64, Lab units.
    """
    if superpixels.count == 0 or len(sigmas) < 2:
        return
    reduced = superpixels.reduced
    planes = reduced.sums.transpose(2, 0, 1).astype(np.float32)  # L, a, b, number x rows x columns of squares
    planes[:3] /= FINE_STEPS
    stack = _Stack(superpixels, planes, resources)
    with stack.buffers:
        wanted, coming = 0.0, deque[Download]()
        for number, (before, sigma) in enumerate(itertools.pairwise(sigmas)):
            wanted += (sigma - before) ** 2
            stack.blur_to(wanted)
            coming.append(stack.sums_later(number))
            if len(coming) == _AHEAD:
                yield _lab(coming.popleft())
        yield from map(_lab, coming)


def _lab(sums: Download) -> np.ndarray:
    return sums.array()[:, :3].astype(np.float64)


class _Stack:
    """The image on the device, blurred in steps."""

    def __init__(self, superpixels: Superpixels, planes: np.ndarray, resources: Resources):
        self._device, self._superpixels = resources.device, superpixels
        self._run = self._device.program("superpixels")
        self._side = superpixels.reduced.side
        self._variance = (self._side**2 - 1) / 12  # of the current blur, px^2
        _, self.height, self.width = planes.shape
        runs = superpixels.runs
        order = np.argsort(runs.label, kind="stable")[np.count_nonzero(runs.label == OUTSIDE) :]  # OUTSIDE is the least
        starts = offset_table(np.searchsorted(runs.label[order], np.arange(superpixels.count + 1)))
        table = np.empty((len(order), 3), np.int32)  # there are millions of runs: one column at a time
        for column, values in enumerate((runs.rows, lambda: runs.left, runs.right)):
            table[:, column] = values()[order]
        first, last = starts[:-1], starts[1:] - 1
        self._extent = (  # left, top, right, bottom of every superpixel's pixels, all inclusive
            np.minimum.reduceat(table[:, 1], first),
            table[first, 0],
            np.maximum.reduceat(table[:, 2], first) - 1,
            table[last, 0],
        )
        self._tables = self._device.upload(starts), self._device.upload(table)
        boxes = self._boxes()
        size = self._plane * 4 * 4
        layout = {"image": size, "other": size, "shares": 2 * int(boxes[-1, 3])}
        layout |= {f"sums{n}": 16 * superpixels.count for n in range(_AHEAD)}
        self.buffers = Buffers(self._device, layout, resources.budget, "the Gaussian stack")
        padded = np.zeros((4, self.height + 2 * _MARGIN, self._stride), np.float32)  # planes x rows x columns
        padded[:, _MARGIN:-_MARGIN, _MARGIN : _MARGIN + self.width] = planes
        self._clear()
        self._device.write(self.buffers["image"], padded)
        self._share(boxes)

    @property
    def _stride(self) -> int:
        return self.width + 2 * _MARGIN

    @property
    def _plane(self) -> int:
        return self._stride * (self.height + 2 * _MARGIN)

    def _clear(self) -> None:
        for name in ("image", "other"):
            self._device.fill(self.buffers[name], np.float32(0), 4 * self._plane)

    def _boxes(self) -> np.ndarray:
        """In the format of cl/superpixels.cl: (n + 1, 4) int32, the last one only an end."""
        left, top, right, bottom = (edge // self._side for edge in self._extent)
        sizes = (right - left + 1) * (bottom - top + 1).astype(np.int64)
        boxes = np.zeros((len(sizes) + 1, 4), np.int32)
        boxes[:-1, :3] = np.stack([left, top, right - left + 1], 1)
        boxes[1:, 3] = offset_table(np.cumsum(sizes))
        return boxes

    def _share(self, boxes: np.ndarray) -> None:
        self._box_table = self._device.upload(boxes)
        count = self._superpixels.count
        tables = self._box_table, *self._tables
        self._run("shares", (count,), *tables, self.buffers["shares"], count, self._side, team=True)

    def blur_to(self, variance: float) -> None:
        """Blur until the total blur has that variance, px^2, or that of the squares if it is larger."""
        missing = (variance - self._variance) / self._side**2
        taps = taps_of(missing)
        if len(taps) > 1:
            self._blur(taps)
            self._variance += float(taps @ np.square(np.arange(len(taps)) - len(taps) // 2.0)) * self._side**2
        while self._variance >= (_BLUR_IN_SQUARES * self._side) ** 2 and self._side < WIDEST:
            self._halve()

    def _blur(self, taps: np.ndarray) -> None:
        table = self._device.upload(taps.astype(np.float32))
        lanes = 1 if self._device.lanes == 1 else 8
        shape = -(-self.width // lanes), 4 * self.height
        for step in (1, self._stride):
            images = self.buffers["image"], self.buffers["other"]
            numbers = len(taps) // 2, self.width, self.height, self._stride, self._plane, _MARGIN, step
            self._run("blur", shape, *images, table, *numbers)
            self.buffers.swap("image", "other")

    def _halve(self) -> None:
        old = self._stride, self._plane
        self.width, self.height = -(-self.width // 2), -(-self.height // 2)
        self._device.fill(self.buffers["other"], np.float32(0), 4 * self._plane)
        images = self.buffers["image"], self.buffers["other"]
        numbers = *old, self.width, self.height, self._stride, self._plane, _MARGIN
        self._run("halve", (self.width, 4 * self.height), *images, *numbers)
        self.buffers.swap("image", "other")
        self._device.fill(self.buffers["other"], np.float32(0), 4 * self._plane)
        self._variance += 3 * self._side**2 / 12
        self._side *= 2
        self._share(self._boxes())

    def sums_later(self, number: int) -> Download:
        """(n, 4) float32: sums of Lab over each superpixel, downloaded asynchronously. `number`: the level."""
        count = self._superpixels.count
        image, shares, sums = (self.buffers[name] for name in ("image", "shares", f"sums{number % _AHEAD}"))
        numbers = count, self._stride, self._plane, _MARGIN
        self._run("gather", (count,), self._box_table, shares, image, sums, *numbers, team=True)
        return self._device.read_later(sums, (count, 4), np.float32)


def taps_of(variance: float) -> np.ndarray:
    """Weights over squares, (2 radius + 1,) float64, of a Gaussian of that variance in squared squares."""
    if variance < 0.01:
        return np.ones(1)
    if variance <= 0.5:  # sampled, such a narrow Gaussian would have another variance
        return np.array([variance / 2, 1 - variance, variance / 2])
    return gaussian_taps(math.sqrt(variance), 3.0, _MARGIN - 8)
