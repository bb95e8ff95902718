# SPDX-License-Identifier: Apache-2.0
"""cl/quilting.cl against tests/reference/quilting.py, to the bit, and what a plan promises."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from oiiotex.analysis import regions
from oiiotex.errors import ImageError
from oiiotex.synthesis import quilting
from oiiotex.synthesis.plans import NONE, Grid, Plan, Renderer
from oiiotex.windows import Window
from tests import pictures
from tests.reference.quilting import Oracle

BUDGET = 1 << 30


def exemplar(grid: Grid, labels: np.ndarray | None = None, height: int = 45, width: int = 53) -> quilting.Exemplar:
    random = np.random.default_rng(1)
    lab = (pictures.pebbles(height, width, 3) * 400 + random.integers(-40, 40, (height, width, 3))).astype(np.int16)
    labels = np.ones((height, width), np.uint8) if labels is None else labels
    table = regions.content_table(*regions.window_keys(labels, grid.patch), grid.patch, grid.step)
    return quilting.Exemplar(lab, table)


def sewn(device, grid: Grid, rules: quilting.Rules, found: quilting.Exemplar | None = None, keys=None, **more):
    found = found or exemplar(grid)
    demand = quilting.Demand(np.zeros(grid.shape, np.int32) if keys is None else keys)
    return quilting.Quilt(device, found, grid, demand, rules, BUDGET, **more)


GRIDS = [
    Grid(50, 41, 12, 4),
    Grid(50, 41, 13, 4, True, False),
    Grid(37, 44, 16, 5, False, True),
    Grid(41, 39, 16, 4, True, True),
    Grid(17, 16, 16, 4, True, True),
    Grid(5, 7, 12, 4),
]


@pytest.mark.parametrize("grid", GRIDS, ids=str)
@pytest.mark.parametrize("reuse", [1.0, 3.0])
def test_the_plan_is_the_oracles(any_lanes, grid, reuse):
    rules = quilting.Rules(seed=7, candidates=24, reach=2, reuse=reuse)
    found = exemplar(grid)
    quilt = sewn(any_lanes, grid, rules, found)
    plan = quilt.finished()
    keys = np.zeros(grid.shape, int)
    oracle = Oracle(found.lab, grid, found.table, keys, quilting.caps(found.table, keys, reuse), rules)
    expected = oracle.run()
    np.testing.assert_array_equal(plan.offsets, expected.offsets)
    np.testing.assert_array_equal(plan.vertical, expected.vertical)
    np.testing.assert_array_equal(plan.horizontal, expected.horizontal)
    places = np.array([[oracle.source(y, x) for x in range(grid.width)] for y in range(grid.height)])
    expected = places[..., 0] * found.lab.shape[1] + places[..., 1]
    np.testing.assert_array_equal(quilt.sources(Window(0, 0, grid.width, grid.height)), expected)


def test_all_offsets_are_tried_where_they_are_few(any_lanes):
    grid = Grid(40, 40, 12, 4)
    found = exemplar(grid, height=16, width=17)
    rules = quilting.Rules(seed=3, candidates=64, reach=0, reuse=9.0)
    oracle = Oracle(found.lab, grid, found.table, np.zeros(grid.shape, int), np.array([10**6]), rules)
    tried = oracle.candidates(1, 2, 0)
    assert set(tried[:30]) == set(found.table.offsets.tolist()) and tried[30:] == [None] * 34
    np.testing.assert_array_equal(sewn(any_lanes, grid, rules, found).finished().offsets, oracle.run().offsets)


def test_no_region_is_used_more_often_than_its_cap(any_lanes):
    grid = Grid(400, 300, 12, 4)
    for reuse in (1.0, 2.0):
        quilt = sewn(any_lanes, grid, quilting.Rules(reuse=reuse, candidates=16))
        plan = quilt.finished()
        uses, cap = quilt.used()
        assert (uses <= cap).all() and uses.sum() == plan.offsets.size
        blocks = (plan.offsets >> 16) // grid.step * 100 + (plan.offsets & 0xFFFF) // grid.step
        counted = np.unique(blocks, return_counts=True)[1]
        assert counted.max() == uses.max() and counted.max() <= np.ceil(reuse * plan.offsets.size / len(uses))


def test_cells_have_the_keys_that_are_asked_for(any_lanes):
    grid = Grid(90, 60, 12, 4)
    labels = np.where(np.indices((45, 53))[1] < 26, 1, 2).astype(np.uint8)
    found = exemplar(grid, labels)
    assert found.table.keys.tolist() == [[1, 1], [1, 2], [2, 1], [2, 2]]
    keys = np.random.default_rng(0).integers(0, 4, grid.shape).astype(np.int32)
    offsets = sewn(any_lanes, grid, quilting.Rules(candidates=16), found, keys).finished().offsets
    for (i, j), at in np.ndenumerate(offsets):
        counts = regions.histogram(labels, int(at >> 16), int(at & 0xFFFF), grid.patch)
        assert list(regions.key_of(counts)) == found.table.keys[keys[i, j]].tolist()


@pytest.mark.parametrize("grid", GRIDS[:4], ids=str)
def test_any_window_at_any_time_is_the_whole_cropped(device, grid):
    rules = quilting.Rules(seed=2, candidates=16)
    whole = Window(0, 0, grid.width, grid.height)
    expected = sewn(device, grid, rules).sources(whole)
    random = np.random.default_rng(0)
    for pixels in (7, 1000):
        quilt = sewn(device, grid, rules, pixels=max(pixels, grid.width))
        for _ in range(12):
            left, right = np.sort(random.choice(grid.width + 1, 2, replace=False)).tolist()
            top, bottom = np.sort(random.choice(grid.height + 1, 2, replace=False)).tolist()
            window = Window(left, top, right, bottom)
            np.testing.assert_array_equal(quilt.sources(window), expected[window.inside(whole)])


def test_the_first_rows_do_not_wait_for_the_last(device):
    for tile in itertools.product((False, True), repeat=2):
        grid = Grid(60, 200, 12, 4, *tile)
        quilt = sewn(device, grid, quilting.Rules(candidates=4))
        quilt.sources(Window(0, 0, 60, 8))
        assert 0 < quilt.done < quilt.waves // 2


def test_a_torus_closes_as_well_as_it_is_sewn_inside(device):
    """Jumps across the borders are no larger than those at other seams; without wrapping they are."""
    found = exemplar(Grid(240, 240, 16, 4), height=100, width=100)

    def jumps(tile: bool) -> np.ndarray:
        grid = Grid(240, 240, 16, 4, tile, tile)
        source = sewn(device, grid, quilting.Rules(seed=1), found).sources(Window(0, 0, 240, 240))
        image = found.lab[source // 100, source % 100].astype(int)
        across = [np.abs(np.roll(image, -1, axis) - image).sum(-1).mean(1 - axis) for axis in (0, 1)]
        return np.array([a[-1] / a[:-1].mean() for a in across])

    assert (jumps(True) < 1.25).all()
    assert (jumps(False) > 1.4).all()


def test_what_is_decided_stays_and_only_its_surroundings_are_cut_anew(device):
    grid = Grid(160, 140, 16, 4)
    found = exemplar(grid, height=80, width=90)
    first = sewn(device, grid, quilting.Rules(seed=1), found).finished()
    whole = Window(0, 0, 160, 140)
    old = sewn(device, grid, quilting.Rules(seed=1), found).sources(whole)
    offsets = first.offsets.copy()
    offsets[4:6, 5:8] = NONE
    again = sewn(
        device, grid, quilting.Rules(seed=9), found, plan=Plan(grid, offsets, first.vertical, first.horizontal)
    )
    new, plan = again.sources(whole), again.finished()
    kept = np.ones(grid.shape, bool)
    kept[4:6, 5:8] = False
    np.testing.assert_array_equal(plan.offsets[kept], first.offsets[kept])
    assert (plan.offsets[~kept] != first.offsets[~kept]).any()
    y, x = np.nonzero(old != new)
    assert len(y) and y.min() >= 4 * 12 and y.max() < 6 * 12 + 4 and x.min() >= 5 * 12 and x.max() < 8 * 12 + 4
    uses, _ = again.used()
    assert uses.sum() == offsets.size


def test_a_saved_plan_gives_the_same_pixels(device, tmp_path):
    grid = Grid(61, 47, 12, 4, True, True)
    quilt = sewn(device, grid, quilting.Rules(candidates=8))
    quilt.finished().save(tmp_path / "plan.npz", (53, 45))
    plan, size = Plan.load(tmp_path / "plan.npz")
    assert size == (53, 45) and plan.grid == grid
    window = Window(5, 3, 61, 47)
    made = Renderer.of(device, plan, 53, BUDGET)
    np.testing.assert_array_equal(made.sources(window), quilt.sources(window))


def test_what_is_no_plan_is_refused(device, tmp_path):
    path = tmp_path / "plan.npz"
    with pytest.raises(ImageError, match="no plan can be read"):
        Plan.load(path)
    path.write_bytes(b"PK nonsense")
    with pytest.raises(ImageError, match="no plan can be read"):
        Plan.load(path)
    grid = Grid(61, 47, 12, 4)
    plan = sewn(device, grid, quilting.Rules(candidates=8)).finished()
    plan.offsets[2, 3] = 40 << 16 | 3  # would read below the exemplar
    plan.save(path, (53, 45))
    with pytest.raises(ImageError, match="is no whole plan"):
        Plan.load(path)


def test_wide_grids_are_the_same_from_any_order_of_waves():
    order, waves = Grid(100, 90, 12, 4).waves()
    rows, columns = Grid(100, 90, 12, 4).shape
    assert sorted(order.tolist()) == list(range(rows * columns)) and waves[-1] == rows * columns
    place = np.empty(rows * columns, int)
    place[order] = np.repeat(np.arange(len(waves) - 1), np.diff(waves))
    place = place.reshape(rows, columns)
    assert (place[1:, :-1] > place[:-1, 1:]).all() and (place[:, 1:] > place[:, :-1]).all()


def test_a_tile_smaller_than_a_patch_is_refused():
    with pytest.raises(ImageError, match="at least as wide as a patch, 16 px; it is 15"):
        Grid(15, 40, 16, 4, True, False)


def test_lanes_do_not_show_in_labels_and_guides(device, narrow_device):
    grid = Grid(150, 120, 16, 5, True, True)
    labels = np.where(np.indices((45, 53))[1] < 26, 1, 2).astype(np.uint8)
    plain = exemplar(grid, labels)
    fine = quilting.folded(np.indices((45, 53)).sum(0) // 5 + 250)
    found = quilting.Exemplar(plain.lab, plain.table, (fine, quilting.folded(labels)), labels)
    random = np.random.default_rng(0)
    keys = random.integers(0, len(plain.table.keys), grid.shape).astype(np.int32)
    guide = random.integers(0, 3, (*grid.shape, quilting.GUIDE, quilting.GUIDE)).astype(np.uint16)
    made = [
        quilting.Quilt(d, found, grid, quilting.Demand(keys, guide), quilting.Rules(candidates=32), BUDGET).finished()
        for d in (device, narrow_device)
    ]
    for name in ("offsets", "vertical", "horizontal"):
        np.testing.assert_array_equal(getattr(made[0], name), getattr(made[1], name))


def test_labels_past_the_bins_share_one_and_none_stays_apart():
    assert quilting.folded(np.array([0, 1, 255, 256, 511])).tolist() == [0, 1, 255, 1, 1]
