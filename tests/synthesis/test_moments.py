# SPDX-License-Identifier: Apache-2.0
"""The projection by moments (MJH17 sections 3.1 and 4.3) against its dense oracle."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex.analysis.stationarity.grid_statistics import CellGrid
from oiiotex.engine.core.window import Domain
from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.synthesis.projections import histograms, moments
from tests import pictures
from tests.reference import moments as reference
from tests.reference.projections import projected_by


def lab_like(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.rint(800 * pictures.stained(pictures.bricks(height, width, seed))).astype(np.int16)


def projected(device, image, sigma, order, wrap=(True, True), strength=1.0):
    height, width, channels = image.shape
    grid = CellGrid.of(Domain(width, height, *wrap), sigma)
    seen = image[image[..., 0] != histograms.OUTSIDE]
    low, high = seen.min(0), seen.max(0)
    both = {"image": image.nbytes, "matched": image.nbytes}
    with Buffers(device, {**moments.layout(grid, channels), **both}, 1 << 30, "test") as buffers:
        made = moments.MomentProjection(device, buffers, grid, low, high, order)
        return projected_by(made, device, buffers, image, strength)


@pytest.mark.parametrize(
    ("order", "wrap"), [(2, (False, True)), (3, (True, True)), (4, (True, True)), (4, (False, True))]
)
def test_the_projection_on_cells_is_close_to_the_dense_one(any_lanes, order, wrap):
    image = lab_like(61, 47)
    found = projected(any_lanes, image, 8.0, order, wrap)
    random = np.random.default_rng(0)
    places = list(zip(random.integers(0, 61, 60), random.integers(0, 47, 60), strict=True))
    for c in (0, 1):
        low, high = float(image[..., c].min()), float(image[..., c].max())
        exact = reference.project(image[..., c], 8.0, low, high, histograms.BINS, *wrap, order, places)
        away = (np.array([found[(*at, c)] for at in places]) - exact) / 8.0  # Lab
        # where an axis does not wrap, windows at its border end half a cell earlier than the dense ones
        assert np.sqrt((away**2).mean()) < (0.15 if all(wrap) else 0.5)
    assert np.sqrt(((found - image) ** 2.0).mean()) / 8.0 > 3.0


@pytest.mark.parametrize("order", [2, 3, 4])
def test_moments_become_the_same_everywhere(device, order):
    image = lab_like(96, 96)
    found = projected(device, image, 8.0, order)
    before, after = (reference.local_moments(i[..., 0], 8.0, True, True) for i in (image, found))
    assert after[0].std() < 0.35 * before[0].std()
    assert np.sqrt(after[1]).std() < 0.5 * np.sqrt(before[1]).std()


@pytest.mark.parametrize(("order", "most"), [(2, 0.2), (3, 0.2), (4, 1.0)])
def test_a_stationary_image_projects_to_itself(device, order, most):
    """But for what lies beyond the ends of the distribution that has its moments."""
    image = np.tile(lab_like(16, 16), (4, 4, 1))
    away = np.abs(projected(device, image, 40.0, order).astype(int) - image) / 8.0
    assert np.quantile(away, 0.9) <= 0.25 and np.sqrt((away**2).mean()) < most


@pytest.mark.parametrize("order", [2, 3, 4])
def test_variance_0_is_a_triangle_of_one_bin(device, order):
    """A constant channel stays; a flat region becomes the middle of all, and one value stays one value."""
    constant = lab_like(40, 40)
    constant[..., 1] = 17
    assert (projected(device, constant, 5.0, order)[..., 1] == 17).all()
    image = lab_like(64, 64)
    image[:, 32:] = 400
    flat = projected(device, image, 2.0, order)[:, 44:52].astype(float)
    assert (np.ptp(flat.reshape(-1, 3), axis=0) == 0).all()
    spread = image.reshape(-1, 3).std(0)
    assert (np.abs(flat[0, 0] - image.reshape(-1, 3).mean(0)) < spread).all()


def test_lanes_do_not_show(device, narrow_device):
    image = lab_like(53, 67)
    for order in (2, 4):
        np.testing.assert_array_equal(projected(device, image, 4.0, order), projected(narrow_device, image, 4.0, order))


def test_strength_goes_its_share_of_the_way(device):
    image = lab_like(40, 44)
    none, half, whole = (projected(device, image, 5.0, 4, strength=s) for s in (0.0, 0.5, 1.0))
    np.testing.assert_array_equal(none, image)
    assert np.abs(half - (image.astype(float) + whole) / 2).max() <= 1


def test_what_is_outside_is_not_seen(device):
    image = lab_like(64, 64)
    inside = np.ones((64, 64), bool)
    inside[20:50, 30:60] = False
    image[~inside] = histograms.OUTSIDE
    found = projected(device, image, 3.0, 4)  # a part of it is further from any pixel than windows reach
    assert np.isfinite(found).all()
    alone = projected(device, image, 3.0, 4)
    np.testing.assert_array_equal(found[inside], alone[inside])
    assert np.abs(found[inside].mean(0) - image[inside].mean(0)).max() < 40


def test_maps_of_a_material_are_projected_apart(device):
    image = lab_like(40, 45)
    more = np.concatenate([image, lab_like(40, 45, 3)[..., :2]], -1)
    np.testing.assert_array_equal(projected(device, more, 6.0, 3)[..., :3], projected(device, image, 6.0, 3))
