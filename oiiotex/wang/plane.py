# SPDX-License-Identifier: Apache-2.0
"""An unbounded plane of Wang tiles, with random access.

CSHD03 (Cohen, Shade, Hiller, Deussen, Wang Tiles for Image and Texture Generation, SIGGRAPH 2003) place tiles row by
row, so that each depends on the ones above and to the left. Departure: edge colors are hashed from their positions
(Wei, Tile-Based Texture Mapping on Graphics Hardware, 2004), so a tile does not depend on its neighbors. This requires
a tile for every combination of four edge colors: interchangeable tiles, or the complete set.
"""

from __future__ import annotations

import itertools
import re

from ..core.attributes import EDGES, TAG
from ..core.image import Image, Part
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError
from ..patchmatch.field import hash_at
from .tiles import TWO_COLORS_FROM, Edges

_UP, _LEFT, _CHOICE = 0x71E1, 0x71E2, 0x71E3  # hash streams: edge above, edge to the left, choice of tile
_EDGES = re.compile(r"n(\d{1,3})e(\d{1,3})s(\d{1,3})w(\d{1,3})", re.ASCII)


class TilePlane:
    """The plane covered with tiles."""

    def __init__(self, tiles: Image, seed: int):
        first = tiles.first.spec
        self._width, self._height, self._seed = first.width, first.height, seed
        kind = _kind(first)
        self._fits: dict[Edges, list[Part]] = {}
        for part in tiles.parts:
            if _kind(part.spec) != kind:
                raise ImageError(
                    f"{tiles.source}: part '{part.name}' must have the size, type and color space of the first tile"
                )
            self._fits.setdefault(_edges(part, tiles.source), []).append(part)
        if len(tiles.parts) >= TWO_COLORS_FROM and not any(map(_edge_text, tiles.parts)):
            raise ImageError(
                f"{tiles.source}: {len(tiles.parts)} tiles without edge colors (attribute {EDGES}); write the set as"
                " EXR, which keeps them"
            )
        self._colors = 1 + max(itertools.chain(*self._fits))
        every = (Edges(*colors) for colors in itertools.product(range(self._colors), repeat=4))
        lacking = next((edges for edges in every if edges not in self._fits), None)
        if lacking is not None:
            raise ImageError(
                f"{tiles.source}: {len(tiles.parts)} tiles are not a complete set: none has the edges {lacking};"
                " make it with variants=2 to 7, or 16 and more"
            )

    def pixels(self, place: Window) -> np.ndarray:
        """The pixels of a window, (height, width, channels)."""
        columns = range(place.left // self._width, -(-place.right // self._width))
        rows = range(place.top // self._height, -(-place.bottom // self._height))
        strips = []
        for row in rows:
            pieces = []
            for column in columns:
                tile = Window.sized(self._width * column, self._height * row, self._width, self._height)
                inside = (tile & place).shifted(-tile.left, -tile.top)
                part = self._at(column, row)
                pieces.append(part.read(inside.shifted(part.window.left, part.window.top)))
            strips.append(np.concatenate(pieces, axis=1))
        return np.concatenate(strips)

    def _at(self, x: int, y: int) -> Part:
        north, south = (self._drawn(_UP, x, row, self._colors) for row in (y, y + 1))
        west, east = (self._drawn(_LEFT, column, y, self._colors) for column in (x, x + 1))
        fits = self._fits[Edges(north, east, south, west)]
        return fits[self._drawn(_CHOICE, x, y, len(fits))]

    def _drawn(self, what: int, x: int, y: int, count: int) -> int:
        """A random index below `count`, hashed from a position."""
        bits = int(hash_at(self._seed, what, np.array([y]), np.array([x]))[0])
        return bits * count >> 32


def _kind(spec: oiio.ImageSpec) -> tuple[object, ...]:
    """The properties that all tiles must share."""
    return spec.width, spec.height, spec.nchannels, spec.format, spec.get_string_attribute(TAG)


def _edge_text(part: Part) -> str:
    return str(part.spec.get_string_attribute(EDGES))


def _edges(part: Part, source: str) -> Edges:
    text = _edge_text(part) or "n0e0s0w0"
    match = _EDGES.fullmatch(text)
    if match is None:
        raise ImageError(f"{source}: part '{part.name}': {EDGES}={text}: expected edge colors such as n0e1s1w0")
    return Edges(*map(int, match.groups()))
