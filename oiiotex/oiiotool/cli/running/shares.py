# SPDX-License-Identifier: Apache-2.0
"""Shares of a line's output: each is kept in FILE.parts, until a run with --join assembles FILE from them.

A share is a set of rows of every part, in cells as high as the bands that are written. Cells are keyed by a hash of the
line, the program's version and the input files, so that cells of another line or of changed inputs are never used.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from .... import __version__
from ....engine.core.demand import assembled, cells_of, rows_for, stream
from ....engine.core.image import Image, Part
from ....engine.core.window import Window
from ....engine.deferred import np
from ....engine.errors import ParameterError
from ....engine.io.checkpoint import Checkpoint
from ....engine.session import Session
from ..language.parse import settings_of, without

OPTIONS = settings_of(
    ("--share I/N", "Compute share I of N of the output, in FILE.parts; assemble FILE with --join"),
    ("--join", "Write FILE from the shares of the same line in FILE.parts, and compute missing ones"),
    ("--openjd", "Print progress and failures in the format of Open Job Description"),
)
_SPREAD = {"share": 1, "join": 0, "farm": 1, "openjd": 0}  # options and their numbers of arguments
_HOW = _SPREAD | {  # options that do not change the output
    "device": 1, "threads": 1, "cache": 1, "v": 0, "verbose": 0, "q": 0, "noprogress": 0, "runstats": 0, "debug": 0,
}  # fmt: skip
_MULTIPLE = 64  # rows of cells, as of bands
_SHARE = re.compile(r"([1-9]\d{0,5})/([1-9]\d{0,5})", re.ASCII)


@dataclass(frozen=True)
class Shares:
    """The part of a line's output that a run computes."""

    words: tuple[str, ...]  # of the line, without options that do not change the output
    number: int = 0  # of the share to compute; 0: assemble all
    count: int = 0

    @classmethod
    def of(cls, words: Sequence[str], number: int = 0, count: int = 0) -> Shares:
        """From the complete words of a line."""
        return cls(without(words, _HOW), number, count)

    def compute(self, session: Session, image: Image, path: str, inputs: Sequence[str]) -> None:
        """Compute this share of an image into FILE.parts; existing cells are kept."""
        keeper, session.resources.keeper = session.resources.keeper, Checkpoint(Path(path))
        try:
            for number, part in enumerate(image.parts):
                key = self._key(number, part, inputs)
                cells = cells_of(part.window, (part.spec.width, _cell_rows(part)), part.window)
                mine = cells[len(cells) * (self.number - 1) // self.count : len(cells) * self.number // self.count]
                for cell, pixels in stream(part, [c for c in mine if not session.resources.keeper.holds(key, c)]):
                    session.resources.keeper.piece(key, cell, lambda: pixels)  # noqa: B023 - called at once
                    session.progress.advance(mine.index(cell) + 1, len(mine))
        finally:
            session.resources.keeper = keeper

    def joined(self, session: Session, image: Image, inputs: Sequence[str]) -> Image:
        """The image, read from its cells; to be written within `session.resources.checkpoints`."""
        parts = [self._joined(session, part, self._key(n, part, inputs)) for n, part in enumerate(image.parts)]
        return Image(tuple(parts), image.source)

    def _joined(self, session: Session, part: Part, key: str) -> Part:
        whole, size = part.window, (part.spec.width, _cell_rows(part))

        def cell(place: Window) -> np.ndarray:
            def piece() -> np.ndarray:
                keeper = session.resources.keeper
                return part.read(place) if keeper is None else keeper.piece(key, place, lambda: part.read(place))

            return session.resources.cache.get((key, place), piece)

        return replace(part, fetch=lambda window: assembled(window, size, whole, cell), ready=False)

    def _key(self, number: int, part: Part, inputs: Sequence[str]) -> str:
        from ....engine.io.disk_cache import hash_of  # few lines have shares

        files = [(name, *_facts(name)) for name in sorted(inputs) if os.path.isfile(name)]
        return hash_of(
            __version__, self.words, files, number, part.window, part.spec.channelnames, str(part.spec.format)
        )


def shares_of(settings: dict[str, tuple[str, ...]], words: Sequence[str]) -> Shares | None:
    """The shares that --share or --join selects; None without these options."""
    if "--join" in settings:
        if "--share" in settings:
            raise ParameterError("--share conflicts with --join: run the shares first, then --join alone")
        return Shares.of(words)
    if "--share" not in settings:
        return None
    match = _SHARE.fullmatch(settings["--share"][0])
    if not match or int(match[1]) > int(match[2]):
        raise ParameterError(f"--share {settings['--share'][0]}: expected I/N with I from 1 to N, and N up to 999999")
    return Shares.of(words, int(match[1]), int(match[2]))


def line_of(words: Sequence[str]) -> tuple[str, ...]:
    """The line without options of the farm, as files record it."""
    return without(words, _SPREAD)


def _cell_rows(part: Part) -> int:
    return rows_for(part, multiple=_MULTIPLE)


def _facts(path: str) -> tuple[int, int]:
    """Size in bytes and time of the last change in ns: they identify a file on every machine."""
    status = os.stat(path)
    return status.st_size, status.st_mtime_ns
