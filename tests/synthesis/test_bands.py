# SPDX-License-Identifier: Apache-2.0
"""A synthesis has the same bits in whatever bands its rows pass through the device, and wherever they lie meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from oiiotex.analysis.regularity.lattice import Lattice
from oiiotex.analysis.regularity.offset_prices import InStep
from oiiotex.engine.core.scratch import RowStore
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.errors import Interrupted
from oiiotex.engine.io.checkpoint import Checkpoint
from oiiotex.synthesis.patchmatch import exemplar_rows, memory, optimization
from oiiotex.synthesis.patchmatch.constraints import Constraints, FixedPixels
from oiiotex.synthesis.patchmatch.exemplar_rows import piece_halo
from oiiotex.synthesis.patchmatch.level_rows import halo
from oiiotex.synthesis.patchmatch.matcher import Matcher
from oiiotex.synthesis.patchmatch.optimization import Synthesis, synthesize
from oiiotex.synthesis.patchmatch.recipe import Recipe
from tests import pictures

WIDTH, HEIGHT = 70, 74  # two levels
PLAIN = {"sigma": 8.0, "patch": 7, "iterations": 2, "seed": 3, "uniformity": 0.01, "contrast": 0.7, "flat": True}
LAB = (100 * pictures.stained(pictures.bricks(66, 62, 1)) - np.array([0, 40, 40])).astype(np.float32)
MASK = np.ones(LAB.shape[:2], bool)
MASK[20:44, 30:56] = False
KEPT = np.zeros((HEIGHT, WIDTH), bool)
KEPT[:, :26], KEPT[60:] = True, True
FIXED = FixedPixels(KEPT, SourceMap.of(np.arange(HEIGHT)[:, None] % 66, np.arange(WIDTH) % 62))
SIGMAS = np.geomspace(4, 9, WIDTH)[None].repeat(HEIGHT, 0).astype(np.float32)
WEIGHT = np.random.default_rng(0).random(LAB.shape[:2]).astype(np.float32)
REPEATED = np.tile(LAB[:20, :19], (3, 3, 1))  # patches of one distance lie in many places
MATERIAL = np.concatenate([LAB, LAB[::-1] * np.float32(0.7)], -1)  # two maps


def recipe(tile: str = "xy", **more: object) -> Recipe:
    return Recipe.tiling(WIDTH, HEIGHT, tile, **PLAIN | {"complete": True} | more)


def in_step(tile: str) -> Recipe:
    lattice = Lattice(np.array([[0.061, 0.013], [-0.017, 0.083]]), 9.0, np.random.default_rng(6).random((64, 64)))
    own = recipe(tile)
    return replace(own, in_step=InStep(lattice, lattice.on_torus(own), 0.5, origin=(3, 8)))


CASES = {
    **{f"tile={tile}": (recipe(tile), {}) for tile in ("xy", "x", "y", "none")},
    "a small sigma": (recipe(sigma=1.7), {}),
    "a small sigma on a plane": (recipe("x", sigma=2.2), {}),
    "two moments": (recipe(measure="moments", order=2), {}),
    "four moments on a plane": (recipe("x", measure="moments", order=4), {}),
    "moments of a small sigma": (recipe(measure="moments", order=3, sigma=1.7), {}),
    "moments of a small sigma on a plane": (recipe("x", measure="moments", order=2, sigma=2.2), {}),
    "steerable": (recipe(measure="steerable"), {}),
    "steerable on a plane": (recipe("x", measure="steerable"), {}),
    "steerable of a small sigma": (recipe(measure="steerable", sigma=2.0), {}),
    "prices of offsets": (in_step("xy"), {}),
    "prices of offsets on a plane": (in_step("none"), {}),
    "a mask": (recipe(), {"allowed": MASK}),
    "a mask, steerable": (recipe(measure="steerable"), {"allowed": MASK}),
    "pixels that stay": (recipe("none", complete=False), {"fixed": FIXED}),
    "pixels that stay, steerable": (recipe("y", complete=False, measure="steerable"), {"fixed": FIXED}),
    "weights": (recipe(), {"weight": WEIGHT}),
    "a map of sigmas": (recipe(), {"sigmas": SIGMAS}),
    "a map of sigmas, steerable": (recipe("y", measure="steerable"), {"sigmas": SIGMAS}),
    "two maps of a material": (recipe(), {"exemplar": MATERIAL}),
    "what ties": (recipe(sigma=None, complete=False, contrast=0.0, uniformity=0.0), {"exemplar": REPEATED}),
    "no projection": (recipe("y", sigma=None, complete=False, contrast=1.0, flat=False), {}),
}
SLOW = (  # each pair of a measure, a plane or a torus, a small sigma and a constraint is in another case
    "two moments", "moments of a small sigma on a plane", "steerable", "a small sigma on a plane", "prices of offsets",
    "pixels that stay, steerable", "a map of sigmas, steerable",
)  # fmt: skip
# rows of a band, rows of cells, bytes of planes in memory, rows of a piece of the exemplar
PLANS = {"few rows": (13, None, 1 << 17), "pieces": (None, None, 0, 17)}
DEAR = {  # each case has one of them, in turn
    "a row": (1, None, 0),
    "few rows and cells": (26, 9, 1 << 30),
    "few cells": (None, 5, 0),
    "few rows, cells and pieces": (31, 9, 0, 23),
}
EDGES = {"a small sigma": {"a row and few cells": (1, 1, 0)}, "what ties": {"pieces of a row": (None, None, 0, 1)}}


def plans_of(case: str) -> dict[str, tuple[int | None, ...]]:
    turns = list(DEAR)
    turn = turns[list(CASES).index(case) % len(turns)]
    if "steerable" in case and "small" not in case:
        turn = "a row"  # cells are summed again for every band
    return PLANS | {turn: DEAR[turn]} | EDGES.get(case, {})


def made(
    device, case: str, monkeypatch: pytest.MonkeyPatch, plan: tuple[int | None, ...],
    progress: Callable[[int, int], None] = lambda *_: None, keeper: Checkpoint | None = None,
) -> Synthesis:  # fmt: skip
    own, more = CASES[case]
    rows, cell_rows, stores, e_rows = (*plan, None)[:4]
    monkeypatch.setattr(exemplar_rows, "_REGION", 20)  # else halos are as high as levels

    def planned(device, exemplar, recipe, geometries, scales, constraints, budget, held):
        grids = memory.grids_of(recipe, geometries, scales, constraints)
        most = None if rows is None else rows + halo(recipe.patch)
        piece = None if e_rows is None else e_rows + piece_halo(recipe.patch)
        layout = memory.layout(recipe, geometries, grids, constraints, most, cell_rows, piece)
        return memory.MemoryPlan(layout, 0, stores, piece is None)

    monkeypatch.setattr(optimization, "plan_memory", planned)
    constraints = Constraints(**{name: more[name] for name in ("fixed", "weight", "sigmas") if name in more})
    exemplar, allowed = more.get("exemplar", LAB), more.get("allowed", KEPT[:66, :62] if "fixed" in more else None)
    if e_rows is not None:
        exemplar = in_file(exemplar)
    return synthesize(device, exemplar, allowed, own, 1 << 30, progress, constraints=constraints, keeper=keeper)


def in_file(array: np.ndarray) -> RowStore:
    store = RowStore(array.shape, array.dtype)
    store[:] = array
    return store


@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.slow if c in SLOW else ()) for c in CASES])
def test_bands_do_not_show(device, case, monkeypatch):
    whole = made(device, case, monkeypatch, (None, None, 0))
    for name, plan in plans_of(case).items():
        banded = made(device, case, monkeypatch, plan)
        for of in ("field", "source"):
            ours, theirs = (np.asarray(getattr(one, of).packed) for one in (banded, whole))
            np.testing.assert_array_equal(ours, theirs, err_msg=f"{name}: {of}")
        assert banded.lost == whole.lost


def test_pieces_do_not_show_in_single_lanes(device, narrow_device, monkeypatch):
    whole = made(device, "what ties", monkeypatch, (None, None, 0))
    pieces = made(narrow_device, "what ties", monkeypatch, PLANS["pieces"])
    np.testing.assert_array_equal(pieces.source.packed, whole.source.packed)


@pytest.mark.parametrize(
    ("case", "stop"),  # iterations: 2, and 1 on each finer level
    [("tile=xy", 1), ("tile=xy", 5), ("prices of offsets", 3), ("pixels that stay", 5), ("a map of sigmas", 3),
     ("weights", 1), ("weights", 3)],
)  # fmt: skip
def test_a_synthesis_goes_on_after_its_last_finished_level(device, case, stop, monkeypatch, tmp_path):
    counted: list[int] = []  # reports, one for each iteration
    whole = made(device, case, monkeypatch, (None, None, 0), lambda done, total: counted.append(done))
    iterations = len(counted)
    stop = min(stop, iterations)

    def stopped(done: int, total: int) -> None:
        if done == counted[stop - 1]:
            raise Interrupted

    with pytest.raises(Interrupted):
        plan = PLANS["pieces" if case == "weights" else "few rows"]
        made(device, case, monkeypatch, plan, stopped, Checkpoint(tmp_path / "out.exr"))
    passes = []
    improve = Matcher.improve
    monkeypatch.setattr(Matcher, "improve", lambda self, *given: (passes.append(given), improve(self, *given)))
    again = made(device, case, monkeypatch, (None, None, 0), keeper=Checkpoint(tmp_path / "out.exr"))
    assert len(passes) == (iterations if stop < 3 else iterations + 1 - stop)
    for of in ("field", "source"):
        ours, theirs = (np.asarray(getattr(one, of).packed) for one in (again, whole))
        np.testing.assert_array_equal(ours, theirs, err_msg=of)
    assert again.lost == whole.lost
    passes.clear()  # all levels are there now
    banded = made(device, case, monkeypatch, PLANS["few rows"], keeper=Checkpoint(tmp_path / "out.exr"))
    assert not passes
    np.testing.assert_array_equal(np.asarray(banded.source.packed), np.asarray(whole.source.packed))
    made(device, "no projection", monkeypatch, (None, None, 0), keeper=Checkpoint(tmp_path / "out.exr"))
    assert passes[0][1] == 0  # another recipe begins at the beginning
