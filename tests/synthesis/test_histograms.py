# SPDX-License-Identifier: Apache-2.0
"""cl/histograms.cl against tests/reference/histograms.py, and global matching against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex.analysis.stationarity.grid_statistics import CellGrid
from oiiotex.engine.core.window import Domain
from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.synthesis.projections import histograms
from tests import pictures
from tests.reference import histograms as reference
from tests.reference.projections import projected_by


def lab_like(height: int, width: int, seed: int = 0) -> np.ndarray:
    """A drifting picture on the integer grid."""
    return np.rint(800 * pictures.stained(pictures.bricks(height, width, seed))).astype(np.int16)


def projected(device, image, sigma, wrap_x, wrap_y, strength=1.0):
    height, width = image.shape[:2]
    grid = CellGrid.of(Domain(width, height, wrap_x, wrap_y), sigma)
    low, high = image.reshape(-1, 3).min(0), image.reshape(-1, 3).max(0)
    both = {"image": image.nbytes, "matched": image.nbytes}
    with Buffers(device, {**histograms.layout(grid), **both}, 1 << 30, "test") as buffers:
        projection = histograms.Projection(device, buffers, grid, low, high)
        return projected_by(projection, device, buffers, image, strength), low, high


@pytest.mark.parametrize(
    ("height", "width", "sigma", "wrap"),  # each side and each scale with each kind of border
    [(61, 47, 3.0, (True, True)), (23, 131, 8.0, (False, False)), (48, 80, 8.0, (True, True)),
     (61, 47, 3.0, (True, False))],
)  # fmt: skip
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


@pytest.mark.parametrize("alpha", [1.0, 0.5, 0.0])
def test_a_global_match_takes_over_the_targets_histogram(any_lanes, alpha):
    random = np.random.default_rng(1)
    image = random.normal(100, 20, (80, 80, 3)).round().astype(np.int16)
    target = random.gamma(2.0, 60, (90, 70, 3)).round().astype(np.int16)
    first = int(min(image.min(), target.min()))
    entries = int(max(image.max(), target.max())) - first + 1
    sizes = {"image": image.nbytes, "target": target.nbytes, "matched": image.nbytes}
    with Buffers(any_lanes, histograms.ValueCounts.layout() | sizes, 1 << 24, "test") as buffers:
        any_lanes.write(buffers["image"], image)
        any_lanes.write(buffers["target"], target)
        counts = histograms.ValueCounts(any_lanes, buffers, first, entries, 3)
        counts.add("counts", "image", (80, 80), more=False)
        counts.add("goal_counts", "target", (70, 50), more=False)
        counts.add("goal_counts", "target", (70, 40), more=True, at=50)
        counts.match(alpha)
        counts.apply("image", "matched", (80, 80))
        matched = any_lanes.read(buffers["matched"], image.shape, np.int16)
    own, goal = (reference.value_counts(i, first, entries) for i in (image, target))
    table = reference.matching_table(own, goal, first, alpha)
    exact = np.stack([table[c][image[..., c] - first] for c in range(3)], -1)
    assert np.abs(matched - exact).max() <= 0.501
    for q in (0.1, 0.5, 0.9):
        assert abs(np.quantile(matched, q) - np.quantile(target if alpha == 1 else exact, q)) <= 3


def test_devices_match_values_alike(device, narrow_device):
    """Shares are compared in integers: counts as large as an image may have, and values that do not occur."""
    random, entries = np.random.default_rng(3), histograms.MOST_VALUES - 5
    counts, goal = ((random.integers(0, 9, (3, entries)) ** 6).astype(np.uint32) for _ in range(2))
    counts[1, 40:3000] = goal[2, :17] = goal[0, -9:] = 0
    tables = []
    for one in (device, narrow_device):
        with Buffers(one, histograms.ValueCounts.layout(), 1 << 24, "test") as buffers:
            one.write(buffers["counts"], counts)
            one.write(buffers["goal_counts"], goal)
            histograms.ValueCounts(one, buffers, -900, entries, 3).match(0.7)
            tables.append(one.read(buffers["value_table"], (3, entries), np.int16))
    np.testing.assert_array_equal(*tables)
    exact, occurs = reference.matching_table(counts.astype(np.int64), goal.astype(np.int64), -900, 0.7), counts > 0
    assert np.abs(tables[0] - exact)[occurs].max() <= 0.51


def test_the_inverse_of_a_histogram_is_that_of_all_rows(any_lanes):
    """At equal shares of pixels, by linear interpolation in a bin; bins may be empty."""
    random, low, high = np.random.default_rng(5), np.array([-40, 0, 7]), np.array([900, 640, 8])
    grid = CellGrid.of(Domain(90, 70), 6.0)
    sums = (random.random((3, grid.down, histograms.BINS)) ** 9 * 500).astype(np.float32)
    sums[:, :, 20:30] = 0
    layout = histograms.layout(grid)
    with Buffers(any_lanes, layout, 1 << 24, "test") as buffers:
        projection = histograms.Projection(any_lanes, buffers, grid, low, high)
        any_lanes.write(buffers["grid_sums"], sums)
        projection.invert()
        inverse = any_lanes.read(buffers["grid_inverse"], (3, histograms.INVERSE + 1), np.float32)
    shares, bins = np.linspace(0, 1, histograms.INVERSE + 1), histograms.BINS
    for c in range(3):
        below = np.concatenate([[0.0], np.cumsum(sums[c].sum(0, np.float64))])
        place = np.interp(shares, below / below[-1], np.arange(bins + 1) - 0.5)
        step = max(1, high[c] - low[c]) / (bins - 1)
        exact = np.clip(low[c] + place * step, low[c], high[c])
        away = np.abs(inverse[c] - exact)
        assert (away > 1e-3 * step).sum() <= 2  # on both sides of empty bins
        assert (np.diff(inverse[c]) >= 0).all()


@pytest.mark.parametrize(("height", "width"), [(1, 7), (45, 300), (70, 67)])
def test_values_are_counted_on_the_device(any_lanes, height, width):
    """Less rows than parts, more columns than a work-group has items; with and without pixels that are held."""
    image = lab_like(height, width)
    first, entries = int(image.min()) - 3, int(np.ptp(image)) + 9
    held = np.full_like(image, histograms.OUTSIDE)
    held[np.indices((height, width)).sum(0) % 3 == 0] = 5
    layout = {**histograms.ValueCounts.layout(), "image": image.nbytes, "held": image.nbytes}
    with Buffers(any_lanes, layout, 1 << 24, "test") as buffers:
        any_lanes.write(buffers["image"], image)
        any_lanes.write(buffers["held"], held)
        counts = histograms.ValueCounts(any_lanes, buffers, first, entries, 3)
        free = held[..., 0] == histograms.OUTSIDE
        for marks, counted in (({}, image), ({"free": "held"}, image[free]), ({"seen": "held"}, image[~free])):
            counts.add("counts", "image", (width, height), more=False, **marks)
            found = any_lanes.read(buffers["counts"], (3, entries), np.uint32)
            np.testing.assert_array_equal(found, reference.value_counts(counted, first, entries))
