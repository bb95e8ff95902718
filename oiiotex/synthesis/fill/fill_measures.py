# SPDX-License-Identifier: Apache-2.0
"""Measures of a fill: whether its border, its detail and its copies show."""

from __future__ import annotations

from ...engine.core.source_map import NONE, SourceMap
from ...engine.deferred import np
from ..quality.copy_detection import REGION, most_shown

NAMES = "border", "step", "sharp", "shown", "repeat"
NEAR = 12  # px around the region that it is compared with
_LEVEL = 6.0  # px; sigma of local levels
_APART = 8  # px between the border and the lines that its step is compared with
BYTES = 80  # for each pixel of the window
SOURCE_BYTES = 8  # for each pixel of the source, whose uses are counted


def fill_measures(lab: np.ndarray, shown: np.ndarray, known: np.ndarray) -> dict[str, float]:
    """Measures of a fill by its surroundings; none without surroundings.

    Parameters
    ----------
    lab : (height, width, channels) float32
        The filled photo: the region and at least 2 `NEAR` px around it.
    shown, known : (height, width) bool
        Pixels of the fill, and those of the photo.

    Returns
    -------
    dict
        `border`: mean jump of L across the border, relative to jumps within `NEAR` px around it. `step`: mean
        difference of local levels across the border, relative to that across a line around it. `sharp`: mean
        |L - blurred L| inside, relative to that around.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter  # slow to import

    light = lab[..., 0]
    around = known & (distance_transform_edt(~shown) <= NEAR)
    if not around.any() or not shown.any():
        return {}
    jumps, own = [], []
    for axis in (0, 1):
        jump = np.abs(np.diff(light, axis=axis))
        first, last = (slice(None, -1), slice(1, None)) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
        jumps.append(jump[(shown[first] & known[last]) | (known[first] & shown[last])])
        own.append(jump[around[first] & around[last]])
    measures = {"border": _ratio(np.concatenate(jumps), np.concatenate(own))}
    fine = np.abs(light - gaussian_filter(light, 1.0))
    measures["sharp"] = _ratio(fine[shown], fine[around])

    def step(inner: np.ndarray) -> np.ndarray:
        """Differences of the levels on both sides of an area's outline, along it."""
        levels = []
        for side in (inner, (shown | known) & ~inner):
            weight = gaussian_filter(side.astype(np.float32), _LEVEL)
            levels.append(gaussian_filter(light * side, _LEVEL) / np.maximum(weight, 1e-6))
        return np.abs(levels[0] - levels[1])[inner & (distance_transform_edt(inner) <= 1)]

    out = distance_transform_edt(~shown)
    measures["step"] = _ratio(step(shown), step(out <= _APART + 2 * _LEVEL))
    return measures


def repeats(source: SourceMap, shown: np.ndarray, size: tuple[int, int], other: bool) -> dict[str, float]:
    """How often the most used region of `REGION` px is shown, and that divided by the average.

    Parameters
    ----------
    source : SourceMap
        (height, width)
    shown : (height, width) bool
        Pixels of the fill.
    size : (int, int)
        Height and width of the source.
    other : bool
        The source is another photo. Otherwise the photo itself also shows each region once.
    """
    if min(size) < REGION:
        return {}
    packed = np.where(shown, source.packed, source.packed.dtype.type(NONE))
    most = most_shown(SourceMap(packed, source.bits), size)[0] + (not other)
    average = np.count_nonzero(shown) / (size[0] * size[1]) if other else 1.0
    return {"shown": most, "repeat": most / max(1.0, average)}


def _ratio(values: np.ndarray, usual: np.ndarray) -> float:
    return float(values.mean()) / max(float(usual.mean()), 1e-6) if len(values) and len(usual) else 1.0
