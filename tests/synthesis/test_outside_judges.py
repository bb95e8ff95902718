# SPDX-License-Identifier: Apache-2.0
"""The peers that are written here for benchmarks do what their papers say, or their figures would say nothing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from benchmarks.labels.levels import score
from benchmarks.subtextures import factorization
from benchmarks.tiles import hex_tiling
from tests import pictures

SIDE = 96


def noise(sigma: float, side: int = SIDE) -> np.ndarray:
    """A stationary texture that tiles, (side, side, 3) in 0 .. 1, skewed in its values."""
    made = gaussian_filter(np.random.default_rng(3).normal(size=(side, side, 3)), (sigma, sigma, 0), mode="wrap")
    return 1 / (1 + np.exp(-2 * made / made.std() + 1.5))


@pytest.mark.parametrize("told", [False, True])
def test_factorization_tells_two_textures_apart_and_counts_them(told):
    truth = np.ones((SIDE, SIDE), int)
    truth[:, SIDE // 2 :] = 2
    looks = noise(0.7), pictures.bricks(SIDE, SIDE, seed=1)
    picture = np.where(truth[..., None] == 1, *looks)
    labels = factorization.segmented(picture, 2 if told else None, window=21, residual=0.3)
    found = score(truth, labels, labels)
    assert found.count == 2 and found.covering > 0.8


def test_spectral_histograms_are_shares():
    values = np.random.default_rng(0).normal(size=(20, 24, 3))
    made = factorization.spectral_histograms(values, 5).reshape(20, 24, 3, -1)
    np.testing.assert_allclose(made.sum(-1), 1, atol=1e-5)


def test_blending_by_histogram_keeps_the_histogram_and_plain_blending_does_not():
    photo = noise(1.5, 128)
    kept = hex_tiling.by_histogram(photo, 256, 1)
    np.testing.assert_allclose(kept.mean((0, 1)), photo.mean((0, 1)), atol=0.03)
    np.testing.assert_allclose(kept.std((0, 1)), photo.std((0, 1)), rtol=0.1)
    weights, samples = hex_tiling._pieces(photo, 256, 1, turned=False, inside=True)
    plain = (weights[..., None] * samples).sum(0)
    assert (plain.std((0, 1)) < 0.85 * photo.std((0, 1))).all()


@pytest.mark.parametrize("turned", [False, True])
def test_hex_tiling_has_no_seams_where_triangles_meet(turned):
    photo = np.stack([noise(4, 128)[..., 0]] * 3, -1)
    weights, _ = hex_tiling._pieces(photo, 256, 1, turned, inside=False)
    np.testing.assert_allclose(weights.sum(0), 1, atol=1e-9)
    plane = hex_tiling.hextiled(photo, 256, 1, turned)
    jump = max(np.abs(np.diff(plane, axis=n)).max() for n in (0, 1))
    inside = max(np.abs(np.diff(photo, axis=n)).max() for n in (0, 1))
    assert jump < 2.5 * inside  # pieces are shown at up to twice their size or half of it
