# SPDX-License-Identifier: Apache-2.0
"""The dominant texture, stage by stage against its equations."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex.analysis.dominant import diffusion, patch_manifold
from oiiotex.analysis.dominant.refinement import pixel_colors, refined_mask
from oiiotex.engine.color.lab_reduced import LabPixels
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import Progress
from tests.reference import diffusion as reference


def pixels_of(lab: np.ndarray, seen: np.ndarray | None = None) -> LabPixels:
    seen = np.ones(lab.shape[:2], bool) if seen is None else seen
    return LabPixels(lab.astype(np.float32), seen, 1, None, lab.shape[1], lab.shape[0])


def some_lab(seed: int = 0, height: int = 17, width: int = 14) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.rint(random.normal(50, 20, (height, width, 3)) * 8) / 8


@pytest.mark.parametrize("period", [7, 9, 11, 15, 21])
@pytest.mark.parametrize("angle", [0, 45, 90, 135])
def test_the_patch_is_the_period_of_a_grating(period, angle):
    y, x = np.mgrid[0:190, 0:200]
    along = x * np.cos(np.radians(angle)) + y * np.sin(np.radians(angle))
    light = 50 + 20 * (along % period < period / 2) + np.random.default_rng(0).normal(0, 2, (190, 200))
    assert abs(patch_manifold.patch_size(light.astype(np.float32)) - period) <= 2


def test_patches_of_small_and_plain_images_have_the_least_size():
    assert patch_manifold.patch_size(np.zeros((200, 200), np.float32)) == patch_manifold.LEAST_PATCH
    assert [patch_manifold.patch_size(np.zeros((n, 40), np.float32)) for n in (1, 2, 3, 4, 5)] == [1, 1, 3, 3, 5]


def test_texels_keep_the_distances_of_patches():
    lab = some_lab()
    found = patch_manifold.texels_of(pixels_of(lab), 5, 1, Session().resources)
    vectors = reference.patches(lab, 5)
    assert found.count == len(vectors) == 13 * 10
    expected = ((vectors[:, None] - vectors) ** 2).sum(-1)
    got = patch_manifold.squared_distances(found.values, found.values)
    assert np.abs(got - expected).max() < 0.02 * expected.max()  # 99.9 % of the energy
    np.testing.assert_array_equal(lab[found.rows, found.columns], lab[2:15, 2:12].reshape(-1, 3))


def test_texels_are_whole_patches_of_opaque_pixels_on_a_grid():
    seen = np.ones((17, 14), bool)
    seen[4, 6] = False
    found = patch_manifold.texels_of(pixels_of(some_lab(), seen), 3, 2, Session().resources)
    places = {(y, x) for y in range(1, 16, 2) for x in range(1, 13, 2) if not (abs(y - 4) <= 1 and abs(x - 6) <= 1)}
    assert set(zip(found.rows.tolist(), found.columns.tolist(), strict=True)) == places


def test_densities_and_heat_are_eq_4_and_eq_3():
    found = patch_manifold.texels_of(pixels_of(some_lab(1)), 3, 1, Session().resources)
    points, size = found.values.astype(np.float64), 900.0
    kernel = reference.weights(points, size)
    chosen = np.arange(0, found.count, 3)
    np.testing.assert_allclose(
        patch_manifold.densities(found, chosen, size, False, Session().resources), kernel[:, chosen].sum(1), rtol=1e-3
    )
    near = patch_manifold.neighbor_weights(
        patch_manifold.neighbor_squares(found, Session().resources, Progress()), size, False
    )
    k = patch_manifold.neighbor_count(found.count)
    order = np.argsort(-kernel, axis=1)[:, :k]
    sparse = np.zeros_like(kernel)
    np.put_along_axis(sparse, order, np.take_along_axis(kernel, order, 1), 1)
    sparse = np.maximum(sparse, sparse.T)
    np.testing.assert_allclose(near.toarray(), sparse, rtol=2e-3, atol=1e-6)
    matrix = (diffusion.diags_array(1 / near.sum(1)) @ near.astype(np.float64)).tocsr()
    np.testing.assert_allclose(diffusion.heat_from(matrix, 7, 9), reference.heat(sparse, 7, 9), rtol=0.02, atol=1e-9)


def test_eq_7_is_the_inverse_distance():
    squares = np.array([[4.0, 0.25]], np.float32)
    np.testing.assert_allclose(patch_manifold.weights_of(squares, 1.0, True), [[0.5, 2.0]])
    np.testing.assert_allclose(patch_manifold.weights_of(squares, 2.0, False), np.exp(-squares / 4))


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_the_slope_says_the_dimension(dimension):
    """Eq. 2 on points of a known manifold: half the dimension is the slope, a little less at its borders."""
    random = np.random.default_rng(0)
    flat = np.zeros((1500, 6), np.float32)
    flat[:, :dimension] = random.random((1500, dimension)) * 1000
    turned = flat @ np.linalg.qr(random.normal(0, 1, (6, 6)))[0].astype(np.float32)
    found = patch_manifold.Texels(turned, np.arange(1500), np.arange(1500), 1, 1)
    kernel = patch_manifold.kernel_of(found, np.arange(1500))
    assert 0.75 * dimension < kernel.dimension < 1.15 * dimension
    assert kernel.size == pytest.approx(kernel.landmark_size)
    e, total = np.exp(kernel.curve[40])
    squares = ((turned[:, None].astype(np.float64) - turned) ** 2).sum(-1)
    assert np.exp(-squares / (2 * e)).sum() == pytest.approx(total, rel=1e-3)


def test_landmarks_are_n_to_the_0_7():
    many = patch_manifold.Texels(np.zeros((5000, 1), np.float32), np.arange(5000), np.arange(5000), 1, 1)
    one, again = patch_manifold.landmarks(many), patch_manifold.landmarks(many)
    assert len(one) == int(5000**0.7) == len(np.unique(one))
    np.testing.assert_array_equal(one, again)


def test_a_dense_small_group_is_found_small():
    """The published rule takes it together with everything else, which is why there is a correction."""
    random = np.random.default_rng(0)
    heat = np.concatenate([random.normal(-3, 0.1, 150), random.normal(-9, 0.5, 850)])
    density = np.concatenate([random.normal(20, 1, 150), random.normal(8, 1, 850)])
    _, hot, small = diffusion._repaired(density, heat, 1000)
    assert small and -8 < hot < -3
    _, hot, small = diffusion._repaired(density[150:], heat[150:], 1000)
    assert not small and (heat[150:] > hot).sum() >= 400
    assert diffusion._literal(density, heat, 1000) == (-np.inf, None, False)


def test_the_published_rule_keeps_what_lies_above_a_valley_of_heat_beyond_the_0_4_quantile():
    random = np.random.default_rng(0)
    heat = np.concatenate([random.normal(-3, 0.3, 520), random.normal(-9, 0.3, 480)])
    density = np.concatenate([random.normal(20, 1, 500), random.normal(8, 1, 500)])
    dense, hot, small = diffusion._literal(density, heat, 1000)
    assert not small and -8 < hot < -4 and 9 < dense < 19
    assert diffusion._literal(density, heat[::-1].copy() - 3 * (np.arange(1000) < 300), 1000)[1] is not None


def test_the_mask_is_the_centers_dilated_by_a_patch():
    types = np.full(130, diffusion.SCATTERED, np.int8)
    types[[0, 57]] = diffusion.DOMINANT
    found = patch_manifold.texels_of(pixels_of(some_lab()), 5, 1, Session().resources)
    mask = diffusion.dominant_mask(diffusion.Dominance(found, types, types, types), np.ones((17, 14), bool))
    expected = np.zeros((17, 14), bool)
    for t in (0, 57):
        expected[found.rows[t] - 2 : found.rows[t] + 3, found.columns[t] - 2 : found.columns[t] + 3] = True
    np.testing.assert_array_equal(mask, expected)


def test_a_mask_is_nothing_where_nothing_is_dominant_seen_or_covered():
    lab = some_lab(1, 40, 40)
    seen = np.ones((40, 40), bool)
    seen[:, :4], seen[20, 30] = False, False
    pixels = pixels_of(lab, seen)
    texels = patch_manifold.texels_of(pixels, 5, 1, Session().resources)
    zeros = np.zeros(texels.count)
    of_all, of_none = (
        refined_mask(
            diffusion.Dominance(texels, np.full(texels.count, kind, np.int8), zeros, zeros),
            pixels,
            pixel_colors(pixels),
        )
        for kind in (diffusion.DOMINANT, diffusion.SMALL)
    )
    assert not of_none.any()
    np.testing.assert_array_equal(of_all, diffusion.dominant_mask(_all_dominant(texels), seen))


def _all_dominant(texels: patch_manifold.Texels) -> diffusion.Dominance:
    zeros = np.zeros(texels.count)
    return diffusion.Dominance(texels, zeros.astype(np.int8), zeros, zeros)


@pytest.mark.parametrize("seed", range(40))
def test_valleys_are_those_of_scipy(seed):
    from scipy.signal import find_peaks

    random = np.random.default_rng(seed)
    counts = random.integers(0, 9, 64).astype(float) if seed % 2 else diffusion._histogram(random.random(500))[0]
    for prominence in (0.0, 0.03, 0.3):
        valleys, depths = diffusion._valleys(counts, prominence)
        expected, facts = find_peaks(-counts, prominence=max(prominence * counts.max(), 1e-9))
        np.testing.assert_array_equal(valleys, expected)
        np.testing.assert_array_equal(depths, facts["prominences"])


def test_a_long_search_for_neighbors_says_how_long_and_advances(monkeypatch, caplog):
    random = np.random.default_rng(0)
    values = random.random((5000, 3)).astype(np.float32)
    texels = patch_manifold.Texels(values, np.arange(5000), np.arange(5000), 1, 1)
    told = []
    quick = patch_manifold.neighbor_squares(texels, Session().resources, Progress(lambda *at: told.append(at)))
    assert not caplog.records and told == [(n, 20) for n in range(1, 21)]
    monkeypatch.setattr(patch_manifold, "_LONG", 0.0)
    monkeypatch.setattr(patch_manifold, "_TIMED", 0.0)
    slow = patch_manifold.neighbor_squares(texels, Session().resources, Progress())
    assert "comparing 5000 patches takes about" in caplog.text
    assert (quick != slow).nnz == 0
