# SPDX-License-Identifier: Apache-2.0
"""An atlas: all tiles of a set in one image, so that filtering across its borders is right.

Wei04: Wei, Tile-Based Texture Mapping on Graphics Hardware, Graphics Hardware 2004. Neighbors in the atlas share an
edge, also across the image's borders, so a filter that reads past a tile's border reads what lies there in the plane.
"""

from __future__ import annotations

import itertools
import math
import re

from ...engine.core.attributes import ATLAS
from ...engine.core.image import Image, Part, derived_spec
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ImageError
from .tiles import COUNTS, Edges, between, border_pixels, edges_of

CORNERS = ("0010", "0001", "0111", "1011")  # on a torus, every square of four corners occurs once
_GRID = re.compile(r"(\d{1,2})x(\d{1,2})", re.ASCII)


def atlas_edges(count: int) -> list[list[Edges]]:
    """The edges of the tiles of an atlas by row and column.

    Wei04 orders edge colors so that every combination occurs once. For corner colors, `CORNERS` does so.
    """
    side = math.isqrt(count)
    corners = [[int(color) if count > COUNTS[0] else 0 for color in row] for row in CORNERS]

    def corner(y: int, x: int) -> int:
        return corners[y % side % len(corners)][x % side % len(corners)]

    return [
        [between(corner(y, x), corner(y, x + 1), corner(y + 1, x), corner(y + 1, x + 1)) for x in range(side)]
        for y in range(side)
    ]


def atlas_numbers(count: int) -> np.ndarray:
    """The tiles of a set in its atlas: (side, side) indices into `edges_of(count)`."""
    left: dict[Edges, list[int]] = {}
    for number, edges in enumerate(edges_of(count)):
        left.setdefault(edges, []).append(number)
    return np.array([[left[edges].pop(0) for edges in row] for row in atlas_edges(count)])


def packed(tiles: list[SourceMap]) -> SourceMap:
    """The sources of an atlas's pixels, from those of the tiles of a set."""
    return SourceMap(np.block([[tiles[n].packed for n in row] for row in atlas_numbers(len(tiles)).tolist()]))


def shared_pixels(atlas: SourceMap, count: int, strip: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of an atlas that belong to one edge of the plane: pairs of flat indices, (n,) int64 each.

    They lie in two tiles, at the same place within `strip` px of the border, and have the same source.
    """
    side = math.isqrt(count)
    height, width = (length // side for length in atlas.packed.shape)

    def by_tile(pixels: np.ndarray) -> np.ndarray:
        tiles = pixels.reshape(side, height, side, width).swapaxes(1, 2).reshape(count, height, width)
        return tiles[:, border_pixels(width, height, strip)]

    sources, places = by_tile(atlas.packed), by_tile(np.arange(atlas.packed.size).reshape(atlas.packed.shape))
    pairs = [
        (places[first][same], places[second][same])
        for first, second in itertools.combinations(range(count), 2)
        if (same := sources[first] == sources[second]).any()
    ]
    first, second = (np.concatenate(ends) for ends in zip(*pairs, strict=True))
    return first, second


def mark_as_atlas(part: Part, count: int) -> Part:
    """The part, with its number of columns and rows as an attribute."""
    side = len(atlas_edges(count))
    return part.respecced(lambda spec: spec.attribute(ATLAS, f"{side}x{side}"))


def atlas_side(spec: oiio.ImageSpec) -> int:
    """The number of tiles along a side of an image; 0 if it is not an atlas."""
    match = _GRID.fullmatch(spec.get_string_attribute(ATLAS))
    side = int(match[1]) if match and match[1] == match[2] else 0
    fits = side * side in COUNTS and not (spec.width % side or spec.height % side)
    return side if fits else 0


def tiles_of(tiles: Image) -> list[tuple[Part, Window]]:
    """The tiles of an atlas in the order of `edges_of`, or each part of a set: a part and a window of it."""
    first = tiles.first
    side = atlas_side(first.spec)
    if not side:
        return [(part, part.window) for part in tiles.parts]
    if len(tiles.parts) > 1:
        raise ImageError(f"{tiles.source}: an atlas must be the only part of its file")
    width, height = first.spec.width // side, first.spec.height // side
    corner = Window.sized(first.window.left, first.window.top, width, height)
    places = np.argsort(atlas_numbers(side * side).ravel()).tolist()
    return [(first, corner.shifted(place % side * width, place // side * height)) for place in places]


def first_tile(atlas: Image) -> Image:
    """A tile of an atlas that joins itself: all its edges have the first color."""
    part, window = tiles_of(atlas)[0]
    spec = derived_spec(part.spec, *window.size)
    spec.erase_attribute(ATLAS)
    tile = Part(part.name, spec, lambda place: part.read(place.shifted(window.left, window.top)), part.stored)
    return Image((tile,), atlas.source)
