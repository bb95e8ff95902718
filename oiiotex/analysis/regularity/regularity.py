# SPDX-License-Identifier: Apache-2.0
"""The regularity of a photo or a tile on a lattice."""

from __future__ import annotations

from ...engine.deferred import np
from .autocorrelation import Autocorrelation, autocorrelation, high_passed, wrapped_autocorrelation
from .lattice import Lattice


def peaks_over_floor(values: np.ndarray, lattice: Lattice, wraps: bool) -> np.ndarray:
    """The normalized autocorrelation at the lattice's first three vectors, minus its mean over the cell around each.

    Parameters
    ----------
    values : (height, width, channels) float32
        CIE Lab.
    lattice : Lattice
        Lattice of these pixels.
    wraps : bool
        The image is a torus.

    Returns
    -------
    (3,) float64
        NaN at a vector that is too long for the image.
    """
    if wraps:
        likeness = wrapped_autocorrelation(values)
    else:
        everywhere = np.ones(values.shape[:2], bool)
        likeness = autocorrelation(high_passed(values.astype(np.float64), everywhere), everywhere)
    return np.array([_peak_over_floor(likeness, lattice, vector) for vector in lattice.first_vectors()])


def _peak_over_floor(likeness: Autocorrelation, lattice: Lattice, vector: np.ndarray) -> float:
    """The value at the pixels nearest to a vector: fractions of a pixel are not resolved."""
    x, y = (grid - at for grid, at in zip(likeness.offsets(), vector, strict=True))
    phases = [np.abs(x * fx + y * fy) for fx, fy in lattice.frequencies]
    if lattice.rank == 1:  # a square around it
        phases.append(np.abs(y * lattice.frequencies[0, 0] - x * lattice.frequencies[0, 1]))
    says = likeness.weight > 0
    cell = says & (np.maximum(*phases) <= 0.5)
    near = says & (np.maximum(np.abs(x), np.abs(y)) < 1.5)
    return float(likeness.ncc[near].max() - likeness.ncc[cell].mean()) if near.any() else float("nan")
