# SPDX-License-Identifier: Apache-2.0
"""A client of the resident process, which starts it on demand and requests images from it."""

from __future__ import annotations

import itertools
import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError, Future
from pathlib import Path
from subprocess import DEVNULL
from typing import TYPE_CHECKING, Any

from ...engine.core.image import Image
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import Error, of_facts, reason_of
from ...engine.machine import start_python
from ...engine.session.progress import Onlooker
from .messages import Link, LinkError
from .pictures import image_facts
from .settings import ResidentSettings

if TYPE_CHECKING:
    from subprocess import Popen

_START = 30.0  # s; timeout for the start of a process
BRUSH, TILES, LOOKS, EXPORT = 0, 2, 5, 9  # priorities: interactive, visible tiles, previews, files

Reply = tuple[dict[str, Any], list["np.ndarray"]]


class Request(Future[Reply]):
    """A pending request. Its result are the reply's facts and arrays.

    Parameters
    ----------
    client : Client
    number : int
    on_look : callable or None
        Called with (pixels, whole), on the client's thread.
    on_progress : callable or None
        Called with (done, total), on the client's thread.
    """

    def __init__(
        self, client: Client, number: int, on_look: Onlooker | None, on_progress: Callable[[int, int], object] | None
    ):
        super().__init__()
        self.set_running_or_notify_cancel()  # `stop` cancels; the process confirms it
        self._client, self._number = client, number
        self.on_look, self.on_progress = on_look, on_progress

    def stop(self) -> None:
        """Cancel the request: its result becomes a CancelledError, unless it is already done."""
        if not self.done():
            self._client.tell({"do": "cancel", "job": self._number})


class Client:
    """A connection to the resident process.

    Parameters
    ----------
    link : Link
    """

    def __init__(self, link: Link):
        self._link = link
        self._numbers = itertools.count(1)
        self._open: dict[int, Request] = {}
        self._lock = threading.Lock()
        self._ended = False
        threading.Thread(target=self._listen, name="oiiotex-replies", daemon=True).start()

    @property
    def ended(self) -> bool:
        """Whether the process has ended."""
        return self._ended

    def put(self, image: Image) -> int:
        """Send an image, and return its number."""
        pixels = [np.ascontiguousarray(part.pixels()) for part in image.parts]
        return int(self._ask({"do": "put", "image": image_facts(image)}, pixels).result()[0]["number"])

    def drop(self, number: int) -> None:
        """Delete an image in the process."""
        self.tell({"do": "drop", "image": number})

    def make(
        self, op: str, images: Sequence[int] = (), values: Mapping[str, object] | None = None, *,
        optional: Mapping[str, int | str] | None = None, priority: int = LOOKS, measure: bool = False,
        until: str | None = None, read: str | None = None, keep: bool = True, on_look: Onlooker | None = None,
        on_progress: Callable[[int, int], object] | None = None,
    ) -> Request:  # fmt: skip
        """Run an op in the process (`work.Bench.make`).

        Parameters
        ----------
        op : str
            Name of the op's function.
        images : sequence of int
            Numbers of the required images.
        values : mapping
            Values by modifier: strings, or objects that print as such.
        optional : mapping
            Optional images by modifier: a number, or the name of a part of the first image.
        priority : int
            0 is the most urgent, and interrupts less urgent jobs.
        measure : bool
            Whether to measure the result, as -v does.
        until : str, optional
            'look': stop at the first preview of the result, whose pixels are the reply's array.
        read : str, optional
            The part whose pixels are the reply's array; '': the first.
        keep : bool
            Whether the process keeps the resulting images until they are dropped.
        on_look, on_progress : callable, optional
            As in `Request`.
        """
        modifiers = {key: f"{int(v) if isinstance(v, bool) else v}" for key, v in (values or {}).items()}
        facts = {
            "do": "make", "op": op, "images": list(images), "values": modifiers, "optional": dict(optional or {}),
            "priority": priority, "measure": measure, "until": until, "read": read, "keep": keep,
            "look": on_look is not None,
        }  # fmt: skip
        return self._ask(facts, (), on_look, on_progress)

    def read(self, image: int, window: Window | None = None, part: str = "", priority: int = LOOKS) -> Request:
        """Request the pixels of a window; the reply's array is (height, width, channels), of the part's pixel type."""
        facts = {"do": "read", "image": image, "part": part, "priority": priority}
        return self._ask(facts | {"window": None if window is None else list(window)})

    def hello(self) -> dict[str, Any]:
        """The facts of the process (`Resident.facts`)."""
        return self._ask({"do": "hello"}).result()[0]

    def end(self) -> None:
        """Ask the process to end."""
        self.tell({"do": "end"})

    def close(self) -> None:
        """Disconnect: the process drops images and jobs of this client."""
        self._link.close()

    def tell(self, facts: dict[str, Any]) -> None:
        """Send a request and ignore the answer."""
        self._ask(facts)

    def _ask(
        self, facts: dict[str, Any], arrays: Sequence[np.ndarray] = (), on_look: Onlooker | None = None,
        on_progress: Callable[[int, int], object] | None = None,
    ) -> Request:  # fmt: skip
        """The request. If the process has ended before, its result is a LinkError, as if it ended afterwards."""
        number = next(self._numbers)
        request = Request(self, number, on_look, on_progress)
        with self._lock:
            ended = self._ended
            if not ended:
                self._open[number] = request
        try:
            if ended:
                raise LinkError("the resident process has ended")
            self._link.send(facts | {"id": number}, arrays)
        except Error as error:
            with self._lock:
                is_open = self._open.pop(number, None) is not None  # else `_listen` has set its result
                self._ended |= isinstance(error, LinkError)  # maybe before `_listen` hears of it
            if not isinstance(error, LinkError):
                raise
            if is_open or ended:
                request.set_exception(error)
        return request

    def _listen(self) -> None:
        try:
            while True:
                facts, arrays = self._link.receive()
                request = self._open.get(facts["re"])
                if request is not None:
                    self._hear(request, facts, arrays)
        except LinkError as error:
            with self._lock:
                self._ended = True
                left, self._open = list(self._open.values()), {}
            for request in left:
                request.set_exception(error)

    def _hear(self, request: Request, facts: dict[str, Any], arrays: list[np.ndarray]) -> None:
        state = facts["state"]
        if state == "look":
            if request.on_look is not None:
                request.on_look(arrays[0], facts["whole"])
            return
        if state == "progress":
            if request.on_progress is not None:
                request.on_progress(facts["done"], facts["total"])
            return
        with self._lock:
            self._open.pop(facts["re"], None)
        if state == "done":
            request.set_result((facts, arrays))
        elif state == "canceled":
            request.set_exception(CancelledError())
        else:
            request.set_exception(of_facts(facts))


def connect(settings: ResidentSettings) -> Client:
    """A client of the process with these settings, which is started if needed.

    Raises
    ------
    Error
        The process cannot be started.
    """
    path = str(settings.socket())
    process, until = None, time.monotonic() + _START
    while True:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.connect(path)
            client = Client(Link(connection))
            client.hello()  # fails if the process is about to end
            return client
        except (OSError, LinkError) as error:
            connection.close()
            if time.monotonic() > until:
                raise Error(f"the resident process does not answer: {reason_of(error)}") from error
        if process is None:
            process = _started(settings)
        elif process.poll() not in (None, 0):
            lines = _log_of(settings).read_text(errors="replace").strip().splitlines() or ["no error message"]
            raise Error(f"the resident process cannot be started: {lines[-1]}")
        time.sleep(0.02)


def _started(settings: ResidentSettings) -> Popen[Any]:
    with open(_log_of(settings), "wb") as log:
        return start_python(
            "oiiotex.oiiotool.service", settings.text(), stdin=DEVNULL, stdout=log, stderr=log, start_new_session=True
        )


def _log_of(settings: ResidentSettings) -> Path:
    return settings.socket().with_suffix(".log")
