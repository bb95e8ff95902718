# SPDX-License-Identifier: Apache-2.0
"""Tiles whose edges match each other in many ways: Wang tiles by synthesis with given borders.

CSHD03: Cohen, Shade, Hiller, Deussen, Wang Tiles for Image and Texture Generation, SIGGRAPH 2003. They cut four
diamonds of the exemplar together for each tile; here (departure) the strip of pixels along an edge belongs to the
edge's colour, and the inside of each tile is synthesized between its four strips. So what lies across an edge is always
the same pixels, and tiles can be as stationary as MJH17 makes them (whose section 5.4 suggests both together).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..errors import ImageError
from .guidance import Held
from .patchmatch import hash_at

TWO_COLOURS_FROM = 8  # tiles: every pair of upper and left colour then has two to choose from (CSHD03 section 3)

Make = Callable[[Held | None, int, bool], np.ndarray]
"""What synthesizes: (pixels that stay, number of the run, whether it tiles) -> places of the tile's pixels, packed."""


class Edges(NamedTuple):
    """The colours of a tile's edges."""

    north: int
    east: int
    south: int
    west: int

    def __str__(self) -> str:
        return "".join(f"{name[0]}{colour}" for name, colour in self._asdict().items())


def edges_of(count: int) -> list[Edges]:
    """The edges of a set of that many tiles.

    Fewer than `TWO_COLOURS_FROM` have one colour: any tile goes beside any other. From there on there are two, and the
    tiles with a given upper and left edge differ in the others as long as they can: 16 tiles are all there are.
    """
    if count < TWO_COLOURS_FROM:
        return [Edges(0, 0, 0, 0)] * count
    others = ((0, 0), (1, 1), (0, 1), (1, 0))
    return [Edges((n >> 1) & 1, others[(n >> 2) % 4][0], others[(n >> 2) % 4][1], n & 1) for n in range(count)]


def runs_for(count: int) -> int:
    """How often `wang_tiles` synthesizes for that many tiles."""
    return count + 1 + max(edges_of(count)[-1])


def wang_tiles(make: Make, count: int, width: int, height: int, strip: int) -> list[np.ndarray]:
    """Places of the tiles' pixels, in the order of `edges_of`.

    Parameters
    ----------
    make : callable
        Called first for textures that tile, one for each colour of edge, then for the tiles.
    count : int
    width, height : int
        Of a tile, px.
    strip : int
        How far the pixels of an edge reach into a tile, px.

    Raises
    ------
    ImageError
        The tile has no inside.
    """
    if min(width, height) < 4 * strip:
        raise ImageError(f"tiles of {width}x{height} px are too small for borders of {strip} px: they need {4 * strip}")
    edges = edges_of(count)
    textures = [make(None, 0, True)]
    if any(max(edge) > 0 for edge in edges):  # all corners are alike: four tiles of any colours meet there
        textures.append(make(Held(_border(width, height, strip, corners=True), textures[0]), 1, True))
    border = _border(width, height, strip)
    first = len(textures)
    return [make(Held(border, _bordered(textures, edge, strip)), first + n, False) for n, edge in enumerate(edges)]


def _border(width: int, height: int, strip: int, corners: bool = False) -> np.ndarray:
    """Where a tile's border is, or its corners alone: (height, width) bool."""
    y, x = np.ogrid[:height, :width]
    beside, above = (x < strip) | (x >= width - strip), (y < strip) | (y >= height - strip)
    return above & beside if corners else above | beside


def _bordered(textures: list[np.ndarray], edges: Edges, strip: int) -> np.ndarray:
    """Places of a tile's border pixels. Across each edge lies what lies across the border of that colour's texture."""
    places = textures[0].copy()
    places[:strip] = textures[edges.north][:strip]
    places[-strip:] = textures[edges.south][-strip:]
    inner = slice(strip, -strip)
    places[inner, :strip] = textures[edges.west][inner, :strip]
    places[inner, -strip:] = textures[edges.east][inner, -strip:]
    return places


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
