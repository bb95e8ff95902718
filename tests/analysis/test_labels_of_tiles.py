# SPDX-License-Identifier: Apache-2.0
"""Superpixels and labels of a tile wrap: where it begins does not show, and none ends at its border."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex import filters
from oiiotex.analysis.superpixels.hierarchy import hierarchy
from oiiotex.analysis.superpixels.slic import Slic
from oiiotex.analysis.superpixels.superpixels import Superpixels, superpixels
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.core.image import Image, from_pixels
from oiiotex.engine.core.tiling import tiling_of
from oiiotex.engine.opencl.device import Device
from tests.analysis.test_superpixels import resources_of

HEIGHT, WIDTH, SIGMA = 80, 120, 10.0  # 8 x 12 cells
NOISE = gaussian_filter(np.random.default_rng(2).random((HEIGHT, WIDTH, 3)), (3, 3, 0), mode="wrap")
TILE = np.clip(0.4 + 0.12 * (NOISE - NOISE.mean()) / NOISE.std(), 0.01, 1).astype(np.float32)
HALF = HEIGHT // 2, WIDTH // 2  # a whole number of cells


def image_of(pixels: np.ndarray, modes: str = "periodic,periodic") -> Image:
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, "float")
    spec.attribute("oiio:ColorSpace", "lin_rec709_scene")
    spec.attribute("wrapmodes", modes)
    return Image((from_pixels("tile", np.ascontiguousarray(pixels, np.float32), spec),), "tile")


def found(device: Device, pixels: np.ndarray, modes: str = "periodic,periodic", **settings: object) -> Superpixels:
    resources, image = resources_of(device), image_of(pixels, modes)
    return superpixels(image, lens_of(image, resources), resources, **{"sigma": SIGMA, **settings})


def parts_of(made: Superpixels) -> np.ndarray:
    return made.labels.pixels()[..., 0].astype(np.int64)


def agreement(a: np.ndarray, b: np.ndarray) -> float:
    """Share of pixels in which two partitions agree, under whatever numbers: each part with the one it shares most."""
    pairs, counts = np.unique(np.stack([a.ravel(), b.ravel()]), axis=1, return_counts=True)
    most = [np.zeros(row.max() + 1) for row in pairs]
    for row, largest in zip(pairs, most, strict=True):
        np.maximum.at(largest, row, counts)
    both = (most[0][pairs[0]] == counts) & (most[1][pairs[1]] == counts)
    return float(counts[both].sum() / a.size)


def border_share(parts: np.ndarray, axis: int) -> float:
    """How often regions end at the border, relative to lines inside: 1 is as anywhere, much more is a border."""
    ends = (parts != np.roll(parts, 1, axis)).mean(1 - axis)
    return float(ends[0] / ends[1:].mean())


def test_where_a_tile_begins_does_not_show(any_lanes):
    """All pixels agree but for small pieces, which go to the first of equally good neighbors."""
    for modes, settings in (("periodic,periodic", {"minsize": 0}), ("periodic,periodic", {}), ("black,black", {})):
        made, turned = (
            parts_of(found(any_lanes, pixels, modes, **settings)) for pixels in (TILE, np.roll(TILE, HALF, (0, 1)))
        )
        alike = agreement(np.roll(made, HALF, (0, 1)), turned)
        if "black" in modes:
            assert alike < 0.9
        else:
            assert alike > 0.99 and (not settings or alike == 1)


def test_seeds_on_the_host_are_those_of_the_device(device, monkeypatch):
    there = found(device, TILE)
    monkeypatch.setattr(Slic, "_settled_there", Slic._settled_here)
    here = found(device, TILE)
    np.testing.assert_array_equal(here.labels.pixels(), there.labels.pixels())
    np.testing.assert_array_equal(here.edges, there.edges)


@pytest.mark.parametrize(
    ("modes", "axes"), [("periodic,periodic", "xy"), ("periodic,black", "x"), ("black,periodic", "y")]
)
def test_no_superpixel_ends_at_a_border_that_wraps(device, modes: str, axes: str):
    made = found(device, TILE, modes)
    parts = parts_of(made)
    for axis, name in enumerate("yx"):
        share = border_share(parts, axis)
        assert share < 1.8 if name in axes else share > 2.5, share
    assert tiling_of(made.labels.spec) == axes
    left, right = parts[:, 0], parts[:, -1]
    beside = {tuple(sorted(pair)) for pair in zip(left.tolist(), right.tolist(), strict=True) if pair[0] != pair[1]}
    edges = {(int(a) + 1, int(b) + 1) for a, b in made.edges}
    assert (beside <= edges) == ("x" in axes)


def test_statistics_of_a_tile_are_those_of_its_pixels(device):
    made, parts = found(device, TILE), parts_of(found(device, TILE))
    assert made.sizes.tolist() == np.bincount(parts.ravel())[1:].tolist()
    y, x = np.indices(parts.shape)
    for n, center in enumerate(made.positions, 1):
        for at, size, middle in ((x, WIDTH, center[0]), (y, HEIGHT, center[1])):
            away = (at[parts == n] - middle + size / 2) % size - size / 2
            assert abs(away.mean()) < 1e-6 and np.abs(away).max() < 3 * SIGMA


@pytest.mark.parametrize("count", [1, 2, 3])
def test_tiles_of_few_superpixels(device, count: int):
    made = found(device, TILE[: 80 // count, : 90 // count], sigma=80.0 / count)
    assert made.sizes.sum() == (80 // count) * (90 // count)
    assert np.isfinite(made.positions).all()


def test_coarse_superpixels_of_a_tile_wrap(device):
    parts = []
    for pixels in (TILE, np.roll(TILE, HALF, (0, 1))):
        made = found(device, pixels)
        levels = hierarchy(made, resources_of(device), SIGMA + 6.0 * np.arange(3))
        parts.append(made.runs.relabeled(levels.partition(2)).pixels(0, HEIGHT, 0, WIDTH))
        assert max(border_share(parts[-1], axis) for axis in (0, 1)) < 2.5


def bricks(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A tile of bricks that begins in the middle of bricks, and a mask of its bricks."""
    dice = np.random.default_rng(seed)
    y, x = np.indices((128, 128))
    y, x = (y + 8) % 128, (x + 16) % 128
    row = y // 16
    place = (x + (row % 2) * 16) % 128
    joint = (y % 16 < 3) | (place % 32 < 3)
    light = np.where(joint, 0.7, 0.2 + 0.1 * dice.random((8, 4))[row, place // 32])
    rough = gaussian_filter(dice.standard_normal((128, 128)), 1, mode="wrap")
    return np.clip(light + 0.01 * rough / rough.std(), 0, 1)[..., None] * [1.0, 0.6, 0.5], ~joint


def one_label(parts: np.ndarray, inside: np.ndarray, axis: int, step: int) -> tuple[float, float]:
    """How often both sides of a line through bricks have one label: at the border, and at such lines inside."""
    bricks = inside & np.roll(inside, 1, axis)
    same = (bricks & (parts == np.roll(parts, 1, axis))).sum(1 - axis) / np.maximum(bricks.sum(1 - axis), 1)
    return float(same[0]), float(same[step::step].mean())


def labels_of(pixels: np.ndarray, modes: str, **arguments: object) -> dict[str, oiio.ImageBuf]:
    image = image_of(pixels, modes)
    photo = oiio.ImageBuf(image.first.spec)
    photo.set_pixels(photo.roi, image.first.pixels())
    return filters.label(photo, **arguments)


@pytest.mark.parametrize("turned", [False, True])
def test_half_bricks_at_opposite_borders_have_one_label(turned: bool):
    """Lines across bricks lie 32 px apart along x, or along y if the tile is turned."""
    pixels, inside = (np.swapaxes(each, 0, 1) if turned else each for each in bricks(1))
    axis, name = (0, "y") if turned else (1, "x")
    one_way = "black,periodic" if turned else "periodic,black"
    for modes, axes in (("periodic,periodic", "xy"), (one_way, name), ("black,black", "none")):
        levels = labels_of(pixels, modes).values()
        assert {tiling_of(level.spec()) for level in levels} == {axes}
        labels = [level.get_pixels(oiio.UINT32)[..., 0] for level in levels]
        shares = [one_label(level, inside, axis, 32) for level in labels if level.max() > 1]  # all bricks: one texture
        border, within = np.mean(shares, 0)  # some bricks are as light as their neighbors in any case
        assert within > 0.9 and (border > 0.8 if name in axes else border < 0.5)


def test_superpixels_of_a_tagged_image_wrap():
    image = image_of(TILE)
    tile = oiio.ImageBuf(image.first.spec)
    tile.set_pixels(tile.roi, TILE)
    made = filters.superpixel(tile, sigmamin=SIGMA)
    assert tiling_of(made.spec()) == "xy"
    assert max(border_share(made.get_pixels(oiio.UINT32)[..., 0], axis) for axis in (0, 1)) < 1.8


def subtextures(pixels: np.ndarray, modes: str) -> np.ndarray:
    image = image_of(pixels, modes)
    photo = oiio.ImageBuf(image.first.spec)
    photo.set_pixels(photo.roi, image.first.pixels())
    made = filters.decompose(photo)
    assert (tiling_of(made.spec()) == "xy") == ("periodic" in modes)
    return made.get_pixels(oiio.UINT32)[..., 0]


def test_subtextures_of_a_tile_wrap():
    """Pixels that touch across a border have one label, as inside."""
    dice, (y, x) = np.random.default_rng(1), np.indices((192, 192))
    fine, coarse = (gaussian_filter(dice.standard_normal((192, 192)), sigma, mode="wrap") for sigma in (1, 4))
    disc = np.hypot(np.minimum(y, 192 - y), np.minimum((x + 20) % 192, 172 - x)) < 60  # it crosses the borders
    light = 0.5 + 0.1 * np.where(disc, fine / fine.std(), coarse / coarse.std())
    pixels = np.repeat(np.clip(light, 0, 1)[..., None], 3, -1)

    def steps(labels: np.ndarray) -> float:
        return float(np.mean([*(labels[0] != labels[-1]), *(labels[:, 0] != labels[:, -1])]))

    tile, plain = (subtextures(pixels, modes) for modes in ("periodic,periodic", "black,black"))
    assert tile.max() == 2 and (tile == np.where(disc, tile[0, 0], tile[96, 96])).mean() > 0.98
    assert steps(tile) < 0.01 and steps(plain) > 0.03
