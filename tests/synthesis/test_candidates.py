# SPDX-License-Identifier: Apache-2.0
"""The analysis stage: stacks, admissible levels, the search for candidates, transfer functions, the cache."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex.engine.color.lab_grid import FINE_STEPS
from oiiotex.engine.core.window import Window
from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.synthesis.multiscale import candidate_sets
from oiiotex.synthesis.multiscale.candidate_sets import NONE, analyze, neighborhoods, project
from oiiotex.synthesis.multiscale.graph import Graph, parse_graph
from oiiotex.synthesis.multiscale.stacks import Exemplar, blurred, nearest_opaque, sigma_of, tiles
from oiiotex.synthesis.multiscale.superexemplar import unrolled
from oiiotex.synthesis.multiscale.targets import lively_texels, stacks_of
from tests import pictures
from tests.reference import candidates as reference

BUDGET = 1 << 30


def graph_of(names, *edges):
    nodes = [{"id": n, "file": n} for n in names]
    drawn = [{"from": a, "to": b, "r": r} for a, b, r in edges]
    return parse_graph({"exemplars": nodes, "edges": drawn, "root": names[0]}, Path("g.json"))


def exemplar_of(values, opaque=None, periodic=True):
    side = len(values)
    values = np.dstack([values * 100, np.zeros((side, side))]).astype(np.float32)
    return Exemplar("made", values[..., :3], values, opaque, Window(0, 0, side, side), 1.0, periodic)


def test_levels_of_a_chain():
    """HRRG08 figure 4: r = 2 brings level k of one and k - 2 of the other together; the finest leads nowhere."""
    levels = unrolled(graph_of("ab", ("a", "b", 2)), 5)
    number = {at: n for n, at in enumerate(levels.stacks)}
    named = {at: [(levels.stacks[n], r) for n, r in levels.admissible[number[at]]] for at in levels.stacks}
    assert levels.stacks[0] == (0, 0)
    assert named[0, 1] == [((0, 1), 0)]
    assert named[0, 3] == [((0, 3), 0), ((1, 1), 2)]
    assert named[0, 5] == [((1, 3), 2)]
    assert named[1, 5] == [((1, 5), 0)]  # no edge leaves it
    assert (1, 0) in number and levels.finer[number[0, 2]] == number[0, 3]
    assert levels.finer[number[1, 5]] == number[1, 5]
    assert [levels.spacing(number[0, k]) for k in range(6)] == [32, 16, 8, 4, 2, 1]


@pytest.mark.parametrize("r, early, end", [(1, (), 5), (2, (), 5), (3, (), 5), (1, (0,), 4)])
def test_a_loop_turns_where_its_levels_end(r, early, end):
    """Not before; and by two octaves or more."""
    levels = unrolled(graph_of("a", ("a", "a", r)), 5, early)
    number = {at: n for n, at in enumerate(levels.stacks)}
    assert len(levels.stacks) == end + 1  # finer ones are never come to
    for k in range(end):
        assert levels.admissible[number[0, k]] == ((number[0, k], 0),)
    turn = max(r, 2)
    assert levels.admissible[number[0, end]] == ((number[0, end - turn], turn),)
    assert [levels.turns(number[0, k]) for k in range(end + 1)] == [False] * end + [True]


def test_an_exemplar_is_left_while_the_next_ones_levels_are_admissible():
    """Before an edge with r = 0 into a loop more levels lead on: else, at the last one nothing would be admissible."""
    levels = unrolled(graph_of("ab", ("a", "b", 0), ("b", "b", 3)), 6)
    number = {at: n for n, at in enumerate(levels.stacks)}
    assert [levels.stacks[n] for n, _ in levels.admissible[number[0, 5]]] == [(1, 5)]
    assert [levels.stacks[n] for n, _ in levels.admissible[number[0, 4]]] == [(0, 4), (1, 4)]
    assert [levels.stacks[n] for n, _ in levels.admissible[number[1, 6]]] == [(1, 3)]


def test_levels_that_are_not_reached_take_no_part():
    levels = unrolled(graph_of("abc", ("a", "b", 2), ("b", "c", 0)), 5)
    assert {k for i, k in levels.stacks if i == 2} == set(range(6))
    assert len(set(levels.stacks)) == len(levels.stacks)


def test_a_stack_blurs_around_the_border_and_keeps_the_mean():
    random = np.random.default_rng(0).random((32, 32, 2))
    assert sigma_of(5, 5) == 0
    for level in range(6):
        found = blurred(random, sigma_of(level, 5))
        assert found.mean((0, 1)) == pytest.approx(random.mean((0, 1)))
    one = np.zeros((32, 32, 1))
    one[0, 0] = 1
    found = blurred(one, 2.0)[..., 0]
    assert found[0, 1] == pytest.approx(found[0, -1]) and found.min() >= -1e-15
    offset = (np.arange(32) + 16) % 32 - 16
    assert (found.sum(0) * offset**2).sum() == pytest.approx(4.0, rel=1e-3)  # sigma^2


def test_transparent_pixels_have_no_say_in_a_stack():
    random = np.random.default_rng(0).random((32, 32, 1)) * 0.1 + 0.5
    opaque = np.ones((32, 32), bool)
    opaque[5:20, 8:25] = False
    a, b = (blurred(np.where(opaque[..., None], random, under), 3.0, opaque) for under in (0.0, 1e3))
    np.testing.assert_allclose(a, b, atol=1e-9)
    assert a.min() > 0.4 and a.max() < 0.7
    nearest = nearest_opaque(opaque)
    assert nearest.gather(opaque).all()
    assert (nearest[opaque].flat(32) == np.flatnonzero(opaque)).all()


def around_all(stacks):
    """Neighborhoods of all levels: (levels, side^2, 75)."""
    levels = enumerate(zip(stacks.planes, stacks.periodic, strict=True))
    return np.array([neighborhoods(p, stacks.levels.spacing(n), around) for n, (p, around) in levels])


@pytest.mark.parametrize("periodic, wrap", [(True, "wrap"), (False, "symmetric")])
@pytest.mark.parametrize("spacing", [1, 2, 16])
def test_neighborhoods_go_around_or_are_mirrored(periodic, wrap, spacing):
    plane = np.random.default_rng(0).integers(-99, 99, (16, 16, 4))
    found = neighborhoods(plane, spacing, periodic)
    padded = np.pad(plane[..., :3], ((2 * spacing,) * 2,) * 2 + ((0, 0),), mode=wrap)
    rows = np.array([0, 17, 255, 100])
    for row in rows:
        y, x = divmod(int(row), 16)
        seen = padded[y : y + 4 * spacing + 1 : spacing, x : x + 4 * spacing + 1 : spacing]
        np.testing.assert_array_equal(found[row], seen.ravel())
    np.testing.assert_array_equal(candidate_sets._around(plane, spacing, periodic, rows), found[rows])


def test_a_mirrored_stack_is_the_blur_of_the_mirrored_exemplar():
    """Oracle: scipy's Gaussian with mode='reflect', and the exemplar with its mirror images as a torus."""
    image = np.random.default_rng(0).random((32, 32, 2))
    for level in range(3, 6):
        sigma = sigma_of(level, 5)
        found = blurred(image, sigma, periodic=False)
        np.testing.assert_allclose(found, gaussian_filter(image, (sigma, sigma, 0), truncate=9), atol=1e-6)
    twice = np.concatenate([image, image[::-1]])
    twice = np.concatenate([twice, twice[:, ::-1]], 1)
    for level in range(6):
        sigma = sigma_of(level, 5)
        found = blurred(image, sigma, periodic=False)
        np.testing.assert_allclose(found, blurred(twice, sigma)[:32, :32], atol=1e-12)
    opaque = np.random.default_rng(1).random((32, 32)) < 0.8
    four = np.concatenate([opaque, opaque[::-1]])
    four = np.concatenate([four, four[:, ::-1]], 1)
    np.testing.assert_allclose(
        blurred(image, 3.0, opaque, periodic=False), blurred(twice, 3.0, four)[:32, :32], atol=1e-9
    )


def test_what_tiles_is_told_by_its_borders():
    random = np.random.default_rng(0).random((128, 128, 1))
    for sigma in (0.0, 1.0, 4.0):
        torus = 100 * blurred(random, sigma)
        assert tiles(torus), sigma
        assert sigma == 0 or not tiles(torus[:100, :90]), sigma  # of white noise any piece tiles
    slope = np.arange(64.0)[:, None, None] * np.ones((64, 64, 1))
    assert not tiles(slope) and not tiles(slope.swapaxes(0, 1))
    joints = np.where(np.arange(64) % 16 == 0, 0.0, 50.0)[:, None, None] * np.ones((64, 64, 1))
    assert tiles(joints + np.random.default_rng(0).random((64, 64, 1)))  # its wrap lies in a joint like three others


def test_projection_is_the_rounded_scalar_product():
    random = np.random.default_rng(0)
    around = random.integers(-2400, 2401, (50, 75)).astype(np.float64)
    basis = np.rint(np.linalg.qr(random.normal(size=(75, 16)))[0] * 4096).astype(np.int16)
    exact = np.floor((around.astype(np.int64) @ basis.astype(np.int64) + 2048) / 4096)
    np.testing.assert_array_equal(project(around, basis), np.clip(exact, -5790, 5790))


@pytest.fixture(scope="module")
def small():
    """Two exemplars and transparent pixels, 16 px."""
    opaque = np.ones((16, 16), bool)
    opaque[3:7, 2:9] = False
    made = exemplar_of(pictures.moss(16, 16, 3), opaque)
    return stacks_of(graph_of("ab", ("a", "b", 1)), [made, exemplar_of(pictures.pebbles(16, 16, 1), periodic=False)])


def buffers_of(device, stacks, projections):
    texels = projections.shape[1]
    layout = {"projections": projections.nbytes, "usable": stacks.usable.size, "excluded": 4 * texels}
    layout |= dict.fromkeys(("texel", "cost", "texel_next", "cost_next"), 4 * texels)
    buffers = Buffers(device, layout, BUDGET, "test")
    device.write(buffers["projections"], projections)
    device.write(buffers["usable"], stacks.usable.view(np.uint8))
    return buffers


def projections_of(stacks):
    basis, _ = candidate_sets.basis_of(stacks, 16)
    return np.array([project(seen, basis) for seen in around_all(stacks)])


@pytest.mark.parametrize("at", [(0, 2), (0, 4)])
@pytest.mark.parametrize("exclude", [False, True])
def test_the_search_is_the_oracles(any_lanes, small, at, exclude):
    number = small.levels.stacks.index(at)
    assert len(small.levels.admissible[number]) == (1 if at == (0, 4) else 2)
    q = projections_of(small)
    own = (number * 256 + np.arange(256)).astype(np.uint32)
    excluded = own if exclude else np.full(256, NONE, np.uint32)
    with buffers_of(any_lanes, small, q) as buffers:
        found = candidate_sets.search(any_lanes, buffers, small, number, excluded)
    usable = small.usable.reshape(len(small.usable), -1)
    disc = round((candidate_sets.DISC * 16) ** 2)
    oracle = reference.Oracle(q, usable, small.levels.admissible[number], excluded, disc, number, 4)
    expected = np.array(oracle.run(candidate_sets._ROUNDS, candidate_sets._JUMPS), np.uint32)
    hit = expected != NONE
    assert hit.all()
    np.testing.assert_array_equal(found, expected)
    assert usable.ravel()[found].all()


SLOW = [pytest.param(picture, marks=pytest.mark.slow) for picture in (pictures.moss, pictures.pebbles)]


@pytest.mark.parametrize("picture", [pictures.bricks, *SLOW])
def test_candidates_come_near_the_exact_ones(device, picture):
    """What is stated: second candidates cost at most 6 % more than the exact ones, in the mean over all levels."""
    stacks = stacks_of(graph_of("a", ("a", "a", 1)), [exemplar_of(picture(64, 64, 1))])
    q = projections_of(stacks)
    found_cost, exact_cost = 0.0, 0.0
    with buffers_of(device, stacks, q) as buffers:
        for number in range(2, len(q)):
            excluded = (number * 4096 + np.arange(4096)).astype(np.uint32)
            found = candidate_sets.search(device, buffers, stacks, number, excluded).astype(np.int64)
            cost = ((q[number].astype(np.int64) - q.reshape(-1, 16)[found]) ** 2).sum(1)
            disc = round((candidate_sets.DISC * 64) ** 2)
            usable = stacks.usable.reshape(len(stacks.usable), -1)
            exact = reference.exact(q, usable, stacks.levels.admissible[number], excluded, disc, number, 6)
            assert (cost >= exact - 0.5).all()
            found_cost, exact_cost = found_cost + np.sqrt(cost).mean(), exact_cost + np.sqrt(exact).mean()
        assert found_cost <= 1.06 * exact_cost


def test_transfer_functions_bring_the_means_of_neighborhoods_together(device):
    """HRRG08 eq. 4: a darker copy of an exemplar is matched with the difference as offset."""
    bright = pictures.pebbles(32, 32, 1) * 0.5 + 0.4
    graph = graph_of("ab", ("a", "b", 1))
    stacks = stacks_of(graph, [exemplar_of(bright), exemplar_of(bright - 0.2)])
    made = analyze(device, stacks, 16, True, BUDGET, lambda done, total: None, None)
    number = stacks.levels.stacks.index((0, 5))  # its finest level: only the other exemplar is admissible
    links = made.links[number].astype(np.int64)
    assert (links >> 10 == stacks.levels.stacks.index((1, 4))).all()
    around = around_all(stacks)
    means = around.reshape(len(around), -1, 25, 3).mean(2)
    away = means[number][:, None] - means.reshape(-1, 3)[links]
    np.testing.assert_allclose(made.offsets[number, ..., :3], away, atol=0.5001)
    # matched as they are (section 8), so bright places of the dark one are taken: less than 20 Lab are left
    assert 2 * FINE_STEPS < away[..., 0].mean() < 20 * FINE_STEPS
    # what is stored is the candidate's neighborhood with the offset on it
    shifted = around.reshape(-1, 75)[links[:, 0]] + np.tile(made.offsets[number, :, 0, :3], 25)
    np.testing.assert_allclose(made.records[number, :, 0], project(shifted, made.basis), atol=1)
    plain = analyze(device, stacks, 16, False, BUDGET, lambda done, total: None, None)
    assert not plain.offsets.any()
    np.testing.assert_array_equal(plain.links, made.links)


def test_an_exemplar_agrees_with_itself(device):
    made = analyze(
        device, stacks_of(Graph.single("a"), [exemplar_of(pictures.moss(32, 32, 1))]), 16, True, BUDGET,
        lambda done, total: None, None,
    )  # fmt: skip
    assert not made.offsets.any()
    texels = np.arange(made.links.shape[0] * 1024).reshape(-1, 1024)
    np.testing.assert_array_equal(made.links[..., 0], texels)  # candidate 1 is the texel itself
    assert (made.links[..., 1] != texels).all()
    assert 0.7 < made.variance <= 1


def test_a_second_run_takes_all_from_the_cache(device, tmp_path, monkeypatch):
    stacks = stacks_of(Graph.single("a"), [exemplar_of(pictures.moss(16, 16, 1))])
    told = []

    def run(**other):
        told.clear()
        given = {"stacks": stacks, "dims": 16, "correct": True, **other}
        cache, tell = tmp_path / "c", lambda done, total: told.append((done, total))
        return analyze(device, budget=BUDGET, advance=tell, cache=cache, **given)

    first = run()
    steps = told[-1][1]
    assert told == [(done, steps) for done in range(1, steps + 1)]
    with monkeypatch.context() as patched:
        for name in ("basis_of", "neighborhoods", "search", "_transfers"):
            patched.setattr(candidate_sets, name, None)
        again = run()
    assert told == [(done, steps) for done in range(1, steps + 1)]  # progress goes through all of it as well
    for name in ("basis", "links", "records", "offsets", "variance"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    # what follows from something else has another name
    usable = stacks.usable.copy()
    usable[0, 0, 0] = False
    others = [
        {"dims": 6},
        {"correct": False},
        {"stacks": dataclasses.replace(stacks, usable=usable)},
        {"stacks": stacks_of(Graph.single("a"), [exemplar_of(pictures.moss(16, 16, 2))])},
    ]
    for other in others:
        run(**other)
        assert len(told) == steps
    assert len(list((tmp_path / "c").iterdir())) == 1 + len(others)


def test_in_a_loop_only_texels_with_detail_to_come_are_jumped_to(device):
    flat = np.full((64, 64, 3), 0.5)
    flat[16:48, 16:48] = pictures.moss(32, 32, 1)  # detail in a quarter of it
    plain = stacks_of(graph_of("a", ("a", "a", 2)), [exemplar_of(flat)])
    assert lively_texels(plain.levels, plain.planes, plain.periodic, []).all() and not plain.targets.all()
    (end,) = filter(plain.levels.turns, range(len(plain.planes)))
    made = analyze(device, plain, 16, True, BUDGET, lambda d, t: None, None)
    y, x = np.divmod(made.links[end] & 4095, 64)
    assert ((y >= 12) & (y < 52) & (x >= 12) & (x < 52)).all()
    without = replace(plain, targets=plain.usable)
    without = analyze(device, without, 16, True, BUDGET, lambda d, t: None, None)
    y, x = np.divmod(without.links[end] & 4095, 64)
    assert ((y < 12) | (y >= 52)).any()


def test_a_turn_is_found_by_shape_not_by_color(device):
    """One half of a picture is 40 Lab darker: texels come to the other half as if it were not."""
    picture = 0.5 + blurred(np.random.default_rng(0).random((64, 64, 1)) - 0.5, 1.0) * np.ones(3)
    picture[:, 32:] += 0.4
    stacks = stacks_of(graph_of("a", ("a", "a", 3)), [exemplar_of(picture, periodic=False)])
    (end,) = filter(stacks.levels.turns, range(len(stacks.planes)))
    across = {}
    for correct in (True, False):
        links = analyze(device, stacks, 16, correct, BUDGET, lambda d, t: None, None).links[end]
        across[correct] = ((links.reshape(64, 64, 2)[:, 2:24] & 63) >= 32).mean()
    assert across[True] > 0.2 > 0.02 > across[False]  # without transfer functions colors have to be alike


def test_a_blurred_exemplar_turns_early():
    """Where the finest octave holds nothing, a turn of two octaves is made of the two before it."""
    random = np.random.default_rng(0).random((64, 64, 1)) * np.ones(3)
    ends = {}
    for sigma in (0.0, 2.0):
        picture = blurred(random, sigma)
        levels = stacks_of(graph_of("a", ("a", "a", 2)), [exemplar_of(picture)]).levels
        ends[sigma] = next(levels.stacks[n][1] for n in range(len(levels.stacks)) if levels.turns(n))
    assert ends == {0.0: 6, 2.0: 5}


def test_by_the_letter_a_loop_turns_anywhere_and_an_exemplar_agrees_with_itself(device):
    """HRRG08 section 3.3: A(E_k) has the level itself below the finest and every edge; section 5: the identity."""
    graph, picture = graph_of("a", ("a", "a", 1)), pictures.moss(32, 32, 1)
    stacks = stacks_of(graph, [exemplar_of(picture)], literal=True)
    levels, number = stacks.levels, {at: n for n, at in enumerate(stacks.levels.stacks)}
    assert levels.admissible[number[0, 3]] == ((number[0, 3], 0), (number[0, 2], 1))
    assert levels.admissible[number[0, 5]] == ((number[0, 4], 1),)
    assert stacks.targets.all()
    assert not analyze(device, stacks, 6, True, BUDGET, lambda d, t: None, None).offsets.any()
    assert analyze(
        device, stacks_of(graph, [exemplar_of(picture)]), 6, True, BUDGET, lambda d, t: None, None
    ).offsets.any()
