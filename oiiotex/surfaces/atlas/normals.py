# SPDX-License-Identifier: Apache-2.0
"""Tangent-space normals copied onto a surface, rotated from the photo's directions to those of its charts."""

from __future__ import annotations

from dataclasses import replace

from ...engine.color.config import as_float
from ...engine.color.lens import in_type
from ...engine.core.image import Part, channels_of
from ...engine.core.window import Window
from ...engine.deferred import np
from .charts import Frames
from .mesh import Mesh


def turns(mesh: Mesh, frames: Frames) -> np.ndarray:
    """The photo's x (to the right) and y (up) in each face's tangent space: (faces, 2, 2) float32.

    Tangent space is that of MikkTSpace: the tangent along u, the bitangent perpendicular on the side of v, mirrored in
    mirrored charts. MikkTSpace also interpolates tangents between faces, which is ignored here.
    """
    corners, uv = mesh.corners, mesh.uv
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], -1)
    flat = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], -1)
    tangent = (edges @ np.linalg.inv(flat))[..., 0]  # derivative of places by u
    bitangent = np.cross(np.cross(edges[..., 0], edges[..., 1]), tangent) * np.sign(np.linalg.det(flat))[:, None]
    basis = np.stack([tangent, bitangent], 1)
    basis /= np.linalg.norm(basis, axis=-1, keepdims=True)
    photo = frames.step * (1, -1)
    photo /= np.linalg.norm(photo, axis=1, keepdims=True)
    return (basis @ photo).astype(np.float32)


def turned(part: Part, turn: np.ndarray, encoded: bool, upwards: bool) -> Part:
    """Tangent-space normals on a surface, in their original type.

    Parameters
    ----------
    part : Part
        Normals as copied from the photo.
    turn : (height, width, 2, 2) float32
        Rotation of each pixel, from `turns`.
    encoded : bool
        Whether -1 to 1 is stored as 0 to 1.
    upwards : bool
        Whether green points up (OpenGL) or down (DirectX).
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
