# SPDX-License-Identifier: Apache-2.0
"""Texton histograms of neighborhoods, and the similarity of two places under small shifts.

CZF02 section II: Caenen, Zalesny, Ferrari, Van Gool. Color and Haar details are quantized to 8 textons each; a pixel
belongs to all of them by weights (eq. 1); a place has the mean of the weights over a disc (eq. 2); two places are
compared by the Bhattacharyya coefficient (eq. 3), the second at the best shift (section II B).

Weights are in steps of 1 / 255 and roots of histograms in steps of 1 / `UNIT`, so that sums and products are exact
integers, independent of the order of summation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...engine.color.lab_reduced import LabPixels
from ...engine.session.resources import Resources
from ..labels.filter_bank import Texture, texton_map

UNIT = 4000  # steps of a root of a histogram: the product of two fits the 24 bits of a float32
BINS = 8  # of color and of structure each: CZF02 section II A
FULL = 255  # steps of a weight
_COLOR = 2.2  # weight of L, a and b relative to each of 21 responses in filter bank textons
_LEARNED = 4000  # pixels from which these are learned: twice as many change no score and take .1 s longer
_SAMPLE = 16384  # pixels from which bins are learned
_LLOYD = 12  # iterations of a bisection
_BLOCK = 1 << 15
_STARTS = ((0, 0), (-1, 0), (1, 0), (0, -1), (0, 1))  # starts of a mean shift search, in halves of its radius
_SHIFTS = 12  # maximum number of steps of a mean shift search


@dataclass(frozen=True)
class Counts:
    """Amount of each texton in each cell."""

    values: np.ndarray  # (h, w, k) int32: in steps of 1 / 255 of a pixel; 0 at invalid pixels
    side: int  # Side of a cell, in pixels of the reduced image


# --- textons ---


def weighted_counts(pixels: LabPixels, resources: Resources, bins: int = BINS) -> Counts:
    """CZF02 section II A: weights (eq. 1) of color bins, then of Haar bins, for each pixel."""
    groups = [pixels.lab, haar_details(pixels.lab[..., 0])]
    values = np.concatenate([_weights(group, pixels.seen, bins, resources) for group in groups], axis=-1)
    return Counts(values * pixels.seen[..., None], 1)


def bank_counts(texture: Texture, resources: Resources, bins: int, side: int) -> Counts:
    """Counts of filter bank textons in cells; unlike in the paper, a pixel belongs to one texton only.

    `side`: side of a cell, px.
    """
    textons = texton_map(texture, resources, bins, _COLOR, _LEARNED)
    height, width = textons.shape
    across, down = -(-width // side), -(-height // side)
    cell = (np.arange(height) // side)[:, None] * across + np.arange(width) // side
    keys = (cell * bins + textons)[texture.seen]
    counts = np.bincount(keys, minlength=down * across * bins).reshape(down, across, bins)
    return Counts((FULL * counts).astype(np.int32), side)


def haar_details(light: np.ndarray) -> np.ndarray:
    """Horizontal, vertical and diagonal detail of an undecimated Haar wavelet: (h, w) -> (h, w, 3) float32.

    Undecimated, because the paper needs a vector for each pixel; the last row and column are repeated.
    """
    a = np.pad(light, ((0, 1), (0, 1)), mode="edge").astype(np.float32)
    a, b, c, d = a[:-1, :-1], a[:-1, 1:], a[1:, :-1], a[1:, 1:]
    return np.stack([a - b + c - d, a + b - c - d, a - b - c + d], axis=-1) / np.float32(2)


def bisected(points: np.ndarray, bins: int) -> np.ndarray:
    """Centers (at most bins, d) float32 of a hierarchical clustering of points (n, d).

    The cluster with the largest error is bisected until there are `bins` clusters, or none has an error.
    """
    points = points.astype(np.float64)
    clusters = [points]
    while len(clusters) < bins:
        errors = [((c - c.mean(0)) ** 2).sum() for c in clusters]
        worst = int(np.argmax(errors))
        if errors[worst] <= 1e-6 * len(clusters[worst]):
            break
        clusters[worst : worst + 1] = _halves(clusters[worst])
    return np.array([c.mean(0) for c in clusters], np.float32)


def _halves(points: np.ndarray) -> list[np.ndarray]:
    """Two clusters by Lloyd's algorithm, from starts on both sides of the mean along the principal axis."""
    away = points - points.mean(0)
    widest = np.linalg.eigh(away.T @ away)[1][:, -1]
    upper = away @ widest > 0
    for _ in range(_LLOYD):
        low, high = points[~upper].mean(0), points[upper].mean(0)
        nearer = (points - (low + high) / 2) @ (high - low) > 0
        if nearer.all() or not nearer.any() or (nearer == upper).all():
            break
        upper = nearer
    return [points[~upper], points[upper]]


def _weights(values: np.ndarray, seen: np.ndarray, bins: int, resources: Resources) -> np.ndarray:
    """CZF02 eq. 1, (h, w, bins) int32 in steps of 1 / 255.

    sigma, which the paper does not give, is the root mean squared distance to the nearest center. The weights of a
    pixel are normalized to a sum of 1, so that all pixels count the same.
    """
    points = values.reshape(-1, values.shape[-1])
    known = np.flatnonzero(seen)
    sample = points[known[:: max(1, len(known) // _SAMPLE)]] if len(known) else points[:1]
    centers = bisected(sample, bins)
    squares = (centers**2).sum(1)
    apart = np.maximum((sample**2).sum(1)[:, None] + squares - 2 * sample @ centers.T, 0).min(1)
    variance = max(float(apart.mean(dtype=np.float64)), 1e-3)

    def weigh(first: int) -> np.ndarray:
        here = points[first : first + _BLOCK]
        away = squares - 2 * here @ centers.T  # up to a constant per pixel, which normalization cancels
        away -= away.min(1, keepdims=True)
        weight = np.exp(away / np.float32(-2 * variance))
        return np.rint(weight * (FULL / weight.sum(1, keepdims=True))).astype(np.int32)

    weights = np.concatenate(list(resources.spread(weigh, range(0, len(points), _BLOCK))))
    return np.pad(weights, ((0, 0), (0, bins - weights.shape[1]))).reshape(*values.shape[:2], bins)


# --- histograms ---


def disc_sums(values: np.ndarray, radius: float, resources: Resources) -> np.ndarray:
    """CZF02 eq. 2 without the division: (h, w, k) int32 -> sums over discs, clipped at borders, (h, w, k) int32."""
    height, width = values.shape[:2]
    reach = int(radius)
    x = np.arange(width)

    def summed(k: int) -> np.ndarray:
        rows = np.zeros((height, width + 1), np.int32)
        np.cumsum(values[..., k], axis=1, out=rows[:, 1:])
        out = np.zeros((height, width), np.int32)
        for dy in range(-min(reach, height - 1), min(reach, height - 1) + 1):
            half = int(math.sqrt(radius * radius - dy * dy))
            right, left = np.minimum(x + half + 1, width), np.maximum(x - half, 0)
            from_rows = rows[max(dy, 0) : height + min(dy, 0)]
            out[max(-dy, 0) : height - max(dy, 0)] += from_rows[:, right] - from_rows[:, left]
        return out

    return np.stack(list(resources.spread(summed, range(values.shape[2]))), axis=-1)


def histogram_roots(sums: np.ndarray) -> np.ndarray:
    """Roots of histograms in steps of 1 / `UNIT`, (..., k) int16; their products are eq. 3 in steps of 1 / `UNIT`^2."""
    total = sums.sum(-1, keepdims=True, dtype=np.int64)
    return np.rint(np.sqrt(sums / np.maximum(total, 1)) * UNIT).astype(np.int16)


# --- similarity ---


@dataclass(frozen=True)
class Samples:
    """A regular grid of places; samples are those with valid pixels."""

    rows: np.ndarray  # (down,), (across,) int: cells of the grid's rows and columns
    columns: np.ndarray
    places: np.ndarray  # (n,) int: indices of the samples on the grid, row by row

    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of each sample's cell."""
        return self.rows[self.places // len(self.columns)], self.columns[self.places % len(self.columns)]


def sample_grid(seen: np.ndarray, step: int) -> Samples:
    """Places `step` cells apart (CZF02 section II B): shifted neighbors would match each other trivially."""
    height, width = seen.shape
    rows = np.arange(min(step // 2, height - 1), height, step)
    columns = np.arange(min(step // 2, width - 1), width, step)
    return Samples(rows, columns, np.flatnonzero(seen[np.ix_(rows, columns)]))


def similarities(
    roots: np.ndarray, samples: Samples, shift: float, others: tuple[np.ndarray, ...] = (), steps: int = 2
) -> np.ndarray:
    """CZF02 section II B: max(s'_ij, s'_ji), s'_ij the best Bhattacharyya coefficient of i with places near j.

    The paper uses mean shift (`mean_shift_similarities`). Here all shifts on a grid are evaluated as matrix products,
    which finds better matches in less time.

    `roots` (h, w, k) int16; `others` tuple of (h, w, k) int16; returns (n, n) float32.
    """
    rows, columns = samples.cells()
    height, width = roots.shape[:2]
    here = roots[rows, columns].astype(np.float32)
    best = here @ here.T
    offsets = sorted({round(shift * s / steps) for s in range(-steps, steps + 1)})
    for scale, field in enumerate((roots, *others)):
        for dy in offsets:
            for dx in offsets:
                if dy * dy + dx * dx > shift * shift + 1 or (scale == 0 and dy == dx == 0):
                    continue
                y, x = np.clip(rows + dy, 0, height - 1), np.clip(columns + dx, 0, width - 1)
                np.maximum(best, here @ field[y, x].astype(np.float32).T, out=best)
    return _symmetric(best)


def mean_shift_similarities(
    counts: Counts, radii: tuple[float, ...], samples: Samples, shift: float, resources: Resources
) -> np.ndarray:
    """The same as `similarities` by mean shift (CZF02 section II B, after Comaniciu, Ramesh, Meer, CVPR 2000).

    From five starts and at each scale, a window near j moves to the mean of its pixels, each weighted by the sum over
    textons of weight * sqrt(q / p), with q the histogram at i and p that of the window. The mean requires three sums
    over the disc for each texton, which are computed once for all windows.

    Returns (n, n) float32.
    """
    rows, columns = samples.cells()
    n = len(rows)
    height, width = counts.values.shape[:2]
    best = None
    queries = histogram_roots(disc_sums(counts.values, radii[0], resources))[rows, columns].astype(np.float32)
    y, x = np.mgrid[0:height, 0:width]
    for radius in radii:
        mass = disc_sums(counts.values, radius, resources)
        roots = histogram_roots(mass).reshape(height * width, -1).astype(np.float32)
        moments = [_disc_moments(counts.values, axis, radius, resources).reshape(height * width, -1) for axis in (y, x)]
        mass = mass.reshape(height * width, -1).astype(np.float32)
        products = np.zeros((n, n), np.float32)
        for j in range(n):
            for start in _STARTS:
                at = np.tile([rows[j] + start[0] * shift / 2, columns[j] + start[1] * shift / 2], (n, 1))
                at = np.clip(at, 0, [height - 1, width - 1])
                for _ in range(_SHIFTS):
                    place = np.rint(at).astype(np.int64) @ [width, 1]
                    p = roots[place]
                    np.maximum(products[:, j], np.einsum("ik,ik->i", queries, p), out=products[:, j])
                    pull = queries / np.maximum(p, 1.0)
                    weight = np.einsum("ik,ik->i", pull, mass[place])
                    to = np.stack([np.einsum("ik,ik->i", pull, m[place]) for m in moments], 1)
                    to = to / np.maximum(weight, 1e-6)[:, None]
                    to = np.clip(to, [rows[j] - shift, columns[j] - shift], [rows[j] + shift, columns[j] + shift])
                    to = np.clip(to, 0, [height - 1, width - 1])
                    if (np.rint(to) == np.rint(at)).all():
                        break
                    at = to
        best = products if best is None else np.maximum(best, products)
    assert best is not None
    return _symmetric(best)


def _disc_moments(values: np.ndarray, coordinate: np.ndarray, radius: float, resources: Resources) -> np.ndarray:
    """Sums over discs of weights times a coordinate, float32."""
    middle = int(coordinate.max()) // 2  # keeps the sums within 32 bits
    moved = values * (coordinate - middle)[..., None].astype(np.int32)
    return (
        disc_sums(moved, radius, resources) + middle * disc_sums(values, radius, resources).astype(np.float64)
    ).astype(np.float32)


def _symmetric(products: np.ndarray) -> np.ndarray:
    likeness = np.maximum(products, products.T) / np.float32(UNIT * UNIT)
    np.minimum(likeness, np.float32(1), out=likeness)
    np.fill_diagonal(likeness, 1)
    return likeness
