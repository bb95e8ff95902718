# SPDX-License-Identifier: Apache-2.0
"""--texlive: a page in the browser, on what the line has made so far."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.parameters import param
from ...errors import ParameterError
from ..language.parse import Option, parse
from ..stack.chain import Chain


@dataclass(frozen=True)
class LiveModifiers:
    """Of --texlive."""

    port: int = param(0, ge=0, le=65535, help="where it listens; 0: any that is free")
    open: bool = param(True, help="open it in the browser")
    host: str = param("127.0.0.1", help="the address that is listened at; beyond this machine with token alone")
    token: str = param("", help="of the URL, 16 letters and digits or more; a new one when left out")
    graph: Path | None = param(None, help="an exemplar graph to zoom into, instead of an image")
    document: Path | None = param(
        None, help="where what is done there is kept; NAME.texlive.json in the current folder when left out"
    )


def show(chain: Chain, given: LiveModifiers) -> None:
    """Tune, paint and zoom in a browser: the page of the top image, or of a graph."""
    if given.graph is None:
        image = chain.top
    elif chain.stack:
        raise ParameterError("graph says what is zoomed into: leave the image out")
    else:
        image = None
    from ..vocabulary import LANGUAGE  # which has this option

    words = list(chain.session.settings.words)
    end = next(n for n, word in enumerate(words) if word.lstrip("-").split(":")[0] == "texlive")
    for step in parse(words[end + 1 :], LANGUAGE).steps:
        if step.option is None or not (step.option.throughout or step.option.control):
            raise ParameterError(f"nothing behind it is done, as {step.word}: the page saves what is made there")
    if not chain.acts():
        return
    from ...live.server import serve

    serve(
        image, chain.session, tuple(words[:end]), host=given.host, port=given.port, token=given.token,
        open_page=given.open, graph=given.graph, document=given.document,
    )  # fmt: skip


OPTIONS = (Option("--texlive", show, LiveModifiers),)
