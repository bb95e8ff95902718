# SPDX-License-Identifier: Apache-2.0
"""--texlive: a page in the browser for the top image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from oiiotex.engine.errors import ParameterError

from ..api.images import Image, upright
from ..api.lines import LANGUAGE, Chain, CommandLine, Option, param, parse, require_device


@dataclass(frozen=True)
class LiveModifiers:
    """Modifiers of --texlive."""

    port: int = param(0, ge=0, le=65535, help="TCP port of the server. 0: any free port.")
    open: bool = param(True, help="Open the page in the browser.")
    host: str = param("127.0.0.1", example="0.0.0.0", help="Address of the server. Other machines require token.")
    token: str = param("", unset="random", example="0a1b2c3d4e5f6a7b", help="Token in the URL: 16 or more characters.")
    graph: Path | None = param(None, example="graph.json", help="Exemplar graph to zoom into, instead of an image.")
    document: Path | None = param(None, unset="NAME.texlive.json", help="File that stores the state of the page.")


def show(chain: Chain, given: LiveModifiers) -> None:
    """Open a page in the browser to tune, paint and zoom the images on the stack or a graph."""
    if given.graph is not None and chain.stack:
        raise ParameterError("graph conflicts with an image on the stack: remove one of them")
    words = list(chain.session.settings.words)
    end = next(n for n, word in enumerate(words) if word.lstrip("-").split(":")[0] == "texlive")
    photos, throughout = _photos(chain.stack, words[:end], parse(words[:end], LANGUAGE))
    for step in parse(words[end + 1 :], LANGUAGE).steps:
        if step.option is None or not (step.option.throughout or step.option.control):
            raise ParameterError(f"{step.word} after --texlive never runs: save results on the page")
    if not chain.acts():
        return
    from .server import serve

    require_device(chain.session.settings.device_name, chain.session.settings.threads)  # before a page opens
    pixel_type = str(chain.settings["-d"][0]) if "-d" in chain.settings else ""
    serve(
        photos, throughout, chain.session, host=given.host, port=given.port, token=given.token,
        open_page=given.open, graph=given.graph, document=given.document,
        pixel_type=pixel_type,
    )  # fmt: skip


def _photos(
    stack: Sequence[Image], words: Sequence[str], before: CommandLine
) -> tuple[list[tuple[Image, tuple[str, ...]]], tuple[str, ...]]:
    """Every image of the stack, from the bottom and upright, with its line, which leaves it on top; general options.

    A line that only reads and tags files is split into one line per file. Other lines are kept whole, and pop the
    images above.
    """
    steps = before.steps
    files = [n for n, step in enumerate(steps) if step.op is None and step.option is None]
    throughout = [word for name, arguments in before.settings.items() for word in (name, *arguments)]
    own, plain = [list[str]() for _ in files], len(files) == len(stack)
    for n, step in enumerate(steps):
        if step.option is not None and step.option.throughout:
            throughout += [step.word, *step.arguments]
        elif n in files or (step.name == "--iscolorspace" and n > files[0]):
            own[sum(first <= n for first in files) - 1] += [step.word, *step.arguments]
        else:
            plain = False
    if plain:
        lines = [(*throughout, *said) for said in own]
    else:
        lines = [(*words, *["--pop"] * above) for above in reversed(range(len(stack)))]
    return list(zip(map(upright, stack), lines, strict=True)), tuple(throughout)


OPTION = Option("--texlive", show, LiveModifiers, heading="Viewing")
