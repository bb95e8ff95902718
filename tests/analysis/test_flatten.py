# SPDX-License-Identifier: Apache-2.0
"""--texflatten: against its oracle, against a dense version, and at its edges."""

from __future__ import annotations

import logging

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.color.config import ColorConfig
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.session import Session
from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import save
from tests.reference import drift as reference
from tests.refusals import refused


def lab_of(image: np.ndarray, space: str = "lin_rec709_scene") -> np.ndarray:
    lab = np.ascontiguousarray(image[..., :3], np.float32)
    ColorConfig().to_lab(space)(lab)
    return lab


def linear(picture: np.ndarray) -> oiio.ImageBuf:
    return buffer(picture, space="lin_rec709_scene", names=("R", "G", "B", "A")[: picture.shape[2]])


@pytest.mark.parametrize(
    ("height", "width", "radius", "side", "amount", "contrast", "tone"),
    [(31, 47, 15.0, 2, 1.0, 1.0, "photo"), (50, 23, 26.0, 3, 0.6, 0.5, "gray")],
)
def test_it_is_what_the_oracle_says(height, width, radius, side, amount, contrast, tone):
    picture = pictures.stained(pictures.bricks(height, width, 3)) ** 2.2
    alpha = np.ones((height, width, 1))
    alpha[4:17, 5:15] = 0
    given = np.concatenate([picture, alpha], -1).astype(np.float32)
    made = pixels(filters.flatten(linear(given), radius=radius, flattening=amount, localcontrast=contrast, tone=tone))
    target = None if tone == "photo" else np.array([50.0, 0, 0])
    seen = alpha[..., 0] > 0
    wanted = reference.flattened(lab_of(given), seen, radius, side, amount, contrast, target)
    np.testing.assert_allclose(lab_of(made)[seen], wanted[seen], atol=2e-3)
    np.testing.assert_array_equal(made[~seen], given[~seen])


def test_a_stain_is_removed_with_its_rim_and_the_texture_stays():
    """What a Gaussian does not do: it leaves a bright and a dark rim."""
    photo = pictures.moss(256, 256, 1) ** 2.2
    clean = lab_of(photo).astype(np.float64)
    y, x = np.mgrid[:256, :256]
    stain = 1 / (1 + np.exp((np.hypot(x - 100, y - 140) - 70) / 2))
    stained = photo * (1 - stain[..., None] * [0.4, 0.45, 0.6])  # it absorbs light, as dirt does
    lab = lab_of(stained)
    made = lab_of(pixels(filters.flatten(linear(stained)))).astype(np.float64)

    def blurred(values):
        return np.stack([gaussian_filter(values[..., c], 6, mode="reflect") for c in range(3)], -1)

    flat = lab_of(pixels(filters.flatten(linear(photo)))).astype(np.float64)
    apart = blurred(lab - clean), blurred(made - flat)
    before, after = (np.abs(one - one.mean((0, 1))) for one in apart)
    assert after[..., 0].mean() < 0.5 * before[..., 0].mean()
    assert after[..., 2].mean() < 0.5 * before[..., 2].mean()
    detail = [one - blurred(one) for one in (clean, made)]
    assert np.corrcoef(detail[0].ravel(), detail[1].ravel())[0, 1] > 0.97


MILD, STRONG = (0.3, 0.6, 0.7), (0.1, 0.8, 0.95)  # shares of light that a spot absorbs: dirt, red paint
FEW, MANY = ((100, 120),), ((40, 40), (40, 130), (40, 220), (130, 40), (130, 220), (210, 130))


def with_spots(places: tuple[tuple[int, int], ...], absorbed: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Moss, and the same with spots much smaller than the disc: linear RGB."""
    clean = pictures.moss(256, 256, 1) ** 2.2
    y, x = np.mgrid[:256, :256]
    spots = np.max([1 / (1 + np.exp((np.hypot(y - cy, x - cx) - 28) / 2)) for cy, cx in places], 0)
    return clean, clean * (1 - spots[..., None] * absorbed)


@pytest.mark.parametrize(
    ("places", "absorbed", "least", "most"),
    [(FEW, MILD, -0.25, 0.25), (FEW, STRONG, 0.75, 1.25), (MANY, MILD, 0.6, 1.1)],
)
def test_one_small_stain_is_removed_and_objects_stay(places, absorbed, least, most):
    clean, photo = with_spots(places, absorbed)
    (y, x), light = places[0], np.s_[:, :, 0]
    spot = np.s_[y - 15 : y + 15, x - 15 : x + 15]
    images = pixels(filters.flatten(linear(photo))), photo, clean
    made, before, clean = (lab_of(image)[light][spot].mean() for image in images)
    assert least < (made - clean) / (before - clean) < most


def test_the_correction_is_written_out():
    photo = linear(pictures.stained(pictures.bricks(80, 96, 3)) ** 2.2)
    made = filters.flatten(photo, drift=True)
    field = pixels(made["drift"])
    assert made["drift"].spec().channelnames == tuple(f"{k}.{c}" for k in ("gain", "offset") for c in "Lab")
    wanted = lab_of(pixels(photo)) * field[..., :3] + field[..., 3:]
    np.testing.assert_allclose(lab_of(pixels(made["flat"])), wanted, atol=2e-3)


def test_a_tile_of_another_size_and_its_drift_lie_in_one_file(tmp_path):
    save(pictures.stained(pictures.bricks(80, 96, seed=1)), tmp_path / "photo.png")
    run(["photo.png", "--texstationarize:size=64x48:drift=1:iterations=1", "-o", "t.exr"], tmp_path)
    tile, drift = (oiio.ImageBuf(str(tmp_path / "t.exr"), n, 0).spec() for n in (0, 1))
    assert (tile.width, tile.height) == (64, 48) == (drift.full_width, drift.full_height)
    assert (drift.width, drift.height) == (96, 80)  # the photo's


def test_only_pixels_of_the_mask_say_what_the_drift_is():
    photo = pictures.moss(96, 96, 1) ** 2.2
    mask = np.zeros((96, 96, 1), np.float32)
    mask[:, :60] = 1
    other = photo.copy()
    other[:, 60:] = 0.9
    made, again = (
        pixels(filters.flatten(linear(one), radius=20, mask=buffer(mask, space="", names=("Y",))))
        for one in (photo, other)
    )
    np.testing.assert_array_equal(made[:, :60], again[:, :60])


def test_a_gradient_of_light_goes_up_to_the_border():
    rng = np.random.default_rng(0)
    lab_light = np.linspace(30, 70, 256)[None, :, None]
    lab = np.concatenate([lab_light + 5 * rng.standard_normal((128, 256, 1)), np.zeros((128, 256, 2))], -1)
    picture = np.ascontiguousarray(lab, np.float32)
    ColorConfig().from_lab("lin_rec709_scene")(picture)
    made = lab_of(pixels(filters.flatten(linear(picture), radius=48)))[..., 0]
    columns = made.mean(0).reshape(16, 16).mean(1)
    assert np.ptp(columns) < 2.0  # of 40 before; the noise alone has 0.8
    assert made.mean() == pytest.approx(lab[..., 0].mean(), abs=0.3)
    assert made.std() == pytest.approx(5.0, abs=0.3)


def test_the_alpha_of_data_is_no_data():
    """Values far from 0, so that scaling an alpha by their range would leave none at 0."""
    given = 5 + np.random.default_rng(0).random((40, 50, 4)).astype(np.float32)
    given[..., 3] = np.linspace(0.1, 1, 50)
    given[10:30, 20:30] = 0
    made = pixels(filters.flatten(buffer(given, space="", names=tuple("RGBA")), data=True))
    np.testing.assert_array_equal(made[..., 3], given[..., 3])
    assert not made[10:30, 20:30].any()


def test_contrast_is_evened_out_and_bounded():
    rng = np.random.default_rng(0)
    strength = np.where(np.arange(300) < 150, 2.0, 20.0)[None, :]
    gray = 50 + strength * rng.uniform(-1, 1, (200, 300))
    data = buffer(gray[..., None], space="", names=("Y",))
    made = pixels(filters.flatten(data, radius=40, data=True))
    weak, strong = made[:, :90].std(), made[:, 210:].std()
    assert gray[:, 210:].std() / gray[:, :90].std() > 9
    assert strong / weak < 6
    assert weak / gray[:, :90].std() == pytest.approx(2.0, abs=0.1)  # not beyond twice
    kept = pixels(filters.flatten(data, radius=40, data=True, localcontrast=0))
    assert kept[:, :90].std() == pytest.approx(gray[:, :90].std(), rel=0.02)


def test_gray_forgets_the_photos_own_color():
    a, b = (linear(pictures.stained(pictures.moss(96, 96, 1)) * tint) for tint in ([0.5, 1, 1], [1, 0.6, 0.3]))
    means = [lab_of(pixels(filters.flatten(x, tone="gray"))).mean((0, 1)) for x in (a, b)]
    for mean in means:
        np.testing.assert_allclose(mean, [50, 0, 0], atol=1.0)
    kept = lab_of(pixels(filters.flatten(a))).mean((0, 1))
    np.testing.assert_allclose(kept, lab_of(pixels(a)).mean((0, 1)), atol=0.5)


def test_amount_0_changes_no_bit_and_an_endless_radius_hardly_any():
    photo = linear(pictures.stained(pictures.bricks(60, 80, 1)) * 8 - 0.1)
    np.testing.assert_array_equal(pixels(filters.flatten(photo, flattening=0)), pixels(photo))
    np.testing.assert_allclose(pixels(filters.flatten(photo, radius=1e6)), pixels(photo), atol=2e-3)


@pytest.mark.parametrize("tile", ["none", "xy"])
@pytest.mark.parametrize(("size", "radius"), [((1, 1), None), ((1, 40), 1), ((40, 1), 1e4), ((2, 3), None)])
def test_tiny_images(size, radius, tile):
    picture = np.random.default_rng(0).random((*size, 3))
    made = pixels(filters.flatten(linear(picture), radius=radius, tiled=tile))
    assert made.shape == picture.shape and np.isfinite(made).all()
    if size == (1, 1):
        np.testing.assert_allclose(made, picture, atol=1e-2)


def test_any_radius_is_taken():
    assert pixels(filters.flatten(linear(np.full((2, 3, 3), 0.3)), radius=1e6)) == pytest.approx(0.3, abs=1e-2)


def test_an_image_without_alpha_anywhere_stays():
    nothing = np.zeros((20, 30, 4))
    nothing[..., :3] = 0.5
    np.testing.assert_array_equal(pixels(filters.flatten(linear(nothing))), nothing.astype(np.float32))


def test_data_are_flattened_on_their_own_scale():
    field = pictures.stained(pictures.pebbles(70, 90, 2))
    a = pixels(filters.flatten(buffer(field, space=""), data=True))
    b = pixels(filters.flatten(buffer(field * 512 - 64, space=""), data=True))
    np.testing.assert_allclose(b, a * 512 - 64, atol=0.05)
    two = pixels(filters.flatten(buffer(field[..., :2], space="", names=("u", "v")), data=True))
    assert two.shape == (70, 90, 2)


def test_values_beyond_all_light_do_not_break_it():
    """Color over next to no alpha, in a space that takes powers of it; halves stay finite."""
    many = np.concatenate([pictures.bricks(40, 40, 1), np.ones((40, 40, 1))], -1)
    many[3, 4] = [0.9, 0.8, 0.7, 1e-4]
    made = filters.flatten(buffer(many, oiio.HALF, "ACEScct", ("R", "G", "B", "A")))
    assert np.isfinite(pixels(made)).all()


def test_all_that_is_broken_is_counted_before_anything_is_written():
    broken = pictures.bricks(300, 40, 1)
    broken[[3, 150, 299], 5, 0], broken[200, 6, 1] = np.nan, np.inf
    with refused(errors.ImageError, counts=[3, 1]):
        filters.flatten(linear(broken), radius=16)
    with refused(errors.ImageError, counts=[3, 1]):
        filters.flatten(linear(broken), radius=16, data=True)


def test_how_much_drift_there_was_is_logged(caplog):
    with caplog.at_level(logging.INFO, "oiiotex"):
        filters.flatten(linear(pictures.stained(pictures.bricks(64, 64, 1))))
    assert "local levels differ" in caplog.text


# --- textures that tile ---


def wrapping(height: int, width: int) -> np.ndarray:
    """Linear RGB that goes on beyond its borders: detail in a slowly varying light, both of whole turns."""
    y, x = np.mgrid[:height, :width]
    slow = 0.12 * np.sin(2 * np.pi * x / width + 1) + 0.1 * np.cos(2 * np.pi * y / height + 2)
    fine = 0.05 * np.sin(2 * np.pi * (7 * x / width + 3 * y / height)) + 0.05 * np.cos(2 * np.pi * 11 * y / height)
    light = (1 + slow / 0.3)[..., None]
    return (light * np.stack([0.3 + fine, 0.3 - fine, np.full_like(fine, 0.25)], -1)).astype(np.float32)


def steps_across(made: np.ndarray) -> list[float]:
    """How much larger the mean jump of L across each border is than the largest between any two lines inside."""
    light = lab_of(made)[..., 0]
    jumps = [np.abs(light - np.roll(light, 1, axis)).mean(1 - axis) for axis in (0, 1)]
    return [float(jump[0] / jump[1:].max()) for jump in jumps]


@pytest.mark.parametrize("size", [(97, 131), (40, 300)])
def test_what_tiles_goes_on_to_tile(size):
    photo = wrapping(*size)
    y, x = steps_across(pixels(filters.flatten(linear(photo), radius=40, tiled="xy")))
    assert y <= 1.05 and x <= 1.05
    assert max(steps_across(pixels(filters.flatten(linear(photo), radius=40)))) > 1.5
    made = filters.flatten(linear(photo), radius=40, tiled="x")
    y, x = steps_across(pixels(made))
    assert x <= 1.05 < y
    assert made.spec().get_string_attribute("wrapmodes") == "periodic,black"


def test_a_torus_has_no_corner():
    """Turned by whole cells the result is the same, turned; by any number of pixels nearly so."""
    photo = wrapping(96, 120)
    made = pixels(filters.flatten(linear(photo), radius=32, tiled="xy"))
    turned = pixels(filters.flatten(linear(np.roll(photo, (28, 52), (0, 1))), radius=32, tiled="xy"))
    np.testing.assert_allclose(np.roll(turned, (-28, -52), (0, 1)), made, atol=1e-5)
    turned = pixels(filters.flatten(linear(np.roll(photo, (7, 13), (0, 1))), radius=32, tiled="xy"))
    np.testing.assert_allclose(np.roll(turned, (-7, -13), (0, 1)), made, atol=2.5e-2)


def test_bands_and_threads_do_not_show_in_what_tiles(monkeypatch):
    photo = linear(wrapping(97, 61))
    made = pixels(filters.flatten(photo, radius=18, tiled="xy"))
    monkeypatch.setattr("oiiotex.engine.scan.PIECE_PIXELS", 61 * 2)
    again = pixels(filters.flatten(photo, radius=18, tiled="xy", session=Session(threads=1)))
    np.testing.assert_array_equal(made, again)


@pytest.mark.parametrize(("places", "absorbed", "covers"), [(FEW, STRONG, 0), (MANY, STRONG, 1)])
def test_stains_and_few_objects_are_no_source_of_a_tile(places, absorbed, covers):
    photo = with_spots(places, absorbed)[1]
    made = filters.stationarize(linear(photo), iterations=3, st=True)
    y, x = SourceMap.of_coordinates(pixels(made["st"]), linear(photo).spec(), "st").yx
    copied = np.min([np.hypot(y - cy, x - cx) for cy, cx in places], 0) < 22
    assert copied.any() == covers
