# SPDX-License-Identifier: Apache-2.0
"""The picture of docs/reference/filters/texatlas.md, after LDR09's figure 7: `python -m tools.docs.pictures.atlas`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import trimesh

from oiiotex import filters
from oiiotex.surfaces.atlas.mesh import Mesh, read_mesh
from tests.surfaces.test_atlas import bumpy
from tools.docs.pictures.layout import beside, draw, pixels, shrunk, stacked, test_photo, write_jpeg

PHOTOS = ("rust_barrel_side.jpg", "stained_plaster_wall.jpg")
PANE, SIDE = 300, 640  # px of a pane and of an atlas
_LIGHT = np.array([-0.5, -0.7, 0.5]) / np.linalg.norm([-0.5, -0.7, 0.5])
_TURN, _TILT = 0.6, 0.5  # radians


def shaded(mesh: Mesh, texture: np.ndarray, side: int = PANE) -> np.ndarray:
    """A textured mesh under one light, in parallel projection: (side, side, 3) uint8.

    Drawn at twice the size; the nearest face wins by a depth buffer.
    """
    size = 2 * side
    c, s = np.cos(_TURN), np.sin(_TURN)
    turn = np.array([[1, 0, 0], [0, np.cos(_TILT), -np.sin(_TILT)], [0, np.sin(_TILT), np.cos(_TILT)]])
    turn = turn @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    centered = mesh.points - (mesh.points.max(0) + mesh.points.min(0)) / 2
    seen = (centered / np.linalg.norm(centered, axis=1).max()) @ turn.T
    corners = seen[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    image, depth = np.ones((size, size, 3)), np.full((size, size), -np.inf)
    for face in np.flatnonzero(normal[:, 1] < 0):
        x, y = (corners[face, :, 0] * 0.95 + 1) * side, (1 - corners[face, :, 2] * 0.95) * side
        left, right = int(max(0, x.min())), int(min(size, x.max() + 1))
        top, bottom = int(max(0, y.min())), int(min(size, y.max() + 1))
        row, column = np.mgrid[top:bottom, left:right] + 0.5
        whole = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        second = ((column - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (row - y[0])) / whole
        third = ((x[1] - x[0]) * (row - y[0]) - (column - x[0]) * (y[1] - y[0])) / whole
        weights = np.stack([1 - second - third, second, third], -1)
        near = -weights @ corners[face, :, 1]
        area = slice(top, bottom), slice(left, right)
        drawn = (weights.min(-1) >= -1e-6) & (near > depth[area])
        u, v = np.moveaxis(weights[drawn] @ mesh.uv[face], -1, 0)
        height, width = texture.shape[:2]
        at = np.clip((1 - v) * height, 0, height - 1).astype(int), np.clip(u * width, 0, width - 1).astype(int)
        image[area][drawn] = texture[at] / 255 * (0.4 + 0.75 * max(0, normal[face] @ _LIGHT))
        depth[area][drawn] = near[drawn]
    small = np.clip(image, 0, 1).reshape(side, 2, side, 2, 3).mean((1, 3))
    return np.rint(255 * small).astype(np.uint8)


def square(image: oiio.ImageBuf) -> np.ndarray:
    """On white, as large as a pane."""
    small = pixels(shrunk(image, PANE))
    pane = np.full((PANE, PANE, 3), 255, np.uint8)
    top, left = ((PANE - n) // 2 for n in small.shape[:2])
    pane[top : top + small.shape[0], left : left + small.shape[1]] = small
    return pane


def figure_7() -> None:
    """Photo, two objects textured from its dominant mask, the second from the whole photo, an atlas."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        objects = {"torus": trimesh.creation.torus(1, 0.45, 48, 32), "stone": bumpy()}
        paths = {name: Path(folder) / f"{name}.ply" for name in objects}
        for name, path in paths.items():
            objects[name].export(path)
        for name in PHOTOS:
            photo = test_photo(name, 384)
            mask = filters.dominant(photo)

            def made(shape: str, photo: oiio.ImageBuf = photo, **more: object) -> tuple[np.ndarray, oiio.ImageBuf]:
                atlas = filters.atlas(photo, mesh=paths[shape], size=(SIDE, SIDE), seed=1, **more)
                return shaded(read_mesh(paths[shape], SIDE, SIDE), pixels(atlas)), atlas

            torus, stone, whole = made("torus", mask=mask), made("stone", mask=mask), made("stone")
            rows.append(beside(square(photo), torus[0], stone[0], whole[0], square(stone[1])))
    write_jpeg(stacked(rows), "atlas_objects.jpg")


if __name__ == "__main__":
    draw(figure_7)
