# SPDX-License-Identifier: Apache-2.0
"""The start of a fill: thin parts of the region continue their surroundings."""

from __future__ import annotations

import numpy as np

from oiiotex.engine.core.source_map import SourceMap
from oiiotex.synthesis.fill.onion_peel import peeled
from oiiotex.synthesis.patchmatch.field import Geometry, allowed_patches
from oiiotex.synthesis.projections.histograms import OUTSIDE
from tests.any_filter import buffer, pixels
from tests.synthesis.test_fill import made


def test_a_thin_region_continues_what_is_on_each_side_of_it():
    """A cable across upright bars: from a random start, it becomes a gray that is none of theirs."""
    random = np.random.default_rng(2)
    bars = np.repeat(random.choice([0.1, 0.35, 0.8], 8), 20)
    photo = np.clip(bars[None, :, None] + random.normal(0, 0.03, (80, 160, 3)), 0, 1)
    region = (np.abs(np.arange(80) - 34) < 12)[:, None, None] & np.ones((80, 160, 1), bool)
    filled = pixels(made(region, buffer(photo), fade=0.0, lattice=0.0))[22:47, :, 0]
    assert np.abs(filled - bars).mean() < 0.04


def test_peeling_starts_with_the_patches_that_continue_the_fixed_pixels():
    columns = np.random.default_rng(1).integers(-900, 900, (1, 40, 3)).astype(np.int16)
    image = np.repeat(columns, 30, 0)
    free = np.zeros((30, 40), bool)
    free[12:19, 5:33] = True
    geometry = Geometry(width=40, height=30, exemplar_width=40, exemplar_height=30, patch=5)
    patches = allowed_patches(~free, geometry)
    stays = np.where(free[..., None], np.int16(OUTSIDE), image)
    field = SourceMap.of(*np.zeros((2, 26, 36), int))
    found = peeled(field, stays, image, patches, geometry)
    y, x = found.yx
    over = ~patches
    np.testing.assert_array_equal(x[over], np.broadcast_to(np.arange(36), over.shape)[over])
    assert patches[y, x].all() and not x[~over].any()  # other patches are left to the first guess
