# SPDX-License-Identifier: Apache-2.0
"""Courses of unequal height: found where they are, and kept straight by --texstationarize."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.analysis.regularity.courses import Courses, InCourses, courses_turn, find_courses
from oiiotex.analysis.regularity.lattice import high_pass_of
from oiiotex.analysis.regularity.offset_prices import BITS
from oiiotex.engine.core.window import Domain
from oiiotex.engine.session import Session
from oiiotex.synthesis.patchmatch.optimization import synthesize
from tests import pictures
from tests.analysis.test_regularity import recipe_of, values_of
from tests.any_filter import buffer
from tests.lattices import regular
from tests.masonry import ashlar, converging


@pytest.mark.parametrize("dark", [True, False])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_joints_are_found_to_a_pixel(seed, dark):
    picture, joints = ashlar(256, 224, seed, dark=dark)
    courses = find_courses(values_of(picture))
    assert courses is not None and courses.rows
    np.testing.assert_allclose(courses.joints, joints, atol=1)
    across = find_courses(values_of(np.ascontiguousarray(picture.swapaxes(0, 1))))
    assert not across.rows
    np.testing.assert_allclose(across.joints, courses.joints, atol=1e-6)


def test_joints_are_found_in_usable_pixels_of_a_large_photo():
    picture, joints = ashlar(700, 520, 4, heights=(40, 90), joint=8)
    photo, usable = values_of(picture), np.ones((700, 520), bool)
    photo[:, 400:], usable[:, 400:] = values_of(pictures.moss(700, 120, 1)), False
    np.testing.assert_allclose(find_courses(photo, usable).joints, joints, atol=2)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["noise", "moss"])
def test_no_courses_are_found_where_there_are_none(name, seed):
    plane = pictures.noise(192, 256, seed)
    picture = getattr(pictures, name)(192, 256, seed) if name == "moss" else np.repeat(plane[..., None], 3, 2)
    assert find_courses(values_of(pictures.stained(picture))) is None


def test_joints_of_one_half_and_single_ledges_are_no_courses():
    picture, _ = ashlar(256, 256, 5)
    photo, moss = values_of(picture), values_of(pictures.moss(256, 256, 1))
    assert find_courses(photo) is not None
    photo[:, 128:] = moss[:, 128:]
    assert find_courses(photo) is None
    for rows, found in (((40, 70, 95, 130, 160, 200), True), ((20, 28, 36, 44, 130, 220), False), ((60, 120), False)):
        ledges = pictures.noise(256, 256, 2)[..., None] * [0.5, 0.5, 0.5]
        ledges[np.array(rows)[:, None] + [0, 1]] = 0.9
        assert (find_courses(values_of(ledges)) is not None) == found


@pytest.mark.parametrize("share", [0.12, 0.25, 0.5])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_courses_in_perspective_turn(seed, share):
    picture, _ = ashlar(256, 256, seed, heights=(18, 40))
    lab = values_of(converging(picture, share))
    texture, counted = high_pass_of(lab, None)
    assert courses_turn(texture, counted) and courses_turn(texture.swapaxes(0, 1), counted.T)
    assert find_courses(lab) is None


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", ["ashlar", "moss", "pebbles", "bricks"])
def test_straight_courses_and_other_photos_do_not_turn(name, seed):
    straight = ashlar(192, 256, seed, heights=(18, 40))[0] if name == "ashlar" else None
    picture = getattr(pictures, name)(192, 256, seed) if straight is None else straight
    assert not courses_turn(*high_pass_of(values_of(picture), None))
    assert not courses_turn(np.ones((40, 300, 3)), np.ones((40, 300), bool))  # too small for strips


def test_courses_of_a_tile_close_in_their_order():
    courses = Courses(True, np.array([10.0, 40.0, 62.0, 100.0, 125.0, 170.0]), 180)
    for height in (180, 128, 512, 97):
        joints = courses.on_torus(Domain(64, height, True, True))
        heights = np.diff(np.append(joints, joints[0] + height))
        assert min(joints[0], height - joints[-1]) > 0.2 * heights.min()  # no joint at the wrap
        nearest = np.abs(heights[:, None] - courses.heights).min(1)
        assert (nearest / heights).max() < 0.2 and (height < 180 or (nearest / heights).max() < 0.07)
    np.testing.assert_array_equal(courses.on_torus(Domain(64, 180, True, False)), courses.joints)
    longer = courses.on_torus(Domain(64, 300, True, False))
    np.testing.assert_allclose(longer[:7], [*courses.joints, 200.0])


def test_a_row_costs_by_its_distance_from_a_joint():
    courses = Courses(True, np.array([10.0, 40.0, 70.0, 100.0, 130.0]), 140)
    kept = InCourses.of(courses, Domain(50, 120, True, True), 0.5)
    prices, bins = kept.prices((1.0, 1.0), (1.0, 1.0), 10, 4.0), 1 << BITS
    axis, own_at, wanted_at = prices.phases.astype(int)
    own, wanted = (part.view(np.uint32) for part in (prices.table[own_at:wanted_at], prices.table[wanted_at:]))
    assert (axis, own_at, len(own), len(wanted)) == (1, bins, 140, 120)

    def price(e: int, y: int) -> int:
        return prices.table[(own[e] - wanted[y]) >> np.uint32(32 - BITS)]

    joint = int(kept.wanted[1])
    assert price(40 - 5, joint - 5) == price(70 - 5, joint - 5) == 0  # corners of patches of 10 px
    assert price(55 - 5, joint - 5) == 400  # the middle of a course: 2 * 0.5 * 10^2 * 4
    assert 0 < price(42 - 5, joint - 5) < 400
    moved = kept.moved(3, 7).prices((1.0, 1.0), (1.0, 1.0), 10, 4.0)
    np.testing.assert_array_equal(moved.table[wanted_at:-7], prices.table[wanted_at + 7 :])


@pytest.mark.parametrize("rows", [pytest.param(True, marks=pytest.mark.slow), False])
def test_a_tile_keeps_its_joints_straight(device, rows):
    picture, joints = ashlar(144, 144, 3, heights=(13, 28))
    is_joint = (np.abs(np.arange(144)[:, None] + 0.5 - joints).min(1) < 1.5)[:, None] & np.ones((144, 144), bool)
    if not rows:
        picture, is_joint = np.ascontiguousarray(picture.swapaxes(0, 1)), is_joint.T
    photo = values_of(picture)
    kept = InCourses.of(find_courses(photo), Domain(144, 144, True, True), 0.5)

    def straight(in_step: InCourses | None) -> float:
        made = synthesize(device, photo, None, recipe_of((144, 144), in_step=in_step), 1 << 30, lambda *_: None)
        tile = made.source.gather(is_joint[..., None].astype(np.float32))[..., 0]
        return float((tile.mean(int(rows)) ** 2).mean() / tile.mean())  # 1: each joint goes through the whole tile

    with_courses, without = straight(kept), straight(None)
    assert with_courses > 0.85
    assert without < with_courses - 0.1  # the tile starts as the photo, so most joints are straight without, too


def test_only_a_photo_with_courses_and_no_lattice_is_kept_in_courses(caplog):
    picture, _ = ashlar(128, 128, 3, heights=(12, 26))
    photos = {"courses": picture, "lattice": regular("square", 128, 128, 1), "moss": pictures.moss(128, 128, 1)}
    made, common = {}, {"seed": 2, "iterations": 2, "size": (128, 128), "sigma": 16.0}
    with caplog.at_level(logging.INFO, "oiiotex"):
        for name, photo in photos.items():
            caplog.clear()
            one, other = (
                filters.stationarize(buffer(photo), lattice=s, session=Session(), **common).get_pixels()
                for s in (0.5, 0.0)
            )
            made[name] = "the photo has courses" in caplog.text, bool((one == other).all())
    assert made == {"courses": (True, False), "lattice": (False, False), "moss": (False, True)}


def test_a_checkpoint_knows_the_courses():
    kept = InCourses.of(Courses(True, np.arange(10.0, 100, 20), 110), Domain(64, 110, True, True), 0.5)
    other = replace(kept, courses=replace(kept.courses, joints=kept.courses.joints + 1))
    assert str(kept.facts()) != str(other.facts())
