# SPDX-License-Identifier: Apache-2.0
"""--texcheckmaterial: each fault is put into a good material, and found; the good one has none."""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import Progress
from oiiotex.surfaces.capture import material_checks
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import oiiotex, save
from tests.reference import reliefs

SIDE = 128
HEIGHT = reliefs.hills(SIDE, 5)
KINDS = ["color", "normal", "height", "data"]


def albedo(seed: int = 3) -> np.ndarray:
    """Linear, with spots of its own that know nothing of the heights."""
    spots = 0.1 + 0.3 * pictures.smooth_noise(SIDE, SIDE, 5, seed)
    return spots[..., None] * [1.0, 0.8, 0.6]


def material(**changed: np.ndarray) -> list[oiio.ImageBuf]:
    """Albedo, normals, heights and roughness; arrays that are given replace them."""
    maps = {
        "color": albedo(),
        "normal": 0.5 + 0.5 * reliefs.normals(HEIGHT),
        "height": (HEIGHT[..., None] - HEIGHT.min()) / np.ptp(HEIGHT),
        "data": 0.5 * np.ones((SIDE, SIDE, 1)),
    } | changed
    spaces = {"color": "lin_rec709_scene"}
    return [buffer(maps[kind], space=spaces.get(kind, "data"), names=None) for kind in KINDS]


def found(maps: list[oiio.ImageBuf], kinds: list[str] = KINDS, convention: str = "opengl") -> set[tuple[str, str, str]]:
    """(level, kind of the map, check) of everything that is found."""
    images = tuple(from_buffer(one) for one in maps)
    named = tuple(type(one)(one.parts, kind) for one, kind in zip(images, kinds, strict=True))
    _, findings = material_checks.check_material(named, list(kinds), convention, Session().resources, Progress())
    assert all(finding.text and str(finding).startswith(finding.level) for finding in findings)
    return {(finding.level, finding.map, finding.check) for finding in findings}


def test_a_good_material_has_nothing_wrong():
    assert found(material()) == set()


@pytest.mark.parametrize("kind", ["color", "normal", "height", "data"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_broken_values(kind, value):
    maps = material()
    broken = pixels(maps[KINDS.index(kind)]).copy()
    broken[3, 4, 0] = value
    assert ("error", kind, "broken") in found(material(**{kind: broken}))


def test_words_of_findings():
    images = [from_buffer(buffer(pixels, space=space, names=None)) for pixels, space in (
        (np.ones((32, 32, 2)), "lin_rec709_scene"), (np.full((32, 32, 3), 1.5), "lin_rec709_scene"),
        (np.ones((32, 32, 3)), None),
    )]  # fmt: skip
    named = tuple(type(one)(one.parts, f"{n}.exr") for n, one in enumerate(images))
    _, findings = material_checks.check_material(named, ["color"] * 3, "opengl", Session().resources, Progress())
    said = [str(one) for one in findings]
    assert "error: 0.exr: has 2 channels apart from alpha: expected 1 or 3 for color" in said
    assert "error: 1.exr: 100 % of its pixels are negative or reflect more light than they receive" in said
    assert any(one.startswith("error: 2.exr: has no color space tag ") for one in said)


def test_sizes_and_densities_that_differ():
    maps = material(height=np.indices((64, 64)).sum(0)[..., None] / 126)
    maps[0].specmod().attribute("XResolution", 100.0)
    maps[3].specmod().attribute("XResolution", 200.0)
    assert found(maps) >= {("error", "height", "size"), ("warning", "data", "density")}


def test_color_spaces_that_are_wrong():
    maps = material()
    maps[0].specmod().attribute("oiio:ColorSpace", "data")
    maps[1].specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    assert found(maps) == {("error", "color", "colorspace"), ("warning", "normal", "colorspace")}
    maps[0].specmod().erase_attribute("oiio:ColorSpace")
    assert ("error", "color", "colorspace") in found(maps)


@pytest.mark.parametrize(
    ("light", "level"), [(1.5, "error"), (0.95, "warning"), (0.005, "warning")], ids=["impossible", "snow", "shadow"]
)
def test_albedo_that_nothing_has(light, level):
    spots = albedo()
    spots[:20, :20] = light
    assert (level, "color", "range") in found(material(color=spots))


def test_slow_light_is_baked_in():
    slow = 1 + 0.7 * np.sin(2 * np.pi * np.arange(SIDE) / SIDE)[:, None, None]
    assert ("warning", "color", "drift") in found(material(color=albedo() * slow))


@pytest.mark.parametrize("azimuth", [20, 90, 230])
@pytest.mark.parametrize("convention", ["opengl", "directx"])
def test_light_from_one_side_is_baked_in(azimuth, convention):
    normal = reliefs.normals(HEIGHT) * ([1, -1, 1] if convention == "directx" else [1, 1, 1])
    maps = material(color=0.5 * reliefs.lit(HEIGHT, azimuth)[..., None] * np.ones(3), normal=0.5 + 0.5 * normal)
    images = tuple(map(from_buffer, maps))
    _, findings = material_checks.check_material(images, KINDS, convention, Session().resources, Progress())
    (lit,) = (finding for finding in findings if finding.check == "lit")
    said = float(lit.text.partition("light from ")[2].split()[0])
    assert abs((said - azimuth + 180) % 360 - 180) < 12


def test_occlusion_is_baked_in():
    sky = reliefs.visible_sky(reliefs.stones(SIDE, 1), 12, 64)
    heights = reliefs.stones(SIDE, 1)
    normal = 0.5 + 0.5 * reliefs.normals(heights)
    seen = found(
        material(color=0.4 * sky[..., None] * np.ones(3), normal=normal, height=heights[..., None] / heights.max())
    )
    assert ("warning", "color", "occluded") in seen


def test_normals_that_are_no_unit_vectors_or_point_down():
    good = reliefs.normals(HEIGHT)
    assert ("error", "normal", "length") in found(material(normal=0.5 + 0.5 * 0.8 * good))
    assert ("error", "normal", "below") in found(material(normal=0.5 + 0.5 * good * [1, 1, -1]))
    assert found(material(normal=good)) == set()  # not encoded


def test_normals_of_a_surface_that_was_not_level():
    tilted = reliefs.normals(HEIGHT) + np.array([-0.3, 0, 0])
    tilted /= np.linalg.norm(tilted, axis=-1, keepdims=True)
    assert ("warning", "normal", "lean") in found(material(normal=0.5 + 0.5 * tilted))


@pytest.mark.parametrize("with_height", [False, True])
@pytest.mark.parametrize("asked", ["opengl", "directx"])
@pytest.mark.parametrize("given", ["opengl", "directx"])
def test_which_way_green_points(given, asked, with_height):
    normal = 0.5 + 0.5 * reliefs.normals(HEIGHT) * ([1, -1, 1] if given == "directx" else [1, 1, 1])
    maps = material(normal=normal)
    kinds = KINDS if with_height else ["color", "normal"]
    wrong = ("error", "normal", "handedness") in found(maps[: len(kinds)], kinds, asked)
    assert wrong == (given != asked)


def test_normals_that_were_made_of_heights_upside_down():
    assert ("error", "normal", "inverted") in found(material(normal=0.5 + 0.5 * reliefs.normals(-HEIGHT)))


def test_two_channels_are_normals_and_four_are_not():
    two = 0.5 + 0.5 * reliefs.normals(HEIGHT)[..., :2]
    assert found(material(normal=two)) == set()
    assert ("error", "normal", "channels") in found(material(normal=np.full((SIDE, SIDE, 1), 0.5)))


def test_heights_and_data_that_say_little():
    assert ("warning", "height", "flat") in found(material(height=np.full((SIDE, SIDE, 1), 0.25)))
    assert ("error", "data", "range") in found(material(data=np.full((SIDE, SIDE, 1), 1.25)))
    coarse = buffer((HEIGHT[..., None] - HEIGHT.min()) / np.ptp(HEIGHT), oiio.UINT8, "data")
    assert ("warning", "height", "steps") in found([coarse], ["height"])


def test_bands_do_not_show(monkeypatch):
    maps = tuple(map(from_buffer, material(color=0.5 * reliefs.lit(HEIGHT, 90)[..., None] * np.ones(3))))
    once = material_checks.check_material(maps, KINDS, "opengl", Session().resources, Progress())
    for band in ("oiiotex.engine.core.demand.BAND_BYTES", "oiiotex.engine.scan.BAND_BYTES"):
        monkeypatch.setattr(band, 12 * SIDE * 7)
    assert material_checks.check_material(maps, KINDS, "opengl", Session().resources, Progress()) == once


def test_the_run_goes_to_its_end_and_exits_3(tmp_path):
    save(albedo(), tmp_path / "a.exr", "half", "lin_rec709_scene")
    save(0.5 + 0.5 * reliefs.normals(HEIGHT) * [1, -1, 1], tmp_path / "n.exr", "half", "data")
    words = ["a.exr", "n.exr", "--texcheckmaterial:kinds=color,normal:facts=found.json", "-o", "n2.exr"]
    done = oiiotex(*words, cwd=tmp_path)
    assert done.returncode == 3
    assert (
        "green points down (DirectX)" in done.stdout and done.stdout.splitlines()[-1] == "2 maps: 1 errors, 0 warnings"
    )
    report = json.loads((tmp_path / "found.json").read_text())
    assert report["schema"] == "oiiotex.materialcheck/1" and not report["passed"]
    assert [one["check"] for one in report["findings"]] == ["handedness"]
    assert report["maps"][1]["measures"]["convention"] == "directx"
    same = oiio.ImageBuf(str(tmp_path / "n2.exr"))
    np.testing.assert_array_equal(pixels(same), pixels(oiio.ImageBuf(str(tmp_path / "n.exr"))))
    words[2] += ":normals=directx"
    assert oiiotex(*words, cwd=tmp_path).returncode == 0


def test_python_has_the_maps_and_an_error_that_holds_them():
    maps = material(data=np.full((SIDE, SIDE, 1), 2.0))
    with pytest.raises(errors.QualityError, match="from 2 to 2") as caught:
        filters.checkmaterial(maps[0], maps=maps[1:], kinds=KINDS)
    assert len(caught.value.result) == 4
    assert len(filters.checkmaterial(maps[0], maps=maps[1:], kinds=KINDS, fail=["none"])) == 4
