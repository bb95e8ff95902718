# SPDX-License-Identifier: Apache-2.0
"""Which projection of MJH17 section 4.3 belongs to a measure of its section 3."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from ..deferred import np
from ..opencl.buffers import Buffers
from ..opencl.device import Device
from ..opencl.rows import Rows
from ..stationarity.grid_statistics import CellGrid
from . import histograms
from .histograms import Projection, RowSource


class Projecting(Protocol):
    """What brings an image nearer to looking the same everywhere: it looks at all of it, then makes bands of rows."""

    channels: int
    looks_beyond: bool  # what is made of a row hangs on others, which must stay till then
    held: int | None  # rows that it can look at at once, where its own memory limits them

    def learning(self, image: RowSource) -> Iterator[None]:
        """Look at all of an image, at every step at some of its rows."""

    def last_row(self, top: int) -> int:
        """Up to which row it can be matched at once from row `top` on."""

    def match(self, image: RowSource, top: int, bottom: int, matched: str, strength: float) -> int:
        """Write rows to buffer `matched`, which holds the rows that the image's buffer then holds, from which on is
        returned.
        """


def projected(
    projection: Projecting, image: Rows, matched: str, strength: float = 1.0, most: int | None = None
) -> Iterator[tuple[int, int, int]]:
    """Rows (top, bottom) that are made in buffer `matched`, and which row lies at its start and at the image's.

    Parameters
    ----------
    matched : str
        What lies `strength` times the way from the image to its projection.
    most : int or None
        Rows at once, where the buffer does not hold all of them.
    """
    for _ in projection.learning(image):
        pass
    for begin, end in image.bands(most=most):
        top = begin
        while top < end:
            bottom = min(end, projection.last_row(top))
            first = projection.match(image, top, bottom, matched, strength)
            if image.store is not None:
                yield top, bottom, first
            top = bottom
        if image.store is None:
            yield begin, end, 0


def projection(
    measure: str, order: int, device: Device, buffers: Buffers, grid: CellGrid, low: np.ndarray, high: np.ndarray,
    number: int = 0, literal: bool = False,
) -> Projecting:  # fmt: skip
    """By local histograms, moments up to `order` or steerable responses; all else as `histograms.Projection` has it.

    Parameters
    ----------
    measure : str
        histogram, moments or steerable.
    order : int
        Of moments, 2 to 4.
    buffers : Buffers
        At least `layout()`.
    low, high : (channels,) int
        Range of values, in grid steps.
    number : int
        Of a projection that is used beside others.
    literal : bool
        Of steerable responses: MJH17 section 4.3 by the letter, without the departures of `steerable`.
    """
    common = (device, buffers, grid, low, high)
    if measure == "histogram":
        return Projection(*common, f"grid{number}")
    if measure == "moments":
        from .moments import MomentProjection  # what the measure needs, and when it is needed

        return MomentProjection(*common, order, f"local{number}")
    from .steerable import SteerableProjection

    return SteerableProjection(*common, f"grid{number}", literal)


def layout(
    measure: str, grid: CellGrid, channels: int, rows: int, cell_rows: int | None = None, number: int = 0
) -> dict[str, int]:
    """Memory that it needs, in bytes by name.

    Parameters
    ----------
    measure, number
        As of `projection`.
    rows : int
        Of the image, that are held.
    cell_rows : int or None
        As of `histograms.layout`.
    """
    if measure == "histogram":
        return histograms.layout(grid, channels, cell_rows, f"grid{number}")
    if measure == "moments":
        from . import moments

        return moments.layout(grid, channels, cell_rows, f"local{number}")
    from . import steerable

    return steerable.layout(grid, channels, rows, cell_rows, f"grid{number}")
