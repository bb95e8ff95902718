# SPDX-License-Identifier: Apache-2.0
"""--farm: distribute the frames of a line, or shares of its output, to a scheduler's machines."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, as_completed

from oiiotex.engine.errors import Error, ParameterError

from ..api.images import Session
from ..api.lines import (
    CommandLine,
    Display,
    Frame,
    InBands,
    Job,
    Option,
    Shares,
    Task,
    Whole,
    WorkerDied,
    frame_numbers,
    line_of,
    run_task,
    skip,
    work,
    worker_processes,
)

_SHARES_A_WORKER = 4  # small shares, so that a slow worker delays the others less


def spread(command: CommandLine, words: Sequence[str], tasks: list[Task], session: Session, display: Display) -> int:
    """Run a line on a farm, or write its job template; returns the exit code."""
    engine, _, place = command.settings["--farm"][0].partition("=")
    if engine not in ("dask", "openjd") or not place:
        raise ParameterError(
            f"--farm {command.settings['--farm'][0]}: expected dask=tcp://HOST:PORT, dask=local:WORKERS or openjd=FILE"
        )
    if "--each" in command.settings and engine == "openjd":
        raise ParameterError("--farm openjd cannot be combined with --each", hint="use --farm dask")
    if not tasks:  # each file has failed already
        return 0
    if len(tasks) == 1 and "--each" not in command.settings:
        _require_shares(command)
    if engine == "dask":
        return _on_dask(place, command, words, tasks, session, display)
    _write_template(place, command, words, tasks, session)
    return 0


def _require_shares(command: CommandLine) -> None:
    """Refuse a line whose ops need the whole image for every share."""
    for step in command.steps:
        if step.op is not None and issubclass(step.op, (Whole, InBands)):
            problem = f"--farm cannot split {step.name}: each share would compute the whole image"
            raise ParameterError(problem, hint="distribute frames with --frames, or use one machine")


def _on_dask(
    address: str, command: CommandLine, words: Sequence[str], tasks: list[Task], session: Session, display: Display
) -> int:
    from . import dask_cluster

    line = line_of(words)
    apart = len(tasks) > 1 or "--each" in command.settings  # a job for each frame, not for shares of one
    workers = dask_cluster.local_workers(address)
    one = Job(tasks[0], session.resources.budget // workers if workers else 0, int(workers > 0), folder=os.getcwd())

    def jobs(count: int) -> list[Job]:
        if apart:
            return [one._replace(task=task) for task in tasks]
        count *= _SHARES_A_WORKER
        return [one._replace(shares=Shares.of(line, n, count)) for n in range(1, count + 1)]

    with contextlib.ExitStack() as stack:
        if workers:
            pool = stack.enter_context(worker_processes(workers, debugging=False))
            todo = jobs(workers)
            futures = {pool.submit(_answer, job, dask_cluster.RETRIES): job for job in todo}
            answers: Iterator[_Answer] = (_result(future, futures[future]) for future in as_completed(futures))
        else:
            client, workers = stack.enter_context(dask_cluster.cluster(address))
            todo = jobs(workers)
            answers = dask_cluster.results(client, _answer, todo, _failed)
        status = 0
        for done, (frame, printed, error, own) in enumerate(answers, 1):
            display.advance(done, len(todo))
            display.clear()
            sys.stdout.write(printed if apart else "")
            status = max(status, own)
            if error is not None:
                if not apart:
                    raise error
                skip(error, frame, command)
    return status if apart else run_task(tasks[0], session, Shares.of(line))


_Answer = tuple[Frame, str, Error | None, int]


def _answer(job: Job) -> _Answer:
    """Run a job; returns (its frame, its output, its error, its exit code)."""
    return job.task.frame, *work(job)


def _failed(job: Job, why: str) -> _Answer:
    return job.task.frame, "", Error(f"a job failed on its worker: {why}"), 1


def _result(future: Future[_Answer], job: Job) -> _Answer:
    try:
        return future.result()
    except WorkerDied as died:
        return job.task.frame, "", died, 1


def _write_template(
    place: str, command: CommandLine, words: Sequence[str], tasks: Sequence[Task], session: Session
) -> None:
    from .openjd import LEAST_MEMORY, frame_template, place_of, share_template, write_template

    path, shares = place_of(place)
    line = list(line_of(words))
    own = {word for task in tasks for word in line_of(task.frame.words)}
    memory = session.resources.budget >> 20 if "--cache" in command.settings else LEAST_MEMORY
    if "--frames" in command.settings:
        at = line.index("--frames")
        del line[at : at + 2]
        template = frame_template(path.stem, line, frame_numbers(command.settings["--frames"][0]), memory)
    else:
        template = share_template(path.stem, line, shares, memory)
    write_template(path, template, own)


OPTION = Option(
    "--farm ENGINE",
    text="Distribute frames or shares: dask=tcp://HOST:PORT, dask=local:N, openjd=FILE[,SHARES]",
    spread=spread,
)
