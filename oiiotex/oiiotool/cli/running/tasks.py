# SPDX-License-Identifier: Apache-2.0
"""Run one frame of a command line: in this process, in another one, or on another machine."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import threading
from collections.abc import Callable, Iterator
from typing import NamedTuple, cast

from .... import __version__
from ....engine.deferred import oiio
from ....engine.errors import Error
from ....engine.machine import forget_current_folder, usable_threads
from ....engine.session import Session
from ..files.reading import read_input
from ..language.parse import MOST_MB, MOST_THREADS, CommandLine, parse
from ..language.sequences import Frame
from ..stack.chain import Chain
from ..vocabulary import LANGUAGE
from .shares import Shares, line_of, shares_of

log = logging.getLogger("oiiotex")
_resident: dict[tuple[object, ...], Session] = {}  # the session of this process's last job
_at_work = threading.Lock()  # lines share the current folder and OpenImageIO's threads


class Task(NamedTuple):
    """A frame, the number of its steps that matter, and for each use of an op the file that is written next."""

    frame: Frame
    steps: int
    files: tuple[str, ...] = ()


class Job(NamedTuple):
    """A task for another process."""

    task: Task
    budget: int = 0  # memory in bytes; 0: by its line and its machine
    threads: int = 0  # 0: by its line
    shares: Shares | None = None  # the share of the output to compute; None: all
    folder: str = ""  # of the line's relative names; '': the current folder
    version: str = __version__  # of the sender


def run_task(task: Task, session: Session, shares: Shares | None = None, command: CommandLine | None = None) -> int:
    """Run a task, whose line may be parsed already as `command`; returns its exit code."""
    line = command or parse(list(task.frame.words), LANGUAGE)
    with _named(task.frame):
        return session.resources.on_a_device(lambda: _run_chain(task, session, shares, line))


@contextlib.contextmanager
def _named(frame: Frame) -> Iterator[None]:
    """Begin warnings during a block with the frame's file or number; each is given once."""
    given: set[str] = set()

    def name(record: logging.LogRecord) -> bool:
        if record.levelno >= logging.WARNING:
            text = record.getMessage()
            record.msg, record.args = f"{_name_of(frame)}: {text}" if _name_of(frame) else text, ()
        if record.levelno != logging.WARNING:
            return True
        again = record.msg in given
        given.add(record.msg)
        return not again

    log.addFilter(name)
    try:
        yield
    finally:
        log.removeFilter(name)


def _name_of(frame: Frame) -> str:
    return frame.file or (f"frame {frame.number}" if frame.number is not None else "")


def _run_chain(task: Task, session: Session, shares: Shares | None, command: CommandLine) -> int:
    session.change(all_parts=False, autocc=False)  # options of the line set them for each frame
    chain = Chain(session, read_input, task.frame)
    chain.written_next = iter(task.files)
    chain.shares = shares or shares_of(command.settings, task.frame.words)
    chain.run(command.steps[: task.steps])
    return chain.status


def work(job: Job, watch: Callable[[Session], object] | None = None) -> tuple[str, Error | None, int]:
    """Run a job; returns (its output, its error, its exit code). `watch` gets its session before the work."""
    if job.version != __version__:
        text = f"a worker runs oiiotex {__version__}: expected {job.version}, the version of the sender"
        return "", Error(text), 1
    if job.folder and not os.path.isdir(job.folder):
        return "", Error(f"a worker has no access to the folder {job.folder}"), 1
    printed = io.StringIO()
    try:
        with _at_work, contextlib.chdir(job.folder or os.curdir), contextlib.redirect_stdout(printed):
            session = _session_of(job)
            if watch is not None:
                watch(session)
            status = run_task(job.task, session, job.shares)
        return printed.getvalue(), None, status
    except Error as error:
        return printed.getvalue(), error, 1


def _session_of(job: Job) -> Session:
    """A session that reuses the device and the color config of the last one if their settings are equal."""
    words = list(job.task.frame.words)
    session = session_for(parse(words, LANGUAGE), words)
    settings = session.settings
    session.change(threads=job.threads or settings.threads, budget=job.budget or settings.budget)
    limit_threads(session.resources.thread_count)
    key = settings.device_name, session.settings.threads, settings.colorconfig, settings.interchange, settings.profile
    if key in _resident:
        session.resources.inherit(_resident[key].resources)
    _resident.clear()
    _resident[key] = session
    return session


def session_for(command: CommandLine, words: list[str]) -> Session:
    """The session of a line."""
    forget_current_folder()
    threads = command.whole_number("--threads", MOST_THREADS)
    limit_threads(threads or usable_threads())
    session = Session(
        device_name=command.first("--device"),
        threads=threads,
        colorconfig=command.first("--colorconfig"),
        interchange=cast("tuple[str, str] | None", command.settings.get("--interchange")),
        say=print,
        measure=command.reports,
        profile="--runstats" in command.settings,
        words=line_of(words),
    )
    if "--cache" in command.settings:
        session.change(budget=command.whole_number("--cache", MOST_MB) << 20)
    return session


def limit_threads(count: int) -> None:
    """Limit OpenImageIO's own threads: it counts the machine's, not those that the process may use."""
    oiio.attribute("threads", count)
    oiio.attribute("exr_threads", count)


def skip(error: Error, frame: Frame, command: CommandLine) -> None:
    """Log the error of a frame if --skip-bad-frames or --each is set, else raise it."""
    if "--skip-bad-frames" not in command.settings and not frame.file:
        raise error
    which = f"{_name_of(frame)}: " if _name_of(frame) and (error.op or error.step) else ""
    log.error("oiiotex ERROR: %s%s", which, error)
