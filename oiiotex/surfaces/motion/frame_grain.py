# SPDX-License-Identifier: Apache-2.0
"""The amount of grain in a shot, measured between successive frames.

The difference of a frame from the plate also has detail that the two resolve differently, which looks like grain. It
nearly cancels between successive frames. Grain is that of the camera, the same in the whole shot, and what adds to it
(zooms, focus, moving shadows) differs from frame to frame: so the pairs of frames that match well decide.
"""

from __future__ import annotations

from typing import NamedTuple

from ...engine.core.window import Window
from ...engine.deferred import np
from .frame_motion import FrameMotion
from .light import MEDIAN
from .sampling import REACH, at_points, centers, grown

_AROUND = 64  # px around the region that are compared
_RESAMPLED = 0.85  # variance of grain after it was resampled
_FEWEST = 256  # px
_BEST = 0.25  # quantile of the pairs


class Side(NamedTuple):
    """A frame as its neighbor in time sees it: (h, w, c) float32, (h, w) bool, and its motion."""

    values: np.ndarray
    region: np.ndarray
    motion: FrameMotion


def grain_between(before: Side, frame: Side) -> np.ndarray | None:
    """Standard deviation of a frame's grain in each channel, (c,) float64. None: too few pixels are seen in both."""
    whole = Window(0, 0, frame.region.shape[1], frame.region.shape[0])
    window = whole
    if frame.region.any():
        rows, columns = (np.flatnonzero(frame.region.any(axis)) for axis in (1, 0))
        inner = Window(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
        window = inner.grown(_AROUND, _AROUND) & whole
    at = window.inside(whole)
    points = before.motion.back(frame.motion.onto(centers(window).reshape(-1, 2)))
    points = points.reshape(window.height, window.width, 2)
    hidden = grown(before.region, REACH) | ~np.isfinite(before.values).all(2)
    layers = np.concatenate([np.where(hidden[..., None], 0, before.values), ~hidden[..., None]], 2, dtype=np.float32)
    seen = at_points(layers, points)
    here = (seen[..., -1] > 0.999) & ~frame.region[at] & np.isfinite(frame.values[at]).all(2)
    inside = np.array(before.region.shape[::-1]) - REACH
    here &= ((points >= REACH) & (points <= inside)).all(2)
    if np.count_nonzero(here) < _FEWEST:
        return None
    now, then = frame.values[at][here].astype(np.float64), seen[here][:, :-1].astype(np.float64)
    gain = np.sum(now * then, 0) / np.maximum(np.sum(then**2, 0), 1e-12)
    variance = np.median((now - gain * then) ** 2, 0) / MEDIAN
    return np.sqrt(variance / (1 + _RESAMPLED * gain**2))


def of_shot(grains: list[np.ndarray]) -> np.ndarray | None:
    """The grain of a shot, (c,) float64, from its pairs of frames. Repeated frames, which have none, do not count."""
    found = [grain for grain in grains if grain.all()]
    return np.quantile(found, _BEST, axis=0) if found else None
