# SPDX-License-Identifier: Apache-2.0
"""Which projection of MJH17 section 4.3 belongs to a measure of its section 3."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..device import Buffers, Device
from .histograms import Cells, Projection


class Projecting(Protocol):
    """What brings an image nearer to looking the same everywhere."""

    channels: int

    def project(self, image: str, matched: str, strength: float = 1.0) -> None:
        """Write to buffer `matched` what lies `strength` times the way from buffer `image` to its projection."""


def projection(
    measure: str, order: int, device: Device, buffers: Buffers, cells: Cells, sigma: float, low: np.ndarray,
    high: np.ndarray, wrap_x: bool, wrap_y: bool,
) -> Projecting:  # fmt: skip
    """By local histograms, moments up to `order` or steerable responses; all else as `histograms.Projection` has it."""
    from . import moments, steerable  # when they are needed: scipy.stats takes half a second

    what = (device, buffers, cells, sigma, low, high, wrap_x, wrap_y)
    if measure == "moments":
        return moments.MomentProjection(*what, order)
    return (steerable.SteerableProjection if measure == "steerable" else Projection)(*what)


def layout(measure: str, cells: Cells, channels: int = 3) -> dict[str, int]:
    """Memory that it needs, in bytes by name."""
    from . import moments, steerable

    return {"moments": moments.layout, "steerable": steerable.layout}.get(measure, Cells.layout)(cells, channels)
