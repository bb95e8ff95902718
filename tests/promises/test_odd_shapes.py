# SPDX-License-Identifier: Apache-2.0
"""The work of a filter is bounded by the pixels of its inputs and outputs, whatever the shape: counted, not timed."""

from __future__ import annotations

import os
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from unittest.mock import Mock

import numpy as np
import OpenImageIO as oiio
import pytest

import oiiotex
from oiiotex import filters
from oiiotex.engine.core.op import Op
from oiiotex.engine.errors import Error
from oiiotex.engine.io import disk_cache
from oiiotex.engine.opencl.device import Program
from oiiotex.synthesis.graphcut.placement import Layout, graph_cut
from tests import any_filter
from tests.any_filter import buffer, ids, scramble, settings

SHAPES = ((1, 1), (1, 97), (97, 1), (2, 700), (700, 3))  # height, width
SLOW_SHAPES = ((1, 2), (3, 3), (5, 5), (1, 4096), (4096, 1), (9, 31), (48, 40))
CALLS, CALLS_PER_PIXEL = 60_000, 40  # of Python functions of this package; most are 37,000 for a photo of a pixel
RUNS = {"composite": 4, "sigmas": 9, "zoom": 2}  # label maps that are grown; tiles made; sets of candidates
CELLS, CELLS_PER_PIXEL = 1_000_000, 2_000  # work-items of kernels
OUTPUT, OUTPUT_PER_PIXEL = 4_000_000, 200  # pixels
_HERE = os.path.dirname(oiiotex.__file__)


@contextmanager
def counted(monkeypatch: pytest.MonkeyPatch) -> Iterator[Counter[str]]:
    """Counts calls of functions, in all threads, and work-items of kernels. Nothing comes from the disk cache."""
    counts: Counter[str] = Counter()
    launch = Program.__call__

    def counting(self: Program, name: str, shape: tuple[int, ...], *arguments: object, **options: object) -> None:
        counts["cells"] += int(np.prod(shape))
        launch(self, name, shape, *arguments, **options)

    def look(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(_HERE):
            counts["calls"] += 1
            if counts["calls"] > 20 * CALLS:
                raise AssertionError("no end of calls")

    before = sys.getprofile()
    with monkeypatch.context() as patch:
        patch.setattr(Program, "__call__", counting)
        patch.setattr(disk_cache, "read_arrays", Mock(side_effect=FileNotFoundError))
        threading.setprofile(look)
        sys.setprofile(look)
        try:
            yield counts
        finally:
            sys.setprofile(before)
            threading.setprofile(None)  # type: ignore[arg-type]


def shaped(op: type[Op], height: int, width: int, dice: np.random.Generator) -> tuple[list[oiio.ImageBuf], dict]:
    """Operands of that shape, and parameters."""
    photo = buffer(dice.random((height, width, 3)))
    y, x = np.indices((height, width))
    labels = ids(1 + (x + y) % 3)
    given = settings(op)
    given.pop("corners", None)
    if any_filter.is_view(op):
        return [labels], given
    if op.name in any_filter.LABELED:
        given.pop("size", None)
        return [any_filter.labeled(photo, labels), labels][: len(op.images())], given
    if op.name in any_filter.REGIONS:
        return [photo, ids(x >= width // 2)], given
    if op.name in any_filter.PLATES:
        return [photo, photo], given
    return [photo, *(scramble(40, 48, photo) for _ in op.images()[1:])], given


def require_bounded(op: type[Op], height: int, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    operands, given = shaped(op, height, width, np.random.default_rng(height * 10_000 + width))
    pixels = height * width
    with counted(monkeypatch) as counts:
        try:
            made = getattr(filters, op.name)(*operands, **given)
        except Error as error:  # refused, in one line
            assert str(error).isprintable()
            return
        finally:
            runs = RUNS.get(op.name, 1)
            assert counts["calls"] <= runs * (CALLS + CALLS_PER_PIXEL * pixels), (op.name, height, width, counts)
            assert counts["cells"] <= runs * (CELLS + CELLS_PER_PIXEL * pixels), (op.name, height, width, counts)
    for image in made.values() if isinstance(made, dict) else [made]:
        if isinstance(image, oiio.ImageBuf):
            assert image.spec().image_pixels() <= OUTPUT + OUTPUT_PER_PIXEL * pixels, (op.name, height, width)


@pytest.mark.parametrize("op", filters.FILTERS, ids=lambda op: op.name)
def test_odd_shapes_take_bounded_work(op, monkeypatch):
    for height, width in SHAPES:
        require_bounded(op, height, width, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("op", filters.FILTERS, ids=lambda op: op.name)
def test_more_odd_shapes_take_bounded_work(op, monkeypatch):
    for height, width in SLOW_SHAPES:
        require_bounded(op, height, width, monkeypatch)


# --- channels, types and values ---

ODD = {  # channels, type, values of random ones
    "transparent": (5, oiio.HALF, np.zeros_like),
    "mostly transparent": (7, oiio.UINT8, lambda v: v - 0.7),
    "gray, NaN": (1, oiio.FLOAT, lambda v: np.where(v < 0.3, np.nan, v)),
    "huge": (3, oiio.FLOAT, lambda v: v * 3e38),
    "two channels, negative": (2, oiio.HALF, lambda v: v - 0.7),
    "64 channels": (64, oiio.UINT16, lambda v: v),
}


@pytest.mark.parametrize("name", ODD)
@pytest.mark.parametrize(
    "op",
    [pytest.param(op, marks=() if op.name == "palette" else pytest.mark.slow) for op in filters.FILTERS],
    ids=lambda op: op.name,
)
def test_odd_channels_types_and_values_are_taken_or_refused(op, name, monkeypatch):
    channels, kind, change = ODD[name]

    def odd(values: np.ndarray, *given: object, **more: object) -> oiio.ImageBuf:
        if values.shape[2] != 3:  # a map of coordinates or of ids
            return any_filter.buffer(values, *given, **more)
        dice = np.random.default_rng(values.size)
        return any_filter.buffer(change(dice.random((*values.shape[:2], channels), np.float32)), kind)

    monkeypatch.setitem(globals(), "buffer", odd)
    operands, given = shaped(op, 64, 64, np.random.default_rng(1))
    try:
        getattr(filters, op.name)(*operands, **given)
    except Error as error:
        assert str(error).isprintable() and "internal" not in str(error)


# --- graph cuts ---


@pytest.mark.parametrize("shape", [(1, 1), (1, 60), (60, 1), (2, 3)])
def test_patches_of_a_narrow_photo_are_at_most_three_times_the_sites(shape, monkeypatch):
    """A patch of it covers so few pixels that holes would be closed by thousands of them."""
    laid = []
    canvas = sys.modules[Layout.__module__]._Canvas
    put = canvas._put
    monkeypatch.setattr(canvas, "_put", lambda *given: laid.append(1) or put(*given))
    lab = np.random.default_rng(0).random((*shape, 3), np.float32) * 50
    layout = Layout.tiling(90, 64, "none", patch=16, passes=0, seed=3)
    made = graph_cut(lab, None, layout, 1 << 30, lambda done, total: None)
    y, x = made.yx
    assert len(laid) <= 3 * len(layout.sites())  # two for each hole
    assert (y >= 0).all() and (x >= 0).all() and (y < shape[0]).all() and (x < shape[1]).all()


def test_pixels_that_no_patch_covers_are_usable_ones():
    dice = np.random.default_rng(1)
    allowed = dice.random((40, 50)) < 0.01
    layout = Layout.tiling(200, 150, "xy", patch=16, passes=0, seed=0)
    made = graph_cut(dice.random((40, 50, 3), np.float32), allowed, layout, 1 << 30, lambda done, total: None)
    assert allowed[made.yx].all()


def test_a_preview_of_a_strip_is_at_most_four_times_as_wide_as_high():
    tile = np.random.default_rng(0).random((1, 96, 3))
    made = filters.preview(buffer(tile), panels=["2x2", "plane"], panel=64)
    assert (made.spec().width, made.spec().height) == (4 * 64 + 8 + 96, 64)
    pixels = made.get_pixels(oiio.FLOAT)
    assert pixels[:3, :256].any() and not pixels[4:, :256].any() and pixels[8:, -96:].any()
