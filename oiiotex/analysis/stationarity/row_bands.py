# SPDX-License-Identifier: Apache-2.0
"""Bands of image rows whose height does not depend on the memory budget, so that sums are bit-identical."""

from __future__ import annotations

from collections.abc import Iterator

from ...engine.core.demand import MadeRows, SomeRows
from ...engine.deferred import np

PIXELS = 1 << 17  # of a band


def row_bands(rows: SomeRows, pixels: int = PIXELS) -> Iterator[slice]:
    """Rows of an image from top to bottom in bands of at most `pixels` pixels, at least one row each."""
    step = max(1, pixels // rows.shape[1])
    return (slice(top, min(top + step, len(rows))) for top in range(0, len(rows), step))


def rows_around(rows: SomeRows, band: slice, halo: int, wraps: bool) -> np.ndarray:
    """A band with `halo` rows above and below. Beyond the border of an image that does not wrap it is mirrored."""
    at = np.pad(np.arange(len(rows)), halo, mode="wrap" if wraps else "reflect")[band.start : band.stop + 2 * halo]
    runs = np.split(at, np.flatnonzero(np.diff(at) != 1) + 1)
    return np.concatenate([rows[int(run[0]) : int(run[-1]) + 1] for run in runs])


def channel(rows: SomeRows, number: int) -> SomeRows:
    """One channel of an image, (height, width)."""
    return MadeRows(rows.shape[:2], rows.dtype, lambda first, last: rows[first:last][..., number])
