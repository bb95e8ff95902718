# SPDX-License-Identifier: Apache-2.0
"""Jobs in worker processes on this machine: frames of a line, shares of its output, materials of a library.

A thread here drives each process (`worker`) over two private pipes; no port is opened.
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

from ....engine.errors import Error, present
from ....engine.machine import start_python
from ....engine.session import Session
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
    """A worker process ended during its job."""


def run_in_parallel(tasks: list[Task], workers: int, session: Session, display: Display, command: CommandLine) -> int:
    """Run each frame in a worker with its share of the memory; outputs are printed in order of frames."""
    jobs = [Job(task, budget=session.resources.budget, threads=1) for task in tasks]
    status = 0
    with worker_processes(workers, "--debug" in command.settings) as pool, session.resources.stats.time("frames"):
        futures = [pool.submit(work, job) for job in jobs]
        for count, (future, task) in enumerate(zip(futures, tasks, strict=True), 1):
            try:
                printed, error, own = future.result()
            except WorkerDied as died:
                printed, error, own = "", died, 1
            display.advance(count, len(jobs))
            display.clear()
            sys.stdout.write(printed)
            status = max(status, own)
            if error is not None:
                skip(error, task.frame, command)
    return status


@contextlib.contextmanager
def worker_processes(count: int, debugging: bool) -> Iterator[Workers]:
    """Worker processes for a block; if it raises, they remove unfinished files and end at once."""
    workers = Workers(count, debugging)
    try:
        yield workers
        workers.close()
    except BaseException:
        workers.stop()
        workers.close()
        raise


class Workers:
    """Processes that run jobs, started on demand; they ignore Ctrl-C and end when this process ends."""

    def __init__(self, count: int, debugging: bool):
        self._words = str(log.getEffectiveLevel()), str(int(debugging)), os.getcwd()
        self._threads = ThreadPoolExecutor(count, "oiiotex-worker", _without_interrupts)
        self._own = threading.local()
        self._lock = threading.Lock()
        self._processes: list[Popen[bytes]] = []
        self._stopped = False

    def submit(self, work: Callable[[AnyJob], Result], job: AnyJob, retries: int = 0) -> Future[Result]:
        """Run a job with a function of a module; `WorkerDied` after `retries` + 1 processes have died."""
        return self._threads.submit(self._done, work, job, retries)

    def stop(self) -> None:
        """End all processes at once."""
        with self._lock:
            self._stopped = True  # starts no further process
            for process in self._processes:
                process.terminate()

    def close(self) -> None:
        """Wait for running jobs, then end the processes."""
        self._threads.shutdown(cancel_futures=True)
        for process in self._processes:
            with contextlib.suppress(OSError):  # it has ended before reading everything
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
                process.terminate()  # it may have closed its pipes and still run
                if attempt == retries or self._stopped:
                    break
                continue
            if error is not None:
                raise error
            return result
        raise WorkerDied("a worker process was killed or ran out of memory; use fewer workers")

    def _started(self) -> Popen[bytes]:
        with self._lock:
            if self._stopped:
                raise WorkerDied("the run is ending")
            process = start_python(
                "oiiotex.oiiotool.cli.running.worker", *self._words, stdin=PIPE, stdout=PIPE, stderr=streams.stderr()
            )
            self._processes.append(process)
        self._own.process = process
        return process


def _without_interrupts() -> None:
    """Block SIGINT in this thread and in processes that it starts: the main thread handles it and ends them."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
