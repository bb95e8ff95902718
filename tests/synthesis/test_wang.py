# SPDX-License-Identifier: Apache-2.0
"""Tiles whose edges match each other."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.synthesis.wang.tiles import Edges, between, edges_of, runs_for
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex, save
from tools.docs.pictures.wang_plane import random_plane

PHOTO = pictures.stained(pictures.pebbles(96, 112, 3))
SMALL = {"size": (56, 64), "iterations": 4, "patch": 7, "seed": 1}


def test_sixteen_tiles_have_all_edges_and_eight_two_for_each_corner():
    assert sorted(edges_of(16)) == sorted(between(*corners) for corners in itertools.product((0, 1), repeat=4))
    assert edges_of(16)[0b0110] == Edges(1, 2, 2, 1)  # upper left 0, upper right 1, lower left 1, lower right 0
    for count in (8, 9, 12):
        edges = edges_of(count)
        for corner in ((0, 0), (0, 1), (1, 0), (1, 1)):
            fitting = [e for e in edges if (e.north, e.west) == corner]
            assert len(fitting) >= 2 and len({(e.east, e.south) for e in fitting}) >= 2
    assert edges_of(3) == [Edges(0, 0, 0, 0)] * 3
    assert (runs_for(3), runs_for(8), runs_for(16)) == (4, 10, 20)


@pytest.mark.parametrize("count", [2, 9])
def test_tiles_meet_as_the_inside_meets_itself(count):
    """The worst line across an edge is no worse than the worst inside, on average: of one seed either may be."""
    edges, worst = edges_of(count), []
    for seed in range(3):
        tiles = filters.stationarize(buffer(PHOTO), variants=count, **{**SMALL, "seed": seed})
        light = [pixels(tile)[..., 1] for tile in tiles]
        assert [t.spec().get_string_attribute("oiiotex:edges") for t in tiles] == [str(e) for e in edges]
        assert len({t.tobytes() for t in light}) == count  # and differ
        for axis, near, far in ((0, "south", "north"), (1, "east", "west")):
            inside = max(np.abs(np.diff(t, axis=axis)).mean(1 - axis).max() for t in light)
            meeting = [
                np.abs(a.take(-1, axis) - b.take(0, axis)).mean()
                for a, one in zip(light, edges, strict=True)
                for b, other in zip(light, edges, strict=True)
                if getattr(one, near) == getattr(other, far)
            ]
            worst.append(max(meeting) / inside)
    assert np.mean(worst) <= 1, worst


def test_all_pairs_across_an_edge_are_the_same_pixels():
    edges = edges_of(8)
    tiles = [pixels(t) for t in filters.stationarize(buffer(PHOTO), variants=8, **SMALL)]
    for name, take in {
        "east": lambda t: t[:, -7:], "west": lambda t: t[:, :7], "north": lambda t: t[:7], "south": lambda t: t[-7:],
    }.items():  # fmt: skip
        for color in (0, 1):
            same = [take(t) for t, e in zip(tiles, edges, strict=True) if getattr(e, name) == color]
            middle = [s[7:-7] if name in ("east", "west") else s[:, 7:-7] for s in same]
            assert all((m == middle[0]).all() for m in middle) and len(same) > 1


def test_seams_of_a_plane_are_no_worse_than_its_inside():
    """Of one seed any share of the lines inside may be quieter, on average half of them: a seam that shows has all."""
    quieter = []
    for seed in (1, 2, 3):
        tiles = [pixels(t)[..., 1] for t in filters.stationarize(buffer(PHOTO), variants=8, **SMALL | {"seed": seed})]
        plane = random_plane(edges_of(8), 6, 7, seed=3)
        picture = np.block([[tiles[n] for n in row] for row in plane])
        for axis, side in ((1, 56), (0, 64)):
            jumps = np.abs(np.diff(picture, axis=axis)).mean(1 - axis)
            quieter.append((jumps < jumps[side - 1 :: side].mean()).mean())
    assert np.mean(quieter) <= 0.8
    assert len(np.unique(plane)) > 5
    np.testing.assert_array_equal(plane, random_plane(edges_of(8), 6, 7, seed=3))


def test_variants_of_a_material_come_tile_by_tile(tmp_path):
    save(PHOTO, tmp_path / "a.png")
    save(PHOTO[..., :1], tmp_path / "b.png")
    op = "--texstationarize:kinds=color,data:mapweights=1,0:variants=2:size=40x40:patch=7"
    done = oiiotex("a.png", "b.png", op, "-o:all=0", "t%d.tif", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    shapes = [load(tmp_path / f"t{n}.tif").shape for n in range(4)]
    assert shapes == [(40, 40, 3), (40, 40, 1)] * 2
    done = oiiotex(
        "a.png", op.replace("kinds=color,data:mapweights=1,0:", ""), "--siappendall", "-o", "set.exr", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert "wang01_n0e0s0w0" in oiiotex("--info", "-v", "-a", "set.exr", cwd=tmp_path).stdout


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"tiles": "x"}, "variants=2: conflicts with tiles=x"),
        (
            {"size": (24, 64)},
            "tiles of 24x64 px are too small for border strips of 7 px: expected at least 28x28 px",
        ),
    ],
)
def test_what_variants_cannot_do_is_said(given, said):
    given = {name: buffer(v) if isinstance(v, np.ndarray) else v for name, v in given.items()}
    with pytest.raises(errors.Error, match=said):
        filters.stationarize(buffer(PHOTO), **{**SMALL, "variants": 2, **given})
