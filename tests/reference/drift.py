# SPDX-License-Identifier: Apache-2.0
"""Flattening cell by cell: the oracle of drift/drift_field.py. Slow, and only for small images."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates


def flattened(
    lab: np.ndarray,
    opaque: np.ndarray,
    radius: float,
    side: int,
    amount: float,
    contrast: float,
    target: np.ndarray | None,
) -> np.ndarray:
    """(height, width, 3) Lab without its drift; `target` None: the median of its levels."""
    height, width = opaque.shape
    down, across = -(-height // side), -(-width // side)
    values = np.rint(lab.astype(np.float64) * 64) / 64
    cell_y, cell_x = np.arange(height) // side, np.arange(width) // side
    inside = [[opaque & (cell_y == j)[:, None] & (cell_x == i)[None, :] for i in range(across)] for j in range(down)]
    number = np.array([[m.sum() for m in row] for row in inside])
    spread = np.sqrt((2 * radius / side) ** 2 - 1 / 3 - 1 / 12)  # the cells' width and the spline come on top
    reach = max(1, int(np.ceil(3.5 * spread)))
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / spread) ** 2)
    taps /= taps.sum()
    ridge = 0.02 * (taps * np.arange(-reach, reach + 1) ** 2).sum()

    def plane(j: int, i: int) -> np.ndarray:
        """The value at the center of a plane fitted by weighted least squares, its slopes held by the ridge."""
        equations, right, total = np.zeros((3, 3)), np.zeros((3, 3)), 0.0
        for y in range(max(0, j - reach), min(down, j + reach + 1)):
            for x in range(max(0, i - reach), min(across, i + reach + 1)):
                weight, pixels = taps[y - j + reach] * taps[x - i + reach], values[inside[y][x]]
                step = np.array([1.0, y - j, x - i])
                equations += weight * len(pixels) * np.outer(step, step)
                right += weight * np.outer(step, pixels.sum(0))
                total += weight * len(pixels)
        equations += np.diag([0.0, ridge * total, ridge * total])
        return np.linalg.solve(equations, right)[0]

    def median(cells: dict[tuple[int, int], np.ndarray], j: int, i: int) -> np.ndarray:
        """Over the cells of the disc that have pixels."""
        near = [v for (y, x), v in cells.items() if ((y - j) * side) ** 2 + ((x - i) * side) ** 2 <= radius**2]
        return np.median(near, axis=0) if near else np.zeros(3)

    seen = {(j, i): values[inside[j][i]] for j in range(down) for i in range(across) if number[j, i]}
    planes = {(j, i): plane(j, i) for j in range(-2, down + 2) for i in range(-2, across + 2)}
    residual = {at: pixels.mean(0) - planes[at] for at, pixels in seen.items()}
    level = {at: planes[at] + median(residual, *at) for at in planes}
    spreads = {at: np.sqrt(((pixels - level[at]) ** 2).mean(0)) for at, pixels in seen.items()}
    local = {at: median(spreads, *at) for at in planes}
    overall = [np.median([field[at] for at in seen], axis=0) for field in (level, local)]
    gain = {at: np.clip(((overall[1] + 1) / (local[at] + 1)) ** contrast, 0.5, 2) for at in planes}
    gain = {at: 1 + amount * (g - 1) for at, g in gain.items()}
    goal = overall[0] if target is None else target
    offset = {at: amount * goal + (1 - amount) * level[at] - level[at] * gain[at] for at in planes}
    y, x = np.meshgrid(*((np.arange(n) + 0.5) / side + 1.5 for n in (height, width)), indexing="ij")

    def surface(field: dict[tuple[int, int], np.ndarray]) -> np.ndarray:
        grid = np.array([[field[j, i] for i in range(-2, across + 2)] for j in range(-2, down + 2)])
        planes = (map_coordinates(grid[..., c], [y, x], order=3, prefilter=False) for c in range(3))
        return np.stack(list(planes), -1)

    return lab * surface(gain) + surface(offset)
