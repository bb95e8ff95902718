# SPDX-License-Identifier: Apache-2.0
"""Where an image is not stationary: MJH17 eq. 1 place by place, for images of any size.

MJH17 eq. 1 is a mean over pairs of places; its inner mean, over the second place alone, says how unlike the rest of
the image the first one is. `stationarity.stationarity_cost` is the outer mean over 32 x 32 places and holds the image;
here local histograms stand on a grid of cells, which is filled in one look at the image, and every cell is a place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..images import Image
from ..session import Session
from ..working import Lens
from .cells import Cells, correlated, padded, smoothing_taps, survey
from .stationarity import BINS, RANGES

SHARES = 64  # of a bin: a value between two bins is shared between them in so many whole parts
_CELLS_PER_SIGMA = 2.5
_LARGEST_CELL = 512  # px


@dataclass(frozen=True)
class Deviation:
    """How unlike the rest of an image its places are.

    Attributes
    ----------
    cells : Cells
    local : (down + 4, across + 4) float
        At the cells' centres with the margin of `cells.MARGIN`: the mean earth mover's distance between the local
        histogram there and those of all cells, summed over channels, in Lab units.
    cost : float
        MJH17 eq. 1: the mean of it, cells counted by their pixels.
    """

    cells: Cells
    local: np.ndarray
    cost: float


def cells_for(image: Image, sigma: float) -> Cells:
    """Cells of sigma / 2.5, at least 1 and at most 512 px."""
    return Cells(image.first.window, max(1, min(_LARGEST_CELL, round(sigma / _CELLS_PER_SIGMA))))


def deviation_of(image: Image, lens: Lens, sigma: float, session: Session) -> Deviation:
    """The local deviation from stationarity of an image's first part, from one look at its pixels.

    Parameters
    ----------
    image : Image
    lens : Lens
    sigma : float
        Of the Gaussian window w_d of MJH17 eq. 3, px.
    session : Session

    Raises
    ------
    ImageError
        NaN or Inf, or so many cells that their histograms do not fit the budget.
    """
    cells, count = cells_for(image, sigma), lens.count
    places = (cells.down + 4) * (cells.across + 4)
    need = 4 * count * BINS * cells.down * cells.across + 8 * 8 * places
    session.require(need, f"sigma {sigma:g} px", "take a larger sigma")
    ranges = RANGES if lens.space is not None else (RANGES[0],) * count
    histograms = np.zeros((cells.down, count, cells.across, BINS), np.int32)
    column = np.repeat(np.arange(cells.across, dtype=np.int32), cells.side)[: cells.window.width] * np.int32(BINS)

    def look(values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
        return cell_histograms(values, opaque, column, cells.across, ranges)

    def keep(row: int, found: np.ndarray) -> None:
        histograms[row] += found

    survey(image, lens, cells, session, look, keep)
    return _deviation(cells, histograms, sigma, ranges)


def cell_histograms(
    values: np.ndarray,
    opaque: np.ndarray | None,
    column: np.ndarray,
    across: int,
    ranges: tuple[tuple[float, float], ...],
) -> np.ndarray:
    """Histograms with triangular bins (the Parzen window w_r of MJH17 eq. 3) in whole numbers, per cell of a row.

    Parameters
    ----------
    values : (height, width, >= channels) float32
    opaque : (height, width) bool or None
    column : (width,) int32
        `BINS` times the cell in which a column of pixels lies.
    across : int
        Cells in the row.
    ranges : per channel (low, high)
        Centres of the first and last bin.

    Returns
    -------
    (channels, across, BINS) int32
        A pixel counts `SHARES`.
    """
    out = np.empty((len(ranges), across, BINS), np.int32)
    for c, (low, high) in enumerate(ranges):
        per_unit = np.float32((BINS - 1) * SHARES / (high - low))
        place = (values[..., c] - np.float32(low)) * per_unit
        place = np.rint(np.clip(place, 0, (BINS - 1) * SHARES)).astype(np.int32)
        lower = np.minimum(place >> 6, BINS - 2)
        share = place - (lower << 6)
        lower += column
        if opaque is not None:
            lower, share = lower[opaque], share[opaque]
        number = np.bincount(lower.ravel(), minlength=across * BINS).reshape(across, BINS)
        # sums of whole numbers, exact in doubles
        upper = np.bincount(lower.ravel(), share.ravel(), across * BINS).reshape(across, BINS).astype(np.int32)
        out[c] = number * SHARES - upper
        out[c, :, 1:] += upper[:, :-1]
    return out


def _deviation(
    cells: Cells, histograms: np.ndarray, sigma: float, ranges: tuple[tuple[float, float], ...]
) -> Deviation:
    taps = smoothing_taps(sigma, cells.side)
    number = padded(histograms[:, 0].sum(-1) / SHARES)
    weight = correlated(number, taps, taps)
    known = weight > 0
    safe = np.where(known, weight, 1.0)
    share_of_places = number.ravel()  # a place counts by its pixels: the margin not at all
    local = np.zeros(number.shape)
    for c, (low, high) in enumerate(ranges):
        below = np.zeros(histograms.shape[:1] + histograms.shape[2:3])
        for b in range(BINS - 1):  # the cumulative of the last bin is 1 everywhere
            below += histograms[:, c, :, b] / SHARES
            cumulative = correlated(padded(below), taps, taps) / safe
            local += _mean_distance(cumulative.ravel(), share_of_places).reshape(local.shape) * (
                (high - low) / (BINS - 1)
            )
    pixels = share_of_places.sum()
    local = np.where(known, local, 0.0)
    return Deviation(cells, local, float((local * number).sum() / pixels) if pixels > 0 else 0.0)


def _mean_distance(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """sum_j w_j |v_i - v_j| / sum_j w_j for every i, by sorting in N log N."""
    order = np.argsort(values, kind="stable")
    v, w = values[order], weights[order]
    up_to, sum_up_to = np.cumsum(w), np.cumsum(w * v)
    distance = v * (2.0 * up_to - up_to[-1]) + sum_up_to[-1] - 2.0 * sum_up_to
    out = np.empty_like(values)
    out[order] = np.maximum(distance, 0.0) / max(up_to[-1], 1.0)
    return out
