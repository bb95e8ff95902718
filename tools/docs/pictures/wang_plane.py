# SPDX-License-Identifier: Apache-2.0
"""Planes of Wang tiles, for pictures."""

from __future__ import annotations

import numpy as np

from oiiotex.synthesis.patchmatch.field import hash_at
from oiiotex.synthesis.wang.tiles import Edges


def random_plane(edges: list[Edges], rows: int, columns: int, seed: int) -> np.ndarray:
    """Tiles that fit each other, drawn row by row: (rows, columns) indices into `edges`, the same for a seed."""
    plane = np.empty((rows, columns), np.int64)
    for y in range(rows):
        for x in range(columns):
            north = None if y == 0 else edges[plane[y - 1, x]].south
            west = None if x == 0 else edges[plane[y, x - 1]].east
            fits = [n for n, e in enumerate(edges) if north in (None, e.north) and west in (None, e.west)]
            bits = int(hash_at(seed, 0x3A96, np.array([y]), np.array([x]))[0])
            plane[y, x] = fits[bits * len(fits) >> 32]
    return plane
