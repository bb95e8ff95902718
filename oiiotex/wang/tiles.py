# SPDX-License-Identifier: Apache-2.0
"""Sets of interchangeable tiles: Wang tiles by synthesis with given borders.

CSHD03: Cohen, Shade, Hiller, Deussen, Wang Tiles for Image and Texture Generation, SIGGRAPH 2003. They join four
diamonds of the exemplar for each tile. Here (departure) the strip of pixels along an edge belongs to the edge's color,
and the inside of each tile is synthesized between its four strips. So the pixels across an edge are always
the same, and tiles are as stationary as MJH17 makes them (its section 5.4 suggests combining both).
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
from ..patchmatch.constraints import FixedPixels
from .cut import joined

TWO_COLORS_FROM = 8  # number of tiles from which every pair of upper and left color has two choices (CSHD03 section 3)

Make = Callable[[FixedPixels | None, int, bool], SourceMap]
"""The synthesis: (fixed pixels, number of the run, whether the result tiles) -> source of each pixel of the tile."""


class Edges(NamedTuple):
    """The colors of a tile's edges."""

    north: int
    east: int
    south: int
    west: int

    def __str__(self) -> str:
        return "".join(f"{name[0]}{color}" for name, color in self._asdict().items())


def edges_of(count: int) -> list[Edges]:
    """The edges of each tile in a set.

    Below `TWO_COLORS_FROM` there is one color: any tile fits next to any other. From there on there are two colors, and
    tiles with the same upper and left edge differ in the others as long as possible: 16 tiles are the complete set.
    """
    if count < TWO_COLORS_FROM:
        return [Edges(0, 0, 0, 0)] * count
    others = ((0, 0), (1, 1), (0, 1), (1, 0))
    return [Edges((n >> 1) & 1, others[(n >> 2) % 4][0], others[(n >> 2) % 4][1], n & 1) for n in range(count)]


def runs_for(count: int) -> int:
    """Number of syntheses that `wang_tiles` runs for a number of tiles."""
    return count + 1 + max(edges_of(count)[-1])


def wang_tiles(
    make: Make, count: int, width: int, height: int, strip: int, values: Callable[[SourceMap], np.ndarray]
) -> list[SourceMap]:
    """The sources of the tiles' pixels, in the order of `edges_of`.

    Parameters
    ----------
    make : callable
        Called first for textures that tile, one for each edge color, then for the tiles.
    width, height : int
        Size of a tile, px.
    strip : int
        Width of an edge's strip inside a tile, px. It ends in a minimum-error cut, up to this much deeper.
    values : callable
        The working values of the photo at the sources, (height, width, channels) float.

    Raises
    ------
    ImageError
        The tile is too small for its strips.
    """
    if min(width, height) < 4 * strip:
        raise ImageError(
            f"tiles of {width}x{height} px are too small for border strips of {strip} px",
            expected=f"at least {4 * strip}x{4 * strip} px",
        )
    edges = edges_of(count)
    textures = [make(None, 0, True)]
    if any(max(edge) > 0 for edge in edges):  # all corners are alike: four tiles of any colors meet there
        textures.append(make(FixedPixels(_border(width, height, strip, corners=True), textures[0]), 1, True))
    border = _border(width, height, strip)
    first = len(textures)
    seen = [values(texture) for texture in textures]
    tiles = []
    for number, edge in enumerate(edges):
        tile = make(FixedPixels(border, _bordered(textures, edge, strip)), first + number, False)
        for color, turns in zip(edge, (1, 2, -1, 0), strict=True):  # rotated, so that the edge is at the left
            inside, along, ours, theirs = (
                np.rot90(pixels, turns)[strip:-strip, strip:-strip]
                for pixels in (tile.packed, textures[color].packed, values(tile), seen[color])
            )
            inside[:] = joined(inside, along, ours, theirs, strip)
        tiles.append(tile)
    return tiles


def _border(width: int, height: int, strip: int, corners: bool = False) -> np.ndarray:
    """The pixels of a tile's border, or of its corners only: (height, width) bool."""
    y, x = np.ogrid[:height, :width]
    beside, above = (x < strip) | (x >= width - strip), (y < strip) | (y >= height - strip)
    return above & beside if corners else above | beside


def _bordered(textures: list[SourceMap], edges: Edges, strip: int) -> SourceMap:
    """Sources of a tile's border pixels: strips along the borders of the edge colors' textures."""
    packed = textures[0].packed.copy()
    packed[:strip] = textures[edges.north].packed[:strip]
    packed[-strip:] = textures[edges.south].packed[-strip:]
    inner = slice(strip, -strip)
    packed[inner, :strip] = textures[edges.west].packed[inner, :strip]
    packed[inner, -strip:] = textures[edges.east].packed[inner, -strip:]
    return SourceMap(packed)


def edged(tile: Part, name: str, edges: str) -> Part:
    """The tile under its name in a set, with its edge colors as an attribute."""

    def mark(spec: oiio.ImageSpec) -> None:
        spec.attribute("oiio:subimagename", name)
        spec.attribute(EDGES, edges)

    return replace(tile.respecced(mark), name=name)
