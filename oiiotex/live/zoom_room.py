# SPDX-License-Identifier: Apache-2.0
"""Room Zoom: tiles of a texture without end, what is in sight first; a place has as many digits as it needs."""

from __future__ import annotations

import asyncio
import os
from collections import OrderedDict
from fractions import Fraction
from typing import Any

from ..api.images import as_float
from ..api.painting import MOST_LEVEL
from ..api.service import TILES, LinkError, Request
from ..deferred import np
from ..errors import Error, ParameterError
from .document import PLACE_BITS
from .hub import Hub, Page
from .lines import line, output_name, text_of, word_of

SIDE = 256  # px of a tile
_MOST_WANTED = 256  # tiles of a page
_AT_ONCE = 6  # that the resident process is asked for
_KEPT = 1024  # tiles
_FRAME = 1280, 720  # px, of a path's frames

TilePlace = tuple[int, int, int]  # level, column, row


class ZoomRoom:
    """What pages see of a plane."""

    def __init__(self, hub: Hub):
        self._hub = hub
        self._wanted: dict[Page, list[TilePlace]] = {}
        self._asked: dict[TilePlace, Request | None] = {}
        self._tiles: OrderedDict[TilePlace, np.ndarray] = OrderedDict()
        self._turn = 0  # of seed and lock: tiles of another are not these

    async def greet(self, page: Page) -> None:
        """A page asks for what it sees."""

    async def changed(self, room: str, names: set[str]) -> None:
        """Forget tiles of another plane; say so where they look otherwise."""
        if room == "zoom" and names & {"seed", "lock"}:
            self._turn += 1
            self._tiles.clear()
            self._drop(set(self._asked))
            self._hub.tell({"do": "stale", "room": "zoom"})
        if room == "view":
            self._hub.tell({"do": "stale", "room": "zoom"})

    async def take(self, page: Page, asked: dict[str, Any], data: bytes) -> None:
        """What a page asks for."""
        do = asked["do"]
        if do == "tiles":
            level, places = int(asked["level"]), asked["tiles"]
            if not 0 <= level <= MOST_LEVEL or len(places) > _MOST_WANTED:
                raise ValueError(level)
            self._wanted[page] = [(level, int(x), int(y)) for x, y in places]
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
        """What it alone saw is not wanted any more."""
        self._wanted.pop(page, None)
        self._drop({tile for tile in self._asked if not self._is_wanted(tile)})

    def forget(self) -> None:
        """The resident process is another one, which is asked for whole tiles as the last one was."""

    # --- tiles ---

    def _is_wanted(self, tile: TilePlace) -> bool:
        return any(tile in wanted for wanted in self._wanted.values())

    def _drop(self, tiles: set[TilePlace]) -> None:
        for tile in tiles:
            request = self._asked.pop(tile)
            if request is not None:
                request.stop()

    def _ask(self) -> None:
        """Send what there is; ask for what comes first, a few at a time: the rest may go out of sight."""
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
            if self._hub.source.graph:  # the resident process has a folder of its own
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

    # --- lines ---

    def _use(self, level: int, left: int, top: int, width: int, height: int) -> tuple[str, dict[str, Any]]:
        """The op, and its modifiers, that make a window of a level."""
        zoom = self._hub.document.state["zoom"]
        same = {"seed": zoom["seed"] or None, "lock": zoom["lock"] or None}
        if self._hub.source.graph:
            window = f"{width}x{height}{left:+d}{top:+d}"
            return "synth", _said({"graph": self._hub.source.graph, "level": level, "window": window} | same)
        at = [Fraction(2 * n + size, 2) / 2**level for n, size in ((left, width), (top, height))]
        return "zoom", _said({"level": level, "at": self._numbers(at), "size": f"{width}x{height}"} | same)

    def _numbers(self, at: list[Fraction]) -> str:
        """A place in pixels of the root, exactly."""
        exact = [place * self._hub.source.side for place in at]
        if any(Fraction(float(n)) != n for n in exact):
            raise ParameterError("here a photo's plane ends: deeper places have more digits than at= holds; graph= has")
        return ",".join(text_of(float(n)) for n in exact)

    def _middle(self, key: dict[str, Any]) -> list[Fraction]:
        """A place in pixels of level 0."""
        return [Fraction(int(key[name]), 1 << PLACE_BITS) for name in ("x", "y")]

    def line(self, width: int, height: int) -> str:
        """The command that makes what is seen, on the level that is nearest."""
        zoom = self._hub.document.state["zoom"]
        level = round(zoom["zoom"])
        left, top = (int(n * 2**level) - size // 2 for n, size in zip(self._middle(zoom), (width, height), strict=True))
        op, values = self._use(level, left, top, width, height)
        return self._line(word_of(f"--tex{op}", values), self._output("zoom"))

    def path(self) -> str:
        """The command that renders the path: from the first key frame's depth to the last one's place."""
        zoom = self._hub.document.state["zoom"]
        keys = zoom["keys"]
        if len(keys) < 2:
            raise ParameterError("a path has two key frames or more: fly, press K, fly on, press K")
        first, last, frames = keys[0], keys[-1], zoom["frames"]
        if first["zoom"] == last["zoom"]:
            raise ParameterError("the path's first and last key frames are as deep: a zoom changes depth")
        side = self._hub.source.side
        aim = [Fraction(round(n * 2**40 * side), 2**40 * side) for n in self._middle(last)]
        values = {
            "graph": self._hub.source.graph or None, "level": round(first["zoom"], 9),
            "speed": round((last["zoom"] - first["zoom"]) / (frames - 1), 9), "at": self._numbers(aim),
            "size": f"{_FRAME[0]}x{_FRAME[1]}", "seed": zoom["seed"] or None, "lock": zoom["lock"] or None,
        }  # fmt: skip
        stem, _, suffix = self._output("zoom").rpartition(".")
        return self._line("--frames", f"1-{frames}", word_of("--texzoom", values), f"{stem}.%04d.{suffix}")

    def _line(self, *words: str) -> str:
        *before, name = words
        return line([*self._hub.source.words, *before, "-o", name])

    def _output(self, what: str) -> str:
        image = self._hub.source.image
        return output_name(self._hub.source.stem, what, "float" if image is None else str(image.first.spec.format))


def _said(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}
