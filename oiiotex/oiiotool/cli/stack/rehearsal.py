# SPDX-License-Identifier: Apache-2.0
"""A rehearsal of a command line: reports errors before a pixel is computed.

It runs the steps with the code of the run, but ops are only planned (`run.planned`): no pixel is read, and no device is
opened. It finds the errors that plans raise, and errors in names, folders, formats and types of files. An image whose
windows, channels or number depend on pixels is provisional: only its declaration is known, and errors of later steps
that use it are left to the run. An expression that needs pixels or a provisional image ends the rehearsal.
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
from ....engine.deferred import oiio
from ....engine.errors import Error, ImageError, ParameterError
from ....engine.io.formats import Format
from ....engine.io.writing import require_writable
from ....engine.run import as_provisional, is_provisional, planned
from ....engine.session import Session
from ....engine.session.facts import Facts
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
    from ....engine.opencl.device import DeviceMemory

log = logging.getLogger("oiiotex")

_MOST_STEPS = 2000  # in loops; the rest is left to the run
_SEVERAL = "add # (the frame), %V (the view) or <UDIM> (the tile) to its name"


@dataclass(frozen=True)
class Foresight:
    """The result of a rehearsal."""

    steps: int  # up to the last one that prints, writes or controls: the run skips the others
    notes: tuple[tuple[int, str], ...] = ()  # level and text of log lines for skipped steps
    files: tuple[str, ...] = ()  # for each use of an op the file that is written next, if known


class CollisionError(ParameterError):
    """The lines of two files of --each, or two frames, write the same file."""


@dataclass
class Rehearsals:
    """Rehearses the lines of one run in order: a later one may read files that an earlier one writes."""

    session: Session
    files: dict[str, Image] = field(default_factory=dict)  # that the run will write, by their real paths
    owners: dict[str, Frame] = field(default_factory=dict)  # the first line to which a path belongs

    def foresight(self, steps: Sequence[Step], frame: Frame | None) -> Foresight:
        """Rehearse the steps; raises the errors that the run would raise."""
        chain = _Rehearsal(_untouched(self.session), frame, self.files, self.session.progress.measure, self.owners)
        try:
            with _quiet(), chain.globals:
                chain.run(steps)
        except _Unknown:
            return Foresight(len(steps), files=tuple(chain.files))
        except Error:
            if chain.settings.get("--no-error-exit"):
                return Foresight(len(steps), files=tuple(chain.files))
            print("".join(chain.echoed), end="", flush=True)  # what the run would have printed before
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


def _untouched(session: Session) -> Session:
    """A session for rehearsals with the settings and the color config of `session`."""
    settings = replace(session.settings, autocc=False, all_parts=False, profile=False)
    resources = _Planning(settings, session.resources)
    return Session.of(resources, Progress())


class _Planning(Resources):
    """Resources of a session in which ops are only planned."""

    def __init__(self, settings: Settings, behind: Resources):
        super().__init__(settings)
        self._behind = behind

    @property
    def device_memory(self) -> DeviceMemory | None:
        """The memory of a device that is not opened."""
        return Facts(self.settings).device_memory

    @functools.cached_property
    def color(self) -> ColorConfig:
        """The config of the run, loaded once, without its warnings, which the run prints."""
        return self._behind.color.unwarned()


class _Unknown(Exception):
    """What follows on the line depends on pixels. Raised by the rehearsal's own methods, never by an op."""


class _Provisional(Image):
    """A provisional image; `chain.looked` is set when something of it is used."""

    def __init__(self, image: Image, chain: _Rehearsal):
        super().__init__(image.parts, image.source)
        object.__setattr__(self, "_chain", chain)

    def __getattribute__(self, name: str) -> Any:
        """Record the access, except to special attributes."""
        if not name.startswith("_"):
            chain = object.__getattribute__(self, "__dict__").get("_chain")
            if chain is not None:
                chain.looked = True
        return super().__getattribute__(name)


class _Rehearsal(Chain):
    """A chain that does not compute, print or write."""

    dry = True

    def __init__(
        self,
        session: Session,
        frame: Frame | None,
        files: dict[str, Image],
        measures: bool,
        owners: dict[str, Frame],
    ):
        super().__init__(session, read_input, frame)
        self._files, self._owners = files, owners
        self._continued: set[str] = set()  # files of earlier lines that this one reads
        self._replaced: list[str] = []  # warnings of files of earlier frames that it replaces
        self._measures = measures  # the run prints them
        self._count = 0
        self._needed = 0  # steps up to the last that prints or writes
        self._certain = False  # the error will also occur in the run
        self.looked = False  # the step has used a provisional image
        self._outputs = 0
        self._uses = 0  # of ops
        self.files: list[str] = []  # the file written next after each of them
        self._idle: list[str] = []  # settings of outputs since the last one
        self._last = ""  # the last op
        self._made, self._outputs_before = 0, 0  # number of its images, and of outputs before it
        self._notes: list[tuple[int, int, str]] = []  # step, level and text
        self.globals = contextlib.ExitStack()  # restores attributes of OpenImageIO

    def foresight(self, steps: Sequence[Step]) -> Foresight:
        """The result after all steps."""
        control = max((n + 1 for n, step in enumerate(steps) if step.option and step.option.control), default=0)
        needed = max(self._needed, control) if self._needed else 0
        notes = [(level, text) for position, level, text in self._notes if position > needed]
        notes += [(logging.WARNING, text) for text in self._replaced]
        if self.unwritten and not self.used:
            notes.append((logging.WARNING, "no file was written: did you forget -o?"))
        elif self.unwritten and self._outputs:
            notes.append((logging.WARNING, f"{self._last} after the last output is skipped: did you forget -o?"))
        left, written = min(self._made, len(self.stack)), self._outputs - self._outputs_before
        if self._made > 1 and 0 < written < left:
            text = f"{written} of the {left} images of {self._last} is written: to write all, use -o:all=0 NAME_%d.png"
            notes.append((logging.WARNING, text))
        if self._outputs and self._idle:
            notes.append((logging.WARNING, f"{', '.join(self._idle)} after the last output has no effect"))
        return Foresight(needed, tuple(notes), tuple(self.files))

    def _do(self, step: Step) -> None:
        self._count += 1
        if self._count > _MOST_STEPS:
            raise _Unknown
        if step.option in output_settings.OPTIONS:
            self._idle.append(" ".join((step.word, *step.arguments)))
        self.stack = list(map(self._watched, self.stack))
        self.looked = False
        try:
            super()._do(step)
        except Error:
            if self.looked and not self._certain:
                raise _Unknown from None
            raise

    def _watched(self, image: Image) -> Image:
        """The image, watched if it is provisional."""
        return _Provisional(image, self) if not isinstance(image, _Provisional) and is_provisional(image) else image

    def images_of(self, op: Op) -> Sequence[Image]:
        """The op's images as declared."""
        self._last = op.flag()
        self._uses += 1
        measured = self._measures and op.prefix == Op.prefix
        for name, path in op.files().items():
            if (owner := self._other_owner(str(path))) is not None:
                self._refuse_shared(str(path), owner, f"{op.output(name).asked_by}=")
        if op.files() or measured or any(map(op.judges, op.outputs)):
            self._needed = self.position
        with self._certainly():
            images = planned(op, self.session.resources, self.written)
        self._made, self._outputs_before = len(images), self._outputs
        return images

    @contextlib.contextmanager
    def _certainly(self) -> Iterator[None]:
        """Mark errors of a block as certain: they do not depend on unknown images."""
        try:
            yield
        except Error:
            self._certain = True
            raise

    def known(self, image: Image, pixels: bool) -> Image:
        """The image; ends the rehearsal if an expression needs what depends on pixels."""
        if pixels or is_provisional(image):
            raise _Unknown
        return image

    def needs_pixels(self) -> NoReturn:
        """End the rehearsal."""
        raise _Unknown

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
            self._require_own(path)
            require_writable(image, path, how, self._place_of(path))
        self._files[os.path.realpath(path)] = as_provisional(image)

    def _require_own(self, path: str) -> None:
        """Refuse an output of another file of --each; warn of one that replaces that of another frame."""
        owner = self._other_owner(path)
        if owner is None:
            return
        if owner.file:
            self._refuse_shared(path, owner)
        if os.path.realpath(path) not in self._continued:
            self._replaced.append(f"{path} is written by several frames, and only the last remains: {_SEVERAL}")

    def _other_owner(self, path: str) -> Frame | None:
        """The line to which an input or output belongs, if it is another one."""
        if self.frame is None:
            return None
        owner = self._owners.setdefault(os.path.realpath(path), self.frame)
        return None if owner is self.frame else owner

    def _refuse_shared(self, path: str, owner: Frame, request: str = "") -> NoReturn:
        """Raise the error for a file of two lines; `request` is the modifier that asks for it."""
        if self.frame is not None and self.frame.file:
            raise CollisionError(
                f"{path} is an input or output of both {owner.file} and {self.frame.file}",
                hint="use {name}, {dir} and {ext} of --each in the names of outputs",
            )
        problem = f"{request}{path} would be written by several frames, and only the last would remain"
        raise CollisionError(problem, hint=_SEVERAL)

    def _place_of(self, path: str) -> str:
        """A file name, in an existing folder if --create-dir will create its own."""
        folder, name = os.path.split(path)
        if not self.settings.get("--create-dir"):
            return path
        while folder and not os.path.exists(folder):
            folder = os.path.dirname(folder)
        above = folder or "."
        if folder != os.path.dirname(path) and not (os.path.isdir(above) and os.access(above, os.W_OK)):
            raise ImageError(f"cannot create the folder of {path}: {above} is not a folder, or cannot be written")
        return os.path.join(folder, name)

    def opened(self, path: str, native: bool = False, config: oiio.ImageSpec | None = None) -> Image:
        """The image of a file, without pixels."""
        if os.path.realpath(path) in self._files:
            self._continued.add(os.path.realpath(path))
            return self._watched(Image(self._files[os.path.realpath(path)].parts, path))
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
