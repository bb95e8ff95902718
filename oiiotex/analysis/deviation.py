# SPDX-License-Identifier: Apache-2.0
"""Where an image is not stationary: MJH17 eq. 1 place by place, for images of any size.

MJH17 eq. 1 is a mean over pairs of places; its inner mean, over the second place alone, says how unlike the rest of
the image the first one is. `stationarity.stationarity_cost` is the outer mean over 32 x 32 places and holds the image;
here local histograms stand on a grid of cells, which is filled in one look at the image, and every cell is a place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb

import numpy as np

from ..images import Image
from ..session import Session
from ..working import Lens
from .cells import Cells, correlated, padded, smoothing_taps, survey
from .responses import survey_responses
from .stationarity import BINS, FLAT, POWER_VARIANCES, RANGES, RESPONSE_RANGES
from .steerable import ORIENTATIONS

SHARES = 64  # of a bin: a value between two bins is shared between them in so many whole parts
STEPS = 8  # of the whole numbers whose powers are summed up, per unit of Lab
_CELLS_PER_SIGMA = 2.5
_LARGEST_CELL = 512  # px


@dataclass(frozen=True)
class Deviation:
    """How unlike the rest of an image its places are.

    Attributes
    ----------
    cells : Cells
    local : (down + 4, across + 4) float
        At the cells' centres with the margin of `cells.MARGIN`: the mean difference between what is seen there and
        what is seen from all cells, summed over channels, in Lab units; of moments in squared ones.
    cost : float
        MJH17 eq. 1: the mean of it, cells counted by their pixels.
    """

    cells: Cells
    local: np.ndarray
    cost: float


def cells_for(image: Image, sigma: float) -> Cells:
    """Cells of sigma / 2.5, at least 1 and at most 512 px."""
    return Cells(image.first.window, max(1, min(_LARGEST_CELL, round(sigma / _CELLS_PER_SIGMA))))


def deviation_of(
    image: Image, lens: Lens, sigma: float, session: Session, measure: str = "histogram", order: int = 2
) -> Deviation:
    """The local deviation from stationarity of an image's first part, from one look at its pixels.

    Parameters
    ----------
    image : Image
    lens : Lens
    sigma : float
        Of the Gaussian window w_d of MJH17 eq. 2 to 4, px.
    session : Session
    measure : str
        histogram, moments or steerable, as `stationarity.stationarity_cost` has them.
    order : int
        Moments up to this one.

    Raises
    ------
    ImageError
        NaN or Inf, or so many cells that their statistics do not fit the budget.
    """
    cells, count = cells_for(image, sigma), lens.count
    ranges = RANGES if lens.space is not None else (RANGES[0],) * count
    look: Callable[[np.ndarray, np.ndarray | None], np.ndarray]
    if measure == "moments":
        starts, dtype = cells.starts(), np.int64
        shape = (cells.down, count, cells.across, 1 + order)

        def look(values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
            return cell_powers(values, opaque, starts, order, ranges)
    else:
        if measure == "steerable":
            limits = RESPONSE_RANGES if lens.space is not None else (RESPONSE_RANGES[0],) * count
            ranges = tuple(r for r in limits for _ in range(ORIENTATIONS))
        shape, dtype = (cells.down, len(ranges), cells.across, BINS), np.int32
        column = np.repeat(np.arange(cells.across, dtype=np.int32), cells.side)[: cells.window.width] * np.int32(BINS)

        def look(values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
            return cell_histograms(values, opaque, column, cells.across, ranges)

    places = (cells.down + 4) * (cells.across + 4)
    need = np.dtype(dtype).itemsize * int(np.prod(shape)) + 8 * 8 * places
    session.require(need, f"sigma {sigma:g} px", "take a larger sigma")
    sums = np.zeros(shape, dtype)

    def keep(row: int, found: np.ndarray) -> None:
        sums[row] += found

    if measure == "steerable":
        survey_responses(image, lens, cells, session, look, keep)
    else:
        survey(image, lens, cells, session, look, keep)
    if measure == "moments":
        return _moment_deviation(cells, sums, sigma, ranges)
    return _deviation(cells, sums, sigma, ranges)


def cell_powers(
    values: np.ndarray,
    opaque: np.ndarray | None,
    starts: np.ndarray,
    order: int,
    ranges: tuple[tuple[float, float], ...],
) -> np.ndarray:
    """Number of pixels and sums of powers (MJH17 eq. 2) in whole numbers, per cell of a row.

    Parameters
    ----------
    values : (height, width, >= channels) float32
    opaque : (height, width) bool or None
    starts : (across,) int
        First column of every cell.
    order : int
        Powers up to this one, 4 at most.
    ranges : per channel (low, high)
        Powers are those of `STEPS` times what a value lies above the middle; values outside are taken as the nearest.

    Returns
    -------
    (channels, across, 1 + order) int64
    """
    seen = np.ones(values.shape[:2], np.int64) if opaque is None else opaque.astype(np.int64)
    out = np.empty((len(ranges), len(starts), 1 + order), np.int64)
    for c, (low, high) in enumerate(ranges):
        off = np.clip(values[..., c], np.float32(low), np.float32(high)) - np.float32(0.5 * (low + high))
        steps, power = np.rint(off * np.float32(STEPS)).astype(np.int64), seen
        for p in range(1 + order):
            out[c, :, p] = np.add.reduceat(power.sum(0), starts)
            power = power * steps
    return out


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


def _moment_deviation(
    cells: Cells, powers: np.ndarray, sigma: float, ranges: tuple[tuple[float, float], ...]
) -> Deviation:
    """Squared differences (MJH17 eq. 2): of one place to all, its own to their mean and their variance."""
    taps = smoothing_taps(sigma, cells.side)
    number = padded(powers[:, 0, :, 0].astype(np.float64))
    weight = correlated(number, taps, taps)
    known, pixels = weight > 0, number.sum()
    local = np.zeros(number.shape)
    for c in range(len(ranges)):
        raw = powers[:, c].astype(np.float64) / float(STEPS) ** np.arange(powers.shape[-1])
        total = raw.sum((0, 1))
        mean = total[1] / max(pixels, 1.0)
        deviation = float(np.sqrt(max(total[2] / max(pixels, 1.0) - mean**2, 0.0)))
        if deviation <= FLAT:
            continue
        for order in range(1, powers.shape[-1]):
            # (v - mean)^p from powers of v
            off = sum(comb(order, k) * (-mean) ** (order - k) * raw[..., k] for k in range(order + 1))
            moment = correlated(padded(off / deviation**order), taps, taps) / np.where(known, weight, 1.0)
            middle = (moment * number).sum() / pixels
            spread = ((moment - middle) ** 2 * number).sum() / pixels
            local += deviation**2 / POWER_VARIANCES[order] * ((moment - middle) ** 2 + spread)
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
