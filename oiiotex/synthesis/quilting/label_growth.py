# SPDX-License-Identifier: Apache-2.0
"""Synthesis of a label map of any size from that of the exemplar: the future work of LSA16 §7.

A label map is itself a texture. It is reduced to cells of about a quarter of its scale, labels become distant
colors, and PatchMatch with voting (`optimization.synthesize`, without projection) makes a map of the new size.
Uniform use of the exemplar's map and histogram matching preserve the shares, and whole patches preserve adjacency. Of
several starts, the one whose shares and adjacency are nearest to the exemplar's is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ...engine.core.window import Domain
from ...engine.deferred import np
from ...engine.errors import ImageError
from ...engine.opencl.device import Device
from ..patchmatch.optimization import synthesize
from ..patchmatch.patch_search import RANDOM
from ..patchmatch.recipe import Recipe

CELLS = 4  # per scale of a label map
_LEAST, _MOST = 24, 192  # cells along the shorter side of the exemplar's map
_PATCHES = (11, 9, 7, 5)
_UNIFORMITY = 0.3  # strong: shares matter more here than the coherence of single borders
_ITERATIONS = 20
_SIDE = 100.0  # of the color cube, Lab units


@dataclass(frozen=True)
class Grown:
    """A synthesized label map.

    Errors of the shares of labels, and of adjacent pairs: half the sum of absolute differences, 0 to 1.
    """

    ids: np.ndarray  # (height, width) uint32: one per cell
    shares: float
    neighbors: float


def cell_side(rho: float, width: int, height: int) -> int:
    """Side of a cell for a label map of scale `rho`, px: the map must have several patches of cells."""
    shorter = min(width, height)
    side = round(rho / CELLS) if rho > 0 else shorter // 64
    return max(1, -(-shorter // _MOST), min(side, shorter // _LEAST))


def cells_of(ids: np.ndarray, side: int) -> np.ndarray:
    """The most frequent label of every cell, ties to the lower: (rows, columns), without incomplete cells."""
    rows, columns = (max(1, n // side) for n in ids.shape)
    ids = ids[: rows * side, : columns * side]
    best, most = np.zeros((rows, columns), np.int64), np.full((rows, columns), -1)
    for label in np.unique(ids):
        count = (ids == label).reshape(rows, ids.shape[0] // rows, columns, -1).sum((1, 3))
        better = count > most
        best[better], most[better] = label, count[better]
    return best.astype(np.uint32)


def apart(count: int) -> np.ndarray:
    """Colors (count, 3) on a grid of the cube, each as far as possible from those before it."""
    steps = max(2, int(np.ceil(count ** (1 / 3))) + 1)
    grid = np.stack(np.meshgrid(*[np.linspace(0, _SIDE, steps)] * 3, indexing="ij"), -1).reshape(-1, 3)
    chosen, nearest = [0], np.full(len(grid), np.inf)
    while len(chosen) < count:
        nearest = np.minimum(nearest, ((grid - grid[chosen[-1]]) ** 2).sum(1))
        chosen.append(int(nearest.argmax()))
    return grid[chosen].astype(np.float32)


def grow_labels(
    device: Device,
    ids: np.ndarray,
    side: int,
    domain: Domain,
    seed: int,
    budget: int,
    progress: Callable[[int, int], None],
    tries: int = 4,
    search: str = RANDOM,
) -> Grown:
    """Synthesize a map of labels from (h, w) ids, in cells of `side` px, for a domain. The best of `tries` is returned.

    `search`: as of `Recipe`.

    Raises ImageError if it has no label, or regions too small for a patch of cells. Id 0 is unlabeled, and not grown.
    """
    cells = cells_of(ids, side)
    labels, index = np.unique(cells, return_inverse=True)
    index = index.reshape(cells.shape)
    allowed = cells != 0
    if not allowed.any():
        raise ImageError("the label map has no labels to grow")
    width, height = (max(_PATCHES[-1], -(-n // side)) for n in domain.size)
    values = apart(len(labels))[index]
    best, attempt = None, 0

    def counted(done: int, total: int) -> None:
        progress(attempt * total + done, tries * total)

    patch = _patch(cells.shape, allowed, (height, width))
    for attempt in range(tries):
        recipe = Recipe(
            width, height, *domain.wraps, sigma=None, patch=patch, iterations=_ITERATIONS,
            seed=(seed + 0x9E3779B1 * attempt) & 0xFFFFFFFF, uniformity=_UNIFORMITY,
            contrast=1.0, flat=False, literal=True, search=search,
        )  # fmt: skip
        mask = None if allowed.all() else allowed
        synthesis = synthesize(device, values, mask, recipe, budget, counted, "cells without a label")
        grown = synthesis.source.gather(index)
        off = _away(_shares(index, allowed, len(labels)), _shares(grown, np.ones(grown.shape, bool), len(labels)))
        beside = _away(_pairs(index, allowed, len(labels)), _pairs(grown, np.ones(grown.shape, bool), len(labels)))
        if best is None or off + beside < best.shares + best.neighbors:
            best = Grown(labels[grown].astype(np.uint32), off, beside)
    assert best is not None
    return best


def _patch(shape: tuple[int, ...], allowed: np.ndarray, size: tuple[int, int]) -> int:
    """The largest patch of cells that is at most a fourth of both maps and fits between the holes."""
    least = min(*shape, *size)
    for patch in _PATCHES:
        inside = np.lib.stride_tricks.sliding_window_view(allowed, (min(patch, shape[0]), min(patch, shape[1])))
        if (4 * patch <= least or patch == _PATCHES[-1]) and inside.all((2, 3)).any():
            return patch
    raise ImageError("the labeled regions of the label map are too small to grow from")


def _shares(index: np.ndarray, counted: np.ndarray, count: int) -> np.ndarray:
    return np.bincount(index[counted], minlength=count) / max(1, int(np.count_nonzero(counted)))


def _pairs(index: np.ndarray, counted: np.ndarray, count: int) -> np.ndarray:
    """Shares of pairs of different labels among all neighbors, in either order: (count^2,)."""
    sums = np.zeros(count * count)
    total = 0
    for a, b, ok in (
        (index[:, :-1], index[:, 1:], counted[:, :-1] & counted[:, 1:]),
        (index[:-1], index[1:], counted[:-1] & counted[1:]),
    ):
        low, high = np.minimum(a[ok], b[ok]), np.maximum(a[ok], b[ok])
        sums += np.bincount((low * count + high), minlength=count * count)
        total += low.size
    return sums / max(1, total)


def _away(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).sum() / 2)
