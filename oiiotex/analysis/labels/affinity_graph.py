# SPDX-License-Identifier: Apache-2.0
"""A sparse similarity graph of superpixels.

LSA16 section 4.1: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for
Texture Synthesis, SIGGRAPH 2016. Departures from the paper:

1. The walk's matrix derives from a symmetric one, W = (K + K^T) / 2, so the chain is reversible: its spectrum is real,
   and a power of it is a product of two thin matrices.
2. Nearest neighbors are exact. Points lie on a grid on which squared distances are integers of 31 bits, so the graph
   is the same on every device.
3. Equal points are one node with a multiplicity, so that flat images have distinct neighbors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...engine.core.elementary import exponential
from ...engine.opencl.buffers import Buffers
from ...engine.session.resources import Resources
from .products import TASK, Sparse

NEIGHBORS = 256  # of a node in the graph: LSA16 section 4.1
_FINEST_GRID = 1024.0
_FARTHEST = 46340.0  # grid steps: its square fits 31 bits
_FINEST = 0.1  # least local scale, so that invisible differences are not amplified
_LARGEST_R = 6.0  # of r in eq. 5: points 20 local scales apart stay separate, even with no points between
_BLOCK = 32  # points per block of a kernel
_SCRATCH = 1 << 22  # distances held at once
_BINS_PER_OCTAVE_BITS = 7  # of relative distances, in the search for r


class Nearest(NamedTuple):
    """Neighbors of n points.

    `scales` (n,) int32: squared distance to the sixth closest point, copies included; 0 where more points than that
    are equal.
    """

    indices: np.ndarray  # (n, k) int32, ascending
    squared: np.ndarray  # (n, k) int32: squared distances to them
    scales: np.ndarray


@dataclass(frozen=True)
class AffinityGraph:
    """The similarity graph of m points, with equal points merged: n nodes.

    `scaled`: T^-1/2 W T^-1/2, (n, n), symmetric: W holds similarities between nodes, multiplied by their
    multiplicities, and T its column sums.
    """

    scaled: Sparse
    mass: np.ndarray  # (n,) float64: column sums, proportional to the stationary distribution of the walk
    node: np.ndarray  # (m,) int64: the node of each point
    counts: np.ndarray  # (n,) int64: number of points of each node
    r: float  # Global normalization of LSA16 eq. 5


def similarity_graph(points: np.ndarray, neighbors: int, resources: Resources) -> AffinityGraph:
    """LSA16 eq. 4 and 5 over the nearest neighbors of m points in d dimensions, (m, d) float."""
    steps, unit = on_grid(points)
    nodes, node, counts = np.unique(steps, axis=0, return_inverse=True, return_counts=True)
    node, n = node.reshape(-1), len(nodes)
    counts = counts.astype(np.int64)
    if n == 1:
        one = Sparse(np.array([0, 1], np.int32), np.zeros(1, np.int32), np.ones(1, np.float32))
        return AffinityGraph(one, counts.astype(np.float64) ** 2, node, counts, 0.0)
    near = nearest(nodes, min(neighbors, n - 1), resources, counts)
    scale = np.sqrt(near.scales.astype(np.float64))
    scale = np.maximum(scale, max(_FINEST * unit, 1e-3 * float(scale.max())))
    r = _global_scale(near, scale, counts)
    edges, squared, shares = _symmetric(near, counts)
    scaled, mass = _weighted(edges, squared, shares, 1.0 / scale, r, resources)
    return AffinityGraph(scaled, mass, node, counts, r)


def on_grid(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Points as integer steps from their mean, (m, d) int16, and the number of steps per unit.

    The grid is as fine as the range of int16 allows for the farthest point.
    """
    away = points - points.mean(0)
    reach = 2.0 * math.sqrt(float((away**2).sum(1).max())) + 1e-9
    slack = math.sqrt(points.shape[1])  # rounding
    unit = min(_FINEST_GRID, 2.0 ** (math.frexp((_FARTHEST - slack) / reach)[1] - 1))
    return np.rint(away * unit).astype(np.int16), unit


def nearest(points: np.ndarray, count: int, resources: Resources, copies: np.ndarray | None = None) -> Nearest:
    """The `count` nearest others of each point; ties go to the lower index.

    Brute force, two coordinates per multiplication: from 15 dimensions on, a tree visits nearly all points as well.

    `points` (n, d) int16; `copies` (n,) int.
    """
    device, (n, d) = resources.device, points.shape
    width, pairs = -(-n // _BLOCK) * _BLOCK, -(-d // 2)
    paired = np.zeros((pairs, width, 2), np.int16)
    even = np.pad(points, ((0, 0), (0, d % 2))).reshape(n, pairs, 2)
    paired[:, :n] = even.transpose(1, 0, 2)
    copies = np.ones(n, np.int32) if copies is None else copies.astype(np.int32)
    rows = min(n, max(1, _SCRATCH // width))
    layout = {"distances": 4 * rows * width, "index": 4 * n * count, "squared": 4 * n * count, "scales": 4 * n}
    run = device.program("affinity")
    with Buffers(device, layout, resources.budget, TASK, tables={"points": paired, "copies": copies}) as buffers:
        tables = [buffers[name] for name in ("points", "copies", *layout)]
        for first in range(0, n, rows):
            run("nearest", (rows,), *tables, n, width, pairs, count, first, rows, group=8)
        index, squared = (device.read(buffers[name], (n, count), np.int32) for name in ("index", "squared"))
        return Nearest(index, squared, device.read(buffers["scales"], (n,), np.int32))


def _global_scale(near: Nearest, scale: np.ndarray, counts: np.ndarray) -> float:
    """The r at which the sum of similarities grows fastest: LSA16 eq. 5.

    Relative distances are counted in bins of 1/128 octave, found by shifting their bits.
    """
    relative = near.squared / (scale[:, None] * scale[near.indices])
    shares = counts[:, None] * counts[near.indices].astype(np.float64)
    diagonal = float((counts.astype(np.float64) ** 2).sum())
    shift = 52 - _BINS_PER_OCTAVE_BITS
    bins = relative.ravel().view(np.int64) >> shift
    least = int(bins.min())
    totals = np.bincount(bins - least, shares.ravel())  # integers
    found = np.flatnonzero(totals)
    middle = ((found + least << shift) + (1 << shift - 1)).astype(np.int64).view(np.float64)
    totals = totals[found]

    def slope(r: float) -> float:
        scaled = middle * float(exponential(np.array(-r)))
        similar = exponential(-scaled) * totals
        return -float((scaled * similar).sum() / (diagonal + similar.sum()))

    r = min(np.arange(-6.0, _LARGEST_R, 0.5).tolist(), key=slope)
    for step in (0.5, 0.1, 0.02):  # vertex of a parabola through three values
        low, middle_slope, high = slope(r - step), slope(r), slope(r + step)
        bend = low - 2.0 * middle_slope + high
        if bend > 0:
            r += float(np.clip(0.5 * (low - high) / bend, -1.0, 1.0)) * step
    return min(r, _LARGEST_R)


def _symmetric(near: Nearest, counts: np.ndarray) -> tuple[Sparse, np.ndarray, np.ndarray]:
    """Edges to the neighbors of each node and to nodes whose neighbor it is, itself first, without weights; squared
    distances; and factors.

    A factor is 1 for mutual neighbors, else a half, times the multiplicities.
    """
    n, k = near.indices.shape
    mutual = _mutual(near)
    row, place = np.nonzero(~mutual)
    others = near.indices[row, place]
    order = np.argsort(others.astype(np.uint16 if n <= 1 << 16 else np.int32), kind="stable")
    row, place, others = row[order], place[order], others[order]
    lengths = 1 + k + np.bincount(others, minlength=n)
    starts = np.concatenate([[0], lengths.cumsum()]).astype(np.int32)
    columns, squared = np.empty(starts[-1], np.int32), np.zeros(starts[-1], np.int32)
    shares = np.ones(starts[-1], np.float32)
    own = starts[:-1]
    forward = own[:, None] + np.arange(1, k + 1, dtype=np.int32)
    backward = own[others] + 1 + k + (np.arange(len(others)) - np.searchsorted(others, np.arange(n))[others])
    columns[own], columns[forward], columns[backward] = np.arange(n), near.indices, row
    squared[forward], squared[backward] = near.squared, near.squared[row, place]
    shares[forward], shares[backward] = np.where(mutual, np.float32(1), np.float32(0.5)), 0.5
    if int(counts.max()) > 1:
        shares *= np.repeat(counts, lengths).astype(np.float32) * counts[columns].astype(np.float32)
    return Sparse(starts, columns, shares), squared, shares


def _mutual(near: Nearest) -> np.ndarray:
    """Whether a node is among the neighbors of each of its neighbors, (n, k) bool.

    It is if it is closer than the farthest of them, or as far and no later than the last of these.
    """
    rows, farthest = np.arange(len(near.indices), dtype=np.int32)[:, None], near.squared.max(1)
    last = np.where(near.squared == farthest[:, None], near.indices, -1).max(1)
    others = farthest[near.indices]
    return (near.squared < others) | ((near.squared == others) & (rows <= last[near.indices]))


def _weighted(
    edges: Sparse, squared: np.ndarray, shares: np.ndarray, near: np.ndarray, r: float, resources: Resources
) -> tuple[Sparse, np.ndarray]:
    """LSA16 eq. 4 for all edges, symmetrized by the column sums; and these sums."""
    device, n = resources.device, edges.rows
    run = device.program("affinity")
    tables = {
        "starts": edges.starts, "columns": edges.columns, "squared": squared, "shares": shares,
        "near": near.astype(np.float32),
    }  # fmt: skip
    layout = {"weights": shares.nbytes, "mass": 4 * n}
    with Buffers(device, layout, resources.budget, TASK, tables=tables) as buffers:
        sharpness = float(exponential(np.array(-r)))
        run("similar", (n,), *(buffers[name] for name in (*tables, *layout)), n, sharpness)
        mass = device.read(buffers["mass"], (n,), np.float32).astype(np.float64)
        less = device.upload((1.0 / np.sqrt(mass)).astype(np.float32))
        run("scaled", (n,), buffers["starts"], buffers["columns"], less, buffers["weights"], n)
        weights = device.read(buffers["weights"], shares.shape, np.float32)
    return Sparse(edges.starts, edges.columns, weights), mass
