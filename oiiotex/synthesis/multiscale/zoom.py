# SPDX-License-Identifier: Apache-2.0
"""A view of a plane at any zoom, including fractional octaves: resampled from the two levels around it.

At zoom z a pixel is 2^z times smaller than one of level 0. At whole octaves the view is a level. After them the
coarser level, enlarged, fades into the finer one, reduced, to avoid pops at a change of levels. For half an
octave the finer one is shown alone: a blend of two is less sharp than either.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from ...engine.color.config import as_float
from ...engine.color.lens import in_type, resampled
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.session.resources import Resources
from .infinite_plane import Plane, States
from .synthesizer import Synthesizer

_RADIUS = 3  # of the filter, in pixels of the coarser side
_DIGITS = 9  # of a zoom: sums of decimal fractions become integers where they should


class View(NamedTuple):
    """A level as seen in a view.

    `left` and `top`: the view's corner on the level. `step`: pixels of the level per pixel of the view. `share`: weight
    of the level.
    """

    level: int
    share: float
    step: float
    left: Fraction
    top: Fraction


def views(zoom: float, at: tuple[Fraction, Fraction], width: int, height: int) -> tuple[View, ...]:
    """The levels of a view of width x height pixels around a place.

    Parameters
    ----------
    at : (Fraction, Fraction)
        x and y in pixels of level 0: exact, because a place is targeted through sixty octaves.
    width, height : int
    """
    zoom = round(zoom, _DIGITS)
    level = math.floor(zoom)
    beyond = min(1.0, 2 * (zoom - level))
    finer = beyond * beyond * (3 - 2 * beyond)  # smooth in time at the start of an octave
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
    """First source of each pixel of an axis, relative to a place of the level, and the weights of its sources."""

    first: np.ndarray  # (pixels,) int64
    weights: np.ndarray  # (pixels, taps) float32

    @property
    def span(self) -> tuple[int, int]:
        """All sources: (first, end)."""
        return int(self.first[0]), int(self.first[-1]) + self.weights.shape[1]


def taps(begin: int, end: int, corner: Fraction, step: float) -> Taps:
    """The sources of pixels begin .. end of a view's axis, relative to the integer pixel at its corner.

    A Lanczos filter with three lobes, widened for reductions: whole octaves are unchanged, and
    between them it loses half as much sharpness as a cubic filter.

    `begin`, `end`: px of the view.
    """
    wide = max(1.0, step)
    at = float(corner - math.floor(corner)) + (np.arange(begin, end) + 0.5) * step
    first = np.ceil(at - _RADIUS * wide - 0.5).astype(np.int64)
    count = math.ceil(2 * _RADIUS * wide) + 1
    away = (first[:, None] + np.arange(count) + 0.5 - at[:, None]) / wide
    weights = np.where(np.abs(away) < _RADIUS, np.sinc(away) * np.sinc(away / _RADIUS), 0.0)
    weights[np.abs(weights) < 1e-12] = 0  # sinc of integers: whole octaves have a single tap
    return Taps(first, (weights / weights.sum(1, keepdims=True)).astype(np.float32))


def filtered(pixels: np.ndarray, rows: Taps, columns: Taps) -> np.ndarray:
    """Pixels of a level, from the start of the taps' spans -> those of the view: (rows, columns, channels) float32.

    Sums run in the order of the taps, so that a pixel is bit-identical in any window.
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
    """A level of a view, with readable pixels."""

    view: View
    states: States
    window: Window  # of the level, for the whole view; its corner is at `states.place`'s

    def source(self, rows: Taps, columns: Taps) -> Window:
        """The window to read, in the coordinates of `states`."""
        x = self.states.place.left - self.window.left + math.floor(self.view.left)
        y = self.states.place.top - self.window.top + math.floor(self.view.top)
        (left, right), (top, bottom) = columns.span, rows.span
        return Window(left, top, right, bottom).shifted(x, y)


class Zoomed:
    """A view of a plane, with windows that can be read independently.

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
        """(height, width, channels) of the root's pixel type. The view's corner is at (0, 0)."""
        mixed: np.ndarray | None = None
        for layer, rows, columns in self._taps(window):
            pixels = self._plane.pixels(layer.states.read(layer.source(rows, columns)))
            dtype = pixels.dtype
            whole = as_float(pixels)
            with np.errstate(over="ignore", invalid="ignore"):
                seen = resampled(filtered(whole, rows, columns), whole, "the photo") * np.float32(layer.view.share)
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
