# SPDX-License-Identifier: Apache-2.0
"""Where an image is not stationary: MJH17 eq. 1 for each place, for images of any size.

MJH17 eq. 1 is a mean over pairs of places. Its inner mean, over the second place alone, is the deviation of the first
place from the rest of the image. `costs.stationarity_cost` is the outer mean over 32 x 32 places with the image in
memory. Here local histograms are gathered on a grid of cells in one pass, and every cell is a place.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

from ...engine.color.lab_grid import FINE_STEPS
from ...engine.color.lens import Lens
from ...engine.core.demand import rows_for
from ...engine.core.image import Image
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.scan import scan
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from .costs import BINS, FLAT, POWER_VARIANCES, RANGES, RESPONSE_RANGES, SHARES, cell_histograms
from .grid_statistics import MARGIN, Cells, correlated, padded, smoothing_taps
from .steerable import ORIENTATIONS, RADIUS, responses_in

_PLANES = 24  # maximum number of arrays of cells between the sums and the results


@dataclass(frozen=True)
class Deviation:
    """Deviation of an image's places from the rest of it.

    `local` (down + 4, across + 4) float: at the cells' centers, with the margin `grid_statistics.MARGIN`: the mean
    difference between the statistics there and at all cells, summed over channels, in Lab units. Moments: in squared
    Lab units.
    """

    cells: Cells
    local: np.ndarray
    cost: float  # MJH17 eq. 1: mean of `local`, with cells weighted by their pixels


def deviation_of(
    image: Image, lens: Lens, sigma: float, resources: Resources, progress: Progress, measure: str = "histogram",
    order: int = 2,
) -> Deviation:  # fmt: skip
    """The local deviation from stationarity of an image's first part, in one pass over its pixels.

    Parameters
    ----------
    sigma : float
        Sigma of the Gaussian window w_d of MJH17 eq. 2 to 4, px.
    measure : str
        histogram, moments or steerable, as in `costs.stationarity_cost`.
    order : int
        Highest order of moments, at most 4.

    Raises
    ------
    ImageError
        NaN or Inf, or the statistics of the cells do not fit the budget.
    """
    cells, count = Cells.for_sigma(image.first.window, sigma), lens.count
    ranges = RANGES if lens.space is not None else (RANGES[0],) * count
    dtype: type[np.generic]
    look: Callable[[np.ndarray, np.ndarray | None], np.ndarray]
    if measure == "moments":
        shape, dtype = (cells.down, count, cells.across, 1 + order), np.int64
        look = functools.partial(_cell_powers, cells=cells, ranges=ranges, order=order)
    else:
        if measure == "steerable":
            limits = RESPONSE_RANGES if lens.space is not None else (RESPONSE_RANGES[0],) * count
            ranges = tuple(r for r in limits for _ in range(ORIENTATIONS))
        shape, dtype = (cells.down, len(ranges), cells.across, BINS), np.int32
        look = functools.partial(cell_histograms, cells=cells, ranges=ranges)

    beside = 8 * _PLANES * (cells.down + 2 * MARGIN) * (cells.across + 2 * MARGIN)
    # results of threads that wait to be summed
    band = min(cells.down, rows_for(image.first) // cells.side + 2)
    beside += np.dtype(dtype).itemsize * math.prod(shape[1:]) * band
    layout = {"sums": (shape, dtype)}
    sums = resources.scratch(layout, f"sigma={sigma:g}", "increase sigma", beside)["sums"]

    def look_at_responses(values: np.ndarray, opaque: np.ndarray | None, piece: Window) -> list[np.ndarray]:
        filtered, clear = responses_in(values[..., :count], opaque, piece, cells.window)
        rows = [row.inside(piece) for row in cells.rows(piece)]
        return [look(filtered[at], None if clear is None else clear[at]) for at in rows]

    keep = functools.partial(cells.add, sums)
    if measure == "steerable":
        scan(image.first, lens, resources, look_at_responses, keep, halo=RADIUS, larger=4,
             advance=progress.advance)  # fmt: skip
    else:
        scan(image.first, lens, resources, lambda values, opaque, _: [look(values, opaque)], keep,
             cell=cells.side, larger=2, advance=progress.advance)  # fmt: skip
    if measure == "moments":
        return _moment_deviation(cells, sums, sigma, ranges)
    return _deviation(cells, sums, sigma, ranges)


def _cell_powers(
    values: np.ndarray, opaque: np.ndarray | None, cells: Cells, ranges: tuple[tuple[float, float], ...], order: int
) -> np.ndarray:
    """Number of pixels and sums of powers (MJH17 eq. 2) as integers, (channels, across, 1 + order) int64.

    For values (height, width, >= channels) in one row of cells. Powers are of `FINE_STEPS` times the difference between
    the value and the middle of its range. Values outside are clamped.
    """
    seen = np.ones(values.shape[:2], np.int64) if opaque is None else opaque.astype(np.int64)
    out = np.empty((len(ranges), cells.across, 1 + order), np.int64)
    for c, (low, high) in enumerate(ranges):
        off = np.clip(values[..., c], np.float32(low), np.float32(high)) - np.float32(0.5 * (low + high))
        steps, power = np.rint(off * np.float32(FINE_STEPS)).astype(np.int64), seen
        for p in range(1 + order):
            out[c, :, p] = np.add.reduceat(power.sum(0), cells.starts)
            power = power * steps
    return out


def _deviation(
    cells: Cells, histograms: np.ndarray, sigma: float, ranges: tuple[tuple[float, float], ...]
) -> Deviation:
    taps = smoothing_taps(sigma, cells.side)
    number = padded(histograms[:, 0].sum(-1) / SHARES)
    weight = correlated(number, taps, taps)
    known = weight > 0
    safe = np.where(known, weight, 1.0)
    share_of_places = number.ravel()  # a place is weighted by its pixels, the margin by 0
    local = np.zeros(number.shape)
    for c, (low, high) in enumerate(ranges):
        below = np.zeros(histograms.shape[:1] + histograms.shape[2:3])  # rows x columns of cells
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
    """Squared differences (MJH17 eq. 2): a place's mean is its squared distance from the mean, plus the variance."""
    taps = smoothing_taps(sigma, cells.side)
    number = padded(powers[:, 0, :, 0].astype(np.float64))
    weight = correlated(number, taps, taps)
    known, pixels = weight > 0, number.sum()
    local = np.zeros(number.shape)
    for c in range(len(ranges)):
        # rows x columns of cells x (number and sums of powers)
        raw = powers[:, c].astype(np.float64) / float(FINE_STEPS) ** np.arange(powers.shape[-1])
        total = raw.sum((0, 1))
        mean = total[1] / max(pixels, 1.0)
        deviation = float(np.sqrt(max(total[2] / max(pixels, 1.0) - mean**2, 0.0)))
        if deviation <= FLAT:
            continue
        for order in range(1, powers.shape[-1]):
            # (v - mean)^p from powers of v
            off = sum(math.comb(order, k) * (-mean) ** (order - k) * raw[..., k] for k in range(order + 1))
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
