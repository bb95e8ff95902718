# SPDX-License-Identifier: Apache-2.0
"""The program: settings, exit codes, signals."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from typing import NoReturn

from ..errors import Error
from .running import Stopped, run, stop


def main(words: list[str] | None = None) -> NoReturn:
    """Run the command line and exit: 0 well, 1 an error, 130 and 143 after SIGINT and SIGTERM."""
    words = sys.argv[1:] if words is None else words
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
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
    except Stopped as stopped:
        sys.exit(128 + stopped.number)
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


if __name__ == "__main__":
    main()
