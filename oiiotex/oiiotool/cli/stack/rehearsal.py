# SPDX-License-Identifier: Apache-2.0
"""A rehearsal of a command line: reports errors before a pixel is computed.

It runs the steps with the code of the run, on images without pixels and in a session that opens no device. It finds the
errors that ops raise before they read pixels or use the device, whose memory is known, and errors in names, folders,
formats and types of files. Once an op reads pixels, its result is known only as declared (`run.foreseen`), and errors
of later steps on that image are left to the run. An expression or option that reads pixels ends the rehearsal.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NoReturn

from ....engine.core.image import Image, Part
from ....engine.core.op import Op
from ....engine.core.piece_cache import PieceCache
from ....engine.deferred import oiio
from ....engine.errors import DeviceError, Error, ParameterError, Unseen
from ....engine.io.formats import Format
from ....engine.io.writing import require_writable
from ....engine.run import as_foreseen, foreseen, is_foreseen
from ....engine.session import Session
from ....engine.session.progress import Progress
from ....engine.session.resources import Resources
from ....engine.session.settings import Settings
from ..files.reading import read_input
from ..language.parse import Step
from ..language.sequences import Frame
from . import output_settings
from .chain import Chain

if TYPE_CHECKING:
    from ....engine.color.config import ColorConfig
    from ....engine.opencl.device import Device

log = logging.getLogger("oiiotex")

_MOST_STEPS = 2000  # in loops; the rest is left to the run


@dataclass(frozen=True)
class Foresight:
    """The result of a rehearsal."""

    steps: int  # up to the last one that prints, writes or controls: the run skips the others
    notes: tuple[tuple[int, str], ...] = ()  # level and text of log lines for skipped steps
    files: tuple[str, ...] = ()  # for each use of an op the file that is written next, if known


class CollisionError(ParameterError):
    """The lines of two files of --each write the same file."""


@dataclass
class Rehearsals:
    """Rehearses the lines of one run in order: a later one may read files that an earlier one writes."""

    session: Session
    files: dict[str, Image] = field(default_factory=dict)  # that the run will write, by their real paths
    owners: dict[str, str] = field(default_factory=dict)  # the file of --each to which a path belongs

    def foresight(self, steps: Sequence[Step], frame: Frame | None) -> Foresight:
        """Rehearse the steps; raises the errors that the run would raise."""
        chain = _Rehearsal(_untouched(self.session), frame, self.files, self.session.progress.measure, self.owners)
        try:
            with _quiet(), chain.globals:
                chain.run(steps)
        except Unseen:
            return Foresight(len(steps), files=tuple(chain.files))
        except Error:
            if chain.settings.get("--no-error-exit"):
                return Foresight(len(steps), files=tuple(chain.files))
            raise
        return chain.foresight(steps)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Disable logging: the run logs."""
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


class _Unopened(Resources):
    """Resources of a session that opens no device and reads no pixel."""

    def __init__(self, settings: Settings, behind: Resources):
        super().__init__(settings)
        self._behind = behind

    @functools.cached_property
    def device(self) -> Device:
        """A device of which only the memory is known; all else raises `Unseen`."""
        from ....engine.opencl.device_choice import choose
        from ....engine.opencl.unopened import UnopenedDevice

        try:
            return UnopenedDevice(choose(self.settings.device_name, self.settings.threads))
        except DeviceError:  # the run raises it if it needs a device
            raise Unseen from None

    @property
    def workers(self) -> NoReturn:
        """Raises `Unseen`: work begins."""
        raise Unseen

    @functools.cached_property
    def color(self) -> ColorConfig:
        """The config of the run, loaded once, without its warnings, which the run prints."""
        return self._behind.color.unwarned()

    @functools.cached_property
    def cache(self) -> PieceCache:
        """A cache without pixels."""
        return _Closed(self._behind.cache.limit)


def _untouched(session: Session) -> Session:
    """A session for rehearsals with the settings and the color config of `session`."""
    settings = replace(session.settings, autocc=False, all_parts=False, profile=False)
    return Session.of(_Unopened(settings, session.resources), Progress())


class _Closed(PieceCache):
    """A cache that raises `Unseen` for every piece."""

    def get(self, key: Any, make: Any) -> NoReturn:
        """Raises `Unseen`."""
        raise Unseen


class _Unknown(Image):
    """An image of which nothing is known."""

    def __init__(self) -> None:
        pass

    def __getattribute__(self, name: str) -> Any:
        """Raise `Unseen`, except for special attributes."""
        if name.startswith("__"):
            return super().__getattribute__(name)
        raise Unseen


class _Rehearsal(Chain):
    """A chain that does not compute, print or write."""

    dry = True

    def __init__(
        self,
        session: Session,
        frame: Frame | None,
        files: dict[str, Image],
        measures: bool,
        owners: dict[str, str],
    ):
        super().__init__(session, read_input, frame)
        self._files, self._owners = files, owners
        self._measures = measures  # the run prints them
        self._count = 0
        self._needed = 0  # steps up to the last that prints or writes
        self._certain = False  # the error will also occur in the run
        self._outputs = 0
        self._uses = 0  # of ops
        self.files: list[str] = []  # the file written next after each of them
        self._idle: list[str] = []  # settings of outputs since the last one
        self._last = ""  # the last op
        self._notes: list[tuple[int, int, str]] = []  # step, level and text
        self.globals = contextlib.ExitStack()  # restores attributes of OpenImageIO

    def foresight(self, steps: Sequence[Step]) -> Foresight:
        """The result after all steps."""
        control = max((n + 1 for n, step in enumerate(steps) if step.option and step.option.control), default=0)
        needed = max(self._needed, control) if self._needed else 0
        notes = [(level, text) for position, level, text in self._notes if position > needed]
        if self.unwritten and not self.used:
            notes.append((logging.WARNING, "no file was written: did you forget -o?"))
        elif self.unwritten and self._outputs:
            notes.append((logging.WARNING, f"{self._last} after the last output is skipped: did you forget -o?"))
        if self._outputs and self._idle:
            notes.append((logging.WARNING, f"{', '.join(self._idle)} after the last output has no effect"))
        return Foresight(needed, tuple(notes), tuple(self.files))

    def _do(self, step: Step) -> None:
        self._count += 1
        if self._count > _MOST_STEPS:
            raise Unseen
        if step.option in output_settings.OPTIONS:
            self._idle.append(" ".join((step.word, *step.arguments)))
        before = list(self.stack)
        try:
            super()._do(step)
        except Error:
            looked_at = before[-max(1, step.option.needs) :] if step.option else before
            if not self._certain and any(map(is_foreseen, looked_at)):
                self.stack = [_Unknown() if is_foreseen(image) else image for image in before]
                super()._do(step)  # an error that does not depend on the image occurs again
                raise Unseen from None
            raise

    def images_of(self, op: Op) -> Sequence[Image]:
        """The op's images as declared."""
        self._last = op.flag()
        self._uses += 1
        measured = self._measures and op.prefix == Op.prefix
        for path in op.files().values():
            self._own(str(path))
        if op.files() or measured or any(map(op.judges, op.outputs)):
            self._needed = self.position
        with self._certainly():
            return foreseen(op, self.session, self.written)

    @contextlib.contextmanager
    def _certainly(self) -> Iterator[None]:
        """Mark errors of a block as certain: they do not depend on unknown images."""
        try:
            yield
        except Error:
            self._certain = True
            raise

    def known(self, image: Image) -> Image:
        """The image; raises `Unseen` if it is not computed yet."""
        if is_foreseen(image):
            raise Unseen
        return image

    def acts(self, *parts: Part) -> bool:
        """False."""
        with self._certainly():
            super().acts(*parts)
        self._needed = self.position
        return False

    def set_global(self, name: str, kind: oiio.TypeDesc, value: object, before: object) -> None:
        """Set an attribute of OpenImageIO until the end of the rehearsal."""
        self.globals.callback(oiio.attribute, name, kind, before)
        super().set_global(name, kind, value, before)

    def tell(self, text: str) -> None:
        """Note that the step prints."""
        if self.settings.get("-v"):
            self._needed = self.position

    def note(self, level: int, text: str) -> None:
        """Keep the line for the log, in case the run skips the step."""
        self._notes.append((self.position, level, text))

    def will_write(self, image: Image, path: str, how: Format) -> None:
        """Refuse a file that cannot be written; later steps see the file."""
        self._outputs += 1
        self._idle.clear()
        self.files += [path] * (self._uses - len(self.files))
        with self._certainly():
            if (
                self.frame is not None
                and self.frame.file
                and os.path.realpath(path) == os.path.realpath(self.frame.file)
            ):
                raise CollisionError(f"{path} is the input", hint="use another folder or name")
            self._own(path)
            require_writable(image, self._place_of(path), how)
        self._files[os.path.realpath(path)] = as_foreseen(image)

    def _own(self, path: str) -> None:
        """Refuse an input or output that is also one of another file of --each."""
        if self.frame is None or not self.frame.file:
            return
        owner = self._owners.setdefault(os.path.realpath(path), self.frame.file)
        if owner != self.frame.file:
            raise CollisionError(
                f"{path} is an input or output of both {owner} and {self.frame.file}",
                hint="use {name}, {dir} and {ext} of --each in the names of outputs",
            )

    def _place_of(self, path: str) -> str:
        """A file name, in an existing folder if --create-dir will create its own."""
        folder, name = os.path.split(path)
        if not self.settings.get("--create-dir"):
            return path
        while folder and not os.path.exists(folder):
            folder = os.path.dirname(folder)
        return os.path.join(folder, name)

    def opened(self, path: str, native: bool = False, config: oiio.ImageSpec | None = None) -> Image:
        """The image of a file, without pixels."""
        if os.path.realpath(path) in self._files:
            return Image(self._files[os.path.realpath(path)].parts, path)
        with self._certainly():
            return super().opened(path, native, config)

    def require_free(self, path: str) -> None:
        """Refuse a name that an op of the run writes."""
        with self._certainly():
            super().require_free(path)

    def changed(self, path: str) -> float:
        """The time of a file's last change; infinity for files that the run will write."""
        return math.inf if os.path.realpath(path) in self._files else super().changed(path)

    def has_file(self, path: str) -> bool:
        """Whether a file exists or will be written."""
        return os.path.realpath(path) in self._files or super().has_file(path)
