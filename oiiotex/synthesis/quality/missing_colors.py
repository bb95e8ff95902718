# SPDX-License-Identifier: Apache-2.0
"""Colors of the photo that a result has lost."""

from __future__ import annotations

from ...engine.deferred import np

_EVERY = 3  # pixels whose colors are counted
_COLORS = 20.0, 8.0, 8.0  # L, a, b: colors nearer than this are shared out among neighbors
_MOST_CELLS = 64.0  # of these, along each axis; colors beyond count as the limit
_GONE = 0.5  # share of a color's pixels: with less, the others are missing; evening out leaves more of all but few


def missing_colors(photo: np.ndarray, result: np.ndarray) -> float:
    """Share of the photo's pixels (n, 3) whose color the result hardly has, by trilinear histograms.

    A color is missing as far as it is less than half as frequent. Evening out makes colors rarer, and removes none.
    """
    photo, result = photo[::_EVERY], result[::_EVERY]
    both = np.clip(np.concatenate([photo, result]) / _COLORS, -_MOST_CELLS, _MOST_CELLS)
    cells = np.floor(both).astype(np.int64)
    part = both - cells
    cells -= cells.min(0)
    shape = tuple((cells.max(0) + 2).tolist())
    counts = np.zeros((2, np.prod(shape)))
    of_light, of_a, of_b = ((1.0 - axis, axis) for axis in part.T.copy())
    first = np.ravel_multi_index(tuple(cells.T), shape)
    for corner in np.ndindex(2, 2, 2):
        weight = of_light[corner[0]] * of_a[corner[1]] * of_b[corner[2]]
        index = first + int(np.ravel_multi_index(corner, shape))
        for n, at in enumerate((slice(0, len(photo)), slice(len(photo), None))):
            counts[n] += np.bincount(index[at], weight[at], counts.shape[1])
    shares = counts / np.array([[len(photo)], [len(result)]])
    return round(float(np.maximum(0.0, _GONE * shares[0] - shares[1]).sum()) / _GONE, 4)
