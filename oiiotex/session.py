# SPDX-License-Identifier: Apache-2.0
"""What one run shares: device, colour config, memory budget, threads, time spent, progress."""

from __future__ import annotations

import contextlib
import copy
import functools
import logging
import math
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from .errors import ImageError, Interrupted
from .keeping import Keeper
from .stats import Stats
from .tiles import PieceCache

if TYPE_CHECKING:
    from .color import ColorConfig
    from .device import Device

log = logging.getLogger("oiiotex")

Progress = Callable[[int, int], bool | None]
Piece, Made = TypeVar("Piece"), TypeVar("Made")


@dataclass(kw_only=True)
class Session:
    """Settings of a run, and what is opened once for it when it is first needed.

    Attributes
    ----------
    device_name : str or None
        As `device.choose` takes it.
    threads : int
        CPU threads; 0: as many as the process may use.
    budget : int
        Bytes of memory that one op may hold; a quarter of what the machine gives the process by default.
    colorconfig : str or None
        An OCIO config; None: $OCIO or a built-in one.
    interchange : (str, str) or None
        A space of a config that does not say how it meets others, and that of ours which is the same.
    autocc : bool
        Let the config's file rules name the space of an untagged file.
    all_parts : bool
        Ops of the host work on all parts of an image, not on the first alone.
    progress : callable or None
        Called with (done, total) as work goes on; returning False stops the run.
    say : callable or None
        Called with each line of text that a filter was asked for.
    measure : bool
        Report how stationary, faithful and seamless a result is (takes time).
    profile : bool
        Time every kernel.
    stats : Stats
        Where the time went.
    words : tuple of str
        The command line, for what files say of the program that wrote them.
    written : set of str
        Real paths of files that ops wrote beside their result; `-o` must not overwrite them.
    keeper : Keeper or None
        Of the file that is being written: where ops with resume=1 keep what is finished.
    """

    device_name: str | None = None
    threads: int = 0
    budget: int = field(default_factory=lambda: memory() // 4)
    colorconfig: str | None = None
    interchange: tuple[str, str] | None = None
    autocc: bool = False
    all_parts: bool = False
    progress: Progress | None = None
    say: Callable[[str], object] | None = None
    measure: bool = False
    profile: bool = False
    stats: Stats = field(default_factory=Stats)
    words: tuple[str, ...] = ()
    written: set[str] = field(default_factory=set)
    keeper: Keeper | None = None
    _last: tuple[str, Any] = ("", None)

    @functools.cached_property
    def device(self) -> Device:
        """The OpenCL device, opened on first use."""
        from . import device

        with self.stats.time("open device"):
            opened = device.open_device(self.device_name, self.threads)
        opened.record = self.profile
        return opened

    @functools.cached_property
    def color(self) -> ColorConfig:
        """The colour config, loaded on first use."""
        from .color import ColorConfig

        return ColorConfig(self.colorconfig, self.interchange)

    @functools.cached_property
    def cache(self) -> PieceCache:
        """Decoded pieces of files and of results that are asked for again."""
        return PieceCache(max(32 << 20, min(self.budget // 4, 1 << 28)))

    @functools.cached_property
    def _workers(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(self.threads or usable_threads(), "oiiotex-work")

    def spread(self, work: Callable[[Piece], Made], pieces: Iterable[Piece]) -> Iterator[Made]:
        """What `work` makes of each piece, in order, on all threads of the run.

        Work must be computing alone: what reads an image may itself be waiting for these threads.
        """
        return self._workers.map(work, pieces)

    def once(self, key: str, make: Callable[[], Made]) -> Made:
        """What `make` gives, or gave when it was last asked under that key: for frames that share their preparation."""
        if self._last[0] != key:
            self._last = "", None  # not two of them in memory
            self._last = key, make()
        return self._last[1]

    @contextlib.contextmanager
    def keeping(self, path: str | os.PathLike) -> Iterator[None]:
        """While this lasts, ops with resume=1 keep finished pieces beside `path`: for who writes it.

        They are removed when it ends well; else they are there for the next run.
        """
        self.keeper = keeper = Keeper(Path(path))
        try:
            yield
        except Exception:
            raise
        except BaseException:  # someone wants it to end, and should know
            if keeper.count:
                log.warning(
                    "%d finished pieces are kept in %s: the same run goes on there", keeper.count, keeper.folder
                )
            raise
        else:
            keeper.discard()
        finally:
            self.keeper = None

    def require(self, need: int, what: str, advice: str = "make the image smaller") -> None:
        """Refuse what does not fit the budget.

        Raises
        ------
        ImageError
            With the figure.
        """
        if need > self.budget:
            raise ImageError(
                f"{what} needs {-(-need >> 20)} MB of memory; the budget is {self.budget >> 20} MB:"
                f" raise --cache, or {advice}"
            )

    def advance(self, done: int, total: int) -> None:
        """Report progress.

        Raises
        ------
        Interrupted
            The callback returned False.
        """
        if self.progress is not None and self.progress(done, total) is False:
            raise Interrupted("stopped by the progress callback")

    def stages(self) -> Iterator[Session]:
        """This session again and again, for ops that work in stages: progress goes on where the last stage ended."""
        self.device  # noqa: B018 - opened once, for all
        begun = ended = 0

        def advance(done: int, total: int) -> bool | None:
            nonlocal ended
            ended = begun + done
            return None if self.progress is None else self.progress(ended, begun + total)

        while True:
            stage = copy.copy(self)
            stage.progress = advance
            yield stage
            begun = ended


def usable_threads() -> int:
    """CPU threads that this process may use: by affinity, and by the quota of its cgroup."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    for quota in _quotas():
        count = min(count, max(1, math.ceil(quota)))
    return count


def _quotas() -> list[float]:
    """CPUs that the cgroup allows, where it says so."""
    found = []
    try:
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text().split()
        found.append(int(quota) / int(period))
    except (OSError, ValueError):  # absent, or the word 'max'
        pass
    try:
        folder = Path("/sys/fs/cgroup/cpu")
        quota, period = ((folder / f"cpu.cfs_{n}_us").read_text() for n in ("quota", "period"))
        if int(quota) > 0:
            found.append(int(quota) / int(period))
    except (OSError, ValueError):
        pass
    return found


def memory() -> int:
    """Bytes of memory that this process may use: the machine's, or less where a cgroup says so."""
    installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 8 << 30
    limits = [installed]
    for name in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            limits.append(int(Path(name).read_text()))
        except (OSError, ValueError):  # absent, or the word 'max'
            continue
    return min(limits)
