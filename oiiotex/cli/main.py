# SPDX-License-Identifier: Apache-2.0
"""The program: settings, exit codes, signals."""

from __future__ import annotations

import os
import sys
import traceback
from typing import NoReturn

from ..errors import Error
from .stopping import Stopped, stop_on_signals


def main(words: list[str] | None = None) -> NoReturn:
    """Run the command line and exit: 0 well, 1 an error, 130 and 143 after SIGINT and SIGTERM."""
    words = sys.argv[1:] if words is None else words
    _open_standard_streams()
    try:
        stop_on_signals()
        status = _run(words)
    except Stopped as stopped:
        status = 128 + stopped.number
        _drop_stdout()
    sys.exit(status)


def _run(words: list[str]) -> int:
    try:
        from .running import run  # only now: a signal while much is imported is answered too

        status = run(words)
    except Error as error:
        return _failed(words, str(error))
    except MemoryError:
        return _failed(words, "out of memory: lower --cache, or make the tile or the photo smaller")
    except BrokenPipeError:  # who reads what is printed has gone, with files perhaps not written
        _drop_stdout()
        return 141  # as a shell says it of a program that SIGPIPE ends
    except Exception as error:  # a fault of ours or of the machine: still one line, the rest on demand
        kind = "" if isinstance(error, OSError) else f"internal, {type(error).__name__}: "
        return _failed(words, f"{kind}{error} (--debug shows where)")
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # all is done, and nobody wants to read more
        _drop_stdout()
    except OSError as error:
        return _failed(words, f"what is printed cannot be written: {error.strerror}")
    return status


def _failed(words: list[str], text: str) -> int:
    """Say what went wrong in one line, behind what has been printed."""
    if any(word in ("--debug", "-debug") for word in words):
        traceback.print_exc()
    try:
        sys.stdout.flush()
    except OSError:
        _drop_stdout()
    try:
        print(f"oiiotex ERROR: {' '.join(text.split())}", file=sys.stderr, flush=True)
    except OSError:  # nobody listens: the exit code has to do
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    return 1


def _open_standard_streams() -> None:
    """What came closed goes nowhere: else the next file opened would get its number, and what libraries print."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115 - open as long as the process
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    sys.stdout.reconfigure(errors="surrogateescape")  # names that are not UTF-8 are printed as they are


def _drop_stdout() -> None:
    """What is left to print goes nowhere: Python would try a full or broken stdout once more at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
