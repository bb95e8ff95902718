# SPDX-License-Identifier: Apache-2.0
"""What a renderer does with an atlas of Wang tiles and an index image, in numpy: an oracle for shaders."""

from __future__ import annotations

import numpy as np


def sample_wang(atlas: np.ndarray, index: np.ndarray, side: int, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Bilinear samples of one MIP level of an atlas, (height, width, channels); u and v in tiles, v downwards."""
    x, y = np.floor(u).astype(int), np.floor(v).astype(int)
    column, row = np.moveaxis(index[y % index.shape[0], x % index.shape[1], :2].astype(int), -1, 0)
    height, width = atlas.shape[0] / side, atlas.shape[1] / side  # of a tile, px
    return bilinear(atlas, (column + u - x) * width - 0.5, (row + v - y) * height - 0.5)


def bilinear(texels: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Samples between the centers of texels, with repeat."""
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    right, down = (x - left)[..., None], (y - top)[..., None]

    def at(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return texels[rows % texels.shape[0], columns % texels.shape[1]].astype(float)

    above = at(top, left) * (1 - right) + at(top, left + 1) * right
    below = at(top + 1, left) * (1 - right) + at(top + 1, left + 1) * right
    return above * (1 - down) + below * down


def border_steps(atlas: np.ndarray, index: np.ndarray, side: int, cells: int = 24) -> float:
    """Root mean square step of a level at the borders of tiles: of two samples, a hair before and behind a border."""
    hair = 1e-6
    line, along = np.meshgrid(np.arange(1.0, cells), np.linspace(0.02, cells - 0.02, 16 * cells), indexing="ij")

    def at(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return sample_wang(atlas, index, side, u, v)

    gaps = at(line + hair, along) - at(line - hair, along), at(along, line + hair) - at(along, line - hair)
    return float(np.sqrt(np.mean(np.square(gaps))))
