# SPDX-License-Identifier: Apache-2.0
"""A plane in perspective: its matrix from four points or more, and its aspect ratio.

Points are (x, y) in px, pixel centers at halves, y down. Matrices multiply row vectors (x, y, 1), as OpenImageIO's do.
"""

from __future__ import annotations

import math

from ...engine.core.parameters import Numbers
from ...engine.deferred import np
from ...engine.errors import ParameterError

_FOCAL = 0.5, 20.0  # in longer sides of the photo: lenses from 90 to 3 degrees of view
USUAL_LENS = 1.0  # in longer sides of the photo: 36 mm equivalent, between a phone's and a standard lens
_SMALLEST = 1e-3  # px^2; least area
_PARALLEL = 1e-3  # sides that meet beyond a thousand times the photo's side do not determine the lens


def require_quadrangle(corners: np.ndarray) -> None:
    """Raise an error unless four corners can be the perspective image of a rectangle.

    Parameters
    ----------
    corners : (4, 2) float
        Top left, top right, bottom right, bottom left.

    Raises
    ------
    ParameterError
        They are not in that order around a convex quadrangle, or it is too small to have a shape.
    """
    sides = np.roll(corners, -1, 0) - corners
    after = np.roll(sides, -1, 0)
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    if not (turns > max(1e-6 * np.abs(sides).max() ** 2, _SMALLEST)).all():
        expected = "top left, top right, bottom right, bottom left of a convex quadrangle"
        raise ParameterError(parameter="corners", value=Numbers(corners.ravel().tolist()), expected=expected)


def homography(corners: np.ndarray, width: float, height: float) -> np.ndarray:
    """Matrix that maps four corners to those of a rectangle at the origin; exact, unlike `homography_of`.

    Parameters
    ----------
    corners : (4, 2) float
        As in `require_quadrangle`.
    width, height : float
        Size of the rectangle, px.

    Returns
    -------
    (3, 3) float64
    """
    target = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
    return np.linalg.inv(_from_square(corners)) @ _from_square(target)


def _from_square(corners: np.ndarray) -> np.ndarray:
    """From the unit square to a quadrangle, in closed form (Heckbert 1989, section 2.2.3)."""
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = np.asarray(corners, float)
    dx1, dx2, sx = x1 - x2, x3 - x2, x0 - x1 + x2 - x3
    dy1, dy2, sy = y1 - y2, y3 - y2, y0 - y1 + y2 - y3
    area = dx1 * dy2 - dy1 * dx2
    g, h = (sx * dy2 - sy * dx2) / area, (dx1 * sy - dy1 * sx) / area
    return np.array([[x1 - x0 + g * x1, y1 - y0 + g * y1, g], [x3 - x0 + h * x3, y3 - y0 + h * y3, h], [x0, y0, 1.0]])


def through(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) transformed by a matrix, (n, 2) float64."""
    seen = np.concatenate([points, np.ones((len(points), 1))], 1) @ matrix
    return seen[:, :2] / seen[:, 2:]


def sides_of(corners: np.ndarray) -> tuple[float, float]:
    """The longer of top and bottom, and of left and right, px: at this size no part is downsampled."""
    top, right, bottom, left = np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1)
    return float(max(top, bottom)), float(max(left, right))


def aspect_of(corners: np.ndarray, size: tuple[float, float]) -> float:
    """Aspect ratio, width over height, of the rectangle seen at four corners.

    By Zhang and He (Whiteboard scanning and image enhancement, Digital Signal Processing 17(2), 2007, section 3): the
    lens follows from the two vanishing points if the optical axis passes through the center of the photo and pixels are
    square. Where opposite sides are parallel, or no plausible lens results, `USUAL_LENS` is assumed.

    Parameters
    ----------
    corners : (4, 2) float
    size : (width, height)
        Size of the photo, px, whose center is (width / 2, height / 2).
    """
    longer = float(max(size))
    m1, m2, m4, m3 = (
        np.append((np.asarray(c, float) - np.array(size) / 2) / longer, 1.0) for c in corners
    )  # the paper's order: third is lower left, fourth lower right
    k2 = np.cross(m1, m4) @ m3 / (np.cross(m2, m4) @ m3)
    k3 = np.cross(m1, m4) @ m2 / (np.cross(m3, m4) @ m2)
    n2, n3 = k2 * m2 - m1, k3 * m3 - m1  # eq. 13, 15
    seen = np.hypot(*n2[:2]), np.hypot(*n3[:2])
    told = min(abs(n2[2]) / seen[0], abs(n3[2]) / seen[1]) > _PARALLEL
    focal = -(n2[:2] @ n3[:2]) / (n2[2] * n3[2]) if told else 0.0  # eq. 17, squared
    if focal <= 0:
        focal = USUAL_LENS**2
    focal = min(max(focal, _FOCAL[0] ** 2), _FOCAL[1] ** 2)
    return math.sqrt((seen[0] ** 2 / focal + n2[2] ** 2) / (seen[1] ** 2 / focal + n3[2] ** 2))  # eq. 20


def homography_of(points: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Matrix that maps points (n, 2) to targets, with the least squares of algebraic errors, (3, 3) float64.

    The normalized direct linear transform: Hartley and Zisserman, Multiple View Geometry, 2004, algorithm 4.2.
    """
    (a, first), (b, second) = _normalized(points), _normalized(targets)
    x, y, zero, one = *a.T, np.zeros(len(a)), np.ones(len(a))
    u, v = b.T
    rows = [[x, y, one, zero, zero, zero, -u * x, -u * y, -u], [zero, zero, zero, x, y, one, -v * x, -v * y, -v]]
    system = np.concatenate([np.stack(row, 1) for row in rows])
    solution = np.linalg.eigh(system.T @ system)[1][:, 0].reshape(3, 3)
    matrix = first @ solution.T @ np.linalg.inv(second)
    return matrix / matrix[2, 2]


def _normalized(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points around the origin at a mean distance of the root of 2, and the matrix that moves them there."""
    center = points.mean(0)
    scale = np.sqrt(2) / max(float(np.linalg.norm(points - center, axis=1).mean()), 1e-9)
    matrix = np.array([[scale, 0, 0], [0, scale, 0], [*(-scale * center), 1]])
    return (points - center) * scale, matrix
