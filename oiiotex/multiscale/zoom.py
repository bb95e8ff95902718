# SPDX-License-Identifier: Apache-2.0
"""A look at a plane at any zoom, whole octaves or not: resampled from the two levels around it.

At zoom z a pixel is 2^z times smaller than one of level 0. On whole octaves that is a level as it is; behind them the
coarser level, enlarged, gives way to the finer one, reduced, so that nothing pops where levels change. Half an octave
on the finer one stands alone: a mixture of two is less sharp than either.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from ..color.config import as_float
from ..color.lab import in_type
from ..core.window import Window
from ..deferred import np
from ..session.resources import Resources
from .infinite_plane import Plane, States
from .synthesizer import Synthesizer

_RADIUS = 3  # of the filter, in pixels of the coarser side
_DIGITS = 9  # of a zoom: sums of decimal fractions come out whole where they should


class View(NamedTuple):
    """How a level is seen.

    `left` and `top` are the place of the view's corner on the level, `step` how many of its pixels are one of the view,
    `share` how much of what is seen comes from it.
    """

    level: int
    share: float
    step: float
    left: Fraction
    top: Fraction


def views(zoom: float, at: tuple[Fraction, Fraction], width: int, height: int) -> tuple[View, ...]:
    """The levels that make up a view of width x height pixels around a place.

    Parameters
    ----------
    at : (Fraction, Fraction)
        x and y in pixels of level 0: exact, because a place is aimed at through sixty octaves.
    width, height : int
    """
    zoom = round(zoom, _DIGITS)
    level = math.floor(zoom)
    beyond = min(1.0, 2 * (zoom - level))
    finer = beyond * beyond * (3 - 2 * beyond)  # no edge in time where an octave begins
    shares = {level: 1 - finer, level + 1: finer}
    return tuple(_view(n, zoom, share, at, width, height) for n, share in shares.items() if share > 0)


def _view(
    level: int, zoom: float, share: float, at: tuple[Fraction, Fraction], width: int, height: int
) -> View:  # fmt: skip
    step = 2.0 ** (level - zoom)
    left, top = (
        place * 2**level - Fraction(step) * Fraction(n, 2) for place, n in zip(at, (width, height), strict=True)
    )
    return View(level, share, step, left, top)


class Taps(NamedTuple):
    """For pixels of an axis where their sources begin, counted from a place of the level, and how these are weighed."""

    first: np.ndarray  # (pixels,) int64
    weights: np.ndarray  # (pixels, taps) float32

    @property
    def span(self) -> tuple[int, int]:
        """All sources: from, up to."""
        return int(self.first[0]), int(self.first[-1]) + self.weights.shape[1]


def taps(begin: int, end: int, corner: Fraction, step: float) -> Taps:
    """The sources of pixels begin .. end of a view's axis, counted from the whole pixel at its corner.

    The filter is Lanczos' with three lobes, as wide as a reduction asks for: it leaves whole octaves as they are, and
    takes half as much of the sharpness between them as a cubic does.

    `begin`, `end`: px of the view.
    """
    wide = max(1.0, step)
    at = float(corner - math.floor(corner)) + (np.arange(begin, end) + 0.5) * step
    first = np.ceil(at - _RADIUS * wide - 0.5).astype(np.int64)
    count = math.ceil(2 * _RADIUS * wide) + 1
    away = (first[:, None] + np.arange(count) + 0.5 - at[:, None]) / wide
    weights = np.where(np.abs(away) < _RADIUS, np.sinc(away) * np.sinc(away / _RADIUS), 0.0)
    weights[np.abs(weights) < 1e-12] = 0  # sinc of whole numbers: whole octaves have a single tap
    return Taps(first, (weights / weights.sum(1, keepdims=True)).astype(np.float32))


def filtered(pixels: np.ndarray, rows: Taps, columns: Taps) -> np.ndarray:
    """Pixels of a level, from where the taps' spans begin -> those of the view: (rows, columns, channels) float32.

    Sums run in the order of the taps, so that a pixel has the same bits in any window.
    """
    return _along(_along(pixels, rows).transpose(1, 0, 2), columns).transpose(1, 0, 2)


def _along(pixels: np.ndarray, given: Taps) -> np.ndarray:
    begin = given.first - given.first[0]
    out = np.zeros((len(begin), *pixels.shape[1:]), np.float32)
    for n in range(given.weights.shape[1]):
        out += given.weights[:, n, None, None] * pixels[begin + n]
    return out


@dataclass(frozen=True)
class Layer:
    """A level of a view, whose pixels can be read."""

    view: View
    states: States
    window: Window  # of the level, that the whole view looks at; its corner is at `states.place`'s

    def source(self, rows: Taps, columns: Taps) -> Window:
        """What to read, in the coordinates of `states`."""
        x = self.states.place.left - self.window.left + math.floor(self.view.left)
        y = self.states.place.top - self.window.top + math.floor(self.view.top)
        (left, right), (top, bottom) = columns.span, rows.span
        return Window(left, top, right, bottom).shifted(x, y)


class Zoomed:
    """A view of a plane; any window of it can be had alone.

    Parameters
    ----------
    width, height : int
    """

    def __init__(
        self, resources: Resources, plane: Plane, maker: Synthesizer, seen: tuple[View, ...], width: int, height: int
    ):
        self._plane = plane
        self._layers = tuple(_layer(resources, maker, view, width, height) for view in seen)

    def pixels(self, window: Window) -> np.ndarray:
        """(height, width, channels) of the root's pixel type; the view's corner is at (0, 0)."""
        mixed: np.ndarray | None = None
        for layer, rows, columns in self._taps(window):
            pixels = self._plane.pixels(layer.states.read(layer.source(rows, columns)))
            dtype = pixels.dtype
            seen = filtered(as_float(pixels), rows, columns) * np.float32(layer.view.share)
            mixed = seen if mixed is None else mixed + seen
        assert mixed is not None
        return np.ascontiguousarray(in_type(mixed, dtype))

    def _taps(self, window: Window) -> Iterator[tuple[Layer, Taps, Taps]]:
        for layer in self._layers:
            view = layer.view
            rows = taps(window.top, window.bottom, view.top, view.step)
            yield layer, rows, taps(window.left, window.right, view.left, view.step)


def _layer(resources: Resources, maker: Synthesizer, view: View, width: int, height: int) -> Layer:
    (left, right), (top, bottom) = (
        (math.floor(corner) + taps(0, 1, corner, view.step).span[0],
         math.floor(corner) + taps(n - 1, n, corner, view.step).span[1])
        for corner, n in ((view.left, width), (view.top, height))
    )  # fmt: skip
    window = Window(left, top, right, bottom)
    return Layer(view, States(resources, maker, view.level, window, window), window)
