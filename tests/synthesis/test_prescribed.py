# SPDX-License-Identifier: Apache-2.0
"""--texstationarize told with what and how finely: weight, sigmamap."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.analysis.stationarity.grid_statistics import CellGrid
from oiiotex.engine import errors
from oiiotex.engine.core.window import Domain
from oiiotex.engine.opencl.buffers import Buffers
from oiiotex.engine.opencl.rows import Rows
from oiiotex.synthesis.patchmatch import constraints
from oiiotex.synthesis.projections import histograms
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.reference.projections import projected_by
from tests.refusals import refused
from tests.synthesis.test_histograms import lab_like

PHOTO = pictures.stained(pictures.pebbles(96, 112, 3))
QUICK = {"iterations": 4, "patch": 7}


def made(**more: object):
    return filters.stationarize(buffer(PHOTO), **{**QUICK, **more})


# --- weight ---


def used(weight: np.ndarray, **more: object) -> float:
    """The share of the result that comes from the photo's left half."""
    st = pixels(made(weightmap=buffer(weight[..., None], names=("Y",)), st=True, **more)["st"])
    return float((st[..., 0] < 0.5).mean())


def test_what_weighs_more_is_used_more_and_what_weighs_nothing_never():
    left = (np.indices((96, 112))[1] < 56).astype(float)
    shares = [used(1.0 + weight * left, equaluse=0.1) for weight in (0.0, 3.0, 15.0)]
    assert shares[0] + 0.1 < shares[1] and shares[1] + 0.05 < shares[2]
    assert used(left) == 1.0 and used(1.0 - left) == 0.0
    assert used(np.full((96, 112), 7.0)) == used(np.full((96, 112), 1.0))  # only beside each other


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "weightmap is 0 everywhere"),
        (-1.0, "10752 negative, NaN or Inf values"),
        (np.nan, "10752 negative, NaN or Inf values"),
    ],
)
def test_weights_that_are_none_are_refused(value, said):
    with pytest.raises(errors.ImageError, match=said):
        used(np.full((96, 112), value))


def test_weights_of_another_size_are_refused():
    with pytest.raises(errors.ImageError, match=r"weightmap .*4x3.* 112x96"):
        used(np.ones((3, 4)))


# --- sigmamap ---


def sigmas(values: np.ndarray) -> oiio.ImageBuf:
    return buffer(values[..., None], space="data", names=("Y",))


def test_one_sigma_everywhere_is_that_sigma():
    same = made(sigmamap=sigmas(np.full((96, 112), 9.0)))
    np.testing.assert_array_equal(pixels(same), pixels(made(sigma=9.0)))


def test_a_map_is_blended_in_the_logarithm_from_octaves(device):
    """Against numpy on projections made one by one."""
    image = lab_like(61, 47)
    low, high = image.reshape(-1, 3).min(0), image.reshape(-1, 3).max(0)
    wanted = np.geomspace(3.0, 17.0, 47)[None, :].repeat(61, 0).astype(np.float32)
    octaves = constraints.sigma_octaves(wanted)
    assert octaves[0] == pytest.approx(3) and octaves[-1] == pytest.approx(17) and len(octaves) == 4
    grids = [CellGrid.of(Domain(47, 61, True, True), sigma) for sigma in octaves]
    layout = {"image": image.nbytes, "matched": image.nbytes} | constraints.VaryingProjection.layout(47, 61)
    for number, grid in enumerate(grids):  # the finest first: the others need less of what they share
        layout = histograms.layout(grid, name=f"grid{number}") | layout
    with Buffers(device, layout, 1 << 30, "test") as buffers:
        stack = [histograms.Projection(device, buffers, g, low, high, f"grid{n}") for n, g in enumerate(grids)]
        each = [projected_by(projection, device, buffers, image).astype(float) for projection in stack]
        places = Rows(device, buffers, "place", 47, 61, False, None, 0)
        device.write(buffers["place"], constraints.VaryingProjection.places_of(wanted, 4))
        varying = constraints.VaryingProjection(device, buffers, stack, 47, places)
        found = projected_by(varying, device, buffers, image)
    place = np.log(wanted / 3.0) / np.log(17 / 3.0) * 3
    lower = np.minimum(place.astype(int), 2)
    share = (place - lower)[..., None]
    y, x = np.indices(lower.shape)
    each = np.stack(each)
    blend = (1 - share) * each[lower, y, x] + share * each[lower + 1, y, x]
    assert np.abs(found - blend).max() <= 0.51 + np.abs(each[1:] - each[:-1]).max() / 512
    # to the bit: shares are whole 256ths, halves go up
    shares = np.stack([np.rint(256 * np.clip(1 - np.abs(place.astype(np.float32) - k), 0, 1)) for k in range(4)])
    total = (shares[..., None] * each).sum(0)
    exact = np.floor(total / shares.sum(0)[..., None] + 0.5)
    assert (found == exact).mean() > 0.999  # but for places that this test takes of a logarithm of its own


def test_where_sigma_is_small_the_result_is_more_even():
    photo = buffer(pictures.stained(pictures.pebbles(128, 192, 3)))
    ramp = np.geomspace(3, 60, 192)[None, :].repeat(128, 0)
    gray = pixels(filters.stationarize(photo, sigmamap=sigmas(ramp), tiles="y", paper=True, patch=7))
    means = gray[..., 1].reshape(8, 16, 12, 16).mean((1, 3))
    assert means[:, :5].std() < 0.8 * means[:, 7:].std()


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "sigmamap has 5 values below 0.5 px [(]minimum 0[)]: expected sigma in pixels"),
        (np.nan, "sigmamap has 5 NaN or Inf values: expected numbers >= 0.5 px"),
    ],
)
def test_sigmas_that_are_none_are_refused(value, said):
    wrong = np.full((96, 112), 8.0)
    wrong[3, 4:9] = value
    with pytest.raises(errors.ImageError, match=said):
        made(sigmamap=sigmas(wrong))


def test_a_map_of_sigmas_must_fit_the_result_and_stand_alone():
    with pytest.raises(errors.ImageError, match=r"sigmamap .*112x96.* 64x50"):
        made(sigmamap=sigmas(np.full((96, 112), 8.0)), size=(64, 50))
    with pytest.raises(errors.ImageError, match=r"sigmamap .*uint8: .*float"):
        made(sigmamap=buffer(np.ones((96, 112, 1)), oiio.UINT8))
    with refused(errors.ParameterError, parameter="sigma", value=8.0, problem="conflicts with sigmamap"):
        made(sigmamap=sigmas(np.full((96, 112), 8.0)), sigma=8.0)
