# SPDX-License-Identifier: Apache-2.0
"""A tile that keeps the photo's layout: its period, its seams, its copies, and what it refuses."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.demand import MadeRows
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.synthesis.layout import bending
from oiiotex.synthesis.layout.kept_layout import kept_layout
from oiiotex.synthesis.layout.mending import mended
from oiiotex.synthesis.layout.periods import levels_of, rise_of
from oiiotex.synthesis.layout.seam import Joint, starts
from oiiotex.synthesis.layout.strip import PhotoStrip
from oiiotex.synthesis.patchmatch.constraints import FixedPixels
from oiiotex.synthesis.quality import judged_tries
from oiiotex.synthesis.quality.judged_tries import Try
from tests import pictures
from tests.analysis.test_regularity import values_of
from tests.any_filter import buffer, pixels
from tests.masonry import ashlar, converging

BEST, TORUS = (None, None), (True, True)


def lattice(height: int, width: int, period: tuple[int, int], rise: int = 0) -> np.ndarray:
    """Lab that repeats after `period` (x, y) px; its rows rise by `rise` px over the period along x."""
    cell = 60 * np.random.default_rng(4).random((period[1], period[0], 3))
    y, x = np.mgrid[:height, :width]
    moved = y - (2 * x * rise + period[0]) // (2 * period[0])
    return cell[moved % period[1], x % period[0]].astype(np.float32)


def whole(lab: np.ndarray) -> PhotoStrip:
    y, x = np.indices(lab.shape[:2])
    return PhotoStrip(SourceMap.of(y, x), False, lab)


@pytest.mark.parametrize("period", [(37, 29), (80, 77), (11, 43)])
def test_a_lattice_gets_its_own_period(period):
    lab = lattice(100, 128, period)
    tile = kept_layout(lab, None, BEST, TORUS).source
    assert [n % p for n, p in zip(tile.packed.shape[::-1], period, strict=True)] == [0, 0]
    shown, own = tile.gather(lab), np.tile(tile.gather(lab), (2, 2, 1))
    # an exact lattice continues exactly, across both borders
    np.testing.assert_array_equal(own[period[1] :][: len(shown)], own[: len(shown)])
    np.testing.assert_array_equal(own[:, period[0] :][:, : shown.shape[1]], own[:, : shown.shape[1]])


@pytest.mark.parametrize("rise", [-5, 3])
def test_a_tilted_lattice_becomes_level(rise):
    lab = lattice(120, 128, (90, 70), rise)
    strip = whole(lab).turned(False)
    assert rise_of(strip, levels_of(strip)) == (rise, 90)
    tile = kept_layout(lab, None, BEST, TORUS).source
    assert tile.packed.shape == (70, 90)
    y, x = tile.yx
    level = lattice(70, 90, (90, 70))
    origin = int((y[0, 0] - (2 * x[0, 0] * rise + 90) // 180) % 70), int(x[0, 0] % 90)
    np.testing.assert_array_equal(tile.gather(lab), np.roll(level, (-origin[0], -origin[1]), (0, 1)))


@pytest.mark.parametrize("share", [0.1, 0.3])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_courses_in_perspective_meet_at_the_seam(seed, share, monkeypatch):
    """A tile of converging courses is as straight across its border as the photo was before perspective."""
    picture, _ = ashlar(256, 256, seed, heights=(18, 40))
    lab = values_of(converging(picture, share))

    def straight() -> float:
        """Share of the variance along the columns that the means of rows have."""
        tile = kept_layout(lab, None, BEST, TORUS)
        light = tile.source.gather(lab)[..., 0]
        return float(light.mean(1).var() / light.var(0).mean())

    bent = straight()
    assert kept_layout(lab, None, BEST, TORUS).is_bent
    monkeypatch.setattr(bending, "bend_of", lambda *_: None)
    assert bent > 1.2 * straight()


def test_bent_columns_meet_after_a_jump_and_step_in_different_rows():
    strip = PhotoStrip(SourceMap.of(*np.indices((150, 80))), True, np.zeros((150, 80, 3), np.float32))
    distances = np.rint(5 + 4 * np.sin(np.arange(80) * np.pi / 40)).astype(int)
    x = strip.bent(distances, 100).source.yx[1]
    np.testing.assert_array_equal((x[100:] - x[:50]) % 80, np.broadcast_to(distances, (50, 80)))
    assert (np.diff(x, axis=0) != 0).mean(1).max() < 0.25


@pytest.mark.parametrize("name", ["moss", "pebbles", "bricks"])
def test_a_photo_without_courses_in_perspective_is_not_bent(name):
    assert not kept_layout(values_of(getattr(pictures, name)(192, 256, 1)), None, BEST, TORUS).is_bent


def test_the_cheapest_path_of_a_ring_ends_where_it_begins():
    """Against all paths of a small table."""
    costs = np.random.default_rng(2).integers(0, 100, (6, 3))
    for end in (None, 0, 1, 2):
        paths = np.stack(np.meshgrid(*[np.arange(3)] * 6), -1).reshape(-1, 6)
        paths = paths[(np.abs(np.diff(paths)) <= 1).all(1)]
        if end is not None:
            paths = paths[(paths[:, 0] == end) & (paths[:, -1] == end)]

        def cost(paths: np.ndarray) -> np.ndarray:
            return costs[np.arange(6), paths].sum(-1) + 7 * np.abs(np.diff(paths)).sum(-1)

        assert cost(bending._cheapest(costs, 7, end)) == cost(paths).min()


def test_the_default_keeps_the_layout_of_courses_in_perspective():
    picture, _ = ashlar(256, 256, 3, heights=(18, 40))
    photo = buffer(converging(picture, 0.12), space="lin_rec709_scene")
    made, named = filters.stationarize(photo), filters.stationarize(photo, preset="layout")
    assert made.spec().get_string_attribute("oiiotex:chosen") == "preset=layout"
    np.testing.assert_array_equal(pixels(made), pixels(named))


def test_a_cut_costs_at_most_every_straight_seam():
    """Against all straight seams, with the costs of KSE03 eq. 2 written out."""
    lab = np.rint(4 * pictures.pebbles(40, 30, 2) * 60).astype(np.float32) / 4
    joint = Joint(24, 2, 12)
    strip = whole(lab)
    grid = strip.photo_colors(*np.indices(lab.shape[:2]))

    def cost(mask: np.ndarray) -> float:
        shown = np.pad(mask, ((1, 1), (0, 0)), constant_values=((False, True), (0, 0)))
        row = np.arange(-1, 13)[:, None] + 2 + 24 * ~shown
        column = np.broadcast_to(np.arange(30), row.shape)
        total = 0.0
        for dy, dx in ((0, 1), (1, 0)):
            ys, yt = row[: 14 - dy, : 30 - dx], row[dy:, dx:]
            xs, xt = column[: 14 - dy, : 30 - dx], column[dy:, dx:]
            apart = yt - ys != dy
            both = grid[np.clip([yt - dy, ys, ys + dy, yt], 0, 39), [xt - dx, xs, xs + dx, xt]]
            away = [np.sqrt((d.astype(float) ** 2).sum(-1)) for d in (both[1] - both[0], both[2] - both[3])]
            inside = [np.sqrt((d.astype(float) ** 2).sum(-1)) for d in (both[1] - both[2], both[0] - both[3])]
            edge = np.clip(np.rint(64 * sum(away) / (2 * sum(inside) + 8)), 1, 1 << 13)
            total += edge[apart].sum()
        return total

    found = starts(strip, joint)
    straight = [cost(np.arange(12)[:, None].repeat(30, 1) >= n) for n in range(13)]
    assert cost(found) <= min(straight)


def test_a_seam_goes_around_objects_that_a_line_cannot_pass():
    """Both sides agree but for bars, between which only a seam can pass that turns back."""
    height, width, jump = 96, 240, 110
    lab = (60 * pictures.pebbles(jump + height, width, 2)).astype(np.float32)
    lab[jump:] = lab[:height]
    bars = np.zeros((height, width), bool)
    bars[:70, 80:100], bars[30:, 116:136] = True, True
    lab[jump:][bars] += 20
    found = starts(whole(lab), Joint(jump, 0, height))
    shown = np.pad(found, ((1, 1), (0, 0)), constant_values=((False, True), (0, 0)))
    seen = np.pad(bars, ((1, 1), (0, 0)))
    for axis in (0, 1):
        seam = np.diff(shown.astype(int), axis=axis) != 0
        first, second = (np.delete(seen, end, axis) for end in (-1, 0))
        assert seam.any() and not (seam & (first | second)).any()


def test_every_pixel_is_a_copy_of_the_one_that_st_names():
    photo = buffer(8 * pictures.stained(pictures.pebbles(96, 112, 3)) - 0.1, space="lin_rec709_scene")
    made = filters.stationarize(photo, preset="layout", flattening=0, st=True)
    st, own = pixels(made["st"]), pixels(photo)
    x, y = (np.floor(st[..., k] * n).astype(int) for k, n in ((0, 112), (1, 96)))
    np.testing.assert_array_equal(pixels(made["tile"]), own[y, x])
    assert made["tile"].spec().get_string_attribute("wrapmodes") == "periodic,periodic"
    assert made["tile"].spec().get_string_attribute("oiiotex:chosen") == "preset=layout"


def test_the_maps_of_a_material_have_one_layout():
    photo, other = pictures.bricks(96, 128, 1), pictures.moss(96, 128, 2)
    made = filters.stationarize(
        buffer(photo, space="lin_rec709_scene"), maps=[buffer(other, space="")], preset="layout", st=True
    )
    st = pixels(made[0]["st"])
    x, y = (np.floor(st[..., k] * n).astype(int) for k, n in ((0, 128), (1, 96)))
    np.testing.assert_array_equal(pixels(made[1]), other.astype(np.float32)[y, x])


def test_rows_from_a_file_give_the_same_tile():
    lab = (100 * pictures.pebbles(90, 120, 1)).astype(np.float32)
    rows = MadeRows(lab.shape, np.float32, lambda first, last: lab[first:last])
    first, second = (kept_layout(values, None, BEST, TORUS).source.packed for values in (lab, rows))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("size", [(200, 170), (60, 40), (128, 96), (301, 96)])
def test_a_given_size_is_kept_and_larger_ones_show_different_crops(size):
    lab = (100 * pictures.pebbles(96, 128, 1)).astype(np.float32)
    tile = kept_layout(lab, None, size, TORUS).source
    assert tile.packed.shape == size[::-1]
    y, x = tile.yx
    assert x.max() < 128 and y.max() < 96
    if size[0] > 128:  # no shift along x shows the same crop again
        row = x[0]
        shares = [(row == np.roll(row, by)).mean() for by in range(20, size[0] - 20)]
        assert max(shares) < 0.75


@pytest.mark.parametrize("tiles", ["none", "x", "y"])
def test_axes_that_do_not_tile_are_not_joined(tiles):
    photo = buffer(pictures.pebbles(96, 112, 3), space="lin_rec709_scene")
    spec = filters.stationarize(photo, preset="layout", tiles=tiles).spec()
    for axis, size, whole_side in (("x", spec.width, 112), ("y", spec.height, 96)):
        # to level a tilt along one axis costs some lines of the other
        assert size <= 0.94 * whole_side if axis in tiles else 0.85 * whole_side <= size <= whole_side
    exact = filters.stationarize(photo, preset="layout", tiles=tiles, size=(100, 90)).spec()
    assert (exact.width, exact.height) == (100, 90)


def test_excluded_pixels_are_not_shown():
    photo = np.dstack([pictures.moss(96, 96, 5), np.ones((96, 96))])
    photo[30:50, 30:60] = 0
    made = filters.stationarize(buffer(photo, space="lin_rec709_scene"), preset="layout", st=True)
    assert (pixels(made["tile"])[..., 3] == 1).all()
    mask = np.zeros((96, 96, 1), np.float32)
    mask[:20] = 1
    with pytest.raises(errors.ImageError, match="of the photo's layout is excluded"):
        filters.stationarize(buffer(pictures.moss(96, 96, 5)), mask=buffer(mask, space=""), preset="layout")


@pytest.mark.parametrize("wraps", [(True, True), (False, True)])
def test_excluded_pixels_are_replaced_in_a_piece_around_them(wraps):
    """Across the border where the tile wraps, and with the pixels around it as they are."""
    source, usable = SourceMap.of(np.arange(60)[:, None], np.arange(80)), np.ones((60, 80), bool)
    usable[:4, 20:30] = usable[56:, 24:34] = False
    pieces = []

    def synthesized(fixed: FixedPixels, wrapped: tuple[bool, bool]) -> SourceMap:
        pieces.append((fixed.where.shape, wrapped))
        return SourceMap.of(np.where(fixed.where, fixed.places.yx[0], 30), fixed.places.yx[1])

    tile = mended(source, usable, wraps, 5, synthesized)
    assert pieces == [((8 + 2 * 15, 14 + 2 * 15), (False, False))]
    assert tile.gather(usable).all()
    np.testing.assert_array_equal(tile.packed[usable], source.packed[usable])


@pytest.mark.parametrize("shape", [(1, 64), (64, 1), (14, 40)])
def test_a_photo_without_room_for_a_seam_is_refused(shape):
    with pytest.raises(errors.ImageError, match=r"smaller than a patch|expected at least 16x16 px"):
        filters.stationarize(buffer(np.full((*shape, 3), 0.5)), preset="layout")


def test_a_constant_photo_is_a_constant_tile():
    made = filters.stationarize(buffer(np.full((48, 64, 3), 0.25, np.float32)), preset="layout", flattening=0)
    assert (pixels(made) == np.float32(0.25)).all()


@pytest.mark.parametrize("modifier", [{"sigma": 8.0}, {"evenness": 0.5}, {"variants": 4}])
def test_modifiers_without_a_meaning_are_refused(modifier):
    with pytest.raises(errors.ParameterError, match="conflicts with preset=layout"):
        filters.stationarize(buffer(pictures.moss(64, 64, 5)), preset="layout", **modifier)


def test_the_default_tries_the_layout_and_says_how_to_request_it(caplog, monkeypatch):
    """What the default chooses, its line makes again."""
    photo = buffer(pictures.pebbles(96, 112, 3) ** 2.2, space="lin_rec709_scene")
    monkeypatch.setattr(judged_tries, "GOOD", 2.0)  # which no result reaches
    monkeypatch.setattr(Try, "hope", lambda *_: 2.0)
    with caplog.at_level(logging.INFO, "oiiotex"):
        made = filters.stationarize(photo)
    assert "trying preset=layout" in caplog.text and "layout kept: " in caplog.text
    chosen = dict(word.split("=") for word in made.spec().get_string_attribute("oiiotex:chosen").split(":"))
    spelled = {name: v if name == "preset" else int(v) if name == "patch" else float(v) for name, v in chosen.items()}
    np.testing.assert_array_equal(pixels(filters.stationarize(photo, **spelled)), pixels(made))
