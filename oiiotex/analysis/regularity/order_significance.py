# SPDX-License-Identifier: Apache-2.0
"""Whether a lattice is significant: a permutation test on the photo itself.

The photo is divided into the lattice's cells, and the mean of all cells is computed: if they are alike, it varies as
they do, otherwise it is flat. Then whole rows of cells are shifted against each other at random, which keeps everything
inside a row (ledges, streaks, stones of similar size) and destroys only the order. The variance of the mean
cell must be far above that of such photos, along both directions of the lattice.
"""

from __future__ import annotations

import math

from ...engine.deferred import np

SHIFTED = 64  # number of photos with shifted rows
_BIN = 1.5  # minimum width of a part of a cell, px
_BINS = 4, 32  # minimum and maximum number of parts of a cell


def order_of(texture: np.ndarray, usable: np.ndarray, frequencies: np.ndarray, enough: float) -> float:
    """The significance of a lattice: deviations of the mean cell's variance above that of shifted photos, the minimum.

    For rank 2, rows are shifted along each of the short vectors in turn: stripes do not change when
    shifted along themselves, and so are not such a lattice.

    `texture` (height, width, channels) float64; `usable` (height, width) bool; `frequencies` (rank, 2) float.
    """
    if len(frequencies) == 1:
        return _order_along(texture, usable, frequencies)
    vectors = np.linalg.inv(frequencies).T
    steps = np.array([[[1, 0], [0, 1]], [[0, 1], [1, 0]], [[1, 1], [0, 1]], [[1, -1], [0, 1]]])
    least = math.inf
    for pair in steps:
        least = min(least, _order_along(texture, usable, np.linalg.inv(pair @ vectors).T))
        if least < enough:
            break
    return least


def least_of_halves(texture: np.ndarray, usable: np.ndarray, frequencies: np.ndarray, enough: float) -> float:
    """The smallest significance in the left, right, upper and lower half: low for a lattice that bends or ends."""
    least = math.inf
    for axis in (0, 1):
        counts = np.cumsum(usable.sum(1 - axis))
        middle = int(np.searchsorted(counts, counts[-1] / 2)) + 1
        for half in (slice(0, middle), slice(middle, None)):
            part = (half, slice(None)) if axis == 0 else (slice(None), half)
            if not usable[part].any():
                return 0.0
            least = min(least, order_of(texture[part], usable[part], frequencies, enough))
            if least < enough:
                return least
    return least


def _order_along(texture: np.ndarray, usable: np.ndarray, frequencies: np.ndarray) -> float:
    """The same for rows that are shifted along the first vector only."""
    bins = [int(np.clip(1 / (_BIN * np.hypot(*f)), *_BINS)) for f in frequencies]
    random = np.random.Generator(np.random.PCG64(0x0DE5))
    sums, counts = _cell_rows(texture, usable, frequencies, bins)
    own = _variance(sums.sum(0), counts.sum(0))
    rows, parts, by_chance = np.arange(len(sums))[:, None], np.arange(bins[0]), []
    for _ in range(SHIFTED):
        at = rows, (parts + random.integers(0, bins[0], len(sums))[:, None]) % bins[0]
        by_chance.append(_variance(sums[at].sum(0), counts[at].sum(0)))
    return float((own - np.mean(by_chance)) / max(float(np.std(by_chance)), 1e-12))


def _cell_rows(
    texture: np.ndarray, usable: np.ndarray, frequencies: np.ndarray, bins: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Sums over the cells of each row, (rows, *bins, channels), and counts without channels."""
    height, width, channels = texture.shape
    y, x = np.mgrid[:height, :width]
    row = np.floor(x * frequencies[0, 0] + y * frequencies[0, 1]).astype(np.int64)
    row -= row.min()
    part = [row[usable]]
    for (fx, fy), n in zip(frequencies, bins, strict=True):
        phase = (x * fx + y * fy)[usable] % 1.0
        part.append(np.minimum((phase * n).astype(np.int64), n - 1))
    shape = (int(row.max()) + 1, *bins)
    place, size = np.ravel_multi_index(tuple(part), shape), int(np.prod(shape))
    counts = np.bincount(place, minlength=size).reshape(shape)
    sums = [np.bincount(place, texture[..., c][usable], size).reshape(shape) for c in range(channels)]
    return np.stack(sums, -1), counts


def _variance(sums: np.ndarray, counts: np.ndarray) -> float:
    """Variance of the mean cell, over its parts and summed over channels."""
    mean = sums.sum(tuple(range(counts.ndim))) / counts.sum()
    part = sums / np.maximum(counts, 1)[..., None]
    return float((((part - mean) ** 2) * counts[..., None]).sum() / counts.sum())
