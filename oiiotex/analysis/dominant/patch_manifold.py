# SPDX-License-Identifier: Apache-2.0
"""Texels: overlapping patches of a texture as points of a low-dimensional manifold.

LDR09: Lu, Dorsey, Rushmeier, Dominant Texture and Diffusion Distance Manifolds, Eurographics 2009, sections 4 to 6.
Patches are from Lab on an integer grid. All products are of blocks of one fixed shape, distributed over threads, so
that results do not depend on the number of threads or the memory budget.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import scipy.fft
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import csr_array

from ...engine.color.lab_reduced import LabPixels
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources

log = logging.getLogger("oiiotex")

ENERGY = 0.999  # proportion of variance kept by the principal components: LDR09 section 6.1
LANDMARKS = 0.7  # N' = N^0.7: LDR09 section 6.2
LEAST_PATCH, MOST_PATCH = 5, 25  # px
_BLOCK = 1024  # texels per block of distances
_ROWS = 256  # texels per search for neighbors, so that intermediate results fit the cache
_EVERY = 16  # stride of the sample of a row's distances from which the k smallest are estimated
_COVARIANCE = 4096  # texels from which the components are learned
_TIMED = 2.0  # s of searches after which the time of all is estimated
_LONG = 20.0  # s; from here on there is a warning
_PIECES = 8  # in which an image is blurred
_CURVE = 96  # kernel sizes to try
_STRONG = 0.7  # of the strongest response: a longer period above this is preferred


def patch_size(light: np.ndarray, spread: Callable[..., Iterable[np.ndarray]] = map) -> int:
    """LDR09 step 1: period of lightness (h, w) with the strongest response in one of four directions, odd, px.

    Choices that the paper leaves open: a Hann window; wedges of 45 degrees as directions; as response the power above a
    power law fitted to the mean of all directions, since textures have more power in low frequencies; and of strong
    responses the lowest frequency, since the others are its harmonics.
    """
    height, width = light.shape
    most = min(MOST_PATCH, min(height, width) // 8)
    if most <= LEAST_PATCH:
        return max(1, min(LEAST_PATCH, height, width) - (min(LEAST_PATCH, height, width) + 1) % 2)
    flat = light - _blurred(light.astype(np.float64), min(height, width) / 6, spread)
    flat *= np.outer(np.hanning(height), np.hanning(width))
    size = scipy.fft.next_fast_len(2 * max(height, width))
    power = np.abs(scipy.fft.rfft2(flat, (size, size))) ** 2
    v, u = scipy.fft.fftfreq(size)[:, None], scipy.fft.rfftfreq(size)
    ring = np.minimum((np.hypot(v, u) * size).astype(np.int64), size // 2)
    rings = size // 2 + 1
    wanted = np.flatnonzero((np.arange(rings) >= size / most) & (np.arange(rings) <= size / LEAST_PATCH))
    mean = np.bincount(ring.ravel(), power.ravel(), rings) / np.maximum(np.bincount(ring.ravel(), minlength=rings), 1)
    if len(wanted) < 8 or mean.max() <= 1e-9 * flat.size:
        return LEAST_PATCH
    log_ring = np.log(np.arange(rings) + 1.0)
    background = np.polyval(np.polyfit(log_ring[wanted], np.log(mean[wanted] + 1e-12), 1), log_ring)
    angle = np.arctan2(v, u)
    responses = []
    for turn in range(4):
        away = np.abs((angle - turn * np.pi / 4 + np.pi / 2) % np.pi - np.pi / 2)
        inside = away < np.pi / 8
        number = np.maximum(np.bincount(ring[inside], minlength=rings), 1)
        here = np.log(np.bincount(ring[inside], power[inside], rings) / number + 1e-12) - background
        responses.append(gaussian_filter1d(here, 1.5)[wanted])
    response = np.max(responses, axis=0)
    peaks = [
        i
        for i in range(len(response))
        if response[i] >= _STRONG * response.max() and response[i] == response[max(0, i - 3) : i + 4].max()
    ]
    period = round(size / wanted[peaks[0]])
    return int(np.clip(period | 1, LEAST_PATCH, most - 1 + most % 2))


def _blurred(light: np.ndarray, sigma: float, spread: Callable[..., Iterable[np.ndarray]]) -> np.ndarray:
    """`scipy.ndimage.gaussian_filter`, by blocks of columns and then of rows."""
    for axis in (0, 1):
        pieces = np.array_split(light, _PIECES, axis=1 - axis)
        done = spread(lambda piece, along=axis: gaussian_filter1d(piece, sigma, along), pieces)
        light = np.concatenate(list(done), axis=1 - axis)
    return light


@dataclass(frozen=True)
class Texels:
    """N overlapping patches."""

    values: np.ndarray  # (N, d) float32: principal components
    rows: np.ndarray  # (N,) int, of centers; columns likewise
    columns: np.ndarray
    patch: int  # side, px
    step: int  # spacing of centers, px

    @property
    def count(self) -> int:
        """N."""
        return len(self.rows)


def texels_of(pixels: LabPixels, patch: int, step: int, resources: Resources) -> Texels:
    """LDR09 steps 2 and 6.1: patches around each `step`th pixel that are valid throughout, reduced by PCA."""
    height, width = pixels.seen.shape
    half = patch // 2
    whole = np.lib.stride_tricks.sliding_window_view(pixels.seen, (patch, patch))[::step, ::step].all((2, 3))
    at = np.flatnonzero(whole)
    rows, columns = at // whole.shape[1] * step, at % whole.shape[1] * step
    views = np.lib.stride_tricks.sliding_window_view(pixels.lab, (patch, patch), (0, 1))

    def patches(of: np.ndarray) -> np.ndarray:
        return views[rows[of], columns[of]].reshape(len(of), -1)

    if not len(at):
        return Texels(np.zeros((0, 1), np.float32), rows, columns, patch, step)
    sample = patches(np.arange(0, len(at), max(1, len(at) // _COVARIANCE)))
    mean = sample.mean(0, dtype=np.float64).astype(np.float32)
    sample = (sample - mean).astype(np.float64)
    energy, axes = np.linalg.eigh(sample.T @ sample)
    energy, axes = np.maximum(energy[::-1], 0), axes[:, ::-1]
    kept = int(np.searchsorted(np.cumsum(energy), ENERGY * energy.sum())) + 1
    axes = np.ascontiguousarray(axes[:, :kept], np.float32)
    blocks = [np.arange(first, min(first + _BLOCK, len(at))) for first in range(0, len(at), _BLOCK)]
    values = np.concatenate(list(resources.spread(lambda of: (patches(of) - mean) @ axes, blocks)))
    return Texels(values, rows + half, columns + half, patch, step)


def squared_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """|a_i - b_j|^2, (n, d) and (m, d) -> (n, m) float32."""
    squares = a @ b.T
    squares *= np.float32(-2)
    squares += (a * a).sum(1)[:, None]
    squares += (b * b).sum(1)
    return np.maximum(squares, 0, out=squares)


@dataclass(frozen=True)
class Kernel:
    """Size of the kernel, and dimension of the manifold."""

    size: float  # epsilon of eq. 1, Lab^2 per texel, for all texels: eq. 6
    landmark_size: float  # epsilon' for the landmarks
    dimension: float  # d of eq. 2
    curve: np.ndarray  # (n, 2) float64: log epsilon, log of the sum of weights (LDR09 figure 3)


def landmarks(texels: Texels) -> np.ndarray:
    """N' = N^0.7 texels chosen by a counter-based hash, ascending: LDR09 section 6.2."""
    count = max(2, int(texels.count**LANDMARKS))
    if count >= texels.count:
        return np.arange(texels.count)
    drawn = np.random.Philox(key=[0, 9]).random_raw(texels.count)
    return np.sort(np.argsort(drawn, kind="stable")[:count])


def kernel_of(texels: Texels, chosen: np.ndarray) -> Kernel | None:
    """LDR09 step 4: epsilon in the linear part, where log sum w over log epsilon is steepest; None if all are equal.

    The sum over pairs is computed from a histogram of distances with bins of a hundredth of an octave.
    """
    squares = squared_distances(texels.values[chosen], texels.values[chosen]).astype(np.float64)
    np.fill_diagonal(squares, 0)
    apart = squares[squares > 1e-4 * texels.patch**2]  # smaller ones are equal on the grid of Lab
    if not len(apart):
        return None
    cell = np.floor(100 * np.log2(apart)).astype(np.int64)
    cell -= cell.min()
    number = np.bincount(cell)
    means = np.bincount(cell, apart)[number > 0] / number[number > 0]
    number = number[number > 0]
    sizes = np.geomspace(max(np.percentile(apart, 0.1) / 4, 1e-6), 4 * apart.max(), _CURVE)
    equal = squares.size - len(apart)
    sums = np.array([equal + (number * np.exp(-means / (2 * e))).sum() for e in sizes])
    curve = np.stack([np.log(sizes), np.log(sums)], 1)
    slope = np.gradient(curve[:, 1], curve[:, 0])
    best = int(slope.argmax())
    dimension = max(2 * float(slope[best]), 0.5)  # eq. 2
    # eq. 6; by eq. 2 the exponent should be 2 / d, which made no measurable difference
    size = float(sizes[best]) * (len(chosen) / texels.count) ** (1 / dimension)
    return Kernel(size, float(sizes[best]), dimension, curve)


def weights_of(squares: np.ndarray, size: float, euclidean: bool) -> np.ndarray:
    """LDR09 eq. 1; if `euclidean` eq. 7: 1 / distance, clipped below a step of Lab."""
    if euclidean:
        return 1 / np.sqrt(np.maximum(squares, np.float32(1 / 64)))
    return np.exp(squares * np.float32(-0.5 / size))


def densities(texels: Texels, chosen: np.ndarray, size: float, euclidean: bool, resources: Resources) -> np.ndarray:
    """LDR09 eq. 4 by the landmarks `chosen` (section 6.2), (N,) float64; `euclidean`: eq. 7 instead of eq. 1."""
    marks = texels.values[chosen]

    def density(first: int) -> np.ndarray:
        here = squared_distances(texels.values[first : first + _BLOCK], marks)
        return weights_of(here, size, euclidean).sum(1, dtype=np.float64)

    return np.concatenate(list(resources.spread(density, range(0, texels.count, _BLOCK))))


def neighbor_count(count: int) -> int:
    """k = log^2 N: LDR09 section 6.3, with the natural logarithm."""
    return min(count, max(8, int(math.log(max(count, 2)) ** 2)))


def description_time(count: int, patch: int) -> float:
    """Expected time of `texels_of`, in nanoseconds of a usual processor."""
    return 7.5 * count * patch**3.3


def search_time(count: int, dimensions: float) -> float:
    """Expected time of `neighbor_squares`, in nanoseconds of a usual processor."""
    return count * count * (2.6 + 0.022 * dimensions)


def neighbor_squares(texels: Texels, resources: Resources, progress: Progress) -> csr_array:
    """Squared distances to the k nearest, including itself (LDR09 section 6.3), rows of k entries each.

    If it will take long, a warning says how long.

    Exact, unlike the paper's. Distances are matrix products of blocks, with the squared norms as two additional
    dimensions. A sample of each row, every `_EVERY`th entry, gives an upper bound of the k smallest. Only entries below
    it are sorted, unless they are fewer than k.
    """
    count = texels.count
    k = neighbor_count(count)
    norms = (texels.values * texels.values).sum(1)[:, None]
    ones = np.ones_like(norms)
    left = np.concatenate([texels.values * np.float32(-2), norms, ones], 1)
    right = np.concatenate([texels.values, ones, norms], 1).T.copy()
    expected = k / _EVERY
    rank = min(int(expected + 3 * math.sqrt(expected)) + 2, -(-count // _EVERY) - 1)

    def nearest(first: int) -> tuple[np.ndarray, np.ndarray]:
        squares = left[first : first + _ROWS] @ right
        here = np.arange(len(squares))
        squares[here, first + here] = 0
        bound = np.partition(squares[:, ::_EVERY], rank, axis=1)[:, rank]
        within = squares <= bound[:, None]
        neighbors = np.empty((len(squares), k), np.int32)
        for n, row in enumerate(squares):
            near = np.flatnonzero(within[n])
            if len(near) < k:
                near = np.arange(count)
            neighbors[n] = near[np.argpartition(row[near], k - 1)[:k]]
        return neighbors, np.maximum(np.take_along_axis(squares, neighbors, 1), 0)

    firsts, pieces, begin, timed = range(0, count, _ROWS), [], time.monotonic(), False
    for piece in resources.spread(nearest, firsts):
        pieces.append(piece)
        progress.advance(len(pieces), len(firsts))
        passed = time.monotonic() - begin
        if not timed and passed > _TIMED:
            timed, remaining = True, passed / len(pieces) * (len(firsts) - len(pieces))
            if remaining > _LONG:
                log.warning("comparing %d patches takes about %.0f s", count, remaining)
    columns, values = (np.concatenate(p).ravel() for p in zip(*pieces, strict=True))
    return csr_array((values, columns, np.arange(0, count * k + 1, k, dtype=np.int32)), shape=(count, count))


def landmark_squares(texels: Texels, chosen: np.ndarray, resources: Resources) -> csr_array:
    """Squared distances of all texels to landmarks, in the format of `neighbor_squares`."""

    def away(first: int) -> np.ndarray:
        return squared_distances(texels.values[first : first + _BLOCK], texels.values[chosen])

    values = np.concatenate(list(resources.spread(away, range(0, texels.count, _BLOCK))))
    rows = np.arange(0, values.size + 1, len(chosen))
    columns = np.tile(chosen.astype(np.int32), texels.count)
    return csr_array((values.ravel(), columns, rows), shape=(texels.count, texels.count))


def neighbor_weights(squares: csr_array, size: float, euclidean: bool) -> csr_array:
    """The symmetric sparse kernel: a weight if either of two texels is a near neighbor of the other."""
    weights = weights_of(squares.data, size, euclidean)
    directed = csr_array((weights, squares.indices, squares.indptr), shape=squares.shape)
    return directed.maximum(directed.T).tocsr()


def memory_needed(pixels: int, texels: int, patch: int, threads: int) -> int:
    """Peak memory of the search for a dominant texture, in bytes.

    There may be as many components as values in a patch, as for grass, and they are held three times during the search
    for neighbors.
    """
    k, values = neighbor_count(texels), 3 * patch * patch
    marks = texels**LANDMARKS
    covariance = 20 * min(texels, _COVARIANCE) * values + 24 * values**2
    blocks = threads * max(8 * _ROWS * texels, 16 * _BLOCK * marks, 12 * _BLOCK * values)
    components = 12 * texels * values
    return int(60 * pixels + 40 * texels * (k + 3) + 40 * marks**2 + blocks + max(covariance, components))
