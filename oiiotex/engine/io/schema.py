# SPDX-License-Identifier: Apache-2.0
"""Validation of documents by types: an error names the place in the document and the expected type.

`str`, `int`, `float` and `bool`, `Literal`, `X | None`, `tuple[X, ...]`, `dict[str, X]`, `Annotated[X, Allowed(...)]`,
`TypedDict` (all keys are required) and frozen dataclasses (fields without a default are required;
`field(metadata={"key": ...})` sets another key). `Any` is not checked.
"""

from __future__ import annotations

import functools
import math
import re
import types
from collections.abc import Collection, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints, is_typeddict

from ..core.parameters import nearest
from ..errors import Error, ImageError, ParameterError, within

_NAMES = {str: "a string", int: "an integer", float: "a number", bool: "true or false", type(None): "null"}


@dataclass(frozen=True)
class Allowed:
    """Numbers from `low` to `high`; strings matching a pattern, described by `words`, or of limited length; choices."""

    low: float = -math.inf
    high: float = math.inf
    most: int | None = None
    pattern: str | None = None
    words: str = ""
    among: Collection[Any] | None = None

    def holds(self, value: Any) -> bool:
        """Whether a value of the right type fits."""
        if self.among is not None:
            return value in self.among
        if isinstance(value, (int, float)):
            return self.low <= value <= self.high
        return (self.most is None or len(value) <= self.most) and (
            self.pattern is None or re.fullmatch(self.pattern, value) is not None
        )

    def __str__(self) -> str:
        if self.words or self.among is not None:
            return f" {self.words or '(' + ', '.join(map(str, self.among or ())) + ')'}"
        most = "" if self.most is None else f" of at most {self.most} characters"
        if self.high < math.inf:
            return f" from {self.low:.15g} to {self.high:.15g}{most}"
        return f" >= {self.low:.15g}{most}" if self.low > -math.inf else most


Seed = Annotated[int, Allowed(0, 2**32 - 1)]
Fraction = Annotated[float, Allowed(0, 1)]


class _Unfit(Exception):
    """The place of an invalid value, and the error."""

    def below(self, place: str) -> _Unfit:
        """The same, with the enclosing place in front."""
        inner, text = self.args
        return _Unfit(f"{place}{'.' if inner and inner[0] != '[' else ''}{inner}", text)


def read_as(kind: Any, document: Any, where: str, error: type[Error] = ImageError, more: bool = False) -> Any:
    """A parsed JSON, YAML or TOML document as the given type; with `more`, unknown keys are ignored.

    Raises
    ------
    Error
        `error`: WHERE: PLACE: expected ..., not ...
    """
    try:
        return _read(kind, document, more)
    except _Unfit as unfit:
        with within(where):
            raise error(": ".join(filter(None, unfit.args))) from None


def _read(kind: Any, value: Any, more: bool) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is Any:
        return value
    if origin is Annotated:
        checked = _read(arguments[0], value, more) if _fits(arguments[0], value) else None
        if checked is not None and arguments[1].holds(checked):
            return checked
    elif origin in (Union, types.UnionType):
        for option in arguments:
            if _fits(option, value):
                return _read(option, value, more)
    elif _fits(kind, value):
        if _has_fields(kind):
            return _object(kind, value, more)
        if origin in (tuple, list):
            return origin(_below(f"[{n}]", arguments[0], one, more) for n, one in enumerate(value))
        if origin in (dict, Mapping):
            return {name: _below(name, arguments[1], one, more) for name, one in value.items()}
        return float(value) if kind is float else value
    raise _Unfit("", f"expected {_expected(kind)}, not {_shown(value)}")


def _below(place: str, kind: Any, value: Any, more: bool) -> Any:
    try:
        return _read(kind, value, more)
    except _Unfit as unfit:
        raise unfit.below(place) from None


def _fits(kind: Any, value: Any) -> bool:
    """Whether a value has the type, without its elements."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _fits(arguments[0], value)
    if origin is Literal:
        return any(type(value) is type(choice) and value == choice for choice in arguments)
    if origin in (tuple, list):
        return isinstance(value, list)
    if origin in (dict, Mapping) or _has_fields(kind):
        return isinstance(value, Mapping) and all(isinstance(name, str) for name in value)
    if kind is float:
        return (type(value) is float and math.isfinite(value)) or (type(value) is int and abs(value) <= 2**53)
    return kind is Any or type(value) is kind


def _object(kind: Any, value: Mapping[str, Any], more: bool) -> Any:
    known = types_of(kind)
    for name in value:
        if name not in known and not more:
            raise _Unfit("", f"unknown key '{name[:60]}'{nearest(name, known)}; expected {', '.join(known)}")
    read = {name: _below(name, type_, value[name], more) for name, type_ in known.items() if name in value}
    own = {} if is_typeddict(kind) else {_key(one): one for one in fields(kind)}
    for name in known:
        if name not in read and (not own or own[name].default is own[name].default_factory is MISSING):
            raise _Unfit("", f"{name} is missing: expected {_expected(known[name])}")
    try:
        return kind(**{own[name].name if own else name: one for name, one in read.items()})
    except ParameterError as error:
        raise _Unfit("", str(error)) from error


def _has_fields(kind: Any) -> bool:
    return is_typeddict(kind) or is_dataclass(kind)


@functools.cache
def types_of(kind: Any) -> dict[str, Any]:
    """The types of a TypedDict or a dataclass, by key."""
    hints = get_type_hints(kind, include_extras=True)
    return hints if is_typeddict(kind) else {_key(one): hints[one.name] for one in fields(kind)}


def _key(one: Field[Any]) -> str:
    return str(one.metadata.get("key", one.name))


def _expected(kind: Any) -> str:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return f"{_expected(arguments[0])}{arguments[1]}"
    if origin is Literal:
        return " or ".join(map(repr, arguments))
    if origin in (Union, types.UnionType):
        return " or ".join(_expected(one) for one in arguments if one is not type(None))
    if origin in (tuple, list):
        return "a list"
    if _has_fields(kind):
        return f"an object of {', '.join(list(types_of(kind))[:5])}"
    return _NAMES.get(kind, "an object")


def _shown(value: Any) -> str:
    if isinstance(value, (list, Mapping)):
        return "a list" if isinstance(value, list) else "an object"
    text = ascii(value) if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
