# SPDX-License-Identifier: Apache-2.0
"""The program: settings, exit codes, signals."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
import time
import traceback
from types import FrameType
from typing import NoReturn

from ..errors import Error, ParameterError
from ..session import Session
from .language import LANGUAGE
from .parse import CommandLine, parse


class _Signal(BaseException):
    """A signal asked the run to end: unwinds it, so that nothing half is left behind."""

    def __init__(self, number: int):
        self.number = number


def main(words: list[str] | None = None) -> NoReturn:
    """Run the command line and exit: 0 well, 1 an error, 130 and 143 after SIGINT and SIGTERM."""
    words = sys.argv[1:] if words is None else words
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _raise_signal)
    status = 0
    try:
        status = run(words)
        sys.stdout.flush()
    except Error as error:
        if _debugging(words):
            traceback.print_exc()
        sys.exit(f"oiiotex ERROR: {error}")
    except MemoryError:
        sys.exit("oiiotex ERROR: out of memory: lower --cache, or make the tile or the photo smaller")
    except BrokenPipeError:
        _drop_stdout()
        sys.exit(0)
    except _Signal as stop:
        sys.exit(128 + stop.number)
    except Exception as error:  # a fault of ours or of the machine: still one line, the rest on demand
        if _debugging(words):
            traceback.print_exc()
        _drop_stdout()
        kind = "" if isinstance(error, OSError) else f"internal, {type(error).__name__}: "
        sys.exit(f"oiiotex ERROR: {kind}{' '.join(str(error).split())} (--debug shows where)")
    sys.exit(status)


def _drop_stdout() -> None:
    """What is left to print goes nowhere: Python would try a full or broken stdout once more at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _debugging(words: list[str]) -> bool:
    return any(word in ("--debug", "-debug") for word in words)


def _raise_signal(number: int, _: FrameType | None) -> NoReturn:
    raise _Signal(number)


def run(words: list[str], folder: str | os.PathLike | None = None) -> int:
    """Do what a command line says, in `folder` if one is given; returns the exit code, 1 where images differ.

    Raises
    ------
    Error
        Something is wrong.
    """
    if folder is not None:
        with contextlib.chdir(folder):
            return run(words)
    start = time.perf_counter()
    command = parse(words, LANGUAGE)
    settings = command.settings
    logging.basicConfig(format="%(message)s", level=logging.INFO if _wants_report(command) else logging.WARNING)
    if _prints_only(command):
        return 0
    from . import report
    from .chain import Chain

    session = Session(
        device_name=_first(settings, "--device"),
        threads=_whole_number(settings, "--threads"),
        colorconfig=_first(settings, "--colorconfig"),
        autocc="--autocc" in settings,
        progress=report.progress_bar(),
        measure=_wants_report(command),
        profile="--runstats" in settings,
    )
    if "--cache" in settings:
        session.budget = _whole_number(settings, "--cache") << 20
    chain = Chain(session)
    chain.run(command.steps)
    if "--runstats" in settings:
        print(report.time_table(session.stats, time.perf_counter() - start))
    return chain.status


def _prints_only(command: CommandLine) -> bool:
    """Serve the options that print something and end."""
    from . import report

    settings = command.settings
    if "--help" in settings or not (settings or command.steps):
        topic = _first(settings, "--help")
        print(report.page(topic) if topic else report.overview())
    elif "--version" in settings:
        print(report.versions())
    elif "--devices" in settings:
        print(report.device_list(_whole_number(settings, "--threads")))
    else:
        return False
    return True


def _wants_report(command: CommandLine) -> bool:
    return "-v" in command.settings or "--runstats" in command.settings


def _first(settings: dict[str, tuple[str, ...]], name: str) -> str | None:
    return next(iter(settings.get(name, ())), None)


def _whole_number(settings: dict[str, tuple[str, ...]], name: str) -> int:
    text = _first(settings, name) or "0"
    if not (text.isascii() and text.isdigit()):
        raise ParameterError(f"{name} {text}: allowed is a whole number >= 0")
    return int(text)


if __name__ == "__main__":
    main()
