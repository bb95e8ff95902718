# SPDX-License-Identifier: Apache-2.0
"""The Pearson system against Pearson's own equation, and the table that kernels read."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from oiiotex.synthesis.projections import pearson_table
from tests.reference import pearson

TYPES = {
    "I": (0.6, 2.6), "I, a J": (1.5, 4.0), "I, a U": (0.4, 1.4), "II": (0.0, 2.0), "II, flat": (0.0, 1.8),
    "III": (0.8, 3 + 1.5 * 0.64), "IV": (0.5, 4.5), "V": (0.9, None), "VI": (1.2, 5.6), "VII": (0.0, 5.0),
    "normal": (0.0, 3.0), "skewed to the left": (-0.7, 3.9),
}  # fmt: skip
SHARES = np.linspace(0.001, 0.999, 999)


def kurtosis_of_type_5(skewness: float) -> float:
    """Where the discriminant of Pearson's denominator is 0, between types IV and VI."""

    def discriminant(kurtosis: float) -> float:
        b1 = skewness**2
        return b1 * (kurtosis + 3) ** 2 - 4 * (4 * kurtosis - 3 * b1) * (2 * kurtosis - 3 * b1 - 6)

    from scipy.optimize import brentq

    return brentq(discriminant, 3 + 1.5 * skewness**2 + 1e-6, 3 + 10 * skewness**2, xtol=1e-14)


def moments_of(quantiles: np.ndarray, shares: np.ndarray) -> list[float]:
    """Mean, variance, skewness and kurtosis from a quantile function."""
    width = np.diff(shares)
    middle = 0.5 * (quantiles[1:] + quantiles[:-1])
    mean = (middle * width).sum() / width.sum()
    central = [((middle - mean) ** k * width).sum() / width.sum() for k in (2, 3, 4)]
    return [mean, central[0], central[1] / central[0] ** 1.5, central[2] / central[0] ** 2]


@pytest.mark.parametrize("name", TYPES)
def test_every_type_has_the_moments_that_were_asked_for(name):
    skewness, kurtosis = TYPES[name]
    kurtosis = kurtosis or kurtosis_of_type_5(skewness)
    # shares are denser where the tails are
    shares = stats.norm.cdf(np.linspace(-8, 8, 40001))
    found = moments_of(pearson.pearson_ppf(shares, skewness, kurtosis), shares)
    np.testing.assert_allclose(found, [0, 1, skewness, kurtosis], atol=0.02, rtol=0.02)


@pytest.mark.parametrize("name", ["I", "III", "IV", "VI", "VII"])
def test_densities_solve_pearsons_equation(name):
    skewness, kurtosis = TYPES[name]
    b1 = skewness**2
    c0, c1, c2 = 4 * kurtosis - 3 * b1, skewness * (kurtosis + 3), 2 * kurtosis - 3 * b1 - 6
    d = 10 * kurtosis - 12 * b1 - 18
    wanted = np.array([0.3, 0.4, 0.6, 0.7])
    low, *places = pearson.pearson_ppf(np.concatenate([[0.2], wanted]), skewness, kurtosis)

    def slope(u: float, log_density: np.ndarray) -> float:
        return -(d * u + c1) / (c0 + c1 * u + c2 * u * u)

    grid = np.linspace(low, places[-1], 4001)
    log_density = integrate.solve_ivp(slope, (low, places[-1]), [0.0], t_eval=grid, rtol=1e-9, atol=1e-9).y[0]
    below = integrate.cumulative_trapezoid(np.exp(log_density), grid, initial=0)
    share = np.interp(places, grid, below) / below[-1]
    np.testing.assert_allclose(share, (wanted - 0.2) / 0.5, atol=1e-4)


def test_types_meet_where_they_border():
    for skewness, kurtosis in ((0.8, 3 + 1.5 * 0.64), (0.9, kurtosis_of_type_5(0.9)), (0.0, 3.0), (1e-6, 4.0)):
        beside = [pearson.pearson_ppf(SHARES, skewness, kurtosis + step) for step in (-1e-4, 0.0, 1e-4)]
        assert np.ptp(beside, axis=0).max() < 2e-3


@pytest.mark.parametrize("kurtosis", [1.64, 1.0, 0.0])
def test_at_the_bound_and_below_it_there_are_two_values(kurtosis):
    found = pearson.pearson_ppf(SHARES, 0.8, kurtosis)
    values, counts = np.unique(found, return_counts=True)
    assert len(values) == 2
    mean = np.average(values, weights=counts)
    assert mean == pytest.approx(0, abs=2e-3)
    assert np.average((values - mean) ** 3, weights=counts) == pytest.approx(0.8, rel=0.01)
    near = pearson.pearson_ppf(SHARES, 0.8, 1.64 + 1e-4)
    assert np.quantile(np.abs(near - found), 0.95) < 0.02


def test_the_kept_table_is_what_scipy_says():
    made = pearson.tabulated()
    assert (made["quantiles"].dtype, made["shares"].dtype) == (np.float32, np.float64)
    np.testing.assert_allclose(pearson_table.table_shares(), made["shares"], rtol=1e-14)
    np.testing.assert_allclose(pearson_table.quantile_table(), made["quantiles"], rtol=1e-5, atol=1e-6)


def test_the_table_is_the_distribution_and_reads_both_ways():
    table = pearson_table.quantile_table()
    assert np.isfinite(table).all() and (np.diff(table, axis=2) >= 0).all()
    random = np.random.default_rng(0)
    for _ in range(40):
        skewness = random.uniform(-2, 2)
        kurtosis = 1 + skewness**2 + random.uniform(1.0, 8.0)
        at = [float(v) for v in pearson_table.table_place(np.array(skewness), np.array(kurtosis))]
        shares = random.uniform(0.02, 0.98, 20)
        found = pearson_table.shares_below(pearson.pearson_ppf(shares, skewness, kurtosis), *at)
        assert np.abs(found - shares).max() < 0.1  # at the sharp end of a J; elsewhere below a percent
        assert np.median(np.abs(found - shares)) < 0.01
    assert pearson_table.shares_below(np.array([-99.0, 0.0, 99.0]), 0.0, 16.0)[[0, 2]].tolist() == [0.0, 1.0]
