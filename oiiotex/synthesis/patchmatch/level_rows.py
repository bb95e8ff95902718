# SPDX-License-Identifier: Apache-2.0
"""The planes of a level: they are in the device's buffers, or pass through them in bands.

All passes are Jacobi and all decisions are made on integers, so results are bit-identical for any band height.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

from ...analysis.stationarity.steerable import RADIUS
from ...engine.core.scratch import RowStore, empty_rows
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from ...engine.opencl.rows import Rows
from .field import Geometry

JUMPS = (4, 2, 1)  # jump distances of propagation, px


def halo(patch: int) -> int:
    """Rows that buffers hold in addition to those of a band, for what passes read above and below."""
    return max(2 * sum(JUMPS) + patch - 1, 4 * RADIUS)  # twice the radius of steerable filters: analysis and synthesis


class LevelRows:
    """The planes of one level.

    `memory`: bytes of host memory for planes that the buffers do not hold. The rest is in a file.
    """

    def __init__(self, device: Device, buffers: Buffers, geometry: Geometry, memory: int = 0):
        g = geometry
        self._device, self._buffers, self._geometry, self._memory = device, buffers, g, memory
        padded = buffers["target"].size // (2 * g.channels * g.padded_width)
        held = min(buffers["field"].size // (4 * g.width), padded)
        self.whole = held >= g.height and padded >= g.height + g.patch - 1
        self.most = g.height if self.whole else held - halo(g.patch)
        self._rows: dict[str, Rows] = {}
        self.field = self.plane("field", (g.rows, g.columns), np.uint32)
        self.next_field = None if self.whole else self.store((g.rows, g.columns), np.uint32)
        self.image = self.plane("image", (g.height, g.width, g.channels), np.int16)

    @property
    def field_store(self) -> np.ndarray | RowStore | None:
        """Where the field is stored if its buffer does not hold it."""
        return cast("np.ndarray | RowStore | None", self.field.store)

    def store(self, shape: tuple[int, ...], dtype: type) -> np.ndarray | RowStore:
        """Allocate rows on the host."""
        size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
        fits = size <= self._memory
        self._memory -= size if fits else 0
        return empty_rows(shape, dtype, fits)

    def plane(self, name: str, shape: tuple[int, ...], dtype: type, values: np.ndarray | None = None) -> Rows:
        """Rows that pass through the buffer of that name, initialized with `values`."""
        g = self._geometry
        store = None if self.whole else self.store(shape, dtype) if values is None else values
        if self.whole and values is not None:
            self._device.write(self._buffers[name], values.astype(dtype, copy=False))
        most = shape[0] if self.whole else self.most + halo(g.patch)
        self._rows[name] = Rows(self._device, self._buffers, name, shape[1], shape[0], g.wrap_y, store, most)
        return self._rows[name]

    def bands(self) -> Iterator[tuple[int, int]]:
        """Bands of the image: (first, last) rows."""
        return self.image.bands(most=self.most)

    def field_bands(self) -> Iterator[tuple[int, int]]:
        """Bands of the field: (first, last) rows."""
        return self.field.bands(most=self.most)

    def load(self, name: str, first: int, last: int) -> int:
        """`Rows.load` of the plane of that name."""
        return 0 if self.whole else self._rows[name].load(first, last)
