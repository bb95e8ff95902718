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
    shares = {at: light_share(level[at], local[at], *overall) for at in planes}
    gain = {at: 1 + amount * shares[at] * (g - 1) for at, g in gain.items()}
    overall, target = overall[0], overall[0] if target is None else target
    darkest, brightest = values[opaque][:, 0].min(), values[opaque][:, 0].max()
    sure = min(1.0, max(0.0, (20 - max(tint(level[at], overall) for at in seen)) / (20 - 12)))
    level = {at: np.array([np.clip(v[0], darkest, brightest), *v[1:]]) for at, v in level.items()}

    def change(at: tuple[int, int]) -> list[float]:
        """Gain and offset of L, ratio of levels, gains and offsets of color."""
        own = level[at]
        share = shares[at]
        goal = own[0] + amount * (share[0] * np.clip(overall[0] - own[0], -40, 40) + target[0] - overall[0])
        f = (max(goal, 0) + 16) / 116
        here, common, wanted = (relit(lab, goal)[[0, 2]] for lab in (own, overall, target))
        moved = amount * (share[1:] * sure * (common - here) + wanted - common)
        ratio = np.clip(max(goal, 1) / max(own[0], 1), 0.25, 4)
        return [gain[at][0], goal - own[0] * gain[at][0], ratio, 1, 1, *moved / max(f - 4 / 29, 4 / 29)]

    y, x = np.meshgrid(*((np.arange(n) + 0.5) / side + 1.5 for n in (height, width)), indexing="ij")

    grid = np.array([[change((j, i)) for i in range(-2, across + 2)] for j in range(-2, down + 2)])
    fields = np.stack([map_coordinates(grid[..., c], [y, x], order=3, prefilter=False) for c in range(7)], -1)
    brightest *= max(1.0, target[0] / max(overall[0], 1.0))
    pixels = zip(lab.reshape(-1, 3).astype(np.float64), fields.reshape(-1, 7), strict=True)
    return np.array([corrected(*one, brightest) for one in pixels]).reshape(lab.shape)


def corrected(lab: np.ndarray, field: np.ndarray, brightest: float) -> np.ndarray:
    """One pixel, (3,) Lab with L >= 0, by its gains and offsets."""
    gain, offset, ratio = field[:3]
    f = of_lab(lab)
    light = np.clip(lab[0] * gain + offset, lab[0] * min(ratio, 1) / 2, lab[0] * max(ratio, 1) * 2)
    least_room = max(1.0, (brightest + 16) / 116 / f.max())
    light = min(light, max(lab[0], brightest), 116 * f[1] * least_room - 16)
    new = relit(lab, light)
    color = new[1] + field[3:5] * (new[[0, 2]] - new[1]) + field[5:7] * (new[1] - 4 / 29)
    x, z = np.maximum(color, np.minimum(new[[0, 2]], (new[[0, 2]] + 4 / 29) / 2))
    return np.array([light, 500 * (x - new[1]), 200 * (new[1] - z)])


def of_lab(lab: np.ndarray) -> np.ndarray:
    """f of X, Y, Z (CIE 15)."""
    y = (max(lab[0], 0) + 16) / 116
    return np.array([y + lab[1] / 500, y, y - lab[2] / 200])


def relit(lab: np.ndarray, light: float) -> np.ndarray:
    """f of X, Y, Z in the light that gives a color the lightness `light`."""
    f = of_lab(lab)
    xyz, y = (np.where(v > 6 / 29, v**3, (v - 4 / 29) * 108 / 841) for v in (f, (max(light, 0) + 16) / 116))
    xyz = xyz * y / max(xyz[1], 1e-9)
    return np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz * 841 / 108 + 4 / 29)


def light_share(level: np.ndarray, contrast: np.ndarray, overall: np.ndarray, typical: np.ndarray) -> np.ndarray:
    """Share of L, a and b that light explains: what moves both ends of a and b, not what a mixture moves."""
    scale, shares = (overall[0] + 16) / (max(level[0], 0) + 16), []
    apart = [abs(scale * level[c] - overall[c]) for c in (1, 2)]
    ends = [abs(scale * contrast[c] - typical[c]) - 1 for c in (1, 2)]
    mixed = [min(max(end, 0), 2 * typical[c], away) for c, end, away in zip((1, 2), ends, apart, strict=True)]
    for part, whole in ((np.hypot(*mixed), np.hypot(*apart)), *zip(mixed, apart, strict=True)):
        shares.append(1 - part / (whole + 1))
    return np.array(shares)


def tint(level: np.ndarray, overall: np.ndarray) -> float:
    """Difference in a, b that neither light nor an offset explains."""
    relit = level[1:] / (level[0] + 16) * (overall[0] + 16)
    return min(np.hypot(*(relit - overall[1:])), np.hypot(*(level[1:] - overall[1:])))
