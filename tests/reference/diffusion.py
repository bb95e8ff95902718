# SPDX-License-Identifier: Apache-2.0
"""Diffusion on texels with full matrices: the oracle of dominant/patch_manifold.py and dominant/diffusion.py."""

from __future__ import annotations

import numpy as np


def patches(lab: np.ndarray, side: int) -> np.ndarray:
    """LDR09 step 2: all patches as vectors, (N, 3 side^2)."""
    height, width = lab.shape[:2]
    return np.array([
        lab[y : y + side, x : x + side].transpose(2, 0, 1).ravel().astype(np.float64)
        for y in range(height - side + 1)
        for x in range(width - side + 1)
    ])  # fmt: skip


def weights(points: np.ndarray, epsilon: float) -> np.ndarray:
    """LDR09 eq. 1, (N, N)."""
    squares = ((points[:, None] - points) ** 2).sum(-1)
    return np.exp(-squares / (2 * epsilon))


def heat(kernel: np.ndarray, seed: int, steps: int) -> np.ndarray:
    """LDR09 eq. 3 by a matrix power."""
    a = kernel / kernel.sum(1, keepdims=True)
    return np.linalg.matrix_power(a, steps)[:, seed]
