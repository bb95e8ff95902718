# SPDX-License-Identifier: Apache-2.0
"""Whether a result of copies keeps the photo's objects whole: the share of its patches that no place explains."""

from __future__ import annotations

from typing import cast

from ...engine.core.demand import SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np

_PLACES = 2000  # patches that are looked at, on a grid
_ACROSS = 9  # samples along a patch, and it is 1/12 of the photo's longer side: as large as what is seen as an object
_REACH = 12 * (_ACROSS - 1)
_GAINS = 0.7, 1.4  # of a copy that evening out may have made lighter or more contrasty
_STEPS = 8.0  # of Lab values per unit: sums of integers are exact in any order
_UNEXPLAINED = 0.8  # of a patch's variance
_LEAST_SHARE = 0.1  # of the photo's variance: patches with less are compared with this, as nothing is seen in them


def broken_patches(photo: SomeRows, source: SourceMap, wraps: tuple[bool, bool]) -> float | None:
    """Share of a result's patches that differ from the photo at every place that their pixels come from.

    A patch that was copied in one piece is a piece of the photo. One across a cut is compared with nine places: where
    its middle, its corners and the middles of its sides would lie if all of it came from there. Where the pieces
    continue each other, one of them explains it. Local level and contrast are taken out, since evening changes them.

    Parameters
    ----------
    photo : (height, width, 3) float32
        CIE Lab that the result consists of.
    source : SourceMap
        Of each pixel of the result, (h, w).
    wraps : (bool, bool)
        The result is a torus along y, along x.

    Returns
    -------
    float or None
        0 to 1. None: the result or the photo is smaller than three patches.
    """
    stride = max(1, round(max(photo.shape[:2]) / _REACH))
    half = stride * (_ACROSS // 2)
    if min(*photo.shape[:2], *source.packed.shape) < 6 * half:
        return None
    grid = _centers(cast("tuple[int, int]", source.packed.shape), half, wraps)
    around = np.arange(-half, half + 1, stride)
    own = _samples(source, photo, grid, around)
    explained, variance = np.zeros(len(own)), (own * own).mean(1)
    for down in (-half, 0, half):
        for right in (-half, 0, half):
            there = _continued(source, photo.shape, grid, (down, right), half)
            other = _samples(None, photo, there, around)
            both, power = (own * other).mean(1), (other * other).mean(1)
            gain = np.clip(both / np.maximum(power, 1.0), *_GAINS)
            explained = np.maximum(explained, gain * (2 * both - gain * power))
    usual = float(variance.mean())
    return float((variance - explained > _UNEXPLAINED * np.maximum(variance, _LEAST_SHARE * usual + 1e-9)).mean())


def _centers(shape: tuple[int, int], half: int, wraps: tuple[bool, bool]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the patches' middles, one for each."""
    step = max(1, int((shape[0] * shape[1] / _PLACES) ** 0.5))
    lines = (
        np.arange(step // 2, n, step) if around else np.arange(half, n - half, step)
        for n, around in zip(shape, wraps, strict=True)
    )
    down, right = np.meshgrid(*lines, indexing="ij")
    return down.ravel(), right.ravel()


def _samples(
    source: SourceMap | None, photo: SomeRows, centers: tuple[np.ndarray, np.ndarray], around: np.ndarray
) -> np.ndarray:
    """Lab of patches of the result, or without `source` of the photo, minus their means: (patches, n) of integers.

    Each is multiplied by the number of samples, so that subtracting the mean leaves integers.
    """
    y, x = centers[0][:, None, None] + around[:, None], centers[1][:, None, None] + around
    if source is not None:
        height, width = source.packed.shape
        picked = source[y % height, x % width]
    else:
        picked = SourceMap.of(*np.broadcast_arrays(y, x), bits=32)
    values = np.rint(picked.gather(photo).astype(np.float64) * _STEPS).reshape(len(y), -1, 3)
    values = values * values.shape[1] - values.sum(1, keepdims=True)
    return values.reshape(len(y), -1)


def _continued(
    source: SourceMap,
    shape: tuple[int, ...],
    centers: tuple[np.ndarray, np.ndarray],
    offset: tuple[int, int],
    half: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Where the patches' middles lie in the photo if the pixel at that offset is in its place."""
    height, width = source.packed.shape
    places = source[(centers[0] + offset[0]) % height, (centers[1] + offset[1]) % width].yx
    y, x = (np.clip(at - by, half, n - 1 - half) for at, by, n in zip(places, offset, shape, strict=False))
    return y, x
