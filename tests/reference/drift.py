# SPDX-License-Identifier: Apache-2.0
"""Flattening cell by cell: the oracle of drift/drift_field.py. Slow, and only for small images."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates


def flattened(
    lab: np.ndarray,
    opaque: np.ndarray,
    sigma: float,
    side: int,
    amount: float,
    contrast: float,
    target: np.ndarray | None,
) -> np.ndarray:
    """(height, width, 3) Lab without its drift; `target` None: its own mean."""
    height, width = opaque.shape
    down, across = -(-height // side), -(-width // side)
    values = np.rint(lab.astype(np.float64) * 64) / 64
    cell_y, cell_x = np.arange(height) // side, np.arange(width) // side
    inside = [[opaque & (cell_y == j)[:, None] & (cell_x == i)[None, :] for i in range(across)] for j in range(down)]
    number = np.array([[m.sum() for m in row] for row in inside])
    spread = np.sqrt((sigma / side) ** 2 - 1 / 3 - 1 / 12)  # the cells' width and the spline come on top
    reach = max(1, int(np.ceil(3.5 * spread)))
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / spread) ** 2)
    taps /= taps.sum()
    ridge = 0.02 * (taps * np.arange(-reach, reach + 1) ** 2).sum()

    def around(j: int, i: int):
        """Cells near a centre: their weights, steps to them, and pixels."""
        for y in range(max(0, j - reach), min(down, j + reach + 1)):
            for x in range(max(0, i - reach), min(across, i + reach + 1)):
                if number[y, x]:
                    yield taps[y - j + reach] * taps[x - i + reach], y - j, x - i, values[inside[y][x]]

    def local_mean(j: int, i: int) -> np.ndarray:
        """The value at the centre of a plane fitted by least squares, its slopes held by the ridge."""
        equations, right, total = np.zeros((3, 3)), np.zeros((3, 3)), 0.0
        for w, dy, dx, pixels in around(j, i):
            step = np.array([1.0, dy, dx])
            equations += w * len(pixels) * np.outer(step, step)
            right += w * np.outer(step, pixels.sum(0))
            total += w * len(pixels)
        equations += np.diag([0.0, ridge * total, ridge * total])
        return np.linalg.solve(equations, right)[0]

    overall = values[opaque].mean(0)
    shape = (down + 4, across + 4, 3)
    mean = np.array([[local_mean(j, i) for i in range(-2, across + 2)] for j in range(-2, down + 2)])
    left = np.zeros((down, across, 3))
    for j in range(down):
        for i in range(across):
            left[j, i] = ((values[inside[j][i]] - mean[j + 2, i + 2]) ** 2).sum(0)
    deviation = np.zeros(shape)
    for j in range(-2, down + 2):
        for i in range(-2, across + 2):
            seen = [(w, left[j + dy, i + dx], len(p)) for w, dy, dx, p in around(j, i)]
            deviation[j + 2, i + 2] = np.sqrt(sum(w * v for w, v, _ in seen) / sum(w * n for w, _, n in seen))
    everywhere = np.sqrt(left.sum((0, 1)) / number.sum())
    gain = np.clip(((everywhere + 1) / (deviation + 1)) ** contrast, 0.5, 2)
    y, x = np.meshgrid(*((np.arange(n) + 0.5) / side + 1.5 for n in (height, width)), indexing="ij")
    smooth = [
        np.stack([map_coordinates(g[..., c], [y, x], order=3, prefilter=False) for c in range(3)], -1)
        for g in (mean, gain)
    ]
    goal = overall if target is None else target
    flat = (lab - smooth[0]) * smooth[1] + goal
    return lab + amount * (flat - lab)
