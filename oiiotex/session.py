# SPDX-License-Identifier: Apache-2.0
"""One run: its settings, what it opens once and shares (device, colour config, cache, threads), its progress."""

from __future__ import annotations

import contextlib
import copy
import functools
import logging
import math
import os
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from .core.demand import PieceCache
from .core.machine import memory, usable_threads
from .deferred import oiio
from .errors import BuildError, Error, ImageError, Interrupted, MemoryBudgetError
from .io.checkpoint import Checkpoint
from .stats import Stats

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import DTypeLike

    from .color.config import ColorConfig
    from .core.image import Part
    from .opencl.device import Device

log = logging.getLogger("oiiotex")

MOST_SIDE = 1 << 22  # px of an image that is written, or looked at as a whole

Progress = Callable[[int, int], bool | None]
Look = Callable[["np.ndarray", bool], object]
Piece = TypeVar("Piece")
Result = TypeVar("Result")


class Resources:
    """What a run opens once, when it is first needed.

    Parameters
    ----------
    settings : Session

    Attributes
    ----------
    keeper : Checkpoint or None
        Of the file that is being written, or will be: where ops with resume=1 keep what is finished.
    memory : int
        Bytes of arrays that `remembered` keeps; 0, as in a program that ends after its line: nothing is kept.
    """

    def __init__(self, settings: Session):
        self._settings = settings
        self._last: tuple[str, Any] = ("", None)
        self.keeper: Checkpoint | None = None
        self.memory = 0
        self._memory: OrderedDict[Hashable, tuple[Any, tuple[object, ...]]] = OrderedDict()
        self._checkpoints: dict[Path, Checkpoint] = {}

    def checkpoint(self, path: Path) -> Checkpoint:
        """That of a file, one for who computes its image and who writes it."""
        return self._checkpoints.setdefault(path, Checkpoint(path))

    def forget_checkpoint(self, path: Path) -> None:
        """The file has been written, or could not be: the next one of that name has its own."""
        self._checkpoints.pop(path, None)

    @functools.cached_property
    def device(self) -> Device:
        """The OpenCL device."""
        from .opencl import device

        with self._settings.stats.time("open device"):
            opened = device.open_device(self._settings.device_name, self._settings.threads)
        opened.record = self._settings.profile
        return opened

    @property
    def has_device(self) -> bool:
        """Whether it is open."""
        return "device" in self.__dict__

    def forget_device(self) -> None:
        """Let the next one be opened instead; what was made with this one is made anew."""
        self.__dict__.pop("device", None)
        self._last = "", None
        self._memory.clear()

    @functools.cached_property
    def color(self) -> ColorConfig:
        """The colour config."""
        from .color.config import ColorConfig

        return ColorConfig(self._settings.colorconfig, self._settings.interchange)

    @functools.cached_property
    def cache(self) -> PieceCache:
        """Decoded pieces of files and of results that are asked for again."""
        return PieceCache(max(32 << 20, min(self._settings.budget // 4, 1 << 28)))

    @functools.cached_property
    def workers(self) -> ThreadPoolExecutor:
        """Threads that compute."""
        return ThreadPoolExecutor(self._settings.threads or usable_threads(), "oiiotex-work")

    def inherit(self, other: Resources) -> None:
        """Take over what is dear to open from the resources of a session with the same settings that has ended."""
        for name in ("device", "color"):
            if name in other.__dict__:
                self.__dict__[name] = other.__dict__[name]
        self._last = other._last

    def once(self, key: str, make: Callable[[], Result]) -> Result:
        """What `make` gives, or gave when it was last asked under that key: for frames that share their preparation."""
        if self._last[0] != key:
            self._last = "", None  # not two of them in memory
            self._last = key, make()
        value: Result = self._last[1]
        return value

    def remembered(self, key: Hashable, make: Callable[[], Result], *held: object) -> Result:
        """What `make` gives, or gave under that key: analyses that a resident process keeps from job to job.

        Parameters
        ----------
        key : hashable
        make : callable
        held : objects
            Whose id is part of the key: they live as long as what is remembered of them.
        """
        if key in self._memory:
            self._memory.move_to_end(key)
            value: Result = self._memory[key][0]
            return value
        value = make()
        if self.memory:
            self._memory[key] = value, held
            while len(self._memory) > 1 and sum(_bytes_of(one) for one, _ in self._memory.values()) > self.memory:
                self._memory.popitem(last=False)
        return value


def _bytes_of(value: Any) -> int:
    """Of arrays, and of what says its bytes as they do: in tuples, lists and fields of dataclasses, too."""
    if hasattr(value, "nbytes"):
        return int(value.nbytes)
    if isinstance(value, (tuple, list)):
        return sum(map(_bytes_of, value))
    if is_dataclass(value) and not isinstance(value, type):
        return sum(_bytes_of(getattr(value, one.name)) for one in fields(value))
    return 0


@dataclass(kw_only=True)
class Session:
    """Settings of a run, its resources and its progress.

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
    look : callable or None
        Called with (pixels, whole) as a result comes nearer: (height, width, channels) of the image's own type,
        first coarse ones of a smaller size; `whole` where they are the result's own.
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
    resources : Resources
        What is opened once, also where an op works in stages.
    """

    device_name: str | None = None
    threads: int = 0
    budget: int = field(default_factory=lambda: memory() // 4)
    colorconfig: str | None = None
    interchange: tuple[str, str] | None = None
    autocc: bool = False
    all_parts: bool = False
    progress: Progress | None = None
    look: Look | None = None
    say: Callable[[str], object] | None = None
    measure: bool = False
    profile: bool = False
    stats: Stats = field(default_factory=Stats)
    words: tuple[str, ...] = ()
    resources: Resources = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.resources = Resources(self)

    @property
    def device(self) -> Device:
        """The OpenCL device, opened on first use."""
        return self.resources.device

    @property
    def color(self) -> ColorConfig:
        """The colour config, loaded on first use."""
        return self.resources.color

    @property
    def cache(self) -> PieceCache:
        """Decoded pieces of files and of results that are asked for again."""
        return self.resources.cache

    def spread(self, work: Callable[[Piece], Result], pieces: Iterable[Piece]) -> Iterator[Result]:
        """What `work` makes of each piece, in order, on all threads of the run.

        Work must be computing alone: what reads an image may itself be waiting for these threads.
        """
        return self.resources.workers.map(work, pieces)

    @contextlib.contextmanager
    def beside(self, work: Callable[[Session], Result]) -> Iterator[Callable[[], Result]]:
        """Begin `work` on a thread of its own, while the block does something else; gives what waits for its result.

        A run of one thread does it when its result is asked for.
        """
        if (self.threads or usable_threads()) == 1:
            yield lambda: work(self)
            return
        with ThreadPoolExecutor(1, "oiiotex-beside") as thread:
            yield thread.submit(work, self).result

    def on_a_device(self, work: Callable[[], Result]) -> Result:
        """What `work` gives. Where the device's compiler refuses a program, the next device does it all: once, loudly.

        A device that was named is not replaced.
        """
        try:
            return work()
        except Error as error:
            instead = self._instead(error)
            if instead is None:
                raise
            log.warning("%s; all is done again on %s", error, instead)
        self.resources.forget_device()
        return work()

    def _instead(self, error: BaseException | None) -> str | None:
        """The device that takes over; None where that would not help, or is not wanted."""
        from .opencl import device

        while error is not None and not isinstance(error, BuildError):
            # a step's error may be raised from itself
            error = error.__cause__ if error.__cause__ is not error else None
        if error is None or not self.resources.has_device or self.device_name or device.named_by_environment():
            return None
        instead = device.refuse(self.device.info, self.threads)
        return instead.name if instead else None

    @contextlib.contextmanager
    def keeping(self, path: str | os.PathLike[str]) -> Iterator[Checkpoint]:
        """While this lasts, ops with resume=1 keep finished pieces beside `path`, which is written later."""
        before, keeper = self.resources.keeper, self.resources.checkpoint(Path(path))
        self.resources.keeper = keeper
        try:
            yield keeper
        except Exception:
            raise
        except BaseException:  # someone wants it to end, and should know
            if keeper.count:
                log.warning(
                    "%d finished pieces are kept in %s: the same run goes on there", keeper.count, keeper.folder
                )
            raise
        finally:
            self.resources.keeper = before

    @contextlib.contextmanager
    def checkpoints(self, path: str | os.PathLike[str]) -> Iterator[None]:
        """As `keeping`, for who writes the file: pieces are removed when this ends well."""
        try:
            with self.keeping(path) as keeper:
                yield
                keeper.discard()
        finally:
            self.resources.forget_checkpoint(Path(path))

    def require(self, need: int, task: str, advice: str = "make the image smaller") -> None:
        """Refuse what does not fit the budget.

        Raises
        ------
        MemoryBudgetError
            With the figure.
        """
        if need > self.budget:
            raise MemoryBudgetError(task, need, self.budget, advice)

    def require_streamable(self, *parts: Part) -> None:
        """Refuse images that cannot be computed from top to bottom, or that nobody could read.

        Parameters
        ----------
        parts : Parts
            Whose pixels are about to be asked for, all of them.

        Raises
        ------
        ImageError
            A side is longer than 2^22 pixels (files and readers keep a figure for each row), the image larger than
            OpenImageIO reads, or 16 rows, which are held at once, do not fit the budget.
        """
        most = oiio.get_int_attribute("limits:imagesize_MB")
        for part in parts:
            width, height = part.window.size
            image = f"an image of {width}x{height} pixels"
            if max(width, height) > MOST_SIDE:
                raise ImageError(f"{image}: expected at most {MOST_SIDE} along each side")
            size = width * height * part.pixel_bytes >> 20
            if most and size > most:
                raise ImageError(
                    f"{image} takes {size} MB: expected at most {most} MB, which is what OpenImageIO reads here;"
                    " raise its attribute limits:imagesize_MB"
                )
            self.require(16 * width * max(part.pixel_bytes, 4 * part.spec.nchannels), f"{image}")

    def scratch(
        self, layout: Mapping[str, tuple[tuple[int, ...], DTypeLike]], task: str, advice: str, beside: int = 0
    ) -> dict[str, np.ndarray]:
        """Arrays of zeros declared as a whole: summed, checked against the budget, then allocated, as `Buffers` are.

        Parameters
        ----------
        layout : mapping of name to (shape, dtype)
        task, advice : str
            For the error's text.
        beside : int
            Bytes that calculations hold beside them for a while.

        Raises
        ------
        ImageError
            They do not fit.
        """
        import numpy as np  # the program asks for a session before it needs numpy

        need = sum(np.dtype(kind).itemsize * math.prod(shape) for shape, kind in layout.values())
        self.require(need + beside, task, advice)
        return {name: np.zeros(shape, kind) for name, (shape, kind) in layout.items()}

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
