# SPDX-License-Identifier: Apache-2.0
"""cl/histograms.cl against tests/reference/histograms.py, and global matching against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex.device import Buffers
from oiiotex.synthesis import histograms
from tests import pictures
from tests.reference import histograms as reference


def lab_like(height: int, width: int, seed: int = 0) -> np.ndarray:
    """A drifting picture on the integer grid."""
    return np.rint(800 * pictures.stained(pictures.bricks(height, width, seed))).astype(np.int16)


def projected(device, image, sigma, wrap_x, wrap_y, strength=1.0):
    height, width = image.shape[:2]
    cells = histograms.Cells.of(width, height, sigma)
    low, high = image.reshape(-1, 3).min(0), image.reshape(-1, 3).max(0)
    with Buffers(device, {**cells.layout(), "image": image.nbytes}, 1 << 30, "test") as buffers:
        device.write(buffers["image"], image)
        projection = histograms.Projection(device, buffers, cells, sigma, low, high, wrap_x, wrap_y)
        projection.project("image", "matched", strength)
        return device.read(buffers["matched"], image.shape, np.int16), low, high


@pytest.mark.parametrize(("height", "width"), [(61, 47), (48, 80), (23, 131)])
@pytest.mark.parametrize("sigma", [3.0, 8.0])
@pytest.mark.parametrize("wrap", [(True, True), (False, False), (True, False)])
def test_the_projection_on_cells_is_close_to_the_dense_one(any_lanes, height, width, sigma, wrap):
    image = lab_like(height, width)
    found, low, high = projected(any_lanes, image, sigma, *wrap)
    exact = reference.project(image, sigma, low, high, histograms.BINS, *wrap)
    # in Lab units (8 steps each): the cells' interpolation and the grid's rounding
    away = np.abs(found - exact) / 8.0
    # where an axis does not wrap, windows at its border end half a cell earlier than the dense ones
    assert np.sqrt((away**2).mean()) < (0.3 if all(wrap) else 0.5)
    assert np.quantile(away, 0.99) < (1.0 if all(wrap) else 2.5)
    # the projection itself is far larger than what the cells get wrong
    assert np.sqrt(((found - image) ** 2.0).mean()) / 8.0 > 3.0


def test_projection_makes_an_image_stationary(device):
    image = lab_like(96, 96)
    found, _, _ = projected(device, image, 6.0, True, True)
    drift = [
        np.std(reference.gaussian_rows(96, 6.0, True) @ i[..., 0] @ reference.gaussian_rows(96, 6.0, True).T)
        for i in (image, found)
    ]
    assert drift[1] < 0.35 * drift[0]
    assert abs(np.mean(found) - np.mean(image)) < 0.03 * np.std(image)


def test_a_stationary_image_projects_to_itself(device):
    image = np.tile(lab_like(16, 16), (4, 4, 1))
    found, _, _ = projected(device, image, 40.0, True, True)
    assert np.abs(found.astype(int) - image).max() <= 8  # one Lab unit; a bin is 2.5


def test_a_constant_channel_stays(device):
    image = lab_like(40, 40)
    image[..., 1] = 17
    found, _, _ = projected(device, image, 5.0, True, True)
    assert (found[..., 1] == 17).all()


def test_strength_goes_its_share_of_the_way_and_no_further_than_the_range(device):
    image = lab_like(40, 44)
    none, low, high = projected(device, image, 5.0, True, True, 0.0)
    half, _, _ = projected(device, image, 5.0, True, True, 0.5)
    whole, _, _ = projected(device, image, 5.0, True, True, 1.0)
    far, _, _ = projected(device, image, 5.0, True, True, 9.0)
    np.testing.assert_array_equal(none, image)
    assert np.abs(half - (image.astype(float) + whole) / 2).max() <= 1
    assert (far >= low).all() and (far <= high).all()


def test_lanes_do_not_show_in_the_projection(device, narrow_device):
    image = lab_like(53, 67)
    wide, _, _ = projected(device, image, 4.0, True, True)
    single, _, _ = projected(narrow_device, image, 4.0, True, True)
    np.testing.assert_array_equal(wide, single)


def test_a_global_match_takes_over_the_targets_histogram():
    random = np.random.default_rng(1)
    image = random.normal(100, 20, (80, 80, 3)).round().astype(np.int16)
    target = random.gamma(2.0, 60, (90, 70, 3)).round().astype(np.int16)
    first = int(min(image.min(), target.min()))
    entries = int(max(image.max(), target.max())) - first + 1
    counts, goal = (histograms.value_counts(i, first, entries) for i in (image, target))
    assert counts.sum() == image.size and counts[0, 100 - first] == (image[..., 0] == 100).sum()
    table = histograms.matching_table(counts, goal, first, 1.0)
    matched = np.stack([table[c][image[..., c] - first] for c in range(3)], -1)
    for q in (0.1, 0.5, 0.9):
        assert abs(np.quantile(matched, q) - np.quantile(target, q)) <= 3
    assert (np.diff(table.astype(int), axis=1) >= 0).all()
    identity = histograms.matching_table(counts, goal, first, 0.0)
    np.testing.assert_array_equal(identity[0], first + np.arange(entries))
    np.testing.assert_allclose(
        histograms.matching_table(counts, goal, first, 0.5), (table + identity.astype(float)) / 2, atol=0.51
    )


def test_a_table_is_applied_per_channel(any_lanes):
    image = lab_like(9, 13)
    first, entries = int(image.min()), int(image.max()) - int(image.min()) + 1
    table = np.random.default_rng(0).integers(-500, 500, (3, entries)).astype(np.int16)
    with Buffers(any_lanes, {"image": image.nbytes}, 1 << 20, "test") as buffers:
        any_lanes.write(buffers["image"], image)
        histograms.apply_table(any_lanes, buffers, "image", 9 * 13, table, first)
        found = any_lanes.read(buffers["image"], image.shape, np.int16)
    np.testing.assert_array_equal(found, np.stack([table[c][image[..., c] - first] for c in range(3)], -1))
