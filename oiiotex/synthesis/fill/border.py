# SPDX-License-Identifier: Apache-2.0
"""The step at the border of a fill, as a correction that fades out into the region.

Next to the border, the fill's source is continued by one pixel and compared with the kept pixel there. Where they
differ, viewers see the outline of the region. The differences are distributed over some pixels by a screened Poisson
equation (Perez, Gangnet and Blake, Poisson Image Editing, SIGGRAPH 2003; screened as in Bhat, Curless, Cohen and
Zitnick, ECCV 2008): differences of fine detail fade out within a pixel or two, differences of level within `fade`.
So gradients across the border are those of the source, and detail is not blurred.
"""

from __future__ import annotations

from ...engine.core.demand import SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np

BYTES = 160  # for each pixel of the window, at most
_DEPTH = 4.0  # of `fade`: farther from the border there is no correction
_WEIGHT = 2.0  # of a difference across the border relative to one inside: at 1, half of the jump remains
_RANGE = 0.1, 0.9  # quantiles of the kept pixels: a larger step than between these is the edge of an object
_ROUNDS = 6.0  # of successive over-relaxation, for each pixel of `fade`
_STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0))


def border_offsets(
    kept: np.ndarray, exemplar: SomeRows, source: SourceMap, shown: np.ndarray, is_kept: np.ndarray,
    usable: np.ndarray | None, fade: float, wraps: tuple[bool, bool] = (False, False),
) -> np.ndarray:  # fmt: skip
    """Offsets that close the step at the border of a fill, (height, width, 3) float32, 0 in all other pixels.

    Parameters
    ----------
    kept : (height, width, channels) float32
        The photo; with `Light`, at the common level.
    exemplar : (rows, columns, channels) float32
        The source, at the same level.
    source : SourceMap
        (height, width): pixels of the exemplar.
    shown, is_kept : (height, width) bool
        Pixels of the fill, and of the photo next to them.
    usable : (rows, columns) bool or None
        Pixels that the source may be continued with. None: all.
    fade : float
        Distance, px, over which a difference of level falls to 1/e.
    wraps : (bool, bool)
        The photo tiles along x, along y.
    """
    from scipy.ndimage import distance_transform_edt  # slow to import

    out = np.zeros((*shown.shape, 3), np.float32)
    if not is_kept.any() or not shown.any():
        return out
    most = np.diff(np.quantile(kept[is_kept][:, :3], _RANGE, axis=0), axis=0)[0].astype(np.float32)
    y, x = np.nonzero(shown & (distance_transform_edt(~is_kept) <= _DEPTH * fade))
    count, size = len(y), shown.shape
    number = np.full(size, count, np.int32)  # of the unknown in each pixel; the last one is 0
    number[y, x] = np.arange(count, dtype=np.int32)
    from_y, from_x = (at.astype(np.int32) for at in source[y, x].yx)
    sums, weight = np.zeros((count + 1, 3), np.float32), np.full((count + 1, 1), fade**-2, np.float32)
    beside = np.empty((len(_STEPS), count), np.int32)
    for dy, dx, numbers in zip(*np.transpose(_STEPS), beside, strict=True):
        to_y, inside_y = _moved(y + dy, size[0], wraps[1])
        to_x, inside_x = _moved(x + dx, size[1], wraps[0])
        numbers[:] = np.where(inside_y & inside_x, number[to_y, to_x], count)
        weight[:-1, 0] += inside_y & inside_x & shown[to_y, to_x]
        next_y, here_y = _moved(from_y + dy, exemplar.shape[0], False)
        next_x, here_x = _moved(from_x + dx, exemplar.shape[1], False)
        at = inside_y & inside_x & here_y & here_x & is_kept[to_y, to_x]
        at[at] &= True if usable is None else usable[next_y[at], next_x[at]]
        continued = SourceMap.of(next_y[at], next_x[at]).gather(exemplar)[:, :3]
        sums[:-1][at] += _WEIGHT * np.clip(kept[to_y[at], to_x[at], :3] - continued, -most, most)
        weight[:-1, 0] += _WEIGHT * at
    out[y, x] = _solved(sums, weight, beside, (y + x) % 2 == 0, fade)[:-1]
    return out


def _moved(at: np.ndarray, length: int, wraps: bool) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates within an axis, and whether they were."""
    return (at % length if wraps else at.clip(0, length - 1)), ((at >= 0) & (at < length)) | wraps


def _solved(sums: np.ndarray, weight: np.ndarray, beside: np.ndarray, even: np.ndarray, fade: float) -> np.ndarray:
    """The solution of weight * c - (sum of c of neighbors) = sums, with the last unknown 0: as `sums`.

    Pixels of one color of a checkerboard do not depend on each other, so all of them are computed at once.
    """
    found = np.zeros_like(sums)
    radius = np.cos(np.pi / (2 * _DEPTH * fade)) / (1.0 + fade**-2 / 4.0)  # of Jacobi's iteration
    step = np.float32(2.0 / (1.0 + np.sqrt(1.0 - radius**2)))
    colors = [(at, beside[:, at], sums[at], 1.0 / weight[at]) for at in (np.flatnonzero(even), np.flatnonzero(~even))]
    for _ in range(int(np.ceil(_ROUNDS * max(1.0, fade)))):
        for at, neighbors, own, share in colors:
            around = own + found[neighbors[0]] + found[neighbors[1]] + found[neighbors[2]] + found[neighbors[3]]
            found[at] += step * (around * share - found[at])
    return found
