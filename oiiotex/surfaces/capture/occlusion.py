# SPDX-License-Identifier: Apache-2.0
"""Ambient occlusion of a height map, from horizons within a radius."""

from __future__ import annotations

import math

from ...engine.color.config import as_float
from ...engine.color.lens import count_broken
from ...engine.core.attributes import HEIGHT_PX
from ...engine.core.image import Part
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import BrokenValues

SLICES = 8  # half the number of directions
_STEPS = 12  # samples along each direction, denser near the center
_RELIEF = 1 / 32  # of the longer side: height that a value of 1 stands for, unless given


def relief_of(spec: oiio.ImageSpec) -> float:
    """The height, in px, that a value of 1 of a height map stands for: its attribute, else a guess by its size."""
    said = spec.get_float_attribute(HEIGHT_PX, 0.0)  # PNG stores it as a string
    return said if 1e-6 <= said <= 1e6 else max(spec.width, spec.height) * _RELIEF


def heights_around(
    part: Part, window: Window, reach: int, wraps: tuple[bool, bool], channel: int, name: str
) -> np.ndarray:
    """Heights of a window grown by `reach` px, wrapped or clamped at the border."""
    whole, places = part.window, []
    for low, high, begin, size, wrap in zip(window[:2], window[2:], whole[:2], whole.size, wraps, strict=True):
        at = np.arange(low - reach, high + reach) - begin
        places.append(at % size if wrap else np.clip(at, 0, size - 1))
    columns, rows = places
    left, right = whole.left + int(columns.min()), whole.left + int(columns.max()) + 1
    wanted = np.unique(rows)
    runs = np.split(wanted, np.flatnonzero(np.diff(wanted) > 1) + 1)
    bands = [part.read(Window(left, whole.top + int(r[0]), right, whole.top + int(r[-1]) + 1)) for r in runs]
    heights = as_float(np.concatenate(bands)[..., channel])
    broken = count_broken(heights)
    if broken.any():
        raise BrokenValues(name, broken)
    return heights[np.searchsorted(wanted, rows)][:, columns - columns.min()]


def visible_sky(heights: np.ndarray, radius: int) -> np.ndarray:
    """Ambient occlusion: light from a uniform sky that reaches each point, relative to an unoccluded one.

    For each slice through the vertical, the integral of the cosine between two horizons in closed form (Jimenez, Wu,
    Pesce and Jarabo, Practical real-time strategies for accurate indirect occlusion, 2016, eq. 10). No light comes from
    below the surface's tangent plane, nor from below the horizontal plane.

    Parameters
    ----------
    heights : (height + 2 radius, width + 2 radius) float32
        px, with a margin.
    radius : int
        px; surfaces farther away do not occlude.

    Returns
    -------
    (height, width) float32
        0 to 1.
    """
    inner = heights[radius:-radius, radius:-radius]
    size = inner.shape

    def beside(x: int, y: int) -> np.ndarray:
        return heights[radius + y : radius + y + size[0], radius + x : radius + x + size[1]]

    right, down = (beside(1, 0) - beside(-1, 0)) / 2, (beside(0, 1) - beside(0, -1)) / 2
    length = np.sqrt(1 + right**2 + down**2)
    total = np.zeros(size, np.float32)
    for n in range(SLICES):
        angle = math.pi * n / SLICES
        x, y = math.cos(angle), math.sin(angle)
        slope = np.float32(x) * right + np.float32(y) * down  # slope of the surface along the slice
        # the normal projected on the slice leans from the vertical by gamma and has this length
        gamma = -np.arctan(slope)
        share = np.sqrt(1 + slope**2) / length
        for ahead in (1, -1):
            steepest = ahead * slope  # the tangent plane occludes light below it
            np.maximum(steepest, 0, out=steepest)
            for at in _places(ahead * x, ahead * y, radius):
                np.maximum(steepest, (beside(*at) - inner) / np.float32(math.hypot(*at)), out=steepest)
            horizon = np.float32(ahead) * (np.float32(math.pi / 2) - np.arctan(steepest))
            total += share * (np.cos(gamma) + 2 * horizon * np.sin(gamma) - np.cos(2 * horizon - gamma))
    return np.clip(total * np.float32(1 / (4 * SLICES)), 0, 1)


def _places(x: float, y: float, radius: int) -> list[tuple[int, int]]:
    """Integer offsets along a direction, px, without duplicates."""
    away = [radius ** (n / (_STEPS - 1)) for n in range(_STEPS)]
    return list(dict.fromkeys((round(x * r), round(y * r)) for r in away))
