# SPDX-License-Identifier: Apache-2.0
"""A plane without end of tiles that fit each other, any place of it alone.

CSHD03 (Cohen, Shade, Hiller, Deussen, Wang Tiles for Image and Texture Generation, SIGGRAPH 2003) lay tiles row by row,
each by what lies above and left of it. Here (departure) the colors of all edges are drawn from their places, as Wei,
Tile-Based Texture Mapping on Graphics Hardware, 2004, does, so that a tile is known without its neighbors. It wants a
set that has a tile for any four colors: all tiles alike at their edges, or the whole set.
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
from ..patchmatch.wang_tiles import TWO_COLORS_FROM, Edges

_UP, _LEFT, _CHOICE = 0x71E1, 0x71E2, 0x71E3  # what is drawn at a place
_EDGES = re.compile(r"n(\d{1,3})e(\d{1,3})s(\d{1,3})w(\d{1,3})", re.ASCII)


class TilePlane:
    """Tiles laid over the plane."""

    def __init__(self, tiles: Image, seed: int):
        first = tiles.first.spec
        self._width, self._height, self._seed = first.width, first.height, seed
        kind = _kind(first)
        self._fits: dict[Edges, list[Part]] = {}
        for part in tiles.parts:
            if _kind(part.spec) != kind:
                raise ImageError(
                    f"{tiles.source}: part '{part.name}' is of another size, type or color space than the first tile"
                )
            self._fits.setdefault(_edges(part, tiles.source), []).append(part)
        if len(tiles.parts) >= TWO_COLORS_FROM and not any(map(_said, tiles.parts)):
            raise ImageError(
                f"{tiles.source}: {len(tiles.parts)} tiles that do not say their edges ({EDGES}): write the set as EXR,"
                " which holds that"
            )
        self._colors = 1 + max(itertools.chain(*self._fits))
        every = (Edges(*colors) for colors in itertools.product(range(self._colors), repeat=4))
        lacking = next((edges for edges in every if edges not in self._fits), None)
        if lacking is not None:
            raise ImageError(
                f"{tiles.source}: {len(tiles.parts)} tiles cannot lie anywhere: none has the edges"
                f" {lacking}; variants=2 to 7, and from 16 on, can"
            )

    def pixels(self, place: Window) -> np.ndarray:
        """Those of a window, (height, width, channels)."""
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
        """One of `count`, by place."""
        bits = int(hash_at(self._seed, what, np.array([y]), np.array([x]))[0])
        return bits * count >> 32


def _kind(spec: oiio.ImageSpec) -> tuple[object, ...]:
    """What all tiles have in common."""
    return spec.width, spec.height, spec.nchannels, spec.format, spec.get_string_attribute(TAG)


def _said(part: Part) -> str:
    return str(part.spec.get_string_attribute(EDGES))


def _edges(part: Part, source: str) -> Edges:
    text = _said(part) or "n0e0s0w0"
    match = _EDGES.fullmatch(text)
    if match is None:
        raise ImageError(f"{source}: part '{part.name}': {EDGES}={text}: expected such as n0e1s1w0")
    return Edges(*map(int, match.groups()))
