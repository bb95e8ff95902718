# SPDX-License-Identifier: Apache-2.0
"""Steerable filters (MJH17 eq. 4), and the projection by them (section 4.3)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from oiiotex.analysis.stationarity import steerable
from oiiotex.analysis.stationarity.grid_statistics import CellGrid
from oiiotex.engine.core.window import Domain
from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.synthesis.projections import histograms
from oiiotex.synthesis.projections import steerable as projection
from tests import pictures
from tests.reference import histograms as reference
from tests.reference.projections import projected_by

SCALE = projection._SCALE


def kernels() -> np.ndarray:
    """The third derivative of a Gaussian along four directions, sampled: (4, 13, 13), y down, not normalized."""
    sigma = math.sqrt(3) / (math.pi / 2)
    y, x = np.mgrid[-6:7, -6:7] / sigma
    out = []
    for angle in np.arange(4) * math.pi / 4:
        along = x * math.cos(angle) + y * math.sin(angle)
        out.append((3 * along - along**3) * np.exp(-0.5 * (x**2 + y**2)))
    return np.array(out)


def dense(plane: np.ndarray, modes: tuple[str, str]) -> np.ndarray:
    """Direct sums, normalized as the pyramid is: the sum of |F_o|^2 is 1 where it is largest."""
    spectrum = (np.abs(np.fft.fft2(kernels(), (256, 256))) ** 2).sum(0)
    padded = np.pad(np.pad(plane, ((6, 6), (0, 0)), modes[0]), ((0, 0), (6, 6)), modes[1])
    seen = np.lib.stride_tricks.sliding_window_view(padded, (13, 13))
    return np.einsum("yxij,oij->oyx", seen, kernels()) / math.sqrt(spectrum.max())


@pytest.mark.parametrize("wrap", [(True, True), (False, False), (True, False)])
def test_responses_are_derivatives_along_four_directions(wrap):
    plane = np.random.default_rng(0).random((23, 31)) * 100
    modes = tuple("wrap" if w else "reflect" for w in (wrap[1], wrap[0]))
    np.testing.assert_allclose(steerable.responses(plane, wrap), dense(plane, modes), rtol=1e-3, atol=2e-3)


def test_the_filters_see_all_directions_alike_and_neither_light_nor_a_ramp():
    point = np.zeros((64, 64))
    point[0, 0] = 1
    energy = (np.abs(np.fft.fft2(steerable.responses(point, (True, True)))) ** 2).sum(0)
    assert energy.max() == pytest.approx(1, abs=1e-3)
    assert energy[16, 0] == pytest.approx(energy[0, 16], rel=1e-9)
    assert energy[0, 12] == pytest.approx(0.5 * (energy[8, 9] + energy[9, 8]), rel=0.02)  # 12 is the root of 145
    ramp = np.add.outer(2.0 * np.arange(40), 3.0 * np.arange(40))
    assert np.abs(steerable.responses(ramp)[:, 6:-6, 6:-6]).max() < 1e-2


def test_they_see_what_simoncellis_pyramid_sees():
    pyrtools = pytest.importorskip("pyrtools")
    plane = 100 * pictures.stained(pictures.pebbles(128, 128, 3))[..., 0]
    pyramid = pyrtools.pyramids.SteerablePyramidFreq(plane, height=1, order=3)
    found = steerable.responses(plane, (True, True))
    theirs = np.array([pyramid.pyr_coeffs[0, o].ravel() for o in range(4)])
    both = np.corrcoef(theirs, found.reshape(4, -1))
    assert np.diag(both[:4, 4:]).min() > 0.9  # the same four directions, in the same order
    np.testing.assert_allclose(both[4:, 4:], both[:4, :4], atol=0.1)  # which are as much alike
    np.testing.assert_allclose(found.std((1, 2)), theirs.std(1), rtol=0.15)


# --- projection ---


def lab_like(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.rint(800 * pictures.stained(pictures.bricks(height, width, seed))).astype(np.int16)


def projected(device, image, sigma, wrap=(True, True), strength=1.0, literal=False):
    height, width, channels = image.shape
    grid = CellGrid.of(Domain(width, height, *wrap), sigma)
    seen = image[image[..., 0] != histograms.OUTSIDE]
    low, high = seen.min(0), seen.max(0)
    both = {"image": image.nbytes, "matched": image.nbytes}
    with Buffers(device, {**projection.layout(grid, channels, height), **both}, 1 << 30, "test") as buffers:
        made = projection.SteerableProjection(device, buffers, grid, low, high, literal=literal)
        matched = projected_by(made, device, buffers, image, strength)
        bands = [device.read(buffers[name], image.shape, np.int16) for name in projection._BEFORE]
        return matched, np.array(bands)


def responses_of(bands: np.ndarray) -> np.ndarray:
    return np.sign(bands) * (bands.astype(float) / SCALE) ** 2


@pytest.mark.parametrize("size", [(61, 47), (20, 5)])
@pytest.mark.parametrize("wrap", [(True, True), (False, True)])
def test_bands_are_the_responses(any_lanes, size, wrap):
    image = lab_like(*size)
    _, bands = projected(any_lanes, image, 8.0, wrap)
    wanted = np.stack([steerable.responses(image[..., c], wrap) for c in range(3)], -1)
    np.testing.assert_allclose(responses_of(bands), wanted, atol=0.03)  # the roots are rounded


def oracle(image: np.ndarray, sigma: float, low: np.ndarray, high: np.ndarray, literal: bool = False) -> np.ndarray:
    """Section 4.3 densely: responses and the rest matched at every pixel, and put together again."""
    bands = np.stack([steerable.responses(image[..., c], (True, True)) for c in range(3)], -1)  # (4, h, w, 3)
    largest = np.full(3, SCALE * math.sqrt(projection._LARGEST))

    def back(changes: np.ndarray) -> np.ndarray:
        spread = [steerable.responses(changes[o, ..., c], (True, True))[o] for c in range(3) for o in range(4)]
        return -np.array(spread).reshape(3, 4, *image.shape[:2]).sum(1).transpose(1, 2, 0)

    def matched(plane: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        return reference.project(plane, sigma, low, high, histograms.BINS, True, True)

    roots = [matched(np.sign(b) * np.sqrt(np.abs(b)) * SCALE, -largest, largest) for b in bands]
    rest = image - back(bands)
    changes = responses_of(np.array(roots)) - bands
    if literal:
        return np.clip(image + back(changes), low, high)
    return np.clip(image + projection._GAIN * back(changes) + matched(rest, low, high) - rest, low, high)


@pytest.mark.parametrize("literal", [False, True])
def test_the_projection_is_close_to_the_dense_one(device, literal):
    image = lab_like(48, 60)
    low, high = image.reshape(-1, 3).min(0), image.reshape(-1, 3).max(0)
    dense = oracle(image, 6.0, low, high, literal)
    away = (projected(device, image, 6.0, literal=literal)[0] - dense) / 8.0
    change = np.sqrt(((dense - image) ** 2.0).mean()) / 8.0
    assert np.sqrt((away**2).mean()) < min(0.6, 0.2 * change)
    assert change > (0.5 if literal else 3.0)


def test_lanes_do_not_show(device, narrow_device):
    image = lab_like(53, 67)
    np.testing.assert_array_equal(projected(device, image, 4.0)[0], projected(narrow_device, image, 4.0)[0])


def test_maps_of_a_material_are_projected_apart(device):
    image = lab_like(40, 45)
    more = np.concatenate([image, lab_like(40, 45, 3)[..., :2]], -1)
    found = projected(device, more, 6.0)[0]
    assert found.shape == more.shape
    np.testing.assert_array_equal(found[..., :3], projected(device, image, 6.0)[0])


def test_a_constant_image_stays(device):
    image = np.full((40, 41, 3), 123, np.int16)
    np.testing.assert_array_equal(projected(device, image, 5.0)[0], image)


def test_what_is_outside_is_not_seen(device):
    image, other = lab_like(64, 64), lab_like(64, 64)
    for one, value in ((image, 700), (other, -300)):
        one[20:30, 30:40] = value
    inside = np.ones((64, 64), bool)
    inside[20:30, 30:40] = False
    found = []
    for one in (image, other):
        one[~inside] = histograms.OUTSIDE
        found.append(projected(device, one, 6.0)[0][inside])
    np.testing.assert_array_equal(*found)
    bands = projected(device, image, 6.0)[1]
    assert (bands[:, 14:36, 24:46] == histograms.OUTSIDE).all() and (bands[:, :14] != histograms.OUTSIDE).all()
