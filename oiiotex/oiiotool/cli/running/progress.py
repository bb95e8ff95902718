# SPDX-License-Identifier: Apache-2.0
"""Progress of a run: a bar on a terminal, a line every ten seconds in a log."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tqdm import tqdm

_TICK = 0.25  # s
_QUIET = 1.0  # s before a bar appears
_LINES = 10.0  # s between lines in a log
_BAR = "{{desc}} {{percentage:3.0f}}%|{{bar}}| {{elapsed}}<{left}, {{rate_fmt}}"
_NO_BAR = "{desc} {elapsed}"  # for stages of unknown length


class Display:
    """Shows stage, percentage, rate and time left from a separate thread."""

    def __init__(self, terminal: bool | None = None):
        self._terminal = sys.stderr.isatty() if terminal is None else terminal
        self._owner = threading.get_ident()
        self._stages: list[str] = []
        self._prefix = self._note = ""
        self._first = self._done = self._total = 0  # steps: at the begin, now, at the end
        self._begun = self._told = self._start = self._last_line = time.monotonic()
        self._bar: tqdm | None = None
        self._lock = threading.RLock()
        self._ended = threading.Event()

    def stage(self, name: str, begins: bool) -> None:
        """Begin or end a stage; stages of other threads are not shown."""
        if threading.get_ident() != self._owner:
            return
        with self._lock:
            if begins:
                self._stages.append(name)
            elif name in self._stages:
                del self._stages[len(self._stages) - 1 - self._stages[::-1].index(name) :]
            if len(self._stages) <= begins:  # an op begins or ends; its own stages are parts of its progress
                self._restart()
            if not self._stages:
                self.clear()

    def advance(self, done: int, total: int) -> None:
        """Set the number of finished steps. Fewer than before restart the estimate; the total may change."""
        with self._lock:
            if done < self._done:
                self._restart(done)
            if done > self._done:
                self._told = time.monotonic()
            self._done, self._total = done, total

    def _restart(self, done: int = 0) -> None:
        self._first = self._done = done
        self._total, self._begun = 0, time.monotonic()
        self._told = self._begun

    def _left(self, now: float) -> float | None:
        """Seconds left, as of the last report: a stage that reports nothing is still expected to take its share.

        None if there is no estimate, or if the time that it gave has passed.
        """
        if self._done <= self._first or not self._total:
            return None
        whole = (self._told - self._begun) * (self._total - self._first) / (self._done - self._first)
        return whole - (now - self._begun) if whole > now - self._begun else None

    def note(self, text: str) -> None:
        """Set the text after the first stage's name: the step of work in other processes, instead of a stage here."""
        with self._lock:
            self._note = text

    @property
    def stages(self) -> str:
        """The current stage and its own innermost stage; '' if nothing runs."""
        return " ".join(dict.fromkeys((*self._stages[:1], self._note or "".join(self._stages[-1:]))))

    def frame(self, number: int, count: int, name: str = "") -> None:
        """Set the current frame of a sequence, from 1 to `count`, and its name if it is a file of --each."""
        self._prefix = f"{name or 'frame'} {number}/{count}: " if count > 1 else ""

    @contextlib.contextmanager
    def shown(self) -> Iterator[None]:
        """Show progress during a block."""
        ticker = threading.Thread(target=self._tick, name="oiiotex-progress", daemon=True)
        ticker.start()
        handlers = logging.getLogger().handlers
        for handler in handlers:
            handler.addFilter(self._before_line)
        try:
            yield
        finally:
            for handler in handlers:
                handler.removeFilter(self._before_line)
            self._ended.set()
            ticker.join()
            if self._bar is not None:
                self._bar.close()

    def _before_line(self, _: logging.LogRecord) -> bool:
        self.clear()
        return True

    def clear(self) -> None:
        """Clear the bar before other output."""
        with self._lock:
            if self._bar is not None:
                self._bar.clear()

    def print(self, text: str) -> None:
        """Print a line of the run's output."""
        self.clear()
        print(text)

    def _tick(self) -> None:
        show = self._draw if self._terminal else self._say
        while not self._ended.wait(_TICK):
            with self._lock:
                if self._stages:
                    show(time.monotonic())

    def _draw(self, now: float) -> None:
        if now - self._start < _QUIET:
            return
        if self._bar is None:
            from tqdm import tqdm

            self._bar = tqdm(leave=False, file=sys.stderr)
        bar = self._bar
        bar.ncols, bar.nrows = _terminal_size()  # tqdm draws nothing on a terminal that reports 0 rows
        bar.desc, bar.n, bar.total = self._text(), self._done, self._total or None
        bar.start_t = bar._time() - (now - self._begun)
        left = self._left(now)
        bar.bar_format = (
            _BAR.format(left="?" if left is None else bar.format_interval(left)) if self._total else _NO_BAR
        )
        bar.refresh()

    def _say(self, now: float) -> None:
        if now - self._last_line < _LINES:
            return
        self._last_line = now
        text = f"{self._text()} {now - self._start:.0f} s"
        if self._total:
            text += f", {100 * self._done / self._total:.0f} %"
        left = self._left(now)
        if left is not None:
            text += f", {left:.0f} s left"
        with contextlib.suppress(OSError):  # stderr is closed
            print(text, file=sys.stderr, flush=True)

    def _text(self) -> str:
        return f"{self._prefix}{self.stages}:"


def _terminal_size() -> tuple[int, int]:
    """Columns, minus one that some terminals reserve for the cursor, and rows."""
    try:
        columns, rows = os.get_terminal_size(sys.stderr.fileno())
    except (OSError, ValueError):
        columns = rows = 0
    return (columns or 80) - 1, rows or 24
