# SPDX-License-Identifier: Apache-2.0
"""Slow drift of an image: the local mean and the local contrast of its values at a scale sigma."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

from ..color.lab import Lens
from ..color.lab_grid import SUM_STEPS
from ..core.image import Image
from ..core.window import Window
from ..deferred import np
from ..scan import scan
from ..session import Session
from ..stationarity.grid_statistics import MARGIN, Cells, Surface, close_margins, correlated, smoothing_taps

_LIMIT = 2048 * SUM_STEPS  # what lies beyond is taken as this: the squares in a cell still add up exactly in doubles
_CELLS_PER_SIGMA = 4  # more than elsewhere: these cells are read as a surface, pixel by pixel
_PLANES = 20  # of all places that lie between the sums and what is made of them, at most
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
        Local mean at the cells' centres, with the margin of `grid_statistics.MARGIN`.
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


def drift_of(
    image: Image, lens: Lens, sigma: float, session: Session, wraps: tuple[bool, bool] = (False, False)
) -> Drift | None:
    """The statistics of an image's first part at that scale, from one look at its pixels.

    Parameters
    ----------
    image : Image
    lens : Lens
    sigma : float
        px.
    session : Session
    wraps : (bool, bool)
        The image is a torus along y, along x.

    Returns
    -------
    Drift or None
        None where no pixel has alpha.

    Raises
    ------
    ImageError
        NaN or Inf, or so many cells that they do not fit the budget.
    """
    cells, count = Cells.for_sigma(image.first.window, sigma, _LARGEST_CELL, _CELLS_PER_SIGMA, wraps), lens.count
    places = cells.down + 2 * MARGIN, cells.across + 2 * MARGIN
    layout = dict.fromkeys(("mean", "left", "deviation"), ((*places, count), np.float64))
    layout["sums"] = ((*places, 1 + 2 * count), np.float64)
    advice, beside = "take a larger sigma", 8 * _PLANES * math.prod(places)
    scratch = session.scratch(layout, f"sigma {sigma:g} px", advice, beside)
    sums = scratch["sums"][MARGIN:-MARGIN, MARGIN:-MARGIN]

    def look(values: np.ndarray, opaque: np.ndarray | None, piece: Window) -> list[np.ndarray]:
        rows = [row.inside(piece) for row in cells.rows(piece)]
        return [cell_sums(values[at][..., :count], None if opaque is None else opaque[at], cells) for at in rows]

    keep = functools.partial(cells.add, sums)
    cell = 0 if wraps[0] else cells.side  # around a torus rows of cells differ by a pixel
    scan(image.first, lens, session, look, keep, cell=cell, larger=2, progress=session.advance)
    if not sums[..., 0].any():
        return None
    return _drift(cells, scratch, sigma)


def cell_sums(values: np.ndarray, opaque: np.ndarray | None, cells: Cells) -> np.ndarray:
    """Number, sums and sums of squares of values on the integer grid, per cell of a row of cells.

    Whole numbers held in doubles, which add them exactly in any order.

    Parameters
    ----------
    values : (height, width, channels) float32
    opaque : (height, width) bool or None
    cells : Cells

    Returns
    -------
    (across, 1 + 2 channels) float64
    """
    height, width, count = values.shape
    starts = cells.starts
    out = np.empty((len(starts), 1 + 2 * count))
    if opaque is None:
        out[:, 0] = np.diff(starts, append=width) * height
    else:
        out[:, 0] = np.add.reduceat(np.count_nonzero(opaque, axis=0), starts)
    for c in range(count):
        grid = np.clip(np.rint(values[..., c] * np.float32(SUM_STEPS)), -_LIMIT, _LIMIT)
        if opaque is not None:
            grid *= opaque
        grid = grid.astype(np.float64)
        out[:, 1 + c] = np.add.reduceat(grid.sum(0), starts)
        out[:, 1 + count + c] = np.add.reduceat(np.einsum("ij,ij->j", grid, grid), starts)
    return out


def _drift(cells: Cells, scratch: dict[str, np.ndarray], sigma: float) -> Drift:
    """From sums and into arrays of all places, the margin's too; channel by channel, so that little lies between."""
    wraps = cells.wraps
    torus = tuple(slice(MARGIN, -MARGIN) if around else slice(None) for around in wraps)  # has no margin of its own
    sums, mean, left, deviation = (scratch[name][torus] for name in ("sums", "mean", "left", "deviation"))
    number, count = sums[..., 0], mean.shape[-1]
    taps_y, taps_x = (smoothing_taps(sigma, step) for step in cells.steps)
    fit = _LocalFit(number, taps_y, taps_x, wraps)
    weight = np.where(fit.weight > 0, fit.weight, 1.0)
    for c in range(count):
        total, squares = sums[..., 1 + c] / SUM_STEPS, sums[..., 1 + count + c] / SUM_STEPS**2
        own = mean[..., c] = fit.means(total)
        # what is left of the sum of squares when the local mean, constant in a cell, is taken off every value
        left[..., c] = np.maximum(squares - 2.0 * own * total + own**2 * number, 0.0)
        deviation[..., c] = np.sqrt(correlated(left[..., c], taps_y, taps_x, wraps=wraps) / weight)
    pixels = number.sum()
    overall = (sums[..., 1 : 1 + count] / SUM_STEPS).sum((0, 1)) / pixels
    mean[fit.weight <= 0] = overall
    for name in ("mean", "deviation"):
        close_margins(scratch[name], wraps)
    deviation_overall = np.sqrt(left.sum((0, 1)) / pixels)
    return Drift(cells, scratch["mean"], scratch["deviation"], overall, deviation_overall)


class _LocalFit:
    """Local means: the value at a cell's centre of a plane fitted to what lies around it.

    A plain weighted mean leans inwards at the border and away from holes, and would leave a part of a gradient of
    light there; a fitted plane does not. Inside, both are the same.

    Parameters
    ----------
    number : (down, across) float
        Pixels of the cells.
    taps_y, taps_x : (2 radius + 1,) float
    wraps : (bool, bool)
        The cells lie on a torus along y, along x.
    """

    def __init__(self, number: np.ndarray, taps_y: np.ndarray, taps_x: np.ndarray, wraps: tuple[bool, bool]):
        (y0, y1, y2), (x0, x1, x2) = (_moments(taps) for taps in (taps_y, taps_x))
        self._along, self._wraps = ((y0, x0), (y0, x1), (y1, x0)), wraps
        self.weight = self._around(number, y0, x0)
        self._safe = safe = np.where(self.weight > 0, self.weight, 1.0)
        self._x, self._y = x, y = [self._around(number, *pair) / safe for pair in self._along[1:]]
        xx, yy, xy = (self._around(number, *pair) / safe for pair in ((y0, x2), (y2, x0), (y1, x1)))
        self._xx = xx - x * x + _RIDGE * float(x2.sum())
        self._yy = yy - y * y + _RIDGE * float(y2.sum())
        self._xy = xy - x * y
        self._inverse = 1.0 / (self._xx * self._yy - self._xy * self._xy)

    def means(self, total: np.ndarray) -> np.ndarray:
        """Of values whose sums in the cells are `total`, (down, across)."""
        x, y, xx, yy, xy = self._x, self._y, self._xx, self._yy, self._xy
        mean, along_x, along_y = (self._around(total, *pair) / self._safe for pair in self._along)
        along_x, along_y = along_x - x * mean, along_y - y * mean
        slope_x = (along_x * yy - along_y * xy) * self._inverse
        slope_y = (along_y * xx - along_x * xy) * self._inverse
        return mean - slope_x * x - slope_y * y

    def _around(self, grid: np.ndarray, taps_y: np.ndarray, taps_x: np.ndarray) -> np.ndarray:
        return correlated(grid, taps_y, taps_x, wraps=self._wraps)


def _moments(taps: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Taps, and these times the cells away and their square."""
    away = np.arange(len(taps)) - len(taps) // 2
    return taps, taps * away, taps * away**2


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
    shape = (*drift.mean.shape[:2], 4)
    means, gains = np.zeros(shape, np.float32), np.ones(shape, np.float32)
    means[..., :count], gains[..., :count] = drift.mean, gain
    share, level = np.zeros(4, np.float32), np.zeros(4, np.float32)
    share[:count], level[:count] = 1.0 - amount, amount * target
    return Correction(Surface(means, drift.cells), Surface(gains, drift.cells), share, level)
