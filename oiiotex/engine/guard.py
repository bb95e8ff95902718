# SPDX-License-Identifier: Apache-2.0
"""A small process that ends this one if a library keeps Python from handling a signal.

Python handles signals between its own instructions. A library that holds Python's lock for seconds, as OpenColorIO
does while it reads a LUT, holds up handlers and all threads. Only the C part of Python's handler runs: it writes the
number of the signal to a pipe. The guard, which is forked before anything large is loaded, reads that pipe.
"""

from __future__ import annotations

import _signal as signal  # `signal` itself takes a millisecond to name its constants
import math
import os
import time
from collections.abc import Iterable

SERVES = b"\0"  # sent by this process after a signal: its own handler takes the time that it needs
ENDS = b"\xff"  # it runs Python, and is about to end
_GRACE = 0.9  # s for a sign of Python after a signal
_GRACES = {SERVES: math.inf, ENDS: 2.0}  # s for the process to end after a sign


def guarded(numbers: Iterable[int], source: int) -> int:
    """Fork the guard of this process.

    Parameters
    ----------
    numbers : iterable of int
        The signals that end this process.
    source : int
        Where the numbers of signals are read: of the pipe that `signal.set_wakeup_fd` writes to.

    Returns
    -------
    int
        The descriptor from which this process reads the numbers: `source` where processes cannot be forked.
    """
    if not hasattr(os, "fork"):
        return source
    ours, theirs = os.pipe()
    process = os.getpid()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)  # the guard never runs a handler
    try:
        if os.fork() == 0:
            _guard(process, set(numbers), source, theirs)
    except OSError:  # a limit on processes
        return source
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    os.close(theirs)
    return ours


def _guard(process: int, numbers: set[int], source: int, thread: int) -> None:
    """The guard: passes numbers on to a thread of the process, and ends with the process."""
    try:
        _close_all_but(source, thread)
        if not _ends_in_time(numbers, source, thread) and os.getppid() == process:
            _end(process, source)
    finally:
        os._exit(0)


def _close_all_but(*kept: int) -> None:
    first = 0
    for number in sorted(kept):
        os.closerange(first, number)
        first = number + 1
    os.closerange(first, os.sysconf("SC_OPEN_MAX"))


def _ends_in_time(numbers: set[int], source: int, thread: int) -> bool:
    """Wait until the process has ended, or should have."""
    import select

    waiting = select.poll()
    waiting.register(source, select.POLLIN)
    end = math.inf
    while True:
        if not waiting.poll(None if end == math.inf else max(0, 1000 * (end - time.monotonic()))):
            return False
        received = os.read(source, 1)
        if not received:
            return True
        if received in _GRACES:
            end = time.monotonic() + _GRACES[received]
            continue
        os.write(thread, received)
        if received[0] in numbers:
            end = min(end, time.monotonic() + _GRACE)


def _end(process: int, source: int) -> None:
    """Remove the unfinished files of the process, and kill it."""
    from .io.atomic import discard_files_of, sweep

    folders = discard_files_of(process)
    os.kill(process, signal.SIGKILL)
    while os.read(source, 1):  # its end of the pipe is closed with its locks
        continue
    for folder in folders:  # it may have begun further ones
        sweep(folder, time.time())
