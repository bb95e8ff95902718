# SPDX-License-Identifier: Apache-2.0
"""The page's server: Starlette and uvicorn, on this machine alone unless the user says otherwise."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import threading
import webbrowser
from collections.abc import AsyncIterator, Iterator
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from ..color.display import usual_view, views
from ..core.attributes import TAG
from ..core.image import Image
from ..errors import Error
from ..io.reading import read
from ..multiscale.graph import read_graph
from ..session import Session
from .document import Document, default_state
from .guard import LOOPBACK, Guard, token_for

if TYPE_CHECKING:
    import uvicorn
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

    from .hub import Hub

MOST_UPLOAD = 32 << 20  # bytes of a message from a page
_MOST_CONNECTIONS = 64
_TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


def serve(
    image: Image | None, session: Session, words: tuple[str, ...], *, host: str, port: int, token: str, open_page: bool,
    graph: Path | None, document: Path | None,
) -> None:  # fmt: skip
    """Serve the page of a photo, or of a graph, until the process is told to end.

    Parameters
    ----------
    image : Image or None
        The photo; None where `graph` says what is zoomed into.
    session : Session
        Of the line.
    words : tuple of str
        The line up to here.
    host : str
        The machine's address that is listened at; beyond loopback `token` must be said.
    port : int
        0: any that is free.
    token : str
        Of the URL; '': a new one.
    open_page : bool
        Open it in the user's browser.
    graph, document : Path or None
        An exemplar graph; where parameters and history are kept, beside the current folder's files when left out.

    Raises
    ------
    Error
        Something is not installed, the port is taken, or the document is another's.
    """
    try:
        import starlette
        import uvicorn
        import websockets  # uvicorn looks for it
    except ImportError as error:
        raise Error(f"{error.name} is not installed: pip install oiiotex[live]") from error
    assert starlette and websockets
    token = token_for(host, token)
    application = _application(_hub(image, session, words, graph, document))
    listening = _listening(host, port)
    port = listening.getsockname()[1]
    guarded = Guard(application, token, _names(host))
    config = uvicorn.Config(
        guarded, log_level="error", access_log=False, server_header=False, ws="websockets-sansio",
        ws_max_size=MOST_UPLOAD, limit_concurrency=_MOST_CONNECTIONS, timeout_graceful_shutdown=2, lifespan="on",
    )  # fmt: skip
    url = f"http://{f'[{host}]' if ':' in host else host}:{port}/{token}/"
    print(f"{url}  (Ctrl-C ends it)", flush=True)
    if open_page:
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
    server = uvicorn.Server(config)
    with listening, _ended_by_hang_up(server):
        server.run(sockets=[listening])


@contextlib.contextmanager
def _ended_by_hang_up(server: uvicorn.Server) -> Iterator[None]:
    """SIGHUP ends the server as SIGINT and SIGTERM do, which uvicorn hears of itself: what is done there is kept."""
    heard: list[int] = []

    def hang_up(number: int, _: object) -> None:
        heard.append(number)
        server.should_exit = True

    before = signal.getsignal(signal.SIGHUP) if hasattr(signal, "SIGHUP") else signal.SIG_IGN
    if before == signal.SIG_IGN or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGHUP, hang_up)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, before)
    if heard:
        signal.raise_signal(signal.SIGHUP)


def _hub(
    image: Image | None, session: Session, words: tuple[str, ...], graph: Path | None, document: Path | None
) -> Hub:
    """The document's hub with its rooms."""
    from .hub import Hub, Source
    from .paint_room import PaintRoom
    from .tile_room import TileRoom
    from .zoom_room import ZoomRoom

    first = image
    if graph is not None:
        described = read_graph(graph)
        first = read(described.files[described.root], session.cache)
    assert first is not None
    tag = first.first.spec.get_string_attribute(TAG)
    space = session.color.resolve(tag) if tag else None
    name = str(graph) if graph is not None else first.source
    stem = Path(name).stem
    side = min(256, 1 << min(first.first.spec.width, first.first.spec.height).bit_length() - 1)
    state = default_state(*usual_view(session.color, space), side)
    state["zoom"]["zoom"] = float(side.bit_length() - 1)
    opened = Document(document or Path(f"{stem}.texlive.json"), state, name, views(session.color))
    source = Source(image, "" if graph is None else str(graph), words, stem, space, side)
    hub = Hub(source, opened, session)
    hub.rooms = {"tile": TileRoom(hub), "paint": PaintRoom(hub), "zoom": ZoomRoom(hub)}
    return hub


def _application(hub: Hub) -> Starlette:
    """The page's files, and its connection."""
    from starlette.applications import Starlette
    from starlette.responses import Response
    from starlette.routing import Route, WebSocketRoute

    folder = resources.files(__package__) / "page"
    files = {entry.name: entry for entry in folder.iterdir()}

    async def file(request: Request) -> Response:
        name = request.path_params.get("name") or "index.html"
        if name not in files or Path(name).suffix not in _TYPES:
            return Response(status_code=404)
        return Response(files[name].read_bytes(), media_type=_TYPES[Path(name).suffix])

    @contextlib.asynccontextmanager
    async def while_it_runs(_: Starlette) -> AsyncIterator[None]:
        saving = asyncio.create_task(hub.save_now_and_then())
        try:
            yield
        finally:
            saving.cancel()
            await asyncio.to_thread(hub.close)

    routes = [WebSocketRoute("/wire", hub.attend), Route("/", file), Route("/{name}", file)]
    return Starlette(routes=routes, lifespan=while_it_runs)


def _names(host: str) -> tuple[str, ...]:
    """By which names a browser may ask for the page."""
    return LOOPBACK if host in LOOPBACK else (*LOOPBACK, host, socket.gethostname())


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise Error(f"port={port} of {host} cannot be listened at: {error.strerror}") from error
