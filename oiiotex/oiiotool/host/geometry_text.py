# SPDX-License-Identifier: Apache-2.0
"""oiiotool's notation for sizes, offsets and windows: 640x480, +10-20, 640x480+10-20, 0,0,639,479, 50%, 50%x25%."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ParameterError

_N = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SIGNED = r"[+-](?:\d+\.?\d*|\.\d+)"
_FORMS = {
    "corners": re.compile(rf"({_N}),({_N}),({_N}),({_N})"),
    "window": re.compile(rf"({_N})x({_N})({_SIGNED})({_SIGNED})"),
    "window,": re.compile(rf"({_N})x({_N}),({_N}),({_N})"),
    "size": re.compile(rf"({_N})x({_N})"),
    "percents": re.compile(rf"({_N})%x({_N})%"),
    "offset": re.compile(rf"({_N})({_SIGNED})"),
    "offset,": re.compile(rf"({_N}),({_N})"),
    "percent": re.compile(rf"({_N})%"),
    "factor": re.compile(rf"({_N})"),
}


class Box(NamedTuple):
    """A window in integer or fractional pixels."""

    x: float
    y: float
    width: float
    height: float

    def window(self) -> Window:
        """As integer pixels; raises as `Window.in_range` does."""
        return Window.sized(int(self.x), int(self.y), int(self.width), int(self.height)).in_range()


def box_of(window: Window) -> Box:
    """A window as a Box."""
    return Box(window.left, window.top, window.width, window.height)


def parse_box(text: str, base: Box, *, scaling: bool = False, whole: bool = True) -> Box:
    """The window that a text describes, relative to `base`; raises ParameterError for any other form.

    WxH, WxH+X+Y, X0,Y0,X1,Y1 (both corners included), +X+Y, and with `scaling` P%, P%xQ% or a factor. A width or
    height of 0 follows from the other by the aspect ratio of `base`; missing numbers are taken from `base`. With
    `whole`, sizes are rounded to integers, and the second corner is the last pixel of the window.
    """
    form, numbers = _match(text)
    allowed = (
        form.startswith("offset")
        or form in ("corners", "window", "window,", "size")
        or (scaling and form in ("percents", "percent", "factor"))
    )
    if not allowed or (whole and form not in ("percents", "percent", "factor") and any(n % 1 for n in numbers)):
        forms = "+X+Y, WxH, WxH+X+Y or X0,Y0,X1,Y1" + ", P% or P%xQ%" * scaling
        raise ParameterError(f"'{text}'", expected=forms)
    x, y, width, height = base
    if form == "corners":
        extra = 1 if whole else 0
        x, y = numbers[:2]
        width, height = max(0, numbers[2] - x + extra), max(0, numbers[3] - y + extra)
    elif form in ("window", "window,", "size"):
        width, height = _proportional(numbers[0], numbers[1], base, whole)
        if form != "size":
            x, y = numbers[2:]
    elif form.startswith("offset"):
        x, y = numbers
    else:
        width, height = _scaled(form, numbers, base, whole)
    return Box(x, y, width, height)


def parse_size(text: str) -> tuple[float, float]:
    """'5x3.5' -> (5.0, 3.5); raises ParameterError for something else."""
    form, numbers = _match(text)
    if form != "size":
        raise ParameterError(f"'{text}'", expected="a size WxH")
    return numbers[0], numbers[1]


def parse_offset(text: str) -> tuple[int, int]:
    """'+10-20' or '10,-20' -> (10, -20); raises ParameterError for something else."""
    form, numbers = _match(text)
    if not form.startswith("offset") or any(n % 1 for n in numbers):
        raise ParameterError(f"'{text}'", expected="an offset +X+Y")
    return int(numbers[0]), int(numbers[1])


def _match(text: str) -> tuple[str, list[float]]:
    for form, pattern in _FORMS.items():
        match = pattern.fullmatch(text.strip())
        if match:
            numbers = [float(n) for n in match.groups()]
            if any(abs(n) >= 1 << 31 for n in numbers):
                raise ParameterError(f"'{text}'", expected="numbers below 2147483648")
            return form, numbers
    raise ParameterError(f"'{text}'", expected="WxH, +X+Y, WxH+X+Y or X0,Y0,X1,Y1")


def _proportional(width: float, height: float, base: Box, whole: bool) -> tuple[float, float]:
    if width == 0 and base.height:
        width = _rounded(np.float32(height) * np.float32(base.width) / np.float32(base.height), whole)
    if height == 0 and base.width:
        height = _rounded(np.float32(width) * np.float32(base.height) / np.float32(base.width), whole)
    return width, height


def _scaled(form: str, numbers: list[float], base: Box, whole: bool) -> tuple[float, float]:
    x, y = [
        np.float32(n) if form == "factor" else max(np.float32(0), np.float32(n) * np.float32(0.01))
        for n in (numbers * 2)[:2]
    ]
    x, y = x or y, y or x
    return _rounded(np.float32(base.width) * x, whole), _rounded(np.float32(base.height) * y, whole)


def _rounded(value: np.float32, whole: bool) -> float:
    return math.floor(value + np.float32(0.5)) if whole else float(value)
