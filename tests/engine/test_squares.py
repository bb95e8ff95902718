# SPDX-License-Identifier: Apache-2.0
"""Large images: seeds settle on means of squares, pixels choose among the seeds around them, crumbs join neighbors."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy import ndimage

from oiiotex.analysis.superpixels import squares
from oiiotex.analysis.superpixels.crumbs import without_crumbs
from oiiotex.analysis.superpixels.run_length import OUTSIDE, Strip, pieces_of
from oiiotex.analysis.superpixels.slic import SeedGrid, Slic, candidates, refined_slots
from oiiotex.analysis.superpixels.squares import LabelSquares
from oiiotex.analysis.superpixels.superpixels import superpixels
from oiiotex.engine.color import lab_on_device
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.color.lab_on_device import LabGrid
from oiiotex.engine.core.image import Image, Part
from oiiotex.engine.errors import ImageError
from oiiotex.engine.opencl.device import Device
from tests import pictures
from tests.analysis.test_superpixels import checks, found, grid_values, image_of, resources_of, same, slots_of
from tests.reference import superpixels as reference
from tests.refusals import refused

HEIGHT, WIDTH = 161, 237
PHOTO = pictures.stained(pictures.pebbles(HEIGHT, WIDTH, seed=3))
ALPHA = np.ones((HEIGHT, WIDTH, 1))
ALPHA[40:90, 60:131] = 0
ALPHA[:, 180] = 0
HOLED = np.concatenate([PHOTO * ALPHA, ALPHA], -1)


def means_of(lab: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Of (h, w, 4): sums (down, across, 4), and means by plain integers, halves up; 2 where a square is whole."""
    down, across = -(-lab.shape[0] // side), -(-lab.shape[1] // side)
    padded = np.zeros((down * side, across * side, 4), np.int64)
    padded[: lab.shape[0], : lab.shape[1]] = lab
    sums = padded.reshape(down, side, across, side, 4).sum((1, 3))
    n = np.maximum(sums[..., 3:], 1)
    means = (2 * sums + n) // (2 * n)
    means[..., 3] = np.where(sums[..., 3] == side * side, 2, sums[..., 3] > 0)
    return sums, np.where(sums[..., 3:] > 0, means, 0)


@pytest.mark.parametrize(("pixels", "sigma", "side"), [(PHOTO, 37.0, 2), (HOLED, 70.0, 4), (HOLED, 140.0, 8)])
def test_pixels_choose_among_the_seeds_of_the_squares_around_them(any_lanes, pixels, sigma, side):
    image, resources = image_of(pixels), resources_of(any_lanes)
    lab = grid_values(any_lanes, pixels)
    grid = SeedGrid.of(WIDTH, HEIGHT, sigma, 20.0, side)
    lens = lens_of(image, resources)
    with (
        LabelSquares(WIDTH, HEIGHT, side, resources, True) as squares,
        LabGrid(image, lens, resources, side, look=squares.look) as held,
        Slic(squares, grid.of_squares, resources) as slic,
    ):
        [band] = squares.bands()
        means = any_lanes.read(band.lab, (squares.height, squares.width, 4), np.int16)
        centers = slic.iterate(6)
        made = refined_slots(held, grid, squares, slic, centers, resources)
        slots = np.concatenate([slots_of(any_lanes, held, *given) for given in made])
    sums, plain = means_of(lab, side)
    np.testing.assert_array_equal(squares.reduced.sums, sums)
    np.testing.assert_array_equal(means, plain)

    small, every = grid.of_squares, np.arange(grid.count)
    edges = small.edges(0), small.edges(1)
    np.testing.assert_array_equal(np.minimum(edges[0] * side, HEIGHT), grid.edges(0))
    table = candidates(small, centers, every)
    coarse = reference.choices(plain.astype(np.int16), table, *edges, small.shift)
    rows, columns = small.cells(0)[:, None], small.cells(1)[None]
    around = [np.pad(n, 1, constant_values=-99) for n in (rows + coarse // 3, columns + coarse % 3, coarse)]
    allowed, (y, x) = np.zeros((9, *coarse.shape), bool), np.indices(coarse.shape)
    for v, u in np.ndindex(3, 3):
        dy, dx, slot = (n[v : v + small.height, u : u + small.width] for n in around)
        dy, dx = dy - rows, dx - columns
        near = (slot < 9) & (dy >= 0) & (dy < 3) & (dx >= 0) & (dx < 3)
        allowed[(3 * dy + dx)[near], y[near], x[near]] = True
    allowed = allowed.repeat(side, 1).repeat(side, 2)[:, :HEIGHT, :WIDTH]
    centers = centers * [1, 1, 1, side, side] + [0, 0, 0, (side - 1) / 2, (side - 1) / 2]
    expected = reference.choices(
        lab, candidates(grid, centers, every), grid.edges(0), grid.edges(1), grid.shift, allowed
    )
    assert (allowed.sum(0) == 1).any() and (allowed.sum(0) > 1).any()
    np.testing.assert_array_equal(slots, expected)


def test_devices_without_doubles_settle_on_the_same_seeds(any_lanes, monkeypatch):
    if not any_lanes.info.has_doubles:
        pytest.skip("the device has no doubles to compare with")
    image, resources, grid = image_of(HOLED), resources_of(any_lanes), SeedGrid.of(WIDTH, HEIGHT, 9.0, 20.0)
    jitter = np.random.default_rng(1).uniform(-2, 2, (grid.down, grid.across, 2))
    settled = []
    for doubles in (True, False):
        monkeypatch.setattr(type(any_lanes.info), "has_doubles", doubles)
        with LabGrid(image, lens_of(image, resources), resources) as held, Slic(held, grid, resources) as slic:
            settled.append([slic.iterate(count, moves) for count in (1, 2, 40) for moves in (None, jitter)])
    np.testing.assert_array_equal(settled[0], settled[1])
    assert np.isnan(settled[0][0]).any()


@pytest.mark.parametrize("rows", [4, 24, 90])
def test_bands_and_sums_at_a_time_do_not_show(device, monkeypatch, rows):
    settings = {"sigma": 70.0, "runs": 2}
    whole = found(device, HOLED, **settings)
    monkeypatch.setattr(lab_on_device, "_HOST_BYTES", 0)
    monkeypatch.setattr(lab_on_device, "BAND_BYTES", rows * WIDTH * lab_on_device.PIXEL_BYTES // 2)
    monkeypatch.setattr(squares, "_AT_ONCE", 16 * 60 * 3)
    same(found(device, HOLED, **settings), whole)


def test_lanes_do_not_show(device, narrow_device):
    same(found(device, HOLED, sigma=40.0), found(narrow_device, HOLED, sigma=40.0))


def test_threads_do_not_show(device):
    image = image_of(HOLED)
    made = []
    for threads in (1, 3):
        resources = resources_of(device, threads=threads)
        made.append(superpixels(image, lens_of(image, resources), resources, sigma=40.0))
    same(*made)


def test_where_they_settle_hardly_changes_what_they_are(device):
    squares, pixels = (found(device, PHOTO, sigma=33.0, compactness=20.0, literal=literal) for literal in (False, True))
    assert squares.error() <= 1.02 * pixels.error()
    assert (squares.labels.pixels() != pixels.labels.pixels()).any()
    checks(squares, HEIGHT * WIDTH)
    labels = squares.labels.pixels()[..., 0]
    assert all(ndimage.label(labels == i)[1] == 1 for i in range(1, squares.count + 1))
    assert squares.sizes.min() >= 0.25 * squares.sigma**2


def test_literally_every_iteration_looks_at_all_pixels(device):
    image, resources = image_of(PHOTO), resources_of(device)
    lens, grid = lens_of(image, resources), SeedGrid.of(WIDTH, HEIGHT, 40.0, 20.0)
    with LabGrid(image, lens, resources) as held, Slic(held, grid, resources) as slic:
        slots = np.concatenate([slots_of(device, held, *given) for given in slic.slots(slic.iterate(1000))])
    made = superpixels(image, lens, resources, sigma=40.0, compactness=20.0, literal=True, minsize=1)
    seeds = (grid.cells(0)[:, None] + slots // 3 - 1) * grid.across + grid.cells(1) + slots % 3 - 1
    pieces = pieces_of([Strip.of(seeds.astype(np.int32))], HEIGHT)
    np.testing.assert_array_equal(made.labels.pixels()[..., 0], pieces.runs.pixels(0, HEIGHT, 0, WIDTH) + 1)


def test_powers_are_summed_where_they_are_asked_for(device):
    made = found(device, PHOTO, sigma=40.0, powers=False)
    assert made.power_sums is None
    same(dataclasses.replace(made, power_sums=0), dataclasses.replace(found(device, PHOTO, sigma=40.0), power_sums=0))


@pytest.mark.parametrize("shape", [(16, 16), (1, 300), (257, 1), (64, 65)])
def test_odd_pictures_give_defined_results(device, shape):
    random = np.random.default_rng(0)
    for pixels in (np.full((*shape, 3), 0.3), random.random((*shape, 3))):
        checks(found(device, pixels, sigma=64.0), shape[0] * shape[1])
    empty = found(device, np.zeros((*shape, 4)), sigma=64.0)
    assert (empty.count, empty.labels.pixels().any()) == (0, False)


def test_the_first_look_sees_every_band(device, monkeypatch):
    monkeypatch.setattr(lab_on_device, "_HOST_BYTES", 0)
    monkeypatch.setattr(lab_on_device, "BAND_BYTES", 12 * WIDTH * lab_on_device.PIXEL_BYTES // 2)
    resources, image, seen = resources_of(device), image_of(HOLED), []

    def values(band: lab_on_device.Band) -> tuple[int, int, np.ndarray]:
        return band.top, band.bottom, device.read(band.lab, (band.bottom - band.top, WIDTH, 4), np.int16)

    with LabGrid(image, lens_of(image, resources), resources, 4, look=lambda band: seen.append(values(band))) as lab:
        bands = [values(band) for band in lab.bands()]
    assert [b[:2] for b in bands] == [s[:2] for s in seen] and len(seen) > 3
    for (*_, one), (*_, other) in zip(bands, seen, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(np.concatenate([s[2] for s in seen]), grid_values(device, HOLED))


# --- crumbs ---


def pixels_of(strips: list[Strip]) -> np.ndarray:
    rows = [np.repeat(s.label, np.diff(s.starts, append=s.height * s.width)).reshape(-1, s.width) for s in strips]
    return np.concatenate(rows)


@pytest.mark.parametrize("height", [1, 31, 64, 200])
def test_no_crumb_that_is_less_than_half_a_strip_high_stays(height):
    random = np.random.default_rng(height)
    labels = ndimage.zoom(random.integers(0, 6, (height // 8 + 1, 11)), 8, order=0)[:height].astype(np.int32)
    noisy = np.where(random.random(labels.shape) < 0.3, random.integers(-1, 6, labels.shape), labels).astype(np.int32)
    made = pixels_of(list(without_crumbs([Strip.of(noisy)], height, 12)))
    np.testing.assert_array_equal(made == OUTSIDE, noisy == OUTSIDE)
    for label in range(6):
        pieces, count = ndimage.label(made == label)
        for part in range(1, count + 1):
            inside = pieces == part
            around = ndimage.binary_dilation(inside) & ~inside
            lonely = (made[around] == OUTSIDE).all()
            assert inside.sum() >= 12 or lonely or np.ptp(np.flatnonzero(inside.any(1))) >= 31
    large = [part for label in range(6) for part in parts_of(noisy == label) if part.sum() >= 12]
    assert all(len(set(made[part])) == 1 for part in large)  # which keep their label
    for cuts in ((1, 2, 77), (64,), (5, 32, 96, 160)):
        edges = sorted({0, height, *(c for c in cuts if c < height)})
        strips = [Strip.of(noisy[a:b]) for a, b in itertools.pairwise(edges)]
        np.testing.assert_array_equal(pixels_of(list(without_crumbs(strips, height, 12))), made)


def parts_of(mask: np.ndarray) -> list[np.ndarray]:
    pieces, count = ndimage.label(mask)
    return [pieces == part for part in range(1, count + 1)]


def test_a_crumb_joins_the_large_neighbor_of_the_longest_border():
    labels = np.zeros((6, 9), np.int32)
    labels[:, 5:] = 1
    labels[2:4, 4] = 2
    labels[2:4, 3] = 3
    assert pixels_of(list(without_crumbs([Strip.of(labels)], 6, 10)))[2].tolist() == [0] * 5 + [1] * 4


def test_noise_that_is_refused_by_the_letter_is_cut_into_superpixels(device: Device):
    image = image_of(np.random.default_rng(0).random((300, 400, 3)))
    resources = resources_of(device, budget=12 << 20)
    with refused(ImageError, task="400x300 px divided into that many pieces", budget=12 << 20):
        superpixels(image, lens_of(image, resources), resources, sigma=40.0, literal=True, powers=False)
    made = superpixels(image, lens_of(image, resources), resources, sigma=40.0, powers=False)
    assert made.sizes.sum() == 300 * 400


def test_what_sizes_alone_forbid_is_refused_before_a_pixel_is_read(device):
    resources, spec = resources_of(device, budget=100 << 20), oiio.ImageSpec(60000, 50000, 3, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    image = Image((Part("part0", spec, lambda window: pytest.fail("it was read")),))
    lens = lens_of(image, resources)
    for finest, seeds in ((None, 3000), (40.0, 1875000)):
        with pytest.raises(
            ImageError, match=rf"60000x50000 px divided into {seeds} superpixels needs \d+ MB of memory"
        ):
            given = resources_of(device, budget=10 << 20) if finest is None else resources
            superpixels(image, lens, given, sigma=finest)
