# SPDX-License-Identifier: Apache-2.0
"""The one encoding of where pixels come from: there and back, as copies, as coordinates."""

from __future__ import annotations

import tracemalloc

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.demand import bands
from oiiotex.engine.core.image import Image, Part
from oiiotex.engine.core.source_map import SourceMap, require_addressable
from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from oiiotex.filters import op_named
from tests.any_filter import buffer
from tests.parts import coordinates


def spec_of(width: int, height: int, data: tuple[int, int] = (0, 0), display: Window | None = None) -> oiio.ImageSpec:
    spec = oiio.ImageSpec(width, height, 3, oiio.FLOAT)
    spec.x, spec.y = data
    if display is not None:
        spec.full_x, spec.full_y, spec.full_width, spec.full_height = *display[:2], display.width, display.height
    return spec


@pytest.mark.parametrize("bits", [7, 16, 32])
def test_rows_and_columns_come_back(bits):
    random = np.random.default_rng(0)
    y, x = random.integers(0, 1 << min(bits, 31), (2, 9, 11))
    source = SourceMap.of(y, x, bits)
    assert source.packed.dtype == (np.uint32 if bits <= 16 else np.uint64)
    np.testing.assert_array_equal(np.stack(source.yx), (y, x))
    np.testing.assert_array_equal(source[2:5, 3].yx[0], y[2:5, 3])


def test_numbers_of_exemplars_lie_above():
    source = SourceMap(np.array([[3 << 8 | 5 << 4 | 9]], np.uint32), 4)
    assert (source.number, *source.yx) == (3, 5, 9)


@pytest.mark.parametrize("shape", [(), (1,), (4,)])
def test_gathered_are_the_pixels_of_the_exemplar(shape):
    random = np.random.default_rng(1)
    pixels = random.random((13, 17, *shape))
    y, x = random.integers(0, 13, (6, 5)), random.integers(0, 17, (6, 5))
    for exemplar in (pixels, pixels[::-1]):  # whole, and a view
        np.testing.assert_array_equal(SourceMap.of(y, x).gather(exemplar), exemplar[y, x])


@pytest.mark.parametrize(
    "spec",
    [spec_of(17, 13), spec_of(17, 13, (5, -3), Window(0, -8, 40, 30)), spec_of(70000, 3), spec_of(65536, 2)],
    ids=["plain", "windows", "wide", "just"],
)
def test_coordinates_lead_back_to_the_pixels(spec):
    random = np.random.default_rng(2)
    y, x = random.integers(0, spec.height, (8, 9)), random.integers(0, spec.width, (8, 9))
    x[0, :2] = 0, spec.width - 1
    st = SourceMap.of(y, x, 32).coordinates(spec)
    np.testing.assert_array_equal(np.stack(SourceMap.of_coordinates(st, spec, "st.exr").yx), (y, x))


def test_coordinates_of_a_square_that_was_cut_out_of_an_enlarged_image():
    st = SourceMap.of(np.array([[2]]), np.array([[4]])).coordinates(spec_of(100, 50), (6, 8), 2.0)
    np.testing.assert_allclose(st, [[[5.25 / 100, 5.25 / 50]]], rtol=1e-6)  # (4 + 6 + 1/2) / 2, (2 + 8 + 1/2) / 2


def test_an_exemplar_that_32_bits_do_not_address_is_refused():
    require_addressable((65536, 65536))
    wide = buffer(np.random.default_rng(0).random((16, 65600, 3)))
    for op in (filters.quilt, filters.cut, filters.patchmatch):
        with pytest.raises(errors.ImageError, match=r"65600x16.* 65536 px"):
            op(wide, size=(64, 64))


def test_a_wide_image_is_warped():
    wide = np.zeros((2, 70000, 3), np.float32)
    wide[1, 69999] = 1
    st = SourceMap.of(np.array([[1, 0]]), np.array([[69999, 3]]), 32).coordinates(spec_of(70000, 2))
    warped = filters.warp(buffer(wide), buffer(st, names=("R", "G")))
    np.testing.assert_array_equal(warped.get_pixels(oiio.FLOAT)[0, :, 0], [1, 0])


def test_a_warped_image_may_exceed_the_budget():
    """200 MB of coordinates, warped by a map that turns them upside down."""
    side = 5000
    photo = coordinates(side, side)
    upside_down = spec_of(side, side)
    upside_down.nchannels = 2

    def turned(window: Window) -> np.ndarray:
        y, x = np.mgrid[window.top : window.bottom, window.left : window.right]
        return (np.stack([x + 0.5, side - y - 0.5], -1) / side).astype(np.float32)

    session = Session(budget=64 << 20)
    warp = op_named("warp")(source=Image((photo,)), stmap=Image((Part("st", upside_down, turned),)))
    tracemalloc.start()
    (warped,) = warp.make(warp.plan(session.resources), session).values()
    for window in bands(warped):
        y, x = np.mgrid[window.top : window.bottom, window.left : window.right]
        assert np.array_equal(warped.read(window), np.stack([x, side - 1 - y], -1))
    assert tracemalloc.get_traced_memory()[1] < 150 << 20
    tracemalloc.stop()
