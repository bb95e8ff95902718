# SPDX-License-Identifier: Apache-2.0
"""Slow drift of an image: the local mean and the local contrast of its values at a scale sigma."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..images import Image
from ..session import Session
from ..windows import Window
from ..working import Lens
from .cells import Cells, Surface, correlated, padded, smoothing_taps, survey

STEPS = 64  # of the integer grid, per unit of Lab
_LIMIT = 2048 * STEPS  # what lies beyond is taken as this: the squares in a cell still add up exactly in doubles
_CELLS_PER_SIGMA = 4
_LARGEST_CELL = 256  # px; how many values can lie in a cell is bounded by it
_NOISE = 1.0  # Lab: contrast below it is taken for noise and hardly raised
MOST_GAIN = 2.0  # contrast is at most doubled and at least halved
_RIDGE = 0.02  # of sigma^2, in the fit of a slope: nothing where there is something to fit, all where there is not


@dataclass(frozen=True)
class Drift:
    """Local and global statistics of an image.

    Attributes
    ----------
    cells : Cells
    mean : (down + 4, across + 4, channels) float
        Local mean at the cells' centres, with the margin of `cells.MARGIN`.
    deviation : same shape
        Local standard deviation of what is left when the local mean is taken off.
    overall_mean, overall_deviation : (channels,) float
        Of the whole image; the deviation again without the drift.
    """

    cells: Cells
    mean: np.ndarray
    deviation: np.ndarray
    overall_mean: np.ndarray
    overall_deviation: np.ndarray


def cells_for(image: Image, sigma: float) -> Cells:
    """Cells of sigma / 4, at least 1 and at most 256 px."""
    return Cells(image.first.window, max(1, min(_LARGEST_CELL, round(sigma / _CELLS_PER_SIGMA))))


def drift_of(image: Image, lens: Lens, sigma: float, session: Session) -> Drift | None:
    """The statistics of an image's first part at that scale, from one look at its pixels.

    Parameters
    ----------
    image : Image
    lens : Lens
    sigma : float
        px.
    session : Session

    Returns
    -------
    Drift or None
        None where no pixel has alpha.

    Raises
    ------
    ImageError
        NaN or Inf, or so many cells that they do not fit the budget.
    """
    cells, count = cells_for(image, sigma), lens.count
    need = 8 * (1 + 2 * count + 6 + 4 * count) * (cells.down + 4) * (cells.across + 4)
    session.require(need, f"sigma {sigma:g} px", "take a larger sigma")
    sums = np.zeros((cells.down, cells.across, 1 + 2 * count))
    starts = cells.starts()

    def look(values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
        return cell_sums(values[..., :count], opaque, starts)

    def keep(row: int, found: np.ndarray) -> None:
        sums[row] += found

    survey(image, lens, cells, session, look, keep)
    if not sums[..., 0].any():
        return None
    return _drift(cells, sums, sigma, count)


def cell_sums(values: np.ndarray, opaque: np.ndarray | None, starts: np.ndarray) -> np.ndarray:
    """Number, sums and sums of squares of values on the integer grid, per cell of a row of cells.

    Whole numbers held in doubles, which add them exactly in any order.

    Parameters
    ----------
    values : (height, width, channels) float32
    opaque : (height, width) bool or None
    starts : (across,) int
        First column of every cell.

    Returns
    -------
    (across, 1 + 2 channels) float64
    """
    height, width, count = values.shape
    out = np.empty((len(starts), 1 + 2 * count))
    if opaque is None:
        out[:, 0] = np.diff(starts, append=width) * height
    else:
        out[:, 0] = np.add.reduceat(np.count_nonzero(opaque, axis=0), starts)
    for c in range(count):
        grid = np.clip(np.rint(values[..., c] * np.float32(STEPS)), -_LIMIT, _LIMIT)
        if opaque is not None:
            grid *= opaque
        grid = grid.astype(np.float64)
        out[:, 1 + c] = np.add.reduceat(grid.sum(0), starts)
        out[:, 1 + count + c] = np.add.reduceat(np.einsum("ij,ij->j", grid, grid), starts)
    return out


def _drift(cells: Cells, sums: np.ndarray, sigma: float, count: int) -> Drift:
    sums = padded(sums)
    number, total, squares = sums[..., :1], sums[..., 1 : 1 + count] / STEPS, sums[..., 1 + count :] / STEPS**2
    taps = smoothing_taps(sigma, cells.side)
    mean = _local_fit(number, total, taps)
    # what is left of the sum of squares when the local mean, constant in a cell, is taken off every value
    left = np.maximum(squares - 2.0 * mean * total + mean**2 * number, 0.0)
    weight = correlated(number, taps, taps)
    variance = correlated(left, taps, taps) / np.where(weight > 0, weight, 1.0)
    pixels = number.sum()
    overall = total.sum((0, 1)) / pixels
    mean = np.where(weight > 0, mean, overall)
    return Drift(cells, mean, np.sqrt(variance), overall, np.sqrt(left.sum((0, 1)) / pixels))


def _local_fit(number: np.ndarray, total: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """Local means (down, across, channels): the value at a cell's centre of a plane fitted to what lies around it.

    A plain weighted mean leans inwards at the border and away from holes, and would leave a part of a gradient of
    light there; a fitted plane does not. Inside, both are the same.
    """
    away = np.arange(len(taps)) - len(taps) // 2
    first, second = taps * away, taps * away**2
    ridge = _RIDGE * float(second.sum())
    weight = correlated(number, taps, taps)[..., 0]
    safe = np.where(weight > 0, weight, 1.0)
    x, y = (correlated(number, *pair)[..., 0] / safe for pair in ((taps, first), (first, taps)))
    xx, yy, xy = (correlated(number, *pair)[..., 0] / safe for pair in ((taps, second), (second, taps), (first, first)))
    xx, yy, xy = xx - x * x + ridge, yy - y * y + ridge, xy - x * y
    inverse = 1.0 / (xx * yy - xy * xy)
    out = np.empty(total.shape)
    for c in range(total.shape[-1]):
        values = total[..., c]
        mean, along_x, along_y = (
            correlated(values, *pair) / safe for pair in ((taps, taps), (taps, first), (first, taps))
        )
        along_x, along_y = along_x - x * mean, along_y - y * mean
        slope_x = (along_x * yy - along_y * xy) * inverse
        slope_y = (along_y * xx - along_x * xy) * inverse
        out[..., c] = mean - slope_x * x - slope_y * y
    return out


@dataclass(frozen=True)
class Correction:
    """What takes drift out of an image: (value - mean) * gain + share * mean + level, per channel.

    Mean and gain are surfaces of four fields, as `Lens.values` has four values; share and level are constants,
    (4,) float32.
    """

    mean: Surface
    gain: Surface
    share: np.ndarray
    level: np.ndarray

    def apply(self, values: np.ndarray, window: Window) -> None:
        """Correct (height, width, 4) float32 in place; `window` says which pixels they are."""
        with_mean = bool(self.share.any())
        for line, y in zip(values, range(window.top, window.bottom), strict=True):
            mean = self.mean.row(y, window.left, window.right)
            line -= mean
            line *= self.gain.row(y, window.left, window.right)
            if with_mean:
                line += mean * self.share
            line += self.level


def correction(drift: Drift, amount: float, contrast: float, target: np.ndarray) -> Correction:
    """Bring local means to `target` and local contrast to the overall one.

    The gain is ((G + 1) / (g + 1)) ^ contrast for an overall deviation G and a local g in Lab units, within 1/2 and 2:
    what has no detail must not have its noise raised.

    Parameters
    ----------
    drift : Drift
    amount : float
        0: nothing happens; 1: all of it.
    contrast : float
        0: contrast stays; 1: it becomes even, as far as the limits let it.
    target : (channels,) float
    """
    count = drift.mean.shape[-1]
    gain = ((drift.overall_deviation + _NOISE) / (drift.deviation + _NOISE)) ** contrast
    gain = 1.0 + amount * (np.clip(gain, 1.0 / MOST_GAIN, MOST_GAIN) - 1.0)
    means, gains = np.zeros((*drift.mean.shape[:2], 4)), np.ones((*drift.mean.shape[:2], 4))
    means[..., :count], gains[..., :count] = drift.mean, gain
    share, level = np.zeros(4, np.float32), np.zeros(4, np.float32)
    share[:count], level[:count] = 1.0 - amount, amount * target
    return Correction(Surface(means, drift.cells), Surface(gains, drift.cells), share, level)
