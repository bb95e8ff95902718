# SPDX-License-Identifier: Apache-2.0
"""How often a tile waits for the device: every download stops a GPU until the host goes on."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex.engine.opencl.device import Device, Download
from oiiotex.synthesis.patchmatch.optimization import synthesize
from oiiotex.synthesis.patchmatch.recipe import Recipe, level_scales
from tests.pictures import pebbles

COARSE = 6  # iterations of the coarsest level


@pytest.mark.parametrize(
    ("sigma", "contrast", "a_step", "a_level"), [(4.0, 0.7, 2, 3), (4.0, 0.0, 1, 1), (None, 0.0, 0, 1)]
)
def test_a_level_waits_for_few_downloads(sigma, contrast, a_step, a_level, device, monkeypatch):
    """A step: for the histogram to match, and the one to project to. A level: for both of its goal, and its field.

    At the end, the picked pixels are downloaded. A fine level has one step, so it waits five times; our goal is two.
    """
    waits = []
    for kind, name in ((Device, "read"), (Download, "array")):
        wait = getattr(kind, name)
        monkeypatch.setattr(kind, name, lambda *given, wait=wait: waits.append(1) or wait(*given))
    recipe = Recipe(
        width=96, height=80, wrap_x=True, wrap_y=True, sigma=sigma, patch=11, iterations=COARSE, seed=1,
        uniformity=0.01, contrast=contrast, flat=True,
    )  # fmt: skip
    lab = (100 * pebbles(80, 96, 5)).astype(np.float32)
    levels = len(level_scales(recipe, lab.shape))
    synthesize(device, lab, None, recipe, 1 << 30, lambda done, total: None)
    assert levels > 2 and len(waits) == a_step * (COARSE + levels - 1) + a_level * levels + 1
