# SPDX-License-Identifier: Apache-2.0
"""Access control of the page's server: requests need the token and must come from its own page."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from oiiotex.engine.errors import ParameterError

LOOPBACK = ("127.0.0.1", "localhost", "::1")
LEAST_TOKEN = 16  # characters, for a user's own token
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self';"
    " base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = (
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


def token_for(host: str, given: str) -> str:
    """The token in the URL: the given one, or a new random one."""
    if given:
        if len(given) < LEAST_TOKEN or not given.isascii() or not given.isalnum():
            raise ParameterError(f"token: expected at least {LEAST_TOKEN} letters and digits")
        return given
    if host not in LOOPBACK:
        raise ParameterError(
            f"host={host} requires token=, with at least {LEAST_TOKEN} letters and digits: the page is open to other"
            " machines, and the connection is not encrypted (ssh -L is)"
        )
    return secrets.token_urlsafe(24)


class Guard:
    """Admits only requests with the token in the path, a known host name, and this server as origin.

    A page of another site does not know the token. If it did, its browser would reveal it by the Origin header, and DNS
    rebinding by the Host header. Uploads are possible only through the page's WebSocket.
    """

    def __init__(self, app: App, token: str, hosts: tuple[str, ...]):
        self._app, self._token, self._hosts = app, token.encode(), hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI entry point."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        status = self._refused(scope)
        if status:
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.close", "code": 1008})
                return
            headers = [(b"content-length", b"0"), (b"connection", b"close")]
            await send({"type": "http.response.start", "status": status, "headers": headers})
            await send({"type": "http.response.body"})
            return

        async def answered(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *_HEADERS]
            await send(message)

        _, token, rest = scope["path"].split("/", 2)
        await self._app({**scope, "path": f"/{rest}", "raw_path": f"/{rest}".encode()}, receive, answered)

    def _refused(self, scope: Scope) -> int:
        """The HTTP status of a refusal; 0 if the request is admitted."""
        headers = dict(scope["headers"])
        host = headers.get(b"host", b"").decode("latin-1")
        if _name(host) not in self._hosts:
            return 421
        parts = scope["path"].split("/", 2)
        if len(parts) < 3 or not hmac.compare_digest(parts[1].encode(), self._token):
            return 403
        origin = headers.get(b"origin", b"").decode("latin-1")
        if origin != f"http://{host}" and (origin or scope["type"] == "websocket"):
            return 403
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD"):
            return 405
        return 0


def _name(host: str) -> str:
    """A Host header without its port, which can differ through an ssh tunnel."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] or host
