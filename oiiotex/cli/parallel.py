# SPDX-License-Identifier: Apache-2.0
"""Several frames at a time, each in a process of its own."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from ..errors import Error
from ..session import Session
from .parse import CommandLine
from .progress import Display
from .stopping import end_at_once, end_on_signals
from .streams import loud, quiet_libraries
from .tasks import Job, Task, skip, work

log = logging.getLogger("oiiotex")


def run_in_parallel(tasks: list[Task], workers: int, session: Session, display: Display, command: CommandLine) -> int:
    """Each frame in a process of its own, with its share of the memory; what they print comes in order."""
    jobs = [Job(task, budget=session.budget, threads=1) for task in tasks]
    status = 0
    with worker_processes(workers, "--debug" in command.settings) as pool, session.stats.time("frames"):
        with loud(), without_interrupts():  # workers are born deaf to Ctrl-C: it is for the parent, who ends them
            results = pool.map(work, jobs)
        for count, (printed, error, own) in enumerate(results, 1):
            display.advance(count, len(jobs))
            display.clear()
            sys.stdout.write(printed)
            status = max(status, own)
            if error:
                skip(Error(error), command)
    return status


@contextlib.contextmanager
def worker_processes(workers: int, debugging: bool) -> Iterator[ProcessPoolExecutor]:
    """Processes of this program that stay: quiet, deaf to Ctrl-C where they are born so, ended with their parent."""
    # Processes of every start method are `python -c`, which would look for modules in the current folder first.
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, context, _start_worker, (log.getEffectiveLevel(), debugging))
    try:
        yield pool
    except BaseException as error:
        for worker in multiprocessing.active_children():
            worker.terminate()  # it cleans up behind itself
        if isinstance(error, BrokenProcessPool):
            text = "a process that worked on a frame has ended of itself: killed, or out of memory?"
            raise Error(text) from error
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        if before is None:  # whoever called us starts processes as before
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


@contextlib.contextmanager
def without_interrupts() -> Iterator[None]:
    """SIGINT waits, for this thread and for processes that it starts."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start_worker(level: int, debugging: bool) -> None:
    if not debugging:
        quiet_libraries()
    logging.basicConfig(format="%(message)s", level=level)
    end_on_signals()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that is killed cannot end its workers."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        end_at_once(signal.SIGTERM)
