# SPDX-License-Identifier: Apache-2.0
"""Tiles whose edges match each other in many ways: Wang tiles by synthesis with given borders.

CSHD03: Cohen, Shade, Hiller, Deussen, Wang Tiles for Image and Texture Generation, SIGGRAPH 2003. They cut four
diamonds of the exemplar together for each tile; here (departure) the strip of pixels along an edge belongs to the
edge's color, and the inside of each tile is synthesized between its four strips. So what lies across an edge is always
the same pixels, and tiles can be as stationary as MJH17 makes them (whose section 5.4 suggests both together).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from ..core.attributes import EDGES
from ..core.image import Part
from ..core.source_map import SourceMap
from ..deferred import np, oiio
from ..errors import ImageError
from .constraints import FixedPixels

TWO_COLORS_FROM = 8  # tiles: every pair of upper and left color then has two to choose from (CSHD03 section 3)

Make = Callable[[FixedPixels | None, int, bool], SourceMap]
"""What synthesizes: (pixels that stay, number of the run, whether it tiles) -> where the tile's pixels come from."""


class Edges(NamedTuple):
    """The colors of a tile's edges."""

    north: int
    east: int
    south: int
    west: int

    def __str__(self) -> str:
        return "".join(f"{name[0]}{color}" for name, color in self._asdict().items())


def edges_of(count: int) -> list[Edges]:
    """The edges of a set of that many tiles.

    Fewer than `TWO_COLORS_FROM` have one color: any tile goes beside any other. From there on there are two, and the
    tiles with a given upper and left edge differ in the others as long as they can: 16 tiles are all there are.
    """
    if count < TWO_COLORS_FROM:
        return [Edges(0, 0, 0, 0)] * count
    others = ((0, 0), (1, 1), (0, 1), (1, 0))
    return [Edges((n >> 1) & 1, others[(n >> 2) % 4][0], others[(n >> 2) % 4][1], n & 1) for n in range(count)]


def runs_for(count: int) -> int:
    """How often `wang_tiles` synthesizes for that many tiles."""
    return count + 1 + max(edges_of(count)[-1])


def wang_tiles(make: Make, count: int, width: int, height: int, strip: int) -> list[SourceMap]:
    """Where the tiles' pixels come from, in the order of `edges_of`.

    Parameters
    ----------
    make : callable
        Called first for textures that tile, one for each color of edge, then for the tiles.
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
    if any(max(edge) > 0 for edge in edges):  # all corners are alike: four tiles of any colors meet there
        textures.append(make(FixedPixels(_border(width, height, strip, corners=True), textures[0]), 1, True))
    border = _border(width, height, strip)
    first = len(textures)
    fixed = (FixedPixels(border, _bordered(textures, edge, strip)) for edge in edges)
    return [make(pixels, first + n, False) for n, pixels in enumerate(fixed)]


def _border(width: int, height: int, strip: int, corners: bool = False) -> np.ndarray:
    """Where a tile's border is, or its corners alone: (height, width) bool."""
    y, x = np.ogrid[:height, :width]
    beside, above = (x < strip) | (x >= width - strip), (y < strip) | (y >= height - strip)
    return above & beside if corners else above | beside


def _bordered(textures: list[SourceMap], edges: Edges, strip: int) -> SourceMap:
    """Sources of a tile's border pixels. Across each edge lies what lies across the border of that color's texture."""
    packed = textures[0].packed.copy()
    packed[:strip] = textures[edges.north].packed[:strip]
    packed[-strip:] = textures[edges.south].packed[-strip:]
    inner = slice(strip, -strip)
    packed[inner, :strip] = textures[edges.west].packed[inner, :strip]
    packed[inner, -strip:] = textures[edges.east].packed[inner, -strip:]
    return SourceMap(packed)


def edged(tile: Part, name: str, edges: str) -> Part:
    """The tile under its name in a set, with the colors of its edges as an attribute."""

    def mark(spec: oiio.ImageSpec) -> None:
        spec.attribute("oiio:subimagename", name)
        spec.attribute(EDGES, edges)

    return replace(tile.respecced(mark), name=name)
