# SPDX-License-Identifier: Apache-2.0
"""search=coherent: links are exact nearest neighbors, the kernel is the oracle's, and nothing is searched at random."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.synthesis.patchmatch import field as pm
from oiiotex.synthesis.patchmatch import patch_search
from oiiotex.synthesis.patchmatch.matcher import _penalty_unit
from oiiotex.synthesis.patchmatch.patch_search import COHERENT, Links, coherent_links
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.reference import patchmatch as reference
from tests.synthesis.test_patchmatch import GEOMETRIES, setup

PHOTO = pictures.stained(pictures.pebbles(72, 80, 2)).astype(np.float32)
SMALL = {"size": (56, 48), "iterations": 2, "patch": 7, "seed": 3}


@pytest.mark.parametrize("cells", [40, 2048])  # cells of several pixels, and of one
@pytest.mark.parametrize("masked", [False, True])
def test_links_are_the_nearest_patches_that_are_apart(monkeypatch, cells, masked):
    monkeypatch.setattr(patch_search, "_CELLS", cells)
    g = pm.Geometry(9, 9, True, True, exemplar_width=29, exemplar_height=25, patch=7)
    image = np.random.default_rng(3).integers(-300, 300, (25, 29, 3)).astype(np.int16)
    usable = np.ones((25, 29), bool)
    usable[4:11, 12:15] = not masked
    allowed = pm.allowed_patches(usable, g)
    links = Links.of(image, allowed, g)
    assert (links.side > 1) == (cells == 40)
    y, x = np.arange(0, g.exemplar_rows, links.side), np.arange(0, g.exemplar_columns, links.side)
    used = [(r, c) for r in y for c in x if allowed[r : r + links.side, c : c + links.side].any()]
    reduced = patch_search._reduced(image, y, x, g.patch)
    values = np.array([reduced[r // links.side, c // links.side] for r, c in used])
    corner = np.array(used)
    found = reference.nearest(values, corner, allowed[corner[:, 0], corner[:, 1]], 2, patch_search._NEAREST)
    for own, ((r, c), chosen) in enumerate(zip(used, found, strict=True)):
        wanted = [*chosen, *[own] * (patch_search.LINKS - len(chosen))]
        assert links.places[r // links.side, c // links.side].tolist() == [y << 16 | x for y, x in corner[wanted]]


def test_of_equal_patches_the_first_are_linked():
    """So that links do not depend on how a tree was built: each ninth of a photo is the same."""
    g = pm.Geometry(9, 9, True, True, exemplar_width=48, exemplar_height=48, patch=7)
    image = np.tile(np.random.default_rng(3).integers(-300, 300, (16, 16, 3)), (3, 3, 1)).astype(np.int16)
    places = Links.of(image, pm.allowed_patches(np.ones((48, 48), bool), g), g).places
    equal = [y << 16 | x for y in range(0, 42, 16) for x in range(0, 42, 16)]
    assert places[16, 16].tolist() == [place for place in equal if place != 16 << 16 | 16]


@pytest.mark.parametrize("g", GEOMETRIES)
def test_a_pass_of_propagation_and_links_is_the_oracles(all_lanes, g, monkeypatch):
    monkeypatch.setattr(patch_search, "_CELLS", 20)
    oracle = None
    for device in all_lanes:
        exemplar = setup(device, g, 3)[3]
        links = Links.of(exemplar, pm.allowed_patches(None, g), g)
        assert links.side > 1
        matcher, _, target, exemplar, y, x = setup(device, g, 3, 0.05, search=coherent_links(device, links))
        matcher.improve(1, step=4)
        if oracle is None:
            weight = 0.05 * _penalty_unit(exemplar, g)
            oracle = reference.Oracle(target, exemplar, g, y, x, reference.penalties(y, x, g, weight))
            before = oracle.cost.sum()
            oracle.one_pass(seed=5, step=64, links=links)
            assert oracle.cost.sum() < before
        found_y, found_x = matcher.field().yx
        np.testing.assert_array_equal(found_y, oracle.y)
        np.testing.assert_array_equal(found_x, oracle.x)


@pytest.mark.parametrize("patch", range(5, 22, 2))
def test_weights_of_waves_do_not_depend_on_the_last_bit_of_a_cosine(patch):
    """They are rounded far from halves, so every processor has the same."""
    phase = np.pi * (np.arange(patch) + 0.5) / patch
    along = [np.full(patch, 0.5**0.5), np.cos(phase), np.cos(2 * phase)]
    for down, across in ((v, u) for v in range(3) for u in range(3 - v)):
        exact = patch_search._SCALE * along[down][:, None] * along[across]
        assert np.abs(np.abs(exact % 1) - 0.5).min() > 1e-9, (down, across)


REGION = np.zeros((72, 80, 1), np.float32)
REGION[30:44, 30:50] = 1
LINES = {
    "stationarize": ([PHOTO], SMALL),
    "fill": ([PHOTO, REGION], {"patch": 7, "iterations": 2}),
}


@pytest.mark.parametrize("name", LINES)
def test_coherent_is_the_same_again_and_not_the_random_result(name):
    images, values = LINES[name]
    images = [buffer(one) for one in images]
    first, again, random = (
        pixels(getattr(filters, name)(*images, **values, **more))
        for more in ({"search": COHERENT}, {"search": COHERENT}, {})
    )
    np.testing.assert_array_equal(first, again)
    assert (first != random).any()


@pytest.mark.parametrize("name", [*LINES, "quilt"])
def test_nothing_is_searched_at_random(name, monkeypatch, tmp_path):
    """Neither where coherent is chosen, nor for the report of a quilt, which needs no such choice."""
    make = patch_search.random_windows

    def refuse(device, geometry, seed, count=patch_search.WINDOWS):
        assert count == 0
        return make(device, geometry, seed, count)

    for module in ("patch_search", "matcher"):
        monkeypatch.setattr(f"oiiotex.synthesis.patchmatch.{module}.random_windows", refuse)
    images, values = LINES.get(name, ([PHOTO], {"size": (48, 48), "patch": 16}))
    more = {"search": COHERENT} if name in LINES else {}
    pixels(getattr(filters, name)(*map(buffer, images), **values, **more, report=tmp_path / "report.json"))
    assert (tmp_path / "report.json").exists()
