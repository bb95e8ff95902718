# SPDX-License-Identifier: Apache-2.0
"""SLIC's choice of seeds and LSA16's algorithm 1, as the equations say them."""

from __future__ import annotations

import itertools

import numpy as np


def choices(lab: np.ndarray, candidates: np.ndarray, row_edges, column_edges, shift: int, allowed=True) -> np.ndarray:
    """Slots of (h, w, 4) int16 pixels: the first of the nine whose linear function is least. Plain integers.

    `allowed` (9, h, w): which of the nine a pixel may choose.
    """
    allowed = np.broadcast_to(allowed, (9, *lab.shape[:2]))
    slots = np.full(lab.shape[:2], 255)
    for j, (top, bottom) in enumerate(itertools.pairwise(row_edges)):
        for i, (left, right) in enumerate(itertools.pairwise(column_edges)):
            v = lab[top:bottom, left:right].astype(np.int64)
            y, x = np.mgrid[top:bottom, left:right]
            y, x = (y - (top + bottom) // 2) << shift, (x - (left + right) // 2) << shift
            values = []
            for base, la, bx, cy in candidates[j * (len(column_edges) - 1) + i].tolist():
                cl, ca, cb, cx = (np.array([la & 0xFFFF, la >> 16, bx & 0xFFFF, bx >> 16]).astype(np.int16)).tolist()
                values.append(base + cl * v[..., 0] + ca * v[..., 1] + cb * v[..., 2] + cx * x + cy * y)
            values = np.where(allowed[:, top:bottom, left:right], values, np.iinfo(np.int64).max)
            slots[top:bottom, left:right] = np.where(v[..., 3] > 0, np.argmin(values, 0), 255)
    return slots


def distances(lab: np.ndarray, centers: np.ndarray, weight: float) -> np.ndarray:
    """LSA16 eq. 1, squared, in squared steps: (seeds, h, w) of (h, w, 4) pixels and (seeds, 5) centers."""
    y, x = np.mgrid[0 : lab.shape[0], 0 : lab.shape[1]]
    found = []
    for c in centers:
        color = ((lab[..., :3] - c[:3]) ** 2).sum(-1)
        found.append(color + weight * ((x - c[3]) ** 2 + (y - c[4]) ** 2))
    return np.stack(found)


def merged(sizes, positions, edges, sigmas, levels) -> tuple[list, list]:
    """Algorithm 1 with eq. 2 as printed: merges in order, and how many are left at each level."""
    members = {i: [i] for i in range(len(sizes))}
    edges = {tuple(e) for e in edges.tolist()}
    merges, counts = [], [len(sizes)]
    for sigma, sums in zip(sigmas[1:], levels, strict=True):

        def mean(parts, sums=sums):
            n = sizes[parts].sum()
            return n, sums[parts].sum(0) / n, (positions[parts] * sizes[parts, None]).sum(0) / n

        def cost(edge, sigma=sigma, mean=mean):
            one, other = members[edge[0]], members[edge[1]]
            _, color, place = mean(one + other)
            total = 0.0
            for part in (one, other):
                n, c, p = mean(part)
                total += n * (((c - color) ** 2).sum() + ((p - place) ** 2).sum() / sigma**2)
            return total

        while len(members) > int(sizes.sum() / sigma**2) and edges:
            a, b = min(edges, key=lambda e: (cost(e), e))
            merges.append((a, b))
            members[a] += members.pop(b)
            moved = {tuple(sorted((a if u == b else u, a if v == b else v))) for u, v in edges}
            edges = {e for e in moved if e[0] != e[1]}
        counts.append(len(members))
    return merges, counts
