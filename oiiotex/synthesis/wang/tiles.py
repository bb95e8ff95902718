# SPDX-License-Identifier: Apache-2.0
"""Sets of interchangeable tiles: Wang tiles by synthesis with given borders.

CSHD03: Cohen, Shade, Hiller, Deussen, Wang Tiles for Image and Texture Generation, SIGGRAPH 2003. They join four
diamonds of the exemplar for each tile. Here (departure) the strip of pixels along an edge belongs to the edge's color,
and the inside of each tile is synthesized between its four strips. So the pixels across an edge are always
the same, and tiles are as stationary as MJH17 makes them (its section 5.4 suggests combining both).

LD06: Lagae, Dutré, An Alternative for Wang Tiles: Colored Edges versus Colored Corners, ACM Transactions on Graphics
25(4), 2006. With two corner colors, corners differ, and an edge is one of four instead of two.

EF01: Efros, Freeman, Image Quilting for Texture Synthesis and Transfer, SIGGRAPH 2001, section 2.1: a minimum-error cut
ends each strip. A straight line would show wherever the inside does not continue the strip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from ...engine.core.attributes import EDGES
from ...engine.core.image import Part
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np, oiio
from ...engine.errors import ImageError
from ..patchmatch.constraints import FixedPixels

TWO_COLORS_FROM = 8  # number of tiles from which every pair of upper and left color has two choices (CSHD03 section 3)
COUNTS = (4, 16, 64)  # numbers of tiles that fill the square of an atlas whose side is a power of two
CORNERS_FROM = 16  # number of tiles for all combinations of four corners in two colors (LD06)

Make = Callable[[FixedPixels | None, int, bool], SourceMap]
"""The synthesis: (fixed pixels, number of the run, whether the result tiles) -> source of each pixel of the tile."""


class Edges(NamedTuple):
    """The colors of a tile's edges; between colored corners, 2 * (left or upper corner) + (right or lower corner)."""

    north: int
    east: int
    south: int
    west: int

    def __str__(self) -> str:
        return "".join(f"{name[0]}{color}" for name, color in self._asdict().items())


def edges_of(count: int) -> list[Edges]:
    """The edges of each tile in a set.

    Below `TWO_COLORS_FROM` there is one color: any tile fits next to any other. From there on there are two colors, and
    tiles with the same upper and left edge differ in the others as long as possible. From `CORNERS_FROM` on, corners
    have colors, and 16 tiles are the complete set.
    """
    if count >= CORNERS_FROM:
        return [between(*(n >> bit & 1 for bit in range(4))) for n in range(count)]
    if count < TWO_COLORS_FROM:
        return [Edges(0, 0, 0, 0)] * count
    others = ((0, 0), (1, 1), (0, 1), (1, 0))
    return [Edges((n >> 1) & 1, others[(n >> 2) % 4][0], others[(n >> 2) % 4][1], n & 1) for n in range(count)]


def between(upper_left: Any, upper_right: Any, lower_left: Any, lower_right: Any) -> Edges:
    """The edges between corners of these colors, integers or arrays."""
    return Edges(
        2 * upper_left + upper_right, 2 * upper_right + lower_right, 2 * lower_left + lower_right,
        2 * upper_left + lower_left,
    )  # fmt: skip


def runs_for(count: int) -> int:
    """Number of syntheses that `wang_tiles` runs for a number of tiles."""
    return count + (4 if count >= CORNERS_FROM else 2 if count >= TWO_COLORS_FROM else 1)


def wang_tiles(
    make: Make, count: int, width: int, height: int, strip: int, values: Callable[[SourceMap], np.ndarray]
) -> list[SourceMap]:
    """The sources of the tiles' pixels, in the order of `edges_of`.

    Parameters
    ----------
    make : callable
        Called first for the textures of the edges, then for the tiles.
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
    beside, above = _textures(make, count, width, height, strip)
    first = runs_for(count) - count
    seen = [[values(texture) for texture in textures] for textures in (beside, above)]
    border = border_pixels(width, height, strip)
    tiles = []
    for number, edges in enumerate(edges_of(count)):
        tile = make(FixedPixels(border, _bordered(beside, above, edges, strip)), first + number, False)
        sides = ((edges.north, 1, 1), (edges.east, 0, 2), (edges.south, 1, -1), (edges.west, 0, 0))
        for color, axis, turns in sides:  # rotated, so that the edge is at the left
            inside, along, ours, theirs = (
                np.rot90(pixels, turns)[strip:-strip, strip:-strip]
                for pixels in (tile.packed, (beside, above)[axis][color].packed, values(tile), seen[axis][color])
            )
            inside[:] = joined(inside, along, ours, theirs, strip)
        tiles.append(tile)
    return tiles


def _textures(make: Make, count: int, width: int, height: int, strip: int) -> tuple[list[SourceMap], list[SourceMap]]:
    """By edge color, textures whose strips along x = 0 and along y = 0 are those of the edges, on both sides."""
    textures = [make(None, 0, True)]
    if count < TWO_COLORS_FROM:
        return textures, textures
    if count < CORNERS_FROM:  # all corners are alike: four tiles of any colors meet there
        textures.append(make(FixedPixels(border_pixels(width, height, strip, corners=True), textures[0]), 1, True))
        return textures, textures
    textures.append(make(None, 1, True))
    beside, above = (_mixed(make, 2 + axis, textures, strip, axis) for axis in (1, 0))
    return [textures[0], *beside, textures[1]], [textures[0], *above, textures[1]]


def _mixed(make: Make, number: int, textures: list[SourceMap], strip: int, axis: int) -> list[SourceMap]:
    """Textures with the edges between corners 0 and 1, and 1 and 0, of two textures; axis 0: along y = 0.

    Both edges are synthesized in one image, at a quarter and at three quarters of its side, between their corners.
    """
    corners = [texture.packed if axis == 0 else texture.packed.T for texture in textures]
    height, width = corners[0].shape
    packed, fixed = corners[0].copy(), np.zeros((height, width), bool)
    places = (height // 4, 3 * height // 4)
    for place, first in zip(places, (0, 1), strict=True):
        rows, around = np.arange(place - strip, place + strip), np.arange(-strip, strip)
        for columns, color in ((slice(0, strip), first), (slice(width - strip, width), 1 - first)):
            packed[rows, columns] = corners[color][around, columns]
            fixed[rows, columns] = True
    if axis:
        packed, fixed = np.ascontiguousarray(packed.T), np.ascontiguousarray(fixed.T)
    made = make(FixedPixels(fixed, SourceMap(packed)), number, False)
    return [SourceMap(np.roll(made.packed, -place, axis)) for place in places]


def border_pixels(width: int, height: int, strip: int, corners: bool = False) -> np.ndarray:
    """The pixels of a tile's border, or of its corners only: (height, width) bool."""
    y, x = np.ogrid[:height, :width]
    beside, above = (x < strip) | (x >= width - strip), (y < strip) | (y >= height - strip)
    return above & beside if corners else above | beside


def _bordered(beside: list[SourceMap], above: list[SourceMap], edges: Edges, strip: int) -> SourceMap:
    """Sources of a tile's border pixels: strips along the borders of the edge colors' textures."""
    packed = beside[0].packed.copy()
    packed[:strip] = above[edges.north].packed[:strip]
    packed[-strip:] = above[edges.south].packed[-strip:]
    inner = slice(strip, -strip)
    packed[inner, :strip] = beside[edges.west].packed[inner, :strip]
    packed[inner, -strip:] = beside[edges.east].packed[inner, -strip:]
    return SourceMap(packed)


def edged(tile: Part, name: str, edges: str) -> Part:
    """The tile under its name in a set, with its edge colors as an attribute."""

    def mark(spec: oiio.ImageSpec) -> None:
        spec.attribute("oiio:subimagename", name)
        spec.attribute(EDGES, edges)

    return replace(tile.respecced(mark), name=name)


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
