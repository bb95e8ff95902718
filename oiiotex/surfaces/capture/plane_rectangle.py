# SPDX-License-Identifier: Apache-2.0
"""The rectangle of a textured plane to which --texrectify straightens a photo: its slant, its direction, its extent.

The vanishing line does not tell the slant without the lens. Two directions of joints that are the strongest tell it, as
they are taken to meet at right angles. Otherwise the lens is `USUAL_LENS`.
"""

from __future__ import annotations

import math

from ...engine.core.demand import at_most
from ...engine.deferred import np
from .homography import USUAL_LENS

_SIDE = 512  # px; longer side of the photo in which joints are looked for
_STRONGEST = 0.8  # quantile of the gradients that are taken for joints
_SHARP = 1.5  # times the mean density of directions, from which two directions are joints
_ONLY = 4.0  # from which one direction alone is
_APART = 20  # degrees between two directions of joints
_PEAK = 17  # degrees; within them, a direction of joints is the most frequent
_STRETCH = 6.0  # at most: 1 / cosine of the slant
_LEAST = 0.5  # of the largest scale in the rectangle: the smallest
_SHOWN = 0.6  # of the area that a rectangle along the photo's sides shows: least of one along joints
_OPAQUE = 0.99  # least alpha of a valid pixel
_GRID = 40  # positions along each side


def plane_rectangle(
    values: np.ndarray, vanishing: np.ndarray, opaque: np.ndarray | None = None
) -> tuple[np.ndarray, tuple[int, int]]:
    """The rectangle that shows most of a photo at scales that differ by at most 2.

    Parameters
    ----------
    values : (height, width, 3 or more) float32
        CIE Lab.
    vanishing : (2,) float
        l of x / (1 + l x), x from the photo's center, per px.
    opaque : (height, width) bool or None
        Valid pixels; None: all. Joints are not looked for elsewhere.

    Returns
    -------
    corners : (4, 2) float64
        Top left, top right, bottom right, bottom left, px.
    size : (width, height)
        Of the result, px: as many pixels as the rectangle has in the photo.
    """
    size = np.array(values.shape[1::-1])
    front, turn = _front(values, vanishing, opaque)
    upright = _largest(front, vanishing, size)
    if turn != 0.0:
        cosine, sine = math.cos(turn), math.sin(turn)
        turned = _largest(front @ np.array([[cosine, -sine], [sine, cosine]]), vanishing, size)
        if turned[1][0] * turned[1][1] >= _SHOWN * upright[1][0] * upright[1][1]:
            return turned
    return upright


def _largest(plane: np.ndarray, vanishing: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, tuple[int, int]]:
    """The rectangle, and its size, whose sides lie along the axes of x / (1 + l x) times a matrix."""
    inverse = np.linalg.inv(plane)
    frame = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 * size
    seen = frame / (1 + frame @ vanishing)[:, None] @ plane
    x, y = np.linspace(seen.min(0), seen.max(0), _GRID).T
    points = np.stack(np.meshgrid(x, y), -1) @ inverse
    depth = 1 - points @ vanishing
    within = (depth > 0) & (np.abs(points / np.maximum(depth, 1e-9)[..., None]) <= size / 2 + 1e-6).all(-1)
    step = (x[1] - x[0]) * (y[1] - y[0]) * abs(float(np.linalg.det(inverse)))
    area = np.where(depth > 0, step / np.maximum(depth, 1e-9) ** 3, 0)  # of the photo
    cells = (area[1:, 1:] + area[:-1, 1:] + area[1:, :-1] + area[:-1, :-1]) / 4
    total = np.pad(np.cumsum(np.cumsum(cells, 0), 1), ((1, 0), (1, 0)))
    best, found = 0.0, (0, 0, _GRID - 1, _GRID - 1)
    for left in range(_GRID - 1):
        for right in range(left + 1, _GRID):
            near, far = (one(depth[:, left], depth[:, right]) for one in (np.minimum, np.maximum))
            fits = np.triu(np.minimum.outer(near, near) >= _LEAST * np.maximum.outer(far, far), 1)
            inside = within[:, left] & within[:, right]
            column = total[:, right] - total[:, left]
            covered = (column - column[:, None]) * (fits & inside & inside[:, None])
            if covered.max() > best:
                best = float(covered.max())
                top, bottom = divmod(int(covered.argmax()), _GRID)
                found = left, top, right, bottom
    left, top, right, bottom = found
    sides = np.array([[x[left], y[top]], [x[right], y[top]], [x[right], y[bottom]], [x[left], y[bottom]]]) @ inverse
    corners = sides / (1 - sides @ vanishing)[:, None] + size / 2
    aspect = (x[right] - x[left]) / (y[bottom] - y[top])
    return corners, (max(1, round(math.sqrt(best * aspect))), max(1, round(math.sqrt(best / aspect))))


def _front(values: np.ndarray, vanishing: np.ndarray, opaque: np.ndarray | None) -> tuple[np.ndarray, float]:
    """Matrix (2, 2) from x / (1 + l x) to the plane seen from the front, and the angle of joints there, radians."""
    from scipy.ndimage import maximum_filter1d  # scipy is not loaded before it is needed

    steepness = max(float(np.linalg.norm(vanishing)), 1e-12)
    along = vanishing / steepness
    stretch = math.hypot(1, steepness * max(values.shape[:2]) * USUAL_LENS)  # 1 / cosine of the slant
    front = _stretched(along, stretch)
    density = _directions(values, vanishing, front, opaque)
    first = int(density.argmax())
    peak = density >= maximum_filter1d(density, _PEAK, mode="wrap")
    apart = np.abs((np.arange(180) - first + 90) % 180 - 90) >= _APART
    second = int(np.where(peak & apart, density, 0).argmax())
    one, other = (np.array([math.cos(t), math.sin(t)]) for t in np.radians([first, second]))
    turned = density[first] >= _ONLY
    if min(density[first], density[second]) >= _SHARP:
        square = 1 - float(one @ other) / (float(one @ along) * float(other @ along) or 1e-12)
        if 1 <= square * stretch**2 <= _STRETCH**2:
            rest = _stretched(along, math.sqrt(square))
            front, one, turned = front @ rest, one @ rest, True
    turn = (math.atan2(one[1], one[0]) + math.pi / 4) % (math.pi / 2) - math.pi / 4
    return front, turn if turned else 0.0


def _stretched(along: np.ndarray, stretch: float) -> np.ndarray:
    """Matrix (2, 2) that stretches along one direction."""
    return np.eye(2) + (stretch - 1) * np.outer(along, along)


def _directions(values: np.ndarray, vanishing: np.ndarray, front: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
    """Density of the directions of edges in x / (1 + l x) times a matrix, by degrees, (180,), times its mean."""
    from scipy.ndimage import gaussian_filter  # scipy is not loaded before it is needed

    opaque = np.ones(values.shape[:2], bool) if opaque is None else opaque
    lightness, usable = at_most(_SIDE, values[..., :1], opaque[..., None].astype(np.float32))
    rise, run = np.gradient(gaussian_filter(lightness[..., 0].astype(np.float64), 1.0))
    strength = np.hypot(rise, run) * (usable[..., 0] > _OPAQUE)
    joints = strength > np.quantile(strength, _STRONGEST)
    y, x = np.nonzero(joints)
    size = np.array(strength.shape[::-1])
    points = np.stack([x, y], 1) + 0.5 - size / 2
    slope = vanishing * values.shape[1::-1] / size
    edges = np.stack([-rise[joints], run[joints]], 1)
    seen = (edges * (1 + points @ slope)[:, None] - points * (edges @ slope)[:, None]) @ front
    turns = np.rint(np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))).astype(int) % 180
    density = gaussian_filter(np.bincount(turns, strength[joints], 180), 2.0, mode="wrap")
    return density / max(float(density.mean()), 1e-12)
