# SPDX-License-Identifier: Apache-2.0
"""A command line, run: settings, frames of a sequence, one after the other or several at a time."""

from __future__ import annotations

import contextlib
import io
import logging
import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import OpenImageIO as oiio

from ..errors import Error, ParameterError
from ..session import Session, usable_threads
from .chain import Chain
from .language import LANGUAGE
from .parse import CommandLine, parse
from .reading import read_input
from .sequences import Frame, frames
from .stopping import end_at_once
from .streams import loud, quiet_libraries

log = logging.getLogger("oiiotex")


def run(words: list[str], folder: str | os.PathLike | None = None) -> int:
    """Do what a command line says, in `folder` if one is given; returns the exit code, 1 where images differ.

    Raises
    ------
    Error
        Something is wrong.
    """
    if folder is not None:
        with contextlib.chdir(folder):
            return run(words)
    command = parse(words, LANGUAGE)
    _start_logging(command)
    if _prints_only(command):
        return 0
    todo = frames(words, LANGUAGE.takes)
    for warning in dict.fromkeys(frame.warning for frame in todo if frame.warning):
        log.warning("%s", warning)
    start = time.perf_counter()
    if "--parallel-frames" in command.settings and len(todo) > 1:
        return _run_in_parallel(todo, command)
    status = 0
    session = _session(command, words)
    for frame in todo:
        try:
            status = max(status, _run_frame(frame, session))
        except Error as error:
            if "--skip-bad-frames" not in command.settings:
                raise
            log.error("oiiotex ERROR: %s", error)
            status = 1
    if "--runstats" in command.settings:
        from .report import time_table

        print(time_table(session.stats, time.perf_counter() - start))
    return status


def _run_frame(frame: Frame, session: Session) -> int:
    command = parse(list(frame.words), LANGUAGE)
    session.all_parts = session.autocc = False  # options of the line set them anew for each frame
    chain = Chain(session, read_input, frame)
    chain.settings["-v"] = "-v" in command.settings
    chain.run(command.steps)
    return chain.status


# --- several frames at a time ---


def _run_in_parallel(todo: list[Frame], command: CommandLine) -> int:
    """Each frame in a process of its own, with its share of the memory; what they print comes in order."""
    workers = min(len(todo), _whole_number(command, "--threads") or usable_threads())
    budget = _session(command, []).budget // workers
    jobs = [(frame, budget >> 20) for frame in todo]
    status = 0
    with _pool(workers, "--debug" in command.settings) as pool:
        with loud(), _without_interrupts():  # workers are born deaf to Ctrl-C: it is for the parent, who ends them
            results = pool.map(_job, jobs)
        for printed, error, own in results:
            sys.stdout.write(printed)
            status = max(status, own)
            if error:
                if "--skip-bad-frames" not in command.settings:
                    raise Error(error)
                log.error("oiiotex ERROR: %s", error)
    return status


@contextlib.contextmanager
def _pool(workers: int, debugging: bool) -> Iterator[ProcessPoolExecutor]:
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


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
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
    signal.signal(signal.SIGTERM, end_at_once)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that is killed cannot end its workers."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        end_at_once(signal.SIGTERM)


def _job(job: tuple[Frame, int]) -> tuple[str, str, int]:
    """One frame in a worker: (what it printed, its error, its exit code)."""
    frame, megabytes = job
    printed = io.StringIO()
    words = list(frame.words)
    try:
        with contextlib.redirect_stdout(printed):
            session = _session(parse(words, LANGUAGE), words)
            session.threads, session.budget = 1, megabytes << 20
            _limit_threads(1)
            status = _run_frame(frame, session)
        return printed.getvalue(), "", status
    except Error as error:
        return printed.getvalue(), str(error), 1


# --- settings ---


def _session(command: CommandLine, words: list[str]) -> Session:
    from . import report

    threads = _whole_number(command, "--threads")
    _limit_threads(threads or usable_threads())
    session = Session(
        device_name=_first(command, "--device"),
        threads=threads,
        colorconfig=_first(command, "--colorconfig"),
        interchange=command.settings.get("--interchange"),
        progress=None if "-q" in command.settings else report.progress_bar(),
        say=print,
        measure=_wants_report(command),
        profile="--runstats" in command.settings,
        words=tuple(words),
    )
    if "--cache" in command.settings:
        session.budget = _whole_number(command, "--cache") << 20
    return session


def _limit_threads(count: int) -> None:
    """OpenImageIO's own threads: it counts the machine's, not those that the process may use."""
    oiio.attribute("threads", count)
    oiio.attribute("exr_threads", count)


def _start_logging(command: CommandLine) -> None:
    level = logging.INFO if _wants_report(command) else logging.ERROR if "-q" in command.settings else logging.WARNING
    logging.basicConfig(format="%(message)s", level=level)
    log.setLevel(level)


def _prints_only(command: CommandLine) -> bool:
    """Serve the options that print something and end."""
    from . import report

    settings = command.settings
    if "--help" in settings or not (settings or command.steps):
        topic = _first(command, "--help")
        print(report.page(topic) if topic else report.overview())
    elif "--version" in settings:
        print(report.versions(_first(command, "--device"), _whole_number(command, "--threads")))
    elif "--devices" in settings:
        print(report.device_list(_whole_number(command, "--threads")))
    elif "--completion" in settings:
        print(report.completion(_first(command, "--completion") or ""))
    else:
        return False
    return True


def _wants_report(command: CommandLine) -> bool:
    return "-v" in command.settings or "--runstats" in command.settings


def _first(command: CommandLine, name: str) -> str | None:
    return next(iter(command.settings.get(name, ())), None)


def _whole_number(command: CommandLine, name: str) -> int:
    text = _first(command, name) or "0"
    if not (text.isascii() and text.isdigit()):
        raise ParameterError(f"{name} {text}: allowed is a whole number >= 0")
    return int(text)
