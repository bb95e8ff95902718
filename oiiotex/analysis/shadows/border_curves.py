# SPDX-License-Identifier: Apache-2.0
"""Borders of a mask as smooth curves: traced, moved along their normals, and how unevenly they bend.

Places are (y, x) in cells, with the center of the first cell at 0, 0. On the way along a curve the shade is at the
right hand of somebody who looks at the image, and the normal points to the light.
"""

from __future__ import annotations

from typing import NamedTuple

from ...engine.core.elementary import gaussian_taps
from ...engine.deferred import np

_BEYOND = 8  # points beyond the image's border: the end of a curve is its straight continuation
_DIRECTION = 5  # points that determine it
_NEAR = 3.0  # cells: nearer ones have a distance along the normal, the others to the nearest point


class BorderCurve(NamedTuple):
    """Points of a curve, (n, 2) float, a cell apart; a closed one ends where it begins."""

    points: np.ndarray
    closed: bool

    def evened(self) -> BorderCurve:
        """With points a cell apart."""
        ring = np.concatenate([self.points, self.points[:1]]) if self.closed else self.points
        along = np.append(0.0, np.cumsum(np.sqrt((np.diff(ring, axis=0) ** 2).sum(1))))
        count = max(4, round(float(along[-1])))
        places = np.arange(count + (not self.closed)) * (along[-1] / count)
        return BorderCurve(np.stack([np.interp(places, along, ring[:, k]) for k in (0, 1)], 1), self.closed)

    def smoothed(self, sigma: float) -> BorderCurve:
        """Blurred by a Gaussian of that sigma, in points; the ends of an open curve are kept."""
        points, taps = self.points, gaussian_taps(sigma, 3.0)
        reach = len(taps) // 2
        if self.closed:
            wide = points[np.arange(-reach, len(points) + reach) % len(points)]
        else:
            inside = np.minimum(np.arange(1, reach + 1), len(points) - 1)
            wide = np.concatenate([2 * points[0] - points[inside[::-1]], points, 2 * points[-1] - points[-1 - inside]])
        blurred = sum(tap * wide[k : k + len(points)] for k, tap in enumerate(taps))
        return BorderCurve(np.asarray(blurred), self.closed).evened()

    def extended(self) -> BorderCurve:
        """An open curve with straight ends beyond the image."""
        if self.closed:
            return self
        points, last = self.points, min(_DIRECTION, len(self.points) - 1)
        ends = points[0] - points[last], points[-1] - points[-1 - last]
        first, final = (end / np.maximum(np.sqrt((end**2).sum()), 1e-9) for end in ends)
        steps = np.arange(1, _BEYOND + 1)[:, None]
        return BorderCurve(np.concatenate([points[0] + steps[::-1] * first, points, points[-1] + steps * final]), False)

    def moved(self, distances: np.ndarray) -> BorderCurve:
        """Along its normals, by (n,) cells."""
        return BorderCurve(self.points + distances[:, None] * self.normals(), self.closed).evened()

    def normals(self) -> np.ndarray:
        """Unit vectors toward the light, (n, 2)."""
        tangents = (self._after() - self._before()) / 2
        lengths = np.sqrt((tangents**2).sum(1, keepdims=True))
        return np.stack([tangents[:, 1], -tangents[:, 0]], 1) / np.maximum(lengths, 1e-9)

    def curvature(self) -> np.ndarray:
        """Per cell, (n,); positive where the shade bulges."""
        return -((self._after() + self._before() - 2 * self.points) * self.normals()).sum(1)

    def bending(self) -> tuple[np.ndarray, np.ndarray]:
        """Differences of curvature between neighbors: (m,) now, and (m, n) of how distances moved reduce them.

        A curve with curvature c that moves by d along its normals has c - d'' - c^2 d. Circles and lines have none.
        """
        count, curvature, unit = len(self.points), self.curvature(), np.eye(len(self.points))
        reduction = np.roll(unit, 1, 1) + np.roll(unit, -1, 1) - 2 * unit + np.diag(curvature**2)
        step = np.roll(unit, 1, 1) - unit
        inner = slice(0, count) if self.closed else slice(1, count - 2)
        return (step @ curvature)[inner], (step @ reduction)[inner]

    def _after(self) -> np.ndarray:
        points = self.points
        return np.concatenate([points[1:], points[:1] if self.closed else 2 * points[-1:] - points[-2:-1]])

    def _before(self) -> np.ndarray:
        points = self.points
        return np.concatenate([points[-1:] if self.closed else 2 * points[:1] - points[1:2], points[:-1]])


def traced(shade: np.ndarray) -> list[BorderCurve]:
    """The borders of a mask, (rows, columns) bool, along the sides of its cells."""
    following = _sides(shade)
    ends = {end for found in following.values() for end in found}
    curves = []
    for start in [corner for corner in following if corner not in ends] + list(following):
        while following.get(start):
            corners = [start]
            while following.get(corners[-1]) and (len(corners) == 1 or corners[-1] != start):
                corners.append(following[corners[-1]].pop())
            closed = corners[0] == corners[-1]
            curves.append(BorderCurve(np.array(corners[: len(corners) - closed], np.float64) - 0.5, closed))
    return curves


def _sides(shade: np.ndarray) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Sides of cells between shade and light: the corners that follow each corner."""
    following: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for dy, dx in ((1, 0), (0, 1)):  # sides that lead down, and right
        before, after = (shade[:, :-1], shade[:, 1:]) if dy else (shade[:-1], shade[1:])
        forward = after if dy else before
        for y, x in np.argwhere(before != after).tolist():
            start = y + dx, x + dy
            end = start[0] + dy, start[1] + dx
            start, end = (start, end) if forward[y, x] else (end, start)
            following.setdefault(start, []).append(end)
    return following


def distances(curves: list[BorderCurve], shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Distance of each cell from the nearest curve, positive in light, and the nearest of all their points.

    Returns
    -------
    distance : (rows, columns) float
        Cells.
    nearest : (rows, columns) int
        Index into the points of all curves, in their order.
    """
    from scipy.spatial import cKDTree  # slow to import

    points, normals = (np.concatenate(each) for each in zip(*((c.points, c.normals()) for c in curves), strict=True))
    places = np.argwhere(np.ones(shape, bool)).astype(np.float64)
    away, nearest = cKDTree(points).query(places)
    along = ((places - points[nearest]) * normals[nearest]).sum(1)
    signed = np.where(away < _NEAR, along, np.sign(along) * away)
    return signed.reshape(shape), nearest.reshape(shape)
