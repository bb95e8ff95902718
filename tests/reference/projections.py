# SPDX-License-Identifier: Apache-2.0
"""Projections of images that the device holds as a whole."""

from __future__ import annotations

import numpy as np

from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.engine.opencl.device import Device
from oiiotex.engine.opencl.rows import Rows
from oiiotex.synthesis.projections.projection import Projecting, projected


def projected_by(
    projection: Projecting, device: Device, buffers: Buffers, image: np.ndarray, strength: float = 1.0
) -> np.ndarray:
    """What a projection makes of an image, with buffers `image` and `matched` of its size."""
    device.write(buffers["image"], image)
    rows = Rows(device, buffers, "image", image.shape[1], image.shape[0], False, None, 0)
    assert list(projected(projection, rows, "matched", strength)) == [(0, image.shape[0], 0)]
    return device.read(buffers["matched"], image.shape, np.int16)
