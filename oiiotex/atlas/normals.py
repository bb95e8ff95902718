# SPDX-License-Identifier: Apache-2.0
"""Normals that are copied onto a surface, turned from the photo's directions into those of its charts."""

from __future__ import annotations

from dataclasses import replace

from ..color.config import as_float
from ..color.lab import in_type
from ..core.image import Part, channels_of
from ..core.window import Window
from ..deferred import np
from .charts import Frames
from .mesh import Mesh


def turns(mesh: Mesh, frames: Frames) -> np.ndarray:
    """What the photo's x (to the right) and y (up) are in each face's tangent space: (faces, 2, 2) float32.

    That space is as MikkTSpace has it: the tangent along u, the bitangent at a right angle, to the side of v; mirrored
    charts have a mirrored one. Renderers even tangents out between faces, which is not followed here.
    """
    corners, uv = mesh.corners, mesh.uv
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], -1)
    flat = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], -1)
    tangent = (edges @ np.linalg.inv(flat))[..., 0]  # how places change with u
    bitangent = np.cross(np.cross(edges[..., 0], edges[..., 1]), tangent) * np.sign(np.linalg.det(flat))[:, None]
    basis = np.stack([tangent, bitangent], 1)
    basis /= np.linalg.norm(basis, axis=-1, keepdims=True)
    photo = frames.step * (1, -1)
    photo /= np.linalg.norm(photo, axis=1, keepdims=True)
    return (basis @ photo).astype(np.float32)


def turned(part: Part, turn: np.ndarray, encoded: bool, upwards: bool) -> Part:
    """Tangent-space normals on a surface, in their own type.

    Parameters
    ----------
    part : Part
        Normals as they were copied from the photo.
    turn : (height, width, 2, 2) float32
        Of each pixel, as `turns` gives it.
    encoded : bool
        -1 .. 1 is stored as 0 .. 1.
    upwards : bool
        Green points up (OpenGL), else down (DirectX).
    """
    x, y = channels_of(part.spec).color[:2]
    signs = np.array([1, 1 if upwards else -1], np.float32)

    def fetch(window: Window) -> np.ndarray:
        pixels = part.read(window).copy()
        values = as_float(pixels[..., [x, y]])
        vectors: np.ndarray = (2 * values - 1 if encoded else values) * signs
        matrix = turn[window.inside(part.window)]
        vectors = (matrix[..., 0] * vectors[..., :1] + matrix[..., 1] * vectors[..., 1:]) * signs
        pixels[..., [x, y]] = in_type((vectors + 1) / 2 if encoded else vectors, pixels.dtype)
        return pixels

    return replace(part, fetch=fetch)
