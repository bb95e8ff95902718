# SPDX-License-Identifier: Apache-2.0
"""The judge: cut objects, repetition, missing colors, and what is not judged."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.synthesis.quality.fidelity import FAIR, GOOD, SCALES, fidelity
from oiiotex.synthesis.quality.missing_colors import missing_colors
from oiiotex.synthesis.quality.repetition import salience, slow_waves, texture_waves
from oiiotex.synthesis.quality.wholeness import cuts, times_shown, turning, unexplained
from tests import pictures
from tests.any_filter import buffer, labeled, quarters

SIDE = 192
TORUS = (True, True)
PLANE = (False, False)


def rings(seed: int = 0) -> np.ndarray:
    """Rings around the middle, Lab: lines whose direction turns."""
    y, x = np.mgrid[:SIDE, :SIDE] - SIDE / 2
    light = 50 + 20 * np.sin(np.hypot(x, y) / 3) + np.random.default_rng(seed).standard_normal((SIDE, SIDE))
    return np.stack([light, 0 * light, 0 * light], -1).astype(np.float32)


def in_place() -> SourceMap:
    return SourceMap.of(np.arange(SIDE)[:, None], np.arange(SIDE))


def shuffled(block: int) -> SourceMap:
    """Blocks of the photo in random order."""
    random, starts = np.random.default_rng(1), np.arange(0, SIDE, block)
    y, x = np.zeros((SIDE, SIDE), int), np.zeros((SIDE, SIDE), int)
    for top in starts:
        for left in starts:
            from_top, from_left = random.integers(0, SIDE - block, 2)
            y[top : top + block, left : left + block] = from_top + np.arange(block)[:, None]
            x[top : top + block, left : left + block] = from_left + np.arange(block)
    return SourceMap.of(y, x)


def test_a_copy_in_one_piece_is_whole_and_one_in_blocks_is_not():
    photo = rings()
    assert unexplained(photo, in_place(), PLANE) == 0
    shares = [unexplained(photo, shuffled(block), TORUS) for block in (48, 24, 12)]
    assert 0.05 < shares[0] < shares[1] < shares[2]


@pytest.mark.parametrize("width", [SIDE, SIDE - 1])
def test_bands_of_a_torus_are_those_of_its_blurs(width):
    photo = rings()
    tile = photo[:, :width].astype(np.float64)
    wraps = {"mode": "wrap", "truncate": 3.0, "axes": (0, 1)}
    detail = tile - gaussian_filter(tile, SIDE / 12, **wraps)
    energies = [np.sqrt((gaussian_filter(detail, SIDE / k, **wraps) ** 2).sum(-1).mean()) for k in SCALES]
    ratios = np.divide(fidelity(photo, None, tile, TORUS).bands, fidelity(photo, None, photo, TORUS).bands)
    own = photo - gaussian_filter(photo.astype(np.float64), SIDE / 12, **wraps)
    typical = [np.sqrt((gaussian_filter(own, SIDE / k, **wraps) ** 2).sum(-1).mean()) for k in SCALES]
    np.testing.assert_allclose(ratios, np.divide(energies, typical), rtol=0.01)


def test_a_cut_that_no_one_sees_is_none():
    """Two rows of a wave, moved by a whole period: the pieces continue each other."""
    wave = np.tile(np.sin(np.arange(SIDE) * 2 * np.pi / 16), (SIDE, 1))[..., None].repeat(3, 2).astype(np.float32) * 20
    x = np.where(np.arange(SIDE)[:, None] < SIDE // 2, 0, 16) + np.arange(SIDE)
    moved = SourceMap.of(np.arange(SIDE)[:, None], np.where(x < SIDE, x, x - 32))
    assert unexplained(wave, moved, PLANE) < 1e-3


def test_a_tilt_that_was_leveled_is_no_cut_and_a_jump_is_one():
    """Columns that rise by 1/8 of their distance, in whole pixels, and the same rise at once."""
    photo, y, x = rings(), np.arange(SIDE - 24)[:, None], np.arange(SIDE)
    leveled, jump = (SourceMap.of(y + by, x) for by in (x // 8, 23 * (x >= SIDE // 2)))
    for share in (12, 48):
        assert unexplained(photo, leveled, PLANE, share) == 0
        assert unexplained(photo, jump, PLANE, share) > 0.01


def test_edges_count_more_than_objects():
    """Large blocks of a photo: few edges are cut, and most objects."""
    photo, blocks = rings(), shuffled(48)
    objects, share = unexplained(photo, blocks, TORUS), cuts(photo, blocks, TORUS)
    assert cuts(photo, in_place(), PLANE) == 0
    assert 0 < share < 0.7 * objects
    assert share < cuts(photo, shuffled(12), TORUS)


def test_local_level_and_contrast_do_not_count():
    """The same picture again to the right, lighter and with less contrast; rows alternate between both."""
    one = rings()
    photo = np.concatenate([one, one * 0.8 + [20, 0, 0]], 1).astype(np.float32)
    right = np.where(np.arange(SIDE)[:, None] < SIDE // 2, 0, SIDE)
    assert unexplained(photo, SourceMap.of(np.arange(SIDE)[:, None], np.arange(SIDE) + right), PLANE) < 0.05


def test_directions_turn_in_rings_and_not_in_stripes_or_noise():
    stripes = 20 * np.sin(np.add.outer(np.arange(SIDE) / 3, np.arange(SIDE) / 5))
    noise = np.random.default_rng(0).standard_normal((SIDE, SIDE))
    assert turning(rings()[..., 0]) > 0.4
    assert turning(stripes) < 0.1 and turning(noise) < 0.2


def test_a_slow_wave_repeats_and_a_fast_one_is_texture():
    x = np.arange(SIDE) * 2 * np.pi / SIDE
    for cycles, expected in ((1, 10 / 2**0.5), (3, 10 / 2**0.5), (5, 0)):
        tile = np.zeros((SIDE, SIDE, 3))
        tile[..., 0] = 50 + 10 * np.sin(cycles * x)
        assert slow_waves(tile) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("fine", [True, False])
def test_areas_of_other_texture_repeat_even_if_all_are_as_light(fine):
    """Noise whose left half is plainer, or whose stones grow from left to right; and the same everywhere."""
    random, x = np.random.default_rng(0), np.arange(SIDE)
    noise = random.standard_normal((SIDE, SIDE))
    coarse = 4 * gaussian_filter(noise, 3, mode="wrap")
    right = 0.5 - 0.5 * np.cos(x * 2 * np.pi / SIDE)
    uneven = noise * (1 + right) if fine else noise * (1 - right) + coarse * right
    even = noise if fine else (noise + coarse) / 2
    assert texture_waves(50 + 5 * even) < 0.16 < 0.2 < texture_waves(50 + 5 * uneven)
    assert slow_waves(np.dstack([50 + 5 * uneven] * 3)) < 3.5


def test_one_spot_is_salient_and_a_weed_on_gray_stone_is_not():
    area = np.random.default_rng(0).standard_normal((64, 64, 3))
    spot, weed = area.copy(), area * [1, 0.05, 0.05]
    spot[30, 30, 0] += 20
    weed[30, 30, 1] -= 4
    assert salience(area) < 6.3 < 10 < salience(spot)
    assert salience(weed) < 6.3
    assert salience(spot, np.full((64, 64), 4.0)) == pytest.approx(2 * salience(spot), abs=0.02)


def test_an_area_is_counted_as_often_as_the_tile_shows_it():
    y, x = np.mgrid[:SIDE, :SIDE]
    size = (SIDE, SIDE)
    assert times_shown(SourceMap.of(y, x), size, size, size, 6.0).max() < 1.01
    for top, left in ((0, 0), (0, 96), (96, 96)):
        y[top : top + 48, left : left + 48] = 96 + np.arange(48)[:, None]
        x[top : top + 48, left : left + 48] = np.arange(48)
    shown = times_shown(SourceMap.of(y, x), size, size, size, 6.0)
    assert [round(float(shown[at])) for at in ((24, 24), (24, 120), (120, 120), (120, 24))] == [4, 4, 4, 4]
    assert shown[24, 72] == pytest.approx(1.0, abs=0.1)


def test_shuffled_rings_are_poor_by_the_judge_and_the_photo_is_not_cut():
    photo = rings()
    source = shuffled(24)
    judged = fidelity(photo, None, source.gather(photo), TORUS, source)
    assert judged.value < FAIR and judged.beyond[0] == "objects or patterns are cut"
    assert "objects or patterns are cut" not in fidelity(photo, None, photo, PLANE, in_place()).beyond


def test_colors_that_flattening_removed_are_missing():
    flat = rings()
    colored = flat.copy()
    colored[:, : SIDE // 2, 1] += 60
    kept, lost = (fidelity(flat, None, flat, PLANE, in_place(), own) for own in (flat, colored))
    assert kept.missing < 0.01 and lost.missing > 0.4
    assert "colors of the photo are missing" in lost.beyond


def test_a_color_is_missing_if_it_is_less_than_half_as_frequent():
    def pixels(eighths: int) -> np.ndarray:
        return np.where((np.arange(1200) // 3 % 8 < eighths)[:, None], (60.0, 40.0, 0.0), (20.0, 0.0, 0.0))

    assert [missing_colors(pixels(4), pixels(n)) for n in (4, 3, 2, 1, 0)] == [0, 0, 0, 0.25, 0.5]


def test_a_constant_image_has_lost_nothing():
    plain = np.full((SIDE, SIDE, 3), 40, np.float32)
    for source in (None, in_place()):
        assert fidelity(plain, None, plain, TORUS, source).value >= GOOD


@pytest.mark.parametrize("measure", ["fidelity<0.8", "broken>1", "waves>9", "salient>9"])
def test_paintings_compositions_and_fills_are_not_judged_by_the_photo(measure):
    photo = buffer(pictures.pebbles(64, 64, 1))
    region = np.zeros((64, 64), np.float32)
    region[20:30, 20:30] = 1
    for make in (
        lambda: filters.paint(labeled(photo), quarters(), patch=16, fail=[measure]),
        lambda: filters.composite(labeled(photo), patch=16, fail=[measure]),
        lambda: filters.fill(photo, buffer(region[..., None], space=""), fail=[measure]),
    ):
        with pytest.raises(errors.ParameterError, match="is not measured for this result"):
            make()
