# SPDX-License-Identifier: Apache-2.0
"""The measures of MJH17 section 3: costs against direct sums, maps against dense ones, what is refused."""

from __future__ import annotations

import itertools
import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from benchmarks.quilts.copies import copies
from oiiotex import filters
from oiiotex.analysis.stationarity import costs as st
from oiiotex.analysis.stationarity.steerable import RADIUS, responses
from oiiotex.engine import errors
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.core.window import Domain
from oiiotex.engine.session import Session
from oiiotex.synthesis.quality.copy_detection import copies_by_source, region_uses
from tests import pictures
from tests.analysis.test_deviation import cost_of, lab_of
from tests.analysis.test_stationarity import in_small_bands, lab_like  # noqa: F401 - a fixture for all
from tests.any_filter import buffer, pixels
from tests.reference.histograms import gaussian_rows, soft_members
from tests.refusals import refused

pytestmark = pytest.mark.usefixtures("few_places")


def sites_of(size: int, sites: int, sigma: float, wrap: bool) -> np.ndarray:
    return gaussian_rows(size, sigma, wrap)[np.arange(sites) * size // sites]


@pytest.mark.parametrize("wrap", [True, False])
@pytest.mark.parametrize("order", [2, 4])
def test_the_cost_of_moments_is_the_mean_over_all_pairs_of_squared_differences(monkeypatch, wrap, order):
    monkeypatch.setattr(st, "SITES", 5)
    lab = lab_like(40, 55)
    down, right = (sites_of(n, 5, 4.0, wrap) for n in (40, 55))
    total = 0.0
    for c in range(3):
        deviation = lab[..., c].std(dtype=np.float64)
        z = (lab[..., c] - lab[..., c].mean(dtype=np.float64)) / deviation
        for p in range(1, order + 1):
            local = (down @ z**p @ right.T).ravel()  # eq. 2
            normal = np.random.default_rng(0).normal(size=10**6) ** p
            pairs = [(a - b) ** 2 for a, b in itertools.combinations(local, 2)]
            total += deviation**2 * np.mean(pairs) / normal.var()  # eq. 1
    domain = Domain(55, 40, wrap, wrap)
    assert st.stationarity_cost(lab, 4.0, domain, "moments", order) == pytest.approx(total, rel=0.02)


@pytest.mark.parametrize("wrap", [True, False])
def test_the_cost_of_responses_is_the_mean_over_all_pairs(monkeypatch, wrap):
    monkeypatch.setattr(st, "SITES", 4)
    lab = lab_like(32, 40)
    down, right = (sites_of(n, 4, 4.0, wrap) for n in (32, 40))
    total, dimensions = 0.0, 0
    for c, (low, high) in enumerate(st.RESPONSE_RANGES):
        for plane in responses(lab[..., c], (wrap, wrap)):  # eq. 4
            local = (down @ soft_members(plane, low, high, st.BINS) @ right.T).reshape(st.BINS, -1).cumsum(0)
            pairs = itertools.combinations(local.T, 2)
            total += np.mean([np.abs(a - b).sum() for a, b in pairs]) * (high - low) / (st.BINS - 1)
            dimensions += 1
    assert dimensions == 12
    domain = Domain(40, 32, wrap, wrap)
    assert st.stationarity_cost(lab, 4.0, domain, "steerable") == pytest.approx(total, rel=1e-4)


def test_costs_of_moments_compare_in_the_units_of_another_image():
    lab = lab_like(48, 48)
    plain = [st.stationarity_cost(i, 6.0, measure="moments", order=2, like=lab) for i in (lab, 2 * lab)]
    assert plain[1] > 3.9 * plain[0]
    own = [st.stationarity_cost(i, 6.0, measure="moments", order=2) for i in (lab, 2 * lab)]
    assert own[1] == pytest.approx(4 * own[0])


@pytest.mark.parametrize("measure", ["moments", "steerable"])
def test_a_constant_image_costs_nothing(measure):
    constant = np.full((40, 40, 3), 50, np.float32)
    assert st.stationarity_cost(constant, 4.0, measure=measure, order=4) == pytest.approx(0.0, abs=1e-4)
    made = filters.stationarity(buffer(np.full((40, 50, 3), 0.3)), measure=measure)
    assert cost_of(made) == pytest.approx(0, abs=1e-6) and np.abs(pixels(made)).max() < 1e-6


# --- maps ---


def center_weights(size: int, sigma: float, side: int) -> np.ndarray:
    centers = np.minimum(np.arange(-(-size // side)) * side + (side - 1) / 2, size - 0.5)
    return np.exp(-0.5 * ((np.arange(size)[None, :] - centers[:, None]) / sigma) ** 2)


def in_cells(seen: np.ndarray, side: int) -> np.ndarray:
    rows = np.add.reduceat(seen, np.arange(0, seen.shape[0], side), 0)
    return np.add.reduceat(rows, np.arange(0, seen.shape[1], side), 1)


def dense_moments(lab: np.ndarray, sigma: float, side: int, seen: np.ndarray, order: int) -> tuple[np.ndarray, float]:
    down, right = (center_weights(n, sigma, side) for n in seen.shape)
    share, number = down @ seen @ right.T, in_cells(seen, side)
    total = np.zeros(share.shape)
    for c, (low, high) in enumerate(st.RANGES):
        values = np.clip(lab[..., c].astype(np.float64), low, high)
        mean = np.average(values, weights=seen)
        variance = np.average((values - mean) ** 2, weights=seen)
        for p in range(1, order + 1):
            local = down @ (((values - mean) / np.sqrt(variance)) ** p * seen) @ right.T / share
            apart = (local[:, :, None, None] - local) ** 2
            total += variance / st.POWER_VARIANCES[p] * (apart * number).sum((2, 3)) / number.sum()
    return total, float((total * number).sum() / number.sum())


def dense_responses(lab: np.ndarray, sigma: float, side: int, seen: np.ndarray) -> tuple[np.ndarray, float]:
    down, right = (center_weights(n, sigma, side) for n in seen.shape)
    share, number = down @ seen @ right.T, in_cells(seen, side)
    total = np.zeros(share.shape)
    for c, (low, high) in enumerate(st.RESPONSE_RANGES):
        for plane in responses(lab[..., c]):
            members = soft_members(plane, low, high, st.BINS) * seen
            local = (down @ members @ right.T / share).cumsum(0)
            apart = np.abs(local[:, :, :, None, None] - local[:, None, None]).sum(0) * (high - low) / (st.BINS - 1)
            total += (apart * number).sum((2, 3)) / number.sum()
    return total, float((total * number).sum() / number.sum())


def check(made: oiio.ImageBuf, dense: np.ndarray, cost: float, side: int) -> None:
    assert cost_of(made) == pytest.approx(cost, rel=0.06)
    found = pixels(made)[side // 2 :: side, side // 2 :: side, 0]
    dense = dense[: found.shape[0], : found.shape[1]]
    assert np.sqrt(((found - dense) ** 2).mean()) < 0.1 * dense.mean()


@pytest.mark.parametrize(
    ("measure", "order", "hole"), [("moments", 2, False), ("moments3", 3, True), ("moments4", 4, True)]
)
def test_the_map_of_moments_is_eq_1_place_by_place(measure, order, hole):
    picture = pictures.stained(pictures.pebbles(61, 87, 2))
    seen = np.ones((61, 87))
    seen[10:30, 5 : 5 + 25 * hole] = 0
    photo = buffer(np.dstack([picture * seen[..., None], seen]), names=tuple("RGBA"))
    made = filters.stationarity(photo, sigma=8, measure=measure)
    check(made, *dense_moments(lab_of(picture), 8.0, 3, seen, order), side=3)


@pytest.mark.parametrize("hole", [False, True])
def test_the_map_of_responses_is_eq_1_place_by_place(hole):
    picture = pictures.stained(pictures.pebbles(49, 61, 2))
    opaque, seen = np.ones((49, 61)), np.ones((49, 61))
    if hole:
        opaque[20:28, 30:38] = 0
        seen[20 - RADIUS : 28 + RADIUS, 30 - RADIUS : 38 + RADIUS] = 0  # what sees the hole is no response
    photo = buffer(np.dstack([picture * opaque[..., None], opaque]), names=tuple("RGBA"))
    made = filters.stationarity(photo, sigma=8, measure="steerable")
    check(made, *dense_responses(lab_of(picture), 8.0, 3, seen), side=3)


@pytest.mark.parametrize("measure", ["moments", "steerable"])
def test_neither_bands_nor_threads_show_in_a_map(monkeypatch, measure):
    photo = buffer(pictures.stained(pictures.bricks(70, 83, 1)))
    found = pixels(filters.stationarity(photo, sigma=5, measure=measure))
    monkeypatch.setattr("oiiotex.engine.scan.PIECE_PIXELS", 83 * 2)
    again = pixels(filters.stationarity(photo, sigma=5, measure=measure, session=Session(threads=1)))
    np.testing.assert_array_equal(found, again)


@pytest.mark.parametrize("measure", ["moments", "steerable"])
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (7, 5)])
def test_tiny_images(measure, size):
    made = pixels(filters.stationarity(buffer(np.random.default_rng(0).random((*size, 3))), measure=measure))
    assert made.shape == (*size, 1) and np.isfinite(made).all()


@pytest.mark.parametrize("measure", ["moments", "steerable"])
def test_data_and_images_without_alpha(measure):
    random = np.random.default_rng(0)
    made = filters.stationarity(buffer(random.random((30, 40, 5)), space="data"), measure=measure)
    assert cost_of(made) > 0
    empty = filters.stationarity(buffer(np.zeros((20, 30, 4)), names=tuple("RGBA")), measure=measure)
    assert cost_of(empty) == 0 and not pixels(empty).any()


# --- what is refused ---


@pytest.mark.parametrize("measure", ["moments", "steerable"])
def test_all_that_is_broken_is_counted(monkeypatch, measure):
    monkeypatch.setattr("oiiotex.engine.scan.PIECE_PIXELS", 40 * 50 // 4)
    broken = pictures.bricks(300, 40, 1)
    broken[[3, 49, 50, 299], 5, 0] = np.nan
    with refused(errors.ImageError, counts=[4, 0]):
        filters.stationarity(buffer(broken), sigma=8, measure=measure)
    with refused(errors.ImageError, counts=[4, 0]):
        filters.stationarize(buffer(broken), measure=measure)


@pytest.mark.parametrize("op", ["stationarity", "stationarize", "sigmas"])
def test_other_measures_are_refused(op):
    expected = "one of 'histogram', 'moments', 'moments3', 'moments4', 'steerable'"
    for value in ("haar", "moments2", "moments5"):
        with refused(errors.ParameterError, parameter="measure", value=value, expected=expected):
            getattr(filters, op)(buffer(pictures.bricks(40, 40, 1)), measure=value)


# --- what -v says ---


def test_copies_are_the_same_by_source_and_by_looks():
    random = np.random.default_rng(0)
    exemplar = random.integers(0, 256, (60, 70, 3)).astype(np.uint8)
    y, x = random.integers(0, 60, (50, 55)), random.integers(0, 70, (50, 55))
    for top, left, height, width, from_y, from_x in (
        (0, 0, 8, 8, 3, 5),
        (20, 30, 12, 9, 10, 10),
        (42, 47, 8, 8, 40, 50),
    ):
        rows, columns = np.mgrid[:height, :width]
        y[top : top + height, left : left + width] = from_y + rows
        x[top : top + height, left : left + width] = from_x + columns
    found = copies_by_source(SourceMap.of(y, x), (60, 70))
    assert (found, found.exact) == copies(exemplar[y, x], exemplar)
    assert found.exact == pytest.approx((64 + 108 + 64) / (50 * 55))


def test_uses_of_regions_are_counted_where_they_come_from_and_where_they_go():
    exemplar = buffer(np.zeros((64, 96, 3), np.float32))
    y, x = np.mgrid[:64, :64]
    x[:, 32:] -= 32  # the left half twice, the right third never
    uses, shown = region_uses(SourceMap.of(y, x).coordinates(exemplar.spec()), exemplar.spec())
    assert uses.shape == (64, 96) and shown.shape == (64, 64)
    assert (uses[:, :15] == 2).all() and (uses[:, 49:] == 0).all() and (uses[:, 31:33] > 0.9).all()
    np.testing.assert_array_equal(shown, uses[y, x])


@pytest.mark.parametrize(("measure", "unit"), [("moments", "Lab^2 "), ("steerable", "Lab ")])
def test_v_prints_the_measures_of_every_tile(caplog, measure, unit):
    photo = buffer(pictures.pebbles(64, 72, 1))
    with caplog.at_level(logging.INFO, "oiiotex"):
        filters.stationarize(photo, iterations=4, measure=measure, session=Session(measure=True))
        filters.patchmatch(photo, iterations=4, session=Session(measure=True))
    lines = [r.getMessage() for r in caplog.records if r.levelno == logging.INFO]  # warnings repeat measures
    assert any(
        line.startswith("--texstationarize: stationarity cost") and f"{unit}(MJH17 eq. 1)" in line for line in lines
    )
    for op in ("--texstationarize", "--texpatchmatch"):
        for word in (
            "fidelity", "texture cost", "seam ratio x", "seam ratio y", "sharpness loss",
            "verbatim copies of 8x8 px; the most repeated region of 32x32",
        ):  # fmt: skip
            said = [line for line in lines if line.startswith(f"{op}: ") and word in line and "trying" not in line]
            assert len(said) == 1, word


def test_each_measure_lowers_its_own_cost():
    picture = pictures.stained(pictures.pebbles(96, 96, 1))
    lab = lab_of(picture)
    photo = buffer(picture)
    plain = filters.patchmatch(photo, seed=1, iterations=8)
    for measure in ("histogram", "moments", "steerable"):
        tile = filters.stationarize(photo, measure=measure, seed=1, iterations=8, sigma=3.25)
        lowered, other = (
            st.stationarity_cost(lab_of(pixels(made)), 3.0, measure=measure, like=lab) for made in (tile, plain)
        )
        assert lowered < other
