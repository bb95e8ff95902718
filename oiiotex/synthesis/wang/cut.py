# SPDX-License-Identifier: Apache-2.0
"""The minimum-error cut between the strip along an edge and the inside of a tile.

EF01: Efros, Freeman, Image Quilting for Texture Synthesis and Transfer, SIGGRAPH 2001, section 2.1. Without it, the
strip ends in a straight line, which shows wherever the inside does not continue it.
"""

from __future__ import annotations

from ...engine.deferred import np


def depths(errors: np.ndarray) -> np.ndarray:
    """Where to cut, from the errors of a cut before each column of a band: (rows,) int.

    Parameters
    ----------
    errors : (rows, columns) float
        Neighboring rows are cut at most one column apart; the first and the last row before column 0.

    Returns
    -------
    (rows,) int
        The number of columns before the cut.
    """
    rows, columns = errors.shape
    cost, steps = np.full(columns, np.inf), np.zeros((rows, columns), np.int8)
    cost[0] = errors[0, 0]
    for y in range(1, rows):
        around = np.stack([np.r_[np.inf, cost[:-1]], cost, np.r_[cost[1:], np.inf]])
        best = around.argmin(axis=0)
        steps[y] = best - 1
        cost = around[best, np.arange(columns)] + errors[y]
    cut = np.zeros(rows, np.int64)
    for y in range(rows - 1, 0, -1):
        cut[y - 1] = cut[y] + steps[y, cut[y]]
    return cut


def joined(inside: np.ndarray, strip: np.ndarray, lab: np.ndarray, lab_strip: np.ndarray, band: int) -> np.ndarray:
    """A tile whose left strip extends into its inside up to a minimum-error cut.

    Parameters
    ----------
    inside, strip : (height, width) uint32
        Sources of the tile and of the texture along the edge, from the strip's inner border on, along the edge.
    lab, lab_strip : (height, width, 3) float32
        Their colors.
    band : int
        Maximum depth of the strip beyond its border, px.
    """
    # before the first column, both are the strip by constraint: the step there counts as that of the first column, or
    # the cut would follow the border at half the price
    gap = ((lab[:, :band] - lab_strip[:, :band]) ** 2).sum(-1)
    cut = depths(gap + np.pad(gap, ((0, 0), (1, 0)), "edge")[:, :-1])
    kept = np.arange(band) < cut[:, None]
    out = inside.copy()
    out[:, :band] = np.where(kept, strip[:, :band], inside[:, :band])
    return out
