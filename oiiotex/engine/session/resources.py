# SPDX-License-Identifier: Apache-2.0
"""Resources of a run: device, color config, cache, threads, checkpoints, and the memory budget."""

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

from ..errors import BuildError, Error
from ..io.checkpoint import Checkpoint
from ..stats import Stats
from .facts import Facts

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import DTypeLike

    from ..core.image import Part
    from ..opencl.device import Device, DeviceMemory
    from .settings import Settings

log = logging.getLogger("oiiotex")

Piece = TypeVar("Piece")
Result = TypeVar("Result")


class Resources(Facts):
    """Resources that a run opens once, at first use, in addition to the facts about it.

    Parameters
    ----------
    settings : Settings

    Attributes
    ----------
    stats : Stats
        Seconds by stage.
    keeper : Checkpoint or None
        Checkpoint of the output file, where ops with resume=1 store finished pieces.
    memory : int
        Size of the cache of `remembered`, in bytes; 0 (the default, for a single command line): no cache.
    """

    def __init__(self, settings: Settings):
        super().__init__(settings)
        self.stats = Stats()
        self._last: tuple[str, Any] = ("", None)
        self.keeper: Checkpoint | None = None
        self.memory = 0
        self._memory: OrderedDict[Hashable, tuple[Any, tuple[object, ...]]] = OrderedDict()
        self._checkpoints: dict[Path, Checkpoint] = {}  # by file, shared by the op and the writer

    @functools.cached_property
    def device(self) -> Device:
        """The OpenCL device."""
        from ..machine import map_large_arrays
        from ..opencl import device_choice

        map_large_arrays()
        with self.stats.time("open device"):
            opened = device_choice.open_device(self.settings.device_name, self.settings.threads)
        opened.record = self.settings.profile
        return opened

    @property
    def device_memory(self) -> DeviceMemory | None:
        """The device itself, whose memory may be partly in use."""
        return self.device

    @property
    def has_device(self) -> bool:
        """Whether the device is open."""
        return "device" in self.__dict__

    def forget_device(self) -> None:
        """Close the device, and drop cached results that were computed with it."""
        self.__dict__.pop("device", None)
        self._last = "", None
        self._memory.clear()

    @functools.cached_property
    def workers(self) -> ThreadPoolExecutor:
        """Thread pool for computation."""
        return ThreadPoolExecutor(self.thread_count, "oiiotex-work")

    def inherit(self, other: Resources) -> None:
        """Take over the device and the color config of a finished session with the same settings."""
        for name in ("device", "color"):
            if name in other.__dict__:
                self.__dict__[name] = other.__dict__[name]
        self._last = other._last

    def forget_scanned(self, *parts: Part) -> None:
        """Free the cache after a scan of parts that exceed it: it has the last rows, the next scan needs the first."""
        if sum(part.window.width * part.window.height * part.pixel_bytes for part in parts) > self.cache.limit:
            self.cache.forget()

    def once(self, key: str, make: Callable[[], Result]) -> Result:
        """The result of `make`, cached for the last key: for frames with the same preparation."""
        if self._last[0] != key:
            self._last = "", None  # frees the memory of the last value first
            self._last = key, make()
        value: Result = self._last[1]
        return value

    def remembered(self, key: Hashable, make: Callable[[], Result], *held: object) -> Result:
        """The result of `make`, cached by key, for example results that jobs of a resident process reuse.

        Parameters
        ----------
        key : hashable
        make : callable
        held : objects
            Objects whose id is part of the key; they are kept alive with the cached value.
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
        """The results of `work` for each piece, in order, on all threads of the run.

        `work` must only compute: reading an image may wait for these threads and cause a deadlock.
        """
        return self.workers.map(work, pieces)

    @contextlib.contextmanager
    def in_background(self, work: Callable[[], Result], need: int = 0) -> Iterator[Callable[[], Result]]:
        """Run `work` on a separate thread during the block; yields a function that waits for its result.

        With a single thread, or if it needs more than an eighth of the budget, `work` runs when its result is
        requested.
        """
        if self.thread_count == 1 or need > self.budget // 8:
            yield work
            return
        with ThreadPoolExecutor(1, "oiiotex-background") as thread:
            yield thread.submit(work).result

    def on_a_device(self, work: Callable[[], Result]) -> Result:
        """The result of `work`; if the device's compiler rejects a program, warn and repeat it on the next device.

        A device that was selected by name is not replaced.
        """
        try:
            return work()
        except Error as error:
            instead = self._instead(error)
            if instead is None:
                raise
            log.warning("%s; repeating all work on %s", error, instead)
        self.forget_device()
        return work()

    def _instead(self, error: BaseException | None) -> str | None:
        """The device to use instead; None if the error has another cause, or the device was selected by name."""
        from ..opencl import device_choice

        while error is not None and not isinstance(error, BuildError):
            # a step's error may be raised from itself
            error = error.__cause__ if error.__cause__ is not error else None
        if error is None or not self.has_device or self.settings.device_name or device_choice.named_by_environment():
            return None
        instead = device_choice.refuse(self.device.info, self.settings.threads)
        return instead.name if instead else None

    @contextlib.contextmanager
    def keeping(self, path: str | os.PathLike[str]) -> Iterator[Checkpoint]:
        """Within this block, ops with resume=1 store finished pieces next to `path`."""
        before, keeper = self.keeper, self._checkpoints.setdefault(Path(path), Checkpoint(Path(path)))
        self.keeper = keeper
        try:
            yield keeper
        except Exception:
            raise
        except BaseException:  # the run was interrupted
            keeper.say_kept()
            raise
        finally:
            self.keeper = before

    @contextlib.contextmanager
    def checkpoints(self, path: str | os.PathLike[str]) -> Iterator[None]:
        """As `keeping`, for the writer of the file: the pieces are removed on success."""
        try:
            with self.keeping(path) as keeper:
                yield
                keeper.discard()
        finally:
            self._checkpoints.pop(Path(path), None)

    def scratch(
        self, layout: Mapping[str, tuple[tuple[int, ...], DTypeLike]], task: str, advice: str, extra: int = 0
    ) -> dict[str, np.ndarray]:
        """Arrays of zeros, allocated after their total is checked against the budget.

        Parameters
        ----------
        layout : mapping of name to (shape, dtype)
        task, advice : str
            Text of the error.
        extra : int
            Further bytes that calculations need at the same time.

        Raises
        ------
        MemoryBudgetError
            They exceed the budget.
        """
        import numpy as np  # a session is created before numpy is needed

        need = sum(np.dtype(kind).itemsize * math.prod(shape) for shape, kind in layout.values())
        self.require(need + extra, task, advice)
        return {name: np.zeros(shape, kind) for name, (shape, kind) in layout.items()}


def _bytes_of(value: Any) -> int:
    """Bytes of arrays, also in tuples, lists and fields of dataclasses."""
    if hasattr(value, "nbytes"):
        return int(value.nbytes)
    if isinstance(value, (tuple, list)):
        return sum(map(_bytes_of, value))
    if is_dataclass(value) and not isinstance(value, type):
        return sum(_bytes_of(getattr(value, one.name)) for one in fields(value))
    return 0
