# SPDX-License-Identifier: Apache-2.0
"""Lab of an image on an integer grid, kept where kernels can look at it again and again.

An image that fits lies on the device; a larger one goes through a temporary file and passes the device band by band.
"""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from ..color import BrokenValues
from ..device import Buffers
from ..errors import ImageError
from ..images import Image
from ..session import Session
from ..tiles import BAND_BYTES, bands, stream
from ..windows import Window
from ..working import Lens

STEPS = 8  # integer steps per Lab unit
PIXEL_BYTES = 8  # L, a, b and whether the pixel is opaque, 16 bits each
_LOW = np.array([-16.0, -150.0, -150.0, 0.0], np.float32)
_HIGH = np.array([284.0, 150.0, 150.0, 1.0], np.float32)
_PIECE_PIXELS = 1 << 16
_PADDING = 128  # bytes past the end that wide registers may read: 16 pixels
_HOST_BYTES = (
    512 << 20
)  # where the device is the CPU, more than that goes to a file: the system's cache holds it as well


def to_grid(values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
    """Lab (h, w, 4) float32, which is used up -> (h, w, 4) int16: L, a, b in steps; 1 where opaque, else all 0."""
    np.clip(values, _LOW, _HIGH, out=values)
    values *= np.float32(STEPS)
    np.rint(values, out=values)
    values[..., 3] = 1
    if opaque is not None:
        values *= opaque[..., None]
    return values.astype(np.int16)


@dataclass(frozen=True)
class Band:
    """Full rows of the image as they lie on the device: rows `top` to `bottom`, counted from the data window's."""

    top: int
    bottom: int
    lab: object  # a device buffer of (rows, width, 4) int16


class LabGrid:
    """The image's first part as kernels see it; a context that gives back what it holds.

    Parameters
    ----------
    image, lens, session
    align : int
        Bands of an image that does not fit begin at multiples of so many rows.

    Raises
    ------
    BrokenValues
        NaN or Inf: all are counted.
    DeviceError, ImageError
        No room on the device or the disk.
    """

    def __init__(self, image: Image, lens: Lens, session: Session, align: int = 1):
        part = image.first
        self.window, self._session, self._device = part.window, session, session.device
        self.width, self.height = part.window.width, part.window.height
        self._row = PIXEL_BYTES * self.width
        limit = session.budget // 4
        if self._device.info.kind == "cpu":
            limit = min(limit, _HOST_BYTES)
        self.resident = self._row * self.height <= limit
        rows = self.height if self.resident else max(1, 2 * BAND_BYTES // self._row // align) * align
        self.band_rows = min(rows, self.height)
        with ExitStack() as held:
            size = self.band_rows * self._row + _PADDING
            what = f"{part.spec.width}x{part.spec.height} in Lab"
            self._buffers = held.enter_context(Buffers(self._device, {"lab": size}, session.budget, what))
            self._file = None
            if not self.resident:
                try:
                    self._file = held.enter_context(tempfile.TemporaryFile(prefix="oiiotex-"))
                except OSError as error:
                    raise ImageError(f"no folder for intermediate results (set TMPDIR): {error}") from error
            self._fill(image, lens)
            self._held = held.pop_all()

    def __enter__(self) -> LabGrid:
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()

    def bands(self, wanted: Callable[[int, int], bool] = lambda top, bottom: True) -> Iterator[Band]:
        """Bands from top to bottom, those of which `wanted(top, bottom)` says so."""
        for top in range(0, self.height, self.band_rows):
            bottom = min(top + self.band_rows, self.height)
            if not wanted(top, bottom):
                continue
            if self._file is not None:
                rows = np.empty((bottom - top, self.width, 4), np.int16)
                self._file.seek(top * self._row)
                self._file.readinto(rows)
                self._device.write(self._buffers["lab"], rows)
            yield Band(top, bottom, self._buffers["lab"])

    def _fill(self, image: Image, lens: Lens) -> None:
        """Look at the image once, on all threads."""
        part, broken = image.first, None

        def seen(rows: np.ndarray) -> np.ndarray | BrokenValues:
            try:
                return to_grid(*lens.values(rows))
            except BrokenValues as error:
                return error

        for band, pixels in stream(part, bands(part, BAND_BYTES)):
            pieces = list(band.cells(band.width, max(1, _PIECE_PIXELS // band.width)))
            made = self._session.spread(seen, [pixels[piece.inside(band)] for piece in pieces])
            for piece, found in zip(pieces, made, strict=True):
                if isinstance(found, BrokenValues):
                    broken = found.counts if broken is None else broken + found.counts
                else:
                    self._keep(piece, found)
        if broken is not None:
            raise BrokenValues(lens.name, broken)

    def _keep(self, piece: Window, rows: np.ndarray) -> None:
        at = (piece.top - self.window.top) * self._row
        if self._file is None:
            self._device.write(self._buffers["lab"], rows, at)
            return
        try:
            if os.pwrite(self._file.fileno(), rows, at) < rows.nbytes:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # a full disk takes a part in silence
        except OSError as error:
            folder = tempfile.gettempdir()
            raise ImageError(f"no room for intermediate results in {folder} (set TMPDIR): {error}") from error
