# SPDX-License-Identifier: Apache-2.0
"""Rectangles of pixels are sets of pixels."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
from hypothesis import given, settings
from hypothesis import strategies as st

from oiiotex.engine.core.window import Window

FUZZ = settings(max_examples=200, deadline=None, derandomize=True, database=None)
places, lengths = st.integers(-20, 20), st.integers(0, 12)
windows = st.builds(Window.sized, places, places, lengths, lengths)
filled = st.builds(Window.sized, places, places, st.integers(1, 12), st.integers(1, 12))


def pixels_of(window: Window) -> set[tuple[int, int]]:
    return {(x, y) for y in range(window.top, window.bottom) for x in range(window.left, window.right)}


@FUZZ
@given(a=windows, b=windows)
def test_what_two_share_is_the_pixels_in_both(a, b):
    assert pixels_of(a & b) == pixels_of(a) & pixels_of(b)
    assert (a & b).width >= 0 and (a & b).height >= 0
    assert (a & b).empty == (not pixels_of(a) & pixels_of(b))


@FUZZ
@given(a=filled, b=filled)
def test_the_window_around_two_is_the_smallest_that_holds_both(a, b):
    around = a | b
    assert around == b | a
    assert around & a == a and around & b == b
    xs, ys = zip(*(pixels_of(a) | pixels_of(b)), strict=True)
    assert around == (min(xs), min(ys), max(xs) + 1, max(ys) + 1)


@FUZZ
@given(window=filled, width=st.integers(1, 15), height=st.integers(1, 15), origin=st.none() | st.tuples(places, places))
def test_cells_cover_a_window_once_row_by_row_on_a_grid(window, width, height, origin):
    cells = list(window.cells(width, height, origin))
    covered = [pixel for cell in cells for pixel in pixels_of(cell)]
    assert len(covered) == len(set(covered))
    assert set(covered) == pixels_of(window)
    assert cells == sorted(cells, key=lambda cell: (cell.top, cell.left))
    x, y = origin or (window.left, window.top)
    for cell in cells:
        assert not cell.empty
        assert cell.width <= width and cell.height <= height
        assert cell.left == window.left or (cell.left - x) % width == 0
        assert cell.top == window.top or (cell.top - y) % height == 0


@FUZZ
@given(around=filled, window=filled)
def test_inside_finds_a_window_in_the_array_of_another(around, window):
    window &= around
    if window.empty:
        return
    array = np.array([[(x, y) for x in range(around.left, around.right)] for y in range(around.top, around.bottom)])
    found = array[window.inside(around)]
    assert found.shape == (window.height, window.width, 2)
    assert {tuple(pixel) for pixel in found.reshape(-1, 2).tolist()} == pixels_of(window)


@FUZZ
@given(window=filled, x=places, y=places)
def test_a_shifted_or_grown_window_is_where_it_should_be(window, x, y):
    assert pixels_of(window.shifted(x, y)) == {(a + x, b + y) for a, b in pixels_of(window)}
    grown = window.grown(3, 2)
    assert (grown.width, grown.height) == (window.width + 6, window.height + 4)
    assert grown & window == window
    assert grown.grown(-3, -2) == window
    assert window.grown(4) == window.grown(4, 4)


def test_a_spec_says_its_windows_and_takes_another():
    spec = oiio.ImageSpec(7, 9, 3, oiio.HALF)
    spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height = 3, -5, -1, 2, 50, 40
    spec.tile_width = spec.tile_height = 16
    window = Window.data(spec)
    assert window == (3, -5, 10, 4)
    assert Window.display(spec) == (-1, 2, 49, 42)
    moved = window.shifted(1, 1).apply_to(spec)
    assert Window.data(moved) == (4, -4, 11, 5)
    assert Window.display(moved) == Window.display(spec)
    assert (moved.tile_width, moved.tile_height, spec.tile_width, Window.data(spec)) == (0, 0, 16, window)
    roi = window.roi(3)
    assert (roi.xbegin, roi.xend, roi.ybegin, roi.yend, roi.zbegin, roi.zend) == (3, 10, -5, 4, 0, 1)
    assert (roi.chbegin, roi.chend) == (0, 3)


def test_a_window_is_written_as_a_geometry():
    assert str(Window(3, -5, 10, 4)) == "7x9+3-5"
    assert str(Window(0, 0, 64, 32)) == "64x32+0+0"
