# SPDX-License-Identifier: Apache-2.0
"""An atlas of Wang tiles: its layout, its plane, and filtering across borders."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.reading import read
from oiiotex.engine.session import Session
from oiiotex.oiiotool.service.texture_file import read_texture_file
from oiiotex.oiiotool.service.textures import OpenTexture
from oiiotex.synthesis.exemplar.heights import large_steps
from oiiotex.synthesis.wang.atlas import atlas_edges, atlas_numbers, first_tile
from oiiotex.synthesis.wang.plane import CELLS, index_image, plane_of
from oiiotex.synthesis.wang.tiles import COUNTS, depths, edges_of, joined
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex
from tests.reference.wang import border_steps, sample_wang
from tests.refusals import refused

pytestmark = pytest.mark.usefixtures("few_places")
PHOTO = pictures.stained(pictures.pebbles(96, 112, 3))
HEIGHTS = (0.5 + np.sin(np.arange(96) / 9)[:, None] * np.cos(np.arange(112) / 11) / 4)[..., None]  # unlike the colors
SMALL = {"size": (32, 32), "iterations": 4, "patch": 7, "seed": 1, "variants": 16}


@pytest.fixture(scope="module")
def atlas(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of an atlas of 16 tiles of 32 px."""
    path = tmp_path_factory.mktemp("atlas") / "atlas.exr"
    filters.stationarize(buffer(PHOTO), pack="atlas", **SMALL).write(str(path))
    return path


@pytest.mark.parametrize("count", COUNTS)
def test_neighbors_in_an_atlas_share_edges_across_its_borders_too(count):
    edges, numbers = atlas_edges(count), atlas_numbers(count)
    side = len(edges)
    assert sorted(numbers.ravel()) == list(range(count))
    for y, x in itertools.product(range(side), repeat=2):
        assert edges_of(count)[numbers[y, x]] == edges[y][x]
        assert edges[y][x].east == edges[y][(x + 1) % side].west
        assert edges[y][x].south == edges[(y + 1) % side][x].north
    assert len(set(Counter(itertools.chain(*edges)).values())) == 1


def test_an_atlas_has_the_tiles_of_the_set_and_all_maps_together(atlas):
    tiles = [pixels(tile) for tile in filters.stationarize(buffer(PHOTO), **SMALL)]
    packed = np.concatenate([np.concatenate([tiles[n] for n in row], axis=1) for row in atlas_numbers(16).tolist()])
    np.testing.assert_array_equal(packed.astype(np.float32), load(atlas))
    two = {"maps": [buffer(PHOTO[..., :1], space="data")], "mapweights": (1, 0)}
    color, gray = filters.stationarize(buffer(PHOTO), pack="atlas", flattening=0, **two, **SMALL | {"variants": 4})
    np.testing.assert_array_equal(pixels(color)[..., :1], pixels(gray))
    assert color.spec().get_string_attribute("oiiotex:atlas") == "2x2"
    tile = first_tile(read(str(atlas))).first
    assert (tile.spec.width, tile.spec.height) == (32, 32)
    np.testing.assert_array_equal(tile.pixels(), tiles[0].astype(np.float32))


@pytest.mark.parametrize("variants", [1, 8, 20])
def test_a_set_that_does_not_fill_a_square_is_refused(variants):
    with refused(errors.Error, parameter="pack", value="atlas", problem="requires variants=4, 16 or 64"):
        filters.stationarize(buffer(PHOTO), pack="atlas", **SMALL | {"variants": variants})


@pytest.mark.parametrize("count", [3, *COUNTS])
def test_a_plane_closes_and_uses_all_tiles_equally(count):
    edges = edges_of(count)
    plane = plane_of(edges, seed=5)
    around = np.array(edges)[plane]
    np.testing.assert_array_equal(around[..., 2], np.roll(around[..., 0], -1, 0))
    np.testing.assert_array_equal(around[..., 1], np.roll(around[..., 3], -1, 1))
    shares = np.bincount(plane.ravel()) * count / CELLS**2
    assert len(shares) == count and np.abs(shares - 1).max() < 0.15
    assert (plane != plane_of(edges, seed=6)).mean() > 0.5 * (1 - 1 / count)


def test_the_index_image_is_the_first_period_of_an_endless_texture(tmp_path):
    """To the bit: an atlas of tiles of 1 px, so the plane's pixels are its tiles."""
    atlas = np.arange(16, dtype=np.float32).reshape(4, 4, 1).repeat(3, 2)
    image = buffer(atlas, space="data")
    image.specmod().attribute("oiiotex:atlas", "4x4")
    image.write(str(tmp_path / "a.exr"))
    document = tmp_path / "a.oiiotex"
    document.write_text(json.dumps({"oiiotex": 1, "tiles": "a.exr", "size": "1024x512", "seed": 9}))
    texture = OpenTexture(read_texture_file(str(document)).text(), Session(budget=1 << 28))
    index = index_image(16, seed=9).astype(int)
    plane = texture.tile(0, Window(0, 0, CELLS, CELLS), Session())[..., 0].astype(int)
    np.testing.assert_array_equal(plane, 4 * index[..., 1] + index[..., 0])
    np.testing.assert_array_equal(plane, index[..., 2])
    further = texture.tile(0, Window(-CELLS, 2 * CELLS - 8, 8 - CELLS, 2 * CELLS), Session())[..., 0]
    np.testing.assert_array_equal(further, plane[-8:, :8])


def test_a_set_of_tiles_that_are_too_small_is_warned_about(caplog):
    """A wall, whose courses are broken in tiles of four bricks."""
    wall = buffer(pictures.stained(pictures.bricks(96, 112, 1)))
    given = {"pack": "atlas", "variants": 4, "size": (52, 52), "iterations": 2}
    with caplog.at_level("WARNING", "oiiotex"):
        filters.stationarize(wall, patch=7, **given)
        assert "fidelity" not in caplog.text  # scales that the user chose
        filters.stationarize(wall, **given)
    assert "Tiles must be several times larger than the photo's elements" in caplog.text


def test_steps_of_heights_are_those_of_the_whole_plane_and_leveled_heights_join_everywhere_in_it(caplog):
    """A constant is added to each piece, the same one wherever tiles share an edge."""
    with caplog.at_level("INFO", "oiiotex"):
        plain = atlas_of_heights()
    assert f"{large_share(plain):.2f} % of neighboring heights" in caplog.text
    leveled = atlas_of_heights(relevel=True)
    assert large_share(leveled) < 0.6 * large_share(plain)
    sides = (leveled - plain).reshape(4, 32, 4, 32).swapaxes(1, 2).reshape(16, 32, 32)
    colors = [edges for row in atlas_edges(16) for edges in row]
    for edge, line in (("north", np.s_[0]), ("south", np.s_[-1]), ("west", np.s_[:, 0]), ("east", np.s_[:, -1])):
        for color in {getattr(one, edge) for one in colors}:
            alike = [tile[line] for tile, one in zip(sides, colors, strict=True) if getattr(one, edge) == color]
            for other in alike[1:]:
                np.testing.assert_allclose(other, alike[0], atol=1e-6)


def atlas_of_heights(**given) -> np.ndarray:
    """The heights of an atlas, (128, 128), copied where colors agree."""
    given |= {"maps": [buffer(HEIGHTS, space="data")], "kinds": ("color", "height"), "mapweights": (1, 0)}
    made = filters.stationarize(buffer(PHOTO), pack="atlas", **given, **SMALL | {"iterations": 2})
    return pixels(made[1])[..., 0]


def large_share(heights: np.ndarray) -> float:
    return 100 * large_steps(heights, 0.1 * float(np.ptp(HEIGHTS)), (True, True))


def test_mip_levels_join_down_to_a_pixel_a_tile(atlas, tmp_path):
    """Level by level as -otex writes it, compared with tiles in an order in which neighbors do not share edges."""
    done = oiiotex(atlas, "-otex", "a.tx", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    tx, index = oiio.ImageInput.open(str(tmp_path / "a.tx")), index_image(16, 0)
    fine, numbers = load(atlas), np.random.default_rng(2).permutation(16)
    tiles = fine.reshape(4, 32, 4, 32, 3).swapaxes(1, 2).reshape(16, 32, 32, 3)
    shuffled = tiles[numbers].reshape(4, 4, 32, 32, 3).swapaxes(1, 2).reshape(128, 128, 3)
    place = np.argsort(numbers)[index[..., 2]]
    seam = border_steps(shuffled, np.stack([place % 4, place // 4], -1), 4)
    assert seam > 4 / 255
    for level in range(6):
        texels = tx.read_image(0, level, 0, 3, oiio.FLOAT)
        assert texels.shape[:2] == (128 >> level,) * 2
        means = fine.reshape(128 >> level, 1 << level, 128 >> level, 1 << level, 3).mean((1, 3))
        np.testing.assert_allclose(texels, means, atol=2e-3)
        # texels up to the width of the strip belong to the edge; larger ones are means of tiles, which differ
        assert border_steps(texels, index, 4) < (1e-3 if 1 << level <= SMALL["patch"] else seam / 2), level


def test_the_reference_sampler_reads_the_plane(atlas):
    index = index_image(16, 0)
    y, x = (np.indices((64, 64)) + 0.5) / 32
    plane = sample_wang(load(atlas), index, 4, x, y)
    tile = plane[32:, :32]
    column, row = index[1, 0, :2].astype(int)
    wanted = load(atlas)[32 * row : 32 * row + 32, 32 * column : 32 * column + 32]
    np.testing.assert_allclose(tile, wanted, atol=1e-6)


def test_a_cut_follows_the_least_error_and_ends_at_the_border():
    rng = np.random.default_rng(3)
    errors_at = rng.random((7, 4)) + 0.1
    found = depths(errors_at)
    every = [
        path
        for path in itertools.product(range(4), repeat=7)
        if path[0] == path[-1] == 0 and max(abs(a - b) for a, b in itertools.pairwise(path)) <= 1
    ]
    best = min(every, key=lambda path: errors_at[range(7), path].sum())
    np.testing.assert_array_equal(found, best)


def test_the_courses_of_a_brick_wall_are_unbroken_across_tiles():
    photo = pictures.bricks(64, 64, 1)
    assert (photo[::8, :, 0] > 0.7).mean() > 0.99 > (photo[4::8, :, 0] > 0.7).mean()  # mortar: light
    atlas = pixels(filters.stationarize(buffer(photo), pack="atlas", flattening=0, **SMALL | {"size": None}))
    side = atlas.shape[0] // 4
    assert atlas.shape == (256, 256, 3)  # the lattice closes on 64 px
    y, x = (np.indices((6 * side, 6 * side)) + 0.5) / side
    light = sample_wang(atlas, index_image(16, 0), 4, x, y)[..., 0] > 0.7
    course = int(light.reshape(-1, 8, 6 * side).mean((0, 2)).argmax())
    assert light[course::8].mean() > 0.98  # every line of mortar, over all tiles
    bricks = np.delete(light, np.s_[course::8], axis=0)
    upright = bricks.reshape(-1, 7, 6 * side).all(1)  # joints through a whole course
    own = np.delete(photo[..., 0] > 0.7, np.s_[::8], axis=0).reshape(-1, 7, 64).all(1)
    assert upright.sum(1).min() >= 0.9 * own.sum(1).min() * 6


def test_a_strip_does_not_end_in_a_straight_line_where_nothing_is_better():
    """A cut along the border costs as much as one inside: deeper, where the error is smaller, it is cheaper."""
    lab, other = np.zeros((40, 8, 3), np.float32), np.ones((40, 8, 3), np.float32)
    other[10:30, 4:] = 0.75
    sources = np.zeros((40, 8), np.uint32), np.ones((40, 8), np.uint32)
    depth = joined(*sources, lab, other, 8).sum(1)
    assert (depth[14:26] > 4).all() and depth[0] == depth[-1] == 0
