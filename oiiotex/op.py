# SPDX-License-Identifier: Apache-2.0
"""The contract of an op: name, inputs, parameters, named outputs, reach, working space.

One type serves our filters and the host's own ops alike. An op is a frozen keyword-only dataclass; an instance is one
use of it, with its images and checked values.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any, ClassVar

from .errors import ParameterError
from .params import Parameter, declared


class Reach(enum.Enum):
    """How far an output pixel looks; streaming follows from it."""

    POINT = "one pixel"
    AREA = "a neighbourhood"
    CAUSAL = "what was made before, a strip of it"
    WINDOW = "any window alone"
    GLOBAL = "the whole image"


class Space(enum.Enum):
    """Where an op works."""

    LAB = "CIE Lab D65"
    ANY = "whatever the channels hold"


@dataclass(frozen=True)
class Output:
    """A named output; the first is the op's image, the others follow it as parts where they are asked for."""

    name: str
    help: str


@dataclass(frozen=True, kw_only=True)
class Op:
    """Base of all ops. An op must say `name`, `reach`, `space` and `outputs`: none has a default.

    On the command line a filter of ours is `--tex` + name; the host's ops have no prefix.

    A subclass that has no `name` is not an op but a common ground of several.
    """

    prefix: ClassVar[str] = "--tex"
    aliases: ClassVar[tuple[str, ...]] = ()  # further names on the command line
    copies: ClassVar[bool] = False  # it promises that every pixel of its result is one of its source, whole
    name: ClassVar[str]
    reach: ClassVar[Reach]
    space: ClassVar[Space]
    outputs: ClassVar[tuple[Output, ...]]

    def __init_subclass__(cls) -> None:
        missing = [fact for fact in ("reach", "space", "outputs") if not hasattr(cls, fact)]
        if missing and "name" in cls.__dict__:
            raise TypeError(f"{cls.__name__} does not declare {', '.join(missing)}")

    def __post_init__(self) -> None:
        for parameter in self.parameters():
            try:
                value = parameter.check(getattr(self, parameter.attribute))
            except ParameterError as error:
                raise ParameterError(f"{self.name}: {error}") from None
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

    def values(self) -> dict[str, Any]:
        """This use's parameter values by name."""
        return {p.name: getattr(self, p.attribute) for p in self.parameters()}

    def provenance(self) -> dict[str, Any]:
        """What a file should say of how it was made, as metadata."""
        given = {name: value for name, value in self.values().items() if value is not None}
        images = {i.name: getattr(self, i.attribute) for i in self.optional_images()}
        given |= {name: found.source for name, found in images.items() if found is not None}
        words = ":".join(f"{name}={int(v) if isinstance(v, bool) else v}" for name, v in given.items())
        found = {"oiiotex:filter": self.name, "oiiotex:parameters": words}
        return found | ({"oiiotex:seed": given["seed"]} if "seed" in given else {})

    def compute(self, session: Any) -> Any:
        """The output `images.Image`, or a tuple of them, all pushed in that order; `session` is a `session.Session`."""
        raise NotImplementedError
