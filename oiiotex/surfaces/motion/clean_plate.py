# SPDX-License-Identifier: Apache-2.0
"""A clean plate: the surface that an object hides, as far as the frames of a shot show it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError
from .frame_grain import Side, grain_between, of_shot
from .frame_motion import NO_SURFACE, FrameMotion, Shot
from .sampling import REACH, at_points, centers, grown

MOST_SCALE = 4.0  # plate pixels per pixel of the reference frame
_MOST_SIDE = 1 << 15  # px
MARGIN = REACH + 1  # px of a frame around its region that are rendered, as the plate fades out there
_EVERY = 8  # px between points that decide on size and scale
_SHARP = 4  # power of a frame's resolution in its weight: the sharpest frame decides
_WHOLE = 1e-3  # a filter weight farther from 1 includes pixels of the region or outside the frame


@dataclass(frozen=True)
class PlateLayout:
    """The plate's pixels.

    Attributes
    ----------
    shot : Shot
        From frames to the plate's pixels. Its top left pixel is at 0,0, so that files without a window can hold it.
    size : (int, int)
        Width and height of the plate.
    scale : float
        Plate pixels per pixel of the reference frame.
    """

    shot: Shot
    size: tuple[int, int]
    scale: float


def laid_out(shot: Shot, regions: dict[int, np.ndarray], size: tuple[int, int], given: int) -> PlateLayout:
    """The plate for the regions of all frames.

    Parameters
    ----------
    shot : Shot
        From frames to any common plane.
    regions : dict of (n, 2) float64
        Points of each frame's region; frames without one may be missing.
    size : (int, int)
        Width and height of the frames.
    given : int
        The reference frame, with which the plate is aligned.

    Raises
    ------
    ImageError
        A frame sees the horizon of the plane, or the plate would be too large.
    """
    home = shot[given].matrix
    shot = {n: motion.then(np.linalg.inv(home)) for n, motion in shot.items()}
    if shot[given].bend is None:
        shot[given] = FrameMotion(np.eye(3))
    width, height = size
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)], float)
    quads, inside, finest, widest = [], [], 1.0, 1.0
    for number, motion in shot.items():
        depth = np.c_[corners, np.ones(4)] @ motion.matrix[:, 2]
        if depth.min() * depth.max() <= 0 or depth.min() / depth.max() > 50 or depth.max() / depth.min() > 50:
            raise ImageError(
                f"frame {number} sees the horizon of the tracked plane: expected a surface that ends before it"
            )
        quads.append(motion.onto(corners))
        points = regions.get(number, np.empty((0, 2)))
        steps = np.ones(1)
        if len(points):
            inside.append(motion.onto(points))
            steps = _steps(motion, points)
        fine, wide = float(np.quantile(steps, 0.05)), float(steps.max())
        if not (np.isfinite(quads[-1]).all() and 0 < fine <= wide < np.inf):
            raise ImageError(f"the motion of frame {number} {NO_SURFACE}")
        finest, widest = min(finest, fine), max(widest, wide)
    scale = min(MOST_SCALE, 1.0 / finest)
    shown = np.concatenate(quads)
    low, high = shown.min(0), shown.max(0)
    if inside:  # distant pixels are rarely a source of its texture
        region = np.concatenate(inside)
        reach = max(np.ptp(region, axis=0).max(), max(size)) / 2
        near, far = region.min(0), region.max(0)
        low, high = np.maximum(low, near - reach), np.minimum(high, far + reach)
        low, high = np.minimum(low, near - MARGIN * widest), np.maximum(high, far + MARGIN * widest)
    window = Window(*(math.floor(v * scale) for v in low), *(math.ceil(v * scale) for v in high))
    if max(window.size) > _MOST_SIDE:
        raise ImageError(
            f"the plate would be {window.width}x{window.height} px: expected sides of at most {_MOST_SIDE} px",
            hint="choose a shorter range of frames",
        )
    onto_plate = np.array([[scale, 0, 0], [0, scale, 0], [-window.left, -window.top, 1.0]])
    return PlateLayout({n: motion.then(onto_plate) for n, motion in shot.items()}, window.size, scale)


def _steps(motion: FrameMotion, points: np.ndarray) -> np.ndarray:
    """Plate pixels per pixel of the frame at points."""
    middle = motion.onto(points)
    across, down = (motion.onto(points + step) - middle for step in ((1.0, 0.0), (0.0, 1.0)))
    return np.sqrt(np.abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0]))


def region_points(region: np.ndarray) -> np.ndarray:
    """Points of a region, (h, w) bool, about every `_EVERY` pixels: (n, 2) float64."""
    y, x = np.nonzero(region)
    step = max(1, min(_EVERY**2, len(x) // 64))
    edge = [np.argmin(x), np.argmax(x), np.argmin(y), np.argmax(y)] if len(x) else []
    chosen = np.r_[0 : len(x) : step, edge].astype(int)
    return np.stack([x[chosen], y[chosen]], 1) + 0.5


def assembled(
    layout: PlateLayout,
    frames: Iterable[tuple[int, np.ndarray, np.ndarray]],
    matched: int,
    advance: Callable[[int], object],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """The plate from all frames, its known pixels, and the unknown ones that frames need.

    Each pixel is the mean of the frames that show it, the sharpest with the largest weight, so it has little grain. The
    level of each frame is matched to that of the frames before it.

    Parameters
    ----------
    layout : PlateLayout
    frames : iterable of (number, (h, w, c) float32, (h, w) bool)
        Values and region of each frame, the reference frame first, then outward.
    matched : int
        Number of leading channels whose level is matched.
    advance : callable
        Called with the number of frames done.

    Returns
    -------
    values : (height, width, c) float32
    known, needed : (height, width) bool
    grain : (matched,) float64 or None
        Standard deviation of the shot's grain. None: no two frames show enough in common.
    """
    whole = Window(0, 0, *layout.size)
    grains, sides = list[np.ndarray](), dict[bool, Side]()
    shape = whole.height, whole.width
    total, weight, needed = None, np.zeros(shape, np.float32), np.zeros(shape, bool)
    for done, (number, values, region) in enumerate(frames, 1):
        motion = layout.shot[number]
        side = Side(values[..., :matched], region, motion)
        if total is None:
            total, given = np.zeros((*shape, values.shape[2]), np.float32), number
            sides = {False: side, True: side}
        elif matched:
            measured = grain_between(sides[number > given], side)
            sides[number > given] = side
            if measured is not None:
                grains.append(measured)
        place = _seen(motion, region.shape, whole)
        if not place.empty:
            points = motion.back(centers(place).reshape(-1, 2)).reshape(place.height, place.width, 2)
            at = place.inside(whole)
            around = grown(region, MARGIN)[..., None].astype(np.float32)  # with the pixels that rendering reads
            asked = at_points(around, _inside(points, region.shape))[..., 0] > 0
            hidden = (region | ~np.isfinite(values).all(2))[..., None]  # other frames may have these pixels
            layers = np.concatenate([np.where(hidden, 0, values), ~hidden], 2, dtype=np.float32)
            sampled = at_points(layers, points)
            here = np.abs(sampled[..., -1] - 1) < _WHOLE
            here &= ((points >= 0.5) & (points <= np.array(region.shape[::-1]) - 0.5)).all(2)
            share = np.where(here, np.minimum(_density(points), 1) ** _SHARP, 0).astype(np.float32)
            sampled = sampled[..., :-1]
            sampled[..., :matched] *= _gain(total[at], weight[at], sampled, here)[:matched]
            total[at] += share[..., None] * sampled
            weight[at] += share
            needed[at] |= asked
        advance(done)
    known = weight > 0
    assert total is not None
    return total / np.where(known, weight, 1)[..., None], known, needed & ~known, of_shot(grains)


def _inside(points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Points up to `MARGIN` px beyond the border moved onto it: the filter reads there."""
    edge = np.clip(points, 0.5, np.array(shape[::-1]) - 0.5)
    return np.where(np.abs(points - edge).max(2, keepdims=True) <= MARGIN, edge, points)


def _seen(motion: FrameMotion, shape: tuple[int, ...], whole: Window) -> Window:
    """The part of the plate that a frame shows."""
    height, width = shape
    x, y = (np.linspace(-MARGIN, n + MARGIN, 9) for n in (width, height))
    rim = np.concatenate(
        [np.stack(np.broadcast_arrays(x, v), 1) for v in y[[0, -1]]]
        + [np.stack(np.broadcast_arrays(v, y), 1) for v in x[[0, -1]]]
    )
    shown = motion.onto(rim)
    low, high = np.floor(shown.min(0)).astype(int), np.ceil(shown.max(0)).astype(int)
    return Window(int(low[0]), int(low[1]), int(high[0]), int(high[1])) & whole


def _density(points: np.ndarray) -> np.ndarray:
    """Pixels of the frame per pixel of the plate, along one axis; 1 for a single row or column."""
    if min(points.shape[:2]) < 2:
        return np.ones(points.shape[:2])
    down, across = (np.gradient(points, axis=axis) for axis in (0, 1))
    return np.sqrt(np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0]))


def _gain(total: np.ndarray, weight: np.ndarray, sampled: np.ndarray, here: np.ndarray) -> np.ndarray:
    """Factor per channel that matches a frame's level to the plate's where both are known."""
    both = here & (weight > 0)
    if not both.any():
        return np.ones(sampled.shape[2], np.float32)
    plate, frame = total[both] / weight[both][:, None], sampled[both]
    ease = np.mean(frame**2, 0) + 1e-12
    return np.sum(plate * frame / (frame**2 + ease), 0) / np.maximum(np.sum(frame**2 / (frame**2 + ease), 0), 1e-12)
