# SPDX-License-Identifier: Apache-2.0
"""The page's server: Starlette and uvicorn, reachable from this machine only, by default."""

from __future__ import annotations

import contextlib
import logging
import signal
import socket
import threading
import webbrowser
from collections.abc import AsyncIterator, Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from oiiotex.engine.errors import Error, ParameterError, one_line

from ..api.images import Image, Session
from .guard import LOOPBACK, Guard, token_for

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

    from .photos.strip import PhotoStrip

MOST_UPLOAD = 32 << 20  # bytes of a message from a page
_MOST_CONNECTIONS = 64
_TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


def serve(
    photos: Sequence[tuple[Image, tuple[str, ...]]], words: tuple[str, ...], session: Session, *, host: str, port: int,
    token: str, open_page: bool, graph: Path | None, document: Path | None, pixel_type: str = "",
) -> None:  # fmt: skip
    """Serve the page of photos or of an exemplar graph until the process is interrupted.

    Parameters
    ----------
    photos : sequence of (Image, tuple of str)
        Photos, and for each the command line up to it. Without a photo and `graph`, the page asks for photos.
    words : tuple of str
        Options of the command line that apply throughout, for a graph and for photos that a page opens.
    session : Session
        Session of the command line.
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
        raise Error(f"{error.name} is not installed: pip install oiiotex-studio") from error
    token = token_for(host, token)
    listening = _listening(host, port)
    strip = _strip(photos, words, session, graph, document, pixel_type)
    guarded = Guard(_application(strip), token, _names(host))
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


def _strip(
    photos: Sequence[tuple[Image, tuple[str, ...]]], words: tuple[str, ...], session: Session, graph: Path | None,
    document: Path | None, pixel_type: str,
) -> PhotoStrip:  # fmt: skip
    """The photos of the line, or its graph, in a strip."""
    from .photos.opening import OpenPhoto, hub_of
    from .photos.strip import PhotoStrip

    folder = Path() if document is None else document.parent
    strip = PhotoStrip(session, folder, words, pixel_type)
    if graph is not None:
        strip.add(hub_of(None, session, folder, words=words, graph=graph, document=document, pixel_type=pixel_type))
    elif len(strip.open([OpenPhoto(*photo) for photo in photos], document)) > 1 and document is not None:
        raise ParameterError("document conflicts with several photos: each has its own")
    return strip


def _application(strip: PhotoStrip) -> Starlette:
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
        path = strip.saved(name)
        return Response(status_code=404) if path is None or not path.is_file() else FileResponse(path, filename=name)

    @contextlib.asynccontextmanager
    async def while_it_runs(_: Starlette) -> AsyncIterator[None]:
        strip.start()
        try:
            yield
        finally:
            await strip.end()

    routes = [
        WebSocketRoute("/wire", strip.attend_photo),
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
