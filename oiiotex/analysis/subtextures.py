# SPDX-License-Identifier: Apache-2.0
"""An image decomposed into subtextures: CZF02 whole, and the way that does better by default.

By default textons come from a filter bank, and after clique partitioning the subtextures compete for pixels with
their texton distributions; the paper compares every pixel's histogram with those of the samples around it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter
from threadpoolctl import threadpool_limits

from ..session import Session
from .cliques import partition
from .labpixels import LabPixels
from .textons import (
    Counts,
    Samples,
    bank_counts,
    disc_sums,
    histogram_roots,
    mean_shift_similarities,
    sample_grid,
    similarities,
    weighted_counts,
)

_CELL = 4  # px, of filter bank textons
_LEAST = 0.02  # of the image: smaller subtextures lose their pixels in the competition
_COUPLINGS = (2, 4, 6, 8, 8)  # of a cell with its surroundings in each round, nats; its own textons: nats per pixel
_UPDATES = 4  # of the memberships in a round
_NEAR = 1 / 4  # sigma of the surroundings per radius
_PRIOR = 5  # px of every texton that a subtexture is thought to have before it is looked at
_SMOOTH = 1.0  # cells, of the last vote


@dataclass(frozen=True)
class Settings:
    """How an image is decomposed; px are those of the (reduced) image.

    Attributes
    ----------
    features : str
        "bank" or "haar".
    bins : int
        Textons; of colour and structure each with "haar".
    radius, shift : float
        Of the disc, and how far to look for the best match, px.
    scales : int
        Radii at which the second place is looked at, half an octave apart.
    search : str
        "grid" or "meanshift".
    threshold : float
        Similarity above which two places belong together.
    step : int
        Between samples, px.
    refine : bool
        Of the clique partition.
    assign : str
        "competition" or "neighbours".
    """

    features: str = "bank"
    bins: int = 64
    radius: float = 48.0
    shift: float = 24.0
    scales: int = 1
    search: str = "grid"
    threshold: float = 0.76
    step: int = 16
    refine: bool = True
    assign: str = "competition"


@dataclass(frozen=True)
class Decomposition:
    """What was found.

    Attributes
    ----------
    labels : (h, w) int32
        Of the reduced image, 1 .. count by first pixel; 0 where nothing is seen.
    count : int
    samples : int
        Vertices of the clique partition.
    cliques : int
        Before the competition.
    """

    labels: np.ndarray
    count: int
    samples: int
    cliques: int


def decomposed(pixels: LabPixels, settings: Settings, session: Session) -> Decomposition:
    """The subtextures of an image."""
    if not pixels.seen.any():
        session.advance(2, 4)
        session.advance(3, 4)
        return Decomposition(np.zeros(pixels.seen.shape, np.int32), 0, 0, 0)
    with threadpool_limits(1, "blas"):
        with session.stats.time("textons"):
            if settings.features == "haar":
                counts = weighted_counts(pixels, session, settings.bins)
            else:
                counts = bank_counts(pixels, session, settings.bins, _CELL)
            side = counts.side
            scales = tuple(settings.radius / side * 2 ** (s / 2) for s in _octaves(settings.scales))
            roots = [histogram_roots(disc_sums(counts.values, r, session)) for r in scales]
        session.advance(2, 4)
        with session.stats.time("similarities and cliques"):
            seen = counts.values.any(-1)
            samples = sample_grid(seen, max(1, round(settings.step / side)))
            if not len(samples.places):  # islands between the samples
                samples = Samples(np.arange(seen.shape[0]), np.arange(seen.shape[1]), np.flatnonzero(seen)[:1])
            shift = settings.shift / side
            if settings.search == "meanshift" and shift > 0:
                likeness = mean_shift_similarities(counts, scales, samples, shift, session)
            else:
                likeness = similarities(roots[0], samples, shift, tuple(roots[1:]))
            weights = likeness.astype(np.float64) - settings.threshold
            cliques = partition(weights, settings.refine)
        session.advance(3, 4)
        with session.stats.time("pixels of subtextures"):
            labels = _nearest_samples(roots[0], samples, cliques)
            if settings.assign == "competition":
                labels = _competed(_gathered(counts, _CELL // side), labels, settings.radius, pixels.seen.shape)
            else:
                labels = np.repeat(np.repeat(labels, side, 0), side, 1)[: pixels.seen.shape[0], : pixels.seen.shape[1]]
    labels, count = _numbered(labels, pixels.seen)
    return Decomposition(labels, count, len(samples.places), int(cliques.max()) + 1)


def _octaves(scales: int) -> list[int]:
    """0, -1, 1, -2, ...: the true scale first."""
    return [(-1) ** s * ((s + 1) // 2) for s in range(scales)]


def _nearest_samples(roots: np.ndarray, samples: Samples, cliques: np.ndarray) -> np.ndarray:
    """The clique of the sample, of the nine around a cell, whose histogram is most alike: CZF02 section II B."""
    height, width = roots.shape[:2]
    down, across = len(samples.rows), len(samples.columns)
    index = np.full(down * across, -1)
    index[samples.places] = np.arange(len(samples.places))
    index = np.pad(index.reshape(down, across), 1, constant_values=-1)
    at = roots[samples.cells()].astype(np.float32)
    nearest_row = np.abs(np.arange(height)[:, None] - samples.rows).argmin(1)
    nearest_column = np.abs(np.arange(width)[:, None] - samples.columns).argmin(1)
    best, found = np.full((height, width), -1.0, np.float32), np.zeros((height, width), np.int64)
    order = sorted(((dy, dx) for dy in (0, 1, 2) for dx in (0, 1, 2)), key=lambda d: (d[0] - 1) ** 2 + (d[1] - 1) ** 2)
    for top in range(0, height, 64):
        rows = slice(top, top + 64)
        here = roots[rows].astype(np.float32)
        for dy, dx in order:
            sample = index[nearest_row[rows, None] + dy, nearest_column + dx]
            likeness = np.where(sample >= 0, np.einsum("yxk,yxk->yx", here, at[sample]), -1.0)
            better = likeness > best[rows]
            best[rows][better] = likeness[better]
            found[rows][better] = cliques[sample[better]]
    lonely = best < 0
    if lonely.any():  # no sample near: the first one, then the competition or nothing else decides
        found[lonely] = cliques[0]
    return found


# --- competition ---


def _gathered(counts: Counts, times: int) -> Counts:
    """Cells `times` as wide."""
    if times <= 1:
        return counts
    values = counts.values
    for axis in (0, 1):
        values = np.add.reduceat(values, np.arange(0, values.shape[axis], times), axis=axis)
    return Counts(values, counts.side * times)


def _competed(counts: Counts, labels: np.ndarray, radius: float, shape: tuple[int, int]) -> np.ndarray:
    """Subtextures compete for cells: (h, w) labels of pixels.

    In every round a subtexture has the texton distribution of its cells. A cell is a member of each by a share: the
    likelihood of its textons times what its surroundings are members of (the mean field of a Potts model with
    Gaussian neighbourhoods). Surroundings count for more from round to round, so that borders settle late.
    """
    values = counts.values.astype(np.float32) / (255 * counts.side**2)
    height, width, bins = values.shape
    if labels.shape != (height, width):
        labels = labels[:: labels.shape[0] // height or 1, :: labels.shape[1] // width or 1][:height, :width]
    seen = values.any(-1).astype(np.float32)
    areas = np.bincount(labels.ravel(), seen.ravel())
    largest = np.argsort(-areas, kind="stable")[: int(1 / _LEAST)]
    member = (labels[..., None] == largest).astype(np.float32) * seen[..., None]
    sigma = max(1.0, _NEAR * radius / counts.side)
    for coupling in _COUPLINGS:
        areas = member.sum((0, 1), dtype=np.float64)
        member = member[..., areas >= min(_LEAST * areas.sum(), areas.max())]
        found = member.reshape(height * width, -1).T @ values.reshape(height * width, bins)
        chances = found + np.float32(_PRIOR / counts.side**2)
        likely = values @ np.log(chances / chances.sum(1, keepdims=True)).T
        likely = _blurred(likely - likely.max(-1, keepdims=True), 1.0)
        for _ in range(_UPDATES):
            member = likely + np.float32(coupling) * _blurred(member, sigma)
            member = np.exp(member - member.max(-1, keepdims=True))
            member *= seen[..., None] / member.sum(-1, keepdims=True)
    best = None
    for n, votes in enumerate(np.moveaxis(_blurred(member, _SMOOTH), -1, 0)):
        votes = _enlarged(votes, counts.side, shape)
        if best is None:
            best, found = votes, np.zeros(shape, np.int64)
        else:
            found[votes > best] = n
            np.maximum(best, votes, out=best)
    return found


def _blurred(values: np.ndarray, sigma: float) -> np.ndarray:
    return gaussian_filter(values, (sigma, sigma, 0), truncate=2.5)


def _enlarged(values: np.ndarray, side: int, shape: tuple[int, int]) -> np.ndarray:
    """Cells as pixels, linearly between their centres."""
    for axis in (0, 1):
        at = np.clip((np.arange(shape[axis]) + 0.5) / side - 0.5, 0, values.shape[axis] - 1)
        low = np.minimum(at.astype(np.int64), max(values.shape[axis] - 2, 0))
        share = (at - low).astype(np.float32)
        share = share[:, None] if axis == 0 else share
        high = np.minimum(low + 1, values.shape[axis] - 1)
        values = np.take(values, low, axis) * (1 - share) + np.take(values, high, axis) * share
    return values


def _numbered(labels: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, int]:
    """1 .. count in the order of first pixels, 0 where nothing is seen."""
    names, first, inverse = np.unique(labels[seen], return_index=True, return_inverse=True)
    rank = np.empty(len(names), np.int32)
    rank[np.argsort(first)] = np.arange(1, len(names) + 1)
    found = np.zeros(labels.shape, np.int32)
    found[seen] = rank[inverse]
    return found, len(names)


def memory_needed(pixels: int, settings: Settings) -> int:
    """Bytes that a decomposition holds at its height, of so many pixels of the reduced image."""
    kinds = 2 * settings.bins if settings.features == "haar" else 0
    per_pixel = 400 if settings.features == "bank" else 60 + 14 * kinds * (1 + settings.scales // 2)
    vertices = pixels / settings.step**2
    return math.ceil(per_pixel * pixels + 40 * vertices**2)
