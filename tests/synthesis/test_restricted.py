# SPDX-License-Identifier: Apache-2.0
"""PatchMatch restricted to a mask or a label: which level it starts on, what it counts, what it says."""

from __future__ import annotations

import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.synthesis.patchmatch import optimization as st
from oiiotex.synthesis.patchmatch.constraints import (
    ENOUGH,
    Constraints,
    FixedPixels,
    Octaves,
    coarse_mask,
    ease_from,
    first_level,
)
from oiiotex.synthesis.patchmatch.field import allowed_patches, random_field
from oiiotex.synthesis.patchmatch.matcher import Matcher
from oiiotex.synthesis.patchmatch.memory import ExemplarHeld, plan_memory
from oiiotex.synthesis.patchmatch.recipe import Recipe, geometry_at, level_scales
from oiiotex.synthesis.projections.histograms import OUTSIDE
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.reference.histograms import matching_table

pytestmark = pytest.mark.usefixtures("few_places")
PHOTO = pictures.bricks(160, 192, seed=4)


def recipe(**more: object) -> Recipe:
    given = {"width": 160, "height": 160, "wrap_x": True, "wrap_y": True, "sigma": 12.0, "patch": 7}
    given |= {"iterations": 2, "seed": 0, "uniformity": 0.01, "contrast": 1.0, "flat": True}
    return Recipe(**{**given, **more})


def stripes(width: int, pitch: int = 40) -> np.ndarray:
    """A mask of vertical stripes that coarse levels lose."""
    return np.indices((160, 192))[1] % pitch < width


def test_a_thin_mask_starts_where_it_has_whole_patches():
    scales = level_scales(recipe(literal=True), PHOTO.shape)
    geometries = [geometry_at(recipe(), PHOTO.shape, scale) for scale in scales]
    starts = [first_level(mask, geometries, "x") for mask in (None, stripes(40), stripes(15), stripes(10), stripes(7))]
    assert starts[:2] == [0, 0] and starts == sorted(starts) and starts[-1] == len(scales) - 1
    for mask, start in zip((stripes(15), stripes(10)), starts[2:4], strict=True):
        assert start > 0
        sizes = [(g.exemplar_width, g.exemplar_height) for g in geometries]
        found = [allowed_patches(coarse_mask(mask, *s), g).mean() for s, g in zip(sizes, geometries, strict=True)]
        assert all(share < ENOUGH * found[-1] for share in found[:start]) and found[start] >= ENOUGH * found[-1]


@pytest.mark.parametrize("op", ["stationarize", "patchmatch"])
@pytest.mark.parametrize("width", [8, 13, 24])
def test_only_pixels_of_a_thin_mask_are_copied(op, width):
    mask = stripes(width)
    made = getattr(filters, op)(
        buffer(np.concatenate([PHOTO, mask[..., None]], -1), names=("R", "G", "B", "id")),
        mask=buffer(mask[..., None] * 1.0), patch=7, iterations=2, st=True, size=(150, 140),
    )  # fmt: skip
    tile = pixels(next(iter(made.values())))
    assert tile.shape[:2] == (140, 150) and (tile[..., 3] == 1).all()
    places = pixels(made["st"])
    x, y = (np.floor(places[..., k] * n).astype(int) for k, n in ((0, 192), (1, 160)))
    # parts of the mask that are wide enough for patches are used, not one place over and over
    assert len(np.unique(x[mask[y, x]] // 40)) == 5


def test_pixels_outside_are_in_no_histogram(device):
    """Two gray levels at equal shares inside, the mean of both wherever it is not allowed."""
    mask = np.zeros((64, 80), bool)
    mask[:, :20] = True
    exemplar = np.where(np.indices((64, 80)).sum(0)[..., None] // 4 % 2 == 0, 400, 100) * np.ones(3)
    exemplar = np.where(mask[..., None], exemplar, 250).astype(np.int16)
    given = recipe(width=64, height=64, sigma=8.0, patch=5)
    geometry = geometry_at(given, exemplar.shape, 1.0)
    patches = allowed_patches(mask, geometry)
    layout = plan_memory(
        device, exemplar.shape, given, [geometry], [1.0], Constraints(), 1 << 30, ExemplarHeld()
    ).layout
    with Buffers(device, layout, 1 << 30, "test") as buffers:
        field = random_field(geometry, patches, 0)
        matcher = Matcher(device, buffers, geometry, exemplar, patches, field, 0.0, 0, usable=mask)
        level = st._Level(device, buffers, matcher, exemplar, mask, given, 1.0)
        goal, low = device.read(buffers["goal_counts"], (3, level._entries), np.uint32), level._first
    assert goal.sum(axis=1).tolist() == [mask.sum()] * 3
    values = low + np.arange(goal.shape[1])
    # nothing of the gray between them: the two levels stay apart in the goal, at about equal shares
    assert goal[:, (values > 180) & (values < 320)].sum() < 0.02 * goal.sum()
    assert abs(goal[:, values >= 320].sum() / goal.sum() - 0.5) < 0.05


def test_a_histogram_matched_beside_pixels_that_stay_is_not_shifted(device):
    """What goes part of the way is rounded to the nearest step, not down: by half a step in every iteration."""
    exemplar = (PHOTO * 400).astype(np.int16)
    given = recipe(width=80, height=64, sigma=None, patch=5)
    geometry = geometry_at(given, exemplar.shape, 1.0)
    patches = allowed_patches(None, geometry)
    stays = np.indices((64, 80))[1] < 4
    fixed = FixedPixels(stays, np.zeros((64, 80), np.uint32))
    constraints, image = Constraints(fixed=fixed), np.where(stays[..., None], exemplar[:64, :80], OUTSIDE)
    layout = plan_memory(device, exemplar.shape, given, [geometry], [1.0], constraints, 1 << 30, ExemplarHeld()).layout
    with Buffers(device, layout, 1 << 30, "test") as buffers:
        matcher = Matcher(device, buffers, geometry, exemplar, patches, random_field(geometry, patches, 0), 0.0, 0)
        level = st._Level(device, buffers, matcher, exemplar, None, given, 1.0, constraints, image)
        low, high = level._low, level._high
        before = np.random.default_rng(0).integers(low, (low + 2 * high) // 3, (64, 80, 3)).astype(np.int16)
        device.write(buffers["image"], before)
        level._count_free(0, 64)
        level._match_histogram(1.0)
        after = device.read(buffers["image"], before.shape, np.int16)
        counts = np.stack([np.bincount(c - level._first, minlength=level._entries) for c in before[~stays].T])
        goal = device.read(buffers["goal_counts"], counts.shape, np.uint32)
    table = np.rint(matching_table(counts, goal.astype(np.int64), level._first, 1.0))
    change = table[np.arange(3), before.astype(int) - level._first] - before.astype(float)
    exact = before + change * ease_from(~stays, st.EASE * 5)[..., None] / 255
    assert np.abs(change).mean() > 10
    assert np.abs(after - exact).max() <= 0.51
    assert abs((after - exact).mean()) < 0.02


def test_colors_outside_do_not_show():
    mask = stripes(24)
    other = np.random.default_rng(0).random(PHOTO.shape)
    photos = [PHOTO, np.where(mask[..., None], PHOTO, other), np.where(mask[..., None], PHOTO, 50)]
    tiles = [
        pixels(filters.stationarize(buffer(p), mask=buffer(mask[..., None] * 1.0), iterations=2, patch=7))
        for p in photos
    ]
    np.testing.assert_array_equal(tiles[0], tiles[1])
    np.testing.assert_array_equal(tiles[0], tiles[2])


def test_coarse_levels_are_means_of_allowed_pixels_alone():
    mask = stripes(20)
    values = np.where(mask[..., None], np.float32(40), np.float32(90)) * np.ones(3, np.float32)
    coarse = Octaves(values, mask).reduced(71, 59)
    np.testing.assert_allclose(coarse[coarse_mask(mask, 71, 59)], 40, rtol=1e-5)


@pytest.mark.parametrize("mask", [None, stripes(20)])
def test_a_level_is_the_same_for_the_next_synthesis(mask):
    values = np.random.default_rng(1).uniform(0, 99, (160, 192, 3)).astype(np.float32)
    shared, sizes = Octaves(values, mask), [(20, 17), (40, 33), (71, 59), (192, 160)]
    for width, height in (*sizes, *sizes[::-1]):
        alone = Octaves(values, mask).halve(width, height, True).reduced(width, height)
        again = shared.halve(width, height, True).reduced(width, height, slice(3, 15))
        np.testing.assert_array_equal(again, alone[3:15])


@pytest.mark.parametrize(
    ("mask", "alpha", "said"),
    [
        (stripes(6), None, "is free of pixels outside the mask or label; reduce patch"),
        (None, stripes(6), "is free of transparent pixels"),
        (stripes(20), stripes(20, 33), "is free of transparent pixels and of pixels outside the mask or label"),
    ],
)
def test_a_mask_without_a_whole_patch_is_refused_and_named(mask, alpha, said):
    photo = PHOTO if alpha is None else np.concatenate([PHOTO, alpha[..., None]], -1)
    given = {} if mask is None else {"mask": buffer(mask[..., None] * 1.0)}
    with pytest.raises(errors.ImageError, match="no 21x21 patch of the exemplar of 192x160 px " + said):
        filters.patchmatch(buffer(photo, names=tuple("RGBA")[: photo.shape[2]]), patch=21, **given)


def test_parts_that_stay_are_said_in_one_line_and_labels_are_not(caplog):
    ids = oiio.ImageBuf(oiio.ImageSpec(192, 160, 1, oiio.UINT32))
    ids.set_pixels(ids.roi, (1 + stripes(96, 192)).astype(np.uint32)[..., None])
    parts = {"photo": buffer(PHOTO), "label.1": ids, "m": buffer(stripes(30)[..., None] * 1.0)}
    more = {"depth": buffer(PHOTO), "normals": buffer(PHOTO)}
    with caplog.at_level(logging.WARNING, "oiiotex"):
        filters.cut(parts, mask="m", label=1, size=(40, 40))
        assert not caplog.records
        filters.cut({**parts, **more}, mask="m", label=1, size=(40, 40))
    assert [r.getMessage() for r in caplog.records] == [
        "--texcut: photo: further parts are not in the result: depth, normals"
    ]


def test_a_mask_lies_where_its_windows_say():
    photo = buffer(PHOTO)
    whole = np.zeros((*PHOTO.shape[:2], 1))
    whole[10:50, 20:60] = 1
    expected = pixels(filters.patchmatch(photo, mask=buffer(whole), seed=1))
    crop = buffer(whole[10:50, 20:60])  # as compositors crop mattes
    spec = crop.specmod()
    spec.x, spec.y, spec.full_x, spec.full_y = 20, 10, 0, 0
    spec.full_width, spec.full_height = PHOTO.shape[1::-1]
    np.testing.assert_array_equal(pixels(filters.patchmatch(photo, mask=crop, seed=1)), expected)
    away = buffer(whole)
    away.specmod().x = away.specmod().full_x = 500
    unlike = r"^patchmatch: mask is .*[+]500[+]0, but the exemplar is .*: expected the same size, or"
    with pytest.raises(errors.ImageError, match=unlike):
        filters.patchmatch(photo, mask=away)
