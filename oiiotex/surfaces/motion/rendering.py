# SPDX-License-Identifier: Apache-2.0
"""A plate rendered into the region of one frame."""

from __future__ import annotations

import math

from ...engine.core.window import Window
from ...engine.deferred import np
from .clean_plate import MARGIN
from .frame_motion import FrameMotion
from .light import gains, grain
from .sampling import REACH, at_points, centers, grown, reduced

_AROUND = 64  # px around the region in which light and grain are measured, and a quarter of its size
_FILLED = 2 * REACH + 2  # px around the region where the plate may be filled, because filters read the region there
_LEAST = 1e-3  # of the plate in a pixel that counts
_STEEP = 1.15  # plate pixels per pixel of the frame: from here on the plate is reduced first


def rendered(
    frame: np.ndarray, region: np.ndarray, plate: np.ndarray, known: np.ndarray, corner: tuple[int, int],
    motion: FrameMotion, matched: tuple[int, ...], grain_amount: float, number: int,
) -> tuple[Window, np.ndarray, np.ndarray, int]:  # fmt: skip
    """The plate in the region of a frame, with the frame's light and grain.

    Each frame is sampled from the plate once, so the result does not lose sharpness from frame to frame. The plate
    continues up to `MARGIN` px outside the region, where it fades out: its hole is that much larger, and the fill
    matches the surface at the border of the hole only.

    Parameters
    ----------
    frame : (h, w, c) float32
    region : (h, w) float32
        How much of the plate is seen, 0 to 1, with some pixels above 0.
    plate : (rows, columns, c) float32
    known : (rows, columns) bool
        The plate's valid pixels.
    corner : (int, int)
        Position of the plate's top left pixel: x, y.
    motion : FrameMotion
        From the frame to the plate.
    matched : tuple of int
        Channels that get light and grain: colors.
    grain_amount : float
    number : int
        The frame's: each has its own grain, always the same.

    Returns
    -------
    window : Window
        The changed part of the frame, from its top left.
    values : (window.height, window.width, c) float32
    changed : (window.height, window.width) bool
    missing : int
        Pixels of the region that the plate does not cover. They are unchanged.
    """
    whole = Window(0, 0, frame.shape[1], frame.shape[0])
    inner = _bounds(region > 0).grown(MARGIN, MARGIN) & whole
    around = _AROUND + max(inner.size) // 4
    window = inner.grown(around, around) & whole
    at = window.inside(whole)
    points = motion.onto(centers(window).reshape(-1, 2)).reshape(window.height, window.width, 2) - corner
    known = known & np.isfinite(plate).all(2)
    layers = np.concatenate([np.where(known[..., None], plate, 0), known[..., None]], 2, dtype=np.float32)
    seen = _sampled(layers, points)
    covered = np.abs(seen[..., -1] - 1) < 0.01
    fill, values = seen[..., :-1], frame[at]
    fill = np.where(covered[..., None], fill, 0)
    colors = list(matched)
    usable = covered & ~grown(region[at] > 0, _FILLED) & np.isfinite(values).all(2)
    sources = np.where(usable[..., None], values[..., colors], 0)
    fill[..., colors] *= gains(sources, fill[..., colors], usable)
    amount = np.where(covered, _feathered(region[at]), 0)[..., None]
    if grain_amount:
        difference = np.where(usable[..., None], values[..., colors] - fill[..., colors], 0)
        measured = None if motion.grain is None or len(motion.grain) < len(colors) else motion.grain[colors]
        share = np.sqrt((2 - amount) / np.maximum(amount, _LEAST))  # variances of two grains add up to that of one
        fill[..., colors] += grain_amount * share * grain(difference, fill[..., colors], usable, number, measured)
    near = inner.inside(window)
    with np.errstate(invalid="ignore"):  # infinite values of the frame where nothing of it is used
        part = np.where(amount == 1, 0, (1 - amount) * values)
    mixed = np.where(amount == 0, values, part + amount * fill)
    return inner, mixed[near], amount[near][..., 0] > 0, int(np.count_nonzero((region[at] > 0) & ~covered))


def _feathered(region: np.ndarray) -> np.ndarray:
    """A region, 0 to 1, grown by a pixel, and from there falling smoothly to 0 over `MARGIN` px.

    The fill differs from the frame the most next to the region, and hardly 3 px outside, so it fades out late.
    """
    from scipy.ndimage import grey_dilation

    steps = np.arange(-MARGIN, MARGIN + 1)
    fall = np.maximum(np.hypot(steps, steps[:, None]) - 1, 0) / MARGIN
    around = np.clip(grey_dilation(region, structure=-fall, mode="constant", cval=0.0), 0, 1)
    return np.maximum(region, around * around * (3 - 2 * around)).astype(np.float32)


def _bounds(mask: np.ndarray) -> Window:
    """The bounding box of a mask."""
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    return Window(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def _sampled(layers: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The plate at points, reduced first where points are wide apart, so that it does not alias."""
    height, width = layers.shape[:2]
    low = np.floor(points.min((0, 1))).astype(int) - 4 * REACH
    high = np.ceil(points.max((0, 1))).astype(int) + 4 * REACH
    near = Window(int(low[0]), int(low[1]), int(high[0]), int(high[1])) & Window(0, 0, width, height)
    if near.empty:
        return np.zeros((*points.shape[:2], layers.shape[2]), np.float32)
    layers, points = layers[near.inside(Window(0, 0, width, height))], points - (near.left, near.top)
    steps = [
        float(np.median(np.linalg.norm(np.diff(points, axis=axis), axis=2))) if points.shape[axis] > 1 else 1.0
        for axis in (1, 0)
    ]
    if max(steps) > _STEEP:
        factor = math.sqrt(steps[0] * steps[1])
        small = max(1, round(near.width / factor)), max(1, round(near.height / factor))
        layers = reduced(layers, *small)
        points = points * (np.array(small) / near.size)
    return at_points(layers, points)
