# SPDX-License-Identifier: Apache-2.0
"""Heights from slopes, for images of any size.

The surface whose slopes are closest to the given ones solves Poisson's equation with free borders, which the cosine
transform makes diagonal (Simchony, Chellappa and Shao, Direct analytical methods for solving Poisson equations in
computer vision problems, PAMI 12(5), 1990). The transform is separable: one pass over rows, one over columns, one
over rows, each of which holds a few of them.
"""

from __future__ import annotations

from collections.abc import Iterator

from ...engine.core.demand import BAND_BYTES, SomeRows
from ...engine.core.scratch import RowStore
from ...engine.deferred import np

_GAP_ROUNDS = 8  # after which slopes in gaps are nearly those of the surface around them


def integrate(slopes: SomeRows, heights: np.ndarray | RowStore) -> None:
    """Fill `heights`, px, of mean 0 at the given slopes.

    Slopes in gaps are replaced by those of the surface itself, until they agree: there, nothing is asked of it.

    Parameters
    ----------
    slopes : (height, width, 2) float32
        Right and down; NaN in gaps.
    heights : (height, width) float32
    """
    lean, gaps = _means(slopes)
    for number in range(1 + _GAP_ROUNDS * gaps):
        _transform_rows(slopes, lean, heights, filled=number > 0)
        _solve_columns(heights)
        _restore_rows(heights)
    _center(slopes, heights)


def row_slices(shape: tuple[int, ...]) -> Iterator[slice]:
    """Slices of rows of a few megabytes as float64."""
    step = max(1, BAND_BYTES // (8 * shape[1]))
    return (slice(top, min(top + step, shape[0])) for top in range(0, shape[0], step))


def _means(slopes: SomeRows) -> tuple[np.ndarray, bool]:
    """The mean slope outside of gaps, (2,) float64, and whether there are gaps."""
    total, count = np.zeros(2), 0
    for rows in row_slices(slopes.shape):
        band = slopes[rows].astype(np.float64)
        seen = np.isfinite(band[..., 0])
        total += np.where(seen[..., None], band, 0).sum((0, 1))
        count += int(seen.sum())
    return total / max(count, 1), count < slopes.shape[0] * slopes.shape[1]


def _transform_rows(slopes: SomeRows, lean: np.ndarray, heights: np.ndarray | RowStore, filled: bool) -> None:
    """Replace heights by the transformed rows of the divergence of the slopes; `filled`: gaps have their slopes."""
    from scipy.fft import dct  # slow to import

    high, wide = slopes.shape[:2]
    rise_before, row_before = np.zeros((1, wide)), np.zeros((0, wide))  # of the band above, which is overwritten
    for rows in row_slices(slopes.shape):
        count, first, after = rows.stop - rows.start, len(row_before), min(rows.stop + 1, high)
        band = slopes[rows.start - first : after].astype(np.float64) - lean
        own = heights[rows.start : after].astype(np.float64) if filled else np.zeros((after - rows.start, wide))
        own = np.concatenate([row_before, own])
        right, down = band[..., 0], band[..., 1]
        across, rise = (right[:, 1:] + right[:, :-1]) / 2, (down[1:] + down[:-1]) / 2
        across = np.where(np.isnan(across), np.diff(own, axis=1), across)[first : first + count]
        rise = np.where(np.isnan(rise), np.diff(own, axis=0), rise)[first:]
        rise = np.concatenate([rise, np.zeros((count - len(rise), wide))])  # nothing below the last row
        divergence = np.diff(across, axis=1, prepend=0, append=0) + np.diff(rise, axis=0, prepend=rise_before)
        rise_before, row_before = rise[-1:], own[first + count - 1 : first + count]
        heights[rows] = dct(divergence, axis=1, norm="ortho").astype(np.float32)


def _solve_columns(heights: np.ndarray | RowStore) -> None:
    """Divide the transform by the eigenvalues of the Laplacian, a block of columns at a time."""
    from scipy.fft import dct, idct

    high, wide = heights.shape
    step = max(1, BAND_BYTES // (8 * high))
    down = 2 * np.cos(np.pi * np.arange(high) / high)[:, None] - 2
    for left in range(0, wide, step):
        columns = np.arange(left, min(left + step, wide))
        block = _crossing(heights, columns).astype(np.float64)
        eigenvalues = down + (2 * np.cos(np.pi * columns / wide) - 2)
        if left == 0:
            eigenvalues[0, 0] = 1.0
        spectrum = dct(block, axis=0, norm="ortho") / eigenvalues
        if left == 0:
            spectrum[0, 0] = 0.0
        _set_crossing(heights, columns, idct(spectrum, axis=0, norm="ortho").astype(np.float32))


def _restore_rows(heights: np.ndarray | RowStore) -> None:
    from scipy.fft import idct

    for rows in row_slices(heights.shape):
        heights[rows] = idct(heights[rows].astype(np.float64), axis=1, norm="ortho").astype(np.float32)


def _center(slopes: SomeRows, heights: np.ndarray | RowStore) -> None:
    """Subtract the mean of heights outside of gaps."""
    total, count = 0.0, 0
    for rows in row_slices(heights.shape):
        seen = np.isfinite(slopes[rows][..., 0])
        total += float(np.where(seen, heights[rows], 0).sum(dtype=np.float64))
        count += int(seen.sum())
    for rows in row_slices(heights.shape):
        heights[rows] = heights[rows] - np.float32(total / max(count, 1))


def _crossing(heights: np.ndarray | RowStore, columns: np.ndarray) -> np.ndarray:
    if isinstance(heights, RowStore):
        return heights.crossing(np.arange(len(heights)), columns)
    return heights[:, columns[0] : columns[-1] + 1]


def _set_crossing(heights: np.ndarray | RowStore, columns: np.ndarray, values: np.ndarray) -> None:
    if isinstance(heights, RowStore):
        heights.set_crossing(np.arange(len(heights)), columns, values)
    else:
        heights[:, columns[0] : columns[-1] + 1] = values
