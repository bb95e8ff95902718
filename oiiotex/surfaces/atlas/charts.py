# SPDX-License-Identifier: Apache-2.0
"""Pixels of an atlas, directions on its surface, and walks from a pixel to its neighbors on the surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ...engine.deferred import np
from ...engine.errors import ImageError
from .mesh import Mesh

_AT_ONCE = 1 << 21  # pixels tested at once
_INSIDE = 1e-9  # in barycentric coordinates: pixels on an edge belong to the face of the lower index
_OVERLAP = 1e-6
_MOST_EDGES = 512  # edges that a walk crosses before it stops
_SMOOTH = 0.25  # in roots of the surface area: distance over which directions are smoothed


@dataclass(frozen=True, eq=False)
class Frames:
    """A step of one pixel of the photo on each face.

    Attributes
    ----------
    step : (faces, 3, 2) float64
        Along the surface, in units of the mesh: x, y, z by the photo's x and y.
    gradient : (faces, 3, 3) float64
        Gradient along the surface of the barycentric coordinate of each corner.
    """

    step: np.ndarray
    gradient: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh, unit: float) -> Frames:
        """Directions along the charts' u, smoothed across charts; `unit` is the width of a pixel of the photo."""
        corners = mesh.corners
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(normal, axis=-1, keepdims=True)
        normal /= doubled
        opposite = np.roll(corners, -2, 1) - np.roll(corners, -1, 1)  # the edge opposite to each corner
        gradient = np.cross(normal[:, None], opposite) / doubled[..., None]
        along = np.einsum("fck,fc->fk", gradient, mesh.uv[..., 0])  # the gradient of u
        right = _smoothed(mesh, normal, along, opposite, doubled[:, 0] / 2)
        down = np.cross(right, normal)
        return cls(np.stack([right, down], -1) * unit, gradient)

    def in_atlas(self, mesh: Mesh, scale: tuple[float, float]) -> np.ndarray:
        """Pixels of the atlas, x and y, per pixel of the photo, x and y, on each face: (faces, 2, 2)."""
        change = np.einsum("fck,fkp->fcp", self.gradient, self.step)
        return np.einsum("fcx,fcp->fxp", in_pixels(mesh.uv, scale), change)


def _smoothed(mesh: Mesh, normal: np.ndarray, wanted: np.ndarray, opposite: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Unit tangents close to wanted ones and, along the surface, to each other: (faces, 3).

    A direction is a complex number in a basis of its face, and keeps its angle with an edge that it is carried across.
    Least squares, like the smooth fields of Knöppel, Crane, Pinkall and Schröder (SIGGRAPH 2013), with a data term.
    """
    from scipy.sparse import coo_matrix, diags
    from scipy.sparse.linalg import spsolve
    from threadpoolctl import threadpool_limits

    first = opposite[:, 0] / np.linalg.norm(opposite[:, 0], axis=-1, keepdims=True)
    second = np.cross(normal, first)

    def number(face: np.ndarray, vectors: np.ndarray) -> np.ndarray:
        z = (vectors * first[face]).sum(-1) + 1j * (vectors * second[face]).sum(-1)
        return z / np.maximum(np.abs(z), 1e-300)

    every = np.arange(len(mesh.faces))
    given = number(every, wanted)
    face, corner = np.nonzero(mesh.across >= 0)
    other, edge = mesh.across[face, corner], opposite[face, corner]
    center = mesh.corners.mean(1)
    apart = np.linalg.norm(center[face] - center[other], axis=-1)
    weight = np.linalg.norm(edge, axis=-1) / np.maximum(apart, 1e-9 * apart.max(initial=1))
    turn = number(face, edge) * number(other, edge).conj()  # rotation from the basis of `other` to that of `face`
    count = len(every)
    pull = area / (_SMOOTH**2 * area.sum())
    links = coo_matrix((-weight * turn, (face, other)), shape=(count, count))
    degree = np.bincount(face, weight, count) + pull
    with threadpool_limits(1, "blas"):  # of small fronts, where threads wait for each other
        field = np.atleast_1d(spsolve((links + diags(degree)).tocsc(), pull * given))
    field = np.where(np.abs(field) > 1e-9, field / np.maximum(np.abs(field), 1e-300), given)
    return field.real[:, None] * first + field.imag[:, None] * second


def covered(mesh: Mesh, width: int, height: int, scale: tuple[float, float], name: str = "") -> np.ndarray:
    """Index of the face that covers the center of each pixel: (height, width) int32, -1 for none."""
    place = in_pixels(mesh.uv, scale)
    owner = np.full(width * height, len(mesh.faces), np.int64)
    times = np.zeros(width * height if name else 0, np.uint8)
    for face, y, x in _tried(place, width, height):
        a, b, c = np.moveaxis(place[face], 1, 0)
        at = np.stack([x + 0.5, y + 0.5], -1)
        whole = _cross(b - a, c - a)
        parts = np.stack([_cross(c - b, at - b), _cross(a - c, at - c), _cross(b - a, at - a)], -1) / whole[:, None]
        least = parts.min(-1)
        inside = least >= -_INSIDE
        pixel = y[inside] * width + x[inside]
        np.minimum.at(owner, pixel, face[inside])
        if name:
            strictly = least > _OVERLAP
            np.add.at(times, y[strictly] * width + x[strictly], 1)
    double = np.count_nonzero(times > 1)
    if double:
        raise ImageError(f"{name}: charts overlap on {double} pixels of the atlas; unwrap the mesh without overlaps")
    owner[owner == len(mesh.faces)] = -1
    return owner.reshape(height, width).astype(np.int32)


def in_pixels(uv: np.ndarray, scale: tuple[float, float]) -> np.ndarray:
    """UVs as places x, y in px of an atlas whose first row is the top."""
    return np.stack([uv[..., 0] * scale[0], (1 - uv[..., 1]) * scale[1]], -1)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _tried(place: np.ndarray, width: int, height: int) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """(face, y, x) of all pixels in the bounding boxes of faces, some faces at a time."""
    low = np.clip(np.floor(place.min(1)), 0, (width, height)).astype(np.int64)
    high = np.clip(np.ceil(place.max(1)), 0, (width, height)).astype(np.int64)
    wide, tall = (high - low).T
    number = wide * tall
    group = np.cumsum(number) // _AT_ONCE
    for start, end in zip(*_runs(group), strict=True):
        face = np.repeat(np.arange(start, end), number[start:end])
        first = np.cumsum(number[start:end]) - number[start:end]
        nth = np.arange(len(face)) - np.repeat(first, number[start:end])
        yield face, low[face, 1] + nth // wide[face], low[face, 0] + nth % wide[face]


def _runs(group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    return starts, np.append(starts[1:], len(group))


def walk(
    mesh: Mesh, frames: Frames, face: np.ndarray, weights: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Walk straight along the surface; at an edge the step is rotated into the plane of the next face.

    `face` (n,) int; `weights` (n, 3) float64; `step` (n, 3) float64; returns (n,) int64, (n, 3) float64.
    """
    face, weights, step = face.astype(np.int64), weights.copy(), step.copy()
    corners = mesh.corners
    moving = np.arange(len(face))
    for _ in range(_MOST_EDGES):
        at, here = face[moving], weights[moving]
        rate = np.einsum("nck,nk->nc", frames.gradient[at], step[moving])
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(rate < 0, np.maximum(here, 0) / -rate, np.inf)
        exit_ = reach.argmin(1)
        part = np.minimum(reach[np.arange(len(at)), exit_], 1.0)
        weights[moving] = here + rate * part[:, None]
        step[moving] *= (1 - part)[:, None]
        beyond = mesh.across[at, exit_]
        goes = (part < 1) & (beyond >= 0)
        moving, at, exit_, beyond = moving[goes], at[goes], exit_[goes], beyond[goes]
        if not len(moving):
            break
        # the component along the edge is kept, the component across it rotates into the plane of the next face
        edge = corners[at, (exit_ + 2) % 3] - corners[at, (exit_ + 1) % 3]
        edge /= np.linalg.norm(edge, axis=-1, keepdims=True)
        rest = step[moving]
        ahead = (rest * edge).sum(-1, keepdims=True) * edge
        side = np.linalg.norm(rest - ahead, axis=-1, keepdims=True)
        old = weights[moving]
        new = np.zeros_like(old)
        third = np.ones((len(moving), 3), bool)
        for corner in ((exit_ + 1) % 3, (exit_ + 2) % 3):
            same = mesh.faces[beyond] == mesh.faces[at, corner][:, None]
            new += np.where(same, old[np.arange(len(at)), corner][:, None], 0)
            third &= ~same
        inwards = frames.gradient[beyond][third]  # from the edge towards the opposite corner of the next face
        step[moving] = ahead + side * inwards / np.linalg.norm(inwards, axis=-1, keepdims=True)
        new = np.maximum(new, 0)
        weights[moving], face[moving] = new / new.sum(-1, keepdims=True), beyond
    return face, weights
