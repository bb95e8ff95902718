# SPDX-License-Identifier: Apache-2.0
"""The contract of an op: name, inputs, parameters, named outputs, access kind, working space.

One type serves our filters and the host's own ops alike. An op is a frozen keyword-only dataclass; an instance is one
use of it, with its images and checked values.
"""

from __future__ import annotations

import contextlib
import enum
import logging
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

from ..errors import Error, ParameterError, modifier
from .attributes import FILTER, PARAMETERS
from .parameters import Parameter, declared
from .upright import upright

if TYPE_CHECKING:
    from ..session import Session
    from ..session.facts import Facts
    from .window import Window

log = logging.getLogger("oiiotex")


class Space(enum.Enum):
    """The working space of an op."""

    LAB = "CIE Lab D65"
    DATA = "data scaled to 0 to 100"
    ANY = "the image's own color space"


class Kind(enum.Enum):
    """The kind of an output, which determines its pixel type, color tag and destination (`run.run`)."""

    PIXELS = "pixels"
    IDS = "32-bit ids"
    MASK = "0 or 1, 32-bit floats"
    COORDINATES = "32-bit float coordinates"
    MEASURE = "32-bit float values"
    CRYPTOMATTE = "Cryptomatte 1.2"
    PICTURE = "8-bit sRGB picture"
    TABLE = "JSON"
    ARRAYS = ".npz"
    PAINTS = ".gpl or .aco"
    MESH = ".obj"

    @property
    def is_exact(self) -> bool:
        """Whether its values must never be converted or filtered."""
        return self in (Kind.IDS, Kind.COORDINATES)

    @property
    def is_image(self) -> bool:
        """Whether it can be a part of an image."""
        return self not in (Kind.TABLE, Kind.ARRAYS, Kind.PAINTS, Kind.MESH)


@dataclass(frozen=True)
class Output:
    """A named output.

    Attributes
    ----------
    name : str
        A name ending in `.N` stands for several outputs: `label.1`, `label.2`, ...
    kind : Kind
    help : str
    asked_by : str
        The parameter that requests it: 1 adds it to the image as a part, a file name writes it there (for Cryptomatte,
        only the manifest). Empty: the output is always made.
    of : str
        The input image of which it is the unchanged first part, before all other outputs.
    instead : bool
        Whether it replaces the op's image if requested.
    judged_by : str
        Of a table: the parameter with limits for it, which also requests it. Its `failed` lists exceeded limits.
    lines : callable or None
        Of a table: a function of its facts that returns the lines to print, with or without a file.
    """

    name: str
    kind: Kind
    help: str
    asked_by: str = ""
    of: str = ""
    instead: bool = False
    judged_by: str = ""
    lines: Callable[[Any], Iterable[str]] | None = None

    @property
    def text(self) -> str:
        """Its help, kind, and the parameter that requests it."""
        return f"{self.help} [{self.kind.value}{f'; with {self.asked_by}' if self.asked_by else ''}]"


def no_pixels(window: Window | None = None) -> NoReturn:
    """The `fetch` of parts that are only planned."""
    raise AssertionError(f"{window} is read before the work")


@dataclass(frozen=True)
class Plan:
    """What is known of one use of an op before its work.

    Attributes
    ----------
    results : optional
        Its outputs, as `Op.make` returns them, if they lack nothing but pixels. None: windows, channels or number of
        its images depend on pixels, so that only their declared kinds are known.
    work
        Values that `Op.make` works with, decided without pixels.
    """

    results: Any = None
    work: Any = None


@contextlib.contextmanager
def errors_of(op: type[Op]) -> Iterator[None]:
    """Errors raised in this block name the op, unless they already name one."""
    try:
        yield
    except Error as error:
        error.op = error.op or op.name
        raise


@dataclass(frozen=True, kw_only=True)
class Op:
    """Base of all ops. An op has an access kind (core/access.py), and declares `name`, `space` and `outputs`.

    On the command line our filters are `--tex` + name; ops of the host have no prefix.

    A subclass without `name` is a common base of several ops.
    """

    prefix: ClassVar[str] = "--tex"
    aliases: ClassVar[tuple[str, ...]] = ()  # further names on the command line
    turns: ClassVar[bool] = True  # its images are turned upright, as their Orientation says
    copies: ClassVar[bool] = False  # every pixel of its result is a complete copy of a source pixel
    rescales: ClassVar[bool] = False  # its result has another pixel size than its source
    blends: ClassVar[bool] = False  # it averages all channels, which ids of Cryptomatte do not survive
    example: ClassVar[str] = ""  # doctest code for its docstring; default: a call on one photo
    deep: ClassVar[bool] = False  # it accepts deep images
    carries: ClassVar[bool] = False  # further parts of its first image are appended to its result
    PAPER: ClassVar[dict[str, Any]] = {}  # values of other parameters that its parameter `paper` sets
    name: ClassVar[str]
    scans: ClassVar[bool] = False  # it reads all pixels of its images, for any window of the result
    reach: ClassVar[str]  # which pixels it reads, for help; set by the access kind
    space: ClassVar[Space]
    outputs: ClassVar[tuple[Output, ...]]

    def __init_subclass__(cls) -> None:
        if "name" not in cls.__dict__:
            return
        missing = [fact for fact in ("space", "outputs") if not hasattr(cls, fact)]
        if missing:
            raise TypeError(f"{cls.__name__} does not declare {', '.join(missing)}")
        if not hasattr(cls, "reach") or "reach" in cls.__dict__:
            raise TypeError(f"{cls.__name__} must have one access kind: Pointwise, ScanThenMap, Gather, Whole, ...")
        fields = {name for base in cls.__mro__ if base is not Op for name in vars(base).get("__annotations__", ())}
        methods = {name for name, one in vars(Op).items() if isinstance(one, (FunctionType, classmethod, property))}
        for name in sorted(fields & methods):
            raise TypeError(f"{cls.__name__}.{name} would hide a method of its base class: use another name")

    def __post_init__(self) -> None:
        with errors_of(type(self)):
            for parameter in self.parameters():
                value = parameter.check(getattr(self, parameter.attribute))
                object.__setattr__(self, parameter.attribute, value)
            if self.PAPER and self.values()["paper"]:
                self._follow_the_paper()
            if self.turns:
                self.change_images(upright)

    def change_images(self, change: Callable[[Any], Any]) -> None:
        """Replace all given images."""
        for slot in declared(type(self))[0]:
            given = getattr(self, slot.attribute)
            changed = tuple(map(change, given)) if isinstance(given, tuple) else given and change(given)
            object.__setattr__(self, slot.attribute, changed)

    def _follow_the_paper(self) -> None:
        """Set parameters to the values of `PAPER`; raise ParameterError if another value was given."""
        for parameter in self.parameters():
            if parameter.attribute in self.PAPER:
                given, value = getattr(self, parameter.attribute), self.PAPER[parameter.attribute]
                if given not in (parameter.default, value):
                    name = parameter.name
                    expected = f"no {name}" if value is None else modifier(**{name: value})
                    with_paper = f"conflicts with {modifier(paper=True)}"
                    raise ParameterError(with_paper, parameter=name, value=given, expected=expected)
                object.__setattr__(self, parameter.attribute, value)

    @classmethod
    def images(cls) -> tuple[Parameter, ...]:
        """The declared input images that are required."""
        return tuple(i for i in declared(cls)[0] if i.required)

    @classmethod
    def taken(cls, values: dict[str, Any]) -> tuple[Parameter, ...]:
        """The images of `images` that it takes with these values; the others are None."""
        return cls.images()

    @classmethod
    def optional_images(cls) -> tuple[Parameter, ...]:
        """The declared input images that are optional."""
        return tuple(i for i in declared(cls)[0] if not (i.required or i.many))

    @classmethod
    def further_images(cls) -> Parameter | None:
        """The declared input that holds the images after the first, or None. The parameter `count` lists all."""
        return next((i for i in declared(cls)[0] if i.count), None)

    @classmethod
    def further_count(cls, values: dict[str, Any]) -> int:
        """Number of images after the first."""
        further = cls.further_images()
        return 0 if further is None else len(values.get(further.count) or (None,)) - 1

    @classmethod
    def with_images(cls, images: Sequence[Any], values: dict[str, Any]) -> dict[str, Any]:
        """Its fields: values, and images that are not optional: the first, the further ones, then the other ones."""
        slots, further = cls.images(), cls.further_images()
        if len(slots) == 1 and slots[0].many:
            return values | {slots[0].attribute: tuple(images)}
        count = 1 + cls.further_count(values)
        fields: dict[str, Any] = values | dict.fromkeys(slot.attribute for slot in slots)
        if further is not None:
            fields[further.attribute] = tuple(images[1:count])
        taken = (slot.attribute for slot in cls.taken(values))
        return fields | dict(zip(taken, (*images[:1], *images[count:]), strict=True))

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The declared parameters."""
        return declared(cls)[1]

    @classmethod
    def flag(cls) -> str:
        """The option's name on the command line."""
        return f"{cls.prefix}{cls.name}"

    @classmethod
    def inform(cls, text: str, *values: object) -> None:
        """Log a line with its name; text and values as for `logging`."""
        log.info(f"%s: {text}", cls.flag(), *values)

    @classmethod
    def warn(cls, text: str, *values: object) -> None:
        """Log a warning with its name."""
        log.warning(f"%s: {text}", cls.flag(), *values)

    def used_parts(self) -> tuple[Any, ...]:
        """Parts that it uses: by default those of optional images, which may be parts of the first one."""
        return tuple(part for slot, one in self.given() if not slot.required for part in one.parts)

    def say_what_stays(self, made: Collection[str]) -> None:
        """Warn about further parts of its first images that it neither uses nor has in a result of one of those names.

        A picture of an image, or a measure of it, is not expected to have them.
        """
        if self.main().kind is not Kind.PIXELS:
            return
        used = set(map(id, self.used_parts()))
        for image in (one for slot, one in self.given() if slot is self.images()[0]):
            lost = [part.name for part in image.parts[1:] if id(part) not in used and part.name not in made]
            if lost:
                self.warn("%s: further parts are not in the result: %s", image.source, ", ".join(lost))

    @classmethod
    def arguments(cls) -> tuple[Parameter, ...]:
        """The positional parameters, which follow the op."""
        return tuple(p for p in cls.parameters() if p.positional)

    @classmethod
    def modifiers(cls) -> tuple[Parameter, ...]:
        """The parameters that are modifiers: `--op:name=value`."""
        return (*cls.optional_images(), *(p for p in cls.parameters() if not p.positional))

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """Number of images that it takes from a stack of that depth; if more, it waits for them."""
        return (
            len(cls.taken(values))
            + cls.further_count(values)
            + sum(values.get(i.attribute) is True for i in cls.optional_images())
        )

    @property
    def working_space(self) -> Space:
        """The working space of this use: the declared one, or data instead of Lab with its parameter `data`."""
        return Space.DATA if self.space is Space.LAB and self.values().get("data") else self.space

    def renamed(self) -> dict[str, str]:
        """Renamed channels: new name -> old name."""
        return {}

    def carried(self) -> tuple[Any, ...]:
        """The further parts of its first image, if they are appended to its result."""
        return getattr(self, self.images()[0].attribute).parts[1:] if self.carries else ()

    def given(self) -> Iterator[tuple[Parameter, Any]]:
        """The images of this use, each with its declared input."""
        for slot in declared(type(self))[0]:
            value = getattr(self, slot.attribute)
            yield from ((slot, one) for one in (value if isinstance(value, tuple) else (value,)) if one is not None)

    def values(self) -> dict[str, Any]:
        """This use's parameter values by name."""
        return {p.name: getattr(self, p.attribute) for p in self.parameters()}

    def provenance(self) -> dict[str, Any]:
        """Metadata about how the image was made."""
        given = {name: value for name, value in self.values().items() if value is not None}
        given |= {slot.name: image.source for slot, image in self.given() if slot in self.optional_images()}
        words = ":".join(f"{name}={int(v) if isinstance(v, bool) else v}" for name, v in given.items())
        facts = {FILTER: self.name, PARAMETERS: words}
        return facts | ({"oiiotex:seed": given["seed"]} if "seed" in given else {})

    @classmethod
    def output(cls, name: str) -> Output:
        """The declared output of that name.

        Raises
        ------
        KeyError
            No output has that name.
        """
        declared = {o.name: o for o in cls.outputs}
        return declared.get(name) or declared[re.sub(r"\.[0-9]+$", ".N", name)]

    @classmethod
    def main(cls) -> Output:
        """The declared output that is the op's image."""
        return next(o for o in cls.outputs if not (o.of or o.asked_by))

    def asked(self, output: Output) -> bool | Path:
        """Whether an output is requested; the file name if it goes to a file."""
        value = getattr(self, output.asked_by) if output.asked_by else True
        return value if isinstance(value, Path) else bool(value)

    def judges(self, output: Output) -> bool:
        """Whether an output is checked against limits."""
        return bool(output.judged_by) and getattr(self, output.judged_by) is not None

    def files(self) -> dict[str, Path]:
        """The files written in addition to the image, by output."""
        asked = ((output.name, self.asked(output)) for output in self.outputs)
        return {name: path for name, path in asked if isinstance(path, Path)}

    def operands(self) -> list[Any]:
        """The images of this use, in the order of declaration."""
        return [image for _, image in self.given()]

    def scanned(self) -> list[Any]:
        """The parts of which it reads all pixels."""
        return [image.first for image in self.operands()] if self.scans else []

    def paths_read(self) -> list[Path]:
        """The files that it reads in addition to its images."""
        asking = {output.asked_by for output in self.outputs}
        values = (getattr(self, p.attribute) for p in self.parameters() if p.attribute not in asking)
        return [value for value in values if isinstance(value, Path)]

    def user_variables(self) -> dict[str, int | float | str]:
        """User variables that the op sets for expressions that follow."""
        return {}

    def result_count(self) -> int:
        """Number of images that this use makes."""
        return 1

    def plan(self, facts: Facts) -> Plan:
        """What is known of this use from its values and the specs of its images; never reads a pixel.

        Called before any work, for a command line that may never run: raise errors here. It may be called again.
        """
        return Plan()

    def make(self, plan: Plan, session: Session) -> Any:
        """The outputs by name; a tuple of such mappings if it makes several images. `plan`: from `plan`.

        Outputs are: for an image, an `image.Part`, which may be computed when it is read; for a picture, (height,
        width, 3) sRGB values, 8-bit or floats in 0 .. 1, or an 8-bit part; for a table, values that JSON can hold; for
        arrays, a dict by name; for paints, a list of
        `io.paint_palette.Paint`; for a mesh, its text; for Cryptomatte, its label maps. An output may also be a
        callable without arguments, which is called if the output is requested. An `image.Image` alone is the op's
        image with all its parts.
        """
        return plan.results
