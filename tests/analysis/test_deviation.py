# SPDX-License-Identifier: Apache-2.0
"""--texstationarity: against eq. 1 of MJH17 written down densely, and against the cost of a held image."""

from __future__ import annotations

import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.analysis.stationarity import costs as st
from oiiotex.engine import errors
from oiiotex.engine.color.config import ColorConfig
from oiiotex.engine.core.window import Domain
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import data_folder
from tests.reference.histograms import soft_members
from tests.refusals import refused


def lab_of(picture: np.ndarray, space: str = "srgb_rec709_scene") -> np.ndarray:
    lab = np.ascontiguousarray(picture[..., :3], np.float32)
    ColorConfig().to_lab(space)(lab)
    return lab


def cost_of(made: oiio.ImageBuf) -> float:
    return made.spec().get_float_attribute("oiiotex:stationarity")


def dense_deviation(lab: np.ndarray, sigma: float, side: int, seen: np.ndarray) -> tuple[np.ndarray, float]:
    """Eq. 1 at the cells' centers: every pixel weighs in every local histogram; (down, across), and the mean."""
    weights = []
    for size in lab.shape[:2]:
        centers = np.minimum(np.arange(-(-size // side)) * side + (side - 1) / 2, size - 0.5)
        weights.append(np.exp(-0.5 * ((np.arange(size)[None, :] - centers[:, None]) / sigma) ** 2))
    down, right = weights
    share = (down @ seen @ right.T)[None]
    pixels_in = np.add.reduceat(
        np.add.reduceat(seen, np.arange(0, seen.shape[0], side), 0), np.arange(0, seen.shape[1], side), 1
    )
    total = np.zeros(share.shape[1:])
    for c, (low, high) in enumerate(st.RANGES):
        members = soft_members(lab[..., c].astype(np.float64), low, high, st.BINS) * seen
        local = ((down @ members @ right.T) / share).cumsum(0)
        apart = np.abs(local[:, :, :, None, None] - local[:, None, None]).sum(0) * (high - low) / (st.BINS - 1)
        total += (apart * pixels_in).sum((2, 3)) / pixels_in.sum()
    return total, float((total * pixels_in).sum() / pixels_in.sum())


@pytest.mark.parametrize(
    ("height", "width", "sigma", "side", "hole"), [(61, 87, 8.0, 3, True), (90, 45, 20.0, 8, False)]
)
def test_the_map_is_eq_1_place_by_place(height, width, sigma, side, hole):
    picture = pictures.stained(pictures.pebbles(height, width, 2))
    seen = np.ones((height, width))
    seen[10:30, 5 : 5 + 25 * hole] = 0
    made = filters.stationarity(buffer(np.dstack([picture * seen[..., None], seen]), names=tuple("RGBA")), sigma=sigma)
    dense, cost = dense_deviation(lab_of(picture), sigma, side, seen)
    assert cost_of(made) == pytest.approx(cost, rel=0.05)
    found = pixels(made)[side // 2 :: side, side // 2 :: side, 0]
    dense = dense[: found.shape[0], : found.shape[1]]
    assert np.sqrt(((found - dense) ** 2).mean()) < 0.05 * dense.mean()
    assert np.abs(found - dense)[2:-2, 2:-2].max() < 0.12 * dense.mean()


@pytest.mark.parametrize(
    "name", ["stained_plaster_wall.jpg", "roof_slates.jpg", "moss_grass_stones_ground.jpg", "rust_barrel_side.jpg"]
)
@pytest.mark.parametrize("sigma", [24])
def test_its_mean_is_the_cost_of_the_held_image(name, sigma):
    """Eq. 1 over all cells here, over 32 x 32 places there, which begin at the left and top border."""
    photo = oiio.ImageBuf(str(data_folder() / "photos" / name))
    photo = oiio.ImageBufAlgo.cut(photo, oiio.ROI(200, 520, 100, 400))
    wanted = st.stationarity_cost(
        lab_of(photo.get_pixels(oiio.FLOAT)), sigma, Domain(photo.spec().width, photo.spec().height)
    )
    made = filters.stationarity(photo, sigma=sigma)
    assert cost_of(made) == pytest.approx(wanted, rel=0.04)
    assert pixels(made).mean() == pytest.approx(cost_of(made), rel=0.02)


def test_a_constant_image_is_the_same_everywhere_and_a_stain_is_not():
    made = filters.stationarity(buffer(np.full((40, 50, 3), 0.3)))
    assert cost_of(made) == pytest.approx(0, abs=1e-6) and np.abs(pixels(made)).max() < 1e-6
    picture = pictures.bricks(128, 128, 1)
    picture[40:72, 80:112] *= [0.8, 0.5, 0.3]
    found = pixels(filters.stationarity(buffer(picture), sigma=8))[..., 0]
    assert found[48:64, 88:104].min() > 3 * np.median(found)


def test_the_map_is_data_in_floats_over_the_images_windows(caplog):
    spec = oiio.ImageSpec(72, 64, 4, oiio.UINT8)
    spec.x, spec.y, spec.full_width, spec.full_height = 5, -7, 100, 90
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    photo = oiio.ImageBuf(spec)
    photo.set_pixels(photo.roi, np.dstack([pictures.bricks(64, 72, 1), np.ones((64, 72))]).astype(np.float32))
    with caplog.at_level(logging.INFO, "oiiotex"):
        made = filters.stationarity(photo, sigma=6)
    found = made.spec()
    assert (found.nchannels, found.channelnames, found.format, found.alpha_channel) == (1, ("Y",), oiio.FLOAT, -1)
    assert (found.x, found.y, found.full_width, found.full_height) == (5, -7, 100, 90)
    assert found.get_string_attribute("oiio:ColorSpace") == "data"
    assert f"stationarity cost {cost_of(made):.2f} Lab (MJH17 eq. 1) at sigma 6 px" in caplog.text


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1)])
@pytest.mark.parametrize("sigma", [None, 1, 1e6])
def test_tiny_images(size, sigma):
    made = pixels(filters.stationarity(buffer(np.random.default_rng(0).random((*size, 3))), sigma=sigma))
    assert made.shape == (*size, 1) and np.isfinite(made).all()


def test_an_image_without_alpha_anywhere_costs_nothing():
    made = filters.stationarity(buffer(np.zeros((20, 30, 4)), names=tuple("RGBA")))
    assert cost_of(made) == 0 and not pixels(made).any()


def test_all_that_is_broken_is_counted():
    broken = pictures.bricks(300, 40, 1)
    broken[[3, 299], 5, 0] = np.nan
    with refused(errors.ImageError, counts=[2, 0]):
        filters.stationarity(buffer(broken), sigma=8)
