# SPDX-License-Identifier: Apache-2.0
"""The image stack: does the steps of a command line one after the other."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import OpenImageIO as oiio

from .. import filters
from ..errors import Error, ParameterError
from ..files import read
from ..host.kinds import HostOp
from ..images import Image, type_named
from ..op import Op
from ..params import Parameter
from ..session import Session
from .access import ChainAccess
from .expressions import Expressions
from .parse import Step, split_modifiers, values_of
from .sequences import Frame

log = logging.getLogger("oiiotex")


class StepError(Error):
    """An error together with the step that raised it."""

    def __init__(self, step: Step, cause: Error):
        super().__init__(f"{step.name} : {cause}" if step.word.startswith("-") else str(cause))


@dataclass
class First:
    """What the first image read says of how computed images are written."""

    spec: oiio.ImageSpec | None = None
    pixel_type: oiio.TypeDesc | None = None
    channel_types: dict[str, oiio.TypeDesc] = field(default_factory=dict)
    bits: int = 0
    tile: tuple[int, int] | None = None

    def learn(self, image: Image) -> None:
        """Take in an image that has been read: its type, where it has a wider one than those before."""
        for part in image.parts:
            self.spec = self.spec or part.spec
            own = part.spec.format
            merged = own if self.pixel_type is None else _merged(self.pixel_type, own)
            self.pixel_type = merged
            self.bits = self.bits or part.spec.get_int_attribute("oiio:BitsPerSample")
            if part.spec.tile_width:
                self.tile = self.tile or (part.spec.tile_width, part.spec.tile_height)
            prefix = part.spec.get_string_attribute("oiio:subimagename")
            if prefix:
                self.channel_types.setdefault(f"{prefix}.*", own)
            for channel, name in enumerate(part.spec.channelnames):
                key = f"{prefix}.{name}" if prefix else name
                self.channel_types.setdefault(key, part.spec.channelformat(channel))


def _merged(a: oiio.TypeDesc, b: oiio.TypeDesc) -> oiio.TypeDesc:
    """The type that holds the values of both, as oiiotool merges them."""
    order = ("uint8", "int8", "uint16", "int16", "half", "uint", "int", "float", "double")
    low, high = sorted((str(a), str(b)), key=order.index)
    if low in ("int8", "int16") and high in ("uint16", "half") and low != high:
        return oiio.TypeDesc("float") if high == "half" else oiio.TypeDesc("int")
    if low in ("uint16", "int16") and high == "half":
        return oiio.TypeDesc("float")
    return type_named(high)


class Chain:
    """A stack of images, what is set for what follows, and what waits.

    Attributes
    ----------
    session : Session
    stack : list of Image
        The last is the top.
    labelled : dict of str to Image
        By the names of --label.
    user : dict
        The user's variables, for expressions.
    first : First
    read_input : callable
        What is done with a file's name.
    inputs : list of str
        The files that were read.
    settings : dict
        What options have set for later ones, by the option's name.
    status : int
        Exit code of the run so far.
    position : int
        The step that comes next; control flow moves it.
    skipping : bool
        Steps are passed over: the condition around them does not hold.
    loops : list
        The open --if, --while and --for.
    unwritten, used : bool
        An image has been made and not written; something was written or printed.
    """

    def __init__(self, session: Session, read_input: Callable[[Chain, str], None], frame: Frame | None = None):
        self.read_input = read_input
        self.session = session
        self.frame = frame
        self.inputs: list[str] = []
        self.stack: list[Image] = []
        self.labelled: dict[str, Image] = {}
        self.user: dict[str, int | float | str] = {}
        self.first = First()
        self.settings: dict[str, Any] = {}
        self.status = 0
        self.evaluating = True
        self.position = 0
        self.skipping = False
        self.loops: list[Any] = []
        self.unwritten = False
        self.used = False
        self._waiting: list[tuple[Step, tuple[str, ...], dict[str, Any]]] = []
        self._expressions = Expressions(ChainAccess(self))

    # --- the stack ---

    @property
    def top(self) -> Image:
        """The current image."""
        if not self.stack:
            raise ParameterError("there is no image to work on")
        return self.stack[-1]

    def push(self, image: Image) -> None:
        """Put an image on the stack."""
        self.stack.append(image)

    def pop(self) -> Image:
        """Take the top image."""
        image = self.top
        self.stack.pop()
        return image

    # --- running ---

    def run(self, steps: tuple[Step, ...]) -> None:
        """Do all steps.

        Raises
        ------
        StepError
            One failed; its text names it.
        """
        self.position = 0
        while self.position < len(steps):
            step = steps[self.position]
            self.position += 1
            if self.skipping and not (step.option and step.option.control):
                continue
            try:
                self._do(step)
            except Error as error:
                failed = error if isinstance(error, StepError) else StepError(step, error)
                if not self.settings.get("--no-error-exit"):
                    raise failed from error
                log.error("oiiotex ERROR: %s", failed)
        self._nothing_waits()
        if self.loops:
            raise ParameterError(f"{self.loops[-1].name} has no end")
        if self.unwritten and not self.used:
            log.warning("nothing was written: did you forget -o?")

    def _do(self, step: Step) -> None:
        word = self.expressed(step.word) if not (self.skipping and step.option) else step.word
        if step.op is None and step.option is None:
            self.read_input(self, word)
            return self._run_waiting()
        texts = step.arguments if step.option and step.option.control else tuple(map(self.expressed, step.arguments))
        values = values_of(step, split_modifiers(word)[1])
        if step.op is not None:
            _require_utf8(word, *texts)
            values |= {p.name: p.parse(text) for p, text in zip(step.op.arguments(), texts, strict=True)}
            self._waiting.append((step, (), values))
            return self._run_waiting()
        option = step.option
        assert option is not None and option.run is not None
        if option.needs > len(self.stack):
            self._waiting.append((step, texts, values))
            return None
        if not (option.state or option.control or option.name == "-i"):
            self._nothing_waits()
        option.run(self, *texts, **values)
        return self._run_waiting()

    def expressed(self, text: str) -> str:
        """The text with its expressions evaluated."""
        return self._expressions.substitute(text) if self.evaluating and "{" in text else text

    def _nothing_waits(self) -> None:
        """Refuse to go on past an op that still lacks operands: what follows would happen to the wrong image."""
        if self._waiting:
            step, _, values = self._waiting[0]
            need = self._need(step, values)
            raise StepError(step, ParameterError(f"takes {need} image(s), there are {len(self.stack)}"))

    def _need(self, step: Step, values: dict[str, Any]) -> int:
        if step.op is not None:
            return step.op.arity(values, len(self.stack))
        assert step.option is not None
        return step.option.needs

    def _run_waiting(self) -> None:
        while self._waiting and len(self.stack) >= self._need(self._waiting[0][0], self._waiting[0][2]):
            step, texts, values = self._waiting.pop(0)
            try:
                if step.op is not None:
                    self.apply(step.op, **values)
                else:
                    assert step.option is not None and step.option.run is not None
                    step.option.run(self, *texts, **values)
            except Error as error:
                raise error if isinstance(error, StepError) else StepError(step, error) from error

    def apply(self, op: type[Op], **values: Any) -> None:
        """Replace the op's operands on the stack by its result."""
        values = self._of_frame(op) | values
        count = op.arity(values, len(self.stack))
        operands = self.stack[len(self.stack) - count :]
        log.info("%s on %s", op.flag(), ", ".join(image.source for image in operands) or "nothing")
        with self.session.stats.time(op.flag()):
            bound = op(**_bound(op, operands, values, self.session))
            made = bound.compute(self.session) if isinstance(bound, HostOp) else filters.result(bound, self.session)
        del self.stack[len(self.stack) - count :]
        for result in made if isinstance(made, tuple) else (made,):
            self.push(_with_metadata_of(operands, result) if self.settings.get("--metamerge") else result)
        self.user |= bound.facts() if isinstance(bound, HostOp) else {}
        self.unwritten = True

    def _of_frame(self, op: type[Op]) -> dict[str, Any]:
        """The frame's number for the op's parameters that are the number of a frame."""
        number = self.frame.number if self.frame else None
        return {p.attribute: number for p in op.parameters() if p.frame and number is not None}

    def image(self, index: int) -> Image:
        """The image at that depth, 0 the top."""
        if not 0 <= index < len(self.stack):
            raise ParameterError(f"there is no image {index}: the stack holds {len(self.stack)}")
        return self.stack[-1 - index]


def _require_utf8(*texts: str) -> None:
    """Refuse what OpenImageIO's Python edge cannot take."""
    for text in texts:
        try:
            text.encode()
        except UnicodeEncodeError:
            shown = text.encode(errors="surrogateescape").decode(errors="backslashreplace")
            raise ParameterError(f"'{shown}' is not UTF-8") from None


def _with_metadata_of(operands: list[Image], result: Image) -> Image:
    """The result, with what else is in the metadata of the operands (--metamerge)."""

    def merge(spec: oiio.ImageSpec) -> None:
        for operand in operands:
            for attribute in operand.first.spec.extra_attribs:
                if spec.getattribute(attribute.name) is None:
                    spec.attribute(attribute.name, attribute.type, attribute.value)

    return Image(tuple(part.respecced(merge) for part in result.parts), result.source)


def _bound(op: type[Op], operands: list[Image], values: dict[str, Any], session: Session) -> dict[str, Any]:
    """The values, with the operands by the names under which the op declares them.

    From the bottom up: what it always takes, those behind the first that a count asks for, then each image that a
    modifier asks for.
    """
    declared = op.images()
    if len(declared) == 1 and declared[0].many:
        return {declared[0].name: tuple(operands), **values}
    waiting = iter(operands)
    taken = op.taken(values)
    bound = values | {parameter.name: next(waiting) if parameter in taken else None for parameter in declared}
    further = op.further_images()
    if further is not None:
        bound[further.attribute] = tuple(next(waiting) for _ in range((values.get(further.count) or 1) - 1))
    for parameter in op.optional_images():
        asked = values.get(parameter.attribute)
        if asked is not None:
            bound[parameter.attribute] = next(waiting) if asked is True else _named(parameter, asked, operands, session)
    return bound


def _named(parameter: Parameter, name: str, operands: list[Image], session: Session) -> Image:
    """The part of the first operand of that name, else the file.

    Raises
    ------
    ParameterError
        There is neither.
    """
    part = operands[0].part(name) if operands else None
    if part is not None:
        return Image((part,), name)
    if os.path.exists(name):
        return read(name, session.cache)
    parts = ", ".join(part.name for part in operands[0].parts) if operands else ""
    has = f"the image has {parts}" if parts else "there is no image"
    raise ParameterError(
        f"{parameter.name}={name}: neither a part ({has}) nor a file; allowed is {parameter.allowed()}"
    )
