# SPDX-License-Identifier: Apache-2.0
"""--textransition: tiles of two materials that fit each other in any map."""

from __future__ import annotations

import itertools

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.errors import ImageError, ParameterError
from oiiotex.synthesis.graphcut.seams import NEIGHBORS, GridEdges, chosen, edges, edges_at
from oiiotex.synthesis.wang.transition import LAYOUT, TransitionTiles, controls, shown, widest
from tests import pictures
from tests.any_filter import buffer

SIDE = 64


def tile(values: np.ndarray, kind: object = oiio.FLOAT, periodic: bool = True) -> oiio.ImageBuf:
    made = buffer(values, kind)
    if periodic:
        made.specmod().attribute("wrapmodes", "periodic,periodic")
    return made


def stones(seed: int, side: int = SIDE) -> np.ndarray:
    return np.asarray(pictures.bricks(side, side, seed=seed), np.float32)


def flat(level: float, side: int = SIDE) -> np.ndarray:
    """Lab of a gray with some noise."""
    noise = np.random.default_rng(0).normal(0, 1, (side, side, 1))
    return np.concatenate([level + noise, 0 * noise, 0 * noise], -1).astype(np.float32)


@pytest.fixture(scope="module", params=[16, 47])
def found(request: pytest.FixtureRequest) -> tuple[int, object]:
    count = request.param
    return count, shown((flat(30), flat(70)), count, 0.8 * widest(count, SIDE), 5, lambda *_: None)


def test_the_sets_are_complete():
    corners = controls(16)
    assert len({tuple(one.ravel()) for one in corners}) == 16
    blobs = controls(47)
    assert len({tuple(one.ravel()) for one in blobs}) == len(blobs) == LAYOUT[47].width * LAYOUT[47].height == 48
    assert not blobs[-1].any() and all(one[1, 1] for one in blobs[:-1])
    for one, (y, x) in itertools.product(blobs, ((0, 0), (0, 2), (2, 0), (2, 2))):
        assert not one[y, x] or (one[y, 1] and one[1, x])


def test_tiles_that_may_meet_agree_along_their_edge(found):
    """The pixels of a tile's edge, and those beyond it, are those of every neighbor that may lie there."""
    count, one = found
    points, depth = controls(count), one.depth
    meetings = 0
    for left, right in itertools.product(range(len(points)), repeat=2):
        if (points[left][:, -1] == points[right][:, 0]).all():
            meetings += 1
            np.testing.assert_array_equal(
                one.around(left)[depth:-depth, -depth:], one.tiles[right][:, :depth], f"{left} {right}"
            )
            np.testing.assert_array_equal(one.around(right)[depth:-depth, :depth], one.tiles[left][:, -depth:])
        if (points[left][-1] == points[right][0]).all():
            np.testing.assert_array_equal(one.around(left)[-depth:, depth:-depth], one.tiles[right][:depth])
    assert meetings == (64 if count == 16 else meetings) and meetings > 48


def test_each_material_lies_at_its_points(found):
    count, one = found
    for points, pixels in zip(controls(count), one.tiles, strict=True):
        corners = pixels[:: SIDE - 1, :: SIDE - 1]
        np.testing.assert_array_equal(corners, points[:: len(points) - 1, :: len(points) - 1] == 1)
        if count == 47:
            assert pixels[SIDE // 2, SIDE // 2] == points[1, 1]


def test_weights_continue_across_edges(found):
    """A ramp that the neighbor continues: no step at an edge is larger than one inside."""
    count, one = found
    points = controls(count)
    left = next(n for n, each in enumerate(points) if each[0, -1] != each[-1, -1])
    rights = [n for n, each in enumerate(points) if (each[:, 0] == points[left][:, -1]).all()]
    assert len(rights) > 1
    for right in rights:
        row = np.concatenate([one.weights(left)[:, -8:], one.weights(right)[:, :8]], 1)
        steps = np.abs(np.diff(row, axis=1))
        assert steps[:, 7].max() <= steps.max() and steps[:, 7].max() <= 1 / one.depth + 1e-6
        assert row.min() == 0 and row.max() == 1


def test_weights_of_the_other_material_are_the_rest(found):
    """The ramp is centered on the border: half of a pixel's step to either side of it."""
    _, one = found
    other = TransitionTiles([~tile for tile in one.tiles], one.depth, lambda number: ~one.around(number))
    for number in (1, 2, 5):
        np.testing.assert_allclose(one.weights(number) + other.weights(number), 1, atol=1e-6)
        assert (one.weights(number) > 0.5).tolist() == one.tiles[number].tolist()


def test_borders_follow_objects():
    """Bright squares in both diagonals and in the middle of the tile stay whole, where a straight border cuts them."""
    lab = np.full((SIDE, SIDE, 3), (20, 0, 0), np.float32)
    squares = [np.s_[y : y + 10, x : x + 10] for y, x in itertools.product(range(-5, SIDE, 16), repeat=2)]
    squares = [(slice(max(0, y.start), y.stop), slice(max(0, x.start), x.stop)) for y, x in squares]
    for place in squares:
        lab[place] = (80, 0, 0)
    other = np.full((SIDE, SIDE, 3), (20, 0, 0), np.float32)
    cut = {}
    for name, width in (("led", 0.8 * widest(16, SIDE)), ("straight", 1.0)):
        tiles = shown((other, lab), 16, width, 3, lambda *_: None).tiles
        shares = [tile[place].mean() for tile in tiles for place in squares if min(place[0].stop, place[1].stop) > 16]
        cut[name] = sum(0.02 < share < 0.98 for share in shares)
    assert cut["straight"] > 10 and cut["led"] == 0


def test_large_tiles_are_refined_from_a_coarse_border():
    """Where the border of 256 px says so, the cut decides on the pixels beside it only."""
    lab = (flat(30, 300), flat(70, 300))
    one = shown(lab, 16, 100, 5, lambda *_: None)
    assert len(one.tiles) == 16 and one.tiles[0].shape == (300, 300)
    points = controls(16)
    for left, right in itertools.product(range(16), repeat=2):
        if (points[left][:, -1] == points[right][:, 0]).all():
            depth = one.depth
            np.testing.assert_array_equal(one.around(left)[depth:-depth, -depth:], one.tiles[right][:, :depth])


def test_every_pixel_is_that_of_one_tile_at_its_place():
    first, second = (stones(n) for n in (1, 2))
    made = filters.transition(tile(first), tile(second), as_array=True)
    repeated = [np.tile(one, (4, 4, 1)) for one in (first, second)]
    same = [(made == one).all(-1) for one in repeated]
    assert (same[0] | same[1]).all() and min(one.mean() for one in same) > 0.3


def test_maps_share_their_borders():
    """All maps of a material show the same one at each pixel; the second color decides nothing."""
    colors, data = (
        [tile(stones(n)) for n in (1, 2)],
        [buffer(np.full((SIDE, SIDE, 1), n), space="data") for n in (0, 1)],
    )
    for one in data:
        one.specmod().attribute("wrapmodes", "periodic,periodic")
    atlas, mask = filters.transition(colors[0], data[0], colors[1], data[1], kinds=["color", "data"], as_array=True)
    second = np.tile(stones(2), (4, 4, 1))
    np.testing.assert_array_equal((atlas == second).all(-1), mask == 1)


def test_the_set_of_16_repeats_as_a_whole():
    made = filters.transition(tile(stones(1)), tile(stones(2)))
    assert made.spec().get_string_attribute("wrapmodes") == "periodic,periodic"
    assert made.spec().get_string_attribute("oiiotex:atlas") == "4x4"
    blob = filters.transition(tile(stones(1)), tile(stones(2)), count=47)
    assert blob.spec().get_string_attribute("wrapmodes") == ""
    assert (blob.spec().width, blob.spec().height) == (8 * SIDE, 6 * SIDE)


def test_seeds_change_borders():
    one, same, other = (
        filters.transition(tile(stones(1)), tile(stones(2)), seed=n, as_array=True) for n in (1, 1, 2)
    )  # fmt: skip
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


@pytest.mark.parametrize(
    ("images", "values", "message"),
    [
        ((tile(stones(1), periodic=False), tile(stones(2))), {}, "does not tile"),
        ((tile(stones(1)), tile(stones(2, 48))), {}, "expected 64x64"),
        ((tile(stones(1)), tile(stones(2)[..., :1])), {}, "has channels"),
        ((tile(stones(1)), tile(stones(2), oiio.UINT8)), {}, "has pixel type uint8"),
        ((tile(stones(1)),), {}, "2 images for each kind"),
        ((tile(stones(1, 12)), tile(stones(2, 12))), {}, "too small"),
        ((tile(stones(1)), tile(stones(2))), {"width": 80.0}, "at most 58 px"),
        ((tile(stones(1)), tile(stones(2))), {"count": 15}, "one of 16, 47"),
        ((buffer(stones(1), space=""), buffer(stones(2), space="")), {"tiled": "xy"}, "color space"),
    ],
)
def test_what_does_not_fit_is_refused(images, values, message):
    with pytest.raises((ImageError, ParameterError, Exception), match=message):
        filters.transition(*images, **values)


def test_edges_at_pixels_are_those_of_the_grid():
    random = np.random.default_rng(0)
    for _ in range(20):
        pixels = random.random(random.integers(1, 9, 2)) < 0.4
        for step in NEIGHBORS:
            s, t = edges(pixels.shape, step)
            beside = pixels.ravel()[s] | pixels.ravel()[t]
            found = list(zip(*(one.tolist() for one in edges_at(pixels, step)), strict=True))
            assert sorted(found) == sorted(zip(s[beside].tolist(), t[beside].tolist(), strict=True))


def test_a_minimum_cut_between_fixed_pixels():
    """A row of four pixels between one that is chosen and one that is not is cut where it is cheapest."""
    free = np.array([[False, True, True, True, True, False]])
    fixed = np.array([[False, False, False, False, False, True]])
    s, t = edges(free.shape, (0, 1))
    cost = np.array([5, 4, 1, 6, 7])
    made = chosen(free, fixed, np.zeros(6, np.int64), [GridEdges(s, t, cost, cost)])
    np.testing.assert_array_equal(made, [[False, False, False, True, True, True]])
