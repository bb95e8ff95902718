# SPDX-License-Identifier: Apache-2.0
"""All pages of one document. A change in one page is sent to the others; images go to the pages that show them."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import logging
import struct
import time
from collections.abc import Callable, Coroutine, MutableMapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from ..api.files import require_plain
from ..api.images import Image, Part, Session, Shown, Window, channels_of, shown_by, views, write
from ..api.painting import AUTOMATIC, PRESETS
from ..api.service import BRUSH, EXPORT, Client, LinkError, ResidentSettings, connect, spec_of
from ..deferred import np, oiio
from ..errors import Error, ParameterError
from .document import Document
from .lines import output_name, type_in

SAVE_EVERY = 0.5  # s; at most this much work is lost
RETRY_EVERY = 2.0  # s, after saving has failed
MOST_PAGES = 16
MOST_TASKS = 64  # unfinished requests of all pages
_PATIENCE = 10.0  # s between two restarts of the resident process
MALFORMED = (ValueError, KeyError, TypeError, AttributeError, RecursionError, struct.error)
_LOOKING = {"label": "Finding labels", "dominant": "Finding the dominant texture"}
_WAITING = 1024  # queued messages; a slower page is disconnected

log = logging.getLogger("oiiotex")


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


class Page:
    """One browser's connection."""

    def __init__(self, wire: WebSocket):
        self.wire = wire
        self._waiting: asyncio.Queue[str | bytes | None] = asyncio.Queue(_WAITING)

    def tell(self, message: str | bytes) -> None:
        """Queue a message. A page that is too slow is disconnected, and will reconnect."""
        try:
            self._waiting.put_nowait(message)
        except asyncio.QueueFull:
            while not self._waiting.empty():
                self._waiting.get_nowait()
            self._waiting.put_nowait(None)

    async def send_all(self) -> None:
        """Send queued messages until the page is disconnected."""
        while (message := await self._waiting.get()) is not None:
            await (self.wire.send_text(message) if isinstance(message, str) else self.wire.send_bytes(message))
        await self.wire.close(1013)


class Hub:
    """The document's pages, its rooms, and the resident process that works for them.

    `unsaved`: why something is not saved, '' if everything is. `keepers`: rooms with work to save: their `save_work` is
    called regularly, and `close` at the end.
    """

    def __init__(self, source: PageSource, document: Document, session: Session, spare: Path):
        self.source, self.document, self.session, self.spare = source, document, session, spare
        self.unsaved, self.keepers = "", list[Any]()
        self.pages: set[Page] = set()
        self._client: Client | None = None
        self._connecting = asyncio.Lock()
        self._photo: int | None = None
        self._making, self._saving = asyncio.Lock(), asyncio.Lock()
        self._made: dict[str, dict[str, Any]] = {}
        self._pinned: dict[int, bool] = {}  # images being saved; whether to drop them afterwards
        self._restarted = -_PATIENCE
        self.saved: dict[str, Path] = {}  # files that pages have saved, by name, which they can download
        self.rooms: dict[str, Any] = {}
        self.loop: asyncio.AbstractEventLoop | None = None
        self._tasks: set[asyncio.Task[Any]] = set()

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

    async def made(self, op: str) -> dict[str, Any]:
        """The photo with the parts that an op adds: 'number' and 'parts', from the resident process."""
        photo, client = await self.photo(), await self.client()
        async with self._making:
            if op not in self._made:
                advance = self.advancing(_LOOKING[op])
                request = client.make(op, [photo], {"keep": 1}, priority=BRUSH, on_progress=advance)
                facts, _ = await asyncio.wrap_future(request)
                self._made[op] = facts["images"][0]
            return self._made[op]

    def output(self, what: str) -> tuple[str, str]:
        """The file name and the pixel type of a room's output, 'tile', 'painted' or 'zoom'."""
        chosen = self.document.state["output"]
        pixel_type = chosen["type"] or self.source.pixel_type
        name = chosen.get(what) or output_name(self.source.stem, what, pixel_type)
        return name, chosen["type"] or type_in(name, pixel_type)

    async def save(self, made: dict[str, Any], name: str, pixel_type: str) -> None:
        """Write an image of the resident process to the document's folder, in bands, at the lowest priority.

        Parameters
        ----------
        made : dict
            'number' and 'parts', from the resident process.
        name : str
            File name; a number is added if the file exists.
        pixel_type : str
            As `output` gives it.
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
        self.tell({"do": "saved", "name": path.name})

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

    def begin(self, work: Coroutine[Any, Any, None], page: Page | None = None) -> None:
        """Run a coroutine. An error is sent to the page that asked for it, or to all pages."""
        assert self.loop is not None
        task = self.loop.create_task(self._run(work, page))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _run(self, work: Coroutine[Any, Any, None], page: Page | None) -> None:
        try:
            await work
        except Exception as error:
            self._tell_failure(error, page)

    def _tell_failure(self, error: Exception, page: Page | None) -> None:
        """Send an error's fields and its message to a page, or to all."""
        if page is not None and isinstance(error, MALFORMED):
            error = Error("the page's message is malformed")
        elif not isinstance(error, Error):
            error = Error(f"internal error: {type(error).__name__}: {error}")
            log.error("oiiotex ERROR: %s", error)
        message = error.facts() | {"do": "error", "text": f"oiiotex ERROR: {error}"}
        if page is None:
            self.tell(message)
        else:
            page.tell(json.dumps(message))

    def tell(self, message: dict[str, Any], but: Page | None = None) -> None:
        """Send a message to all pages."""
        text = json.dumps(message)
        for page in self.pages:
            if page is not but:
                page.tell(text)

    def show(self, facts: dict[str, Any], pixels: np.ndarray, to: Page | None = None) -> None:
        """Send an image, (height, width, 1, 3 or 4) uint8, to all pages or to one."""
        facts = facts | {"width": pixels.shape[1], "height": pixels.shape[0], "channels": pixels.shape[2]}
        head = json.dumps(facts).encode()
        head += b" " * (-len(head) % 4)
        frame = struct.pack("<I", len(head)) + head + np.ascontiguousarray(pixels).tobytes()
        for page in self.pages if to is None else (to,):
            page.tell(frame)

    async def attend(self, wire: WebSocket) -> None:
        """Serve a page from its first to its last message."""
        await wire.accept()
        if len(self.pages) >= MOST_PAGES:
            await wire.close(1013)
            return
        self.loop = asyncio.get_running_loop()
        page = Page(wire)
        self.pages.add(page)
        sending = asyncio.create_task(page.send_all())
        try:
            page.tell(json.dumps({"do": "hello", "state": self.document.state} | self._facts()))
            for room in self.rooms.values():
                self.begin(room.greet(page))
            while True:
                message = await wire.receive()
                if message["type"] == "websocket.disconnect":
                    break
                self._take(page, message)
        except (WebSocketDisconnect, RuntimeError):  # the page has disconnected
            pass
        finally:
            self.pages.discard(page)
            sending.cancel()
            for room in self.rooms.values():
                room.leave(page)

    def _take(self, page: Page, message: MutableMapping[str, Any]) -> None:
        try:
            data = b""
            text = message.get("text")
            if text is None:
                packed = message["bytes"]
                (length,) = struct.unpack_from("<I", packed)
                text, data = packed[4 : 4 + length].decode(), packed[4 + length :]
            asked = json.loads(text)
            require_plain(asked)
            self._answer(page, asked, data)
        except (Error, *MALFORMED) as error:
            self._tell_failure(error, page)

    def _answer(self, page: Page, asked: dict[str, Any], data: bytes) -> None:
        if len(self._tasks) > MOST_TASKS:
            raise Error("too many requests at once: wait until some have finished")
        if asked["do"] != "set":
            self.begin(self.rooms[asked["room"]].take(page, asked, data), page)
            return
        room = asked["room"]
        if room == "history":
            raise ParameterError("history is read-only: only the Paint room sets it")
        changed = self.document.change(room, asked["values"])
        if changed:
            self.tell({"do": "set", "room": room, "values": changed}, but=page)
            for one in self.rooms.values():
                self.begin(one.changed(room, set(changed)))

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
        }

    # --- colors ---

    def shown(self, space: str | None = "") -> Shown:
        """The display transform of the document's display and view."""
        view = self.document.state["view"]
        space = self.source.space if space == "" else space
        return shown_by(self.session.resources.color, space, view["display"], view["view"], view["exposure"])

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
            except Error as error:
                failed.append(str(error))
            except Exception as error:  # autosave must survive a bug
                failed.append(f"internal error: {type(error).__name__}: {error}")
        text = f"Not saved: {failed[0]}. Your work is kept in memory until saving succeeds." if failed else ""
        if text != self.unsaved:
            self.unsaved = text
            self.tell({"do": "unsaved", "text": text})

    async def _save_document(self) -> None:
        if write := self.document.unsaved():
            await asyncio.to_thread(write)

    def close(self) -> None:
        """Save, and disconnect from the resident process."""
        for save in (self.document.save, *(room.close for room in self.keepers)):
            try:
                save()
            except Error as error:
                log.error("Not saved: %s", error)
        if self._client is not None:
            with contextlib.suppress(LinkError):
                self._client.close()


def _free(path: Path) -> Path:
    """The path, or one with a number added if the path exists."""
    names = itertools.chain([path], (path.with_name(f"{path.stem}_{n}{path.suffix}") for n in itertools.count(2)))
    return next(name for name in names if not name.exists())


def labels_of(made: dict[str, Any]) -> list[str]:
    """Part names of the label maps in a result of --texlabel, the coarsest last."""
    return [part["name"] for part in made["parts"] if part["name"].startswith("label.")]
