# SPDX-License-Identifier: Apache-2.0
"""Whether a result of copies keeps objects whole: its variance that the photo does not explain, if cuts are visible."""

from __future__ import annotations

from typing import cast

from ...analysis.regularity.autocorrelation import blurred
from ...engine.core.demand import SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np

_PLACES = 1500  # patches that are looked at, on a grid
_AT_ONCE = 256  # of them: their samples fit the cache of a core
_ACROSS = 9  # samples along a patch
_OBJECT, _EDGE = 12, 48  # the longer side over that of a patch: as large as an object, and as the edge of one
_LEAST_STEP = 0.5  # px between samples
_GAINS = 0.7, 1.4  # of a copy that evening out may have made lighter or more contrasty
_STEPS = 8.0  # of Lab values per unit: sums of integers are exact in any order
_LEAST_SHARE = 0.1  # of the patches' mean variance: those with less count as if they had this, as they are plain
_BENT = 1 / 8  # of half a patch, and one pixel: what leveling a tilt moves (`layout`)
_WINDOW = 1 / 16  # of the longer side: sigma of the windows whose directions are compared


def cuts(photo: SomeRows, source: SourceMap, wraps: tuple[bool, bool]) -> float | None:
    """How much a result is cut: from 0 to 1, or None if it or the photo is smaller than three objects.

    Among leaves and stones of all sizes, patches as large as objects are new, and yet nothing is seen; what is seen is
    an edge that ends. So edges weigh three times as much as objects in this geometric mean of what the photo does not
    explain. For the parameters, see `unexplained`.
    """
    objects, edges = (unexplained(photo, source, wraps, share) for share in (_OBJECT, _EDGE))
    if objects is None or edges is None:
        return None
    return float(np.sqrt(edges) * np.sqrt(np.sqrt(edges * objects)))


def unexplained(photo: SomeRows, source: SourceMap, wraps: tuple[bool, bool], share: int = _OBJECT) -> float | None:
    """Share of the variance of a result's patches that the photo does not explain.

    A patch that was copied in one piece is a piece of the photo, also if a tilt was leveled in it. One across a cut is
    compared with nine places: where its middle, its corners and the middles of its sides would lie if all of it came
    from there. Where the pieces continue each other, one of them explains it. Local level and contrast are taken out,
    since evening changes them.

    Parameters
    ----------
    photo : (height, width, 3) float32
        CIE Lab that the result consists of.
    source : SourceMap
        Of each pixel of the result, (h, w).
    wraps : (bool, bool)
        The result is a torus along y, along x.
    share : int
        The photo's longer side over the side of a patch.

    Returns
    -------
    float or None
        0 to 1. None: the result or the photo is smaller than three patches.
    """
    apart = max(_LEAST_STEP, max(photo.shape[:2]) / (share * (_ACROSS - 1)))
    around = np.rint(apart * (np.arange(_ACROSS) - _ACROSS // 2)).astype(np.int64)
    half = int(around[-1])
    if min(*photo.shape[:2], *source.packed.shape) < 6 * half:
        return None
    centers = _centers(cast("tuple[int, int]", source.packed.shape), half, wraps)
    in_memory = isinstance(photo, np.ndarray) and isinstance(source.packed, np.ndarray)
    step = _AT_ONCE if in_memory else len(centers[0])  # rows of files are read once
    blocks = (tuple(at[n : n + step] for at in centers) for n in range(0, len(centers[0]), step))
    pieces = [_explained(photo, source, places, around) for places in blocks]
    variance, explained = (np.concatenate(one) for one in zip(*pieces, strict=True))
    least = _LEAST_SHARE * float(variance.mean()) + 1.0
    return float(((variance - explained) / np.maximum(variance, least)).mean())


def _explained(
    photo: SomeRows, source: SourceMap, grid: tuple[np.ndarray, ...], around: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the patches around some places, and how much of it the photo explains."""
    half = int(around[-1])
    y, x = (at[:, None, None] + by for at, by in zip(grid, (around[:, None], around), strict=True))
    picked = _sources(source, y, x)
    own = _samples(picked, photo)
    variance = _products(own, own)
    is_cut = _bent(picked, around) > _BENT * half + 1
    explained = variance.copy()  # no continuation explains more than all
    if is_cut.any():
        cut = tuple(at[is_cut] for at in grid)
        explained[is_cut] = _best_continuation(photo, source, cut, around, own[is_cut])
    return variance, explained


def _best_continuation(
    photo: SomeRows, source: SourceMap, grid: tuple[np.ndarray, ...], around: np.ndarray, own: np.ndarray
) -> np.ndarray:
    """How much of the variance of patches, whose samples are `own`, the best of their nine continuations explains.

    Places on the same side of a cut continue alike: each continuation of a patch is compared once.
    """
    half, explained = int(around[-1]), np.zeros(len(own))
    offsets = [(down, right) for down in (-half, 0, half) for right in (-half, 0, half)]
    continued = np.array([_continued(source, photo.shape, grid, offset, half) for offset in offsets])
    for n, there in enumerate(continued):
        new = np.flatnonzero(~(continued[:n] == there).all(1).any(0))
        if not new.size:
            continue
        y, x = there[0, new, None, None] + around[:, None], there[1, new, None, None] + around
        other = _samples(SourceMap.of(y, x, bits=32), photo)
        both, power = _products(own[new], other), _products(other, other)
        gain = np.clip(both / np.maximum(power, 1.0), *_GAINS)
        explained[new] = np.maximum(explained[new], gain * (2 * both - gain * power))
    return explained


def turning(light: np.ndarray) -> float:
    """How much the direction of edges and lines differs from place to place: 0 is one direction, or none at all.

    A cut is hidden among gravel and leaves, and seen where it bends a joint, a plank or a vein. `light` (height,
    width) float.
    """
    smooth = blurred(light[..., None] - light.mean(), 1.0)[2:-2, 2:-2, 0]
    down, right = np.gradient(smooth)
    planes = np.stack([right * right - down * down, 2 * right * down, right * right + down * down], -1)
    tensor = blurred(planes, _WINDOW * max(light.shape))
    direction = tensor[..., :2] / np.maximum(tensor[..., 2:], 1e-6)
    return float(np.hypot(*np.moveaxis(direction - direction.mean((0, 1)), -1, 0)).mean())


def times_shown(
    source: SourceMap, size: tuple[int, int], photo: tuple[int, int], reduced: tuple[int, int], sigma: float
) -> np.ndarray:
    """How often the area around the source of each pixel is shown, over the fair share: (h, w), at least 1.

    Parameters
    ----------
    source : SourceMap
    size : (int, int)
        Height and width at which the result is sampled.
    photo, reduced : (int, int)
        Height and width of the photo, and at which places are counted.
    sigma : float
        px of the reduced photo: of an area.
    """
    y, x = (np.arange(n) * there // n for n, there in zip(size, source.packed.shape, strict=True))
    places = _sources(source, *np.meshgrid(y, x, indexing="ij")).yx
    down, right = (np.clip(at * n // there, 0, n - 1) for at, n, there in zip(places, reduced, photo, strict=True))
    uses = np.bincount((down * reduced[1] + right).ravel(), minlength=reduced[0] * reduced[1]).reshape(*reduced, 1)
    shown = blurred(uses.astype(np.float64), sigma)[..., 0]
    return np.maximum(1.0, shown[down, right] / max(1.0, down.size / uses.size))


def _centers(shape: tuple[int, int], half: int, wraps: tuple[bool, bool]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the patches' middles, one for each."""
    step = max(1, int((shape[0] * shape[1] / _PLACES) ** 0.5))
    lines = (
        np.arange(step // 2, n, step) if around else np.arange(half, n - half, step)
        for n, around in zip(shape, wraps, strict=True)
    )
    down, right = np.meshgrid(*lines, indexing="ij")
    return down.ravel(), right.ravel()


def _bent(picked: SourceMap, around: np.ndarray) -> np.ndarray:
    """How far the samples of patches, (patches, n, n), lie from where they would be in one piece of the photo, px."""
    (y, x), middle = picked.yx, len(around) // 2
    places = np.stack([y - around[:, None], x - around])
    return np.abs(places - places[:, :, middle, middle, None, None]).max((0, 2, 3))


def _samples(picked: SourceMap, photo: SomeRows) -> np.ndarray:
    """Lab of patches of the photo, (patches, n, n), minus their means: (patches, n * n * 3) of integers.

    Each is multiplied by the number of samples, so that subtracting the mean leaves integers.
    """
    values = np.rint(picked.gather(photo).astype(np.float64) * _STEPS).reshape(len(picked.packed), -1, 3)
    sums = np.einsum("psc->pc", values)
    values *= values.shape[1]
    values -= sums[:, None]
    return values.reshape(len(values), -1)


def _products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Mean product of each patch's samples. Sums of integers: exact in any order."""
    return np.einsum("ps,ps->p", a, b) / a.shape[1]


def _continued(
    source: SourceMap,
    shape: tuple[int, ...],
    centers: tuple[np.ndarray, ...],
    offset: tuple[int, int],
    half: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Where the patches' middles lie in the photo if the pixel at that offset is in its place."""
    places = _sources(source, centers[0] + offset[0], centers[1] + offset[1]).yx
    y, x = (np.clip(at - by, half, n - 1 - half) for at, by, n in zip(places, offset, shape, strict=False))
    return y, x


def _sources(source: SourceMap, y: np.ndarray, x: np.ndarray) -> SourceMap:
    """The sources of some pixels of a torus, which may be in a file."""
    height, width = source.packed.shape
    return SourceMap(SourceMap.of(y % height, x % width, bits=32).gather(source.packed), source.bits)
