# SPDX-License-Identifier: Apache-2.0
"""Light of a photo as a field: pixels are moved to a common light to be compared, and into that of their new place.

A light k times as strong raises Lab's L + 16, and with it a and b, by the cube root of k (CIE 15: the formula above its
linear toe). So one gain for each pixel and an offset for each channel carry the local level of one photo to that of
another, with the contrast that this light would give. Data have no light: their gain is 1.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...analysis.drift.drift_field import MOST_GAIN, Drift, drift_of
from ...analysis.drift.flattening import default_radius
from ...analysis.stationarity.grid_statistics import SplineSurface
from ...engine.color.lab import lens_of
from ...engine.core.demand import MadeRows, SomeRows
from ...engine.core.image import Image, cropped
from ...engine.core.op import Space
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources

_BLACK = 16.0  # L + 16 is proportional to the cube root of light


@dataclass(frozen=True)
class Light:
    """The correction of a photo to a common level: value * gain + offset.

    Attributes
    ----------
    field : SplineSurface
        Gain, then one offset for each of three channels, in image coordinates.
    corner : (int, int)
        The data window's corner (x, y). Windows below begin there.
    """

    field: SplineSurface
    corner: tuple[int, int]

    def at(self, window: Window) -> np.ndarray:
        """Gain and offsets of a window, (height, width, 4) float32."""
        return self.field.values(window.shifted(*self.corner))

    def at_pixels(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Gain and offsets of single pixels, (n, 4) float32."""
        out = np.empty((len(y), 4), np.float32)
        order = np.argsort(y, kind="stable")
        rows, begins = np.unique(y[order], return_index=True)
        for row, here in zip(rows.tolist(), np.split(order, begins[1:]), strict=True):
            left, right = int(x[here].min()), int(x[here].max()) + 1
            line = self.at(Window(left, row, right, row + 1))[0]
            out[here] = line[x[here] - left]
        return out

    def removed_from(self, values: SomeRows, window: Window) -> SomeRows:
        """Values of a window, (height, width, channels) float32, with the first three channels at the common level."""

        def rows(first: int, last: int) -> np.ndarray:
            out = np.array(values[first:last])
            change = self.at(Window(window.left, window.top + first, window.right, window.top + first + len(out)))
            out[..., :3] = out[..., :3] * change[..., :1] + change[..., 1:]
            return out

        if isinstance(values, np.ndarray):
            return rows(0, len(values))
        return MadeRows(values.shape, np.float32, rows)


def drift_within(
    image: Image, window: Window, usable: np.ndarray, space: Space, resources: Resources, progress: Progress
) -> Drift | None:
    """Levels of a window of an image (from the data window's corner) by its usable pixels, (height, width) bool."""
    whole = image.first.window
    part = cropped(image.first, window.shifted(whole.left, whole.top))
    lens = lens_of(image, resources, space)
    return drift_of(Image((part,), image.source), lens, default_radius(window), resources, progress, usable=usable)


def light_of(drift: Drift, target: np.ndarray, amount: float, in_lab: bool, corner: tuple[int, int]) -> Light:
    """The correction of a share `amount` of the local level's distance from `target`, (channels,) float."""
    level = drift.level
    count = min(3, level.shape[-1])
    goal = level + amount * (target - level)
    gain = np.ones(level.shape[:2])
    if in_lab:
        gain = (np.maximum(goal[..., 0], 0.0) + _BLACK) / (np.maximum(level[..., 0], 0.0) + _BLACK)
        gain = np.clip(gain, 1.0 / MOST_GAIN, MOST_GAIN)
    field = np.zeros((*level.shape[:2], 4), np.float32)
    field[..., 0] = gain
    field[..., 1 : 1 + count] = (goal - level * gain[..., None])[..., :count]
    return Light(SplineSurface(field, drift.cells), corner)
