# SPDX-License-Identifier: Apache-2.0
"""Structures that a histogram would spread over the tile, and the presets that say what becomes of them."""

from __future__ import annotations

import json
import logging
import re
import shlex

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.core.image import from_buffer
from oiiotex.errors import ParameterError
from oiiotex.exemplar.large_structures import CONTRAST, main_texture
from oiiotex.filters.presets import PRESETS
from oiiotex.session import Session
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import oiiotex, save

QUICK = {"iterations": 4, "seed": 1, "structure": 0}


def plaster(height: int = 128, width: int = 144, seed: int = 3) -> np.ndarray:
    """Even plaster with dark ledges at unequal distances that go all the way across."""
    fine, coarse = (pictures.smooth_noise(height, width, side, seed, 70 + side) for side in (2, 6))
    wall = np.array([0.75, 0.7, 0.6]) * (0.6 + 0.5 * fine + 0.1 * coarse)[..., None]
    for top, high in ((0.1, 0.12), (0.31, 0.05), (0.68, 0.07)):
        wall[round(top * height) : round((top + high) * height)] *= 0.3
    return wall


def lab_like(picture: np.ndarray) -> np.ndarray:
    """Something on Lab's scale: what is compared are distances."""
    return np.ascontiguousarray(100 * picture - [0, 50, 50], np.float32)


@pytest.mark.parametrize("seed", range(3))
def test_plaster_is_a_texture_and_its_ledges_are_none(seed):
    texture = main_texture(lab_like(plaster(seed=seed)), None, Session())
    assert texture is not None
    assert 0.4 < texture.share < 0.8
    assert texture.deviation < 0.6


@pytest.mark.parametrize("make", [pictures.moss, pictures.bricks])
def test_a_texture_has_no_structures_beside_it(make):
    picture = pictures.stained(make(128, 128, 1))
    assert main_texture(lab_like(picture), None, Session()) is None


def test_pixels_that_do_not_count_are_no_structure():
    picture, usable = plaster(), np.ones((128, 144), bool)
    usable[:] = (picture.mean(-1) > 0.35).all(1)[:, None]
    usable[: 128 // 3] = False
    assert main_texture(lab_like(picture), usable, Session()) is None
    assert main_texture(lab_like(picture), np.zeros_like(usable), Session()) is None


@pytest.mark.parametrize("noise", [0, 0.01])
def test_a_flat_part_is_no_texture_beside_which_all_else_is_structure(noise):
    picture = pictures.pebbles(128, 128, 3).astype(np.float32)
    picture[:90, :90] = picture.mean((0, 1)) + np.random.default_rng(0).normal(0, noise, (90, 90, 1))
    assert main_texture(lab_like(picture), None, Session()) is None


def test_too_small_a_photo_has_no_structures():
    assert main_texture(lab_like(plaster(12, 40)), None, Session()) is None


def test_one_colour_has_no_structures():
    assert main_texture(np.full((64, 64, 3), 50, np.float32), None, Session()) is None


def test_contrast_follows_the_photo_and_is_literal_where_it_is_said(tmp_path, caplog):
    photo, report = buffer(plaster()), tmp_path / "report.json"
    with caplog.at_level(logging.INFO, "oiiotex"):
        tile = pixels(filters.stationarize(photo, report=report, **QUICK))
    assert "--texstationarize: contrast=0: " in caplog.text
    assert json.loads(report.read_text())["contrast"] == 0
    np.testing.assert_array_equal(tile, pixels(filters.stationarize(photo, contrast=0, **QUICK)))
    caplog.clear()
    with caplog.at_level(logging.INFO, "oiiotex"):
        spread = pixels(filters.stationarize(photo, contrast=CONTRAST, report=report, **QUICK))
    assert "contrast=0" not in caplog.text
    assert json.loads(report.read_text())["contrast"] == CONTRAST
    dark = tile.mean(-1) < 0.35, spread.mean(-1) < 0.35
    assert dark[0].mean() < 0.25 * dark[1].mean()  # ledges are left out, not spread


def test_contrast_stays_where_nothing_stands_out(caplog):
    photo = buffer(pictures.stained(pictures.moss(96, 96, 1)))
    with caplog.at_level(logging.INFO, "oiiotex"):
        tile = pixels(filters.stationarize(photo, **QUICK))
    assert f"contrast={CONTRAST}: " in caplog.text
    np.testing.assert_array_equal(tile, pixels(filters.stationarize(photo, contrast=CONTRAST, **QUICK)))


def line_of(log: str) -> list[str]:
    """What -v says a preset is."""
    return shlex.split(re.search("preset=.*: the same as (.*)", log)[1])


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    "words", ["", ":tile=x:size=100x90", ":contrast=0.25:sigma=6:patch=7"], ids=["alone", "x", "said"]
)
def test_a_preset_is_the_line_that_it_says(tmp_path, preset, words):
    save(plaster(80, 96), tmp_path / "photo.png", space="srgb_rec709_scene")
    end = ":iterations=4:seed=1:structure=0" + words
    run = oiiotex("-v", "photo.png", f"--texstationarize:preset={preset}{end}", "-o", "a.exr", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    line = line_of(run.stdout + run.stderr)
    assert not any("preset" in word for word in line)
    assert any(word.startswith("--texdominant") for word in line) == (preset == "clean")
    if "contrast" in words:  # what is said stays
        assert "contrast=0.25" in line[-1] and "sigma=6.0" in line[-1] and "patch=7" in line[-1]
    plain = oiiotex("photo.png", *line, "-o", "b.exr", cwd=tmp_path)
    assert plain.returncode == 0, plain.stderr
    a, b = (oiio.ImageBuf(str(tmp_path / name)).get_pixels(oiio.HALF) for name in ("a.exr", "b.exr"))
    np.testing.assert_array_equal(a, b)


def test_presets_differ():
    photo = buffer(plaster(80, 96))
    tiles = [pixels(filters.stationarize(photo, preset=preset, **QUICK)) for preset in PRESETS]
    dark = [(tile.mean(-1) < 0.3).mean() for tile in tiles]
    assert dark[1] < 0.5 * min(dark[0], dark[2])
    assert not np.array_equal(tiles[0], tiles[2])


def test_clean_keeps_a_mask_that_is_given():
    photo, mask = buffer(plaster(80, 96)), np.zeros((80, 96, 1), np.float32)
    mask[:, 48:] = 1
    made = filters.stationarize(photo, mask=buffer(mask), preset="clean", stmap=True, **QUICK)
    st = made["st"].get_pixels(oiio.FLOAT)
    assert st[..., 0].min() >= 0.5


def test_a_preset_refuses_before_the_work(fails, tmp_path):
    save(plaster(80, 96), tmp_path / "photo.png", space="srgb_rec709_scene")
    line = fails("photo.png", "--texstationarize:preset=clean:n=1:relevel=1")
    assert "relevel=1" in line
    assert "preset=spare" in fails("photo.png", "--texstationarize:preset=spare")


# --- the paper by the letter ---


def test_paper_is_mjh17_by_the_letter():
    photo = buffer(plaster(64, 64))
    recipe = filters.Stationarize(exemplar=from_buffer(photo), paper=True).recipe(64, 64)
    assert recipe.literal and not (recipe.complete or recipe.flat) and recipe.in_step is None
    assert (recipe.alpha(0), recipe.alpha(15), recipe.alpha(30), recipe.alpha(31)) == (1, 0.5, 0, 0)
    with pytest.raises(ParameterError, match=r"structure=0\.2: paper=True says structure=0"):
        filters.stationarize(photo, paper=True, structure=0.2)
    with pytest.raises(ParameterError, match="preset=keep: paper=True leaves preset out"):
        filters.stationarize(photo, paper=True, preset="keep")
    literal, ours = (
        pixels(filters.stationarize(photo, measure="steerable", iterations=4, contrast=1.0, structure=0, **way))
        for way in ({"paper": True}, {"target": "exemplar"})
    )
    assert set(map(tuple, literal.reshape(-1, 3))) <= set(map(tuple, pixels(photo).reshape(-1, 3)))
    assert (literal != ours).any(-1).mean() > 0.1
