# SPDX-License-Identifier: Apache-2.0
"""--texpreview against what its panels mean."""

from __future__ import annotations

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.session import Session
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
        ({"panels": ["4x4"]}, "panels=..4x4.,.: expected exemplar, seamless, 2x2, 3x3, plane"),
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
