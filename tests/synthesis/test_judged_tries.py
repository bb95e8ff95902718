# SPDX-License-Identifier: Apache-2.0
"""Quilts and planes are judged: other scales are tried while the first is not good, and what stays bad is warned of."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.analysis.dominant.diffusion import _core_above
from oiiotex.analysis.regularity.courses import Courses, find_courses
from oiiotex.engine.core.window import Domain
from oiiotex.engine.errors import ImageError, Interrupted
from oiiotex.engine.session.progress import Progress
from oiiotex.synthesis.quality.fidelity import Fidelity
from oiiotex.synthesis.quality.judged_tries import Try, best_tried
from tests import pictures
from tests.analysis.test_regularity import values_of
from tests.any_filter import buffer, pixels
from tests.masonry import ashlar


def best_of(tries, measure):
    return best_tried("--x", tries, measure, Progress())


def judged(broken: float) -> Fidelity:
    return Fidelity(bands=(1.0, 1.0, 1.0), shapes=1.0, lines=1.0, missing=0.0, broken=broken)


def test_the_first_good_try_is_taken_else_the_best():
    made = []

    def tries(*values):
        made.clear()
        return [Try(f"n={value}", lambda _, value=value: made.append(value) or value) for value in values]

    assert best_of(tries(0.09, 0.012, 0.01), judged).spelled == "n=0.012"
    assert made == [0.09, 0.012]
    assert best_of(tries(0.09, 0.05, 0.07), judged).made == 0.05
    assert best_of(tries(0.09, 0.01), lambda _: None).made == 0.09  # too small to be judged
    assert made == [0.09]


def test_of_nearly_equal_results_the_one_with_fewer_faults_is_taken():
    whole = replace(judged(0.005), uneven=0.26, missing=0.08)
    stepped = replace(judged(0.0157), uneven=0.25, missing=0.12)
    assert 0 < stepped.value - whole.value < 0.02
    for order in ((whole, stepped), (stepped, whole)):
        tries = [Try(str(n), lambda _, one=one: one) for n, one in enumerate(order)]
        assert best_of(tries, lambda made: made).made is whole
    clearly = replace(whole, uneven=0.2)
    assert best_of([Try("a", lambda _: whole), Try("b", lambda _: clearly)], lambda made: made).made is clearly


def test_a_try_that_can_neither_become_good_nor_gain_is_not_made():
    made = []

    def one(name: str, value: float, **more) -> Try:
        return Try(name, lambda _: made.append(name) or value, **more)

    improving = [
        one("waves", 0.02, improves=("waves",)),  # objects stay cut
        one("breaks", 0.02, improves=("broken",)),
        one("whole", 0.016, improves=("broken",)),
    ]
    assert best_of([one("first", 0.02), *improving], judged).spelled == "whole"
    assert made == ["first", "breaks", "whole"]


def test_an_evened_tile_is_chosen_where_it_repeats_less_and_is_as_whole_by_eye():
    """Up to three times the first tile's cuts are not seen, and no more than a limit; then nothing else is made."""

    def repeating(broken: float) -> Fidelity:
        return replace(judged(broken), waves=1.0 if broken in evened else 6.0)

    def chosen(first: float, even: float) -> str:
        evened.add(even)
        tries = [Try("first", lambda _: first), Try("even", lambda _: even, improves=("waves",), evens=True)]
        return best_of([*tries, Try("layout", lambda _: 0.001)], repeating).spelled

    evened: set[float] = set()
    assert chosen(0.02, 0.055) == "even"
    assert chosen(0.02, 0.065) == "layout"  # 3.2 times
    assert chosen(0.03, 0.08) == "layout"  # 2.7 times, and many
    worse = Try("even", lambda _: 0.01, improves=("waves",), evens=True)
    assert best_of([Try("first", lambda _: 0.03), worse], judged).spelled == "first"  # it does not repeat: not made


def test_whole_objects_are_chosen_although_they_repeat_sooner():
    """Waves of a layout decide nothing if objects of the first tile are cut; its fidelity counts them."""
    layout, larger = replace(judged(0.005), waves=12.0), replace(judged(0.005), waves=6.0)

    def chosen(first: Fidelity, despite: tuple[str, ...] = ("waves",)) -> str:
        tries = [Try("first", lambda _: first), Try("layout", lambda _: layout, improves=("broken",), despite=despite)]
        best = best_of([*tries, Try("larger", lambda _: larger)], lambda made: made)
        assert best.kept is best.made  # the waves are told
        return best.spelled

    cut = replace(judged(0.018), waves=7.0)
    assert layout.value < cut.value
    assert chosen(cut) == "layout"  # and no other is made
    assert chosen(cut, despite=()) == "larger"
    assert chosen(replace(cut, broken=0.014)) == "larger"  # its objects are whole: not made


def test_a_try_that_fails_is_left_out_unless_it_is_the_first():
    def fails(_):
        raise ImageError("no patch fits")

    good, bad = Try("a", lambda _: 0.09), Try("b", fails)
    assert best_of([good, bad], judged).spelled == "a"
    with pytest.raises(ImageError):
        best_of([bad, good], judged)


def test_who_ends_the_run_gets_no_result_of_an_earlier_try():
    def ended(_):
        raise Interrupted("cancelled")

    with pytest.raises(Interrupted):
        best_of([Try("a", lambda _: 0.09), Try("b", ended)], judged)


def test_the_chosen_scale_is_said_and_gives_the_same_pixels(caplog):
    photo = buffer(pictures.pebbles(128, 128, 3))
    with caplog.at_level(logging.INFO, "oiiotex"):
        made = filters.quilt(photo, size=(160, 160), seed=1)
    (said,) = [r.getMessage() for r in caplog.records if "scales chosen" in r.getMessage()]
    name, value = said.rpartition(" ")[2].split("=")
    again = filters.quilt(photo, size=(160, 160), seed=1, **{name: int(value)})
    np.testing.assert_array_equal(pixels(made), pixels(again))


def test_a_window_decides_as_its_plane_does():
    photo = buffer(pictures.pebbles(128, 128, 3))
    whole, piece = (
        pixels(filters.synth(photo, seed=1, **more)) for more in ({"size": (96, 96)}, {"window": "32x24+40+50"})
    )
    np.testing.assert_array_equal(whole[50:74, 40:72], piece)


def test_courses_stay_straight_in_quilts():
    picture, joints = ashlar(144, 144, 3, heights=(13, 28))
    rows = np.arange(144)[:, None] + 0.5
    light = (np.abs(rows - joints).min(1) < 1.5).astype(np.float32)

    def straight(lattice: float) -> float:
        made = filters.quilt(buffer(picture), size=(144, 144), seed=3, st=True, flattening=0, lattice=lattice, patch=16)
        st = pixels(made["st"])
        tile = light[np.clip((st[..., 1] * 144).astype(int), 0, 143)]
        return float((tile.mean(1) ** 2).mean() / tile.mean())

    kept, free = straight(0.5), straight(0.0)
    assert kept > free + 0.1


def test_a_few_even_planks_are_courses_and_a_few_ledges_are_not():
    noise = pictures.noise(256, 256, 2)[..., None] * [0.3, 0.3, 0.3]
    for columns, found in (((20, 84, 150, 215), True), ((20, 30, 150, 215), False)):
        planks = 0.4 + noise
        planks[:, np.array(columns)[:, None] + [0, 1]] = 0.05
        courses = find_courses(values_of(planks))
        assert (courses is not None and not courses.rows) == found


def test_a_plane_repeats_its_courses_in_their_order():
    courses = Courses(True, np.array([10.0, 40.0, 62.0, 100.0]), 128)
    joints = courses.on_torus(Domain(90, 90, True, True))
    assert sorted(np.diff(np.append(joints, joints[0] + 90)).tolist()) == [22.0, 30.0, 38.0]


def test_the_core_of_heat_leaves_out_a_cold_tail_and_nothing_else():
    core = np.random.default_rng(0).normal(-3, 0.2, 4000)
    cold = np.full(600, -8.0)
    above = _core_above(np.concatenate([core, cold]))
    assert (cold < above).all() and (core > above).mean() > 0.97
