# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 of LSA16 against its own words, the Gaussian stack against scipy's blur of the whole image."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from oiiotex.analysis.superpixels.gaussian_stack import blurred_sums, taps_of
from oiiotex.analysis.superpixels.hierarchy import hierarchy, merged, scales
from tests import pictures
from tests.analysis.test_superpixels import found, grid_values, resources_of
from tests.reference import superpixels as reference

PHOTO = pictures.stained(pictures.pebbles(131, 167, seed=5))
SIGMAS = 6.0 + 3.0 * np.arange(9)


@pytest.mark.parametrize("seed", range(2))
def test_merges_are_those_of_the_algorithm(device, seed):
    made = found(device, np.random.default_rng(seed).random((41, 53, 3)) ** 2, sigma=5.0)
    levels = list(blurred_sums(made, SIGMAS.tolist(), resources_of(device)))
    mine = merged(made.sizes, made.positions, made.edges, SIGMAS, levels)
    merges, counts = reference.merged(made.sizes, made.positions, made.edges, SIGMAS, levels)
    assert mine.merges.tolist() == [list(m) for m in merges]
    assert mine.counts.tolist() == counts
    assert len(merges) > 20


def test_equal_costs_are_merged_in_the_order_of_their_ids():
    n = 36  # equal squares of equal color
    y, x = np.divmod(np.arange(n), 6)
    beside = [(i, i + 1) for i in range(n) if i % 6 < 5]
    edges = np.array(sorted(beside + [(i, i + 6) for i in range(n - 6)]))
    sizes, places = np.full(n, 16), np.stack([x, y], 1) * 4.0
    mine = merged(sizes, places, edges, np.array([4.0, 24.0]), [np.zeros((n, 3))])
    merges, _ = reference.merged(sizes, places, edges, [4.0, 24.0], [np.zeros((n, 3))])
    assert mine.merges.tolist() == [list(m) for m in merges]


def test_partitions_are_nested_connected_and_numbered_by_their_first(device):
    made = found(device, PHOTO, sigma=6.0)
    levels = hierarchy(made, resources_of(device), SIGMAS)
    assert levels.counts[0] == made.count
    assert (np.diff(levels.counts) <= 0).all()
    area, finer = made.sizes.sum(), np.arange(made.count)
    a, b = made.edges.T
    for level, count in enumerate(levels.counts.tolist()):
        part = levels.partition(level)
        assert part.dtype == np.int32
        ids, first = np.unique(part, return_index=True)
        np.testing.assert_array_equal(ids, np.arange(count))
        assert (np.diff(first) > 0).all()
        assert count <= max(int(area / SIGMAS[level] ** 2), 1) or level == 0
        assert len(np.unique(np.stack([finer, part]), axis=1).T) == finer.max() + 1  # finer ones are never divided
        within = part[a] == part[b]
        joined = coo_array((np.ones(within.sum()), (a[within], b[within])), (made.count, made.count))
        assert connected_components(joined, directed=False)[0] == count
        finer = part
    for count in (int(levels.counts[-1]), int(levels.counts[-1]) + 1, made.count):
        assert len(np.unique(levels.partition_of(count))) == count


def test_what_alpha_parts_is_never_merged(device):
    alpha = np.ones((131, 167, 1))
    alpha[:, 80:83] = 0
    made = found(device, np.concatenate([PHOTO * alpha, alpha], -1), sigma=6.0)
    levels = hierarchy(made, resources_of(device), np.array([6.0, 1000.0]))
    assert levels.counts[-1] == 2
    assert len(levels.merges) == made.count - 2


def test_the_stack_is_the_blurred_image(any_lanes):
    seen = (pictures.smooth_noise(131, 167, 30, 9) > 0.3)[..., None] * 1.0
    pixels = np.concatenate([PHOTO * seen, seen], -1)
    made = found(any_lanes, pixels, sigma=6.0)
    lab = grid_values(any_lanes, pixels).astype(float)
    inside = lab[..., 3] > 0
    flat = made.labels.pixels()[..., 0].astype(int)[inside] - 1
    resources = resources_of(any_lanes)
    for level, sums in enumerate(blurred_sums(made, SIGMAS.tolist(), resources), 1):
        sigma = 3.0 * np.sqrt(level)
        share = gaussian_filter(lab[..., 3], sigma, mode="constant")
        mean, unblurred = np.empty_like(sums), np.empty_like(sums)
        for c in range(3):
            blurred = gaussian_filter(lab[..., c] / 8, sigma, mode="constant") / np.maximum(share, 1e-9)
            mean[:, c] = np.bincount(flat, blurred[inside]) / made.sizes
            unblurred[:, c] = made.power_sums[:, c, 0] / made.sizes
        away = np.sqrt(np.mean((sums / made.sizes[:, None] - mean) ** 2))
        assert away < 0.05 * np.sqrt(np.mean((unblurred - mean) ** 2))


def test_lanes_do_not_show(device, narrow_device):
    one, other = (hierarchy(found(d, PHOTO, sigma=4.0), resources_of(d)) for d in (device, narrow_device))
    np.testing.assert_array_equal(one.merges, other.merges)
    np.testing.assert_array_equal(one.counts, other.counts)


@pytest.mark.parametrize("variance", [0.02, 0.3, 0.5, 0.9, 4.0])
def test_taps_have_the_variance_they_are_asked_for(variance):
    taps = taps_of(variance)
    assert taps.sum() == pytest.approx(1)
    away = np.arange(len(taps)) - len(taps) // 2
    assert taps @ away**2 == pytest.approx(variance, rel=0.03)


def test_scales_are_the_papers_up_to_128_levels_and_geometric_beyond():
    np.testing.assert_allclose(scales(10.0, 100.0)[:3], [10, 13, 16])
    assert scales(10.0, 100.0)[-1] == 100
    assert len(scales(38.4, 0.2 * 1920)) == 116
    large = scales(200.0, 2000.0)
    assert (len(large), large[0], large[-1]) == (128, 200, pytest.approx(2000))
    np.testing.assert_allclose(large[1:] / large[:-1], large[1] / large[0])
    np.testing.assert_array_equal(scales(4.0, 3.2), [4.0])


@pytest.mark.parametrize("shape", [(16, 16), (1, 1), (1, 300), (64, 65)])
@pytest.mark.parametrize("kind", ["constant", "noise", "nothing"])
def test_odd_pictures_have_hierarchies(device, shape, kind):
    pixels = np.random.default_rng(0).random((*shape, 4)) if kind == "noise" else np.full((*shape, 4), 0.5)
    pixels[..., 3] = kind != "nothing"
    made = found(device, pixels)
    for sigmas in (None, np.array([4.0, 8.0, 1e4])):
        levels = hierarchy(made, resources_of(device), sigmas)
        assert len(levels.counts) == len(levels.sigmas)
        for level, count in enumerate(levels.counts.tolist()):
            assert len(np.unique(levels.partition(level))) == count
    assert levels.counts[-1] == min(1, made.count)
