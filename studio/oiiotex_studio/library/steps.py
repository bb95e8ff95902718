# SPDX-License-Identifier: Apache-2.0
"""Runs lines of a recipe, and reports how far an asset is in a file of the run, which can be on another machine."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from oiiotex.engine.errors import within

from ..api.files import writing_only_below
from ..api.images import Progress, Session
from ..api.lines import LANGUAGE, Display, Frame, Job, Task, parse, work
from ..recipes.lines import ProductStep

_TICK = 0.2  # s between two reports of a stage
_FOLDER = "steps"  # of a run's working folder


def run_line(
    step: ProductStep,
    folder: Path,
    budget: int = 0,
    threads: int = 0,
    watch: Callable[[Session], object] | None = None,
) -> int:
    """Run a product's line in an asset's folder, writing only to the product's folder; returns the exit code.

    `watch` gets the line's session before the work.

    Raises
    ------
    Error
        The line fails.
    """
    task = Task(Frame(None, step.words), len(parse(list(step.words), LANGUAGE).steps))
    with writing_only_below(folder / step.product):
        _, error, status = work(Job(task, budget, threads, folder=str(folder)), watch)
    if error is not None:
        with within(f"product {step.product}"):
            raise error
    return status


class StepFile:
    """The file in which a worker reports how far its asset is. Without room on the disk, nothing is reported."""

    def __init__(self, work: str):
        self._path = step_path(work)
        self._stages = Display(terminal=False)
        self._step, self._share, self._written = "", 0.0, 0.0
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(exist_ok=True)

    def begin(self, step: str) -> None:
        """Begin a step of the asset, such as a product."""
        self._step = step
        self._write()

    def watch(self, progress: Progress) -> Callable[[Session], None]:
        """A function that lets a session report its stages here, and its progress as `progress`."""

        def watch(session: Session) -> None:
            session.progress = replace(session.progress, tell=progress.advance)
            session.resources.stats.watch = self._stage

        return watch

    def _stage(self, name: str, begins: bool) -> None:
        self._stages.stage(name, begins)
        if begins and time.monotonic() - self._written > _TICK:
            self._write()

    def advance(self, done: int, total: int) -> None:
        """Set the share of the asset's work that is finished, as `Progress.tell`."""
        self._share = done / total
        if time.monotonic() - self._written > _TICK:
            self._write()

    def _write(self) -> None:
        self._written = time.monotonic()
        with contextlib.suppress(OSError):
            self._path.write_text(f"{self._share:.4f} {self._step} {self._stages.stages}".rstrip())


def step_path(work: str) -> Path:
    """The file of an asset's step. `work`: its working folder."""
    folder = Path(work)
    return folder.parent.parent / _FOLDER / folder.name


def read_step(path: Path) -> tuple[float, str]:
    """The finished share of an asset's work, from 0 to 1, and its step; (0, '') before its first report."""
    with contextlib.suppress(OSError, ValueError):
        share, _, step = path.read_text().partition(" ")
        return float(share), step
    return 0.0, ""


@contextlib.contextmanager
def calling(look: Callable[[], object], every: float) -> Iterator[None]:
    """Call a function at intervals of `every` seconds during a block, from another thread."""
    ended = threading.Event()

    def work() -> None:
        while not ended.wait(every):
            look()

    watch = threading.Thread(target=work, name="oiiotex-steps", daemon=True)
    watch.start()
    try:
        yield
    finally:
        ended.set()
        watch.join()
