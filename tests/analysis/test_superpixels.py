# SPDX-License-Identifier: Apache-2.0
"""Superpixels against plain numpy and scipy; the same to the bit for any band, budget and register width."""

from __future__ import annotations

import itertools

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy import ndimage

from oiiotex import filters
from oiiotex.analysis.superpixels.slic import SeedGrid, Slic, candidates, centers_of
from oiiotex.analysis.superpixels.superpixels import Superpixels, superpixels
from oiiotex.engine.color import lab_on_device
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.color.lab_on_device import Band, LabGrid
from oiiotex.engine.core.image import Image, from_pixels
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import BrokenValues, ImageError, ParameterError
from oiiotex.engine.opencl.device import Device
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from oiiotex.engine.session.resources import Resources
from tests import pictures
from tests.reference import superpixels as reference
from tests.refusals import refused

PHOTO = pictures.stained(pictures.pebbles(83, 117, seed=3))


def image_of(pixels: np.ndarray, x: int = 0, y: int = 0) -> Image:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.x, spec.y, spec.full_x, spec.full_y = x, y, x, y
    if pixels.shape[2] == 4:
        spec.channelnames = ("R", "G", "B", "A")
        spec.alpha_channel = 3
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    return Image((from_pixels("part0", pixels.astype(np.float32), spec),))


def resources_of(device: Device, **settings: object) -> Resources:
    """Those of a run on that device."""
    resources = Session(**settings).resources
    resources.device = device
    return resources


def found(device: Device, pixels: np.ndarray, x: int = 0, y: int = 0, **settings: object) -> Superpixels:
    resources = resources_of(device)
    image = image_of(pixels, x, y)
    return superpixels(image, lens_of(image, resources), resources, **settings)


def grid_values(device: Device, pixels: np.ndarray) -> np.ndarray:
    """The pixels as kernels see them, by another way."""
    resources = resources_of(device)
    image = image_of(pixels)
    values, opaque = lens_of(image, resources).values(image.first.pixels())
    steps = np.rint(np.clip(values[..., :3], [-16, -150, -150], [284, 150, 150]) * np.float32(8)).astype(np.int16)
    seen = np.ones(steps.shape[:2], bool) if opaque is None else opaque
    return np.concatenate([steps * seen[..., None], seen[..., None]], -1).astype(np.int16)


def slots_of(device: Device, lab: LabGrid, band: Band, buffer: object) -> np.ndarray:
    return device.read(buffer, (band.bottom - band.top, lab.width), np.uint8)


def same(a: Superpixels, b: Superpixels) -> None:
    np.testing.assert_array_equal(a.labels.pixels(), b.labels.pixels())
    for name in ("sizes", "positions", "power_sums", "edges"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_array_equal(a.reduced.sums, b.reduced.sums)


@pytest.mark.parametrize(("sigma", "compactness"), [(4.0, 20.0), (7.3, 20.0), (19.0, 3.0), (40.0, 100.0)])
def test_pixels_choose_the_first_of_the_nearest_seeds(any_lanes, sigma, compactness):
    image, resources = image_of(PHOTO), resources_of(any_lanes)
    lab = grid_values(any_lanes, PHOTO)
    grid = SeedGrid.of(117, 83, sigma, compactness)
    random = np.random.default_rng(1)
    rows, columns = grid.references()
    centers = np.empty((grid.down, grid.across, 5))
    centers[..., :3] = lab[np.ix_(rows, columns)][..., :3]
    centers[..., 3] = columns + random.uniform(-1, 1, (grid.down, grid.across)) * sigma
    centers[..., 4] = rows[:, None] + random.uniform(-1, 1, (grid.down, grid.across)) * sigma
    table = candidates(grid, centers, np.arange(grid.count))
    with LabGrid(image, lens_of(image, resources), resources) as held, Slic(held, grid, resources) as slic:
        slots = np.concatenate([slots_of(any_lanes, held, *given) for given in slic.slots(centers)])
        sums = slic._sums(table, np.ones(grid.count, bool))
    np.testing.assert_array_equal(slots, reference.choices(lab, table, grid.edges(0), grid.edges(1), grid.shift))

    cell_y = np.repeat(np.arange(grid.down), np.diff(grid.edges(0)))[:, None]
    cell_x = np.repeat(np.arange(grid.across), np.diff(grid.edges(1)))[None]
    seed_y, seed_x = cell_y + slots // 3 - 1, cell_x + slots % 3 - 1
    chosen = (seed_y * grid.across + seed_x).ravel()
    y, x = np.mgrid[0:83, 0:117]
    for k, column in enumerate((np.ones_like(x), *np.moveaxis(lab[..., :3], 2, 0), x, y)):
        plain = np.bincount(chosen, column.ravel().astype(float), grid.count)
        np.testing.assert_array_equal(sums[..., k].ravel(), plain)

    # by eq. 1 itself the seed is as near as the rounding of coefficients allows: half a unit for each of five
    squared = reference.distances(lab, centers.reshape(-1, 5), grid.weight)
    mine = np.take_along_axis(squared.reshape(grid.count, -1), chosen[None], 0)[0]
    allowed = (np.abs(seed_y - cell_y) <= 1) & (np.abs(seed_x - cell_x) <= 1)
    assert allowed.all()
    seed_rows, seed_columns = np.divmod(np.arange(grid.count), grid.across)
    near = (np.abs(seed_rows[:, None, None] - cell_y) <= 1) & (np.abs(seed_columns[:, None, None] - cell_x) <= 1)
    best = np.where(near, squared, np.inf).min(0).ravel()
    places = (np.abs(y - rows[cell_y]) + np.abs(x - columns[cell_x])) << grid.shift
    rounding = (np.abs(lab[..., :3].astype(int)).sum(-1) + places + 4) / 4
    assert (mine <= best + rounding.ravel() + 1e-3 * best + 1).all()


def test_iterations_are_those_of_plain_numpy(any_lanes):
    image, resources = image_of(PHOTO), resources_of(any_lanes)
    lab = grid_values(any_lanes, PHOTO)
    grid = SeedGrid.of(117, 83, 9.0, 20.0)
    with LabGrid(image, lens_of(image, resources), resources) as held, Slic(held, grid, resources) as slic:
        last = candidates(grid, slic.iterate(12), np.arange(grid.count))
    y, x = np.mgrid[0:83, 0:117]
    columns = (np.ones_like(x), *np.moveaxis(lab[..., :3], 2, 0), x, y)
    cell_y = np.repeat(np.arange(grid.down), np.diff(grid.edges(0)))[:, None]
    cell_x = np.repeat(np.arange(grid.across), np.diff(grid.edges(1)))[None]
    slots = np.full((83, 117), 4)
    centers = np.full((grid.down, grid.across, 5), np.nan)
    for _ in range(12):
        seeds = ((cell_y + slots // 3 - 1) * grid.across + cell_x + slots % 3 - 1).ravel()
        sums = np.stack([np.bincount(seeds, c.ravel().astype(float), grid.count) for c in columns], -1)
        means = centers_of(sums.reshape(grid.down, grid.across, 6), centers)
        away = ((means - centers) ** 2 * [1, 1, 1, grid.weight, grid.weight]).sum(-1)
        moves = ~(away <= (0.2 * 8) ** 2)
        centers = np.where(moves[..., None], means, centers)
        table = candidates(grid, centers, np.arange(grid.count))
        slots = reference.choices(lab, table, grid.edges(0), grid.edges(1), grid.shift)
    np.testing.assert_array_equal(last, table)


def test_superpixels_are_connected_and_their_statistics_are_those_of_their_pixels(any_lanes):
    made = found(any_lanes, PHOTO, 5, -7, sigma=8.0)
    assert made.window == Window(5, -7, 122, 76)
    labels = made.labels.pixels()[..., 0].astype(int)
    assert (made.labels.spec.format, made.labels.window) == (oiio.UINT32, made.window)
    ids, first = np.unique(labels, return_index=True)
    np.testing.assert_array_equal(ids, np.arange(1, made.count + 1))
    assert (np.diff(first) > 0).all()  # numbered by their first pixel
    assert all(ndimage.label(labels == i)[1] == 1 for i in ids)
    assert made.sizes.min() >= 0.25 * made.sigma**2

    lab = grid_values(any_lanes, PHOTO)[..., :3].reshape(-1, 3) / 8.0
    y, x = np.mgrid[0:83, 0:117]
    flat = labels.ravel() - 1
    np.testing.assert_array_equal(made.sizes, np.bincount(flat))
    np.testing.assert_allclose(made.positions[:, 0], np.bincount(flat, x.ravel()) / made.sizes, rtol=1e-12)
    np.testing.assert_allclose(made.positions[:, 1], np.bincount(flat, y.ravel()) / made.sizes, rtol=1e-12)
    for c in range(3):
        for k in range(5):
            plain = np.bincount(flat, lab[:, c] ** (k + 1))
            np.testing.assert_allclose(made.power_sums[:, c, k], plain, rtol=1e-12, atol=1e-6)
    pairs = {
        (min(p, q) - 1, max(p, q) - 1)
        for one, other in ((labels[:, 1:], labels[:, :-1]), (labels[1:], labels[:-1]))
        for p, q in zip(one.ravel().tolist(), other.ravel().tolist(), strict=True)
        if p != q
    }
    assert sorted(pairs) == [tuple(e) for e in made.edges.tolist()]
    means = made.power_sums[..., 0] / made.sizes[:, None]
    place = (x.ravel() - made.positions[flat, 0]) ** 2 + (y.ravel() - made.positions[flat, 1]) ** 2
    eq3 = ((lab - means[flat]) ** 2).sum() + (made.compactness / made.sigma) ** 2 * place.sum()
    assert made.error() == pytest.approx(eq3, rel=1e-9)


@pytest.mark.parametrize("contrast", [0.05, 0.2, 1.0])
def test_superpixels_are_as_compact_as_the_photo_has_contrast(any_lanes, contrast):
    """By the median of exact deviations, whatever the lanes; a line that spells it out gives the same superpixels."""
    photo = 0.25 + contrast * (PHOTO - 0.25)
    made, lab = found(any_lanes, photo, sigma=8.0), grid_values(any_lanes, photo)[..., :3] / 8.0
    grid = SeedGrid.of(117, 83, 8.0, 20.0)
    cells = [
        lab[top:bottom, left:right].reshape(-1, 3)
        for top, bottom in itertools.pairwise(grid.edges(0))
        for left, right in itertools.pairwise(grid.edges(1))
    ]
    median = np.median([np.sqrt(cell.var(0).sum()) for cell in cells])
    assert made.compactness == min(max(round(2.5 * median) / 2.0, 2.0), 20.0)
    spelled_out = found(any_lanes, photo, sigma=8.0, compactness=made.compactness)
    np.testing.assert_array_equal(made.runs.label, spelled_out.runs.label)


def test_paper_is_lsa16_section_3(device):
    op = filters.op_named("superpixel")(source=image_of(PHOTO), paper=True, sigmamin=8)
    resources = Session().resources
    made = superpixels(
        op.source,
        lens_of(op.source, resources),
        resources,
        sigma=8.0,
        compactness=20.0,
        runs=10,
        minsize=25,
        literal=True,
    )
    ids = run(op, Session())[0].image.first.pixels()
    np.testing.assert_array_equal(ids, made.labels.pixels())
    with refused(ParameterError, parameter="compactness", value=5.0, problem="conflicts with paper=1"):
        filters.op_named("superpixel")(source=op.source, paper=True, compactness=5.0)


def test_powers_of_hdr_are_exact(any_lanes):
    made = found(any_lanes, np.full((200, 150, 3), 1e4), sigma=300.0)  # L is cut to 284
    assert made.sizes.tolist() == [30000]
    np.testing.assert_array_equal(made.power_sums[0, 0], 30000.0 * 284.0 ** np.arange(1, 6))


def test_any_window_of_the_labels_is_the_whole_cropped(device):
    made = found(device, PHOTO, -3, 4, sigma=8.0)
    whole = made.labels.pixels()
    random = np.random.default_rng(0)
    for _ in range(20):
        x, y = np.sort(random.integers(0, (117, 83), (2, 2)), 0).T
        window = Window(int(x[0]) - 3, int(y[0]) + 4, int(x[1]) - 2, int(y[1]) + 5)
        np.testing.assert_array_equal(made.labels.read(window), whole[window.inside(made.window)])


@pytest.mark.parametrize("rows", [5, 16, 40])
def test_bands_do_not_show(device, monkeypatch, rows):
    settings = {"sigma": 8.0, "runs": 2}
    whole = found(device, PHOTO, **settings)
    monkeypatch.setattr(lab_on_device, "_HOST_BYTES", 0)
    monkeypatch.setattr(lab_on_device, "BAND_BYTES", rows * 117 * lab_on_device.PIXEL_BYTES // 2)
    resources, image = resources_of(device), image_of(PHOTO)
    lens = lens_of(image, resources)
    with LabGrid(image, lens, resources) as lab:
        assert (lab.resident, lab.band_rows) == (False, rows)
    same(superpixels(image, lens, resources, **settings), whole)


def test_lanes_do_not_show(device, narrow_device):
    same(found(device, PHOTO, sigma=8.0), found(narrow_device, PHOTO, sigma=8.0))


def test_windows_off_the_origin_give_the_same_superpixels(device):
    same(found(device, PHOTO, sigma=8.0), found(device, PHOTO, -100, 31, sigma=8.0))


def test_the_best_of_several_runs_is_the_one_of_least_error(device):
    one, ten = found(device, PHOTO, sigma=8.0), found(device, PHOTO, sigma=8.0, runs=10)
    assert ten.error() <= one.error()
    same(ten, found(device, PHOTO, sigma=8.0, runs=10))
    assert len({found(device, PHOTO, sigma=8.0, runs=5, seed=s).error() for s in range(4)}) > 1


def test_transparent_pixels_belong_to_none(any_lanes):
    alpha = np.ones((83, 117, 1))
    alpha[20:50, 30:70] = 0
    alpha[:, 90] = 0
    holed = np.concatenate([PHOTO * alpha, alpha], -1)
    made = found(any_lanes, holed, sigma=8.0)
    labels = made.labels.pixels()[..., 0]
    np.testing.assert_array_equal(labels == 0, alpha[..., 0] == 0)
    assert made.sizes.sum() == alpha.sum()
    sides = np.sign(made.positions[:, 0] - 90)
    assert (sides[made.edges[:, 0]] == sides[made.edges[:, 1]]).all()  # nothing reaches across the gap
    other = np.where(alpha > 0, holed, [9.0, -3.0, 0.5, 0.0])  # what lies under alpha 0 does not matter
    same(made, found(any_lanes, other, sigma=8.0))


def checks(made: Superpixels, pixels: int) -> None:
    assert made.sizes.sum() == pixels
    assert (made.sizes > 0).all()
    assert np.isfinite(made.power_sums).all() and np.isfinite(made.positions).all()
    np.testing.assert_array_equal(np.unique(made.labels.pixels()), np.arange(1, made.count + 1))


@pytest.mark.parametrize("shape", [(16, 16), (1, 1), (1, 300), (257, 1), (5, 3), (64, 65)])
@pytest.mark.parametrize("kind", ["constant", "two colors", "noise", "black"])
def test_odd_pictures_give_defined_results(device, shape, kind):
    random = np.random.default_rng(0)
    pixels = {
        "constant": np.full((*shape, 3), 0.3),
        "two colors": np.where(np.arange(shape[1])[None, :, None] % 7 < 3, 0.1, 0.9) * np.ones((*shape, 3)),
        "noise": random.random((*shape, 3)),
        "black": np.zeros((*shape, 3)),
    }[kind]
    checks(found(device, pixels), shape[0] * shape[1])
    checks(found(device, pixels, sigma=1000.0), shape[0] * shape[1])
    checks(found(device, pixels, sigma=2.0, minsize=25), shape[0] * shape[1])


def test_a_constant_picture_is_a_grid(device):
    made = found(device, np.full((60, 80, 3), 0.5), sigma=10.0)
    assert made.count == 48
    assert (made.sizes == 100).all()


def test_a_picture_of_nothing_has_no_superpixels(device):
    made = found(device, np.zeros((20, 30, 4)))
    assert (made.count, made.edges.shape, made.power_sums.shape) == (0, (0, 2), (0, 3, 5))
    assert not made.labels.pixels().any()


def test_noise_that_does_not_fit_is_refused_with_a_figure(device):
    resources, image = resources_of(device, budget=8 << 20), image_of(np.random.default_rng(0).random((300, 400, 3)))
    with refused(ImageError, task="400x300 px divided into that many pieces", budget=8 << 20):
        superpixels(image, lens_of(image, resources), resources)


@pytest.mark.parametrize(("value", "counts"), [(np.nan, [2, 0]), (np.inf, [0, 2])])
def test_broken_values_are_counted(device, value, counts):
    broken = PHOTO.copy()
    broken[3, 4, 0] = broken[80, 6, 2] = value
    with pytest.raises(BrokenValues) as caught:
        found(device, broken)
    assert caught.value.counts.tolist() == counts
