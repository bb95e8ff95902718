# SPDX-License-Identifier: Apache-2.0
"""Jobs in processes of their own on this machine: frames of a line, shares of what it writes, materials of a library.

Each process (`worker`) is led by a thread here, over two pipes that nobody else has: nothing listens.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from subprocess import PIPE
from typing import TYPE_CHECKING, TypeVar

from ...errors import Error, present
from ...machine import start_python
from ...session import Session
from ..language.parse import CommandLine
from . import streams
from .progress import Display
from .tasks import Job, Task, skip, work

if TYPE_CHECKING:
    from subprocess import Popen

AnyJob = TypeVar("AnyJob")
Result = TypeVar("Result")

log = logging.getLogger("oiiotex")


class WorkerDied(Error):
    """The process that was at a job has ended before it."""


def run_in_parallel(tasks: list[Task], workers: int, session: Session, display: Display, command: CommandLine) -> int:
    """Each frame in a process of its own, with its share of the memory; what they print comes in order."""
    jobs = [Job(task, budget=session.resources.budget, threads=1) for task in tasks]
    status = 0
    with worker_processes(workers, "--debug" in command.settings) as pool, session.resources.stats.time("frames"):
        for count, future in enumerate([pool.submit(work, job) for job in jobs], 1):
            printed, error, own = future.result()
            display.advance(count, len(jobs))
            display.clear()
            sys.stdout.write(printed)
            status = max(status, own)
            if error is not None:
                skip(error, command)
    return status


@contextlib.contextmanager
def worker_processes(count: int, debugging: bool) -> Iterator[Workers]:
    """Processes that are ended with the block; at once, and cleaning up behind themselves, where it raises."""
    workers = Workers(count, debugging)
    try:
        yield workers
        workers.close()
    except BaseException:
        workers.stop()
        workers.close()
        raise


class Workers:
    """Processes that do jobs, started as jobs come; deaf to Ctrl-C, and ended with this process whatever ends it."""

    def __init__(self, count: int, debugging: bool):
        self._words = str(log.getEffectiveLevel()), str(int(debugging)), os.getcwd()
        self._threads = ThreadPoolExecutor(count, "oiiotex-worker", _without_interrupts)
        self._own = threading.local()
        self._lock = threading.Lock()
        self._processes: list[Popen[bytes]] = []
        self._stopped = False

    def submit(self, work: Callable[[AnyJob], Result], job: AnyJob, retries: int = 0) -> Future[Result]:
        """Have a function of a module do a job; `WorkerDied` once that many processes and one have died at it."""
        return self._threads.submit(self._done, work, job, retries)

    def stop(self) -> None:
        """End all processes, whatever they do."""
        with self._lock:
            self._stopped = True  # none is started any more
            for process in self._processes:
                process.terminate()

    def close(self) -> None:
        """Wait for jobs that are under way, then end the processes."""
        self._threads.shutdown(cancel_futures=True)
        for process in self._processes:
            with contextlib.suppress(OSError):  # it has ended, and what was written to it last has not arrived
                present(process.stdin).close()
            present(process.stdout).close()
            process.wait()

    def _done(self, work: Callable[[AnyJob], Result], job: AnyJob, retries: int) -> Result:
        request = pickle.dumps((work, job))
        for attempt in range(retries + 1):
            process = getattr(self._own, "process", None) or self._started()
            try:
                pickle.dump(request, present(process.stdin))
                present(process.stdin).flush()
                result, error = pickle.load(present(process.stdout))
            except (OSError, EOFError, pickle.UnpicklingError):
                self._own.process = None
                process.terminate()  # where it closed its pipes and yet lives
                if attempt == retries or self._stopped:
                    break
                continue
            if error is not None:
                raise error
            return result
        raise WorkerDied("a worker process has ended of itself: killed, or out of memory? Have fewer work at a time")

    def _started(self) -> Popen[bytes]:
        with self._lock:
            if self._stopped:
                raise WorkerDied("the run is being ended")
            process = start_python(
                "oiiotex.cli.running.worker", *self._words, stdin=PIPE, stdout=PIPE, stderr=streams.stderr()
            )
            self._processes.append(process)
        self._own.process = process
        return process


def _without_interrupts() -> None:
    """SIGINT waits, for this thread and for processes that it starts: it is for the main thread, who ends them."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
