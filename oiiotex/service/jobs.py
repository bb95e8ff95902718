# SPDX-License-Identifier: Apache-2.0
"""What is to be done: by priority, one at a time, because there is one device; more urgent jobs come in between.

A job is asked for leave whenever it reports progress. There it ends if it was canceled, and there jobs of higher
priority are done, on its thread: so an export of an hour holds up no brush, and kernels are never set up twice at once.
"""

from __future__ import annotations

import heapq
import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..errors import OUT_OF_MEMORY, Error, Interrupted

REPORT_EVERY = 0.05  # s, at most, between two reports of progress
_numbers = itertools.count()


@dataclass(eq=False)
class DeviceJob:
    """Something to be done.

    `report`: called with (state, value): 'progress' (done, total), 'done' what `work` gave, 'failed' an Error,
    'canceled'.
    """

    priority: int  # 0 first; among equals who came first
    work: Callable[[DeviceJob], Any]  # Is called with the job
    report: Callable[[str, Any], None]
    canceled: bool = False
    log: list[tuple[str, str]] = field(default_factory=list)
    _jobs: Jobs | None = None
    _number: int = field(default_factory=lambda: next(_numbers))
    _told: float = 0.0

    def __lt__(self, other: DeviceJob) -> bool:
        return (self.priority, self._number) < (other.priority, other._number)

    def advance(self, done: int, total: int) -> bool:
        """As a session's `progress`: False where the job was canceled."""
        now = time.monotonic()
        if now - self._told >= REPORT_EVERY:
            self._told = now
            self.report("progress", (done, total))
        if self._jobs is not None:
            self._jobs.let_in(self)
        return not self.canceled


class Jobs:
    """Jobs that wait, and the thread that does them."""

    def __init__(self) -> None:
        self._waiting: list[DeviceJob] = []
        self._running: list[DeviceJob] = []  # the last one works, those before it wait for it
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="oiiotex-jobs", daemon=True)
        self._thread.start()

    @property
    def running(self) -> DeviceJob | None:
        """The job that works."""
        return self._running[-1] if self._running else None

    @property
    def count(self) -> int:
        """How many wait or run."""
        return len(self._waiting) + len(self._running)

    def add(self, job: DeviceJob) -> None:
        """Have a job done."""
        job._jobs = self
        with self._changed:
            heapq.heappush(self._waiting, job)
            self._changed.notify()

    def cancel(self, job: DeviceJob) -> None:
        """Leave a job undone, or end it where it next reports progress."""
        with self._changed:
            job.canceled = True
            waited = job in self._waiting
            if waited:
                self._waiting.remove(job)
                heapq.heapify(self._waiting)
        if waited:
            job.report("canceled", None)

    def let_in(self, job: DeviceJob) -> None:
        """Do what is more urgent than a job that runs."""
        while not job.canceled:
            with self._changed:
                if not (self._waiting and self._waiting[0].priority < job.priority):
                    return
                urgent = heapq.heappop(self._waiting)
            self._do(urgent)

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._waiting:
                    self._changed.wait()
                job = heapq.heappop(self._waiting)
            self._do(job)

    def _do(self, job: DeviceJob) -> None:
        self._running.append(job)
        try:
            result = job.work(job)
        except Interrupted as error:
            job.report(*(("canceled", None) if job.canceled else ("failed", error)))
        except Error as error:
            job.report("failed", error)
        except MemoryError:
            job.report("failed", Error(OUT_OF_MEMORY))
        except Exception as error:  # a fault of ours: the process goes on
            job.report("failed", Error(f"internal, {type(error).__name__}: {error}"))
        else:
            job.report("done", result)
        finally:
            self._running.pop()
