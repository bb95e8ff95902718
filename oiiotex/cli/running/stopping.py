# SPDX-License-Identifier: Apache-2.0
"""Signals that end a run: the first unwinds it, a second one ends it at once. Either leaves nothing half behind.

It imports little: a signal that comes while the program is loaded is answered, too.
"""

from __future__ import annotations

import _signal as signal  # what `signal` gives names to, which takes a thousandth of a second
import os
import sys
from collections.abc import Callable
from types import FrameType

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_ATOMIC = "oiiotex.io.atomic"
_GRACE = 0.5  # s for the main thread to hear a signal, and then to put away what it writes

_requested = 0  # the signal that asked the run to end


class Stopped(BaseException):
    """A signal asked the run to end: unwinds it, so that nothing half is left behind."""

    def __init__(self, number: int):
        self.number = number


def stop_on_signals() -> None:
    """From here on SIGINT, SIGTERM and SIGHUP raise `Stopped` in the main thread."""
    _handle(SIGNALS, _stop)
    sys.unraisablehook = _end_or_report


def end_on_signals() -> None:
    """From here on SIGTERM and SIGHUP end this process at once: a worker, which is deaf to SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _handle(SIGNALS[1:], end_at_once)
    watch_signals()


def ignore_interrupts() -> None:
    """All is done: SIGINT while Python ends changes no exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _handle(numbers: tuple[int, ...], handler: Callable[[int, FrameType | None], object]) -> None:
    for number in numbers:
        if signal.getsignal(number) != signal.SIG_IGN:  # as nohup and shells' background jobs have it
            signal.signal(number, handler)


def watch_signals() -> None:
    """Have a thread end the process where the main thread does not hear a signal: other people's code keeps it."""
    import threading

    source, sink = os.pipe()
    os.set_blocking(sink, False)
    signal.set_wakeup_fd(sink, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(source,), name="oiiotex-signals", daemon=True).start()


def _watch(source: int) -> None:
    import time

    while True:
        number = os.read(source, 1)[0]
        if signal.getsignal(number) not in (_stop, end_at_once):  # somebody else's, as a server has them
            continue
        time.sleep(_GRACE)
        if _requested and _writing():
            time.sleep(_GRACE)
        if not _requested or _writing():
            end_at_once(number)


def raise_if_stopped() -> None:
    """Raise `Stopped` again, where C code (a module while it is imported) has turned it into an error of its own."""
    if _requested:
        raise Stopped(_requested)


def end_at_once(number: int, _: object = None) -> None:
    """A signal's handler: what is half written goes, and the process with it."""
    if _writing():
        sys.modules[_ATOMIC].discard_all()
    os._exit(128 + number)


def end_unwound(number: int) -> None:
    """End the process once `Stopped` has unwound it: a signal may have come between a file and who would remove it.

    Python does not take itself down: threads of other people's code still run, which that aborts.
    """
    import atexit

    atexit._run_exitfuncs()
    end_at_once(number)


def _writing() -> bool:
    """Whether there are unfinished files; the module that makes them may not have been loaded yet."""
    return hasattr(sys.modules.get(_ATOMIC), "discard_all") and sys.modules[_ATOMIC].is_writing()


def _stop(number: int, frame: FrameType | None) -> None:
    global _requested
    if _requested or _imports(frame):  # modules of C++ take an exception while they are loaded for the end of all
        end_at_once(number)
    _requested = number
    raise Stopped(number)


def _imports(frame: FrameType | None) -> bool:
    """Whether something is being imported in that frame."""
    while frame is not None and not frame.f_code.co_filename.startswith("<frozen importlib"):
        frame = frame.f_back
    return frame is not None


def _end_or_report(lost: sys.UnraisableHookArgs) -> None:
    """`Stopped`, raised where Python drops exceptions (destructors, the import machinery), ends the run at once."""
    if isinstance(lost.exc_value, Stopped):
        end_at_once(lost.exc_value.number)
    sys.__unraisablehook__(lost)
