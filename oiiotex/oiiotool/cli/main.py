# SPDX-License-Identifier: Apache-2.0
"""The program: exit codes and signals. Everything else is imported after the signal handlers are in place."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

from .running.stopping import (
    end_finished,
    end_undisturbed,
    end_unwound,
    raise_if_stopped,
    stop_on_signals,
    stopped_by,
    watch_signals,
)

_LEAST_ADDRESS_SPACE = 512 << 20  # bytes, for libraries alone


def main(words: list[str] | None = None) -> None:
    """Run the command line and exit: 0 success, 1 error, 3 measure beyond a limit, 128 + N after signal N."""
    if words is not None:
        exit_with(words, _line)
    try:
        exit_with(sys.argv[1:], _line)
    except SystemExit as ended:
        end_finished(int(ended.code or 0))


def exit_with(words: list[str], work: Callable[[list[str]], int]) -> None:
    """Call a program of this package with its words, and exit with the code that it returns.

    An error is one line on stderr and exit code 1; after SIGINT, SIGTERM and SIGHUP the code is 130, 143 and 129.
    """
    try:
        stop_on_signals()
        from .running.streams import open_standard_streams, quiet_libraries

        open_standard_streams()
        if not _debugging(words):
            quiet_libraries()
        watch_signals()
        status = _run(words, work)
        raise_if_stopped()
        end_undisturbed()
    except BaseException:  # locks of Python's library and importing C modules replace `Stopped` by their own errors
        if number := stopped_by():
            end_unwound(number)
        raise
    import gc

    gc.unfreeze()  # libraries that look for leaks see objects freed as usual
    sys.exit(status)


def _line(words: list[str]) -> int:
    import gc

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads spin while they wait, and matrices are small
    gc.disable()  # collections while importing find nothing and take a tenth of the startup time
    from .running.line_run import run  # imported here so that signals are handled meanwhile

    gc.freeze()
    gc.set_threshold(10_000)  # imports that follow also allocate many objects
    gc.enable()
    return run(words)


def _run(words: list[str], work: Callable[[list[str]], int]) -> int:
    from ...engine.errors import OUT_OF_MEMORY, Error, reason_of, spelled
    from .running.streams import drop

    try:
        _require_address_space()
        if os.environ.get("OCIO"):  # OpenImageIO opens it with the first image, even a pipe
            from ...engine.io.documents import require_regular

            require_regular(os.environ["OCIO"])
        status = work(words)
    except Error as error:
        return _failed(words, str(error))
    except MemoryError:
        return _failed(words, spelled(OUT_OF_MEMORY))
    except BrokenPipeError:  # the reader of stdout has ended; files may be missing
        drop(1)
        return 141  # as a shell reports a program that SIGPIPE ended
    except Exception as error:  # a bug or a failing machine
        kind = "" if isinstance(error, OSError) else f"internal, {type(error).__name__}: "
        return _failed(words, f"{kind}{reason_of(error)} (--debug prints a traceback)")
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # all work is done
        drop(1)
    except OSError as error:
        return _failed(words, f"cannot write to standard output: {error.strerror}")
    return status


def _require_address_space() -> None:
    """Refuse a limit on memory under which libraries end the process as they are loaded, without a message."""
    try:
        import resource
    except ImportError:  # Windows
        return
    from ...engine.errors import Error

    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most != resource.RLIM_INFINITY and most < _LEAST_ADDRESS_SPACE:
        raise Error(
            f"this process may take {most >> 20} MB of address space",
            expected=f"at least {_LEAST_ADDRESS_SPACE >> 20} MB",
            hint="raise the limit (ulimit -v)",
        )


def _failed(words: list[str], text: str) -> int:
    """Print the error in one line, after flushing stdout, unless it is what a signal has led to."""
    raise_if_stopped()
    from ...engine.errors import one_line
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
    except OSError:  # stderr is closed
        drop(sys.stderr.fileno())
    return 1


def _debugging(words: list[str]) -> bool:
    return any(word in ("--debug", "-debug") for word in words)
