# SPDX-License-Identifier: Apache-2.0
"""A plane of Wang tiles, with random access, that repeats after `CELLS` tiles.

CSHD03 (Cohen, Shade, Hiller, Deussen, Wang Tiles for Image and Texture Generation, SIGGRAPH 2003) place tiles row by
row, so that each depends on the ones above and to the left. Departure: colors are hashed from their positions (Wei04,
see `atlas`), those of corners (LD06, see `tiles`), so a tile does not depend on its neighbors. This requires a tile for
every combination of four corners: interchangeable tiles, or the complete set.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from typing import Any

from ...engine.core.attributes import EDGES, TAG
from ...engine.core.image import Image, Part
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ImageError
from ..patchmatch.field import hash_at
from .atlas import atlas_edges, atlas_numbers, atlas_side, tiles_of
from .tiles import TWO_COLORS_FROM, Edges, between, edges_of

CELLS = 256  # tiles along x and y after which the plane repeats; renderers read it from an image of this size
_CORNER, _CHOICE = 0x71E1, 0x71E3  # hash streams: corner at the upper left, choice of tile
_EDGES = re.compile(r"n(\d{1,3})e(\d{1,3})s(\d{1,3})w(\d{1,3})", re.ASCII)


def plane_of(edges: Sequence[Edges], seed: int) -> np.ndarray:
    """A plane that closes as a torus: (CELLS, CELLS) indices into `edges`.

    Raises
    ------
    ImageError
        A combination of corners is missing.
    """
    colors, given = 1 if max(itertools.chain(*edges)) == 0 else 2, set(edges)
    every = (between(*corners) for corners in itertools.product(range(colors), repeat=4))
    lacking = next((one for one in every if one not in given), None)
    if lacking is not None:
        raise ImageError(
            f"{len(edges)} tiles are not a complete set: none has the edges {lacking};"
            " make it with variants=2 to 7, or 16 and more"
        )
    y, x = np.ogrid[:CELLS, :CELLS]

    def drawn(stream: int, count: int | np.ndarray) -> np.ndarray:
        return hash_at(seed, stream, y, x).astype(np.int64) * count >> 32

    corner = drawn(_CORNER, colors)
    right, below = np.roll(corner, -1, 1), np.roll(corner, -1, 0)
    kinds = np.array([_kind_of(one) for one in edges])
    wanted = _kind_of(between(corner, right, below, np.roll(right, -1, 0)))
    order = np.argsort(kinds, kind="stable")
    first, count = (np.searchsorted(kinds[order], wanted, side) for side in ("left", "right"))
    return order[first + drawn(_CHOICE, count - first)]


def _kind_of(edges: Edges) -> Any:
    """A number for each combination of edges."""
    return edges.north << 6 | edges.east << 4 | edges.south << 2 | edges.west


def index_image(count: int, seed: int) -> np.ndarray:
    """The plane of an atlas for renderers: (CELLS, CELLS, 3) uint8 of column, row and number of the tile."""
    places = np.argsort(atlas_numbers(count).ravel())[plane_of(edges_of(count), seed)]
    side = len(atlas_edges(count))
    return np.stack([places % side, places // side, places], axis=-1).astype(np.uint8)


class TilePlane:
    """The plane covered with tiles, of a set or an atlas."""

    def __init__(self, tiles: Image, seed: int):
        kind = _kind(tiles.first.spec)
        for part in tiles.parts:
            if _kind(part.spec) != kind:
                raise ImageError(
                    f"{tiles.source}: part '{part.name}' must have the size, type and color space of the first tile"
                )
        self._tiles = tiles_of(tiles)
        self.width, self.height = self._tiles[0][1].size
        if atlas_side(tiles.first.spec):
            edges = edges_of(len(self._tiles))
        else:
            edges = [_edges(part, tiles.source) for part in tiles.parts]
            if len(edges) >= TWO_COLORS_FROM and not any(map(_edge_text, tiles.parts)):
                raise ImageError(
                    f"{tiles.source}: {len(edges)} tiles without edge colors (attribute {EDGES}); write the set as"
                    " EXR, which keeps them"
                )
        try:
            self._plane = plane_of(edges, seed)
        except ImageError as error:
            raise ImageError(f"{tiles.source}: {error}") from None

    def pixels(self, place: Window) -> np.ndarray:
        """The pixels of a window, (height, width, channels)."""
        columns = range(place.left // self.width, -(-place.right // self.width))
        rows = range(place.top // self.height, -(-place.bottom // self.height))
        strips = []
        for row in rows:
            pieces = []
            for column in columns:
                cell = Window.sized(self.width * column, self.height * row, self.width, self.height)
                inside = (cell & place).shifted(-cell.left, -cell.top)
                part, window = self._tiles[self._plane[row % CELLS, column % CELLS]]
                pieces.append(part.read(inside.shifted(window.left, window.top)))
            strips.append(np.concatenate(pieces, axis=1))
        return np.concatenate(strips)


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
