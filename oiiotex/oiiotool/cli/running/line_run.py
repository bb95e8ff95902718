# SPDX-License-Identifier: Apache-2.0
"""Run a command line. Options that only print import no more than they need."""

from __future__ import annotations

import contextlib
import logging
import os
from importlib import import_module

from ....engine.errors import one_line
from ..language.parse import MOST_THREADS, CommandLine, parse
from ..vocabulary import LANGUAGE

log = logging.getLogger("oiiotex")

_PRINTING = {  # options that print and end; '': without arguments
    "": "help.topic",
    "--help": "help.topic",
    "--version": "versions.versions",
    "--plugin-path": "plugin_path.plugin_path",
    "--devices": "devices.device_list",
    "--completion": "shells.completion",
    "--cache-info": "caches.cache_info",
    "--cache-clear": "caches.cache_clear",
}


def run(words: list[str], folder: str | os.PathLike[str] | None = None) -> int:
    """Run a command line, in `folder` if given; returns the exit code."""
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
        """The message of a record in one line."""
        return one_line(super().format(record))


def _printed(command: CommandLine) -> str | None:
    """The output of an option that prints and ends; None if there is none."""
    settings = command.settings
    option = next((one for one in _PRINTING if one in settings), None if settings or command.steps else "")
    if option is None:
        return None
    module, _, function = _PRINTING[option].partition(".")
    arguments: tuple[object, ...] = settings.get(option, ())
    if option == "--devices":
        arguments = command.first("--device"), command.whole_number("--threads", MOST_THREADS), "-v" in settings
    return getattr(import_module(f"..printing.{module}", __package__), function)(*arguments)
