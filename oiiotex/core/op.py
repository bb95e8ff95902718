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
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..errors import Error, ParameterError, modifier
from .parameters import Parameter, declared

if TYPE_CHECKING:
    from ..session import Session

log = logging.getLogger("oiiotex")


class Space(enum.Enum):
    """Where an op works."""

    LAB = "CIE Lab D65"
    DATA = "data, whose range is 0 to 100"
    ANY = "whatever the channels hold"


class Kind(enum.Enum):
    """What an output is: its pixel type, its color tag and how it leaves follow from it (`run.run`)."""

    PIXELS = "pixels"
    IDS = "32-bit ids"
    MASK = "0 or 1, 32-bit floats"
    COORDINATES = "32-bit float coordinates"
    MEASURE = "32-bit float values"
    CRYPTOMATTE = "Cryptomatte 1.2"
    PICTURE = "8-bit sRGB picture"
    TABLE = "JSON"
    ARRAYS = ".npz"
    MOVIE = "GIF or MP4"
    PAINTS = ".gpl or .aco"
    MESH = ".obj"

    @property
    def is_data(self) -> bool:
        """Whether its values are no colors, whatever the image was."""
        return self in (Kind.IDS, Kind.MASK, Kind.COORDINATES, Kind.MEASURE, Kind.CRYPTOMATTE)

    @property
    def is_exact(self) -> bool:
        """Whether another value is another meaning: it is never converted or filtered."""
        return self in (Kind.IDS, Kind.COORDINATES)

    @property
    def is_image(self) -> bool:
        """Whether it can be a part of an image."""
        return self not in (Kind.TABLE, Kind.ARRAYS, Kind.MOVIE, Kind.PAINTS, Kind.MESH)


@dataclass(frozen=True)
class Output:
    """A named output.

    Attributes
    ----------
    name : str
        One that ends in `.N` stands for several: `label.1`, `label.2`, ...
    kind : Kind
    help : str
    asked_by : str
        The parameter that asks for it: 1 makes it a part of the image, a file's name puts it there (of Cryptomatte
        only the manifest). Where it is empty the output is always made.
    of : str
        The input image whose first part it is, untouched, before all that is made.
    instead : bool
        Where it is asked for, it is made instead of the op's image, not beside it.
    judged_by : str
        Of a table: the parameter that holds it to limits. It is made for that, too; its `failed` says what is beyond.
    lines : callable or None
        Of a table: its facts -> what is printed of them for people, whether a file was asked for or not.
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
        """What it is and what asks for it, for people."""
        return f"{self.help} [{self.kind.value}{f'; with {self.asked_by}' if self.asked_by else ''}]"


@contextlib.contextmanager
def errors_of(op: type[Op]) -> Iterator[None]:
    """Errors that leave this block name the op, unless they name one already."""
    try:
        yield
    except Error as error:
        error.op = error.op or op.name
        raise


@dataclass(frozen=True, kw_only=True)
class Op:
    """Base of all ops. An op is of an access kind (core/access.py), and must say `name`, `space` and `outputs`.

    On the command line a filter of ours is `--tex` + name; the host's ops have no prefix.

    A subclass that has no `name` is not an op but a common ground of several.
    """

    prefix: ClassVar[str] = "--tex"
    aliases: ClassVar[tuple[str, ...]] = ()  # further names on the command line
    copies: ClassVar[bool] = False  # it promises that every pixel of its result is one of its source, whole
    rescales: ClassVar[bool] = False  # a pixel of its result is not as large as one of its source
    example: ClassVar[str] = ""  # Python as doctest takes it, for its docstring; default: a call on one photo
    deep: ClassVar[bool] = False  # it takes deep images; else they are refused
    carries: ClassVar[bool] = False  # the further parts of its first image follow what it makes
    PAPER: ClassVar[dict[str, Any]] = {}  # what its parameter `paper` stands for, if it has one: values of others
    name: ClassVar[str]
    scans: ClassVar[bool] = False  # it looks at all pixels of its images, whatever is wanted of the result
    reach: ClassVar[str]  # how it looks at pixels, for people: of its kind, which says it for all
    space: ClassVar[Space]
    outputs: ClassVar[tuple[Output, ...]]

    def __init_subclass__(cls) -> None:
        if "name" not in cls.__dict__:
            return
        missing = [fact for fact in ("space", "outputs") if not hasattr(cls, fact)]
        if missing:
            raise TypeError(f"{cls.__name__} does not declare {', '.join(missing)}")
        if not hasattr(cls, "reach") or "reach" in cls.__dict__:
            raise TypeError(f"{cls.__name__} must be of one access kind: Pointwise, ScanThenMap, Gather, Whole, ...")

    def __post_init__(self) -> None:
        with errors_of(type(self)):
            for parameter in self.parameters():
                value = parameter.check(getattr(self, parameter.attribute))
                object.__setattr__(self, parameter.attribute, value)
            if self.PAPER and self.values()["paper"]:
                self._follow_the_paper()

    def _follow_the_paper(self) -> None:
        """Parameters get the values of `PAPER`, unless another one than the default was given."""
        for parameter in self.parameters():
            if parameter.attribute in self.PAPER:
                given, value = getattr(self, parameter.attribute), self.PAPER[parameter.attribute]
                if given not in (parameter.default, value):
                    name = parameter.name
                    says = f"leaves {name} out" if value is None else f"says {modifier(**{name: value})}"
                    raise ParameterError(f"{modifier(paper=True)} {says}", parameter=name, value=given)
                object.__setattr__(self, parameter.attribute, value)

    @classmethod
    def images(cls) -> tuple[Parameter, ...]:
        """The declared input images that it always takes."""
        return tuple(i for i in declared(cls)[0] if i.required)

    @classmethod
    def taken(cls, values: dict[str, Any]) -> tuple[Parameter, ...]:
        """Those of `images` that it takes with these values; the others are None."""
        return cls.images()

    @classmethod
    def optional_images(cls) -> tuple[Parameter, ...]:
        """The declared input images that it takes where they are asked for."""
        return tuple(i for i in declared(cls)[0] if not (i.required or i.many))

    @classmethod
    def further_images(cls) -> Parameter | None:
        """The declared input that holds the images behind the first, as many as its `count` says, or None."""
        return next((i for i in declared(cls)[0] if i.count), None)

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
        """Log a line under its name; the text as `logging` takes it, with its values."""
        log.info(f"%s: {text}", cls.flag(), *values)

    @classmethod
    def warn(cls, text: str, *values: object) -> None:
        """The same as a warning."""
        log.warning(f"%s: {text}", cls.flag(), *values)

    @classmethod
    def arguments(cls) -> tuple[Parameter, ...]:
        """The parameters that are words of their own behind the op."""
        return tuple(p for p in cls.parameters() if p.positional)

    @classmethod
    def modifiers(cls) -> tuple[Parameter, ...]:
        """What may be said as a modifier: `--op:name=value`."""
        return (*cls.optional_images(), *(p for p in cls.parameters() if not p.positional))

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """How many images it takes from a stack of that depth; more than the depth: it waits for them."""
        further = cls.further_images()
        more = 0 if further is None else (values.get(further.count) or 1) - 1
        return len(cls.taken(values)) + more + sum(values.get(i.attribute) is True for i in cls.optional_images())

    @property
    def working_space(self) -> Space:
        """Where this use sees images: in what the op declares; of Lab, with its parameter `data`, as data."""
        return Space.DATA if self.space is Space.LAB and self.values().get("data") else self.space

    def renamed(self) -> dict[str, str]:
        """Channels that it has renamed: the old name by the new one."""
        return {}

    def carried(self) -> tuple[Any, ...]:
        """The further parts of its first image, where these follow what it makes."""
        return getattr(self, self.images()[0].attribute).parts[1:] if self.carries else ()

    def given(self) -> Iterator[tuple[Parameter, Any]]:
        """The images of this use, each with the input that it is for."""
        for slot in declared(type(self))[0]:
            value = getattr(self, slot.attribute)
            yield from ((slot, one) for one in (value if isinstance(value, tuple) else (value,)) if one is not None)

    def values(self) -> dict[str, Any]:
        """This use's parameter values by name."""
        return {p.name: getattr(self, p.attribute) for p in self.parameters()}

    def provenance(self) -> dict[str, Any]:
        """What a file should say of how it was made, as metadata."""
        given = {name: value for name, value in self.values().items() if value is not None}
        given |= {slot.name: image.source for slot, image in self.given() if slot in self.optional_images()}
        words = ":".join(f"{name}={int(v) if isinstance(v, bool) else v}" for name, v in given.items())
        facts = {"oiiotex:filter": self.name, "oiiotex:parameters": words}
        return facts | ({"oiiotex:seed": given["seed"]} if "seed" in given else {})

    @classmethod
    def output(cls, name: str) -> Output:
        """The declared output of that name.

        Raises
        ------
        KeyError
            There is none.
        """
        declared = {o.name: o for o in cls.outputs}
        return declared.get(name) or declared[re.sub(r"\.[0-9]+$", ".N", name)]

    @classmethod
    def main(cls) -> Output:
        """The declared output that is the op's image."""
        return next(o for o in cls.outputs if not (o.of or o.asked_by))

    def asked(self, output: Output) -> bool | Path:
        """Whether an output is asked for; a file's name where it is to go there."""
        value = getattr(self, output.asked_by) if output.asked_by else True
        return value if isinstance(value, Path) else bool(value)

    def judges(self, output: Output) -> bool:
        """Whether an output is held to limits."""
        return bool(output.judged_by) and getattr(self, output.judged_by) is not None

    def files(self) -> dict[str, Path]:
        """The files that are written beside the image, by the outputs that they hold."""
        asked = ((output.name, self.asked(output)) for output in self.outputs)
        return {name: path for name, path in asked if isinstance(path, Path)}

    def operands(self) -> list[Any]:
        """The images that this use has been given, in the order of declaration."""
        return [image for _, image in self.given()]

    def scanned(self) -> list[Any]:
        """The parts of which it looks at all pixels."""
        return [image.first for image in self.operands()] if self.scans else []

    def paths_read(self) -> list[Path]:
        """The files that it reads beside its images."""
        asking = {output.asked_by for output in self.outputs}
        values = (getattr(self, p.attribute) for p in self.parameters() if p.attribute not in asking)
        return [value for value in values if isinstance(value, Path)]

    def facts(self) -> dict[str, int | float | str]:
        """User variables that the op sets for expressions that follow."""
        return {}

    def result_count(self) -> int:
        """How many images this use makes."""
        return 1

    def compute(self, session: Session) -> Any:
        """The outputs by name; a tuple of such mappings where it makes several images.

        What is an image comes as an `image.Part`, of which nothing need be computed before it is read; a picture as
        (height, width, 3) sRGB values, floats in 0 .. 1 or 8 bits, or as a part of 8 bits; a table as what JSON can
        hold, arrays by their names, a movie as (frames of 8-bit sRGB, frames a second), paints as a list of
        `io.paint_palette.Paint`, a mesh as text, Cryptomatte as its label maps. Instead of an output its maker may
        come, a callable without arguments: it is called where the output is asked for. An `image.Image` alone is the
        op's image with all its parts.

        A line is looked through before it is run: there, what asks for pixels or for the device raises `Unseen`, and
        goes on being known by declaration alone. So what can be wrong is checked before either is touched.
        """
        raise NotImplementedError
