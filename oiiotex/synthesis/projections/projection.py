# SPDX-License-Identifier: Apache-2.0
"""The projection of MJH17 section 4.3 for each measure of its section 3."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from ...analysis.stationarity.grid_statistics import CellGrid
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from ...engine.opencl.rows import Rows
from . import histograms
from .histograms import Projection, RowSource


class Projecting(Protocol):
    """A projection that makes an image more stationary: it reads all of it, then processes bands of rows."""

    channels: int
    looks_beyond: bool  # a row depends on others, which must be kept until then
    held: int | None  # maximum number of rows that it can read at once, if limited

    def learning(self, image: RowSource) -> Iterator[None]:
        """Read the whole image, some of its rows per step."""

    def last_row(self, top: int) -> int:
        """End of the rows that can be matched at once from row `top`."""

    def match(self, image: RowSource, top: int, bottom: int, matched: str, strength: float) -> int:
        """Write rows to buffer `matched`, aligned with the image's buffer. Returns the row at their start."""


def projected(
    projection: Projecting, image: Rows, matched: str, strength: float = 1.0, most: int | None = None
) -> Iterator[tuple[int, int, int]]:
    """Rows (top, bottom) written to buffer `matched`, and the row at the start of its and the image's buffer.

    Parameters
    ----------
    matched : str
        Buffer of the result, `strength` times the way from the image to its projection.
    most : int or None
        Maximum number of rows at once, if the buffer does not hold all of them.
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
    """A projection by local histograms, moments up to `order` or steerable responses, as `histograms.Projection`.

    Parameters
    ----------
    measure : str
        histogram, moments or steerable.
    order : int
        Highest order of moments, 2 to 4.
    buffers : Buffers
        With at least `layout()`.
    low, high : (channels,) int
        Range of values, in grid steps.
    number : int
        Index of the projection, if several are used together.
    literal : bool
        Steerable responses: as in MJH17 section 4.3, without the departures of `steerable`.
    """
    common = (device, buffers, grid, low, high)
    if measure == "histogram":
        return Projection(*common, f"grid{number}")
    if measure == "moments":
        from .moments import MomentProjection  # only for this measure

        return MomentProjection(*common, order, f"local{number}")
    from .steerable import SteerableProjection

    return SteerableProjection(*common, f"grid{number}", literal)


def layout(
    measure: str, grid: CellGrid, channels: int, rows: int, cell_rows: int | None = None, number: int = 0
) -> dict[str, int]:
    """Memory of a projection, in bytes by name.

    Parameters
    ----------
    measure, number
        As in `projection`.
    rows : int
        Number of rows of the image that are kept.
    cell_rows : int or None
        As in `histograms.layout`.
    """
    if measure == "histogram":
        return histograms.layout(grid, channels, cell_rows, f"grid{number}")
    if measure == "moments":
        from . import moments

        return moments.layout(grid, channels, cell_rows, f"local{number}")
    from . import steerable

    return steerable.layout(grid, channels, rows, cell_rows, f"grid{number}")
