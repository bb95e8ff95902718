# SPDX-License-Identifier: Apache-2.0
"""Lattices: found where they are and not where there are none, closed on tiles, kept by --texstationarize."""

from __future__ import annotations

import logging
import tracemalloc

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.analysis.regularity.autocorrelation import autocorrelation, high_passed, wrapped_autocorrelation
from oiiotex.analysis.regularity.lattice import STRETCHED, Lattice, bytes_needed, find_lattice
from oiiotex.analysis.regularity.offset_prices import InStep
from oiiotex.engine.core.window import Domain
from oiiotex.engine.session import Session
from oiiotex.synthesis.patchmatch.optimization import synthesize
from oiiotex.synthesis.patchmatch.recipe import Recipe
from oiiotex.synthesis.quality.lost_structure import peaks_over_floor
from tests import pictures
from tests.any_filter import buffer
from tests.lattices import VECTORS, regular

LUMA = np.array([0.3, 0.6, 0.1])


def values_of(picture: np.ndarray) -> np.ndarray:
    """On the scale of Lab, in three channels: no color science is needed here."""
    gray = 100 * picture @ LUMA
    return np.stack(
        [gray, 40 * (picture[..., 0] - picture[..., 1]), 40 * (picture[..., 1] - picture[..., 2])], -1
    ).astype(np.float32)


def test_a_period_longer_than_all_offsets_has_no_profile():
    texture = np.random.default_rng(0).normal(size=(20, 20, 1))
    likeness = autocorrelation(texture, np.ones((20, 20), bool))
    assert np.array_equal(likeness.folded(np.array([[1e-3, 0.0]]), 24), np.zeros(24))


def test_autocorrelation_is_the_correlation_of_what_lies_above_each_other():
    random = np.random.default_rng(0)
    texture, usable = random.normal(size=(14, 19, 2)), random.random((14, 19)) < 0.8
    texture *= usable[..., None]
    likeness = autocorrelation(texture, usable)
    reach_x, reach_y = likeness.reach
    for x, y in ((0, 0), (3, 0), (-4, 2), (5, -6), (0, 7)):
        one, other = [], []
        for j in range(14):
            for i in range(19):
                if 0 <= j + y < 14 and 0 <= i + x < 19 and usable[j, i] and usable[j + y, i + x]:
                    one.append(texture[j, i])
                    other.append(texture[j + y, i + x])
        one, other = np.array(one), np.array(other)
        expected = (one * other).sum() / np.sqrt((one**2).sum() * (other**2).sum())
        assert likeness.ncc[y + reach_y, x + reach_x] == pytest.approx(expected, abs=1e-9)
        assert likeness.weight[y + reach_y, x + reach_x] == pytest.approx(len(one))


def test_wrapped_autocorrelation_goes_round():
    texture = np.random.default_rng(1).normal(size=(12, 15, 1))
    likeness = wrapped_autocorrelation(np.roll(texture, (5, 3), (0, 1)))
    np.testing.assert_allclose(likeness.ncc, wrapped_autocorrelation(texture).ncc, atol=1e-9)
    assert likeness.ncc[5, 7] == pytest.approx(1.0)


def test_the_folded_mean_is_that_of_equal_phases():
    texture = high_passed(values_of(regular("stripes", 90, 80, 1)).astype(np.float64), np.ones((90, 80), bool))
    likeness = autocorrelation(texture, np.ones((90, 80), bool))
    frequency = np.array([0.083, 0.021])
    x, y = likeness.offsets()
    far = (likeness.weight > 0) & (x * x + y * y > 0.25 / (frequency @ frequency))
    part = np.rint((x * frequency[0] + y * frequency[1]) * 12).astype(int) % 12
    folded = likeness.folded(frequency[None], 12)
    for k in (0, 3, 6):
        at = far & (part == k) | far & (part == -k % 12)
        assert folded[k] == pytest.approx(np.average(likeness.ncc[at], weights=likeness.weight[at]), abs=1e-3)


@pytest.mark.parametrize("seed", [1])
@pytest.mark.parametrize("name", VECTORS)
def test_the_lattice_of_a_texture_is_found_to_a_fraction_of_a_pixel(name, seed):
    lattice = find_lattice(values_of(regular(name, 224, 256, seed)))
    assert lattice is not None
    assert lattice.rank == len(VECTORS[name])
    steps = np.array(VECTORS[name]) @ lattice.frequencies.T  # whole numbers where it is a vector of the lattice
    np.testing.assert_allclose(steps, np.rint(steps), atol=0.02)
    if lattice.rank == 2:  # and of no coarser one
        assert abs(np.linalg.det(np.rint(steps))) == pytest.approx(1)
    else:
        assert np.abs(np.rint(steps)).max() == 1


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["noise", "blurred", "moss"])
def test_no_lattice_is_found_where_there_is_none(name, seed):
    side = 192
    if name in ("noise", "blurred"):
        plane = pictures.noise(side, side, seed)
        if name == "blurred":
            plane = pictures.smooth_noise(side + 64, side + 64, 5, seed)[seed : seed + side, : side - 7]
            plane = plane + pictures.smooth_noise(side, side - 7, 17, seed, 5)
        picture = np.repeat(plane[..., None] / plane.max(), 3, 2)
    else:
        picture = getattr(pictures, name)(side, side, seed)
    assert find_lattice(values_of(pictures.stained(picture))) is None


def courses_of(*heights: float) -> np.ndarray:
    """A photo of 256 px cut into bands of equal height, whose courses have these heights, px."""
    y, x = np.mgrid[0:256, 0:256]
    height = np.array(heights)[y * len(heights) // 256]
    gray = np.where(y % height < 2, 0.85, 0.45) + 0.15 * (pictures.noise(256, 256, 5) - 0.5)
    return values_of(np.repeat(gray[..., None], 3, 2))


def test_both_halves_of_a_photo_must_show_the_same_lattice():
    assert find_lattice(courses_of(14.2, 14.2)) is not None
    assert find_lattice(courses_of(14.2, 12.9)) is None  # bends
    photo, moss = values_of(regular("square", 192, 256, 1)), values_of(pictures.moss(192, 256, 1))
    assert find_lattice(photo) is not None
    for half in ((slice(96), slice(None)), (slice(None), slice(128, None))):
        mixed = photo.copy()
        mixed[half] = moss[half]
        assert find_lattice(mixed) is None


def test_a_lattice_has_three_periods_at_least():
    side = VECTORS["square"][0][0]
    for periods, found in ((2.8, False), (4.2, True)):
        n = round(periods * side)
        small = regular("square", n, n, 2)
        lattice = find_lattice(values_of(np.repeat(np.repeat(small, 4, 0), 4, 1)))
        assert (lattice is not None) == found


def test_a_flat_or_tiny_or_masked_out_photo_has_none():
    assert find_lattice(np.zeros((64, 64, 3), np.float32)) is None
    assert find_lattice(values_of(regular("square", 12, 12, 1))) is None
    photo = values_of(regular("square", 128, 128, 1))
    assert find_lattice(photo, np.zeros((128, 128), bool)) is None


def test_only_usable_pixels_are_asked():
    photo, usable = values_of(pictures.moss(192, 256, 1)), np.zeros((192, 256), bool)
    usable[:, 96:] = True
    photo[usable] = values_of(regular("square", 192, 256, 1))[usable]
    lattice = find_lattice(photo, usable)
    np.testing.assert_allclose(np.abs(lattice.vectors()), VECTORS["square"], atol=0.15)


def lattice_of(*vectors: tuple[float, float]) -> Lattice:
    return Lattice(np.linalg.pinv(np.array(vectors)).T, 10.0, np.zeros((64,) * len(vectors)))


def test_a_fitting_size_is_the_multiple_with_the_least_rest():
    assert lattice_of((61.3, 0), (0, 50)).fitting(Domain(256, 256, True, True)) == (245, 250)
    assert lattice_of((61.3, 0), (0, 50)).fitting(Domain(256, 256, True, False)) == (245, 256)
    half_offset = lattice_of((27.5, 0), (13.75, 12.6))  # courses in pairs
    width, height = half_offset.fitting(Domain(256, 256, True, True))
    assert (width, height) == (248, 256)
    assert half_offset.strain(Domain(width, height, True, True)) < STRETCHED
    assert lattice_of((0, 14.4)).fitting(Domain(250, 250, True, True)) == (250, 245)


def test_a_side_on_which_no_strain_is_visible_stays():
    almost_a_quarter = lattice_of((255.41, 0.02), (-127.7, 255.51))
    assert almost_a_quarter.fitting(Domain(1024, 1024, True, True)) == (1024, 1024)
    assert lattice_of((0, 38.64)).fitting(Domain(1024, 1024, True, True)) == (1024, 1024)  # 26.5 courses
    assert lattice_of((19.0, 0), (0, 20.0)).fitting(Domain(128, 120, True, True)) == (133, 120)


def test_on_a_torus_every_frequency_is_a_whole_number_of_cycles():
    lattice = lattice_of((22.4, 5.1), (-4.2, 17.8))
    closed = lattice.on_torus(Domain(100, 90, True, True)) * [100, 90]
    np.testing.assert_allclose(closed, np.rint(closed), atol=1e-9)
    np.testing.assert_array_equal(lattice.on_torus(Domain(100, 90, False, False)), lattice.frequencies)


def recipe_of(side: tuple[int, int], **more) -> Recipe:
    return Recipe(
        width=side[0], height=side[1], wrap_x=True, wrap_y=True, sigma=max(side) / 32, patch=9, iterations=12, seed=1,
        uniformity=0.01, contrast=0.7, flat=True, complete=True, **more,
    )  # fmt: skip


@pytest.mark.parametrize("name", ["oblique", "bricks"])
def test_a_tile_is_as_regular_as_its_photo(device, name):
    photo = values_of(regular(name, 144, 144, 3))
    lattice = find_lattice(photo)
    size = lattice.fitting(Domain(144, 144, True, True))
    wanted = lattice.on_torus(Domain(*size, True, True))
    own = peaks_over_floor(photo, lattice, False)

    def kept(in_step: InStep | None) -> float:
        made = synthesize(device, photo, None, recipe_of(size, in_step=in_step), 1 << 30, lambda *_: None)
        tile = made.source.gather(photo)
        closed = Lattice(wanted, lattice.order, lattice.likeness)
        return float((peaks_over_floor(tile, closed, True) / own).min())

    assert kept(InStep(lattice, wanted, 0.5)) >= 0.85
    assert kept(None) < 0.85


def test_structure_changes_nothing_where_there_is_no_lattice():
    photo = buffer(pictures.stained(pictures.moss(64, 72, 4)))
    tiles = [filters.stationarize(photo, seed=2, iterations=4, lattice=s, session=Session()) for s in (0.0, 0.5, 1.0)]
    pixels = [np.asarray(tile.get_pixels(tile.spec().format)) for tile in tiles]
    np.testing.assert_array_equal(pixels[0], pixels[1])
    np.testing.assert_array_equal(pixels[0], pixels[2])


def test_the_size_follows_the_lattice_or_is_warned_of(caplog):
    photo = buffer(regular("square", 128, 128, 1))
    with caplog.at_level(logging.INFO, "oiiotex"):
        tile = filters.stationarize(photo, seed=2, iterations=2, session=Session())
    assert (tile.spec().width, tile.spec().height) == (135, 135)  # 7 periods of 19.3 px
    assert "a lattice of" in caplog.text and "135x135" in caplog.text
    caplog.clear()
    given = filters.stationarize(photo, seed=2, iterations=2, size=(125, 135), session=Session())
    assert given.spec().width == 125
    warning = next(r for r in caplog.records if r.levelno == logging.WARNING)
    assert "125x135 px stretch" in warning.getMessage() and "116x135" in warning.getMessage()
    caplog.clear()
    filters.stationarize(photo, seed=2, iterations=2, size=(116, 135), session=Session())
    assert not [r for r in caplog.records if r.levelno == logging.WARNING]


def test_what_a_look_for_a_lattice_holds_is_what_is_said():
    random = np.random.default_rng(0).random((48, 40, 3)).astype(np.float32)
    photo = np.tile(90 * random, (14, 14, 1))
    usable = np.ones(photo.shape[:2], bool)
    usable[:20, :20] = False  # more than a photo without a mask holds
    find_lattice(photo, usable)  # what is loaded once is loaded
    tracemalloc.start()
    try:
        assert find_lattice(photo, usable) is not None
        held = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert 0.7 * bytes_needed(*photo.shape[:2]) < held <= bytes_needed(*photo.shape[:2])
