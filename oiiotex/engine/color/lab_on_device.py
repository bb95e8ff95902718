# SPDX-License-Identifier: Apache-2.0
"""Lab of an image on an integer grid, kept for repeated reading by kernels.

An image that fits the device's memory is held there; a larger one is kept in a temporary file on the host and sent to
the device band by band.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass

from ..core.demand import BAND_BYTES
from ..core.image import Image
from ..core.scratch import RowStore
from ..core.window import Window
from ..deferred import np
from ..opencl.buffers import Buffers
from ..scan import scan
from ..session.resources import Resources
from .lab_grid import seen_on_grid
from .lens import Lens

PIXEL_BYTES = 8  # L, a, b and whether the pixel is opaque, 16 bits each
_PADDING = 128  # bytes past the end that wide registers may read: 16 pixels
# on devices that use the host's memory, larger images go to a file, which the system's cache holds as well
_HOST_BYTES = 512 << 20
_SHARE = 4  # a resident image takes at most 1 / _SHARE of the budget and leaves the rest to results


@dataclass(frozen=True)
class Band:
    """Full rows of the image on the device: rows `top` to `bottom`, counted from the top of the data window."""

    top: int
    bottom: int
    lab: object  # a device buffer of (rows, width, 4) int16


def most_on_device(resources: Resources) -> int:
    """Bytes of an image that may be on the device at a time."""
    device = resources.device
    return max(0, min(device.memory_budget(resources.budget) // _SHARE, device.largest - _PADDING))


class LabGrid:
    """The image's first part as kernels read it; a context manager that releases its memory.

    Parameters
    ----------
    image, lens
    align : int
        Bands of an image that does not fit begin at multiples of this number of rows.
    most : int, optional
        Bytes of the image that may be on the device at a time. Default: `most_on_device`.
    look : callable, optional
        Called with every band, from top to bottom, while the image is read: saves a second pass.

    Raises
    ------
    BrokenValues
        NaN or Inf; all are counted.
    DeviceError, ImageError
        Not enough memory on the device, or space on the disk.
    """

    def __init__(
        self, image: Image, lens: Lens, resources: Resources, align: int = 1, most: int | None = None,
        look: Callable[[Band], object] | None = None,
    ):  # fmt: skip
        part, self._look = image.first, look
        self.window, self._device = part.window, resources.device
        self.width, self.height = part.window.width, part.window.height
        self._row = PIXEL_BYTES * self.width
        most = most_on_device(resources) if most is None else most
        self.resident = self._row * self.height <= (most if self._device.own_memory else min(most, _HOST_BYTES))
        rows = self.height if self.resident else max(1, min(2 * BAND_BYTES, most) // self._row // align) * align
        self.band_rows = min(rows, self.height)
        with ExitStack() as opened:
            size = self.band_rows * self._row + _PADDING
            asker = f"{part.spec.width}x{part.spec.height} in Lab"
            self._buffers = opened.enter_context(Buffers(self._device, {"lab": size}, resources.budget, asker))
            self._rows = None if self.resident else RowStore((self.height, self.width, 4), np.int16)
            scan(part, lens, resources, lambda values, opaque, _: seen_on_grid(values, opaque), self._keep)
            self._opened = opened.pop_all()

    def __enter__(self) -> LabGrid:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()
        self._rows = None  # and its file

    def bands(self, wanted: Callable[[int, int], bool] = lambda top, bottom: True) -> Iterator[Band]:
        """Bands from top to bottom for which `wanted(top, bottom)` is true."""
        for top in range(0, self.height, self.band_rows):
            bottom = min(top + self.band_rows, self.height)
            if not wanted(top, bottom):
                continue
            if self._rows is not None:
                self._device.write(self._buffers["lab"], self._rows[top:bottom])
            yield Band(top, bottom, self._buffers["lab"])

    def _keep(self, piece: Window, rows: np.ndarray) -> None:
        top, lab = piece.top - self.window.top, self._buffers["lab"]
        if self._rows is not None:
            self._rows[top : top + len(rows)] = rows
            if self._look is None:
                return
        while len(rows):
            first = top // self.band_rows * self.band_rows
            end = min(first + self.band_rows, self.height)
            here, rows = rows[: end - top], rows[end - top :]
            self._device.write(lab, here, (top - first) * self._row)
            top += len(here)
            if top == end and self._look is not None:
                self._look(Band(first, end, lab))
