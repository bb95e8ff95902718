# SPDX-License-Identifier: Apache-2.0
"""cl/patchmatch.cl against tests/reference/patchmatch.py, to the bit, in wide registers and in single lanes."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex.device import Buffers, Device
from oiiotex.synthesis import patchmatch as pm
from oiiotex.synthesis.histograms import OUTSIDE
from tests.reference import patchmatch as reference

BUDGET = 1 << 30


def setup(device: Device, geometry: pm.Geometry, seed: int = 0, uniformity: float = 0.0, spread: int = 300):
    """A matcher on random images with a random field, and what it was given."""
    random = np.random.default_rng(seed)
    g = geometry
    target = random.integers(-spread, spread, (g.height, g.width, g.channels)).astype(np.int16)
    exemplar = random.integers(-spread, spread, (g.exemplar_height, g.exemplar_width, g.channels)).astype(np.int16)
    y = random.integers(0, g.exemplar_rows, (g.rows, g.columns))
    x = random.integers(0, g.exemplar_columns, (g.rows, g.columns))
    buffers = Buffers(device, g.layout(), BUDGET, "test")
    matcher = pm.Matcher(device, buffers, g, exemplar, pm.allowed_patches(None, g), pm.pack(y, x), uniformity, 5)
    device.write(buffers["image"], target)
    return matcher, buffers, target, exemplar, y, x


GEOMETRIES = [
    pm.Geometry(17, 13, 19, 23, 5, True, True),
    pm.Geometry(21, 15, 16, 14, 5, False, True),
    pm.Geometry(13, 22, 15, 18, 7, True, False),
    pm.Geometry(16, 19, 21, 13, 11, False, False),
    pm.Geometry(14, 13, 17, 12, 5, True, False, channels=7),  # Lab, a normal and a roughness
]


@pytest.mark.parametrize("patch", range(5, 23, 2))
def test_the_distance_of_a_patch_is_the_plain_sum_of_squares(any_lanes, patch):
    g = pm.Geometry(patch + 3, patch + 2, patch + 5, patch + 4, patch, True, True)
    matcher, buffers, target, exemplar, y, x = setup(any_lanes, g, patch, spread=1200 if patch <= 11 else 600)
    matcher.improve(0, 0)  # scores the field as it is
    found = matcher.distances()
    for r in range(g.rows):
        for c in range(g.columns):
            assert found[r, c] == reference.distance(target, r, c, exemplar, y[r, c], x[r, c], patch)


def test_the_largest_distance_that_the_grid_allows_fits_32_bits(any_lanes):
    for patch, channels in ((11, 3), (21, 3), (11, 10)):
        ends = pm.to_grid(np.array([[-1e9] * channels, [1e9] * channels]), patch)
        g = pm.Geometry(patch, patch, patch, patch, patch, True, True, channels)
        matcher, buffers, *_ = setup(any_lanes, g)
        any_lanes.write(buffers["image"], np.broadcast_to(ends[0], (patch, patch, channels)))
        any_lanes.write(buffers["exemplar"], np.broadcast_to(ends[1], (patch, patch, channels)))
        matcher.improve(0, 0)
        assert (matcher.distances() == channels * patch**2 * (300 * pm.grid_steps(patch, channels)) ** 2).all()


def test_pixels_that_are_held_are_put_back(any_lanes):
    g = GEOMETRIES[-1]
    matcher, buffers, target, *_ = setup(any_lanes, g)
    kept = np.random.default_rng(1).random((g.height, g.width, 1)) < 0.4
    held = np.where(kept, -target, OUTSIDE).astype(np.int16)
    with Buffers(any_lanes, {"held": held.nbytes}, BUDGET, "test") as more:
        any_lanes.write(more["held"], held)
        buffers._held["held"] = more["held"]
        matcher.hold()
        found = any_lanes.read(buffers["image"], target.shape, np.int16)
    np.testing.assert_array_equal(found, np.where(kept, -target, target))


def test_a_change_is_taken_back_by_shares(any_lanes):
    g = GEOMETRIES[-1]
    matcher, buffers, target, *_ = setup(any_lanes, g)
    random = np.random.default_rng(4)
    changed = random.integers(-2400, 2400, target.shape).astype(np.int16)
    share = random.integers(0, 256, target.shape[:2]).astype(np.uint8)
    share[0, :2] = 0, 255
    with Buffers(any_lanes, {"changed": changed.nbytes, "ease": share.nbytes}, BUDGET, "test") as more:
        any_lanes.write(more["changed"], changed)
        any_lanes.write(more["ease"], share)
        buffers._held |= {name: more[name] for name in ("changed", "ease")}
        matcher.ease("changed")
        found = any_lanes.read(more["changed"], target.shape, np.int16)
    exact = target + (changed.astype(float) - target) * share[..., None] / 255
    assert np.abs(found - exact).max() <= 0.51
    np.testing.assert_array_equal(found[0, :2], [target[0, 0], changed[0, 1]])


def test_a_price_divides_the_use_that_a_patch_pays_for(any_lanes):
    """Twice as dear is as if it were used twice as often; what is forbidden is never taken."""
    g = GEOMETRIES[0]
    random = np.random.default_rng(2)
    price = random.choice([0.5, 1.0, 2.0], (g.exemplar_rows, g.exemplar_columns)).astype(np.float32)
    matcher, buffers, _, exemplar, y, x = setup(any_lanes, g, 3, 0.05)
    any_lanes.write(buffers["price"], price)
    matcher._count_uses()
    found = any_lanes.read(buffers["penalty"], price.shape, np.int32)
    plain = reference.penalties(y, x, g, 0.05 * pm._penalty_unit(exemplar, g))
    assert np.abs(found - plain * price).max() <= 2  # of rounding down before or behind the price
    assert plain.max() > 1000


@pytest.mark.parametrize("g", GEOMETRIES)
@pytest.mark.parametrize("uniformity", [0.0, 0.05])
def test_a_pass_of_propagation_and_search_is_the_oracles(any_lanes, g, uniformity):
    matcher, buffers, target, exemplar, y, x = setup(any_lanes, g, 3, uniformity)
    matcher.improve(1, step=4)
    weight = uniformity * pm._penalty_unit(exemplar, g)
    oracle = reference.Oracle(target, exemplar, g, y, x, reference.penalties(y, x, g, weight))
    oracle.one_pass(seed=5, step=64)
    found_y, found_x = pm.unpack(matcher.field())
    np.testing.assert_array_equal(found_y, oracle.y)
    np.testing.assert_array_equal(found_x, oracle.x)


@pytest.mark.parametrize("g", GEOMETRIES)
def test_the_vote_is_the_rounded_mean_of_all_patches_over_a_pixel(any_lanes, g):
    matcher, buffers, _, exemplar, y, x = setup(any_lanes, g, 1)
    matcher.vote()
    image = any_lanes.read(buffers["image"], (g.height, g.width, g.channels), np.int16)
    votes = reference.votes(exemplar, y, x, g)
    for r in range(g.height):
        for c in range(g.width):
            said = np.array([exemplar[v[2], v[3]] for v in votes[r][c]], np.int64)
            expected = np.floor(said.sum(0) / len(said) + 0.5)
            np.testing.assert_array_equal(image[r, c], expected)


@pytest.mark.parametrize("g", GEOMETRIES)
def test_the_last_vote_picks_the_most_voted_source_pixel(any_lanes, g):
    matcher, _, _, exemplar, y, x = setup(any_lanes, g, 2)
    y[:, : g.columns // 2] = np.minimum(y[0, 0] + np.arange(g.rows)[:, None], g.exemplar_rows - 1)  # some agreement
    any_lanes.write(matcher._buffers["field"], pm.pack(y, x))
    source_y, source_x = pm.unpack(matcher.pick())
    offset = np.arange(g.patch) - g.patch // 2
    fall = np.exp(-(offset**2) / (2.0 * pm.PICK_SIGMA**2))
    weight = np.rint(1024 * np.outer(fall, fall)).astype(int)
    votes = reference.votes(exemplar, y, x, g)
    for r in range(g.height):
        for c in range(g.width):
            poll: dict[tuple[int, int], int] = {}
            for v, u, sy, sx in votes[r][c]:
                poll[sy, sx] = poll.get((sy, sx), 0) + int(weight[v, u])
            winner = min(poll, key=lambda pixel: (-poll[pixel], pixel))
            assert (source_y[r, c], source_x[r, c]) == winner


def test_patches_that_are_not_allowed_are_never_matched(device):
    g = pm.Geometry(24, 20, 31, 27, 5, True, True)
    opaque = np.ones((27, 31), bool)
    opaque[10:14, 8:20] = False
    allowed = pm.allowed_patches(opaque, g)
    field = pm.random_field(g, allowed, seed=3)
    exemplar = np.random.default_rng(0).integers(-300, 300, (27, 31, 3)).astype(np.int16)
    with Buffers(device, g.layout(), BUDGET, "test") as buffers:
        matcher = pm.Matcher(device, buffers, g, exemplar, allowed, field, 0.05, 0)
        matcher.vote()
        matcher.improve(4, 0)
        y, x = pm.unpack(matcher.field())
        source_y, source_x = pm.unpack(matcher.pick())
    assert allowed[y, x].all()
    assert opaque[source_y, source_x].all()


def test_a_fair_share_is_one_of_the_pixels_that_may_be_used():
    g = pm.Geometry(40, 40, 30, 20, 5, True, True)
    exemplar = np.random.default_rng(0).integers(-300, 300, (20, 30, 3)).astype(np.int16)
    usable = np.zeros((20, 30), bool)
    usable[:, :10] = True
    alone = pm.Geometry(40, 40, 10, 20, 5, True, True)
    assert pm._penalty_unit(exemplar, g, usable) == pm._penalty_unit(exemplar[:, :10], alone)
    assert pm._penalty_unit(exemplar, g, usable) < 0.5 * pm._penalty_unit(exemplar, g)


def test_patchmatch_comes_close_to_the_exact_nearest_neighbours(device):
    g = pm.Geometry(40, 40, 44, 44, 5, True, True)
    matcher, buffers, _, exemplar, _, _ = setup(device, g, 7)
    smooth = np.cumsum(np.cumsum(exemplar.astype(np.int32) // 40, 0), 1).astype(np.int16)  # texture, not noise
    device.write(buffers["exemplar"], smooth)
    target = np.roll(smooth[:40, :40], (7, 9), (0, 1))
    device.write(buffers["image"], target)
    matcher.improve(pm.MATCH_PASSES, 0)
    found = matcher.distances().astype(np.float64)
    windows = np.lib.stride_tricks.sliding_window_view(smooth.astype(np.float64), (5, 5), (0, 1)).reshape(-1, 75)
    padded = np.pad(target.astype(np.float64), ((0, 4), (0, 4), (0, 0)), mode="wrap")
    patches = np.lib.stride_tricks.sliding_window_view(padded, (5, 5), (0, 1)).reshape(-1, 75)
    exact = ((patches**2).sum(1)[:, None] + (windows**2).sum(1)[None] - 2 * patches @ windows.T).min(1)
    assert found.mean() >= exact.mean() - 1e-6
    assert found.mean() <= 1.1 * exact.mean() + 1.0
    assert (np.abs(found.ravel() - exact) < 0.5).mean() > 0.9


def test_a_field_keeps_its_coherence_when_it_is_upsampled():
    coarse = pm.Geometry(20, 20, 30, 30, 5, True, True)
    fine = pm.Geometry(26, 26, 39, 39, 5, True, True)
    y, x = np.mgrid[0:20, 0:20]
    allowed = np.ones((fine.exemplar_rows, fine.exemplar_columns), bool)
    finer_y, finer_x = pm.unpack(pm.upsample_field(pm.pack(y + 3, x + 2), coarse, fine, allowed, 0))
    assert (np.diff(finer_x[:, :20], axis=1) == 1).mean() > 0.9
    assert abs(np.median(finer_y - np.arange(26)[:, None]) - 3 * 1.3) <= 1


def test_the_hash_of_host_and_device_is_one(device):
    y, x = np.mgrid[0:5, 0:7]
    expected = [
        reference.pcg(int(c) + reference.pcg(int(r) + reference.pcg(9 + reference.pcg(3))))
        for r, c in zip(y.ravel(), x.ravel(), strict=True)
    ]
    # the oracle test above runs the device's hash against the same function
    np.testing.assert_array_equal(pm.hash_at(3, 9, y, x).ravel(), np.array(expected, np.uint64) & 0xFFFFFFFF)
