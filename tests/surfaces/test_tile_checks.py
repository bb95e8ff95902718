# SPDX-License-Identifier: Apache-2.0
"""--texcheckmaterial of finished tiles: broken ones are found, good ones are not, whoever made them."""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.parameters import Words
from oiiotex.engine.core.tiling import tiling_of
from oiiotex.engine.session import Session
from oiiotex.filters.texcheckmaterial import _beyond, _limits
from oiiotex.surfaces.capture.alignment import offset_between
from oiiotex.surfaces.capture.material_checks import Fault
from oiiotex.surfaces.capture.tile_checks import OF_TILES, _across, finished_findings
from tests import pictures
from tests.any_filter import buffer
from tests.conftest import oiiotex, save

SIDE = 192


def of_spectrum(seed: int, slope: float) -> np.ndarray:
    """A tile of random phases, (SIDE, SIDE, 3): a torus by construction."""
    dice = np.random.default_rng(seed)
    radius = np.hypot(*np.meshgrid(*2 * [np.fft.fftfreq(SIDE, 1 / SIDE)], indexing="ij"))
    amplitude = np.where(radius > 5, np.maximum(radius, 1) ** -slope, 0)
    noise = np.fft.ifft2(np.fft.fft2(dice.standard_normal((SIDE, SIDE))) * amplitude).real
    return np.clip(0.35 + 0.08 * noise / noise.std(), 0.02, 0.9)[..., None] * [1.0, 0.85, 0.7]


def of_grains(seed: int, size: float) -> np.ndarray:
    """A tile of pebbles: the distance to the nearest of points in a grid, moved at random."""
    dice = np.random.default_rng(seed)
    across = round(SIDE / size)
    cells = np.stack(np.indices((across, across)), -1).reshape(-1, 2)
    points = (cells + 0.7 * dice.random(cells.shape)) * SIDE / across
    away, nearest = cKDTree(points, boxsize=SIDE).query(np.stack(np.indices((SIDE, SIDE)), -1))
    gray = 0.55 - 0.4 * away / size + 0.02 * dice.random(len(points))[nearest]
    return np.clip(gray, 0.03, 0.9)[..., None] * [0.9, 1.0, 0.8]


def of_bricks(seed: int, rows: int) -> np.ndarray:
    """A tile of bricks whose joints lie at the wrap along y."""
    dice = np.random.default_rng(seed)
    y, x = np.indices((SIDE, SIDE))
    high, wide = SIDE // rows, SIDE // (rows // 2)
    row = y // high
    place = (x + (row % 2) * wide // 2) % SIDE
    joint = (y % high < 3) | (place % wide < 3)
    tone = dice.random((rows, rows))[row, place // wide]
    rough = gaussian_filter(dice.standard_normal((SIDE, SIDE)), 1, mode="wrap")
    gray = np.where(joint, 0.5, 0.25 + 0.08 * tone) + 0.03 * rough / rough.std()
    return np.clip(gray, 0.02, 0.9)[..., None] * [1.0, 0.6, 0.5]


GOOD = {
    **{f"noise_{n}": of_spectrum(n, slope) for n, slope in enumerate((1.0, 1.3, 1.6, 2.0))},
    **{f"grains_{size}": of_grains(size, size) for size in (9, 12, 15, 18)},
    **{f"bricks_{rows}": of_bricks(rows, rows) for rows in (6, 8, 12, 16)},
}
CROPS = {
    **{f"crop_{name}": tile[: SIDE - 27, : SIDE - 41] for name, tile in GOOD.items()},
    "moss": pictures.moss(SIDE, SIDE, 3),
    "pebbles": pictures.pebbles(SIDE, SIDE, 4),
}


def found(pixels: np.ndarray, axes: str = "xy") -> tuple[dict[str, float], list[Fault]]:
    """Measures and findings of a color map that is said to tile."""
    image, measures = from_buffer(buffer(pixels, space="lin_rec709_scene", names=None)), dict[str, float]()
    return measures, list(finished_findings([image], ["color"], [measures], axes, Session().resources))


def levels(faults: list[Fault]) -> dict[str, str]:
    return {fault.check: fault.level for fault in faults}


def cross_faded(photo: np.ndarray, width: int) -> np.ndarray:
    """A photo whose right border is mixed into the left one."""
    share = (np.arange(width)[:, None] + 0.5) / width
    mixed = share * photo[:, :width] + (1 - share) * photo[:, -width:]
    return np.concatenate([mixed, photo[:, width:-width]], 1)


@pytest.mark.parametrize("name", GOOD)
def test_a_good_tile_is_called_good(name: str):
    assert found(GOOD[name])[1] == []


@pytest.mark.parametrize("name", CROPS)
def test_a_crop_is_not(name: str):
    """A cut brick has no larger jump than a joint: it is doubtful."""
    level = levels(found(CROPS[name])[1])["seam"]
    assert level == ("warning" if "bricks" in name else "error")


def test_a_crop_along_the_other_axis_is_a_tile_along_one():
    tile = GOOD["noise_2"][:, : SIDE - 41]
    assert found(tile, "y")[1] == []
    assert levels(found(tile, "x")[1])["seam"] == "error"


def test_a_mirrored_photo_and_a_cross_faded_one():
    photo = pictures.moss(SIDE, SIDE, 3)
    measures, faults = found(np.concatenate([photo, photo[:, ::-1]], 1), "x")
    assert levels(faults) == {"mirror": "warning"} and measures["mirror_x"] > 0.99
    faded = cross_faded(CROPS["crop_noise_1"], 20)
    assert levels(found(faded, "x")[1]) == {"soft": "warning"}


def test_a_spot_and_a_shadow_show_in_every_tile():
    tile, (y, x) = GOOD["noise_1"], np.indices((SIDE, SIDE))
    spot = np.where(np.hypot(y - 60, x - 90) < 14, 3.0, 1.0)[..., None]
    assert "salient" in levels(found(tile * spot)[1])
    shadow = (1 + 0.8 * np.sin(2 * np.pi * x / SIDE))[..., None]
    assert "waves" in levels(found(tile * shadow)[1])


def test_maps_of_one_color_are_not_judged():
    assert found(np.full((64, 64, 3), 0.3))[1] == []
    assert found(GOOD["noise_0"][:20, :20])[0] == {}  # too small


@pytest.mark.parametrize("wraps", [(True, True), (False, False)])
def test_where_a_map_lies_on_another(wraps: tuple[bool, bool]):
    gray = GOOD["grains_12"][..., :1]
    moved = np.roll(np.sqrt(gray), (7, -12), (0, 1))
    place = offset_between(moved, gray, wraps)
    assert (place.x, place.y) == (12, -7) and place.moved
    assert not offset_between(np.sqrt(gray), gray, wraps).moved
    assert not offset_between(GOOD["noise_1"], gray, wraps).moved  # nothing in common


def report(folder, *words: str) -> tuple[dict, int, str]:
    done = oiiotex(*words, cwd=folder)
    return json.loads((folder / "found.json").read_text()), done.returncode, done.stdout + done.stderr


def test_the_check_on_the_command_line(tmp_path):
    save(GOOD["grains_12"], tmp_path / "good.exr", "float", "lin_rec709_scene")
    save(CROPS["pebbles"], tmp_path / "crop.exr", "float", "lin_rec709_scene")
    height = np.roll(CROPS["pebbles"].mean(2, keepdims=True), (9, 14), (0, 1))
    save(height, tmp_path / "height.exr", "float", "data")
    check = "--texcheckmaterial:tiled=xy:facts=found.json"
    facts, code, said = report(tmp_path, "good.exr", check, "-o", "same.exr")
    assert code == 0 and facts["passed"] and "good: good.exr: no seam is visible" in said
    assert {"seam_x", "quieter_y", "excess", "waves", "salient"} <= set(facts["maps"][0]["measures"])
    assert tiling_of(oiio.ImageBuf(str(tmp_path / "same.exr")).spec()) == "xy"
    facts, code, said = report(
        tmp_path, "same.exr", "--texcheckmaterial:facts=found.json:fail=salient>0.1", "-o", "x.exr"
    )
    assert code == 3 and "salient is" in facts["failed"][0]
    facts, code, said = report(tmp_path, "crop.exr", check, "-o", "x.exr")
    assert code == 3 and "error: crop.exr: has a seam along x" in said
    words = "crop.exr", "height.exr", "--texcheckmaterial:kinds=color,height:facts=found.json", "-o", "x.exr"
    facts, code, said = report(tmp_path, *words)
    assert "does not lie on crop.exr: its edges match if it is moved by -14,-9 px" in said
    assert not any(finding["check"] in OF_TILES for finding in facts["findings"])  # not said to tile
    done = oiiotex("crop.exr", "--texcheckmaterial:fail=seems>2", "-o", "x.exr", cwd=tmp_path)
    assert done.returncode == 1 and "unknown measure 'seems'" in done.stderr


def test_a_jump_at_the_border_is_relative_to_those_inside():
    """A ramp rises by 1 from line to line, and falls by all of it at the border."""
    ramp = np.repeat(np.arange(SIDE, dtype=np.float32)[None, :, None], SIDE, 0)
    measures = _across(ramp, 1)
    assert measures["seam"] == measures["excess"] == SIDE - 1 and measures["quieter"] == 100


def test_conditions_count_errors_and_warnings():
    found = {"findings": [{"level": "warning", "map": "a", "text": "b"}], "maps": []}
    for words, failed in (("errors>0", []), ("warnings>0", ["a: b"]), ("warnings>1", []), ("none", [])):
        assert [text for limit in _limits(Words((words,))) for text in _beyond(limit, found)] == failed
