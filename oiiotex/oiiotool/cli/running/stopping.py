# SPDX-License-Identifier: Apache-2.0
"""Signals that end a run: the first unwinds it, a second one ends it at once; no unfinished file remains.

Imports little, so that signals are handled while the program is loading.
"""

from __future__ import annotations

import _signal as signal  # `signal` itself takes a millisecond to name its constants
import os
import sys
from collections.abc import Callable
from types import FrameType

from ....engine.guard import ENDS, SERVES, guarded

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_ATOMIC, _CHECKPOINT = "oiiotex.engine.io.atomic", "oiiotex.engine.io.checkpoint"
_GRACE = 0.4  # s for the main thread to handle a signal, and again to unwind

_requested = 0  # the signal that asked the run to end


class Stopped(BaseException):
    """A signal ends the run: unwinding removes unfinished files."""

    def __init__(self, number: int):
        self.number = number


def stop_on_signals() -> None:
    """Let SIGINT, SIGTERM and SIGHUP raise `Stopped` in the main thread."""
    _handle(SIGNALS, _stop)
    sys.unraisablehook = _end_or_report


def end_on_signals() -> None:
    """Let SIGTERM and SIGHUP end this process at once: a worker, which ignores SIGINT."""
    end_undisturbed()
    watch_signals()


def end_undisturbed() -> None:
    """Ignore SIGINT while Python ends, so that it does not change the exit code; other signals end it at once."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _handle(SIGNALS[1:], end_at_once)


def _handle(numbers: tuple[int, ...], handler: Callable[[int, FrameType | None], object]) -> None:
    for number in numbers:
        if signal.getsignal(number) != signal.SIG_IGN:  # as nohup and shells' background jobs have it
            signal.signal(number, handler)


def watch_signals() -> None:
    """Start what ends the process if library code keeps the main thread from handling a signal: a thread and a guard.

    The thread ends it with the signal's exit code. The guard, a process, kills it where the thread does not run either.
    """
    import threading

    source, sink = os.pipe()
    os.set_blocking(sink, False)
    signal.set_wakeup_fd(sink, warn_on_full_buffer=False)
    source = guarded(SIGNALS, source)
    threading.Thread(target=_watch, args=(source, sink), name="oiiotex-signals", daemon=True).start()


def _watch(source: int, sink: int) -> None:
    import time

    while True:
        number = os.read(source, 1)[0]
        if signal.getsignal(number) not in (_stop, end_at_once):  # another handler, such as a server's
            os.write(sink, SERVES)
            continue
        os.write(sink, ENDS)
        time.sleep(_GRACE)
        if _requested:  # and unwinds
            time.sleep(_GRACE)
        end_at_once(number)


def stopped_by() -> int:
    """The signal that asked the run to end; 0 before."""
    return _requested


def raise_if_stopped() -> None:
    """Raise `Stopped` again if other code, such as an importing C module, has replaced it by another error."""
    if _requested:
        raise Stopped(_requested)


def end_at_once(number: int, _: object = None) -> None:
    """Signal handler: remove unfinished files, name those kept for resuming, and end the process."""
    if _writing():
        sys.modules[_ATOMIC].discard_all()
    try:
        if say_all_kept := getattr(sys.modules.get(_CHECKPOINT), "say_all_kept", None):
            say_all_kept()
    finally:
        os._exit(128 + number)


def end_finished(status: int) -> None:
    """End the process after its work, with all that Python does at exit but freeing every object.

    That takes a sixth of the time of a short line.
    """
    import atexit
    import contextlib
    import threading

    threading._shutdown()  # type: ignore[attr-defined]  # waits for threads
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # closed
            stream.flush()
    os._exit(status)


def end_unwound(number: int) -> None:
    """End the process after `Stopped` has unwound it, and remove files that unwinding missed.

    Python does not finalize itself: that aborts while threads of libraries still run.
    """
    import atexit

    atexit._run_exitfuncs()
    end_at_once(number)


def _writing() -> bool:
    """Whether there are unfinished files, without loading the module that writes them."""
    return hasattr(sys.modules.get(_ATOMIC), "discard_all") and sys.modules[_ATOMIC].is_writing()


def _stop(number: int, frame: FrameType | None) -> None:
    global _requested
    if _requested or _imports(frame):  # C++ modules abort on an exception while they are loading
        end_at_once(number)
    _requested = number
    raise Stopped(number)


def _imports(frame: FrameType | None) -> bool:
    """Whether a frame is inside an import."""
    while frame is not None and not frame.f_code.co_filename.startswith("<frozen importlib"):
        frame = frame.f_back
    return frame is not None


def _end_or_report(lost: sys.UnraisableHookArgs) -> None:
    """End the run at once on a `Stopped` raised where Python drops exceptions: in destructors and imports."""
    if isinstance(lost.exc_value, Stopped):
        end_at_once(lost.exc_value.number)
    sys.__unraisablehook__(lost)
