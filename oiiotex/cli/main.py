# SPDX-License-Identifier: Apache-2.0
"""The program: settings, exit codes, signals. All but the signals is imported once they are answered."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

from .running.stopping import Stopped, end_unwound, ignore_interrupts, raise_if_stopped, stop_on_signals, watch_signals


def main(words: list[str] | None = None) -> None:
    """Run the command line and exit: 0 well, 1 an error, 3 a measure beyond a limit, 128 + N after a signal N."""
    exit_with(sys.argv[1:] if words is None else words, _line)


def exit_with(words: list[str], work: Callable[[list[str]], int]) -> None:
    """Do the work of a program of this package with its words, and exit with the code that it returns.

    What goes wrong is one line on stderr, and exit 1; after SIGINT, SIGTERM and SIGHUP it is 130, 143 and 129.
    """
    try:
        stop_on_signals()
        from .running.streams import open_standard_streams, quiet_libraries

        open_standard_streams()
        if not _debugging(words):
            quiet_libraries()
        watch_signals()
        status = _run(words, work)
        ignore_interrupts()
    except Stopped as stopped:
        end_unwound(stopped.number)
    import gc

    gc.unfreeze()  # what is held to the end is let go as ever: libraries look for leaks
    sys.exit(status)


def _line(words: list[str]) -> int:
    import gc

    gc.disable()  # of what is imported nothing is rubbish: looking for some takes a tenth of the start
    from .running.line_run import run  # only now: a signal while much is imported is answered too

    gc.freeze()
    gc.enable()
    return run(words)


def _run(words: list[str], work: Callable[[list[str]], int]) -> int:
    from ..errors import OUT_OF_MEMORY, Error, spelled
    from .running.streams import drop

    try:
        if os.environ.get("OCIO"):  # OpenImageIO opens it, whatever it is, with the first image
            from ..io.documents import require_regular

            require_regular(os.environ["OCIO"])
        status = work(words)
    except Error as error:
        return _failed(words, str(error))
    except MemoryError:
        return _failed(words, spelled(OUT_OF_MEMORY))
    except BrokenPipeError:  # who reads what is printed has gone, with files perhaps not written
        drop(1)
        return 141  # as a shell says it of a program that SIGPIPE ends
    except Exception as error:  # a fault of ours or of the machine: still one line, the rest on demand
        raise_if_stopped()
        kind = "" if isinstance(error, OSError) else f"internal, {type(error).__name__}: "
        return _failed(words, f"{kind}{error} (--debug shows where)")
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # all is done, and nobody wants to read more
        drop(1)
    except OSError as error:
        return _failed(words, f"what is printed cannot be written: {error.strerror}")
    return status


def _failed(words: list[str], text: str) -> int:
    """Say what went wrong in one line, behind what has been printed."""
    from ..errors import one_line
    from .running.streams import drop

    if _debugging(words):
        import traceback

        traceback.print_exc()
    try:
        sys.stdout.flush()
    except OSError:
        drop(1)
    try:
        if "--openjd" in words:
            print(f"openjd_fail: {one_line(text)}", flush=True)
        print(f"oiiotex ERROR: {one_line(text)}", file=sys.stderr, flush=True)
    except OSError:  # nobody listens: the exit code has to do
        drop(sys.stderr.fileno())
    return 1


def _debugging(words: list[str]) -> bool:
    return any(word in ("--debug", "-debug") for word in words)


if __name__ == "__main__":
    main()
