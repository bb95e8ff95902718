# SPDX-License-Identifier: Apache-2.0
"""The first result: drift is removed, the layout is kept, and a bad one is never called good."""

from __future__ import annotations

import functools
import json
import logging
import re

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex import filters
from oiiotex.analysis.regularity.lattice import Lattice
from oiiotex.analysis.regularity.offset_prices import InStep
from oiiotex.engine import errors
from oiiotex.engine.color.config import ColorConfig
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.errors import present
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import WHOLE, Progress
from oiiotex.synthesis.exemplar import synthesis_run
from oiiotex.synthesis.exemplar.first_result import coarse_photo, fidelity_of, glance, textured
from oiiotex.synthesis.exemplar.presets import EVENER, LARGER
from oiiotex.synthesis.patchmatch.optimization import Synthesis
from oiiotex.synthesis.patchmatch.recipe import COARSEST, Recipe, level_scales
from oiiotex.synthesis.patchmatch.use_prices import Lost
from oiiotex.synthesis.quality import judged_tries
from oiiotex.synthesis.quality.fidelity import FAIR, GOOD, JudgedPhoto, fidelity
from oiiotex.synthesis.quality.judged_tries import Dismissed, Try, best_tried
from tests import pictures
from tests.any_filter import buffer, pixels

pytestmark = pytest.mark.usefixtures("few_places")
QUICK = {"iterations": 4}
TORUS = (True, True)
SIDE = 256
IN_PLACE = SourceMap.of(np.arange(SIDE)[:, None], np.arange(SIDE))
RECIPE = Recipe.tiling(
    SIDE, SIDE, "xy", sigma=None, patch=13, iterations=1, seed=0, uniformity=0.0, contrast=0.0, flat=True
)


def photo(height: int = 96, width: int = 112, **kind: object) -> oiio.ImageBuf:
    picture = pictures.stained(pictures.pebbles(height, width, 3)) ** 2.2
    return buffer(picture, space="lin_rec709_scene", **kind)


def lab_of(image: oiio.ImageBuf) -> np.ndarray:
    lab = np.ascontiguousarray(image.get_pixels(oiio.FLOAT)[..., :3])
    ColorConfig().to_lab("lin_rec709_scene")(lab)
    return lab


# --- drift and structure are two decisions ---


@pytest.mark.parametrize("kind", [oiio.UINT8, oiio.FLOAT])
def test_flatten_is_texflatten_first(kind):
    light = np.linspace(0.4, 1.2, 112)[:, None]
    given = buffer(light * pictures.pebbles(96, 112, 3), space="lin_rec709_scene", kind=kind)  # stains are not copied
    made = filters.stationarize(given, preset="large", **QUICK)  # a kept layout is also evened at its seams
    flat = filters.flatten(given)
    again = filters.stationarize(flat, preset="large", flattening=0, **QUICK)
    np.testing.assert_array_equal(pixels(made), pixels(again))


def test_a_copy_corrected_by_the_field_that_is_written_out():
    given = photo()
    made = filters.stationarize(given, st=True, drift=True, **QUICK)
    st, field = pixels(made["st"]), pixels(made["drift"])
    x, y = (np.floor(st[..., k] * n).astype(int) for k, n in ((0, 112), (1, 96)))
    corrected = lab_of(given) * field[..., :3] + field[..., 3:]
    np.testing.assert_allclose(lab_of(made["tile"]), corrected[y, x], atol=5e-3)
    assert np.abs(field[..., 3:]).max() > 1  # there was something to correct
    # no detail finer than half a cell, an eighth of the disc, to which the rim of a stain is followed
    fast = field[..., 3] - gaussian_filter(field[..., 3].astype(float), 0.2 * 112 / 16, mode="nearest")
    assert fast.std() < 0.1 * field[..., 3].std()


def test_without_flatten_nothing_is_corrected():
    given = photo()
    made = filters.stationarize(given, flattening=0, drift=True, **QUICK)
    field = pixels(made["drift"])
    assert (field[..., :3] == 1).all() and not field[..., 3:].any()
    known = {p.tobytes() for p in pixels(given).reshape(-1, 3)}
    assert all(p.tobytes() in known for p in pixels(made["tile"]).reshape(-1, 3))


def test_other_maps_of_a_material_are_copies():
    given, other = photo(64, 72), buffer(np.random.default_rng(0).random((64, 72, 3)), space="")
    made = filters.stationarize(given, maps=[other], **QUICK)
    known = {p.tobytes() for p in pixels(other).reshape(-1, 3)}
    assert all(p.tobytes() in known for p in pixels(made[1]).reshape(-1, 3))


def test_data_are_not_flattened_by_default():
    values = photo().get_pixels(oiio.FLOAT) * 3 - 1
    known = {p.tobytes() for p in values.reshape(-1, 3)}
    made = filters.stationarize(buffer(values, space=""), data=True, **QUICK)
    assert all(p.tobytes() in known for p in pixels(made).reshape(-1, 3))


@pytest.mark.parametrize("value", [-0.1, 1.5, float("nan")])
def test_flatten_out_of_range_is_refused(value):
    with pytest.raises(errors.ParameterError, match="flattening="):
        filters.stationarize(photo(), flattening=value)


# --- the pyramid's start ---


def recipe(width: int, height: int, **more: object) -> Recipe:
    plain = {"sigma": 16.0, "patch": 13, "iterations": 1, "seed": 0, "uniformity": 0.01, "contrast": 0.7, "flat": True}
    plain["complete"] = True
    return Recipe(width=width, height=height, wrap_x=True, wrap_y=True, **plain | more)


@pytest.mark.parametrize("side", [256, 512, 1024, 4096])
def test_the_coarsest_level_has_one_size_whatever_the_photo(side):
    scales = level_scales(recipe(side, side), (side, side, 3))
    assert round(scales[0] * side) == COARSEST and scales[-1] == 1 and scales == sorted(scales)
    wide = level_scales(recipe(4 * side, 4 * side), (side, side, 3))
    assert wide[0] == scales[0]  # a larger tile of the same photo starts at the photo's scale
    letter = level_scales(recipe(side, side, literal=True), (side, side, 3))
    assert letter[0] == max(0.25, 64 / side)


def test_the_coarsest_level_holds_two_patches():
    for width, height in ((2048, 128), (60, 60), (40, 300)):
        scales = level_scales(recipe(width, height), (height, width, 3))
        assert min(1.0, scales[0]) * min(width, height) >= min(26, min(width, height)) - 1


# --- lattices ---


def test_matches_move_to_the_nearest_place_in_step():
    """Against all places around, by the phase that the photo's frequencies give."""
    frequencies = np.array([[1 / 9.5, 0.01], [-0.02, 1 / 13.0]])
    lattice = Lattice(frequencies, 9.0, np.zeros((64, 64)))
    wanted = np.rint(frequencies * [114, 91]) / [114, 91]
    prices = InStep(lattice, wanted, 0.5).prices((1.0, 1.0), (1.0, 1.0), 0, 1.0)
    random = np.random.default_rng(0)
    x, y, own_x, own_y = (random.integers(0, 80, 200) for _ in range(4))
    found = np.stack(prices.nearest_in_step(x, y, own_x, own_y), -1)

    def away(at: np.ndarray) -> np.ndarray:
        cycles = at @ frequencies.T - np.stack([x, y], -1) @ wanted.T
        return (cycles - np.rint(cycles)) @ np.linalg.inv(frequencies).T

    assert np.abs(away(found)).max() <= 0.75  # to a pixel
    before = away(np.stack([own_x, own_y], -1))
    moved = found - np.stack([own_x, own_y], -1)
    assert np.abs(moved + before).max() <= 0.75


# --- a bad result is never called good ---


def smooth_noise(side: int, seed: int, sigma: float) -> np.ndarray:
    random = np.random.default_rng(seed).standard_normal((side, side, 3))
    lab = np.stack([gaussian_filter(random[..., c], sigma, mode="wrap") for c in range(3)], -1)
    return (2 * lab / lab.std() + [50, 0, 0]).astype(np.float32)


def test_fidelity_of_the_same_texture_is_good_and_of_a_crushed_one_is_not():
    one, other = smooth_noise(256, 1, 4.0), smooth_noise(256, 2, 4.0)
    assert not fidelity(one, None, one, TORUS).beyond
    assert fidelity(one, None, other, TORUS).value >= GOOD
    crushed = fidelity(one, None, smooth_noise(256, 3, 0.8), TORUS)
    assert crushed.value < FAIR and max(crushed.bands) < 0.8
    assert "is lost" in str(crushed)
    blotched = fidelity(one, None, other + 5 * (smooth_noise(256, 4, 10.0) - [50, 0, 0]), TORUS)
    assert blotched.value < GOOD and max(blotched.bands) > 1.25


def test_fidelity_sees_lost_colors_and_broken_lines():
    one, other = smooth_noise(256, 1, 1.5), smooth_noise(256, 2, 1.5)
    light = one.copy()
    light[::8, ::8] = [95, 0, 40]
    assert fidelity(light, None, other, TORUS).missing > fidelity(one, None, other, TORUS).missing
    lined, dashed = one.copy(), other.copy()
    whole = other.copy()
    for column in (40, 110, 200):
        lined[:, column : column + 4] -= [60, 0, 0]
        whole[:, column + 20 : column + 24] -= [60, 0, 0]
        for k in range(8):
            left = (column + 37 * k * k) % 250
            dashed[32 * k : 32 * k + 32, left : left + 4] -= [60, 0, 0]
    broken, kept = (fidelity(lined, None, tile, TORUS) for tile in (dashed, whole))
    assert broken.lines < 0.5 < kept.lines and broken.value < GOOD
    said = "long lines are broken"
    assert said in broken.beyond and said not in kept.beyond


@pytest.mark.parametrize("side", [96, 360])
def test_fidelity_does_not_depend_on_the_size_of_a_result(side):
    """Another piece of the texture is good at any size, and a crushed one is not."""
    for sigma in (2.0, 5.0):
        photo = smooth_noise(256, 1, sigma)
        assert fidelity(photo, None, smooth_noise(side, 2, sigma), TORUS).value >= GOOD
        assert fidelity(photo, None, smooth_noise(400, 2, sigma)[:side, :side], (False, False)).value >= GOOD
        assert fidelity(photo, None, smooth_noise(side, 3, sigma / 4), TORUS).value < FAIR


def test_fidelity_of_what_is_too_small_is_not_said():
    small = smooth_noise(40, 0, 2.0)
    assert fidelity(small, None, small, TORUS) is None


def few_elements() -> oiio.ImageBuf:
    """One panel of nested frames: no texture."""
    y, x = np.mgrid[:128, :128]
    ring = np.maximum(np.abs(y - 64), np.abs(x - 64)) // 12
    picture = np.array([[0.8, 0.3, 0.1], [0.1, 0.2, 0.6], [0.7, 0.7, 0.3]])[ring % 3]
    return buffer(picture * np.random.default_rng(0).uniform(0.6, 1, (128, 128, 1)), space="lin_rec709_scene")


@pytest.mark.parametrize(("fits", "last"), [(True, "preset=layout"), (False, "sigma=32:patch=21")])
def test_what_misses_is_tried_again_and_said(fits, last, caplog, tmp_path, monkeypatch):
    monkeypatch.setattr(judged_tries, "GOOD", 1.0)
    monkeypatch.setattr(synthesis_run, "fits_layout", lambda *_: fits)
    report = tmp_path / "r.json"
    with caplog.at_level(logging.INFO, "oiiotex"):
        made = filters.stationarize(few_elements(), report=report)
    measures = json.loads(report.read_text())["results"][0]["measures"]
    assert re.findall(r"trying (\S+)", caplog.text)[-1].startswith(last)
    chosen = made.spec().get_string_attribute("oiiotex:chosen")
    assert f"scales chosen: {chosen}" in caplog.text
    assert float(made.spec().get_string_attribute("oiiotex:fidelity")) == pytest.approx(measures["fidelity"], abs=1e-3)
    assert any("crop it" in r.getMessage() for r in caplog.records if r.levelno == logging.WARNING)
    # the line with the numbers spelled out makes the same pixels
    values = dict(word.split("=") for word in chosen.split(":"))
    spelled = {name: v if name == "preset" else int(v) if name == "patch" else float(v) for name, v in values.items()}
    np.testing.assert_array_equal(pixels(filters.stationarize(few_elements(), **spelled)), pixels(made))


def repeating(spot: bool) -> np.ndarray:
    """Lab of grain with a salient spot, or with a slow wave."""
    lab = smooth_noise(SIDE, 1, 2.0)
    if spot:
        lab[80:110, 80:110, 0] += 25
    else:
        lab[..., 0] += 10 * np.sin(np.arange(SIDE) * 2 * np.pi / SIDE)
    return lab


@pytest.mark.parametrize(("spot", "third"), [(False, "evener"), (True, "larger")])
def test_only_tiles_that_may_improve_the_worst_part_are_tried(spot, third):
    """Larger structures repeat as slow waves, too."""
    made: list[str] = []

    def one(name: str, improves: tuple[str, ...]) -> Try:
        def make(_: float) -> SourceMap:
            made.append(name)
            return IN_PLACE

        return Try(name, make, improves=improves)

    names = ("evenest", "evener", "larger")
    tries = [one("first", ()), *(one(n, scale[2]) for n, scale in zip(names, (*EVENER, LARGER), strict=True))]
    photo = JudgedPhoto(repeating(spot))
    best = best_tried("--x", tries, lambda tile: fidelity_of(photo, tile, RECIPE), Progress())
    assert made == ["first", "evenest", third] and best.spelled == "first"


def test_a_tile_that_loses_texture_is_dismissed_whatever_its_fidelity():
    whole, flat = (Synthesis(IN_PLACE, IN_PLACE, Lost(0.9, shown)) for shown in (0.9, 0.4))
    assert textured(whole) is whole
    with pytest.raises(Dismissed, match="50 % of the texture"):
        textured(flat)


def test_a_level_that_is_worse_than_the_best_tile_dismisses_its_own():
    lab, half = repeating(spot=False), SIDE // 2
    whole = SourceMap.of(np.arange(half)[:, None], np.arange(half))
    value = present(JudgedPhoto(lab).fidelity(lab, TORUS, IN_PLACE)).value

    def too_early() -> SourceMap:
        raise AssertionError("this level is too small to be measured")

    coarse = functools.partial(coarse_photo, JudgedPhoto(lab))
    with pytest.raises(Dismissed, match="before it is finished"):
        look = glance(coarse, SIDE, RECIPE, value + 0.1)
        look(too_early, (half // 2, half // 2))
        look(lambda: whole, (half, half))
    glance(coarse, SIDE, RECIPE, value - 0.1)(lambda: whole, (half, half))


def test_a_photo_that_tiles_gets_a_hint(caplog):
    tiling = pictures.moss(96, 96, 1)
    tiling = np.concatenate([tiling, tiling[::-1]], 0)
    tiling = np.concatenate([tiling, tiling[:, ::-1]], 1) ** 2.2
    with caplog.at_level(logging.WARNING, "oiiotex"):
        filters.stationarize(buffer(tiling, space="lin_rec709_scene"), **QUICK)
    assert "already tiles" in caplog.text and "--texflatten:tiled=xy" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.WARNING, "oiiotex"):
        filters.stationarize(photo(), **QUICK)
    assert "already tiles" not in caplog.text


def test_a_second_attempt_adds_to_the_work(monkeypatch):
    """The whole grows when the first result is not good, and progress never falls back."""
    told = []
    session = Session(progress=lambda done, total: told.append((done, total)))
    monkeypatch.setattr(judged_tries, "GOOD", 2.0)  # which no result reaches
    monkeypatch.setattr(Try, "hope", lambda one, _: 2.0 if "broken" in one.improves else 0.0)
    monkeypatch.setattr(Try, "is_last", False)
    filters.stationarize(photo(), session=session, **QUICK)
    totals = [total for _, total in told]
    assert totals[0] == WHOLE and 1.8 * WHOLE < totals[-1] < 2.4 * WHOLE and told[-1][0] == totals[-1]
    assert [done for done, _ in told] == sorted(done for done, _ in told)
