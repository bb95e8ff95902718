# SPDX-License-Identifier: Apache-2.0
"""The integer grid of Lab on which filters decide: equal Lab yields equal decisions on every device."""

from __future__ import annotations

from ..deferred import np

FINE_STEPS = 8  # steps per Lab unit
COARSE_STEPS = 4  # for sums of squares over a large patch
SUM_STEPS = 64  # for values that are only added up and may exceed SPAN
SPAN = 300  # extent of the grid along every axis, Lab units
_LOW = (-16.0, -150.0, -150.0)


def steps_for(patch: int, channels: int = 3) -> int:
    """Steps per Lab unit, at most `FINE_STEPS`, with which the distance of two patches fits 32 bits.

    It is at most channels (SPAN steps)^2 patch^2 < 2^31; the sum of a patch's column then fits 16 bits.
    """
    return next(steps for steps in (FINE_STEPS, COARSE_STEPS, 2, 1) if channels * (SPAN * steps * patch) ** 2 < 1 << 31)


def to_grid(lab: np.ndarray, steps: int, used_up: bool = False) -> np.ndarray:
    """Lab on the grid; values outside are clamped.

    Parameters
    ----------
    lab : (..., channels) float
        L, a, b; three more for each further map of a material, or an unused fourth value.
    steps : int
        Steps per Lab unit.
    used_up : bool
        `lab` may be overwritten.

    Returns
    -------
    (..., channels) int16
    """
    low = np.resize(np.array(_LOW, np.float32), lab.shape[-1])
    grid = np.clip(lab, low, low + np.float32(SPAN), out=lab if used_up else None)
    grid *= np.float32(steps)
    return np.rint(grid, out=grid).astype(np.int16)


def mean_lab(sums: np.ndarray) -> np.ndarray:
    """Mean Lab from sums of `seen_on_grid`: (..., 4) int -> (..., 3) float32; 0 where nothing is opaque."""
    return (sums[..., :3] / (FINE_STEPS * np.maximum(sums[..., 3:], 1))).astype(np.float32)


def seen_on_grid(values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
    """Values of a `Lens`, (h, w, 4) float32 (overwritten), on the fine grid, (h, w, 4) int16; the fourth is opacity."""
    grid = to_grid(values, FINE_STEPS, used_up=True)
    grid[..., 3] = 1
    if opaque is not None:
        grid *= opaque[..., None]
    return grid
