# SPDX-License-Identifier: Apache-2.0
"""Pixels of an atlas at one scale, and their neighbors on the surface."""

from __future__ import annotations

from dataclasses import dataclass

from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Program
from ...engine.session.resources import Resources
from .charts import Frames, covered, in_pixels, walk
from .mesh import Mesh

FRACTION = 8  # bits: places in the photo are held in 1/256 px, with pixel centers at a half
ONE = 1 << FRACTION
_AT_ONCE = 1 << 14  # pixels at borders
FARTHEST = 2  # px: greatest distance from the end of a step to the pixel used for it


@dataclass(frozen=True, eq=False)
class Surface:
    """Pixels of an atlas whose centers lie in charts, at one level of scale.

    `step` (faces, 2, 2) float64: pixels of the atlas, x and y, per pixel of the photo, x and y, on each face.
    """

    mesh: Mesh
    frames: Frames  # Of the photo at this level
    shape: tuple[int, int]  # (height, width)
    scale: tuple[float, float]  # Width and height of the unit square in pixels
    face: np.ndarray  # (n,) int32: face that covers the pixel
    place: np.ndarray  # (n,) int64: index of the pixel in the atlas, row by row
    index: np.ndarray  # (height, width) int32: inverse of `place`; -1 outside of charts
    step: np.ndarray
    inverse: np.ndarray  # (faces, 2, 2) float64

    @classmethod
    def of(cls, mesh: Mesh, frames: Frames, width: int, height: int, level: int, name: str = "") -> Surface:
        """Surface of an atlas of that size, halved `level` times; raises as `covered` does."""
        half = 2.0**-level
        shape = -(-height // (1 << level)), -(-width // (1 << level))
        scale = width * half, height * half
        owner = covered(mesh, shape[1], shape[0], scale, name)
        place = np.flatnonzero(owner >= 0)
        index = np.full(owner.size, -1, np.int32)
        index[place] = np.arange(len(place), dtype=np.int32)
        coarse = Frames(frames.step * 2.0**level, frames.gradient)
        face = owner.reshape(-1)[place]
        step = coarse.in_atlas(mesh, scale)
        return cls(mesh, coarse, shape, scale, face, place, index.reshape(shape), step, np.linalg.inv(step))

    @property
    def spots(self) -> np.ndarray:
        """Rows and columns of the pixels as in cl/offsets.h, (n,) uint32."""
        y, x = np.divmod(self.place, self.shape[1])
        return (y << 16 | x).astype(np.uint32)

    def nearest(self) -> np.ndarray:
        """The pixel in a chart nearest to each pixel of the atlas: (height, width) int32."""
        from scipy.ndimage import distance_transform_edt

        y, x = distance_transform_edt(self.index < 0, return_distances=False, return_indices=True)
        return self.index[y, x]

    def centers(self, pixels: np.ndarray) -> np.ndarray:
        """Centers of pixels of charts, x and y in the atlas."""
        y, x = np.divmod(self.place[pixels], self.shape[1])
        return np.stack([x, y], -1) + 0.5

    def around(self, pixels: np.ndarray, steps: np.ndarray, nearest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels at the end of steps along the surface, across borders of charts.

        `pixels` (n,) int; `steps` (n, 3) float64; `nearest` (height, width) int32; returns (n,) int32, (n, 2) float64.
        """
        face = self.face[pixels]
        corners = in_pixels(self.mesh.uv[face], self.scale)
        weights = barycentric(corners, self.centers(pixels))
        end, weights = walk(self.mesh, self.frames, face, weights, steps)
        ends = np.einsum("nc,nck->nk", weights, in_pixels(self.mesh.uv[end], self.scale), optimize=False)
        x, y = np.clip(np.floor(ends).astype(np.int64), 0, (self.shape[1] - 1, self.shape[0] - 1)).T
        there = nearest[y, x]
        return there, self.in_photo(there, self.centers(there) - ends)

    def in_photo(self, pixels: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """Moves (n, ..., 2) in pixels of the atlas as pixels of the photo."""
        return np.einsum("nij,n...j->n...i", self.inverse[self.face[pixels]], moves, optimize=False)

    def gutter_steps(self, pixels: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """Moves (n, 2) in pixels of the atlas as steps along the surface: (n, 3)."""
        photo = self.in_photo(pixels, moves)
        return np.einsum("nij,nj->ni", self.frames.step[self.face[pixels]], photo, optimize=False)


def barycentric(corners: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Barycentric coordinates of places (n, 2) in triangles (n, 3, 2), clipped: (n, 3), nonnegative, of sum 1."""
    a, b, c = np.moveaxis(corners, 1, 0)
    matrix = np.stack([b - a, c - a], -1)
    second, third = np.linalg.solve(matrix, (at - a)[..., None])[..., 0].T
    weights = np.maximum(np.stack([1 - second - third, second, third], -1), 0)
    return weights / weights.sum(-1, keepdims=True)


class Neighbors:
    """Neighbors of each pixel of a surface at some offsets in the photo, and the remainders of these offsets.

    Inside a chart both follow from the face alone, since pixels lie on a grid; at its border they are looked up.
    `tables` are those of cl/atlas.cl; places in rests are x and y in `ONE`ths of a pixel of the photo.
    """

    NAMES = ("spots", "face", "moves", "steps", "table", "beside", "rests", "index")

    def __init__(self, surface: Surface, offsets: np.ndarray, program: Program, resources: Resources):
        self._surface = surface
        count = len(offsets)
        ends = np.einsum("fij,kj->fki", surface.step, offsets, optimize=False)
        moves = np.floor(0.5 + ends)
        self._moves = moves.astype(np.int32)
        self._steps = _fixed(np.einsum("fij,fkj->fki", surface.inverse, moves - ends, optimize=False))
        missing, nearest = self._missing(program, resources), surface.nearest()
        border = np.flatnonzero(missing)
        self._table = np.full(len(missing), -1, np.int32)
        self._table[border] = np.arange(len(border))
        self._beside = np.zeros((max(1, len(border)), count), np.int32)
        self._rests = np.zeros((max(1, len(border)), count, 2), np.int16)
        for start in range(0, len(border), _AT_ONCE):
            pixels, rows = border[start : start + _AT_ONCE], slice(start, start + _AT_ONCE)
            move = self._moves[surface.face[pixels]].astype(np.int64) @ (1, surface.shape[1])
            place = surface.place[pixels, None] + move
            there, rest = np.take(surface.index, place, mode="clip"), self._steps[surface.face[pixels]]
            which, offset = np.nonzero(missing[pixels, None] >> np.arange(count, dtype=np.uint32) & np.uint32(1))
            leaving = pixels[which]
            steps = np.einsum("nij,nj->ni", surface.frames.step[surface.face[leaving]], offsets[offset], optimize=False)
            there[which, offset], away = surface.around(leaving, steps, nearest)
            rest[which, offset] = _fixed(away)
            self._beside[rows], self._rests[rows] = there, rest

    def tables(self) -> dict[str, np.ndarray]:
        """Arrays by `NAMES`."""
        surface = self._surface
        own = self._moves, self._steps, self._table, self._beside, self._rests
        return dict(zip(self.NAMES, (surface.spots, surface.face, *own, surface.index), strict=True))

    def _missing(self, program: Program, resources: Resources) -> np.ndarray:
        """Bits of the neighbors of each pixel that are not in its chart, (n,) uint32."""
        surface, device = self._surface, resources.device
        tables = {
            "spots": surface.spots, "face": surface.face, "chart": surface.mesh.chart.astype(np.int32),
            "moves": self._moves, "index": surface.index,
        }  # fmt: skip
        count, (height, width) = len(surface.place), surface.shape
        with Buffers(device, {"missing": 4 * count}, resources.budget, "an atlas", tables=tables) as buffers:
            arguments = [buffers[name] for name in (*tables, "missing")]
            program("missing", (count,), *arguments, count, width, height, self._moves.shape[1])
            return device.read(buffers["missing"], (count,), np.uint32)


def _fixed(rest: np.ndarray) -> np.ndarray:
    """Steps in `ONE`ths of a pixel, clipped: at a boundary of the surface the last pixel stands for distant ones."""
    return np.rint(np.clip(rest, -FARTHEST, FARTHEST) * ONE).astype(np.int16)
