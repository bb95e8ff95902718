# SPDX-License-Identifier: Apache-2.0
"""Compact regions of a photo that look like nothing else in it: a knot, a chip of paint, a leaf on a plate."""

from __future__ import annotations

from ...engine.color.lab_reduced import lab_pixels
from ...engine.color.lens import Lens
from ...engine.core.image import Image
from ...engine.deferred import np
from ...engine.session.resources import Resources
from .compact_regions import NOISE, connected

_SIDE = 128  # px; about the longer side at which the photo is searched
_LEAST = 128  # px; a smaller shorter side does not tell what is rare
_STEP = 2  # px between patches, and between the samples of a patch, three a side
_STEPS = 8.0  # of Lab values per unit: sums of integers are exact in any order
_COMPARED = 600  # about how many patches each one is compared with
_COMMON = 0.05  # share of the photo that must look alike for it not to be rare
_USUAL, _VARIED = 0.9, 2.0  # if a tenth of the photo is farther than twice the median, it has several materials
_PEAK = 1.85  # of that quantile: the least distance of the rarest region
_LIKEWISE = 0.7  # of that region's: others of its kind
_END = 1.5  # of the median: where a region ends
_LONG, _THIN = 0.3, 4  # of the longer side, and times as long as wide: more are joints and cracks
_MOST, _LARGEST = 7, 0.12  # more regions, or a larger share of the photo, are the texture itself
_AT_ONCE = 64  # patches, whose distances fit the cache of a core


def rare_regions(photo: Image, lens: Lens, resources: Resources) -> np.ndarray | None:
    """Pixels of a photo that stand out, and would be seen in every tile, (height, width) bool; None: there are none.

    `photo` has no low-frequency variation. A patch is rare if less than 5 % of the photo looks like it. Colors alone
    would find the white ones of many stones, and overlook a knot in wood.
    """
    height, width = photo.first.spec.height, photo.first.spec.width
    if min(height, width) < _LEAST:
        return None
    reduced = lab_pixels(photo, lens, resources, max(1, round(max(height, width) / _SIDE)))
    patches = _patches(np.rint(reduced.lab * _STEPS).astype(np.float64))
    seen = reduced.seen[::_STEP, ::_STEP]
    if np.count_nonzero(seen) < _COMPARED:
        return None
    found = _compact(_distances(patches, seen), seen)
    if not found.any():
        return None
    rows, columns = (np.arange(n) // (_STEP * reduced.factor) for n in (height, width))
    return found[rows][:, columns]


def _patches(values: np.ndarray) -> np.ndarray:
    """The samples of the patch around every second pixel of (height, width, channels), (down, across, samples)."""
    height, width = values.shape[:2]
    wide = np.pad(values, ((_STEP, _STEP), (_STEP, _STEP), (0, 0)), mode="reflect")
    shifts = range(0, 2 * _STEP + 1, _STEP)
    return np.concatenate([wide[y : y + height : _STEP, x : x + width : _STEP] for y in shifts for x in shifts], -1)


def _distances(samples: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Distance of each patch to the nearest `_COMMON` of the `seen` ones, (down, across); at least that of noise.

    `samples` (down, across, n) float64, integers.
    """
    patches = samples[seen]
    others = patches[:: max(1, len(patches) // _COMPARED)]
    nearest, squares = int(_COMMON * len(others)), (others * others).sum(1)
    columns = np.ascontiguousarray(-2.0 * others.T)
    noise = NOISE * _STEPS * patches.shape[1] ** 0.5
    distances, nearby = np.full(seen.shape, noise), np.empty(len(patches))
    for first in range(0, len(patches), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        apart = np.einsum("ik,kj->ij", patches[some], columns)  # not BLAS, whose waiting threads cost as much again
        apart += squares
        apart.partition(nearest, 1)
        nearby[some] = apart[:, nearest]
    distances[seen] = np.sqrt(np.maximum(noise**2, nearby + (patches * patches).sum(1)))
    return distances


def _compact(distances: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """The compact regions of rare patches, one patch wider, (down, across) bool; none if they are the texture."""
    ordered = np.sort(distances[seen])
    median, usual = (float(ordered[int(share * len(ordered))]) for share in (0.5, _USUAL))
    least = _PEAK * usual
    if usual > _VARIED * median or ordered[-1] < least:
        return np.zeros(seen.shape, bool)
    places = connected(distances > _END * median)
    rare = np.unique(places[distances >= _LIKEWISE * ordered[-1]])
    for place in rare:
        short, long = sorted(np.ptp(line) + 1 for line in np.nonzero(places == place))
        if long > min(_LONG * max(seen.shape), _THIN * short):
            return np.zeros(seen.shape, bool)
    high, wide = distances.shape
    padded = np.pad(np.isin(places, rare), 1)
    regions = np.logical_or.reduce([padded[y : y + high, x : x + wide] for y in range(3) for x in range(3)])
    count = len(np.unique(connected(regions)[regions]))
    return regions & (count <= _MOST and regions.mean() <= _LARGEST)
