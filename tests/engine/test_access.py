# SPDX-License-Identifier: Apache-2.0
"""The access kinds: what they read for a window, and that windows, threads and pieces do not show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from oiiotex.engine.core.access import Neighborhood, Pointwise
from oiiotex.engine.core.image import Image, Part
from oiiotex.engine.core.op import Kind, Op, Output, Plan, Space
from oiiotex.engine.core.parameters import image, param
from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from tests.conftest import made_by
from tests.parts import counted, part_of


@dataclass(frozen=True, kw_only=True)
class Doubled(Pointwise):
    """Twice the values."""

    name: ClassVar[str] = "doubled"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("out", Kind.PIXELS, "doubled"),)

    source: Image = image(help="the image")

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        return {"out": self.mapped(self.source.first, lambda rows, window: 2 * rows, session)}


@dataclass(frozen=True, kw_only=True)
class BoxMean(Neighborhood):
    """The mean of a square; beyond the image its nearest pixels count."""

    name: ClassVar[str] = "boxmean"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("out", Kind.PIXELS, "means"),)

    source: Image = image(help="the image")
    radius: int = param(1, ge=0, help="of the square")

    def halo(self) -> tuple[int, int]:
        return self.radius, self.radius

    def make(self, plan: Plan, session: Session) -> dict[str, Part]:
        whole = self.source.first.window

        def work(rows: np.ndarray, window: Window) -> np.ndarray:
            wanted = window.grown(*self.halo())
            seen = wanted & whole
            assert rows.shape[:2] == (seen.height, seen.width)
            beyond = ((seen.top - wanted.top, wanted.bottom - seen.bottom),
                      (seen.left - wanted.left, wanted.right - seen.right), (0, 0))  # fmt: skip
            return uniform_mean(np.pad(rows, beyond, "edge"), self.radius)

        return {"out": self.mapped(self.source.first, work, session)}


def uniform_mean(rows: np.ndarray, radius: int) -> np.ndarray:
    """Of whole numbers: sums of them do not hang on their order."""
    side = 2 * radius + 1
    return np.lib.stride_tricks.sliding_window_view(rows, (side, side), (0, 1)).sum((-1, -2)) / np.float32(side**2)


WHOLE = part_of("a", "uint8", 37, 29, 3, x=4, y=-6)
PLAIN = WHOLE.respecced(lambda spec: spec.set_format("float"))


def picture(asked: list[Window]) -> Image:
    pixels = WHOLE.pixels().astype(np.float32)
    part = Part("a", PLAIN.spec, lambda window: pixels[window.inside(WHOLE.window)])
    return Image((counted(part, asked),))


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("radius", [0, 1, 4])
def test_a_neighborhood_is_the_same_in_any_window(radius, threads, monkeypatch):
    monkeypatch.setattr("oiiotex.engine.core.access.PIECE_PIXELS", 29 * 3)
    asked: list[Window] = []
    part = made_by(BoxMean(source=picture(asked), radius=radius), Session(threads=threads))["out"]
    assert asked == []
    expected = uniform_filter(WHOLE.pixels().astype(np.float64), (2 * radius + 1, 2 * radius + 1, 1), mode="nearest")
    whole = part.read(part.window)
    np.testing.assert_allclose(whole, expected, rtol=1e-6, atol=1e-4)
    for window in part.window.cells(11, 9):
        np.testing.assert_array_equal(part.read(window), whole[window.inside(part.window)])


def test_what_is_pointwise_reads_its_window_alone():
    asked: list[Window] = []
    part = made_by(Doubled(source=picture(asked)))["out"]
    window = Window(7, 0, 20, 9)
    pixels = part.read(window)
    assert asked == [window]
    np.testing.assert_array_equal(pixels, 2.0 * WHOLE.pixels()[window.inside(WHOLE.window)])


def test_a_neighborhood_reads_its_halo_and_not_more(monkeypatch):
    """In pieces of full rows that are kept: a halo is computed once."""
    monkeypatch.setattr("oiiotex.engine.core.demand.BAND_BYTES", 2 * 29 * 3 * 4)  # a row at a time
    asked: list[Window] = []
    part = made_by(BoxMean(source=picture(asked), radius=2))["out"]
    part.read(Window(7, 0, 20, 9))
    assert {row for w in asked for row in range(w.top, w.bottom)} == set(range(-2, 11))


def test_what_help_says_follows_from_the_kind():
    from oiiotex.oiiotool.cli.printing.report import _op_page

    for kind in (Doubled, BoxMean):
        assert f"Works in the image's own color space; {kind.reach}." in _op_page(kind)
    assert issubclass(Doubled, Op) and Doubled.reach != BoxMean.reach
