# SPDX-License-Identifier: Apache-2.0
"""--texpreview against what its panels mean."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.color.srgb import decoded, encoded
from oiiotex.engine.session import Session
from oiiotex.surfaces.charts import lighting
from oiiotex.surfaces.charts.tile_preview import area_means, made_seamless, plane_in_perspective, repeated
from oiiotex.synthesis.quality.seam_measures import seam_ratio
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex, save
from tests.refusals import refused

TILE = pictures.pebbles(48, 64, 1)


def test_means_are_integrals_of_a_periodic_step_function():
    random = np.random.default_rng(0)
    row = random.random((7, 2))
    fine = np.tile(np.repeat(row, 1000, axis=0), (5, 1))
    start, stop = np.array([0.0, 2.25, 6.5, -3.0, 1.0]), np.array([1.0, 2.75, 16.125, 4.0, 21.0])
    for mean, a, b in zip(area_means(row, start, stop), start, stop, strict=True):
        np.testing.assert_allclose(mean, fine[round(1000 * (a + 7)) : round(1000 * (b + 7))].mean(0), atol=1e-12)


def test_a_tile_laid_out_at_its_own_size_is_the_tile():
    np.testing.assert_allclose(repeated(TILE, 2, 96), np.tile(TILE, (2, 2, 1)), atol=1e-12)
    half = TILE.reshape(24, 2, 32, 2, 3).mean((1, 3))
    np.testing.assert_allclose(repeated(TILE, 3, 72), np.tile(half, (3, 3, 1)), atol=1e-12)


def test_the_plane_is_what_many_rays_see():
    """Against 16 x 16 rays a pixel through the same pinhole."""
    width, height, n = 60, 40, 16
    found = plane_in_perspective(TILE, width, height)
    assert (found[:5] == 0).all()
    down, right = (np.arange(n * height) + 0.5) / n - 5, (np.arange(n * width) + 0.5) / n - width / 2
    eye = 35 * 2 * 64 / width
    away = width * eye / down[5 * n :]
    u = (right[None, :] * (away / width)[:, None]).astype(np.float64)
    rows, columns = np.floor(away).astype(int) % 48, np.floor(u).astype(int) % 64
    seen = TILE[rows[:, None], columns].reshape(35, n, width, n, 3).mean((1, 3))
    away_from = np.abs(found[5:] - seen)
    assert away_from[12:].mean() < 0.02 and away_from[3:].mean() < 0.03
    np.testing.assert_allclose(found[5].mean(0), TILE.mean((0, 1)), atol=0.05)  # at the horizon all is one


def test_make_seamless_has_no_seam_and_keeps_the_middle():
    photo = pictures.stained(pictures.moss(96, 112, 2))
    made = made_seamless(photo)
    for axis in (0, 1):
        assert seam_ratio(made[..., 1], axis) < min(1.3, seam_ratio(photo[..., 1], axis))
    np.testing.assert_allclose(made[48, 56], photo[48, 56], atol=1e-3)


def test_panels_stand_side_by_side_in_the_order_asked_for():
    tile, photo = buffer(TILE), buffer(pictures.pebbles(60, 60, 2))
    every = pixels(filters.preview(tile, exemplar=photo, panel=48))
    assert every.shape == (48, 48 + 48 + 64 + 64 + 72 + 4 * 8, 3)
    few = pixels(filters.preview(tile, panels=["plane", "2x2"], panel=48))
    np.testing.assert_array_equal(few[:, :72], every[:, -72:])
    np.testing.assert_allclose(few[:, -64:], repeated(TILE.astype(np.float32), 2, 48), atol=1e-6)
    assert pixels(filters.preview(tile, panel=48)).shape[1] == 64 + 64 + 72 + 2 * 8


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"panels": ["4x4"]}, "panels=..4x4.,.: expected exemplar, seamless, 2x2, 3x3, plane, lit, sphere"),
        ({"panels": ["2x2", "seamless"]}, "panels=.*: seamless requires exemplar"),
        ({"exemplar": TILE[..., :1]}, "exemplar has 1 channels, but the tile has 3"),
    ],
)
def test_what_is_wrong_is_said(given, said):
    given = {name: buffer(v) if isinstance(v, np.ndarray) else v for name, v in given.items()}
    with pytest.raises(errors.Error, match=said):
        filters.preview(buffer(TILE), **given)


def test_a_tile_that_does_not_fit_the_budget_is_refused_with_the_figure():
    with refused(errors.ImageError, task="a preview of rows of 64 px, 512 px high,", budget=1000):
        filters.preview(buffer(TILE), session=Session(budget=1000))


def test_on_the_command_line(tmp_path):
    save(TILE, tmp_path / "tile.png")
    save(TILE, tmp_path / "photo.png")
    done = oiiotex("tile.png", "--texpreview:exemplar=photo.png:panel=32", "-o", "seen.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert load(tmp_path / "seen.png").shape[0] == 32


GRAY = np.full((32, 32, 3), 0.5, np.float32)
NORMALS = np.dstack([np.full((32, 32), x, np.float32) for x in (0.3, 0.5, 0.95)])  # leaning to the left


def lit(color: np.ndarray, *maps: np.ndarray, **modifiers: object) -> np.ndarray:
    given = [buffer(one) for one in maps]
    return pixels(filters.preview(buffer(color), maps=given, panel=32, **{"panels": ["lit"], **modifiers}))


def test_a_lit_panel_is_the_shading_of_the_maps():
    """Against the equation for one place, because constant maps are lit alike everywhere."""
    rough, metal = np.full((32, 32, 1), 0.4, np.float32), np.full((32, 32, 1), 0.25, np.float32)
    seen = lit(GRAY, NORMALS, rough, metal, kinds=["color", "normal", "data", "data"])
    texels = [np.float32(one).reshape(1, 1, -1) for one in (decoded(0.5 * np.ones(3)), 1, 0.4, 0.25, 1)]
    normal = 2 * NORMALS[:1, :1] - 1
    normal /= np.linalg.norm(normal)
    material = lighting.LitMaterial(texels[0], normal, *texels[2:])
    radiance = material.seen(np.zeros((1, 1)), np.zeros((1, 1)), normal, (0.0, 0.0, 1.0))
    np.testing.assert_allclose(seen, np.broadcast_to(encoded(radiance), seen.shape), atol=2e-3)


def test_light_comes_from_the_upper_left_in_both_conventions():
    left, right = (lit(GRAY, NORMALS * [[[s, 1, 1]]] + [[[t, 0, 0]]], kinds=["color", "normal"]).mean() for s, t in
                   ((1, 0), (-1, 1)))  # fmt: skip
    assert left > 1.1 * right
    up = NORMALS[..., [1, 0, 2]] * [[[1, -1, 1]]] + [[[0, 1, 0]]]
    opengl, directx = (lit(GRAY, up, kinds=["color", "normal"], normals=n).mean() for n in ("opengl", "directx"))
    assert opengl > 1.1 * directx


def test_heights_replace_normals_and_occlude_the_sky():
    x = np.arange(32) / 32
    heights = np.broadcast_to(0.5 + 0.5 * np.cos(2 * np.pi * x), (32, 32))[..., None].astype(np.float32)
    seen = lit(GRAY, 8 * heights, kinds=["color", "height"])[..., 1].mean(0)
    assert seen[24:30].mean() > 1.1 * seen[2:8].mean()  # the slope that faces the light
    pit = np.ones((32, 32, 1), np.float32)
    pit[8:24, 8:24] = 0
    flat = np.dstack([np.full((32, 32), x, np.float32) for x in (0.5, 0.5, 1.0)])
    dark = lit(GRAY, flat, 8 * pit, kinds=["color", "normal", "height"])[..., 1]
    assert dark[16, 9] < 0.95 * dark[2, 2]


def test_a_sphere_covers_its_picture_in_part():
    tile = np.concatenate([GRAY, np.ones((32, 32, 1), np.float32)], axis=2)
    seen = lit(tile, panels=["sphere"])
    assert seen.shape == (32, 32, 4) and seen[0, 0, 3] == 0 and seen[16, 16, 3] == 1
    assert 0 < np.unique(seen[..., 3])[1] < 1  # its outline
    np.testing.assert_allclose(seen[..., 3].mean(), np.pi / 4 / 1.05**2, atol=0.01)


@pytest.mark.parametrize(
    ("maps", "kinds", "said"),
    [
        ([NORMALS], ["normal", "color"], "is not a color map: panels=lit requires one"),
        ([NORMALS, NORMALS], ["color", "normal", "normal"], "at most one color, normal and height, and two data"),
        ([NORMALS[..., :1]], ["color", "normal"], "a normal map has 1 channels: expected 3"),
    ],
)
def test_maps_that_cannot_be_lit_are_refused(maps, kinds, said):
    with pytest.raises(errors.Error, match=said):
        lit(GRAY, *maps, kinds=kinds)
