# SPDX-License-Identifier: Apache-2.0
"""The last finished tiles by what they were made with, so that undo, redo and variants show them at once."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, NamedTuple

from oiiotex.engine.deferred import np

from ..api.service import spec_of

_MOST = 32  # tiles
_MOST_VALUES = 1 << 27  # of all of them, in the resident process


class KeptTile(NamedTuple):
    """A finished tile.

    Attributes
    ----------
    images : list of dict
        The tile and its maps in the resident process: 'number' and 'parts'.
    pixels : (height, width, channels)
        As pages show it.
    facts : dict
        Of its frame.
    measures : dict
        The message with its measures.
    """

    images: list[dict[str, Any]]
    pixels: np.ndarray
    facts: dict[str, Any]
    measures: dict[str, Any]

    @property
    def values(self) -> int:
        """Values of all images."""
        specs = [spec_of(part) for image in self.images for part in image["parts"]]
        return sum(int(spec.image_pixels()) * spec.nchannels for spec in specs)


class KeptTiles:
    """Finished tiles by key, the last one always."""

    def __init__(self) -> None:
        self._tiles: OrderedDict[str, KeptTile] = OrderedDict()

    def get(self, key: str) -> KeptTile | None:
        """The tile of a key, which counts as the last one then."""
        if key in self._tiles:
            self._tiles.move_to_end(key)
        return self._tiles.get(key)

    def put(self, key: str, tile: KeptTile) -> list[KeptTile]:
        """Keep a tile. Returns tiles that are forgotten: the oldest ones, if there are too many."""
        gone = [self._tiles.pop(key)] if key in self._tiles else []
        self._tiles[key] = tile
        while len(self._tiles) > 1 and (
            len(self._tiles) > _MOST or sum(one.values for one in self._tiles.values()) > _MOST_VALUES
        ):
            gone.append(self._tiles.popitem(last=False)[1])
        return gone

    def holds(self, images: list[dict[str, Any]]) -> bool:
        """Whether these images belong to a kept tile."""
        return any(one.images is images for one in self._tiles.values())

    def forget(self) -> None:
        """Forget all tiles of a resident process that has ended."""
        self._tiles.clear()
