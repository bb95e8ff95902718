# SPDX-License-Identifier: Apache-2.0
"""Connections of pages: messages to all or one, and requests, each handled separately or refused with an error."""

from __future__ import annotations

import asyncio
import json
import logging
import struct
from collections.abc import Coroutine, MutableMapping
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from oiiotex.engine.deferred import np
from oiiotex.engine.errors import Error, failure_of

from ..api.files import require_plain

MOST_PAGES = 16
MOST_TASKS = 64  # unfinished requests of all pages
MALFORMED = (ValueError, KeyError, TypeError, AttributeError, ArithmeticError, RecursionError, struct.error)
_WAITING = 1024  # queued messages; a slower page is disconnected

log = logging.getLogger("oiiotex")


class Page:
    """One browser's connection."""

    def __init__(self, wire: WebSocket):
        self.wire, self.tab = wire, "tile"  # the tab that it shows first
        self._waiting: asyncio.Queue[str | bytes | None] = asyncio.Queue(_WAITING)

    def tell(self, message: str | bytes | None) -> None:
        """Queue a message; None ends the connection. A page that is too slow is disconnected, and will reconnect."""
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


class Pages:
    """Pages that show the same. A subclass greets them and answers their messages."""

    def __init__(self) -> None:
        self.pages: set[Page] = set()
        self._tasks: set[asyncio.Task[Any]] = set()

    async def greet(self, page: Page) -> None:
        """Send the state to a new page."""
        raise NotImplementedError

    def left(self, page: Page) -> None:
        """Forget a page that has disconnected."""

    def answer(self, page: Page, asked: dict[str, Any], data: bytes) -> None:
        """Handle a message of a page."""
        raise NotImplementedError

    def begin(self, work: Coroutine[Any, Any, None], page: Page | None = None) -> None:
        """Run a coroutine. An error is sent to the page that asked for it, or to all pages."""
        task = asyncio.get_running_loop().create_task(self._run(work, page))
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
            error = failure_of(error)
            log.error("oiiotex ERROR: %s", error)
        message = error.facts() | {"do": "error", "text": str(error)}
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
            full = Error(f"{MOST_PAGES} tabs are open already: close one of them, and this one connects")
            await wire.send_text(json.dumps(full.facts() | {"do": "error", "text": str(full)}))
            await wire.close(1013)
            return
        page = Page(wire)
        page.tab = wire.query_params.get("tab") or page.tab
        self.pages.add(page)
        sending = asyncio.create_task(page.send_all())
        try:
            await self.greet(page)
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
            self.left(page)

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
            if len(self._tasks) > MOST_TASKS:
                raise Error("too many requests at once: wait until some have finished")
            self.answer(page, asked, data)
        except (Error, *MALFORMED) as error:
            self._tell_failure(error, page)


def gesture_of(page: Page, asked: dict[str, Any]) -> object:
    """The drag, click or key press of a page that a request comes from; None if it does not say."""
    return (id(page), asked["gesture"]) if type(asked.get("gesture")) is int else None
