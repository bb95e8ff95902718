# SPDX-License-Identifier: Apache-2.0
"""--texfill: a region replaced from the same photo or another one."""

from __future__ import annotations

import json
import logging
import tracemalloc

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.io.cryptomatte import hashed
from oiiotex.engine.session import Session
from oiiotex.synthesis.fill import border
from oiiotex.synthesis.fill import fill_measures as measured
from oiiotex.synthesis.fill.border import border_offsets
from oiiotex.synthesis.fill.fill_measures import fill_measures
from oiiotex.synthesis.fill.onion_peel import BYTES as START_BYTES
from oiiotex.synthesis.fill.onion_peel import peeled
from oiiotex.synthesis.fill.seam_zone import cut_bytes, grown, replaced_pixels
from oiiotex.synthesis.fill.source_layout import in_layout_of
from oiiotex.synthesis.patchmatch.field import Geometry
from oiiotex.synthesis.projections.histograms import OUTSIDE
from oiiotex.synthesis.quality.seam_measures import seam_ratio
from tests import pictures
from tests.any_filter import buffer, ids, labeled, pixels
from tests.conftest import load, oiiotex, save
from tests.refusals import refused

PHOTO = pictures.stained(pictures.pebbles(96, 112, 3))
STAIN = (((np.indices((96, 112))[1] - 73) / 27) ** 2 + ((np.indices((96, 112))[0] - 38) / 20) ** 2 < 1)[..., None]
HOLE = STAIN[..., 0]
OTHER = pictures.moss(80, 64, 1)
QUICK = {"iterations": 4, "patch": 7}


def mask(where: np.ndarray) -> oiio.ImageBuf:
    return buffer(where * 1.0, space="data", names=("Y",))


def made(region: np.ndarray = STAIN, photo: oiio.ImageBuf | None = None, **more: object):
    return filters.fill(photo or buffer(PHOTO), mask(region), **{**QUICK, **more})


def test_outside_nothing_changes_and_inside_nothing_stays_of_the_stain():
    found = made(st=True, fade=0.0)
    filled, st = pixels(found["fill"]), pixels(found["st"])
    photo = PHOTO.astype(np.float32)
    np.testing.assert_array_equal(filled[~HOLE], photo[~HOLE])
    x, y = (np.floor(st[..., i] * n).astype(int) for i, n in ((0, 112), (1, 96)))
    np.testing.assert_array_equal(filled, photo[y, x])
    assert not HOLE[y, x].any()  # patches come from outside
    stain, clean, around = photo[HOLE].mean(), filled[HOLE].mean(), photo[~HOLE].mean()
    assert abs(clean - around) < 0.2 * abs(stain - around)


def test_new_pixels_fit_the_old_ones():
    """Jumps across the region's border are half of those that pasted texture has there."""
    across = HOLE[:, 1:] != HOLE[:, :-1]
    pasted = np.where(STAIN, np.roll(PHOTO, (31, 47), (0, 1)), PHOTO)
    found, other = (np.abs(np.diff(tile[..., 1], axis=1))[across].mean() for tile in (pixels(made()), pasted))
    assert found < 0.6 * other


def test_a_resynthesized_border_makes_a_photo_tile():
    y, x = np.indices((96, 112))
    border = (np.minimum(np.minimum(x, 111 - x), np.minimum(y, 95 - y)) < 14)[..., None]
    tile = pixels(made(border, tiled="xy"))
    np.testing.assert_array_equal(tile[~border[..., 0]], PHOTO.astype(np.float32)[~border[..., 0]])
    for axis in (0, 1):
        assert seam_ratio(tile[..., 1], axis) < 0.6 * seam_ratio(PHOTO[..., 1], axis)


def test_windows_stay_and_transparent_pixels_are_no_source():
    spec = oiio.ImageSpec(112, 96, 4, oiio.FLOAT)
    spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height = -7, 11, -20, 0, 160, 140
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    photo = oiio.ImageBuf(spec)
    alpha = (np.indices((96, 112))[1] < 100)[..., None] * 1.0
    photo.set_pixels(photo.roi, np.concatenate([PHOTO * alpha, alpha], -1).astype(np.float32))
    for more in ({}, {"matchlight": 1.0}):
        found = made(photo=photo, **more)
        assert found.roi == photo.roi and found.roi_full == photo.roi_full
        np.testing.assert_array_equal(pixels(found)[~HOLE], pixels(photo)[~HOLE])
        assert (pixels(found)[HOLE, 3] == 1).all()


# --- another photo ---


def gradient(scale: float = 0.6) -> np.ndarray:
    """The pebbles in a light that falls off to the right, in linear values."""
    return pictures.pebbles(96, 112, 3) * np.linspace(1.0, scale, 112)[None, :, None]


def test_another_photo_takes_the_light_of_its_surroundings():
    """The mean of the fill follows the light; matchlight=0 gives verbatim copies instead."""
    photo, region = buffer(gradient(0.3), space="lin_rec709_scene"), np.indices((96, 112))[0] // 32 == 1
    source = buffer(OTHER * 0.2, space="lin_rec709_scene")
    lit, plain = (
        made(region[..., None], photo, donor=source, matchlight=a, fade=b) for a, b in ((None, 4.0), (0.0, 0.0))
    )
    known = {p.tobytes() for p in pixels(source).reshape(-1, 3)}
    assert all(p.tobytes() in known for p in pixels(plain)[region])
    of_thirds = [pixels(lit)[32:64, a:b].mean() / gradient(0.3)[:32, a:b].mean() for a, b in ((0, 37), (75, 112))]
    assert np.allclose(of_thirds, 1, atol=0.15), of_thirds
    np.testing.assert_array_equal(pixels(lit)[~region], gradient(0.3).astype(np.float32)[~region])


def test_a_step_at_the_border_fades_out_into_the_region():
    """A source 5 Lab brighter than the photo everywhere: most of it at the border, less inside, none elsewhere."""
    ramp = np.repeat(np.linspace(0, 40, 80, dtype=np.float32)[:, None, None], 80, 1).repeat(3, 2)
    inside, here = np.hypot(*(np.indices((80, 80)) - 40)) < 30, SourceMap.of(*np.indices((80, 80)))
    offsets = border_offsets(ramp, ramp + 5, here, inside, ~inside, None, 4.0)
    assert -5 < offsets[40, 11].max() < -4 and -3 < offsets[40, 15].max() < -1
    assert not offsets[~inside].any() and not offsets[40, 32:48].any()
    hidden = border_offsets(ramp, ramp + 5, here, inside, ~inside, inside, 4.0)
    assert not hidden.any()  # the source cannot be continued: nothing is known of the step


def test_the_correction_solves_the_screened_poisson_equation():
    """Each pixel: (1 / fade^2 + edges) c - sum of c of neighbors = sum of steps across the border, twice the weight."""
    random = np.random.default_rng(0)
    kept, other = random.uniform(40, 60, (2, 9, 11, 3)).astype(np.float32)
    shown = np.zeros((9, 11), bool)
    shown[2:7, 3:8] = shown[0, 0] = shown[8, 4] = True
    found = border_offsets(kept, other, SourceMap.of(*np.indices(shown.shape)), shown, ~shown, None, 3.0, (True, False))
    most = np.diff(np.quantile(kept[~shown], (0.1, 0.9), axis=0), axis=0)[0]
    for y, x in zip(*np.nonzero(shown), strict=True):
        weight, total = 1 / 9, np.zeros(3)
        for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            at = y + dy, (x + dx) % 11
            if not 0 <= at[0] < 9 or (not shown[at] and not 0 <= x + dx < 11):
                continue  # the source ends there
            here = np.clip(kept[at] - other[at], -most, most)
            weight, total = weight + 2 - shown[at], total + (found[at] if shown[at] else 2 * here)
        np.testing.assert_allclose(found[y, x] * weight, total, atol=0.02)


def test_a_blended_border_changes_color_alone_and_keeps_light_and_alpha():
    """Bright values next to black ones: nothing turns negative, and normals and alpha are those without blending."""
    alpha = np.ones((96, 112, 1))
    photo = buffer(np.concatenate([(PHOTO - PHOTO.min()) ** 4 * 60, alpha], -1), space="lin_rec709_scene")
    normal = buffer(np.random.default_rng(1).uniform(0, 1, (96, 112, 3)), space="data")
    both = [
        filters.fill(photo, mask(STAIN), maps=[normal], kinds=("color", "normal"), fade=blend, **QUICK)
        for blend in (0.0, 4.0)
    ]
    plain, blended = ([pixels(one) for one in made] for made in both)
    np.testing.assert_array_equal(blended[1], plain[1])
    np.testing.assert_array_equal(blended[0][..., 3], plain[0][..., 3])
    moved = (blended[0] != plain[0]).any(-1)
    assert moved[HOLE].any() and not moved[~HOLE].any() and blended[0].min() >= 0 and np.isfinite(blended[0]).all()
    jumps = [
        np.abs(np.diff(np.cbrt(tile[..., 1]), axis=1))[HOLE[:, 1:] != HOLE[:, :-1]].mean()
        for tile in (plain[0], blended[0])
    ]
    assert jumps[1] < 0.8 * jumps[0]


def test_coordinates_and_drift_give_the_pixels_of_another_photo():
    found = made(donor=buffer(OTHER), st=True, drift=True, matchlight=0.0, fade=0.0)
    st, drift = pixels(found["st"]), pixels(found["drift"])
    np.testing.assert_array_equal(st[..., 2], HOLE)
    x, y = (np.floor(st[..., i] * n).astype(int) for i, n in ((0, 64), (1, 80)))
    np.testing.assert_array_equal(pixels(found["fill"])[HOLE], OTHER.astype(np.float32)[y[HOLE], x[HOLE]])
    np.testing.assert_array_equal(drift, np.broadcast_to(np.repeat([1, 0], 3), drift.shape))
    lit = pixels(made(donor=buffer(OTHER), drift=True)["drift"])
    assert (lit[~HOLE] == drift[~HOLE]).all() and (lit[HOLE] != drift[HOLE]).any()


def test_all_of_a_photo_and_a_region_larger_than_the_source():
    everything = np.ones_like(STAIN)
    filled = pixels(made(everything, donor=buffer(OTHER[:20, :20])))
    known = {p.tobytes() for p in OTHER[:20, :20].astype(np.float32).reshape(-1, 3)}
    assert all(p.tobytes() in known for p in filled.reshape(-1, 3))


def test_a_source_is_converted_to_the_photos_space_channels_and_type():
    photo = from_buffer(buffer(np.ones((4, 4, 5)), oiio.HALF, "lin_rec709_scene", ("R", "G", "B", "A", "Z")))
    other = buffer(np.full((3, 3, 5), 0.5), oiio.UINT8, names=("Z", "R", "G", "B", "N"))
    other.specmod().alpha_channel = -1
    source = from_buffer(other)
    pixel = in_layout_of(photo, source, True, Session().resources).pixels()[1, 1]
    assert pixel.dtype == np.float16
    np.testing.assert_allclose(pixel, [0.2159, 0.2159, 0.2159, 1, 0.502], atol=2e-3)
    dark = from_buffer(buffer(np.full((3, 3, 1), 0.2), space="lin_rec709_scene", names=("Y",)))
    np.testing.assert_allclose(
        in_layout_of(photo, dark, True, Session().resources).pixels()[1, 1], [0.2, 0.2, 0.2, 1, 0], atol=1e-3
    )


def test_all_maps_come_from_the_same_pixels():
    normal = np.concatenate([OTHER[..., :2], np.ones((80, 64, 1))], -1)
    source = {"color": buffer(OTHER), "normal": buffer(normal, space="data")}
    own = buffer(np.full((96, 112, 3), 0.5), space="data")
    found = filters.fill(
        buffer(PHOTO),
        mask(STAIN),
        maps=[own],
        kinds=("color", "data"),
        donor=source,
        matchlight=0.0,
        fade=0.0,
        **QUICK,
    )
    both = np.concatenate([pixels(one)[HOLE] for one in found], -1)
    known = {p.tobytes() for p in np.concatenate([OTHER, normal], -1).astype(np.float32).reshape(-1, 6)}
    assert all(p.tobytes() in known for p in both)
    assert (pixels(found[1])[~HOLE] == 0.5).all()


# --- which pixels ---


def test_a_label_of_the_photo_is_replaced_from_a_label_of_the_source():
    x = np.indices((96, 112))[1]
    labels = ids(1 + (x > 40) + (x > 80).astype(int))
    found = pixels(filters.fill(labeled(buffer(PHOTO), labels), replace=2, label=3, st=True, **QUICK)["st"])
    columns = np.floor(found[..., 0] * 112).astype(int)
    assert (columns[:, 41:81] > 80).all()
    np.testing.assert_array_equal(columns[:, :41], x[:, :41])
    with pytest.raises(errors.ParameterError, match="label=9: not in"):
        filters.fill(labeled(buffer(PHOTO), labels), replace=2, label=9, **QUICK)
    with pytest.raises(errors.ParameterTypeError, match=r"2 images.* 1$"):
        filters.fill(buffer(PHOTO), None)


def cryptomatte(name: str, where: np.ndarray) -> oiio.ImageBuf:
    bits = np.array([hashed(name)], np.uint32).view(np.float32)[0]
    covered = np.where(where, np.float32(0.3), np.float32(0))
    made = buffer(np.stack([covered * 0, covered * 0, covered * 0 + bits * where, covered], -1), space="data")
    spec = made.specmod()
    spec.channelnames = ("things00.R", "things00.G", "things00.B", "things00.A")
    spec.attribute("cryptomatte/1234567/name", "things")
    spec.attribute("cryptomatte/1234567/manifest", json.dumps({name: f"{hashed(name):08x}"}))
    return made


def test_an_object_of_a_cryptomatte_is_replaced():
    photo = {"photo": buffer(PHOTO), "mattes": cryptomatte("chair", HOLE)}
    whole = pixels(made())
    for name in ("chair", f"{hashed('chair'):08x}"):
        np.testing.assert_array_equal(pixels(filters.fill(photo, matte=name, **QUICK)), whole)
    with refused(errors.ParameterError, parameter="matte", value="chiar", expected="a name such as chair"):
        filters.fill(photo, matte="chiar")
    with pytest.raises(errors.ImageError, match="has no Cryptomatte channels; append the parts"):
        filters.fill(buffer(PHOTO), matte="chair")


def test_a_cut_stays_in_its_zone():
    away = np.hypot(*(np.indices((96, 112)) - 50))
    cut = pixels(made((away < 22)[..., None], donor=buffer(PHOTO[::-1]), seamzone=9, matchlight=0.0))
    new = (cut != PHOTO.astype(np.float32)).any(-1)
    assert not new[away > 31].any() and new[away < 22].mean() > 0.9 and new[(away > 23) & (away < 31)].any()


def test_a_cut_goes_where_photo_and_fill_agree():
    away = np.hypot(*(np.indices((96, 112)) - 50))
    kept = np.random.default_rng(0).uniform(20, 80, (96, 112, 3)).astype(np.float32)
    filled = np.where(np.abs(away - 28)[..., None] < 2, kept, kept + 25)
    here = SourceMap.of(*np.indices((96, 112)))
    shown = replaced_pixels(away < 22, away < 34, kept, filled, here)
    assert shown[away < 26].all() and not shown[away > 30].any()


def test_small_scattered_and_empty_regions(caplog):
    dots = np.zeros_like(STAIN)
    dots[0, 0] = dots[50, 60] = dots[90:, 100:] = True
    filled = pixels(made(dots))
    np.testing.assert_array_equal(filled[~dots[..., 0]], PHOTO.astype(np.float32)[~dots[..., 0]])
    assert (filled != PHOTO.astype(np.float32))[dots[..., 0]].any(-1).all()
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(pixels(made(STAIN & False)), PHOTO.astype(np.float32))
    assert "the region is empty; the photo is unchanged" in caplog.text


@pytest.mark.parametrize(
    ("region", "more", "said"),
    [
        (STAIN | True, {}, r"the region covers every pixel of .*: no source pixels remain; .* photo with donor="),
        (STAIN[:30, :40], {}, "region is 40x30, but the exemplar is 112x96"),
        (np.indices((96, 112)).sum(0)[..., None] % 5 > 0, {}, "no 7x7 patch of the exemplar of 112x96 px is free of"),
        (STAIN, {"mask": mask(STAIN)}, "no source pixels remain: all are transparent, or excluded"),
        (STAIN, {"mask": mask(STAIN), "donor": buffer(OTHER)}, "mask is 112x96, but the source is 64x80: expected"),
        (STAIN, {"donor": buffer(OTHER[:5])}, "the exemplar of 64x5 px is smaller than a patch of 7x7"),
        (STAIN, {"labellevel": 1}, "labellevel=1: requires replace or label"),
        (STAIN, {"relevel": True}, "relevel=True requires kinds with a height"),
        (
            STAIN,
            {"maps": [buffer(PHOTO)], "donor": buffer(OTHER)},
            "ImageBuf has 1 parts: expected at least 2, one for each map",
        ),
        (STAIN, {"data": True, "donor": buffer(OTHER)}, "donor requires a map of kind color or normal"),
    ],
)
def test_what_cannot_be_filled_is_said_in_one_line(region, more, said):
    with pytest.raises(errors.Error, match=said):
        made(region, **more)


def test_memory_is_known_before_the_work():
    big = buffer(np.zeros((1200, 1600, 3)))
    region = np.zeros((1200, 1600, 1))
    region[100:1100, 100:1500] = 1
    with pytest.raises(errors.ImageError, match=r"needs [0-9]+ MB"):
        filters.fill(big, mask(region), session=Session(budget=32 << 20))


def test_regions_on_the_command_line(tmp_path):
    save(PHOTO, tmp_path / "photo.png")
    save(STAIN * 1.0, tmp_path / "stain.png")
    save(OTHER, tmp_path / "other.png")
    line = "photo.png", "stain.png", "--texfill:iterations=2:patch=7:donor=other.png", "-o", "out.png"
    done = oiiotex(*line, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    before, after = load(tmp_path / "photo.png"), load(tmp_path / "out.png")
    np.testing.assert_array_equal((before != after).any(-1) & ~HOLE, False)


# --- how good it is ---


def test_a_good_fill_passes_and_a_bad_one_is_called_bad(tmp_path, caplog):
    """Pasted texture of another photo in another light has a visible border, and there is a warning without report."""
    bad = {"donor": buffer(OTHER * 0.3 + 0.6), "matchlight": 0.0, "fade": 0.0}
    with caplog.at_level(logging.WARNING):
        made(report=tmp_path / "good.json", fail=["border>1.5", "sharp<0.5"])
        assert not caplog.text
        with pytest.raises(errors.QualityError, match=r"fill: border is .*: fail=border>1.5"):
            made(report=tmp_path / "bad.json", fail=["border>1.5"], **bad)
    assert "The border of the fill is visible." in caplog.text
    good, poor = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("good", "bad"))
    (fine,), (visible,) = (report["results"] for report in (good, poor))
    assert fine["measures"]["border"] < 1.5 < visible["measures"]["border"]
    assert fine["measures"]["step"] < visible["measures"]["step"] and fine["measures"]["repeat"] >= 1
    assert good["passed"] and not poor["passed"] and "cost" not in fine["measures"]
    with refused(errors.ParameterError, parameter="fail", value="cost>3"):
        made(fail=["cost>3"])


def test_measures_of_a_photo_and_of_a_blurred_region():
    """What was there all along has 1 everywhere; a blur is not sharp; a pasted square has a border and a step."""
    lab = np.repeat(np.random.default_rng(0).normal(50, 10, (96, 112, 1)), 3, 2).astype(np.float32)
    own = fill_measures(lab, HOLE, ~HOLE)
    assert all(0.7 < value < 1.4 for value in own.values()), own
    flat, pasted = (np.where(STAIN, other, lab) for other in (np.float32(50), lab[::-1, ::-1] + 30))
    assert fill_measures(flat, HOLE, ~HOLE)["sharp"] < 0.2
    found = fill_measures(pasted, HOLE, ~HOLE)
    assert found["border"] > 1.8 and found["step"] > 2.5 and found["sharp"] > 0.8
    assert not fill_measures(lab, HOLE | True, HOLE & False)


def test_steps_besides_the_synthesis_take_no_more_memory_than_declared():
    """Traced peaks, for each pixel: a region of stripes, in which every pixel is next to the border, and a cut."""
    y, x = np.indices((200, 200))
    shown, zone = y // 2 % 2 == 0, np.hypot(y - 100, x - 100) < 80
    kept, here = np.random.default_rng(0).normal(50, 10, (200, 200, 3)).astype(np.float32), SourceMap.of(y, x)
    marked = np.hypot(y - 100, x - 100) < 40
    geometry = Geometry(width=200, height=200, exemplar_width=200, exemplar_height=200, patch=5)
    image = (9 * kept).astype(np.int16)
    thin = np.abs(y - 100) < 4
    stays = np.where(thin[..., None], np.int16(OUTSIDE), image)
    steps = (
        (lambda: border_offsets(kept, kept + 5, here, shown, ~shown, None, 4.0), border.BYTES * y.size),
        (lambda: fill_measures(kept, shown, ~shown), measured.BYTES * y.size),
        (
            lambda: replaced_pixels(marked, zone, kept, kept + 5, here),
            cut_bytes(y.size, np.count_nonzero(zone & ~marked), y.size),
        ),
        (
            lambda: peeled(SourceMap.of(y[4:, 4:], x[4:, 4:]), stays, image, ~grown(thin, 8)[4:, 4:], geometry),
            START_BYTES,
        ),
    )
    for work, declared in steps:
        work()  # imports
        tracemalloc.start()
        work()
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert 0.4 * declared < peak < declared
