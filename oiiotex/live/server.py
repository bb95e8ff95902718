# SPDX-License-Identifier: Apache-2.0
"""The page's server: Starlette and uvicorn, reachable from this machine only, by default."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import socket
import threading
import webbrowser
from collections.abc import AsyncIterator
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from ..api.images import TAG, Image, Session, read, usual_view, views
from ..api.painting import read_graph
from ..api.service import reserved_folder
from ..errors import Error, one_line
from .document import LEAST_PAINTED, Document, default_state
from .guard import LOOPBACK, Guard, token_for

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

    from .hub import Hub

MOST_UPLOAD = 32 << 20  # bytes of a message from a page
_MOST_CONNECTIONS = 64
_PAINTED = 1024  # px, maximum side of a new painting
_TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


def serve(
    image: Image | None, session: Session, words: tuple[str, ...], *, host: str, port: int, token: str, open_page: bool,
    graph: Path | None, document: Path | None, pixel_type: str = "",
) -> None:  # fmt: skip
    """Serve the page of a photo or of an exemplar graph until the process is interrupted.

    Parameters
    ----------
    image : Image or None
        The photo; None with `graph`.
    session : Session
        Session of the command line.
    words : tuple of str
        The command line before --texlive.
    host : str
        Address to listen on. Other addresses than loopback require `token`.
    port : int
        0: any free port.
    token : str
        Secret in the URL; '': a new random one.
    open_page : bool
        Open the page in the default browser.
    graph, document : Path or None
        An exemplar graph; the document that keeps parameters and history, by default NAME.texlive.json in the
        current folder.
    pixel_type : str
        Of files that are made, as -d names it; '': that of the photo, float for a graph.

    Raises
    ------
    Error
        A package is not installed, the port is in use, or the document belongs to another photo or is already open.
    """
    try:
        import starlette  # noqa: F401
        import uvicorn.server
        import websockets  # noqa: F401 - uvicorn looks for it
    except ImportError as error:
        raise Error(f"{error.name} is not installed: pip install oiiotex[live]") from error
    token = token_for(host, token)
    listening = _listening(host, port)
    guarded = Guard(_application(_hub(image, session, words, graph, document, pixel_type)), token, _names(host))
    for logger in ("uvicorn.error", "asyncio"):
        logging.getLogger(logger).addFilter(_in_one_line)
    config = uvicorn.Config(
        guarded, log_level="error", access_log=False, server_header=False, ws="websockets-sansio",
        ws_max_size=MOST_UPLOAD, limit_concurrency=_MOST_CONNECTIONS, timeout_graceful_shutdown=2, lifespan="on",
    )  # fmt: skip
    url = f"http://{f'[{host}]' if ':' in host else host}:{listening.getsockname()[1]}/{token}/"
    print(f"{url}  (press Ctrl-C to stop)", flush=True)
    if open_page:
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
    hang_up = getattr(signal, "SIGHUP", None)
    if hang_up is not None and signal.getsignal(hang_up) != signal.SIG_IGN:  # ignored under nohup
        uvicorn.server.HANDLED_SIGNALS = tuple({*uvicorn.server.HANDLED_SIGNALS, hang_up})
    with listening:
        uvicorn.Server(config).run(sockets=[listening])


def _in_one_line(record: logging.LogRecord) -> bool:
    """Shorten log records: malformed requests must not flood the terminal."""
    error = record.exc_info and record.exc_info[1]
    text = record.getMessage() + (f": {type(error).__name__}: {error}" if error else "")
    record.msg, record.args, record.exc_info = one_line(text)[:300], (), None
    return True


def _hub(
    image: Image | None, session: Session, words: tuple[str, ...], graph: Path | None, document: Path | None,
    pixel_type: str,
) -> Hub:  # fmt: skip
    """The hub of the document, with its rooms."""
    from .hub import Hub, PageSource
    from .painting.room import PaintRoom
    from .tile_room import TileRoom
    from .zoom_room import ZoomRoom

    first = image
    if graph is not None:
        described = read_graph(graph)
        first = read(described.files[described.root], session.resources.cache)
    assert first is not None
    tag = first.first.spec.get_string_attribute(TAG)
    space = session.resources.color.resolve(tag) if tag else None
    name = str(graph) if graph is not None else first.source
    stem = Path(name).stem
    side = min(256, 1 << min(first.first.spec.width, first.first.spec.height).bit_length() - 1)
    state = default_state(*usual_view(session.resources.color, space), side)
    sides = first.first.spec.width, first.first.spec.height
    state["paint"] |= dict(zip(("width", "height"), (min(max(n, LEAST_PAINTED), _PAINTED) for n in sides), strict=True))
    state["zoom"]["zoom"] = float(side.bit_length() - 1)
    pixel_type = pixel_type or ("float" if graph is not None else str(first.first.spec.format))
    path = document or Path(f"{stem}.texlive.json")
    spare = reserved_folder(path)
    opened = Document(path, state, name, views(session.resources.color), spare / "document.json")
    source = PageSource(image, "" if graph is None else str(graph), words, stem, space, side, pixel_type)
    hub = Hub(source, opened, session, spare)
    hub.rooms = {"tile": TileRoom(hub), "paint": PaintRoom(hub), "zoom": ZoomRoom(hub)}
    return hub


def _application(hub: Hub) -> Starlette:
    """The ASGI application: the page's files and its WebSocket."""
    from starlette.applications import Starlette
    from starlette.responses import FileResponse, Response
    from starlette.routing import Route, WebSocketRoute

    folder = resources.files(__package__) / "page"
    files = {entry.name: entry for entry in folder.iterdir()}

    async def file(request: Request) -> Response:
        name = request.path_params.get("name") or "index.html"
        if name not in files or Path(name).suffix not in _TYPES:
            return Response(status_code=404)
        return Response(files[name].read_bytes(), media_type=_TYPES[Path(name).suffix])

    async def saved(request: Request) -> Response:
        """A file that a page has saved, as a download."""
        name = request.path_params["name"]
        path = hub.saved.get(name)
        return Response(status_code=404) if path is None or not path.is_file() else FileResponse(path, filename=name)

    @contextlib.asynccontextmanager
    async def while_it_runs(_: Starlette) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(work) for work in (hub.autosave(), hub.warm_up())]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.to_thread(hub.close)

    routes = [
        WebSocketRoute("/wire", hub.attend),
        Route("/", file),
        Route("/saved/{name}", saved),
        Route("/{name}", file),
    ]
    return Starlette(routes=routes, lifespan=while_it_runs)


def _names(host: str) -> tuple[str, ...]:
    """Host names under which a browser can request the page."""
    return LOOPBACK if host in LOOPBACK else (*LOOPBACK, host, socket.gethostname())


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise Error(f"cannot listen on port {port} of {host}: {error.strerror}; choose another port=") from error
