# SPDX-License-Identifier: Apache-2.0
"""The job queue: one job at a time, because there is one device, ordered and preempted by priority.

A job can be interrupted whenever it reports progress: it ends there if it was canceled, and more urgent jobs run there,
on its thread. Thus a long export does not delay brush strokes, and kernels are used by one thread only.
"""

from __future__ import annotations

import heapq
import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ...engine.errors import OUT_OF_MEMORY, Error, Interrupted, failure_of

REPORT_EVERY = 0.05  # s; minimum time between two progress reports
_numbers = itertools.count()


@dataclass(eq=False)
class DeviceJob:
    """A job.

    `report` is called with a state and a value: 'progress' with (done, total), 'done' with the result of `work`,
    'failed' with an Error, 'canceled' with None.
    """

    priority: int  # 0 is the most urgent; equal ones run in order of arrival
    work: Callable[[DeviceJob], Any]  # Called with the job
    report: Callable[[str, Any], None]
    canceled: bool = False
    log: list[tuple[str, str]] = field(default_factory=list)
    _jobs: Jobs | None = None
    _number: int = field(default_factory=lambda: next(_numbers))
    _told: float = 0.0

    def __lt__(self, other: DeviceJob) -> bool:
        return (self.priority, self._number) < (other.priority, other._number)

    def advance(self, done: int, total: int) -> bool:
        """The progress callback of a session: False if the job was canceled."""
        now = time.monotonic()
        if now - self._told >= REPORT_EVERY:
            self._told = now
            self.report("progress", (done, total))
        if self._jobs is not None:
            self._jobs.let_in(self)
        return not self.canceled


class Jobs:
    """Waiting jobs, and the thread that runs them."""

    def __init__(self) -> None:
        self._waiting: list[DeviceJob] = []
        self._running: list[DeviceJob] = []  # the last one runs; the others are suspended
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="oiiotex-jobs", daemon=True)
        self._thread.start()

    @property
    def running(self) -> DeviceJob | None:
        """The running job, or None."""
        return self._running[-1] if self._running else None

    @property
    def count(self) -> int:
        """Number of waiting, suspended and running jobs."""
        return len(self._waiting) + len(self._running)

    def add(self, job: DeviceJob) -> None:
        """Queue a job."""
        job._jobs = self
        with self._changed:
            heapq.heappush(self._waiting, job)
            self._changed.notify()

    def cancel(self, job: DeviceJob) -> None:
        """Remove a waiting job, or stop a running one at its next progress report."""
        with self._changed:
            job.canceled = True
            waited = job in self._waiting
            if waited:
                self._waiting.remove(job)
                heapq.heapify(self._waiting)
        if waited:
            job.report("canceled", None)

    def let_in(self, job: DeviceJob) -> None:
        """Run the waiting jobs that are more urgent than a running one."""
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
        except Exception as error:  # a bug must not end the process
            job.report("failed", failure_of(error))
        else:
            job.report("done", result)
        finally:
            self._running.pop()
