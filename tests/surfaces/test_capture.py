# SPDX-License-Identifier: Apache-2.0
"""Material maps from photos under several lights, against surfaces that are known: no renderer but numpy is needed."""

from __future__ import annotations

import functools
import json

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.attributes import ESTIMATE, HEIGHT_PX
from oiiotex.engine.core.scratch import RowStore
from oiiotex.engine.session import Session
from oiiotex.surfaces.capture import integration
from oiiotex.surfaces.capture.lights import on_ball
from oiiotex.surfaces.capture.lobes import refined
from oiiotex.surfaces.capture.photometric import fitted
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex, save
from tests.reference import captures, reliefs

SIDE = 64
ALBEDO = np.array([0.5, 0.35, 0.2])
RING = captures.lights(8, turn=90)


def linear(photo: np.ndarray, kind=oiio.FLOAT, space: str = "lin_rec709_scene") -> oiio.ImageBuf:
    return buffer(photo, kind, space)


@functools.cache
def hills() -> np.ndarray:
    return reliefs.hills(SIDE, 1)


@functools.cache
def plain_shots() -> list[np.ndarray]:
    return [captures.photo(hills(), ALBEDO, toward, seed=n) for n, toward in enumerate(RING)]


def shots(lights: np.ndarray, heights: np.ndarray | None = None, **more: float) -> list[np.ndarray]:
    if lights is RING and heights is None and not more:  # many tests ask for these
        return [photo.copy() for photo in plain_shots()]
    heights = hills() if heights is None else heights
    return [captures.photo(heights, ALBEDO, toward, seed=n, **more) for n, toward in enumerate(lights)]


def captured(photos: list[np.ndarray], **more: object) -> tuple[np.ndarray, ...]:
    """Albedo, unit normals, heights in px, and roughness if it is asked for."""
    albedo, normal, height, *rest = filters.capture(*map(linear, photos), **more)
    px = height.spec().getattribute(HEIGHT_PX)
    return (pixels(albedo), 2 * pixels(normal) - 1, pixels(height)[..., 0] * px, *(pixels(r)[..., 0] for r in rest))


def sphere(side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """Normals of the middle of a sphere, up to 53 degrees, and its heights, px."""
    y, x = (np.indices((side, side)) + 0.5 - side / 2) / (side * 0.88)
    z = np.sqrt(1 - x * x - y * y)
    return np.stack([x, -y, z], -1), z * side * 0.88


# --- the fit ---


@pytest.mark.parametrize("count", [3, 4, 8])
def test_a_sphere(count):
    normals, heights = sphere()
    lights = np.array([reliefs.light(90 + 360 * n / count, 70) for n in range(count)])  # nothing is in shadow
    photos = [np.maximum(0, normals @ light)[..., None] * ALBEDO for light in lights]
    albedo, found, high = captured(photos, lights=lights.ravel())
    assert captures.degrees_between(found, normals).max() < 0.5
    # half of the 4 % that nearly all surfaces mirror is taken from a matte one, too
    np.testing.assert_allclose(albedo, np.broadcast_to(ALBEDO, albedo.shape), atol=0.01)
    np.testing.assert_allclose(high - high.mean(), heights - heights.mean(), atol=0.01 * np.ptp(heights))


def test_a_plane_is_flat_and_its_tilt_is_removed():
    for lean in (0.0, 0.15):
        normal = np.array([lean, 0, 1]) / np.hypot(lean, 1)
        photos = [np.full((40, 48, 3), 0.4 * light @ normal) for light in RING]
        albedo, normals, heights = captured(photos, lights=RING.ravel())
        assert captures.degrees_between(normals, np.array([0.0, 0, 1])).max() < 0.3
        assert np.ptp(heights) < 0.1
        np.testing.assert_allclose(albedo, 0.4, rtol=0.03)


@pytest.mark.parametrize(
    ("relief", "count", "roughness", "degrees"),
    [
        ("hills", 4, 1, 1.5), ("hills", 8, 0.3, 2.5), ("stones", 8, 1, 3), ("stones", 16, 0.3, 3),
        ("courses", 4, 0.3, 2.5),
    ],
)  # fmt: skip
def test_shadows_and_highlights_are_left_out(relief, count, roughness, degrees):
    heights = {"hills": hills(), "stones": reliefs.stones(SIDE, 1), "courses": reliefs.courses(SIDE)}[relief]
    lights = captures.lights(count, turn=90)
    photos = shots(lights, heights, roughness=roughness, mirrored=0.04 if roughness < 1 else 0, noise=0.01)
    albedo, normals, _ = captured(photos, lights=lights.ravel())
    assert captures.degrees_between(normals, reliefs.normals(heights)).mean() < degrees
    assert 0.95 < np.median(albedo / ALBEDO) < 1.08


@pytest.mark.parametrize("roughness", [0.3, 0.4, 0.5])
def test_wide_highlights_do_not_steepen_a_dark_surface(roughness):
    side = np.linspace(-0.5, 0.5, 24)
    slopes = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    normals = np.column_stack([slopes, np.ones(len(slopes))])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lights = captures.lights(8)
    shown = [0.05 * np.maximum(normals @ light, 0) + captures.highlight(normals, light, roughness) for light in lights]
    seen, toward = np.stack(shown).astype(np.float32), lights[..., None].astype(np.float32)
    valid, one = np.ones(seen.shape, bool), np.ones(len(normals), np.float32)
    matte = fitted(seen, toward, valid)
    joint = refined(seen, toward, valid, matte, (one, one * np.float32(roughness**2)))
    wrong = [captures.degrees_between(each.T, normals).mean() for each in (matte.normals, joint)]
    assert wrong[1] < 0.5 * wrong[0]


def test_powers_and_exposures_may_differ():
    power = np.array([1, 0.6, 1.4, 0.9, 1.1, 0.8, 1.2, 1.0])
    photos = [p * photo for p, photo in zip(power, shots(RING), strict=True)]
    albedo, normals, _ = captured(photos, lights=RING.ravel())
    assert captures.degrees_between(normals, reliefs.normals(hills())).mean() < 1
    assert np.median(albedo / ALBEDO) == pytest.approx(np.exp(np.log(power).mean()), rel=0.03)


def test_near_lights_are_positions():
    positions = 150.0 * RING * np.linspace(0.9, 1.2, 8)[:, None]  # mm; the photo shows 200
    y, x = (np.indices((SIDE, SIDE)) + 0.5 - SIDE / 2) * 200 / SIDE
    photos = []
    for place in positions:
        away = place - np.stack([x, -y, np.zeros_like(x)], -1)
        square = (away**2).sum(-1, keepdims=True)
        shade = (reliefs.normals(hills()) * away).sum(-1, keepdims=True) / np.sqrt(square)
        photos.append(np.maximum(shade, 0) * (place @ place) / square * ALBEDO)
    albedo, normals, _ = captured(photos, lights=positions.ravel(), span=200.0)
    assert captures.degrees_between(normals, reliefs.normals(hills())).mean() < 1
    assert np.abs(albedo / ALBEDO - 1).mean() < 0.03
    far = captured(photos, lights=positions.ravel())[1]
    assert captures.degrees_between(far, reliefs.normals(hills())).mean() > 5


def test_clipped_photos_are_left_out_and_warned_about(caplog):
    photos = [linear(2.4 * photo, oiio.UINT8) for photo in shots(RING)]
    clipped = np.mean([(pixels(p) == 255).any(-1) for p in photos])
    assert clipped > 0.15
    normals = 2 * pixels(filters.capture(*photos, lights=RING.ravel())[1]) - 1
    assert captures.degrees_between(normals, reliefs.normals(hills())).mean() < 3.5
    assert "is clipped: use a shorter exposure" in caplog.text


@pytest.mark.parametrize("relief", ["hills", "stones", "courses"])
def test_a_camera_that_moved_is_warned_about(relief, caplog):
    side = 128
    heights = {"hills": reliefs.hills(side, 1), "stones": reliefs.stones(side, 1), "courses": reliefs.courses(side)}
    albedo = 0.2 + 0.6 * pictures.noise(side, side, 3)[..., None]
    photos = [captures.photo(heights[relief], albedo, toward, noise=0.01, seed=n) for n, toward in enumerate(RING)]
    filters.capture(*map(linear, photos), lights=RING.ravel())
    assert "the camera moved" not in caplog.text
    moved = [np.roll(photo, (5 * n, -4 * n), (0, 1)) for n, photo in enumerate(photos)]
    filters.capture(*map(linear, moved), lights=RING.ravel())
    assert "the camera moved" in caplog.text


def test_high_dynamic_range_is_kept_and_gray_and_data_work():
    photos = shots(RING)
    plain = captured(photos, lights=RING.ravel())
    bright = captured([50 * photo for photo in photos], lights=RING.ravel())
    np.testing.assert_allclose(bright[0], 50 * plain[0], rtol=0.02)
    np.testing.assert_allclose(bright[1], plain[1], atol=2e-3)
    data = filters.capture(*[buffer(photo[..., :1], space="data") for photo in photos], lights=RING.ravel())
    np.testing.assert_allclose(2 * pixels(data[1]) - 1, plain[1], atol=0.02)
    assert np.median(pixels(data[0])) == pytest.approx(ALBEDO[0], rel=0.02)


def test_pixels_of_alpha_0_are_gaps():
    alpha, bare = np.ones((96, 96, 1)), shots(RING, reliefs.hills(96, 1))
    alpha[30:50, 40:70] = 0
    glow = 0.1 * (1 - alpha) * np.arange(len(RING))[:, None, None, None]  # color without opacity, as of a fire
    photos = [np.concatenate([photo * alpha + light, alpha], -1) for photo, light in zip(bare, glow, strict=True)]
    albedo, normals, heights = captured(photos, lights=RING.ravel())
    seen, whole = alpha[..., 0] > 0, captured(bare, lights=RING.ravel())
    assert not albedo[~seen].any()
    assert (normals[~seen] == [0, 0, 1]).all()
    assert captures.degrees_between(normals, whole[1])[seen].mean() < 0.5
    away = (heights - whole[2])[seen]
    assert away.std() < 0.1 * whole[2].std()


# --- lights ---


def test_lights_of_a_file_are_found_by_name(tmp_path):
    for n, photo in enumerate(shots(RING)):
        save(photo, tmp_path / f"p{n}.exr", "float", "lin_rec709_scene")
    order = [3, 1, 0, 2, 7, 6, 5, 4]
    lines = [f"folder/p{n}.jpg {' '.join(map(str, RING[n]))}" for n in order]
    (tmp_path / "lights.lp").write_text("\n".join(["8", *lines]))
    (tmp_path / "lights.json").write_text(str([list(map(float, light)) for light in RING]))
    names = [f"p{n}.exr" for n in range(8)]
    maps = ["-o", "height.exr", "--pop", "-o", "normal.exr", "--pop", "-o", "albedo.exr"]
    made = []
    for lights in ("lights.lp", "lights.json"):
        done = oiiotex(*names, f"--texcapture:lights={lights}", *maps, "-v", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        made.append([load(tmp_path / f"{name}.exr") for name in ("albedo", "normal", "height")])
    for one, other in zip(*made, strict=True):
        np.testing.assert_array_equal(one, other)
    assert captures.degrees_between(2 * made[0][1] - 1, reliefs.normals(hills())).mean() < 1
    said = oiio.ImageBuf(str(tmp_path / "normal.exr")).spec()
    assert said.get_string_attribute(ESTIMATE) == "normal from 8 photos, lights given"
    assert said.get_string_attribute("oiiotex:source").startswith("p0.exr")


@pytest.mark.parametrize("matte", [True, False])
def test_the_direction_of_a_light_is_seen_on_a_ball(matte):
    y, x = (np.indices((81, 81)) + 0.5) / 40.5 - 1
    inside = x * x + y * y < 1
    normals = np.stack([x, -y, np.sqrt(np.maximum(0, 1 - x * x - y * y))], -1)
    for light in RING:
        mirrored = 2 * normals[..., 2:] * normals - [0, 0, 1]
        ball = np.maximum(0, normals @ light) if matte else 0.1 + 5.0 * (mirrored @ light > 0.99)
        assert captures.degrees_between(on_ball(np.where(inside, ball, 0.3)), light) < 1.5


def test_a_ball_in_the_photos_is_a_gap():
    y, x = (np.indices((24, 24)) + 0.5) / 12 - 1
    normals = np.stack([x, -y, np.sqrt(np.maximum(0, 1 - x * x - y * y))], -1)
    photos = shots(RING)
    for photo, light in zip(photos, RING, strict=True):
        inside = x * x + y * y < 1
        photo[6:30, 36:60][inside] = 0.8 * np.maximum(0, normals @ light)[inside][:, None]
    _, found, _ = captured(photos, ball="24x24+36+6")
    seen = np.ones((SIDE, SIDE), bool)
    seen[6:30, 36:60] = False
    assert captures.degrees_between(found, reliefs.normals(hills()))[seen].mean() < 2
    assert (found[~seen] == [0, 0, 1]).all()


def test_lights_are_found_up_to_the_relief(caplog):
    caplog.set_level("INFO")
    lights = captures.lights(8, 40, turn=90)
    truth = reliefs.normals(hills())
    _, found, heights = captured(shots(lights, noise=0.005), strength=float(np.tan(np.radians(46))))
    assert captures.degrees_between(found, truth).mean() < 4
    assert np.corrcoef(heights.ravel(), hills().ravel())[0, 1] > 0.97
    assert "strength of the relief, and what is raised, are not in the photos" in caplog.text
    swapped = captured(shots(lights, noise=0.005), light=270.0)[2]
    assert np.corrcoef(swapped.ravel(), heights.ravel())[0, 1] < -0.95


def test_lights_that_photos_do_not_tell_are_refused():
    rng = np.random.default_rng(1)
    with pytest.raises(errors.ImageError, match="set lights or ball"):
        captured([0.2 + 0.5 * rng.random((48, 48, 3)) for _ in range(6)])
    with pytest.raises(errors.ImageError, match="at least 6 photos without lights or a ball"):
        captured(shots(RING)[:5])


# --- roughness ---


@pytest.mark.parametrize("roughness", [0.2, 0.3, 0.45])
def test_roughness_is_the_width_of_highlights(roughness):
    photos = shots(RING, roughness=roughness, mirrored=0.04, noise=0.005)
    made = captured(photos, lights=RING.ravel(), roughness=True)[3]
    assert np.abs(made - roughness).mean() < 0.05


def test_roughness_that_varies_is_seen_where_it_is():
    roughness = np.where(np.indices((SIDE, SIDE))[1] < SIDE // 2, 0.2, 0.4)
    made = captured(shots(RING, roughness=roughness, mirrored=0.04), lights=RING.ravel(), roughness=True)[3]
    assert np.abs(made - roughness)[:, 16:-16].mean() < 0.06
    assert captured(shots(RING, roughness=0.8, mirrored=0.04), lights=RING.ravel(), roughness=True)[3].mean() > 0.7


# --- refusals ---


@pytest.mark.parametrize(
    ("change", "more", "text"),
    [
        (lambda photos: photos[:1], {}, "1 photo: expected 3 to 16"),
        (lambda photos: photos[:2], {}, "2 photos: expected 3 to 16"),
        (lambda photos: photos * 3, {}, "24 photos: expected 3 to 16"),
        (lambda photos: [*photos[:7], photos[7][:-1]], {}, "is 64x63: expected 64x64"),
        (lambda photos: photos[:5], {"roughness": True, "lights": RING[:5].ravel()}, "requires six photos"),
        (lambda photos: photos[:7], {}, "8 lights: expected x, y and z for each of 7 photos"),
        (lambda photos: photos, {"lights": [0.0, 0.1, 1.0] * 8}, "nearly in one plane"),
        (lambda photos: photos, {"lights": [n * 0.2 - 0.7 if k == 0 else k / 2 for n in range(8) for k in range(3)]},
         "nearly in one plane"),
        (lambda photos: photos, {"lights": -RING.ravel()}, "expected z > 0"),
        (lambda photos: photos, {"lights": RING.ravel()[:-1]}, "expected x, y and z"),
        (lambda photos: [*photos[:7], 0 * photos[7]], {}, "is black"),
        (lambda photos: photos, {"ball": "20x20+90+6"}, "conflicts with lights"),
        (lambda photos: photos, {"span": 100.0, "lights": None}, "requires lights"),
        (lambda photos: photos, {"ball": "20x20+90+6", "lights": None}, "the box around a ball"),
    ],
)  # fmt: skip
def test_bad_photos_and_lights_are_refused(change, more, text):
    with pytest.raises(errors.Error, match=text):
        captured(change(shots(RING)), **({"lights": RING.ravel()} | more))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_broken_values_of_any_photo_are_counted(value):
    photos = shots(RING)
    photos[5][3, 4, 0] = photos[5][60, 7, 1] = value
    with pytest.raises(errors.BrokenValues, match="2 NaN and 0 Inf" if np.isnan(value) else "0 NaN and 2 Inf"):
        captured(photos, lights=RING.ravel())


DAMAGED = ["", "8\n", "a 1 2\n", "a b c d\n", "\n".join(["p 1 2 nan"] * 8), "\n".join(["p 0 0 1e300"] * 8)]


@pytest.mark.parametrize("text", DAMAGED)
def test_damaged_files_of_lights_are_refused(text, tmp_path):
    for name in ("lights.lp", "lights.json"):
        (tmp_path / name).write_text(text)
        with pytest.raises(errors.ImageError, match=name):
            captured(shots(RING), lights=tmp_path / name)


# --- heights ---


@pytest.mark.parametrize("store", [np.zeros, RowStore])
def test_heights_do_not_depend_on_bands_or_where_they_are_stored(store, monkeypatch):
    y, x = np.mgrid[:61, :83] / 9
    truth = 8 * np.sin(x) * np.cos(y)
    slopes = np.stack([np.gradient(truth, axis=1), np.gradient(truth, axis=0)], -1).astype(np.float32)
    slopes[20:26, 30:40] = np.nan
    whole = np.zeros(truth.shape, np.float32)
    integration.integrate(slopes, whole)
    monkeypatch.setattr(integration, "BAND_BYTES", 8 * 83 * 5)
    heights = store(truth.shape, np.float32)
    integration.integrate(slopes, heights)
    np.testing.assert_array_equal(np.asarray(heights), whole)
    plane = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], 1)  # the mean slope is removed
    away = (whole - truth).ravel()
    away -= plane @ np.linalg.lstsq(plane, away, rcond=None)[0]
    assert np.abs(away[np.isfinite(slopes[..., 0]).ravel()]).max() < 0.05 * np.ptp(truth)


def test_memory_and_threads_do_not_show(monkeypatch):
    from oiiotex.surfaces.capture import captured as module

    photos = list(map(linear, shots(RING, roughness=0.3, mirrored=0.04)))
    plain = [pixels(each) for each in filters.capture(*photos, lights=RING.ravel(), roughness=True)]
    monkeypatch.setattr(module, "BAND_BYTES", SIDE * 12 * 8 * 4)  # bands of 16 rows
    monkeypatch.setattr(module, "_PIECE", 32 * 8)
    monkeypatch.setattr(module, "empty_rows", lambda shape, dtype, _: RowStore(shape, dtype))
    for session in (Session(threads=1), Session(threads=3)):
        made = filters.capture(*photos, lights=RING.ravel(), roughness=True, session=session)
        for one, other in zip(made, plain, strict=True):
            np.testing.assert_array_equal(pixels(one), other)
    with pytest.raises(errors.MemoryBudgetError, match="the maps of 8 photos of 64x64"):
        filters.capture(*photos, lights=RING.ravel(), session=Session(budget=1 << 16))


def test_the_maps_are_one_material(tmp_path):
    paint = pictures.smooth_noise(SIDE, SIDE, 12, 3)[..., None] * [0.5, 0.4, 0.2] + 0.1
    for n, light in enumerate(RING):
        save(captures.photo(hills(), paint, light), tmp_path / f"p{n}.exr", "float", "lin_rec709_scene")
    (tmp_path / "l.json").write_text(str([list(map(float, light)) for light in RING]))
    capture = [*[f"p{n}.exr" for n in range(8)], "--texcapture:lights=l.json"]
    done = oiiotex(
        *capture, "--texstationarize:kinds=color,normal,height:size=64x64:iterations=1",
        "-o", "height.exr", "--pop", "-o", "normal.exr", "--pop", "-o", "albedo.exr", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert load(tmp_path / "normal.exr").shape == load(tmp_path / "albedo.exr").shape == (64, 64, 3)
    check = "--texcheckmaterial:kinds=color,normal,height:fail=none:facts=found.json"
    checked = oiiotex(*capture, check, "-o", "a.exr", cwd=tmp_path)
    assert checked.returncode == 0, checked.stderr
    findings = {one["check"] for one in json.loads((tmp_path / "found.json").read_text())["findings"]}
    assert findings <= {"moved"}  # the paint has no edges in common with the relief
