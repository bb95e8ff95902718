# SPDX-License-Identifier: Apache-2.0
"""Run the frames of a command line: check all of them first, then run them in order, in parallel or on a farm."""

from __future__ import annotations

import contextlib
import logging
import os
import shlex
import time
from collections.abc import Iterator
from dataclasses import replace

from ....engine.errors import Error
from ....engine.session import Session
from ..language.parse import CommandLine, parse
from ..language.sequences import Frame, frames
from ..stack.rehearsal import CollisionError, Rehearsals
from ..vocabulary import LANGUAGE
from .progress import Display
from .tasks import Task, run_task, session_for, skip

log = logging.getLogger("oiiotex")


def run_frames(command: CommandLine, words: list[str]) -> int:
    """Run all frames of a line, parsed as `command`; returns the exit code."""
    todo = frames(words, LANGUAGE.takes)
    for warning in dict.fromkeys(frame.warning for frame in todo if frame.warning):
        log.warning("%s", warning)
    start = time.perf_counter()
    session = session_for(command, words)
    workers = min(len(todo), session.resources.thread_count) if "--parallel-frames" in command.settings else 1
    if workers > 1:
        session.change(budget=session.settings.budget // workers)
    tasks, status = _checked(todo, session, command, words)
    if command.spread is not None:
        with _progress(session, command) as display:
            return max(status, command.spread(command, words, tasks, session, display))
    with _progress(session, command) as display:
        if workers > 1:
            from .parallel import run_in_parallel

            return max(status, run_in_parallel(tasks, workers, session, display, command))
        for number, task in enumerate(tasks, 1):
            display.frame(number, len(tasks), task.frame.file)
            try:
                status = max(status, run_task(task, session, command=_parsed(task.frame, command, words)))
            except Error as error:
                skip(error, task.frame, command)
                status = max(status, 1)
    if "--runstats" in command.settings:
        from ..printing.report import time_table

        print(time_table(session.resources.stats, time.perf_counter() - start))
    return status


@contextlib.contextmanager
def _progress(session: Session, command: CommandLine) -> Iterator[Display]:
    """The display of the session's progress; silent after -q, --noprogress and --openjd."""
    display = Display()
    if "--openjd" in command.settings:
        session.progress = replace(session.progress, tell=tell_runner)
        yield display
        return
    if "-q" in command.settings or "--noprogress" in command.settings:
        yield display
        return
    session.progress = replace(session.progress, tell=display.advance, say=display.print)
    session.resources.stats.watch = display.stage
    with display.shown():
        yield display


def tell_runner(done: int, total: int) -> None:
    """Print progress in the format of Open Job Description."""
    print(f"openjd_progress: {100 * done / max(total, 1):.1f}", flush=True)


def _parsed(frame: Frame, command: CommandLine, words: list[str]) -> CommandLine:
    """The line of a frame: `command` itself, parsed from `words`, if it has no frames."""
    return command if list(frame.words) == words else parse(list(frame.words), LANGUAGE)


def _checked(todo: list[Frame], session: Session, command: CommandLine, words: list[str]) -> tuple[list[Task], int]:
    """The tasks and the exit code so far: checks all frames before the first one runs."""
    if "--device" in command.settings:
        from ....engine.opencl import device_choice

        device_choice.require_named(session.settings.device_name, session.settings.threads)
    rehearsals = Rehearsals(session, owners={os.path.realpath(frame.file): frame for frame in todo if frame.file})
    tasks, notes, status = [], dict[tuple[int, str], None](), 0
    for frame in todo:
        try:
            steps = _parsed(frame, command, words).steps
            seen = rehearsals.foresight(steps, frame)
        except CollisionError:
            raise
        except Error as error:
            skip(error, frame, command)
            status = 1
            continue
        if frame.file and any(step.name == "-n" for step in steps):
            print(shlex.join(["oiiotex", *(word for word in frame.words if word != "-n")]))
        notes |= dict.fromkeys(seen.notes)
        if seen.steps:
            tasks.append(Task(frame, seen.steps, seen.files))
    for level, text in notes:
        log.log(level, "%s", text)
    return tasks, status
