# SPDX-License-Identifier: Apache-2.0
"""Room Zoom: tiles of an unbounded texture, visible ones first. Positions are exact integers of any length."""

from __future__ import annotations

import asyncio
import os
from collections import OrderedDict
from fractions import Fraction
from typing import Any

from oiiotex.engine.deferred import np
from oiiotex.engine.errors import Error, ParameterError

from ..api.images import as_float
from ..api.painting import MOST_LEVEL
from ..api.service import TILES, LinkError, Request
from .document import PLACE_BITS
from .hub import Hub
from .lines import line, text_of, word_of
from .pages import Page

SIDE = 256  # px of a tile
_MOST_WANTED = 256  # tiles per page
_AT_ONCE = 6  # concurrent requests to the resident process
_KEPT = 1024  # tiles
_FRAME = 1280, 720  # px, size of a path's frames

TilePlace = tuple[int, int, int]  # level, column, row


class ZoomRoom:
    """The Zoom room of all pages."""

    def __init__(self, hub: Hub):
        self._hub = hub
        self._wanted: dict[Page, list[TilePlace]] = {}
        self._asked: dict[TilePlace, Request | None] = {}
        self._tiles: OrderedDict[TilePlace, np.ndarray] = OrderedDict()
        self._turn = 0  # changes with seed, jitter and keeplayout, which invalidate tiles

    async def greet(self, page: Page) -> None:
        """Nothing to send: a page requests the tiles it shows."""

    async def changed(self, room: str, names: set[str]) -> None:
        """Discard tiles after a change of the plane, and tell pages when tiles look different."""
        if room == "zoom" and names & {"seed", "jitter", "keeplayout"}:
            self._turn += 1
            self._tiles.clear()
            self._drop(set(self._asked))
            self._hub.tell({"do": "stale", "room": "zoom"})
        if room == "view":
            self._hub.tell({"do": "stale", "room": "zoom"})

    async def take(self, page: Page, asked: dict[str, Any], data: bytes) -> None:
        """Handle a request of a page."""
        do = asked["do"]
        if do == "tiles":
            places = [(int(level), int(x), int(y)) for level, x, y in asked["tiles"][: _MOST_WANTED + 1]]
            if len(places) > _MOST_WANTED or not all(0 <= level <= MOST_LEVEL for level, *_ in places):
                raise ValueError(places)
            self._wanted[page] = places
            self._drop({tile for tile in self._asked if not self._is_wanted(tile)})
            self._ask()
        elif do == "line":
            width, height = (max(1, min(16384, int(asked[name]))) for name in ("width", "height"))
            self._hub.tell({"do": "line", "room": "zoom", "text": self.line(width, height)})
        elif do == "path":
            self._hub.tell({"do": "line", "room": "zoom", "text": self.path()})
        else:
            raise ValueError(do)

    def leave(self, page: Page) -> None:
        """Cancel requests for tiles that only this page showed."""
        self._wanted.pop(page, None)
        self._drop({tile for tile in self._asked if not self._is_wanted(tile)})

    def forget(self) -> None:
        """Nothing to do after a restart of the resident process: tiles are requested whole."""

    # --- tiles ---

    def _is_wanted(self, tile: TilePlace) -> bool:
        return any(tile in wanted for wanted in self._wanted.values())

    def _drop(self, tiles: set[TilePlace]) -> None:
        for tile in tiles:
            request = self._asked.pop(tile)
            if request is not None:
                request.stop()

    def _ask(self) -> None:
        """Send finished tiles and request the next few; the others may leave the view before."""
        for page, wanted in self._wanted.items():
            for tile in [tile for tile in wanted if tile in self._tiles]:
                wanted.remove(tile)
                self._tiles.move_to_end(tile)
                self._show(tile, page)
        for wanted in self._wanted.values():
            for tile in wanted:
                if len(self._asked) >= _AT_ONCE:
                    return
                if tile not in self._asked:
                    self._asked[tile] = None
                    self._hub.begin(self._make(tile))

    async def _make(self, tile: TilePlace) -> None:
        turn = self._turn
        try:
            client = await self._hub.client()
            images = [] if self._hub.source.graph else [await self._hub.photo()]
            if tile not in self._asked or turn != self._turn:
                return
            op, values = self._use(tile[0], tile[1] * SIDE, tile[2] * SIDE, SIDE, SIDE)
            if self._hub.source.graph:  # the resident process has a different working folder
                values["graph"] = os.path.abspath(self._hub.source.graph)
            request = client.make(op, images, values, priority=TILES, read="", keep=False)
            self._asked[tile] = request
            _, (pixels,) = await asyncio.wrap_future(request)
        except asyncio.CancelledError:
            return
        except Error as error:
            self._asked.pop(tile, None)
            if isinstance(error, LinkError) and self._hub.tries_again():
                self._ask()
                return
            self._wanted = {page: [one for one in wanted if one != tile] for page, wanted in self._wanted.items()}
            raise
        finally:
            self._asked.pop(tile, None)
        if turn == self._turn:
            self._tiles[tile] = pixels
            while len(self._tiles) > _KEPT:
                self._tiles.popitem(last=False)
        self._ask()

    def _show(self, tile: TilePlace, page: Page) -> None:
        level, x, y = tile
        picture = self._hub.picture(as_float(self._tiles[tile]), self._hub.shown())
        self._hub.show({"room": "zoom", "level": level, "x": str(x), "y": str(y)}, picture, page)

    # --- commands ---

    def _use(self, level: int, left: int, top: int, width: int, height: int) -> tuple[str, dict[str, Any]]:
        """The op and the modifiers that render a window of a level."""
        zoom = self._hub.document.state["zoom"]
        same = {"seed": zoom["seed"] or None, "jitter": zoom["jitter"], "keeplayout": zoom["keeplayout"] or None}
        if self._hub.source.graph:
            window = f"{width}x{height}{left:+d}{top:+d}"
            return "synth", _given({"graph": self._hub.source.graph, "lod": level, "window": window} | same)
        at = [Fraction(2 * n + size, 2) / 2**level for n, size in ((left, width), (top, height))]
        return "zoom", _given({"lod": level, "center": self._numbers(at), "size": f"{width}x{height}"} | same)

    def _numbers(self, at: list[Fraction]) -> str:
        """A position in root pixels, exactly."""
        exact = [place * self._hub.source.side for place in at]
        if any(Fraction(float(n)) != n for n in exact):
            raise ParameterError(
                "too deep for a photo: center cannot hold this position exactly; zoom out or use graph"
            )
        return ",".join(text_of(float(n)) for n in exact)

    def _middle(self, key: dict[str, Any]) -> list[Fraction]:
        """A position in pixels of level 0."""
        return [Fraction(int(key[name]), 1 << PLACE_BITS) for name in ("x", "y")]

    def line(self, width: int, height: int) -> str:
        """The command that renders the current view, at the nearest level."""
        zoom = self._hub.document.state["zoom"]
        level = round(zoom["zoom"])
        left, top = (int(n * 2**level) - size // 2 for n, size in zip(self._middle(zoom), (width, height), strict=True))
        op, values = self._use(level, left, top, width, height)
        return self._line(word_of(f"--tex{op}", values))

    def path(self) -> str:
        """The command that renders the path, from the zoom of the first keyframe to the last keyframe."""
        zoom = self._hub.document.state["zoom"]
        keys = zoom["keys"]
        if len(keys) < 2:
            raise ParameterError("a path requires at least two keyframes: press K at each position")
        first, last, frames = keys[0], keys[-1], zoom["frames"]
        if first["zoom"] == last["zoom"]:
            raise ParameterError("the first and last keyframes have the same zoom: expected different ones")
        side = self._hub.source.side
        aim = [Fraction(round(n * 2**40 * side), 2**40 * side) for n in self._middle(last)]
        values = {
            "graph": self._hub.source.graph or None, "lod": round(first["zoom"], 9),
            "speed": round((last["zoom"] - first["zoom"]) / (frames - 1), 9), "center": self._numbers(aim),
            "size": f"{_FRAME[0]}x{_FRAME[1]}", "seed": zoom["seed"] or None, "jitter": zoom["jitter"],
            "keeplayout": zoom["keeplayout"] or None,
        }  # fmt: skip
        return self._line("--frames", f"1-{frames}", word_of("--texzoom", values), number=".%04d")

    def _line(self, *words: str, number: str = "") -> str:
        name, pixel_type = self._hub.output("zoom")
        stem, _, suffix = name.rpartition(".")
        return line([*self._hub.source.words, *words], f"{stem}{number}.{suffix}", pixel_type)


def _given(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}
