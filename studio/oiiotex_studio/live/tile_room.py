# SPDX-License-Identifier: Apache-2.0
"""Room Tile: the photo's tile, with coarse previews first. A change cancels the previous synthesis."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from oiiotex.engine.deferred import np
from oiiotex.engine.errors import Error, ImageError

from ..api.images import as_float, read
from ..api.service import BRUSH, LOOKS, Client, LinkError, Request, spec_of
from .hub import Hub, reduced
from .inspection import Inspection, histogram
from .kept_tiles import KeptTile, KeptTiles
from .lines import line, word_of
from .numbered import write_mask
from .pages import Page, gesture_of
from .photos.material import MaterialMaps, Outputs

THUMBNAIL = 128  # px
MOST_THUMBNAILS = 12
_OPS = {"": "stationarize", "brush": "fill"}  # by what is replaced
_BRUSHES = {"mask": "Source", "fill": "Replace"}  # and their titles on the page


class TileRoom:
    """The Tile room of all pages."""

    def __init__(self, hub: Hub):
        self._hub = hub
        self._turn = 0
        self._request: Request | None = None
        self._tile: tuple[np.ndarray, dict[str, Any]] | None = None  # the last preview, and its facts
        self._measures: dict[str, Any] | None = None
        self._busy: dict[str, Any] = {"do": "busy", "room": "tile", "done": 1, "total": 1, "turn": 0}
        self._images: list[dict[str, Any]] = []  # the finished tile, and its maps: 'number' and 'parts'
        self._kept = KeptTiles()
        self._saves: list[Outputs] = []  # files to write when the tile is finished
        self._material = MaterialMaps(hub)
        self._thumbnails: list[Request] = []
        self._numbers: dict[Path, int] = {}  # of masks in the resident process
        self._inspection = Inspection(hub)
        self._prepared, self._preparing = False, asyncio.Lock()

    # --- pages ---

    async def greet(self, page: Page) -> None:
        """Send the current state to a new page."""
        if self._hub.source.image is None:
            return
        await self._show_photo(page)
        for name in _BRUSHES:
            if self._mask(name) is not None:
                await self._show_brush(name, page)
        if self._tile is not None:
            self._hub.show(*self._framed(*self._tile), to=page)
        if self._measures is not None:
            self._hub.tell(self._measures)
        page.tell(json.dumps(self._busy))
        self._hub.begin(self._material.show(page))
        self._tell_line()
        self._inspection.show_presets(page)
        if page.tab == "tile":
            await self._open()

    async def _open(self) -> None:
        """Make the first tile, once a page shows the tab: until then, the resident process works for other tabs."""
        if self._turn == 0 and not self._hub.source.asks:
            self._turn = 1
            await self.prepare()
            if self._turn == 1:
                await self._begin()

    async def prepare(self) -> None:
        """Make the coarse tiles of the presets, once."""
        async with self._preparing:
            if not self._prepared and not self._hub.source.asks:
                self._prepared = True
                await self._inspection.find_presets(self._values())

    async def changed(self, room: str, names: set[str]) -> None:
        """Resynthesize the tile, or update its display transform."""
        if self._hub.source.image is None:
            return
        if room == "view":
            await self._show_photo()
            self._inspection.show_presets()
            if self._tile is not None:
                self._hub.show(*self._framed(*self._tile))
        if room in ("tile", "output", "masks"):
            self._tell_line()
        brushes = names if room == "masks" else set()
        for name in brushes:
            await self._show_brush(name)
        if room == "tile" or any(self._hub.document.state["tile"][name] == "brush" for name in brushes):
            await self._begin()

    def _tell_line(self, asked: bool = False) -> None:
        """Show the line next to the button that saves; `asked`: in a dialog, to copy it."""
        self._hub.tell({"do": "line", "room": "tile", "text": self.line(), "asked": asked})

    async def take(self, page: Page, asked: dict[str, Any], data: bytes) -> None:
        """Handle a request of a page."""
        do = asked["do"]
        if do == "open":
            await self._open()
        elif do == "line":
            self._tell_line(asked=True)
        elif do == "brush":
            await self._take_brush(asked["name"], data, gesture_of(page, asked))
        elif do == "save":
            if self._images:
                await self._material.save(self._images, self._material.outputs())
            elif self._request is None or self._request.done():
                await self._begin([self._material.outputs()])
            else:
                self._saves.append(self._material.outputs())
                self._hub.tell({"do": "note", "text": "The tile will be saved when it is finished"})
        elif do == "seeds":
            await self._seeds(int(asked["first"]), int(asked["count"]))
        elif do == "presets":
            await self._inspection.find_presets(self._values())
        elif do == "sample":
            await self._inspection.sample(page, asked, self._tile_image)
        elif do == "measure":
            await self._inspection.show_measure(
                asked["name"], self._tile_image, self._hub.document.state["tile"]["measure"]
            )
        elif do == "overlay":
            await self._inspection.show_overlay(asked["name"])
        else:
            raise ValueError(do)

    def leave(self, page: Page) -> None:
        """Nothing to do: no state belongs to a single page."""

    def forget(self) -> None:
        """Drop references to images of a resident process that has ended."""
        self._numbers.clear()
        self._material.forget()
        self._kept.forget()
        self._images = []

    # --- the tile ---

    async def deliver(self, changed: bool) -> None:
        """Make the tile, unless it is there and not `changed`, and save its files."""
        if self._images and not changed:
            await self._material.save(self._images, self._material.outputs())
        else:
            await self._begin([self._material.outputs()])

    def rest(self) -> None:
        """Stop all work, except that on files that will be saved."""
        self._stop_thumbnails()
        if not self._saves:
            self.stop()

    def stop(self) -> None:
        """Stop making the tile."""
        self._turn += 1
        self._saves = []
        if self._request is not None:
            self._request.stop()

    async def _begin(self, again: Sequence[Outputs] = ()) -> None:
        """Synthesize the tile by the document's values; `again`: files of a synthesis whose process has ended."""
        self._turn += 1
        turn, hub = self._turn, self._hub
        if self._request is not None and not self._saves:  # else it ends, and its files are written
            self._request.stop()
        saves = self._saves = list(again)
        self._stop_thumbnails()
        self._measures = None
        self._advanced(turn, 0, 1)
        client = await hub.client()
        self._images, key = [], self._key()
        if (kept := self._kept.get(key)) is not None:
            return await self._show_again(turn, kept, saves)
        given, optional = await self._exemplar()
        given[1:1] = await self._material.numbers(client)  # maps follow the photo, before a painted area
        if turn != self._turn:
            if saves:
                raise Error("not saved: the parameters have changed since")
            return
        loop = asyncio.get_running_loop()
        self._request = request = client.make(
            self._op, given, self._values() | self._material.values | {"st": 1},
            optional=optional, priority=BRUSH, measure=True,
            on_look=lambda pixels, whole: loop.call_soon_threadsafe(self._looked, turn, pixels, whole),
            # finished is only what is measured and answered
            on_progress=lambda done, total: loop.call_soon_threadsafe(self._advanced, turn, done, total + 1),
        )  # fmt: skip
        try:
            facts, _ = await asyncio.wrap_future(request)
        except asyncio.CancelledError:
            return
        except Error as error:
            if turn == self._turn and isinstance(error, LinkError) and hub.tries_again():
                await self._begin(saves)
            elif turn == self._turn:
                self._advanced(turn, 1, 1)
                raise
            return
        images = facts["images"]
        made = images[0]
        if turn == self._turn:
            self._images = images
            own = f"--tex{self._op}: "  # and st=1 is the page's
            lines = [[level, text.removeprefix(own).replace(":st=1", "")] for level, text in facts["log"]]
            chosen = spec_of(made["parts"][0]).get_string_attribute("oiiotex:chosen")
            self._measures = {"do": "measures", "room": "tile", "lines": lines, "chosen": chosen}
            hub.tell(self._measures)
            self._advanced(turn, 1, 1)
            if self._tile is not None and self._tile[1] | {"turn": turn, "whole": True} == self._tile[1]:
                for gone in self._kept.put(key, KeptTile(images, *self._tile, self._measures)):
                    self._release(client, gone.images)
            await self._material.find(client, images)
        try:
            for outputs in saves:
                await self._material.save(images, outputs)
        finally:
            if not self._kept.holds(images):
                self._release(client, images)

    def _key(self) -> str:
        """What determines the tile of the document's values."""
        tile = self._hub.document.state["tile"]
        masks = [str(self._mask(name)) for name in _BRUSHES if tile[name] == "brush"]
        return json.dumps([self._op, self._values(), tile["mask"], masks], sort_keys=True)

    async def _show_again(self, turn: int, kept: KeptTile, saves: Sequence[Outputs]) -> None:
        """Show a tile that was finished before, and save its files."""
        self._images, self._measures = kept.images, kept.measures
        self._tile = kept.pixels, kept.facts | {"turn": turn}
        self._hub.show(*self._framed(*self._tile))
        self._hub.tell(kept.measures)
        self._advanced(turn, 1, 1)
        await self._material.find(await self._hub.client(), kept.images)
        for outputs in saves:
            await self._material.save(kept.images, outputs)

    def _release(self, client: Client, images: list[dict[str, Any]]) -> None:
        for image in images:
            self._hub.release(client, image["number"])

    def _looked(self, turn: int, pixels: np.ndarray, whole: bool) -> None:
        if turn != self._turn:
            return
        facts = {"kind": "tile", "turn": turn, "whole": whole, "size": [pixels.shape[1], pixels.shape[0]]}
        self._tile = reduced(pixels), facts
        self._hub.show(*self._framed(*self._tile))

    def _framed(self, pixels: np.ndarray, facts: dict[str, Any]) -> tuple[dict[str, Any], np.ndarray]:
        picture = self._hub.picture(pixels, self._hub.shown())
        return facts | {"room": "tile", "histogram": histogram(picture)}, picture

    def _advanced(self, turn: int, done: int, total: int) -> None:
        if turn == self._turn:
            self._busy |= {"done": done, "total": total, "turn": turn}
            self._hub.tell(self._busy)

    @property
    def _op(self) -> str:
        """The filter that makes the tile."""
        return _OPS[self._hub.document.state["tile"]["fill"]]

    def _values(self) -> dict[str, Any]:
        """Modifiers with other values than the default, except images."""
        tile = self._hub.document.state["tile"]
        if tile["fill"]:
            values = {"patch": tile["patch"], "seed": tile["seed"] or None}
            values |= {"lattice": tile["lattice"]} if tile["lattice"] != 0.5 else {}
            values |= {"label": tile["mask"]} if isinstance(tile["mask"], int) else {}
            return {name: value for name, value in values.items() if value is not None}
        values = {name: tile[name] for name in ("flattening", "sigma", "evenness", "histogram", "preset", "patch")}
        if tile["evenness"] is not None:
            values["sigma"] = None
        if tile["width"] or tile["height"]:
            assert self._hub.source.image is not None
            photo = self._hub.source.image.first.spec
            values["size"] = f"{tile['width'] or photo.width}x{tile['height'] or photo.height}"
        values |= {"lattice": tile["lattice"]} if tile["lattice"] != 0.5 else {}
        values |= {"measure": tile["measure"]} if tile["measure"] != "histogram" else {}
        values |= {"seed": tile["seed"]} if tile["seed"] else {}
        if isinstance(tile["mask"], int):
            values["label"] = tile["mask"]
        return {name: value for name, value in values.items() if value is not None}

    async def _exemplar(self) -> tuple[list[int], dict[str, int | str]]:
        """Numbers of the photo, with parts that the tile requires, and of a painted area; and of optional images."""
        tile, optional = self._hub.document.state["tile"], dict[str, int | str]()
        number = await self._hub.photo()
        if tile["mask"] == "dominant":
            number = (await self._hub.made("dominant"))["number"]
            optional["mask"] = "dominant"
        elif tile["mask"] == "brush":
            optional["mask"] = await self._brush("mask")
        elif tile["mask"]:
            number = (await self._hub.made("label"))["number"]
        return [number, *([await self._brush("fill")] if tile["fill"] else [])], optional

    def _mask(self, name: str) -> Path | None:
        """The file of a painted mask. Each stroke has another file, so that lines and undo find it."""
        number = self._hub.document.state["masks"][name]
        return self._hub.document.beside("masks") / f"{number:06d}.png" if number else None

    async def _brush(self, name: str) -> int:
        path = self._mask(name)
        if path is None:
            raise Error(f"{_BRUSHES[name]}: nothing is painted yet; choose the brush and paint on the photo")
        if path not in self._numbers:
            client = await self._hub.client()
            image = read(path, self._hub.session.resources.cache)
            self._numbers[path] = await asyncio.to_thread(client.put, image)
        return self._numbers[path]

    def line(self) -> str:
        """The command that renders this tile at full size."""
        source, tile = self._hub.source, self._hub.document.state["tile"]
        assert source.image is not None
        words, images = list(source.words), {}
        if tile["mask"] == "dominant":
            words.append("--texdominant:photo=1")
            images["mask"] = "dominant"
        elif tile["mask"] == "brush":
            images["mask"] = str(self._mask("mask"))
        elif tile["mask"]:
            words.append("--texlabel:photo=1")
        maps = [word for one in source.maps for word in one.words]
        if tile["fill"]:
            maps.append(str(self._mask("fill")))
        words += [*maps, word_of(f"--tex{self._op}", images | self._values() | self._material.values)]
        return line([*words, *self._material.written()], *self._hub.output("tile"))

    # --- seeds ---

    async def _seeds(self, first: int, count: int) -> None:
        self._stop_thumbnails()
        client = await self._hub.client()
        images, optional = await self._exemplar()
        requests = {
            seed: client.make(
                self._op, images, self._values() | {"seed": seed}, optional=optional, priority=LOOKS, until="look"
            )
            for seed in range(first, first + min(count, MOST_THUMBNAILS))
        }
        self._thumbnails = list(requests.values())
        for seed, request in requests.items():
            try:
                _, (pixels, *_) = await asyncio.wrap_future(request)
            except asyncio.CancelledError:
                return
            small = self._hub.picture(reduced(pixels, THUMBNAIL), self._hub.shown())
            self._hub.show({"room": "tile", "kind": "seed", "seed": seed}, small)

    def _stop_thumbnails(self) -> None:
        for request in self._thumbnails:
            request.stop()
        self._thumbnails = []

    @property
    def _tile_image(self) -> dict[str, Any] | None:
        return self._images[0] if self._images else None

    # --- the photo and its overlays ---

    async def _show_photo(self, page: Page | None = None) -> None:
        small = await self._hub.small_photo()
        picture = await asyncio.to_thread(self._hub.picture, small, self._hub.shown())
        self._hub.show({"room": "tile", "kind": "photo", "histogram": histogram(picture)}, picture, page)

    async def _show_brush(self, name: str, page: Page | None = None) -> None:
        """Show a painted mask, or that there is none."""
        path = self._mask(name)
        marked = np.zeros((*(await self._hub.small_photo()).shape[:2], 1), np.uint8)
        if path is not None:
            pixels = reduced(as_float(read(path, self._hub.session.resources.cache).first.pixels()))
            marked = np.where(pixels[..., :1] > 0.5, 255, 0).astype(np.uint8)
        self._hub.show({"room": "tile", "kind": "brush", "name": name}, marked, page)

    async def _take_brush(self, name: str, data: bytes, gesture: object) -> None:
        """Save a painted mask at the photo's size, as the next file."""
        source, folder = self._hub.source.image, self._hub.document.beside("masks")
        assert source is not None
        height, width = (await self._hub.small_photo()).shape[:2]
        if name not in _BRUSHES:
            raise ValueError(name)
        if len(data) != width * height:
            raise ImageError(f"{len(data)} bytes of mask: expected {width}x{height} px, as the photo; reload the page")
        small = np.frombuffer(data, np.uint8).reshape(height, width)
        spec = source.first.spec
        number = write_mask(folder, small, spec)
        self._hub.change("masks", {name: number}, f"{_BRUSHES[name]} mask", gesture)
