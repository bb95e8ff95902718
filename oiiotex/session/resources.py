# SPDX-License-Identifier: Apache-2.0
"""What a run opens once and shares: device, color config, cache, threads, checkpoints; and what it may hold."""

from __future__ import annotations

import contextlib
import functools
import logging
import math
import os
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ..core.demand import PieceCache
from ..deferred import oiio
from ..errors import BuildError, Error, ImageError, MemoryBudgetError
from ..io.checkpoint import Checkpoint
from ..machine import usable_threads
from ..stats import Stats

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import DTypeLike

    from ..color.config import ColorConfig
    from ..core.image import Part
    from ..opencl.device import Device
    from .settings import Settings

log = logging.getLogger("oiiotex")

MOST_SIDE = 1 << 22  # px of an image that is written, or looked at as a whole

Piece = TypeVar("Piece")
Result = TypeVar("Result")


class Resources:
    """What a run opens once, when it is first needed.

    Parameters
    ----------
    settings : Settings

    Attributes
    ----------
    stats : Stats
        Where the time went.
    keeper : Checkpoint or None
        Of the file that is being written, or will be: where ops with resume=1 keep what is finished.
    memory : int
        Bytes of arrays that `remembered` keeps; 0, as in a program that ends after its line: nothing is kept.
    """

    def __init__(self, settings: Settings):
        self.settings = settings
        self.stats = Stats()
        self._last: tuple[str, Any] = ("", None)
        self.keeper: Checkpoint | None = None
        self.memory = 0
        self._memory: OrderedDict[Hashable, tuple[Any, tuple[object, ...]]] = OrderedDict()
        self._checkpoints: dict[Path, Checkpoint] = {}

    @property
    def budget(self) -> int:
        """Bytes of memory that one op may hold."""
        return self.settings.budget

    @property
    def thread_count(self) -> int:
        """CPU threads that compute."""
        return self.settings.threads or usable_threads()

    def checkpoint(self, path: Path) -> Checkpoint:
        """That of a file, one for who computes its image and who writes it."""
        return self._checkpoints.setdefault(path, Checkpoint(path))

    def forget_checkpoint(self, path: Path) -> None:
        """The file has been written, or could not be: the next one of that name has its own."""
        self._checkpoints.pop(path, None)

    @functools.cached_property
    def device(self) -> Device:
        """The OpenCL device."""
        from ..opencl import device

        with self.stats.time("open device"):
            opened = device.open_device(self.settings.device_name, self.settings.threads)
        opened.record = self.settings.profile
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
        """The color config."""
        from ..color.config import ColorConfig

        return ColorConfig(self.settings.colorconfig, self.settings.interchange)

    @functools.cached_property
    def cache(self) -> PieceCache:
        """Decoded pieces of files and of results that are asked for again."""
        return PieceCache(max(32 << 20, min(self.settings.budget // 4, 1 << 28)))

    @functools.cached_property
    def workers(self) -> ThreadPoolExecutor:
        """Threads that compute."""
        return ThreadPoolExecutor(self.thread_count, "oiiotex-work")

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
        """What `make` gives, or gave under that key: analyzes that a resident process keeps from job to job.

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

    def spread(self, work: Callable[[Piece], Result], pieces: Iterable[Piece]) -> Iterator[Result]:
        """What `work` makes of each piece, in order, on all threads of the run.

        Work must be computing alone: what reads an image may itself be waiting for these threads.
        """
        return self.workers.map(work, pieces)

    @contextlib.contextmanager
    def beside(self, work: Callable[[], Result]) -> Iterator[Callable[[], Result]]:
        """Begin `work` on a thread of its own, while the block does something else; gives what waits for its result.

        A run of one thread does it when its result is asked for.
        """
        if self.thread_count == 1:
            yield work
            return
        with ThreadPoolExecutor(1, "oiiotex-beside") as thread:
            yield thread.submit(work).result

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
        self.forget_device()
        return work()

    def _instead(self, error: BaseException | None) -> str | None:
        """The device that takes over; None where that would not help, or is not wanted."""
        from ..opencl import device

        while error is not None and not isinstance(error, BuildError):
            # a step's error may be raised from itself
            error = error.__cause__ if error.__cause__ is not error else None
        if error is None or not self.has_device or self.settings.device_name or device.named_by_environment():
            return None
        instead = device.refuse(self.device.info, self.settings.threads)
        return instead.name if instead else None

    @contextlib.contextmanager
    def keeping(self, path: str | os.PathLike[str]) -> Iterator[Checkpoint]:
        """While this lasts, ops with resume=1 keep finished pieces beside `path`, which is written later."""
        before, keeper = self.keeper, self.checkpoint(Path(path))
        self.keeper = keeper
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
            self.keeper = before

    @contextlib.contextmanager
    def checkpoints(self, path: str | os.PathLike[str]) -> Iterator[None]:
        """As `keeping`, for who writes the file: pieces are removed when this ends well."""
        try:
            with self.keeping(path) as keeper:
                yield
                keeper.discard()
        finally:
            self.forget_checkpoint(Path(path))

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


def _bytes_of(value: Any) -> int:
    """Of arrays, and of what says its bytes as they do: in tuples, lists and fields of dataclasses, too."""
    if hasattr(value, "nbytes"):
        return int(value.nbytes)
    if isinstance(value, (tuple, list)):
        return sum(map(_bytes_of, value))
    if is_dataclass(value) and not isinstance(value, type):
        return sum(_bytes_of(getattr(value, one.name)) for one in fields(value))
    return 0
