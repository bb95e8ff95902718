# SPDX-License-Identifier: Apache-2.0
"""A command line, run. What only prints something imports no more than it needs for that."""

from __future__ import annotations

import contextlib
import logging
import os

from ...errors import one_line
from ..language.parse import MOST_THREADS, CommandLine, parse
from ..vocabulary import LANGUAGE

log = logging.getLogger("oiiotex")


def run(words: list[str], folder: str | os.PathLike[str] | None = None) -> int:
    """Do what a command line says, in `folder` if one is given; returns the exit code, 1 where images differ.

    Raises
    ------
    Error
        Something is wrong.
    """
    if folder is not None:
        with contextlib.chdir(folder):
            return run(words)
    command = parse(words, LANGUAGE)
    _start_logging(command)
    text = _printed(command)
    if text is not None:
        print(text)
        return 0
    from .frame_runs import run_frames

    return run_frames(command, words)


def _start_logging(command: CommandLine) -> None:
    level = logging.INFO if command.reports else logging.ERROR if "-q" in command.settings else logging.WARNING
    handler = logging.StreamHandler()
    handler.setFormatter(_OneLine())
    logging.basicConfig(handlers=[handler], level=level)
    log.setLevel(level)


class _OneLine(logging.Formatter):
    """The message alone."""

    def format(self, record: logging.LogRecord) -> str:
        """The text of a record."""
        return one_line(super().format(record))


def _printed(command: CommandLine) -> str | None:
    """The text of the options that print something and end; None where there is work to do."""
    settings = command.settings
    if not (settings or command.steps):
        from ..printing.report import greeting

        return greeting()
    if "--help" in settings:
        from ..printing.report import overview, page

        topic = command.first("--help")
        return page(topic) if topic else overview()
    if "--version" in settings:
        from ..printing.versions import versions

        return versions()
    if "--plugin-path" in settings:
        from ..printing.plugin_path import plugin_path

        return plugin_path()
    if "--devices" in settings:
        from ..printing.devices import device_list

        return device_list(command.first("--device"), command.whole_number("--threads", MOST_THREADS), "-v" in settings)
    if "--completion" in settings:
        from ..printing.shells import completion

        return completion(command.first("--completion") or "")
    if "--manpage" in settings:
        from ..printing.shells import manual

        return manual()
    if "--cache-info" in settings:
        from ..printing.caches import cache_info

        return cache_info()
    if "--cache-clear" in settings:
        from ..printing.caches import cache_clear

        return cache_clear()
    return None
