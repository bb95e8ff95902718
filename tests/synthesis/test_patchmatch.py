# SPDX-License-Identifier: Apache-2.0
"""cl/patchmatch.cl against tests/reference/patchmatch.py, to the bit, in wide registers and in single lanes."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex.analysis.regularity.lattice import Lattice
from oiiotex.analysis.regularity.offset_prices import InStep
from oiiotex.engine.color.lab_grid import steps_for, to_grid
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.core.window import Domain
from oiiotex.engine.errors import ImageError
from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.engine.opencl.device import Device
from oiiotex.synthesis.patchmatch import field as pm
from oiiotex.synthesis.patchmatch.matcher import MATCH_PASSES, PICK_SIGMA, Matcher, _penalty_unit, match_patches
from oiiotex.synthesis.projections.histograms import OUTSIDE
from tests.reference import patchmatch as reference

BUDGET = 1 << 30


def setup(device: Device, geometry: pm.Geometry, seed: int = 0, uniformity: float = 0.0, spread: int = 300, **more):
    """A matcher on random images with a random field, and what it was given."""
    random = np.random.default_rng(seed)
    g = geometry
    target = random.integers(-spread, spread, (g.height, g.width, g.channels)).astype(np.int16)
    exemplar = random.integers(-spread, spread, (g.exemplar_height, g.exemplar_width, g.channels)).astype(np.int16)
    y = random.integers(0, g.exemplar_rows, (g.rows, g.columns))
    x = random.integers(0, g.exemplar_columns, (g.rows, g.columns))
    own = {"fixed": target.nbytes, "changed": target.nbytes, "ease": g.width * g.height}
    buffers = Buffers(device, g.layout() | own, BUDGET, "test")
    allowed = pm.allowed_patches(None, g)
    matcher = Matcher(device, buffers, g, exemplar, allowed, SourceMap.of(y, x), uniformity, 5, **more)
    device.write(buffers["image"], target)
    return matcher, buffers, target, exemplar, y, x


GEOMETRIES = [
    pm.Geometry(17, 13, True, True, exemplar_width=19, exemplar_height=23, patch=5),
    pm.Geometry(21, 15, False, True, exemplar_width=16, exemplar_height=14, patch=5),
    pm.Geometry(13, 22, True, False, exemplar_width=15, exemplar_height=18, patch=7),
    pm.Geometry(16, 19, False, False, exemplar_width=21, exemplar_height=13, patch=11),
    pm.Geometry(
        14, 13, True, False, exemplar_width=17, exemplar_height=12, patch=5, channels=7
    ),  # Lab, a normal and a roughness
]


@pytest.mark.parametrize("patch", [5, 11, 21])  # the ends, and what is usual; the golden images have 7 and 9
def test_the_distance_of_a_patch_is_the_plain_sum_of_squares(any_lanes, patch):
    g = pm.Geometry(patch + 3, patch + 2, True, True, exemplar_width=patch + 5, exemplar_height=patch + 4, patch=patch)
    matcher, buffers, target, exemplar, y, x = setup(any_lanes, g, patch, spread=1200 if patch <= 11 else 600)
    matcher.improve(0, 0)  # scores the field as it is
    found = reference.distances(matcher)
    for r in range(g.rows):
        for c in range(g.columns):
            assert found[r, c] == reference.distance(target, r, c, exemplar, y[r, c], x[r, c], patch)


def test_the_largest_distance_that_the_grid_allows_fits_32_bits(any_lanes):
    for patch, channels in ((11, 3), (21, 3), (11, 10)):
        ends = to_grid(np.array([[-1e9] * channels, [1e9] * channels]), steps_for(patch, channels))
        g = pm.Geometry(
            patch, patch, True, True, exemplar_width=patch, exemplar_height=patch, patch=patch, channels=channels
        )
        matcher, buffers, *_ = setup(any_lanes, g)
        any_lanes.write(buffers["image"], np.broadcast_to(ends[0], (patch, patch, channels)))
        any_lanes.write(buffers["exemplar"], np.broadcast_to(ends[1], (patch, patch, channels)))
        matcher.improve(0, 0)
        assert (reference.distances(matcher) == channels * patch**2 * (300 * steps_for(patch, channels)) ** 2).all()


def test_pixels_that_are_held_are_put_back(any_lanes):
    g = GEOMETRIES[-1]
    matcher, buffers, target, *_ = setup(any_lanes, g)
    kept = np.random.default_rng(1).random((g.height, g.width, 1)) < 0.4
    held = np.where(kept, -target, OUTSIDE).astype(np.int16)
    any_lanes.write(buffers["fixed"], held)
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
    any_lanes.write(buffers["changed"], changed)
    any_lanes.write(buffers["ease"], share)
    matcher.ease("changed")
    found = any_lanes.read(buffers["changed"], target.shape, np.int16)
    exact = target + (changed.astype(float) - target) * share[..., None] / 255
    assert np.abs(found - exact).max() <= 0.51
    assert abs((found - exact).mean()) < 0.05  # neither up nor down: rounded down it were half a step of the grid
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
    plain = reference.penalties(y, x, g, 0.05 * _penalty_unit(exemplar, g))
    assert np.abs(found - plain * price).max() <= 2  # of rounding down before or behind the price
    assert plain.max() > 1000


@pytest.mark.parametrize(("g", "uniformity"), list(zip(GEOMETRIES, (0.05, 0.0, 0.05, 0.05, 0.05), strict=True)))
def test_a_pass_of_propagation_and_search_is_the_oracles(all_lanes, g, uniformity):
    oracle = None
    for device in all_lanes:
        matcher, buffers, target, exemplar, y, x = setup(device, g, 3, uniformity)
        matcher.improve(1, step=4)
        if oracle is None:
            weight = uniformity * _penalty_unit(exemplar, g)
            oracle = reference.Oracle(target, exemplar, g, y, x, reference.penalties(y, x, g, weight))
            oracle.one_pass(seed=5, step=64)
        found_y, found_x = matcher.field().yx
        np.testing.assert_array_equal(found_y, oracle.y)
        np.testing.assert_array_equal(found_x, oracle.x)


@pytest.mark.parametrize(("g", "rank"), list(zip(GEOMETRIES, (1, 2, 1, 2), strict=False)))
def test_a_pass_with_prices_of_offsets_is_the_oracles(all_lanes, g, rank):
    """Out of step costs what the table says, on a lattice that is sheared to close on the torus."""
    frequencies = np.array([[0.137, 0.031], [-0.043, 0.171]])[:rank]
    likeness = np.random.default_rng(6).random((64,) * rank)
    likeness.flat[0] = 1.0
    lattice = Lattice(frequencies, 9.0, likeness)
    in_step = InStep(lattice, lattice.on_torus(g), 0.4, origin=(3, 8))
    prices = in_step.prices((1, 1), (1, 1), g.patch, reference.VARIANCE)
    fields = []
    for device in all_lanes:
        matcher, _, target, exemplar, y, x = setup(device, g, 3, offset_prices=prices)
        matcher.improve(1, step=4)
        fields.append(matcher.field().yx)
    free = np.zeros((g.exemplar_rows, g.exemplar_columns), np.int64)
    oracle = reference.Oracle(target, exemplar, g, y, x, free, in_step)
    oracle.one_pass(seed=5, step=64)
    plain = reference.Oracle(target, exemplar, g, y, x, free)
    plain.one_pass(seed=5, step=64)
    for found_y, found_x in fields:
        np.testing.assert_array_equal(found_y, oracle.y)
        np.testing.assert_array_equal(found_x, oracle.x)
    assert (oracle.y != plain.y).mean() > 0.1  # the price decides


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
    any_lanes.write(matcher._buffers["field"], SourceMap.of(y, x).packed)
    source_y, source_x = matcher.pick().yx
    offset = np.arange(g.patch) - g.patch // 2
    fall = np.exp(-(offset**2) / (2.0 * PICK_SIGMA**2))
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
    g = pm.Geometry(24, 20, True, True, exemplar_width=31, exemplar_height=27, patch=5)
    opaque = np.ones((27, 31), bool)
    opaque[10:14, 8:20] = False
    allowed = pm.allowed_patches(opaque, g)
    field = pm.random_field(g, allowed, seed=3)
    exemplar = np.random.default_rng(0).integers(-300, 300, (27, 31, 3)).astype(np.int16)
    with Buffers(device, g.layout(), BUDGET, "test") as buffers:
        matcher = Matcher(device, buffers, g, exemplar, allowed, field, 0.05, 0)
        matcher.vote()
        matcher.improve(4, 0)
        y, x = matcher.field().yx
        source_y, source_x = matcher.pick().yx
    assert allowed[y, x].all()
    assert opaque[source_y, source_x].all()


def test_a_fair_share_is_one_of_the_pixels_that_may_be_used():
    g = pm.Geometry(40, 40, True, True, exemplar_width=30, exemplar_height=20, patch=5)
    exemplar = np.random.default_rng(0).integers(-300, 300, (20, 30, 3)).astype(np.int16)
    usable = np.zeros((20, 30), bool)
    usable[:, :10] = True
    alone = pm.Geometry(40, 40, True, True, exemplar_width=10, exemplar_height=20, patch=5)
    assert _penalty_unit(exemplar, g, usable) == _penalty_unit(exemplar[:, :10], alone)
    assert _penalty_unit(exemplar, g, usable) < 0.5 * _penalty_unit(exemplar, g)


def test_patchmatch_comes_close_to_the_exact_nearest_neighbors(device):
    g = pm.Geometry(40, 40, True, True, exemplar_width=44, exemplar_height=44, patch=5)
    matcher, buffers, _, exemplar, _, _ = setup(device, g, 7)
    smooth = np.cumsum(np.cumsum(exemplar.astype(np.int32) // 40, 0), 1).astype(np.int16)  # texture, not noise
    device.write(buffers["exemplar"], smooth)
    target = np.roll(smooth[:40, :40], (7, 9), (0, 1))
    device.write(buffers["image"], target)
    matcher.improve(MATCH_PASSES, 0)
    found = reference.distances(matcher).astype(np.float64)
    windows = np.lib.stride_tricks.sliding_window_view(smooth.astype(np.float64), (5, 5), (0, 1)).reshape(-1, 75)
    padded = np.pad(target.astype(np.float64), ((0, 4), (0, 4), (0, 0)), mode="wrap")
    patches = np.lib.stride_tricks.sliding_window_view(padded, (5, 5), (0, 1)).reshape(-1, 75)
    exact = ((patches**2).sum(1)[:, None] + (windows**2).sum(1)[None] - 2 * patches @ windows.T).min(1)
    assert found.mean() >= exact.mean() - 1e-6
    assert found.mean() <= 1.1 * exact.mean() + 1.0
    assert (np.abs(found.ravel() - exact) < 0.5).mean() > 0.9


def test_a_start_from_the_exemplar_is_whole_but_at_its_border_and_differs_by_seed():
    g = pm.Geometry(30, 40, True, True, exemplar_width=30, exemplar_height=40, patch=5)
    allowed = np.ones((g.exemplar_rows, g.exemplar_columns), bool)
    y, x = pm.shifted_field(g, allowed, 1).yx
    whole = (np.roll(x, -1, 1) - x == 1) & (np.roll(y, -1, 0) - y == 1)
    assert whole.mean() > (1 - 5 / 30) * (1 - 5 / 40) - 0.01
    shift = (y - np.arange(40)[:, None]) % 40, (x - np.arange(30)) % 30
    assert all((np.bincount(n.ravel()).max() / n.size) > 0.8 for n in shift)
    assert (pm.shifted_field(g, allowed, 2).packed != SourceMap.of(y, x).packed).any()


def test_a_start_of_a_larger_tile_shifts_each_piece_by_its_own_distance():
    g = pm.Geometry(80, 60, True, True, exemplar_width=40, exemplar_height=30, patch=5)
    y, x = pm.shifted_field(g, np.ones((g.exemplar_rows, g.exemplar_columns), bool), 1).yx
    shifts = {(int(y[r, c] - r) % 30, int(x[r, c] - c) % 40) for r in range(0, 60, 3) for c in range(0, 80, 3)
              if y[r, c] < g.exemplar_rows - 1 and x[r, c] < g.exemplar_columns - 1}  # fmt: skip
    assert len(shifts) == 4


def test_a_start_from_the_exemplar_has_only_allowed_patches_and_fills_what_it_is_given():
    g = pm.Geometry(24, 300, True, True, exemplar_width=31, exemplar_height=27, patch=5)
    opaque = np.ones((27, 31), bool)
    opaque[10:14, 8:20] = False
    allowed = pm.allowed_patches(opaque, g)
    place = np.zeros((g.rows, g.columns), np.uint32)
    field = pm.shifted_field(g, allowed, 3, place)
    assert allowed[field.yx].all()
    assert (place == field.packed).all()


def test_a_field_keeps_its_coherence_when_it_is_upsampled():
    coarse = pm.Geometry(20, 20, True, True, exemplar_width=30, exemplar_height=30, patch=5)
    fine = pm.Geometry(26, 26, True, True, exemplar_width=39, exemplar_height=39, patch=5)
    y, x = np.mgrid[0:20, 0:20]
    allowed = np.ones((fine.exemplar_rows, fine.exemplar_columns), bool)
    finer_y, finer_x = pm.upsample_field(SourceMap.of(y + 3, x + 2), coarse, fine, allowed, 0).yx
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


@pytest.mark.parametrize(
    ("domain", "shape", "text"),
    [
        (
            Domain(40, 30, True, True),
            (30, 36, 3),
            "lab is 30 x 36 x 3: expected 30 x 40 x 3",
        ),
        (Domain(36, 30, True, False), (30, 36, 3), "field is 30 x 36: expected 26 x 36"),
        (
            Domain(36, 30, True, True),
            (30, 36, 4),
            "lab is 30 x 36 x 4: expected 30 x 36 x 3",
        ),
    ],
)
def test_arrays_that_are_not_of_the_domains_size_are_refused(device, domain, shape, text):
    """Kernels would read beyond them, and end the process."""
    lab, exemplar = np.zeros(shape, np.float32), np.zeros((20, 24, 3), np.float32)
    with pytest.raises(ImageError, match=text):
        match_patches(device, lab, exemplar, SourceMap(np.zeros((30, 36), np.uint32)), 5, domain, 0, BUDGET)


def test_the_texture_cost_is_eq_5_for_the_given_matches(device):
    random = np.random.default_rng(0)
    lab, exemplar = (20 * random.random(shape).astype(np.float32) for shape in ((12, 14, 3), (20, 18, 3)))
    y, x = random.integers(0, 16, (12, 14)), random.integers(0, 14, (12, 14))
    total = 0.0
    for r in range(12):
        for c in range(14):
            here = lab[np.ix_(np.arange(r, r + 5) % 12, np.arange(c, c + 5) % 14)]
            total += ((here - exemplar[y[r, c] : y[r, c] + 5, x[r, c] : x[r, c] + 5]) ** 2).sum() / 25
    _, cost = match_patches(device, lab, exemplar, SourceMap.of(y, x), 5, Domain(14, 12, True, True), 0, BUDGET, 0)
    assert cost == pytest.approx(total / (12 * 14), rel=1e-3)


def test_a_matcher_refuses_arrays_that_are_not_of_its_geometry(device):
    g = GEOMETRIES[0]
    with Buffers(device, g.layout(), BUDGET, "test") as buffers:
        arrays = {
            "exemplar": np.zeros((g.exemplar_height, g.exemplar_width, 3), np.int16),
            "allowed": np.ones((g.exemplar_rows, g.exemplar_columns), bool),
            "field": SourceMap(np.zeros((g.rows, g.columns), np.uint32)),
        }
        Matcher(device, buffers, g, **arrays, uniformity=0.0, seed=0)
        for name, array in arrays.items():
            with pytest.raises(ImageError, match=f"{name} is"):
                Matcher(device, buffers, g, **arrays | {name: array[:-1]}, uniformity=0.0, seed=0)
