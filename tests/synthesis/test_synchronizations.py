# SPDX-License-Identifier: Apache-2.0
"""How often a tile waits for the device: meanwhile a GPU has nothing to do."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex.engine.opencl.device import Device, Download, Program
from oiiotex.synthesis.patchmatch.optimization import synthesize
from oiiotex.synthesis.patchmatch.recipe import Recipe, level_scales
from tests.pictures import pebbles

COARSE = 6  # iterations of the coarsest level


@pytest.fixture
def waits(monkeypatch):
    """A list with an entry for each download, each wait for the queue, and each upload behind kernels in the queue."""
    waits, queued = [], []

    def replace(kind, name, note):
        call = getattr(kind, name)
        monkeypatch.setattr(kind, name, lambda *given, **more: note() or call(*given, **more))

    def wait():
        waits.append(1)
        queued.clear()

    for kind, name in ((Device, "read"), (Device, "finish"), (Download, "array")):
        replace(kind, name, wait)
    replace(Device, "write", lambda: wait() if queued else None)
    replace(Program, "__call__", lambda: queued.append(1))
    return waits


@pytest.mark.parametrize(("sigma", "contrast"), [(4.0, 0.7), (4.0, 0.0), (None, 0.7), (None, 0.0)])
@pytest.mark.parametrize("complete", [False, True])
def test_a_level_waits_once(sigma, contrast, complete, device, waits):
    """For its field, from which the next level starts. At the end, the picked pixels are downloaded."""
    recipe = Recipe(
        width=96, height=80, wrap_x=True, wrap_y=True, sigma=sigma, patch=11, iterations=COARSE, seed=1,
        uniformity=0.01, contrast=contrast, flat=True, complete=complete,
    )  # fmt: skip
    lab = (100 * pebbles(80, 96, 5)).astype(np.float32)
    levels = len(level_scales(recipe, lab.shape))
    synthesize(device, lab, None, recipe, 1 << 30, lambda done, total: None)
    assert levels > 2 and len(waits) == levels + 1
