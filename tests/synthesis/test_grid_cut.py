# SPDX-License-Identifier: Apache-2.0
"""Cuts of a grid from coarse to fine, against exact ones and against the cost of every edge; costs of edges."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, gaussian_filter

from oiiotex.synthesis.graphcut import seams


def random_grid(seed: int, height: int, width: int) -> seams.GridCut:
    """Costs of a smooth picture with noise, and pixels that are drawn to either choice."""
    random = np.random.default_rng(seed)
    free, lean = random.random((height, width)) < 0.9, np.zeros((height, width), np.int64)
    lean[[0, -1]], lean[height // 3 : height // 2, width // 3 : width // 2] = 400, -900
    lean += (random.integers(-60, 60, lean.shape) * (random.random(lean.shape) < 0.2)).astype(np.int64)
    arcs = []
    for step in seams.NEIGHBORS:
        s, t = seams.ends_of(step)
        both, smooth = free[s] & free[t], gaussian_filter(random.random(free.shape), 2)[s] * 400
        begins, ends = (np.where(both, smooth + random.integers(0, 60, both.shape), 0).astype(np.int64) for _ in "ab")
        arcs.append((begins, ends))
    return seams.GridCut(free, lean, arcs)


def cut_in_band(grid: seams.GridCut) -> np.ndarray:
    return seams.PatchCut(np.zeros(grid.free.shape, bool), 0, grid).banded()


def grid_cost(grid: seams.GridCut, choice: np.ndarray) -> int:
    """What a choice costs, edge by edge."""
    total = int(grid.lean[grid.free & choice].sum())
    for (dy, dx), (begins, ends) in zip(seams.NEIGHBORS, grid.arcs, strict=True):
        for y, x in np.ndindex(begins.shape):
            first, second = choice[y, x], choice[y + dy, x + dx]
            total += int(begins[y, x]) * bool(second and not first) + int(ends[y, x]) * bool(first and not second)
    return total


@pytest.mark.parametrize("shape", [(40, 47), (35, 60)])
def test_cuts_from_coarse_to_fine_cost_little_more(shape, monkeypatch):
    exact, banded, narrow = 0, 0, 0
    for seed in range(4):
        grid = random_grid(seed, *shape)
        lowest = -int(np.abs(grid.lean[grid.free & (grid.lean < 0)]).sum())  # of any choice
        choices = [grid.chosen(), cut_in_band(grid)]
        assert all(grid.cost(choice) == grid_cost(grid, choice) for choice in choices)
        monkeypatch.setattr(seams, "BAND", 1)
        choices.append(cut_in_band(grid))
        monkeypatch.undo()
        assert not any((choice & ~grid.free).any() for choice in choices)
        one, other, least = (grid_cost(grid, choice) - lowest for choice in choices)
        assert one <= other <= least
        exact, banded, narrow = exact + one, banded + other, narrow + least
    assert exact <= banded < 1.01 * exact and banded < narrow


def test_a_band_that_holds_everything_is_the_exact_cut(monkeypatch):
    grid = random_grid(5, 40, 40)
    monkeypatch.setattr(seams, "BAND", 40)
    np.testing.assert_array_equal(cut_in_band(grid), grid.chosen())


def test_half_a_grid_costs_at_most_the_same_choice_in_full():
    """The border of two squares may move to the cheaper line."""
    for seed, shape in enumerate([(12, 14), (13, 15)]):
        grid, random = random_grid(seed, *shape), np.random.default_rng(seed)
        half = grid.half
        assert half.free.shape == ((shape[0] + 1) // 2, (shape[1] + 1) // 2)
        for _ in range(20):
            coarse = (random.random(half.free.shape) < 0.5) & half.free
            fine = coarse.repeat(2, 0).repeat(2, 1)[: shape[0], : shape[1]] & grid.free
            inside = [half.free[s] & half.free[t] for s, t in map(seams.ends_of, seams.NEIGHBORS)]
            assert all((arc[~both] == 0).all() for arcs, both in zip(half.arcs, inside, strict=True) for arc in arcs)
            assert grid_cost(half, coarse) <= grid_cost(grid, fine)


@pytest.mark.parametrize("by", [1, 3])
def test_a_band_grows_to_all_sides(by):
    mask, square = np.random.default_rng(by).random((30, 41)) < 0.02, np.ones((2 * by + 1, 2 * by + 1))
    expected = binary_dilation(mask, square) & binary_dilation(~mask, square)
    np.testing.assert_array_equal(seams.near_border(mask, by), expected)


@pytest.mark.parametrize("seed", range(6))
def test_costs_across_edges_are_those_of_each_way(seed):
    """Also at old seams, at seams inside of the patch, where both agree, and beyond the photo."""
    random = np.random.default_rng(seed)
    source = seams.SeamPhoto(random.integers(-300, 900, (20, 24, 3)).astype(np.int16))
    places, patch = (np.indices((9, 11)) + random.integers(-3, 18, (2, 1, 1)) for _ in range(2))
    if seed % 2:
        patch = places.copy()
        patch[:, 4:] -= 1
    places[:, :, 6:] += 3
    filled, covers = (random.random((9, 11)) < 0.8 for _ in range(2))
    old, new = (places, filled), (patch, covers)
    expected = zip(*(seams.seam_costs(source, *each) for each in (old, (*old, *new), (*new, *old))), strict=True)
    for made, plain in zip(seams.crossing_costs(source, *old, *new), expected, strict=True):
        for one, other in zip(made, plain, strict=True):
            np.testing.assert_array_equal(one, other)
