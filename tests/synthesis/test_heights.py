# SPDX-License-Identifier: Apache-2.0
"""Height maps among the maps of a material: steps at seams, and the constants that close them."""

from __future__ import annotations

import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.synthesis.exemplar.heights import large_steps, levels, neighbors
from tests import pictures
from tests.any_filter import buffer, pixels

pytestmark = pytest.mark.usefixtures("few_places")
ALBEDO = pictures.pebbles(96, 96, seed=4)
BUMPS = 0.04 * pictures.smooth_noise(96, 96, 5, 2)
RELIEF = BUMPS + 0.5 * pictures.smooth_noise(96, 96, 40, 7)  # which colors do not show
LEAST = 0.1 * np.ptp(RELIEF)
QUICK = {"iterations": 4, "patch": 7, "size": (64, 64), "kinds": ("color", "height"), "seed": 3}
BLIND = {"mapweights": (1, 0)}


def heights(values: np.ndarray = RELIEF, kind: object = oiio.FLOAT) -> oiio.ImageBuf:
    return buffer(values[..., None], kind, space="", names=("Y",))


def made(height: oiio.ImageBuf | None = None, **more: object):
    tile, height_tile = filters.stationarize(buffer(ALBEDO), maps=[height or heights()], **(QUICK | more))
    return tile, pixels(height_tile)[..., 0]


def places_of(st: oiio.ImageBuf) -> SourceMap:
    x, y = (np.rint(pixels(st)[..., n] * 96 - 0.5).astype(np.int64) for n in (0, 1))
    return SourceMap.of(y, x)


def patched(seed: int, side: int = 12) -> SourceMap:
    """A field of squares, each copied in one from somewhere, (48, 36) packed."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:48, :36]
    cell = (y // side) * 3 + x // side
    top, left = rng.integers(0, 96 - side, (2, 12))
    return SourceMap.of(top[cell] + y % side, left[cell] + x % side)


# --- the constants ---


@pytest.mark.parametrize("wrap", [(True, True), (False, False), (True, False)])
def test_constants_are_those_of_least_squares(wrap):
    places = patched(1)
    photo = np.random.default_rng(2).random((96, 96)).astype(np.float32)
    y, x = np.mgrid[:48, :36]
    cell = ((y // 12) * 3 + x // 12).ravel()
    rows, right = [], []
    for pairs in neighbors(places, wrap, photo):
        for p, q, step in zip(pairs.first, pairs.second, pairs.step, strict=True):
            if cell[p] != cell[q] or abs(p - q) not in (1, 36):  # or one piece that meets itself beyond the side
                row = np.zeros(12)
                row[cell[p]] += 1
                row[cell[q]] -= 1
                rows.append(row)
                right.append(-step)
    expected, *_ = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)
    got = levels(places, wrap, photo).ravel()
    per_piece = np.array([got[cell == n] for n in range(12)])
    assert (np.ptp(per_piece, axis=1) == 0).all()
    np.testing.assert_allclose(per_piece[:, 0], expected - expected.mean(), atol=1e-4)


def test_pieces_that_differ_by_constants_are_closed_altogether():
    """A smooth relief, its pieces moved up and down: nothing but the relief is left."""
    base = np.arange(48)[:, None] * 0.0 + np.sin(np.arange(36) / 36 * 2 * np.pi)
    y, x = np.mgrid[:48, :36]
    lift = np.random.default_rng(5).random(12)[(y // 12) * 3 + x // 12]
    # a photo in which every square lies apart, with its own continuation around it
    photo = np.zeros((4 * 16, 3 * 16), np.float32)
    places = np.zeros((48, 36), np.uint32)
    for row in range(4):
        for column in range(3):
            square = np.s_[row * 12 : row * 12 + 12, column * 12 : column * 12 + 12]
            wide = np.sin(np.arange(column * 12 - 2, column * 12 + 14) / 36 * 2 * np.pi) + lift[square][0, 0]
            photo[row * 16 : row * 16 + 16, column * 16 : column * 16 + 16] = wide
            inner_y, inner_x = np.mgrid[row * 16 + 2 : row * 16 + 14, column * 16 + 2 : column * 16 + 14]
            places[square] = SourceMap.of(inner_y, inner_x).packed
    closed = SourceMap(places).gather(photo) + levels(SourceMap(places), (True, True), photo)
    np.testing.assert_allclose(closed - closed.mean(), base - base.mean(), atol=1e-4)


def test_what_is_still_stays():
    places = patched(7)
    photo = np.random.default_rng(2).random((96, 96)).astype(np.float32)
    still = np.zeros(places.packed.shape, bool)
    still[:12, :12] = True
    raised = levels(places, (False, False), photo, still)
    assert (raised[still] == 0).all()
    free = levels(places, (False, False), photo)
    np.testing.assert_allclose(raised, free - free[0, 0], atol=1e-4)  # all the others relative to it


def test_large_steps_are_counted_beyond_the_sides_too():
    ramp = np.repeat(np.linspace(0, 1, 20)[None], 10, 0)
    assert large_steps(ramp, 0.1) == 0
    assert large_steps(ramp, 0.1, (True, True)) == 10 / 400
    assert large_steps(ramp, 0.1, (False, True)) == 0


# --- the filter ---


def test_cliffs_are_warned_of_and_closed(caplog):
    with caplog.at_level(logging.WARNING):
        _, blind = made(**BLIND)
    assert "cliffs at seams" in caplog.text and "relevel=1" in caplog.text and "in the photo" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        _, closed = made(**BLIND, relevel=True)
    before, after = (large_steps(one, LEAST, (True, True)) for one in (blind, closed))
    assert before > 0.05
    assert after < 0.15 * before  # pieces are few and large: a constant for each cannot close every seam


def test_a_height_is_matched_at_low_weight_when_match_is_left_out():
    _, by_default = made()
    np.testing.assert_array_equal(by_default, made(mapweights=(1, 0.25))[1])
    _, blind = made(**BLIND)
    by_default, blind = (large_steps(one, LEAST, (True, True)) for one in (by_default, blind))
    assert by_default < 0.25 * blind


def test_levelled_pieces_are_copies_plus_constants_and_nothing_else_changes():
    tile, plain = made(**BLIND, st=True)
    again, levelled = made(**BLIND, relevel=True, st=True)
    for name in ("tile", "st"):
        np.testing.assert_array_equal(pixels(tile[name]), pixels(again[name]))
    places = places_of(tile["st"])
    photo = pixels(heights())[..., 0]
    np.testing.assert_array_equal(plain, places.gather(photo))  # off by default
    raised = levelled - plain
    for pairs in neighbors(places, (True, True), photo):
        first, second = (raised.ravel()[n[pairs.together]] for n in (pairs.first, pairs.second))
        np.testing.assert_allclose(first, second, atol=1e-6)
    assert np.ptp(raised) > 0.2
    assert abs(raised.mean()) < 1e-5


def test_whole_numbers_that_cannot_hold_levelled_heights_say_so(caplog):
    roomy = 0.35 + 0.4 * RELIEF
    with caplog.at_level(logging.WARNING):
        whole = heights(roomy, oiio.UINT16)
        _, levelled = made(whole, **BLIND, relevel=True)
    assert levelled.dtype == np.uint16 and "are cut" not in caplog.text
    floats = made(heights(pixels(whole)[..., 0] / 65535), **BLIND, relevel=True)[1]
    np.testing.assert_allclose(levelled / 65535, floats, atol=8e-6)  # rounding to 16 bits
    flat = np.where(np.arange(96) < 48, 0.0, 1.0) * np.ones((96, 1))
    flat[::7] = 1 - flat[::7]  # spikes of the whole range in both halves: no constant leaves room
    with caplog.at_level(logging.WARNING):
        made(heights(flat, oiio.UINT8), **BLIND, relevel=True)
    assert "exceed the range of uint8 and are clipped" in caplog.text


def test_a_fill_raises_nothing_outside():
    within = np.zeros((96, 96, 1))
    within[30:60, 30:60] = 1
    region = buffer(within, oiio.FLOAT, space="", names=("Y",))
    given = {"maps": [heights()], "kinds": ("color", "height"), "relevel": True, "patch": 7, "iterations": 4} | BLIND
    levelled = pixels(filters.fill(buffer(ALBEDO), region, **given)[1])[..., 0]
    outside = within[..., 0] == 0
    np.testing.assert_array_equal(levelled[outside], pixels(heights())[..., 0][outside])


@pytest.mark.parametrize(("given", "said"), [
    ({"kinds": ("color", "data"), "relevel": True}, "relevel=True requires kinds with a height"),
    ({"variants": 2, "relevel": True}, "variants=2: conflicts with relevel"),
])  # fmt: skip
def test_what_does_not_go_with_levelling_is_said(given, said):
    with pytest.raises(errors.ParameterError, match=said):
        made(**given)


def test_broken_heights_are_counted():
    broken = RELIEF.copy()
    broken[3, 4] = np.nan
    with pytest.raises(errors.ImageError, match="1 NaN"):
        made(heights(broken), **BLIND)


def test_variants_say_their_steps_too(caplog):
    with caplog.at_level(logging.WARNING):
        filters.stationarize(buffer(ALBEDO), maps=[heights()], variants=2, **(QUICK | BLIND))
    assert sum("cliffs at seams" in line for line in caplog.messages) == 1
