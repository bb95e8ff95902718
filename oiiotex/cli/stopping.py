# SPDX-License-Identifier: Apache-2.0
"""Signals that end a run: the first unwinds it, a second one ends it at once. Either leaves nothing half behind."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from ..io.atomic import discard_all

_requested = 0  # the signal that asked the run to end


class Stopped(BaseException):
    """A signal asked the run to end: unwinds it, so that nothing half is left behind."""

    def __init__(self, number: int):
        self.number = number


def stop_on_signals() -> None:
    """From here on SIGINT and SIGTERM raise `Stopped` in the main thread."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) != signal.SIG_IGN:  # as nohup and shells' background jobs have it
            signal.signal(number, _stop)
    sys.unraisablehook = _end_or_report


def raise_if_stopped() -> None:
    """Raise `Stopped` again, where C code (a module while it is imported) has turned it into an error of its own."""
    if _requested:
        raise Stopped(_requested)


def end_at_once(number: int, _: FrameType | None = None) -> None:
    """A signal's handler: what is half written goes, and the process with it."""
    discard_all()
    os._exit(128 + number)


def _stop(number: int, _: FrameType | None) -> None:
    global _requested
    if _requested:
        end_at_once(number)
    _requested = number
    raise Stopped(number)


def _end_or_report(lost: sys.UnraisableHookArgs) -> None:
    """`Stopped`, raised where Python drops exceptions (destructors, the import machinery), ends the run at once."""
    if isinstance(lost.exc_value, Stopped):
        end_at_once(lost.exc_value.number)
    sys.__unraisablehook__(lost)
