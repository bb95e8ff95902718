# SPDX-License-Identifier: Apache-2.0
"""Steps of level and color at the seams of a tile of copies, and the slow field that removes them.

A cut follows what looks alike at the seam. Farther away, a plank or a sheet of metal may be lighter on one side. As in
gradient-domain stitching (Perez, Gangnet and Blake 2003, section 2), the step is spread: the field differs by it
between both sides of the seam, and elsewhere changes as little as possible. It is a function of the photo's pixels, so
a pixel of the tile stays a corrected copy.
"""

from __future__ import annotations

from ...analysis.drift.compact_regions import LARGEST_TINT
from ...analysis.drift.correction import Correction, smooth_offset, tint_between
from ...analysis.stationarity.grid_statistics import Cells
from ...engine.core.demand import SomeRows
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np

_STEPS = 8.0  # of Lab values per unit: medians of integers
_MOST = LARGEST_TINT  # in L, a or b: more between two pixels is another object, not light
_ENOUGH = 0.625  # share of pixels within these: of fewer, that part of the step is removed
_SAMPLES = 5  # along and across a cell and half a cell on each side of it, around a pixel at the seam
_SAMPLED = 16  # pixels for each side of a cell, at most
_AT_ONCE = 1 << 20  # pixels of the tile that are compared with their neighbors at once
_WEIGHT = 4.0  # of the step along the side of a cell, relative to that of two neighboring cells
_ROUNDS, _LEAST = 160, 2e-3  # of the iteration, and the smallest eigenvalue of a grid of 40 x 40 cells


def level_correction(
    source: SourceMap, wraps: tuple[bool, bool], values: SomeRows, usable: np.ndarray | None, cells: Cells,
    amount: float,
) -> Correction | None:  # fmt: skip
    """The correction of the photo that evens the levels on both sides of the tile's seams; None: it has no seams.

    Parameters
    ----------
    source : SourceMap
        (height, width): the tile.
    wraps : (bool, bool)
        Whether the tile wraps along x, along y.
    values : (h, w, channels) float32
        Of the photo; the first three are CIE Lab.
    usable : (h, w) bool or None
        Valid source pixels of the photo. None: all.
    cells : Cells
        Of the photo, in which the correction may differ.
    amount : float
        Share of the steps that is removed, 0 to 1.
    """
    ends, starts = _across_seams(source, wraps, cells.side)
    if not len(ends):
        return None
    ends, starts = (pairs[:: max(1, cells.side // _SAMPLED)] for pairs in (ends, starts))
    near, far, counts, steps = _steps(ends, starts, values, usable, cells)
    field = amount * _spread(near, far, counts * (_WEIGHT / min(_SAMPLED, cells.side)), steps, cells)
    step = max(1, (1 << 20) // values.shape[1])
    brightest = max(float(values[at : at + step][..., 0].max()) for at in range(0, values.shape[0], step))
    return smooth_offset(field, cells, brightest)


def _across_seams(source: SourceMap, wraps: tuple[bool, bool], least: int) -> tuple[np.ndarray, np.ndarray]:
    """Neighbors in the tile that are at least so far apart in the photo, and where the first ones' own lie: (n, 2)."""
    ends, starts = [], []
    height, width = source.packed.shape
    rows = max(1, _AT_ONCE // width)
    for top in range(0, height, rows):
        here = source.packed[top : top + rows]
        below = source.packed[np.arange(top + 1, top + len(here) + 1) % height]
        for axis, there, step in ((0, below, (1, 0)), (1, np.roll(here, -1, 1), (0, 1))):
            apart = there != here + np.uint32(step[0] << source.bits | step[1])
            if not wraps[1 - axis] and (axis or top + len(here) == height):
                apart[(slice(None),) * axis + (-1,)] = False
            own, next_one = (np.stack(SourceMap(which[apart], source.bits).yx, -1) for which in (here, there))
            far = np.abs(next_one - step - own).max(-1) > least
            ends.append(own[far])
            starts.append(next_one[far] - step)
    return np.concatenate(ends), np.concatenate(starts)


def _steps(
    ends: np.ndarray, starts: np.ndarray, values: SomeRows, usable: np.ndarray | None, cells: Cells
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """For each pair of cells that meet at a seam: both cells, the number of its pixels, and the step.

    A step is the median of the differences between the photo's pixels around one side and those around the other,
    in the units of `correction.smooth_offset`. Pixels of different objects do not count.
    """
    height, width = values.shape[:2]
    size = np.array([height, width])
    apart = np.rint(np.linspace(-cells.side, cells.side, _SAMPLES)).astype(np.int64)
    around = np.stack(np.meshgrid(apart, apart, indexing="ij"), -1).reshape(-1, 2)
    both = np.stack([ends, starts])[:, :, None] + around
    valid = np.asarray(((both >= 0) & (both < size)).all((0, -1)))
    y, x = np.moveaxis(np.clip(both, 0, size - 1), -1, 0)
    if usable is not None:
        valid &= usable[y[0], x[0]] & usable[y[1], x[1]]
    lab = np.rint(SourceMap.of(y, x).gather(values)[..., :3].astype(np.float64) * _STEPS)
    differences = lab[0] - lab[1]
    alike = valid & (np.abs(differences) <= _MOST * _STEPS).all(-1)
    of_end, of_start = (
        cells.lines[p[:, 0]].astype(np.int64) * cells.across + cells.columns[p[:, 1]] for p in (ends, starts)
    )
    count = cells.down * cells.across
    places, which, counts = np.unique(of_end * count + of_start, return_inverse=True, return_counts=True)
    steps = np.zeros((len(places), 3))
    for number, some in enumerate(np.split(np.argsort(which, kind="stable"), np.cumsum(counts)[:-1])):
        near, number_valid = alike[some], np.count_nonzero(valid[some])
        if number_valid == 0:
            counts[number] = 0  # nothing is known: the field continues
        if not near.any():
            continue
        share = min(1.0, float(near.sum() / number_valid) / _ENOUGH)
        step = np.median(differences[some][near], 0) / _STEPS
        level = np.median((lab[0, some] + lab[1, some])[near], 0) / (2 * _STEPS)
        steps[number] = share * tint_between(level + step / 2, level - step / 2)
    return places // count, places % count, counts, steps


def _spread(near: np.ndarray, far: np.ndarray, weights: np.ndarray, steps: np.ndarray, cells: Cells) -> np.ndarray:
    """The field over the cells, (down, across, 3), that is lower by the steps in `near` than in `far`.

    It minimizes the sum of its squared differences between neighbors, plus those from the steps, times `weights`: a
    linear system, solved by Chebyshev's iteration (Golub and Varga 1961), whose every operation is elementwise.
    """
    shape, count = (cells.down, cells.across), steps.shape[1]
    number = shape[0] * shape[1]

    def gathered(flow: np.ndarray) -> np.ndarray:
        sums = [np.bincount(far, f, number) - np.bincount(near, f, number) for f in flow.T]
        return np.stack(sums, -1).reshape(*shape, count)

    def excess(field: np.ndarray) -> np.ndarray:
        out = np.zeros(field.shape)
        for axis in (0, 1):
            flow, lines = np.diff(field, axis=axis), np.moveaxis(out, axis, 0)
            lines[:-1] += np.moveaxis(flow, axis, 0)
            lines[1:] -= np.moveaxis(flow, axis, 0)
        flat = field.reshape(number, count)
        return out + gathered(weights[:, None] * (flat[near] - flat[far] + steps))

    degree = np.full(shape, 4.0)
    for edge in (degree[0], degree[-1], degree[:, 0], degree[:, -1]):
        edge -= 1.0
    degree = np.maximum(degree, 1.0) + (np.bincount(near, weights, number) + np.bincount(far, weights, number)).reshape(
        shape
    )
    field, direction, stride = np.zeros((*shape, count)), np.zeros((*shape, count)), 0.0
    middle, half = (2.0 + _LEAST) / 2, (2.0 - _LEAST) / 2  # eigenvalues of the system over its diagonal
    for n in range(_ROUNDS):
        kept = (half * stride) ** 2 / (2 if n == 1 else 4)
        stride = 1.0 / (middle - kept / stride) if n else 1.0 / middle
        direction = excess(field) / degree[..., None] + kept * direction
        field += stride * direction
    return field
