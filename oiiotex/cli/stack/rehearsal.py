# SPDX-License-Identifier: Apache-2.0
"""A command line looked through before it is run: what is wrong with it is said before a pixel is computed.

The steps are done as ever, by the same code, on images whose pixels cannot be asked for and with a session that opens
no device: what an op refuses before it looks at pixels or works on the device, whose memory is known, and what a
file's name, folder, format or type refuse, is found now. Where an op does look, what it makes is known by declaration
alone (`run.foreseen`), and what later steps would refuse of such an image is left to the run. Where an expression or
an option looks at pixels nothing can be said of the steps behind it.
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

from ...core.demand import PieceCache
from ...core.image import Image, Part
from ...core.op import Op
from ...deferred import oiio
from ...errors import DeviceError, Error, Unseen
from ...io.formats import Format
from ...io.writing import require_writable
from ...run import as_foreseen, foreseen, is_foreseen
from ...session import Session
from ...session.progress import Progress
from ...session.resources import Resources
from ...session.settings import Settings
from ..files.reading import read_input
from ..language.parse import Step
from ..language.sequences import Frame
from . import output_settings
from .chain import Chain

if TYPE_CHECKING:
    from ...color.config import ColorConfig
    from ...opencl.device import Device

log = logging.getLogger("oiiotex")

_MOST_STEPS = 2000  # of loops, the rest is left to the run


@dataclass(frozen=True)
class Foresight:
    """What a line has shown."""

    steps: int  # of its first ones, up to the last that prints, writes or decides something: the others are in vain
    notes: tuple[tuple[int, str], ...] = ()  # logging level and text of what the run will not say
    files: tuple[str, ...] = ()  # of each use of an op the file that is written next, as far as it is known


@dataclass
class Rehearsals:
    """Looks lines of one run through, one after the other: a later one may read what an earlier one writes."""

    session: Session
    files: dict[str, Image] = field(default_factory=dict)  # that would be written, by their real paths

    def foresight(self, steps: Sequence[Step], frame: Frame | None) -> Foresight:
        """What can be said of the steps."""
        chain = _Rehearsal(_untouched(self.session), frame, self.files, self.session.progress.measure)
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
    """What there is to log is logged when it is done."""
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


class _Unopened(Resources):
    """Resources of a session that opens no device and looks at no pixel."""

    def __init__(self, settings: Settings, behind: Resources):
        super().__init__(settings)
        self._behind = behind

    @functools.cached_property
    def device(self) -> Device:
        """One of which nothing but its memory is known: whoever asks for more is about to work."""
        from ...opencl.device import choose
        from ...opencl.unopened import UnopenedDevice

        try:
            return UnopenedDevice(choose(self.settings.device_name, self.settings.threads))
        except DeviceError:  # the run says so, if it needs one
            raise Unseen from None

    @property
    def workers(self) -> NoReturn:
        """None: work begins."""
        raise Unseen

    @functools.cached_property
    def color(self) -> ColorConfig:
        """That of the run: loaded once. What it would warn of, the run says."""
        return self._behind.color.unwarned()

    @functools.cached_property
    def cache(self) -> PieceCache:
        """One through which no pixel comes."""
        return _Closed(self._behind.cache.limit)


def _untouched(session: Session) -> Session:
    """With the settings and the colors of that session."""
    settings = replace(session.settings, autocc=False, all_parts=False, profile=False)
    return Session.of(_Unopened(settings, session.resources), Progress())


class _Closed(PieceCache):
    """A cache whose pieces are not to be had."""

    def get(self, key: Any, make: Any) -> NoReturn:
        """Nothing."""
        raise Unseen


class _Unknown(Image):
    """An image of which nothing is known, not even what an op declares."""

    def __init__(self) -> None:
        pass

    def __getattribute__(self, name: str) -> Any:
        """What has `Image` as its class."""
        if name.startswith("__"):
            return super().__getattribute__(name)
        raise Unseen


class _Rehearsal(Chain):
    """A chain that does everything but compute, print and write."""

    dry = True

    def __init__(self, session: Session, frame: Frame | None, files: dict[str, Image], measures: bool):
        super().__init__(session, read_input, frame)
        self._files = files
        self._measures = measures  # the run says them
        self._count = 0
        self._needed = 0  # steps up to the last that prints or writes
        self._certain = False  # what has failed will fail in the run
        self._outputs = 0
        self._uses = 0  # of ops
        self.files: list[str] = []  # that are written next after each of them
        self._idle: list[str] = []  # settings of outputs since the last one
        self._last = ""  # the last op
        self._notes: list[tuple[int, int, str]] = []  # step, level and text
        self.globals = contextlib.ExitStack()  # attributes of OpenImageIO, which it gives back as they were

    def foresight(self, steps: Sequence[Step]) -> Foresight:
        """What has been seen when all steps have been done."""
        control = max((n + 1 for n, step in enumerate(steps) if step.option and step.option.control), default=0)
        needed = max(self._needed, control) if self._needed else 0
        notes = [(level, text) for position, level, text in self._notes if position > needed]
        if self.unwritten and not self.used:
            notes.append((logging.WARNING, "nothing was written: did you forget -o?"))
        elif self.unwritten and self._outputs:
            notes.append((logging.WARNING, f"{self._last} behind the last output is not done: did you forget -o?"))
        if self._outputs and self._idle:
            notes.append((logging.WARNING, f"{', '.join(self._idle)} behind the last output changes nothing"))
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
                super()._do(step)  # what fails whatever the image is, fails again
                raise Unseen from None
            raise

    def images_of(self, op: Op) -> Sequence[Image]:
        """What is known of the op's images."""
        self._last = op.flag()
        self._uses += 1
        measured = self._measures and op.prefix == Op.prefix
        if op.files() or measured or any(map(op.judges, op.outputs)):
            self._needed = self.position
        with self._certainly():
            return foreseen(op, self.session, self.written)

    @contextlib.contextmanager
    def _certainly(self) -> Iterator[None]:
        """What fails here will fail in the run, whatever is known of the images."""
        try:
            yield
        except Error:
            self._certain = True
            raise

    def known(self, image: Image) -> Image:
        """The image, unless it is not made yet: nothing can be said of it."""
        if is_foreseen(image):
            raise Unseen
        return image

    def acts(self, *parts: Part) -> bool:
        """No."""
        with self._certainly():
            super().acts(*parts)
        self._needed = self.position
        return False

    def set_global(self, name: str, kind: oiio.TypeDesc, value: object, before: object) -> None:
        """Set an attribute of OpenImageIO until the line has been looked through."""
        self.globals.callback(oiio.attribute, name, kind, before)
        super().set_global(name, kind, value, before)

    def tell(self, text: str) -> None:
        """Not now."""
        if self.settings.get("-v"):
            self._needed = self.position

    def note(self, level: int, text: str) -> None:
        """For later, if the step is not done."""
        self._notes.append((self.position, level, text))

    def will_write(self, image: Image, path: str, how: Format) -> None:
        """Refuse what cannot be written; from here on the file is there."""
        self._outputs += 1
        self._idle.clear()
        self.files += [path] * (self._uses - len(self.files))
        with self._certainly():
            require_writable(image, self._place_of(path), how)
        self._files[os.path.realpath(path)] = as_foreseen(image)

    def _place_of(self, path: str) -> str:
        """A file's name; in a folder that is there already where its own is to be made."""
        folder, name = os.path.split(path)
        if not self.settings.get("--create-dir"):
            return path
        while folder and not os.path.exists(folder):
            folder = os.path.dirname(folder)
        return os.path.join(folder, name)

    def opened(self, path: str, native: bool = False, config: oiio.ImageSpec | None = None) -> Image:
        """An image without pixels."""
        if os.path.realpath(path) in self._files:
            return Image(self._files[os.path.realpath(path)].parts, path)
        with self._certainly():
            return super().opened(path, native, config)

    def require_free(self, path: str) -> None:
        """Refuse a name under which a filter would just have written."""
        with self._certainly():
            super().require_free(path)

    def changed(self, path: str) -> float:
        """When a file was last changed: what will be written is newer than anything."""
        return math.inf if os.path.realpath(path) in self._files else super().changed(path)

    def has_file(self, path: str) -> bool:
        """Whether there is such a file, or will be."""
        return os.path.realpath(path) in self._files or super().has_file(path)
