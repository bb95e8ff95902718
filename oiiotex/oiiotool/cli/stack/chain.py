# SPDX-License-Identifier: Apache-2.0
"""The image stack: runs the steps of a command line in order."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from ....engine.core.attributes import require_utf8
from ....engine.core.demand import materialized
from ....engine.core.image import Image, Part
from ....engine.core.op import Op
from ....engine.core.parameters import Parameter
from ....engine.deferred import oiio
from ....engine.errors import Error, ImageError, ParameterError
from ....engine.io.formats import Format
from ....engine.io.reading import read
from ....engine.run import run
from ....engine.session import Session
from ..language.parse import Option, Step, errors_of_step, split_modifiers, values_of
from ..language.sequences import Frame
from ..language.titles import title_of
from .first_image import First

if TYPE_CHECKING:
    from ..running.shares import Shares

log = logging.getLogger("oiiotex")

_DEEPEST = 40  # of ops whose pixels depend on each other: each takes up to 12 calls of Python's 1000
_BEYOND_A_LIMIT = 3  # exit code: all is written, and a measure exceeds its limit


class Chain:
    """The stack, the settings for later steps, and ops that still lack operands."""

    dry = False  # True in a rehearsal

    def __init__(self, session: Session, read_input: Callable[[Chain, str], None], frame: Frame | None = None):
        self.read_input = read_input  # called with a file name
        self.session = session
        self.frame = frame
        self.inputs: set[str] = set()  # the files read so far, and names of computed images
        self.written: set[str] = set()  # real paths of files that ops wrote: later steps must not overwrite them
        self.stack: list[Image] = []  # the last is the top
        self.labeled: dict[str, Image] = {}  # by the names of --label
        self.user: dict[str, int | float | str] = {}  # variables of expressions
        self.first = First()
        self.settings: dict[str, Any] = {}  # of options for later ones, by the option's name
        self.status = 0  # exit code so far
        self.evaluating = True  # of expressions
        self.position = 0  # of the next step; control flow moves it
        self.skipping = False  # inside a condition that is false
        self.loops: list[Any] = []  # the open --if, --while and --for
        self.echoed: list[str] = []  # by --echo
        self.unwritten = False  # an image has been made and not written
        self.used = False  # something was written or printed
        self.shares: Shares | None = None  # the part of the output to compute; None: all
        self.written_next: Iterator[str] = iter(())  # for each use of an op the next file, '' if unknown
        self._waiting: list[tuple[Step, tuple[str, ...], dict[str, Any]]] = []

    @property
    def top(self) -> Image:
        """The current image."""
        if not self.stack:
            raise ParameterError("the stack is empty", expected="an image", hint="name an input file first")
        return self.stack[-1]

    def push(self, image: Image) -> None:
        """Put an image on the stack."""
        self.stack.append(image)

    def pop(self) -> Image:
        """Take the top image."""
        image = self.top
        self.stack.pop()
        return image

    def run(self, steps: Sequence[Step]) -> None:
        """Run all steps."""
        self.position = 0
        while self.position < len(steps):
            step = steps[self.position]
            self.position += 1
            if self.skipping and not (step.option and step.option.control):
                continue
            try:
                with errors_of_step(step):
                    self._do(step)
            except Error as error:
                if not self.settings.get("--no-error-exit"):
                    raise
                log.error("oiiotex ERROR: %s", error)
        self._nothing_waits()
        if self.loops:
            raise ParameterError(f"{self.loops[-1].name} is not closed", expected=f"--end{self.loops[-1].name[2:]}")

    def _do(self, step: Step) -> None:
        word = self.expressed(step.word) if not (self.skipping and step.option) else step.word
        if step.op is None and step.option is None:
            self.read_input(self, word)
            return self._run_waiting()
        raw = step.option is not None and (step.option.control or step.option.late)
        texts = step.arguments if raw else tuple(map(self.expressed, step.arguments))
        values = values_of(step, split_modifiers(word)[1])
        if step.op is not None:
            require_utf8(word, *texts)
            values |= {p.name: p.parse(text) for p, text in zip(step.op.arguments(), texts, strict=True)}
            self._waiting.append((step, (), values))
            return self._run_waiting()
        option = step.option
        assert option is not None
        if option.needs > len(self.stack):
            self._waiting.append((step, texts, values))
            return None
        if not (option.state or option.control or option.name == "-i"):
            self._nothing_waits()
        self._run_option(option, texts, values)
        return self._run_waiting()

    def _run_option(self, option: Option, texts: tuple[str, ...], values: dict[str, Any]) -> None:
        if option.flat:
            require_flat(self.stack[-option.needs :])
        assert option.run is not None
        modifiers = (option.modifiers(**values),) if option.modifiers else ()
        option.run(self, *texts, *modifiers)

    def expressed(self, text: str) -> str:
        """The string with its expressions evaluated."""
        if not self.evaluating or "{" not in text:
            return text
        from ..language.expressions import substituted  # few lines need it

        return substituted(text, self)

    def known(self, image: Image, pixels: bool) -> Image:
        """The image that an expression reads, possibly its `pixels`, which are unknown in a rehearsal."""
        return image

    def _nothing_waits(self) -> None:
        """Refuse further steps while an op lacks operands: they would change the wrong image."""
        if self._waiting:
            step, _, values = self._waiting[0]
            need = self._need(step, values)
            with errors_of_step(step):
                raise ParameterError(f"expected {need} image(s) on the stack, found {len(self.stack)}")

    def _need(self, step: Step, values: dict[str, Any]) -> int:
        if step.op is not None:
            return step.op.arity(values, len(self.stack))
        assert step.option is not None
        return step.option.needs

    def _run_waiting(self) -> None:
        while self._waiting and len(self.stack) >= self._need(self._waiting[0][0], self._waiting[0][2]):
            step, texts, values = self._waiting.pop(0)
            with errors_of_step(step):
                if step.op is not None:
                    self.apply(step.op, **values)
                else:
                    assert step.option is not None
                    self._run_option(step.option, texts, values)

    def apply(self, op: type[Op], /, **values: Any) -> None:
        """Replace the op's operands on the stack by its result."""
        values = self._of_frame(op) | values
        count = op.arity(values, len(self.stack))
        operands = self.stack[len(self.stack) - count :]
        log.info("%s on %s", op.flag(), ", ".join(image.source for image in operands) or "nothing")
        with self.session.resources.stats.time(op.flag()):
            bound = op(**self._bound(op, operands, values))
            if not op.deep:
                require_flat(bound.operands())
            self.inputs |= {image.source for image in bound.operands()} | set(map(str, bound.paths_read()))
            images = self.images_of(bound)
        del self.stack[len(self.stack) - count :]
        for image in (self._entitled(op, operands, image) for image in images):
            self.push(_with_metadata_of(bound.operands(), image) if self.settings.get("--metamerge") else image)
        self.user |= bound.user_variables()
        self._rename(bound.renamed())
        self.unwritten = True

    def _rename(self, names: dict[str, str]) -> None:
        """Transfer the types of `-d CHANNEL=TYPE` to new names of channels."""
        if names:
            types = self.settings.get("-d channels", {})
            self.settings["-d channels"] = types | {new: types.get(old) for new, old in names.items()}

    def _entitled(self, op: type[Op], operands: list[Image], image: Image) -> Image:
        """The image with its title; computed now if too many ops depend on each other's pixels."""
        before = max((part.depth for operand in operands for part in operand.parts), default=-1)
        title = title_of(op, operands, image)
        parts = [dataclasses.replace(part, depth=before + 1, title=title) for part in image.parts]
        if before + 1 >= _DEEPEST and not self.dry:
            parts = [dataclasses.replace(materialized(part, self.session.resources.budget), depth=0) for part in parts]
        return Image(tuple(parts), image.source)

    def images_of(self, op: Op) -> Sequence[Image]:
        """The images that an op computes; writes its files, prints its lines and reports exceeded limits."""
        beside = next(self.written_next, "")
        with self.session.resources.keeping(beside) if beside else contextlib.nullcontext():
            uses = run(op, self.session, self.written, not self.settings.get("--nosoftwareattrib"))
        for text in (text for use in uses for text in use.failed):
            log.error("oiiotex FAIL: %s : %s", op.flag(), text)
            self.status = _BEYOND_A_LIMIT
        return [use.image for use in uses]

    def needs_pixels(self) -> None:
        """Called before an option reads pixels that later steps depend on; ends a rehearsal."""

    def acts(self, *parts: Part) -> bool:
        """Whether to print or write now: False in a rehearsal, which notes the step.

        `parts`: those whose pixels are needed; raises as `Resources.require_streamable` does.
        """
        self.session.resources.require_streamable(*parts)
        self.used, self.unwritten = True, False
        return True

    def note(self, level: int, text: str) -> None:
        """Log that something is skipped; in a rehearsal only if the step never runs."""
        log.log(level, "%s", text)

    def set_global(self, name: str, kind: oiio.TypeDesc, value: object, before: object) -> None:
        """Set an attribute of OpenImageIO; `before` is its former value."""
        oiio.attribute(name, kind, value)

    def tell(self, text: str) -> None:
        """Print a line if -v is set."""
        if self.settings.get("-v"):
            print(text, flush=True)

    def will_write(self, image: Image, path: str, how: Format) -> None:
        """Called before a file is written; in a rehearsal it checks that writing is possible."""

    def opened(self, path: str, native: bool = False, config: oiio.ImageSpec | None = None) -> Image:
        """The image of a file, with its pixels as stored."""
        return read(path, self.session.resources.cache, native=native, turned=False, config=config)

    def require_free(self, path: str) -> None:
        """Refuse a name that an op has just written."""
        if os.path.realpath(path) in self.written:
            raise ParameterError(f"{path} would overwrite a file written by an earlier op; use another name")

    def changed(self, path: str) -> float:
        """The time of a file's last change in seconds; 0 if it does not exist."""
        return os.path.getmtime(path) if os.path.exists(path) else 0.0

    def has_file(self, path: str) -> bool:
        """Whether a file exists."""
        return os.path.exists(path)

    def _of_frame(self, op: type[Op]) -> dict[str, Any]:
        """The frame number, by the op's parameters that take it."""
        number = self.frame.number if self.frame else None
        return {p.attribute: number for p in op.parameters() if p.frame and number is not None}

    def image(self, index: int) -> Image:
        """The image at that depth, 0 the top."""
        if not 0 <= index < len(self.stack):
            raise ParameterError(f"no image {index} on the stack, which has {len(self.stack)}")
        return self.stack[-1 - index]

    def _bound(self, op: type[Op], operands: list[Image], values: dict[str, Any]) -> dict[str, Any]:
        """The values and the operands, which are, from the bottom up: images as of `Op.with_images`, optional ones."""
        asked = {p: value for p in op.optional_images() if (value := values.get(p.attribute)) is not None}
        count = len(operands) - sum(value is True for value in asked.values())
        waiting = iter(operands[count:])
        optional = {
            parameter.attribute: next(waiting) if value is True else self._named(parameter, value, operands)
            for parameter, value in asked.items()
        }
        return op.with_images(operands[:count], values) | optional

    def _named(self, parameter: Parameter, name: str, operands: list[Image]) -> Image:
        """The part of the first operand of that name, else the file."""
        part = operands[0].part(name) if operands else None
        if part is not None:
            return Image((part,), name)
        if self.has_file(name):
            return self.opened(name)
        parts = ", ".join(part.name for part in operands[0].parts) if operands else ""
        has = f"the image has {parts}" if parts else "no image is given"
        problem = f"neither a part ({has}) nor a file"
        raise ParameterError(problem, parameter=parameter.name, value=name, expected=parameter.expected)


def require_flat(images: Iterable[Image]) -> None:
    """Raise an ImageError if an image has a deep part."""
    for image in images:
        if any(part.spec.deep for part in image.parts):
            raise ImageError(f"{image.title} is deep: expected a flat image; add --flatten before this step")


def _with_metadata_of(operands: list[Image], result: Image) -> Image:
    """The result with the operands' metadata that it lacks (--metamerge)."""

    def merge(spec: oiio.ImageSpec) -> None:
        for operand in operands:
            for attribute in operand.first.spec.extra_attribs:
                if spec.getattribute(attribute.name) is None:
                    spec.attribute(attribute.name, attribute.type, attribute.value)

    return Image(tuple(part.respecced(merge) for part in result.parts), result.source)
