# SPDX-License-Identifier: Apache-2.0
"""Neighbors, projections, Potts fields and pooled counts as their equations say them: the oracles of labels/."""

from __future__ import annotations

import numpy as np


def nearest(points: np.ndarray, count: int, copies: np.ndarray, local: int) -> tuple[np.ndarray, ...]:
    """Indices in rising order, squared distances, and the squared distance to the `local`th closest point."""
    points = points.astype(np.int64)
    apart = ((points[:, None] - points) ** 2).sum(-1)
    np.fill_diagonal(apart, 1 << 40)
    order = np.argsort(apart, axis=1, kind="stable")[:, :count]
    scales = []
    for i, near in enumerate(order):
        seen = copies[i] - 1 + np.cumsum(copies[near])
        reached = np.append(np.flatnonzero(seen >= local), count - 1)[0]
        scales.append(0 if copies[i] > local else apart[i, near[reached]])
    index = np.sort(order, axis=1)
    return index, np.take_along_axis(apart, index, 1), np.array(scales)


def on_simplex(rows: np.ndarray) -> np.ndarray:
    """The nearest non-negative rows that add up to 1 (Held, Wolfe, Crowder 1974)."""
    falling = -np.sort(-rows, axis=1)
    thresholds = (np.cumsum(falling, axis=1) - 1.0) / np.arange(1, rows.shape[1] + 1)
    last = (falling > thresholds).sum(1) - 1
    return np.maximum(rows - thresholds[np.arange(len(rows)), last][:, None], 0.0)


def memberships(quadratic: np.ndarray, linear: np.ndarray, steps: int = 20000) -> np.ndarray:
    """Rows on the simplex that minimize x Q x^T / 2 - x c^T, by steps down the slope."""
    x = np.full(linear.shape, 1.0 / linear.shape[1])
    for _ in range(steps):
        x = on_simplex(x - (x @ quadratic - linear) / np.linalg.norm(quadratic, 2))
    return x


def distributions(start: np.ndarray, quadratic: np.ndarray, linear: np.ndarray, steps: int) -> np.ndarray:
    """`steps` of FISTA from F (n, r)."""
    at = ahead = start.T
    t = 1.0
    for _ in range(steps):
        new = on_simplex(ahead - (quadratic @ ahead - linear) / np.linalg.norm(quadratic, 2))
        following = (1.0 + np.sqrt(1.0 + 4.0 * t * t)) / 2.0
        at, ahead, t = new, new + (t - 1.0) / following * (new - at), following
    return at.T


def settled(likely: np.ndarray, edges: np.ndarray, coupling: float, updates: int, unlikely: float) -> np.ndarray:
    """The mean field of a Potts model on a graph: (r, n) -> (r, n)."""
    near = np.zeros((likely.shape[1],) * 2)
    near[edges[:, 0], edges[:, 1]] = near[edges[:, 1], edges[:, 0]] = 1.0
    near /= np.maximum(near.sum(1, keepdims=True), 1.0)
    member = likely
    for _ in range(updates):
        pull = np.log(likely + unlikely) + coupling * member @ near.T
        member = np.exp(pull - pull.max(0))
        member /= member.sum(0)
    return member


def pooled(counts: np.ndarray, positions: np.ndarray, sigma: float, reach: float) -> np.ndarray:
    """Counts with those of what is near, by a Gaussian of distance."""
    apart = np.sqrt(((positions[:, None] - positions) ** 2).sum(-1)) / sigma
    return (np.exp(-(apart**2) / 2) * (apart <= reach)) @ counts
