# SPDX-License-Identifier: Apache-2.0
"""The measures of stationarity/costs.py against their definitions."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex.analysis.stationarity import costs as st
from oiiotex.analysis.stationarity.row_bands import row_bands, rows_around
from oiiotex.engine.core.window import Domain
from oiiotex.synthesis.quality import copy_detection, seam_measures
from oiiotex.synthesis.quality.seam_measures import line_jumps, seam_ratio, sharpness
from tests import pictures
from tests.reference.histograms import gaussian_rows, soft_members


def lab_like(height: int, width: int, seed: int = 0) -> np.ndarray:
    return (pictures.stained(pictures.pebbles(height, width, seed)) * [90, 40, 40]).astype(np.float32)


@pytest.fixture(autouse=True)
def in_small_bands(monkeypatch):
    """Small images, too, are looked at in many bands."""
    for module in (st, copy_detection, seam_measures):
        monkeypatch.setattr(module, "row_bands", lambda rows, pixels=300: row_bands(rows, 300))


def brute_force_cost(lab: np.ndarray, sigma: float, wrap: bool, sites: int) -> float:
    """Eq. 1: the double sum over pairs of sites, the earth mover's distance as the area between cumulatives."""
    height, width = lab.shape[:2]
    rows, columns = (np.arange(sites) * n // sites for n in (height, width))
    down, right = gaussian_rows(height, sigma, wrap)[rows], gaussian_rows(width, sigma, wrap)[columns]
    total = 0.0
    for c, (low, high) in enumerate(st.RANGES):
        members = soft_members(lab[..., c].astype(np.float64), low, high, st.BINS)
        local = (down @ members @ right.T).reshape(st.BINS, -1).cumsum(0)
        pairs = itertools.combinations(range(local.shape[1]), 2)
        apart = [np.abs(local[:, i] - local[:, j]).sum() for i, j in pairs]
        total += np.mean(apart) * (high - low) / (st.BINS - 1)
    return total


@pytest.mark.parametrize("wrap", [True, False])
def test_stationarity_cost_is_the_mean_over_all_pairs(monkeypatch, wrap):
    monkeypatch.setattr(st, "SITES", 5)
    lab = lab_like(40, 55)
    cost = st.stationarity_cost(lab, 4.0, Domain(55, 40, wrap, wrap))
    assert cost == pytest.approx(brute_force_cost(lab, 4.0, wrap, 5), rel=1e-4)


def test_a_constant_image_costs_nothing_and_drift_costs_more():
    assert st.stationarity_cost(np.full((40, 40, 3), 50, np.float32), 4.0) == pytest.approx(0.0, abs=1e-4)
    plain = (pictures.pebbles(96, 96, 0) * [90, 40, 40]).astype(np.float32)
    drifting = plain * np.linspace(0.5, 1.5, 96, dtype=np.float32)[None, :, None]
    assert st.stationarity_cost(drifting, 8.0) > 1.5 * st.stationarity_cost(plain, 8.0)


def test_the_seam_ratio_sees_the_wrap_alone():
    ramp = np.tile(np.arange(10.0), (4, 1))
    assert seam_ratio(ramp, 1) == pytest.approx(9.0)
    assert seam_ratio(np.sin(2 * np.pi * np.arange(32) / 32)[:, None] * np.ones((1, 3)), 0) == pytest.approx(
        1.0, abs=0.6
    )
    assert seam_ratio(np.ones((5, 5)), 0) == 0.0


def test_bands_do_not_show():
    gray = lab_like(42, 50)[..., 0]
    assert sharpness(gray) == pytest.approx(np.abs(gray - gaussian_filter(gray, 1, mode="wrap")).mean(), rel=1e-5)
    for axis in (0, 1):
        jumps = np.abs(gray - np.roll(gray, 1, axis)).mean(1 - axis, np.float64)
        np.testing.assert_allclose(line_jumps(gray, axis), jumps)
    for wraps, mode in ((True, "wrap"), (False, "reflect")):
        whole = np.pad(gray, ((6, 6), (0, 0)), mode)
        for band in row_bands(gray, 300):
            np.testing.assert_array_equal(rows_around(gray, band, 6, wraps), whole[band.start : band.stop + 12])


def test_a_seam_in_a_joint_is_compared_with_joints():
    tiles = np.ones((64, 64))
    tiles[:, ::8] = 0.2
    assert seam_ratio(tiles, 1) > 3.0
    assert seam_ratio(tiles, 1, 1 / 8) == pytest.approx(1.0)
    tiles[:, 0] = -0.6
    assert seam_ratio(tiles, 1, 1 / 8) > 1.5
