# SPDX-License-Identifier: Apache-2.0
"""cl/quilting.cl against tests/reference/quilting.py, to the bit, and what a plan promises."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from oiiotex.analysis.labels import content_table
from oiiotex.analysis.regularity.lattice import BINS, Lattice
from oiiotex.analysis.regularity.offset_prices import InStep
from oiiotex.engine.core.source_map import NONE
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import ImageError
from oiiotex.synthesis.quality.copy_detection import most_shown
from oiiotex.synthesis.quilting import quilter
from oiiotex.synthesis.quilting.quilt_plan import Grid, QuiltPlan, Renderer
from oiiotex.synthesis.quilting.repetition import UNITS, PatchSquares
from tests import pictures
from tests.reference.quilting import Oracle

BUDGET = 1 << 30


def exemplar(grid: Grid, labels: np.ndarray | None = None, height: int = 45, width: int = 53) -> quilter.QuiltExemplar:
    random = np.random.default_rng(1)
    lab = (pictures.pebbles(height, width, 3) * 400 + random.integers(-40, 40, (height, width, 3))).astype(np.int16)
    labels = np.ones((height, width), np.uint8) if labels is None else labels
    table = content_table.content_table(*content_table.window_keys(labels, grid.patch), grid.patch)
    return quilter.QuiltExemplar(lab, table)


def sewn(device, grid: Grid, rules: quilter.Rules, found: quilter.QuiltExemplar | None = None, keys=None, **more):
    found = found or exemplar(grid)
    demand = quilter.Demand(np.zeros(grid.shape, np.int32) if keys is None else keys)
    return quilter.Quilt(device, found, grid, demand, rules, BUDGET, **more)


def kept(grid: Grid, frequencies: list[list[float]], structure: float) -> InStep:
    u = np.cos(2 * np.pi * np.arange(BINS) / BINS)
    likeness = u if len(frequencies) == 1 else u[:, None] + 0.5 * u
    lattice = Lattice(np.array(frequencies), 9.0, likeness)
    return InStep(lattice, lattice.on_torus(grid), structure)


GRIDS = [
    Grid(50, 41, patch=12, overlap=4),
    Grid(50, 41, True, False, patch=13, overlap=4),
    Grid(37, 44, False, True, patch=16, overlap=5),
    Grid(41, 39, True, True, patch=16, overlap=4),
    Grid(17, 16, True, True, patch=16, overlap=4),
    Grid(5, 7, patch=12, overlap=4),
]


@pytest.mark.parametrize(
    ("grid", "reuse", "structure"),  # all rules on each kind of plane
    [(GRIDS[0], 1.0, 0.5), (GRIDS[1], 1.0, 0.0), (GRIDS[2], 1.0, 0.5), (GRIDS[3], 1.0, 0.5), (GRIDS[3], 0.0, 0.0),
     (GRIDS[4], 1.0, 0.0), (GRIDS[5], 0.0, 0.0)],
    ids=str,
)  # fmt: skip
def test_the_plan_is_the_oracles(all_lanes, grid, reuse, structure):
    rules = quilter.Rules(seed=7, candidates=24, reach=2, reuse=reuse)
    found = exemplar(grid)
    in_step = kept(grid, [[1 / 7.3, 0.02], [-0.03, 1 / 9.1]], structure) if structure else None
    quilts = [sewn(device, grid, rules, found, in_step=in_step) for device in all_lanes]
    keys = np.zeros(grid.shape, int)
    oracle = Oracle(found.lab, grid, found.table, keys, rules, *map(int, quilts[0]._units[2:]), in_step)
    expected = oracle.run()
    places = np.array([[oracle.source(y, x) for x in range(grid.width)] for y in range(grid.height)])
    for quilt in quilts:
        plan = quilt.finished()
        np.testing.assert_array_equal(plan.offsets, expected.offsets)
        np.testing.assert_array_equal(plan.vertical, expected.vertical)
        np.testing.assert_array_equal(plan.horizontal, expected.horizontal)
        source = quilt.sources(Window(0, 0, grid.width, grid.height))
        np.testing.assert_array_equal(np.stack(source.yx, -1), places)


def test_all_offsets_are_tried_where_they_are_few(any_lanes):
    grid = Grid(40, 40, patch=12, overlap=4)
    found = exemplar(grid, height=16, width=17)
    rules = quilter.Rules(seed=3, candidates=64, reach=0)
    quilt = sewn(any_lanes, grid, rules, found)
    oracle = Oracle(found.lab, grid, found.table, np.zeros(grid.shape, int), rules, int(quilt._units[2]))
    tried = oracle.candidates(1, 2, 0)
    assert set(tried[:30]) == set(found.table.offsets.tolist()) and tried[30:] == [None] * 34
    np.testing.assert_array_equal(quilt.finished().offsets, oracle.run().offsets)


@pytest.mark.parametrize(("side", "most"), [(128, 3.0), (256, 1.5 * 4)])
def test_no_region_is_seen_again_and_again(device, side, most):
    """By the pixels that are shown: 32 x 32 px at most three times in as much as the exemplar, else 1.5 times fair."""
    grid = Grid(side, side, True, True, patch=16, overlap=4)
    lab = (pictures.pebbles(128, 128, 3) * 400).astype(np.int16)
    table = content_table.content_table(*content_table.window_keys(np.ones((128, 128), np.uint8), 16), 16)
    shown = {}
    for reuse in (1.0, 1e9):
        quilt = sewn(device, grid, quilter.Rules(reuse=reuse), quilter.QuiltExemplar(lab, table))
        shown[reuse] = most_shown(quilt.sources(Window(0, 0, side, side)), (128, 128))[0]
    assert shown[1.0] <= most < shown[1e9]


def test_patches_are_in_step_with_the_exemplar(device):
    grid = Grid(160, 144, True, True, patch=16, overlap=4)
    found = exemplar(grid, height=90, width=100)
    for frequencies in ([[1 / 16, 0.0], [0.0, 1 / 12]], [[0.05, 0.0625]]):
        off = {}
        for structure in (0.0, 1.0):
            in_step = kept(grid, frequencies, structure)
            offsets = sewn(device, grid, quilter.Rules(seed=2), found, in_step=in_step).finished().offsets
            y, x = offsets >> 16, offsets & 0xFFFF
            away = np.stack([x - grid.xs, y - grid.ys[:, None]], -1) @ in_step.lattice.frequencies.T
            off[structure] = np.abs(away - np.rint(away)).max()
        assert off[1.0] < 0.2 and off[0.0] > 0.3, off


def test_shares_are_even_over_what_a_key_can_show():
    grid = Grid(120, 90, patch=12, overlap=4)
    labels = np.where(np.indices((45, 53))[1] < 26, 1, 2).astype(np.uint8)
    table = exemplar(grid, labels).table
    keys = np.full(grid.shape, table.nearest((1, 1)), np.int32)
    squares = PatchSquares.of(grid, 45, 53)
    spans = squares.spans(table, keys, 1.0)
    shares = squares.shares(table.offsets, spans, keys, 1.0)
    can = table.offsets[slice(*spans[keys[0, 0], :2])]
    assert len(set(shares[squares.shown(can) > 0])) == 1 and not shares[squares.shown(can) == 0].any()
    assert abs(shares.sum() / UNITS - keys.size * squares.count**2) < 0.01 * keys.size * squares.count**2
    assert squares.shown(can[[0, 0, 5]]).sum() == 3 * squares.count**2


def test_cells_have_the_keys_that_are_asked_for(any_lanes):
    grid = Grid(90, 60, patch=12, overlap=4)
    labels = np.where(np.indices((45, 53))[1] < 26, 1, 2).astype(np.uint8)
    found = exemplar(grid, labels)
    assert found.table.keys.tolist() == [[1, 1], [1, 2], [2, 1], [2, 2]]
    keys = np.random.default_rng(0).integers(0, 4, grid.shape).astype(np.int32)
    offsets = sewn(any_lanes, grid, quilter.Rules(candidates=16), found, keys).finished().offsets
    for (i, j), at in np.ndenumerate(offsets):
        counts = content_table.histogram(labels, int(at >> 16), int(at & 0xFFFF), grid.patch)
        assert list(content_table.key_of(counts)) == found.table.keys[keys[i, j]].tolist()


def test_a_label_of_few_patches_takes_mixed_ones(any_lanes):
    """Those in which it dominates, by the oracle's rules; without a reuse penalty its own few are repeated."""
    grid = Grid(100, 84, patch=12, overlap=4)
    y, x = np.indices((45, 53))
    labels = np.where((np.abs(y - 22) < 8) & (np.abs(x - 26) < 9), 2, 1).astype(np.uint8)
    found = exemplar(grid, labels)
    keys = np.full(grid.shape, found.table.nearest((2, 2)), np.int32)
    shown, mixed = {}, {}
    for reuse in (1.0, 1e9):
        rules = quilter.Rules(seed=4, candidates=24, reach=2, reuse=reuse)
        quilt = sewn(any_lanes, grid, rules, found, keys)
        offsets = quilt.finished().offsets
        np.testing.assert_array_equal(
            offsets, Oracle(found.lab, grid, found.table, keys, rules, int(quilt._units[2])).run().offsets
        )
        first, second = (found.table.keys[found.table.key_map[offsets >> 16, offsets & 0xFFFF], n] for n in (0, 1))
        assert (first == 2).all()
        shown[reuse] = np.bincount(quilt.sources(Window(0, 0, 100, 84)).flat(53).ravel()).max()
        mixed[reuse] = (second == 1).any()
    assert mixed == {1.0: True, 1e9: False} and shown[1.0] < 0.7 * shown[1e9], shown


@pytest.mark.parametrize("grid", GRIDS[:4], ids=str)
def test_any_window_at_any_time_is_the_whole_cropped(device, grid):
    rules = quilter.Rules(seed=2, candidates=16)
    whole = Window(0, 0, grid.width, grid.height)
    expected = sewn(device, grid, rules).sources(whole).packed
    random = np.random.default_rng(0)
    for pixels in (7, 1000):
        quilt = sewn(device, grid, rules, pixels=max(pixels, grid.width))
        for _ in range(12):
            left, right = np.sort(random.choice(grid.width + 1, 2, replace=False)).tolist()
            top, bottom = np.sort(random.choice(grid.height + 1, 2, replace=False)).tolist()
            window = Window(left, top, right, bottom)
            np.testing.assert_array_equal(quilt.sources(window).packed, expected[window.inside(whole)])


def test_the_first_rows_do_not_wait_for_the_last(device):
    for tile in itertools.product((False, True), repeat=2):
        grid = Grid(60, 200, *tile, patch=12, overlap=4)
        quilt = sewn(device, grid, quilter.Rules(candidates=4))
        quilt.sources(Window(0, 0, 60, 8))
        assert 0 < quilt.waves_decided < quilt.waves // 2


def test_a_torus_closes_as_well_as_it_is_sewn_inside(device):
    """Jumps across the borders are no larger than those at other seams; without wrapping they are."""
    found = exemplar(Grid(240, 240, patch=16, overlap=4), height=100, width=100)

    def jumps(tile: bool) -> np.ndarray:
        grid = Grid(240, 240, tile, tile, patch=16, overlap=4)
        source = sewn(device, grid, quilter.Rules(seed=1), found).sources(Window(0, 0, 240, 240))
        image = source.gather(found.lab).astype(int)
        across = [np.abs(np.roll(image, -1, axis) - image).sum(-1).mean(1 - axis) for axis in (0, 1)]
        return np.array([a[-1] / a[:-1].mean() for a in across])

    assert (jumps(True) < 1.25).all()
    assert (jumps(False) > 1.4).all()


def test_what_is_decided_stays_and_only_its_surroundings_are_cut_anew(device):
    grid = Grid(160, 140, patch=16, overlap=4)
    found = exemplar(grid, height=80, width=90)
    first = sewn(device, grid, quilter.Rules(seed=1), found).finished()
    whole = Window(0, 0, 160, 140)
    old = sewn(device, grid, quilter.Rules(seed=1), found).sources(whole).packed
    offsets = first.offsets.copy()
    offsets[4:6, 5:8] = NONE
    again = sewn(
        device, grid, quilter.Rules(seed=9), found, plan=QuiltPlan(grid, offsets, first.vertical, first.horizontal)
    )
    new, plan = again.sources(whole).packed, again.finished()
    kept = np.ones(grid.shape, bool)
    kept[4:6, 5:8] = False
    np.testing.assert_array_equal(plan.offsets[kept], first.offsets[kept])
    assert (plan.offsets[~kept] != first.offsets[~kept]).any()
    y, x = np.nonzero(old != new)
    assert len(y) and y.min() >= 4 * 12 and y.max() < 6 * 12 + 4 and x.min() >= 5 * 12 and x.max() < 8 * 12 + 4
    squares = PatchSquares.of(grid, 80, 90)
    shown = device.read(again._buffers["shown"], (squares.rows, squares.columns), np.int32)
    np.testing.assert_array_equal(shown, squares.shown(plan.offsets.ravel()))


def test_a_saved_plan_gives_the_same_pixels(device, tmp_path):
    grid = Grid(61, 47, True, True, patch=12, overlap=4)
    quilt = sewn(device, grid, quilter.Rules(candidates=8))
    np.savez_compressed(tmp_path / "plan.npz", **quilt.finished().arrays((53, 45)))
    plan, size = QuiltPlan.load(tmp_path / "plan.npz", BUDGET)
    assert size == (53, 45) and plan.grid == grid
    window = Window(5, 3, 61, 47)
    made = Renderer.of(device, plan, BUDGET)
    np.testing.assert_array_equal(made.sources(window).packed, quilt.sources(window).packed)


def test_what_is_no_plan_is_refused(device, tmp_path):
    path = tmp_path / "plan.npz"
    with pytest.raises(ImageError, match="cannot read arrays"):
        QuiltPlan.load(path, BUDGET)
    path.write_bytes(b"PK nonsense")
    with pytest.raises(ImageError, match="cannot read arrays"):
        QuiltPlan.load(path, BUDGET)
    grid = Grid(61, 47, patch=12, overlap=4)
    plan = sewn(device, grid, quilter.Rules(candidates=8)).finished()
    broken = plan.arrays((53, 45))
    for name, at, value in (
        ("offsets", (2, 3), 40 << 16 | 3),  # would read below the exemplar
        ("vertical", (1, 0, 5), 1),  # would show a patch to the left of the first one
        ("horizontal", (0, 2, 0), 3),
    ):
        array = broken[name].copy()
        array[at] = value
        np.savez_compressed(path, **broken | {name: array})
        with pytest.raises(ImageError, match="is not a complete plan"):
            QuiltPlan.load(path, BUDGET)


def test_wide_grids_are_the_same_from_any_order_of_waves():
    order, waves = Grid(100, 90, patch=12, overlap=4).waves()
    rows, columns = Grid(100, 90, patch=12, overlap=4).shape
    assert sorted(order.tolist()) == list(range(rows * columns)) and waves[-1] == rows * columns
    place = np.empty(rows * columns, int)
    place[order] = np.repeat(np.arange(len(waves) - 1), np.diff(waves))
    place = place.reshape(rows, columns)
    assert (place[1:, :-1] > place[:-1, 1:]).all() and (place[:, 1:] > place[:, :-1]).all()


def test_a_tile_smaller_than_a_patch_is_refused():
    with pytest.raises(ImageError, match=r"15 px.* 16 px"):
        Grid(15, 40, True, False, patch=16, overlap=4)


def test_lanes_do_not_show_in_labels_and_guides(device, narrow_device):
    grid = Grid(150, 120, True, True, patch=16, overlap=5)
    labels = np.where(np.indices((45, 53))[1] < 26, 1, 2).astype(np.uint8)
    plain = exemplar(grid, labels)
    fine = quilter.folded(np.indices((45, 53)).sum(0) // 5 + 250)
    found = quilter.QuiltExemplar(plain.lab, plain.table, (fine, quilter.folded(labels)), labels)
    random = np.random.default_rng(0)
    keys = random.integers(0, len(plain.table.keys), grid.shape).astype(np.int32)
    demand = quilter.Demand(keys, random.integers(0, 3, (*grid.shape, quilter.GUIDE, quilter.GUIDE)).astype(np.uint16))
    in_step, rules = kept(grid, [[0.04, 0.13]], 1.0), quilter.Rules(candidates=32)
    made = [
        quilter.Quilt(d, found, grid, demand, rules, BUDGET, in_step=in_step).finished()
        for d in (device, narrow_device)
    ]
    for name in ("offsets", "vertical", "horizontal"):
        np.testing.assert_array_equal(getattr(made[0], name), getattr(made[1], name))


def test_labels_past_the_bins_share_one_and_none_stays_apart():
    assert quilter.folded(np.array([0, 1, 255, 256, 511])).tolist() == [0, 1, 255, 1, 1]
