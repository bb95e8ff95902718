# SPDX-License-Identifier: Apache-2.0
"""The integer grid of Lab on which everything is decided: equal Lab gives equal decisions on every device."""

from __future__ import annotations

from ..deferred import np

FINE_STEPS = 8  # steps per Lab unit
COARSE_STEPS = 4  # where sums of squares over a large patch must fit
SUM_STEPS = 64  # of values that are only added up: not held to SPAN
SPAN = 300  # Lab units that the grid reaches along every axis
_LOW = (-16.0, -150.0, -150.0)


def steps_for(patch: int, channels: int = 3) -> int:
    """Steps per Lab unit, `FINE_STEPS` at most, such that the distance of two patches fits 32 bits.

    It is at most channels (SPAN steps)^2 patch^2 < 2^31; the sum of a patch's column then fits 16 bits.
    """
    return next(steps for steps in (FINE_STEPS, COARSE_STEPS, 2, 1) if channels * (SPAN * steps * patch) ** 2 < 1 << 31)


def to_grid(lab: np.ndarray, steps: int, used_up: bool = False) -> np.ndarray:
    """Lab on the grid; what lies outside is taken as the nearest.

    Parameters
    ----------
    lab : (..., channels) float
        L, a, b; three more for each further map of a material, or a fourth that means nothing.
    steps : int
        Per Lab unit.
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
    """Lab of what `seen_on_grid` gives, added up: (..., 4) int -> (..., 3) float32; 0 where nothing is opaque."""
    return (sums[..., :3] / (FINE_STEPS * np.maximum(sums[..., 3:], 1))).astype(np.float32)


def seen_on_grid(values: np.ndarray, opaque: np.ndarray | None) -> np.ndarray:
    """What a `Lens` shows, (h, w, 4) float32, which is used up, on the fine grid.

    Returns (h, w, 4) int16.
    """
    grid = to_grid(values, FINE_STEPS, used_up=True)
    grid[..., 3] = 1
    if opaque is not None:
        grid *= opaque[..., None]
    return grid
