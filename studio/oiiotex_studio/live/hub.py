# SPDX-License-Identifier: Apache-2.0
"""All pages of one document. A change in one page is sent to the others; images go to the pages that show them."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from oiiotex.engine.deferred import np, oiio
from oiiotex.engine.errors import Error, ParameterError, failure_of

from ..api.files import checked_name
from ..api.images import (
    Image,
    Part,
    Session,
    Window,
    as_float,
    channels_of,
    resized,
    write,
)
from ..api.painting import AUTOMATIC, PRESETS
from ..api.service import BRUSH, EXPORT, Client, LinkError, ResidentSettings, connect, release_folder, spec_of
from .display import Shown, shown_by, views
from .document import INNER, Document
from .lines import output_name, type_in
from .pages import Page, Pages, gesture_of

MOST_SHOWN = 2048  # px; longest side of an image sent to a page
SAVE_EVERY = 0.5  # s; at most this much work is lost
RETRY_EVERY = 2.0  # s, after saving has failed
_PATIENCE = 10.0  # s between two restarts of the resident process
_LOOKING = {"label": "Finding labels", "dominant": "Finding the dominant texture"}

log = logging.getLogger("oiiotex")


@dataclass(frozen=True)
class MaterialMap:
    """A further map of the photo's material, which its tile copies in the same way."""

    role: str  # as `read_name` gives it
    kind: str  # as `kinds` of --texstationarize takes it
    hand: str  # convention of normals: 'opengl', 'directx', or '' if unknown
    image: Image
    words: tuple[str, ...]  # of the line


@dataclass(frozen=True)
class PageSource:
    """The subject of the page: a photo or a graph."""

    image: Image | None  # The photo; None for a graph
    graph: str  # The graph's file; '' for a photo
    words: tuple[str, ...]  # The command line up to the photo
    stem: str  # Stem of output file names
    space: str | None  # Its color space, as named in the config; None if untagged
    side: int  # px; side of the square that zooms start from
    pixel_type: str  # of files made from it, as -d names it
    maps: tuple[MaterialMap, ...] = ()  # of the same material, in the order of the line
    asks: bool = False  # has no color space yet: the page asks for it


class Hub(Pages):
    """The document's pages, its rooms, and the resident process that works for them.

    `unsaved`: why something is not saved, '' if everything is. `keepers`: rooms with work to save: their `save_work` is
    called regularly, and `close` at the end.
    """

    def __init__(self, source: PageSource, document: Document, session: Session, spare: Path):
        super().__init__()
        self.source, self.document, self.session, self.spare = source, document, session, spare
        self.unsaved, self.keepers = "", list[Any]()
        self._client: Client | None = None
        self._connecting = asyncio.Lock()
        self._photo: int | None = None
        self._small: np.ndarray | None = None
        self._making, self._saving, self._reducing = asyncio.Lock(), asyncio.Lock(), asyncio.Lock()
        self._made: dict[str, dict[str, Any]] = {}
        self._pinned: dict[int, bool] = {}  # images being saved; whether to drop them afterwards
        self._restarted = -_PATIENCE
        self.saved: dict[str, Path] = {}  # files that pages have saved, by name, which they can download
        self.rooms: dict[str, Any] = {}
        self.strip: Pages | None = None  # answers messages about photos
        self.further: Callable[[], dict[str, Any]] = dict  # facts for new pages
        self.watch: Callable[[dict[str, Any]], None] = lambda message: None  # of all messages

    # --- the resident process ---

    async def client(self) -> Client:
        """The resident process. If it has ended, it is restarted, and rooms drop their references to its images."""
        async with self._connecting:
            if self._client is None or self._client.ended:
                self._client = await asyncio.to_thread(connect, ResidentSettings.of(self.session))
                self._photo = None
                self._made.clear()
                for room in self.rooms.values():
                    room.forget()
            return self._client

    async def warm_up(self) -> None:
        """Start the resident process, and make what a page shows on opening; a page is told of errors later."""
        with contextlib.suppress(Error):
            await (self.client() if self.source.image is None else self.rooms["tile"].prepare())

    def rest(self) -> None:
        """Drop all images of the resident process, until they are needed again."""
        if self._client is not None:
            with contextlib.suppress(LinkError):
                self._client.close()
            self._client = None

    def tries_again(self) -> bool:
        """Whether to restart a resident process that has ended: not twice in quick succession."""
        now = time.monotonic()
        again = now - self._restarted > _PATIENCE
        self._restarted = now if again else self._restarted
        return again

    async def photo(self) -> int:
        """The photo's number in the resident process."""
        client, image = await self.client(), self.source.image
        assert image is not None
        async with self._connecting:
            if self._photo is None:
                self._photo = await asyncio.to_thread(client.put, image)
            return self._photo

    async def small_photo(self) -> np.ndarray:
        """The photo as pages show it: (height, width, channels) float32, with sides of at most `MOST_SHOWN` px."""
        assert self.source.image is not None
        first = self.source.image.first
        async with self._reducing:
            if self._small is None:
                self._small = await asyncio.to_thread(lambda: reduced(as_float(first.pixels())))
            return self._small

    async def made(self, op: str) -> dict[str, Any]:
        """The photo with the parts that an op adds: 'number' and 'parts', from the resident process."""
        photo, client = await self.photo(), await self.client()
        async with self._making:
            if op not in self._made:
                advance = self.advancing(_LOOKING[op])
                request = client.make(op, [photo], {"photo": 1}, priority=BRUSH, on_progress=advance)
                facts, _ = await asyncio.wrap_future(request)
                self._made[op] = facts["images"][0]
            return self._made[op]

    def output(self, what: str) -> tuple[str, str]:
        """The file name and the pixel type of a room's output, 'tile', 'painted' or 'zoom'."""
        chosen = self.document.state["output"]
        pixel_type = chosen["type"] or self.source.pixel_type
        said = chosen.get(what)
        name = checked_name(said, "output") if said else output_name(self.source.stem, what, pixel_type)
        return name, chosen["type"] or type_in(name, pixel_type)

    async def save(self, made: dict[str, Any], name: str, pixel_type: str, room: str) -> str:
        """Write an image of the resident process to the document's folder, in bands, at the lowest priority.

        Returns the name of the file.

        Parameters
        ----------
        made : dict
            'number' and 'parts', from the resident process.
        name : str
            File name; a number is added if the file exists.
        pixel_type : str
            As `output` gives it.
        room : str
            That offers the file as a download.
        """
        client, facts = await self.client(), made["parts"][0]

        def fetch(window: Window) -> np.ndarray:
            return client.read(made["number"], window, priority=EXPORT).result()[1][0]

        stored = None if facts["stored"] is None else oiio.TypeDesc(facts["stored"])
        part = Part(facts["name"], spec_of(facts), fetch, stored)
        advance, number = self.advancing(), made["number"]
        self._pinned[number] = False
        try:
            async with self._saving:
                path = _free(self.document.path.with_name(name))
                await asyncio.to_thread(write, Image((part,), str(path)), path, oiio.TypeDesc(pixel_type), advance)
        finally:
            if self._pinned.pop(number, False):
                client.drop(number)
        self.saved[path.name] = path
        self.tell({"do": "saved", "name": path.name, "room": room})
        return path.name

    def release(self, client: Client, number: int) -> None:
        """Drop an image of the resident process; if it is being saved, afterwards."""
        if number in self._pinned:
            self._pinned[number] = True
        else:
            client.drop(number)

    def advancing(self, text: str = "") -> Callable[[int, int], None]:
        """A callback that sends the progress of a job, with an optional text, to all pages."""
        loop = asyncio.get_running_loop()

        def advanced(done: int, total: int) -> None:
            facts = {"do": "busy", "room": "", "done": done, "total": total, "text": text}
            loop.call_soon_threadsafe(self.tell, facts)

        return advanced

    # --- pages ---

    async def greet(self, page: Page) -> None:
        """Send the state to a new page."""
        page.tell(json.dumps({"do": "hello", "state": self.document.state} | self._facts()))
        for room in self.rooms.values():
            self.begin(room.greet(page))

    def tell(self, message: dict[str, Any], but: Page | None = None) -> None:
        """Send a message to all pages."""
        super().tell(message, but)
        self.watch(message)

    def left(self, page: Page) -> None:
        """Tell the rooms that a page is gone."""
        if self.strip is not None:
            self.strip.left(page)
        for room in self.rooms.values():
            room.leave(page)

    def answer(self, page: Page, asked: dict[str, Any], data: bytes) -> None:
        """Handle a message of a page."""
        if asked.get("room") == "photos" and self.strip is not None:
            self.strip.answer(page, asked, data)
        elif asked["do"] in ("undo", "redo"):
            self._go(asked["do"] == "redo", page)
        elif asked["do"] != "set":
            self.begin(self.rooms[asked["room"]].take(page, asked, data), page)
        elif asked["room"] in INNER:
            raise ParameterError(f"{asked['room']} is read-only: the server sets it")
        else:
            self.change(asked["room"], asked["values"], gesture=gesture_of(page, asked), but=page)

    def change(
        self, room: str, values: dict[str, Any], text: str = "", gesture: object = None, but: Page | None = None
    ) -> None:
        """Set values of a room, and tell pages and rooms those that have changed."""
        if changed := self.document.change(room, values, text, gesture):
            self._changed(room, changed, but)
            self.tell({"do": "history"} | self.document.history.facts())

    def _changed(self, room: str, values: dict[str, Any], but: Page | None = None) -> None:
        self.tell({"do": "set", "room": room, "values": values}, but)
        for one in self.rooms.values():
            self.begin(one.changed(room, set(values)))

    def _go(self, forward: bool, page: Page) -> None:
        """Undo or redo a step of the document's history, and tell the page that asked what it was."""
        if gone := self.document.go(forward):
            for room, values in gone[1].items():
                self._changed(room, values)
            facts = {"do": "history"} | self.document.history.facts()
            self.tell(facts, page)
            page.tell(json.dumps(facts | {"gone": gone[0], "forward": forward, "rooms": list(gone[1])}))

    def _facts(self) -> dict[str, Any]:
        spec = None if self.source.image is None else self.source.image.first.spec
        return {
            "source": self.source.stem,
            "photo": None if spec is None else [spec.width, spec.height],
            "views": views(self.session.resources.color),
            "document": self.document.path.name,
            "type": self.source.pixel_type,
            "presets": {"": AUTOMATIC} | PRESETS,
            "unsaved": self.unsaved,
            "history": self.document.history.facts(),
            "maps": [{"role": one.role, "kind": one.kind, "hand": one.hand} for one in self.source.maps],
        } | self.further()

    # --- colors ---

    def shown(self) -> Shown:
        """The display transform of the document's display and view."""
        view = self.document.state["view"]
        return shown_by(
            self.session.resources.color, self.source.space, view["display"], view["view"], view["exposure"]
        )

    def picture(self, pixels: np.ndarray, shown: Shown) -> np.ndarray:
        """Convert (height, width, channels) float32 to (height, width, 3) uint8 for the page."""
        color = [0, 1, 2] if self.source.image is None else list(channels_of(self.source.image.first.spec).color)
        chosen = pixels[..., color] if pixels.shape[2] > max(color) else pixels
        if chosen.shape[2] < 3:
            chosen = np.repeat(chosen[..., :1], 3, axis=2)
        return shown(chosen[..., :3])

    # --- saving ---

    async def autosave(self) -> None:
        """Save changes regularly until canceled."""
        while True:
            await asyncio.sleep(RETRY_EVERY if self.unsaved else SAVE_EVERY)
            await self.save_all()

    async def save_all(self) -> None:
        """Save the document and the rooms' work. Pages are told when saving fails and when it succeeds again."""
        failed = []
        for save in (self._save_document, *(room.save_work for room in self.keepers)):
            try:
                await save()
            except Exception as error:  # autosave must survive a bug
                failed.append(str(failure_of(error)))
        text = f"Not saved: {failed[0]}. Your work is kept in memory until saving succeeds." if failed else ""
        if text != self.unsaved:
            self.unsaved = text
            self.tell({"do": "unsaved", "text": text})

    async def _save_document(self) -> None:
        if write := self.document.unsaved():
            await asyncio.to_thread(write)

    async def end(self) -> None:
        """Disconnect the pages, finish files that are being saved, and drop everything else."""
        for page in self.pages:
            page.tell(None)
        self.rooms["tile"].rest()
        while self._tasks:
            await asyncio.wait(self._tasks)
        await asyncio.to_thread(self.close)

    def close(self) -> None:
        """Save, release the document, and disconnect from the resident process."""
        for save in (self.document.save, *(room.close for room in self.keepers)):
            try:
                save()
            except Error as error:
                log.error("Not saved: %s", error)
        release_folder(self.spare)
        self.rest()


def reduced(pixels: np.ndarray, most: int = MOST_SHOWN) -> np.ndarray:
    """(height, width, channels) float32, reduced so that no side exceeds `most`."""
    scale = min(1.0, most / max(pixels.shape[:2]))
    height, width = (max(1, round(n * scale)) for n in pixels.shape[:2])
    return resized(pixels, width, height)


def _free(path: Path) -> Path:
    """The path, or one with a number added if the path exists."""
    names = itertools.chain([path], (path.with_name(f"{path.stem}_{n}{path.suffix}") for n in itertools.count(2)))
    return next(name for name in names if not os.path.lexists(name))  # a broken link could lead anywhere


def labels_of(made: dict[str, Any]) -> list[str]:
    """Part names of the label maps in a result of --texlabel, the coarsest last."""
    return [part["name"] for part in made["parts"] if part["name"].startswith("label.")]
