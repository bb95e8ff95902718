# SPDX-License-Identifier: Apache-2.0
"""A parameter, declared once: type, default, unit, range, help.

From the declaration come the Python signature, the command line's modifiers, `--help`, the docs page and the checks.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import inspect
import keyword
import math
import re
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ..deferred import np
from ..errors import ParameterError, ParameterTypeError, either, spelled

_FIELD = "oiiotex"
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")  # Python's int and float accept more: 1_0, ٣
_INTEGERS = 1 << 31  # OpenImageIO and kernels use 32-bit ints and floats
LARGEST = (2 - 2**-23) * 2.0**127  # of 32-bit floats
_TRUE, _FALSE = ("1", "on", "true", "yes"), ("0", "off", "false", "no")


class Numbers(tuple[float, ...]):
    """Comma-separated numbers: a color, a matrix, a list of coordinates."""

    def __str__(self) -> str:
        return ",".join(f"{n:.9g}" for n in self)


class Words(tuple[str, ...]):
    """Comma-separated words: the kinds of several maps, the names of panels."""

    def __str__(self) -> str:
        return ",".join(self)


class Size(NamedTuple):
    """Width x height in pixels."""

    width: int
    height: int

    def __str__(self) -> str:
        return f"{self.width}x{self.height}"

    def powers_of_two(self) -> Size:
        """Each side rounded to the nearest power of two; ties are rounded up."""
        floors = (1 << (n.bit_length() - 1) for n in self)
        return Size(*(2 * low if 2 * n >= 3 * low else low for n, low in zip(self, floors, strict=True)))


class SizeRule(enum.StrEnum):
    """A word for a size that is derived from an input image."""

    POW2 = "pow2"


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One declared parameter of an op, or one of its input images (`kind` is then None)."""

    name: str
    kind: tuple[type, ...] | None  # types of its value; (): only None
    default: Any  # dataclasses.MISSING if required
    help: str
    unit: str = ""
    ge: float | None = None
    le: float | None = None
    choices: tuple[Any, ...] = ()
    positional: bool = False  # on the command line a separate word after the op instead of a modifier
    many: bool = False  # an input that is a tuple of any number of images
    unset: str = ""  # what a default of None stands for: "longer side / 8"
    example: str = ""  # a value as on the command line, if `sample` cannot derive one
    advanced: bool = False  # few people need it: help and docs list it last
    frame: bool = False  # its default is the frame number of a sequence
    count: str = ""  # of such an input: the parameter with a value for each image, the first input included

    @property
    def attribute(self) -> str:
        """Name of its field: `from_` for `from`, which is a keyword of Python."""
        return f"{self.name}_" if keyword.iskeyword(self.name) else self.name

    @property
    def required(self) -> bool:
        """Whether a value is required."""
        return self.default is dataclasses.MISSING

    @property
    def expected(self) -> str:
        """The valid values, for help and errors: 'a number >= 1 px', with words marked for `spelled`."""
        if self.kind is None:
            return "1 (the next image on the stack), the name of a part of the first image, or a file name"
        if self.choices:
            line = ", ".join(_typed(choice)[0] for choice in self.choices if choice not in ("", None))
            return f"one of {either(line, ', '.join(repr(choice) for choice in self.choices if choice is not None))}"
        if bool in self.kind and len(self.kind) > 1:
            others = " or ".join(_KINDS[k] for k in self.kind if k is not bool)
            text = f"{either('0, 1, or', 'True, False, or')} {others}"
        else:
            text = " or ".join(_KINDS[k] for k in self.kind)
        if self.ge is not None and self.le is not None:
            text += f" from {self.ge:.10g} to {self.le:.10g}"
        elif self.ge is not None:
            text += f" >= {self.ge:.10g}"
        elif self.le is not None:
            text += f" <= {self.le:.10g}"
        unit = f"in {self.unit}" if self.unit and Numbers in self.kind and self.ge is None else self.unit
        return f"{text} {unit}".rstrip()

    @property
    def default_text(self) -> str:
        """The default as on the command line; empty if a value is required."""
        if self.required:
            return ""
        if self.unset or self.default in (None, ""):
            return self.unset or "none"
        return f"{self.default:.10g}" if isinstance(self.default, (bool, int, float)) else str(self.default)

    @property
    def sample(self) -> str:
        """A value as on the command line, other than the default if possible; empty if none is known."""
        if self.example:
            return self.example
        kinds = self.kind or ()
        if self.kind is None:
            return "1"
        if self.choices:
            return next(_typed(choice)[0] for choice in self.choices if choice not in ("", None, self.default))
        if bool in kinds:
            return "0" if self.default is True else "1"
        if SizeRule in kinds or Size in kinds:
            return "1024x1024"
        if not {int, float} & set(kinds):
            return ""
        twice = 2 * self.default if isinstance(self.default, (int, float)) else self.ge
        value = min(max(twice or 1, -LARGEST if self.ge is None else self.ge), LARGEST if self.le is None else self.le)
        return str(int(value)) if int in kinds or value == int(value) else f"{value:g}"

    def described(self, help: str) -> str:
        """`help`, followed by valid values and default as sentences."""
        values = self.allowed()
        begins_with_value = self.kind is None or SizeRule in self.kind
        text = f"{help} {f'Values: {values}' if begins_with_value else values[:1].upper() + values[1:]}."
        return text if self.required else f"{text} Default: {self.default_text}."

    def allowed(self) -> str:
        """The valid values on the command line."""
        return spelled(self.expected)

    def check(self, value: Any) -> Any:
        """`value` converted to the declared type.

        Raises
        ------
        ParameterTypeError
            The value is of another type.
        ParameterError
            The value is out of range, not among the choices, or exceeds 32 bits.
        """
        if value is None and self.default is None:
            return None
        wrong_types = 0
        for kind in (*map(type, self.choices),) if self.choices else self.kind or ():
            try:
                converted = _convert(kind, value)
            except TypeError:
                wrong_types += 1
                continue
            except (ValueError, OverflowError):
                continue
            if self._in_range(converted):
                return self._fitting(converted, value)
        if wrong_types == len(self.choices or self.kind or ()):
            but = "" if np.ndim(value) or isinstance(value, dict) else f", not {type(value).__name__}"
            raise ParameterTypeError(parameter=self.name, value=value, expected=f"{self.expected}{but}")
        raise self.wrong(value)

    def wrong(self, value: Any, bounds: str = "") -> ParameterError:
        """The error for an invalid value; `bounds` is appended to the valid values."""
        return ParameterError(parameter=self.name, value=value, expected=f"{self.expected} {bounds}".rstrip())

    def _in_range(self, value: Any) -> bool:
        if self.choices:
            return value in self.choices
        numbers = _numbers_in(value)
        return all((self.ge is None or n >= self.ge) and (self.le is None or n <= self.le) for n in numbers)

    def _fitting(self, value: Any, given: Any) -> Any:
        """The value, checked to fit into 32 bits where no bound is declared."""
        for n in _numbers_in(value):
            least, most = (-LARGEST, LARGEST) if isinstance(n, float) else (-_INTEGERS, _INTEGERS - 1)
            if (self.ge is None and n < least) or (self.le is None and n > most):
                raise self.wrong(given, f"that fits into 32 bits ({least:.10g} to {most:.10g})")
        return value

    def parse(self, text: str) -> Any:
        """The value of a modifier from its text; raises as `check` does.

        For an input image: True to take it from the stack, None for none, otherwise the name of a part or a file.
        """
        if self.kind is None and text:
            return True if text in _TRUE else None if text in _FALSE else text
        if not text and self.positional and str in (self.kind or ()) and not self.choices:
            return text  # an empty positional text means no value
        for choice in self.choices:
            if text in _typed(choice):
                return choice
        for kind in () if self.choices else self.kind or ():
            try:
                value = _convert(kind, _parse(kind, text))
            except (ValueError, OverflowError):
                continue
            if self._in_range(value):
                return self._fitting(value, text)
        raise self.wrong(text)


_KINDS = {
    int: "an integer", float: "a number", bool: either("0 or 1", "True or False"), Path: "a file name",
    str: "a string", Size: either("WIDTHxHEIGHT", "(width, height)"),
    Numbers: either("a comma-separated list of numbers", "a number or a sequence of numbers"),
    Words: either("a comma-separated list", "a sequence of strings"), SizeRule: either("pow2", "'pow2'"),
}  # fmt: skip


def param(
    default: Any = dataclasses.MISSING,
    *,
    help: str,
    unit: str = "",
    ge: float | None = None,
    le: float | None = None,
    choices: Iterable[Any] = (),
    unset: str = "",
    example: str = "",
    advanced: bool = False,
    frame: bool = False,
    positional: bool = False,
) -> Any:
    """Declare a parameter as a dataclass field; `argument` is the same with `positional`.

    Parameters
    ----------
    default : optional
        If omitted, a value is required.
    help : str
        Sentences, the first beginning with a noun phrase. Valid values and default are appended automatically.
    ge, le : float, optional
        The smallest and the largest value; for both sides of a Size, and for each of `Numbers`.
    unit, choices, unset, example, advanced, frame, positional
        As in `Parameter`.
    """
    facts = {
        "help": help, "unit": unit, "ge": ge, "le": le, "choices": tuple(choices), "unset": unset, "example": example,
        "advanced": advanced, "frame": frame, "positional": positional,
    }  # fmt: skip
    return dataclasses.field(default=default, metadata={_FIELD: facts})


argument = functools.partial(param, positional=True)


def image(default: Any = dataclasses.MISSING, *, help: str, count: str = "", advanced: bool = False) -> Any:
    """Declare an input image as a dataclass field.

    A field of type `tuple[Image, ...]` holds several images. With `count`, it follows the first input, and the
    parameter of that name has a value for each of these images.
    """
    facts = {"help": help, "count": count, "advanced": advanced}
    return dataclasses.field(default=default, metadata={_FIELD: facts})


def declared(op: type) -> tuple[tuple[Parameter, ...], tuple[Parameter, ...]]:
    """(input images, parameters) of an op's dataclass, in the order of declaration.

    Parameters of the op's own class come before those of its bases.
    """
    return _declared(op)


@functools.cache  # not `declared` itself: for mypy, the class of a frozen dataclass is not hashable
def _declared(op: type) -> tuple[tuple[Parameter, ...], tuple[Parameter, ...]]:
    hints = typing.get_type_hints(op)
    images, parameters = [], []
    for field in dataclasses.fields(op):
        facts, hint = field.metadata[_FIELD], hints[field.name]
        if "unit" in facts:
            parameters.append(Parameter(field.name.removesuffix("_"), _kinds(hint), field.default, **facts))
        else:
            several = typing.get_origin(hint) is tuple
            images.append(Parameter(field.name, None, field.default, **facts, many=several))
    own_first = list(dict.fromkeys(name for base in op.__mro__ for name in inspect.get_annotations(base)))
    return tuple(images), tuple(sorted(parameters, key=lambda parameter: own_first.index(parameter.attribute)))


def parse_modifiers(op: type, modifiers: Mapping[str, str | None]) -> dict[str, Any]:
    """An op's values by field, from the values of modifiers; a value of None sets nothing, but its name is checked.

    Optional input images are requested by a modifier of their name.

    Raises
    ------
    ParameterError
        A modifier is unknown (the message suggests the nearest one), or a value is invalid.
    """
    images, parameters = declared(op)
    known = {
        p.name: p
        for p in (*images, *parameters)
        if not p.positional and not (p.kind is None and (p.required or p.many))
    }
    values = {}
    for name, text in modifiers.items():
        if name not in known:
            listed = f"modifiers: {', '.join(known) or 'none'}"
            raise ParameterError(f"unknown modifier '{name}'{nearest(name, known)}", hint=listed)
        if text is not None:
            values[known[name].attribute] = known[name].parse(text)
    return values


def nearest(name: str, known: Iterable[str]) -> str:
    """', did you mean ...?' if a known name is similar, ignoring case; otherwise empty."""
    import difflib  # slow to import, and only used for errors

    by_lower = {each.lower().lstrip("-"): each for each in known}
    close = difflib.get_close_matches(name.lower().lstrip("-"), list(by_lower), 1)
    return f", did you mean '{by_lower[close[0]]}'?" if close else ""


def _numbers_in(value: Any) -> tuple[float, ...]:
    """The numbers of a value; empty for other types."""
    if isinstance(value, (Size, Numbers)):
        return tuple(value)
    return (value,) if isinstance(value, (int, float)) and not isinstance(value, bool) else ()


def _kinds(hint: Any) -> tuple[type, ...]:
    return tuple(k for k in typing.get_args(hint) or (hint,) if k is not type(None))


def _typed(choice: Any) -> tuple[str, ...]:
    """A choice as it is typed on the command line; the first way is shown."""
    return (str(choice),) if not isinstance(choice, bool) else _TRUE if choice else _FALSE


def _parse(kind: type, text: str) -> Any:
    if kind is bool:
        if text.lower() not in _TRUE + _FALSE:
            raise ValueError(text)
        return text.lower() in _TRUE
    if kind is Numbers:
        return Numbers(_parse(float, piece.strip()) for piece in text.split(","))
    if kind is Words:
        words = Words(piece.strip() for piece in text.split(","))
        if not all(words):
            raise ValueError(text)
        return words
    if kind is Size:
        width, _, height = text.lower().partition("x")
        return Size(_parse(int, width), _parse(int, height))
    if not text or (kind in (int, float) and not _NUMBER.fullmatch(text)):
        raise ValueError(text)
    return kind(text)


def _convert(kind: type, value: Any) -> Any:
    """A Python value converted to `kind`; raises ValueError or TypeError if it cannot be."""
    if kind in (Size, Words) and isinstance(value, (str, bytes)):
        raise TypeError(value)
    if kind is Size:
        return Size(*(_convert(int, side) for side in value))
    if kind in (Numbers, Words):
        pieces = value if kind is Words or isinstance(value, tuple) or np.ndim(value) else [value]
        if not len(pieces):
            raise ValueError(value)
        return kind(_convert(str if kind is Words else float, piece) for piece in pieces)
    if kind in (int, float):
        if isinstance(value, (bool, str, bytes)) or getattr(value, "dtype", None) == "bool":
            raise TypeError(value)
        converted = kind(value)
        if converted != value or not math.isfinite(converted):
            raise ValueError(value)
        return converted
    if kind in (bool, str, SizeRule) and not isinstance(value, bool if kind is bool else str):
        raise TypeError(value)
    return kind(value)
