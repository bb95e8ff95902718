# SPDX-License-Identifier: Apache-2.0
"""The {expressions} in words of a command line, as oiiotool 3.2 evaluates them.

Every value is a string, as in oiiotool: numbers have single precision and become a string of six digits after each
product and each sum, so {(1/3)*3} is 0.999999. All operators between summands, including comparisons, have the same
precedence and associate from left to right.

Differences from oiiotool
-------------------------
1. Expressions on which it silently gives up are errors: text after a value ({1 2}), an unknown operator ({5--3}), an
   unclosed quote, {eq(1+1,2)}, {TOP.}, {getattribute(nosuch)}.
2. // and % by a number between -1 and 1, which crash it, and integers beyond 32 bits are errors.
3. {-x} of x = -5 is 5, not --5.
4. A '-' or '!' before var() and getattribute(), which it ignores, is an error.
5. White space may separate any two words. A variable may be named TOPS or information; oiiotool reads the first
   characters as TOP and inf.
6. format() has neither the presentation types 'a' and '?' nor widths and precisions above four digits.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from typing import Protocol

from ....engine.core.image import Image
from ....engine.core.parameters import nearest
from ....engine.deferred import np, oiio
from ....engine.errors import ParameterError, within
from ..printing.metadata import Asked, description
from ..printing.pixel_statistics import part_color, part_statistics, part_statistics_text
from .expression_values import (
    NUMBER,
    PRODUCTS,
    SUMS,
    filled,
    integer_in,
    is_quoted,
    is_true,
    negated,
    number_in,
    shown,
)
from .sequences import Frame

_LONGEST = 1 << 20  # characters of a word: a variable that is doubled in a loop would take all memory


class Scope(Protocol):
    """The parts of a chain that expressions read: images, by index, label and file, and its variables."""

    frame: Frame | None
    labeled: dict[str, Image]
    stack: list[Image]
    user: dict[str, int | float | str]

    def image(self, index: int) -> Image:
        """The image at that depth of the stack, 0 the top."""

    def known(self, image: Image, pixels: bool) -> Image:
        """The image with its attributes, or its pixels; raises if they are not computed yet."""

    def opened(self, path: str) -> Image:
        """The image of a file."""


def substituted(text: str, chain: Scope) -> str:
    """`text` with every {expression} replaced by its value; an unclosed brace is kept."""
    result, at = "", 0
    while (opening := text.find("{", at)) >= 0 and (end := _after_braces(text, opening)):
        expression = text[opening + 1 : end - 1]
        with within(f"{{{expression}}}"):
            value = _Evaluation(expression, chain).value()
            if len(result) + len(value) > _LONGEST:
                raise ParameterError(f"the word becomes longer than {_LONGEST:,} characters")
        result, at = result + text[at:opening] + value, end
    return result + text[at:]


def _after_braces(text: str, opening: int) -> int:
    """The index after the brace that closes the one at `opening`, 0 if none; quotes are ignored, as in oiiotool."""
    nesting = 0
    for brace in re.finditer(r"[{}]", text[opening:]):
        nesting += 1 if brace[0] == "{" else -1
        if nesting == 0:
            return opening + brace.end()
    return 0


_DIMENSIONS = (
    "nchannels", "width", "height", "depth", "x", "y", "z", "full_width", "full_height", "full_depth", "full_x",
    "full_y", "full_z", "tile_width", "tile_height", "tile_depth", "alpha_channel", "z_channel", "geom", "full_geom",
    "datawindow", "displaywindow",
)  # fmt: skip


def _listed(numbers: Iterable[float]) -> str:
    return ",".join(shown(number) for number in numbers)


def _described(verbose: bool, native: bool) -> Callable[[Image], str]:
    asked = Asked(verbose=verbose, all_parts=verbose, native=native)
    return lambda image: "".join(description(image, asked)).removesuffix("\n")


def _is_black(image: Image) -> bool:
    color = part_color(image.first)
    return color is not None and color[0] == 0  # oiiotool tests the first channel only


def _nonfinite_count(image: Image) -> int:
    statistics = part_statistics(image.first)
    return sum(statistics.nancount) + sum(statistics.infcount)


_PROPERTIES: dict[str, Callable[[Image], object]] = {
    "filename": lambda image: image.title,
    "file_extension": lambda image: os.path.splitext(image.title)[1],
    "file_noextension": lambda image: os.path.splitext(image.title)[0],
    "META": _described(verbose=True, native=False),
    "METANATIVE": _described(verbose=True, native=True),
    "METABRIEF": _described(verbose=False, native=False),
    "METANATIVEBRIEF": _described(verbose=False, native=True),
    "SUBIMAGES": lambda image: len(image.parts),
}
_PIXEL_PROPERTIES: dict[str, Callable[[Image], object]] = {
    "MINCOLOR": lambda image: _listed(part_statistics(image.first).min),
    "MAXCOLOR": lambda image: _listed(part_statistics(image.first).max),
    "AVGCOLOR": lambda image: _listed(part_statistics(image.first).avg),
    "NONFINITE_COUNT": _nonfinite_count,
    "STATS": lambda image: part_statistics_text(image.first).removesuffix("\n"),
    "IS_CONSTANT": lambda image: int(part_color(image.first) is not None),
    "IS_BLACK": lambda image: int(_is_black(image)),
}


def _attribute(image: Image, name: str) -> str | None:
    """The property of an image, or None; metadata take precedence, and match in upper and lower case."""
    spec = image.first.spec
    if name == "nativeformat":
        return str(spec.format)
    for param in spec.extra_attribs:
        if param.name.lower() == name.lower():
            text = spec.metadata_val(param)
            return text[1:-1] if param.type.basetype == oiio.STRING else text  # without its quotes
    if name.lower() == "format":
        return str(image.first.working_type)
    if name.lower() in _DIMENSIONS:
        value = spec.getattribute(name)
        return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)
    find = _PROPERTIES.get(name) or _PIXEL_PROPERTIES.get(name)
    return None if find is None else str(find(image))


def _unknown_attribute(image: Image, name: str) -> ParameterError:
    metadata = [param.name for param in image.first.spec.extra_attribs]
    known = [*_DIMENSIONS, "format", "nativeformat", *_PROPERTIES, *_PIXEL_PROPERTIES, *metadata]
    return ParameterError(f"{image.source} has no '{name}'{nearest(name, known)}")


def _global_attribute(name: str) -> str:
    """A global attribute of OpenImageIO."""
    for kind in (oiio.TypeString, oiio.TypeInt, oiio.TypeFloat):
        value = oiio.getattribute(name, kind)
        if value is not None:
            return shown(value) if isinstance(value, float) else str(value)
    raise ParameterError(f"OpenImageIO has no attribute '{name}'")


_NAME = r"[A-Za-z_][A-Za-z_0-9]*"
_STRING = r"""(?s:"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')"""
_DEEPEST = 32  # nesting of parentheses and functions, within the limit of Python's stack
_VALUES = ("TOP", "BOTTOM", "IMG", "FRAME_NUMBER", "FRAME_NUMBER_PAD", "NIMAGES")


class _Evaluation:
    """Evaluates one expression by recursive descent."""

    def __init__(self, text: str, chain: Scope):
        self._text = text
        self._chain = chain
        self._at = 0
        self._nesting = 0

    def value(self) -> str:
        with np.errstate(all="ignore"):  # 1/0 is inf, as in oiiotool
            value = self._sum()
        if left := self._take(r".+"):
            raise ParameterError(f"unexpected '{left}' after the value")
        return value

    def _take(self, pattern: str) -> str:
        """Consume white space and a match of `pattern`; '' without a match."""
        match = re.compile(rf"\s*+({pattern})", re.ASCII).match(self._text, self._at)
        self._at = match.end() if match else self._at
        return match[1] if match else ""

    def _want(self, mark: str, of: str) -> None:
        if not self._take(re.escape(mark)):
            raise ParameterError(f"expected '{mark}' {of}")

    def _sum(self) -> str:
        value = self._product()
        quoted = is_quoted(value)
        total = None if quoted else number_in(value)
        if total is None:
            if self._take(r"[-+<=>!&|*/%]"):
                raise ParameterError(f"'{value}': expected a number")
            return value[1:-1] if quoted else value
        while word := self._take(r"[-+<=>!&|]+"):
            if word not in SUMS:
                raise ParameterError(f"unknown operator '{word}'", hint="separate two operators by a space")
            total = np.float32(SUMS[word](total, self._numeric(self._product())))
        return shown(total)

    def _product(self) -> str:
        value = self._atom()
        total = None if is_quoted(value) else number_in(value)
        if total is None:
            return value
        while word := self._take(r"//|[*/%]"):
            total = PRODUCTS[word](total, self._numeric(self._atom()))
        return shown(total)

    def _numeric(self, value: str) -> np.float32:
        number = number_in(value)
        if number is None:
            raise ParameterError(f"'{value}': expected a number")
        return number

    def _atom(self) -> str:
        """A value after any number of signs and !: all signs apply first, then all !."""
        self._nesting += 1
        if self._nesting > _DEEPEST:
            raise ParameterError(f"expected at most {_DEEPEST} levels of nesting")
        signs = self._take(r"[-+!\s]*")
        negative, inverted = signs.count("-") % 2 == 1, signs.count("!") % 2 == 1
        value = self._plain(signed=negative or inverted)
        value = negated(value) if negative else value
        self._nesting -= 1
        return str(int(not is_true(value))) if inverted else value

    def _plain(self, signed: bool) -> str:
        if self._take(r"\("):
            value = self._sum()
            self._want(")", f"after '{value}'")
            return value
        if number := self._take(NUMBER):
            return shown(self._numeric(number))
        if quoted := self._take(_STRING):
            return quoted[1:-1]
        name = self._take(_NAME)
        if not name:
            rest = self._take(r".+")
            raise ParameterError(f"expected a value before '{rest}'" if rest else "expected a value at the end")
        if self._take(r"\("):
            return self._function(name, signed)
        return self._named(name)

    def _named(self, name: str) -> str:
        chain = self._chain
        if name in ("TOP", "BOTTOM"):
            if not chain.stack:
                raise ParameterError(f"no image at {name}: the stack is empty")
            return self._of_image(chain.stack[-1 if name == "TOP" else 0])
        if name == "IMG" and self._take(r"\["):
            which = self._take(r"[^\]]+").strip()
            self._want("]", "of IMG[...]")
            return self._of_image(self._image(which))
        if name in ("FRAME_NUMBER", "FRAME_NUMBER_PAD"):
            frame, digits = (chain.frame.number or 0, chain.frame.padding) if chain.frame else (0, 0)
            return f'"{frame:0{digits}d}"' if digits and name.endswith("_PAD") else str(frame)
        if name == "NIMAGES":
            return str(len(chain.stack))
        if name in chain.user:
            return self._variable(name)
        known = [*_VALUES, *_FUNCTIONS, *chain.user]
        raise ParameterError(f"unknown name '{name}'{nearest(name, known)}")

    def _variable(self, name: str) -> str:
        """The value of a user variable, or ''; var() ignores case."""
        by_lower = {known.lower(): value for known, value in self._chain.user.items()}
        value = self._chain.user.get(name, by_lower.get(name.lower(), ""))
        return shown(np.float32(value)) if isinstance(value, float) else str(value)

    # images

    def _image(self, which: str) -> Image:
        """The image of IMG[which]: a label, an index, a file, or an expression for an index or a file."""
        labels = self._chain.labeled
        if which in labels:
            return labels[which]
        if integer_in(which) is None and os.path.exists(which):
            return self._chain.opened(which)
        try:
            value = _Evaluation(which, self._chain).value()
        except ParameterError as error:
            known = nearest(which, labels)
            raise ParameterError(f"IMG[{which}]: expected a label, a file or an index{known} ({error})") from error
        index, depth = integer_in(value), len(self._chain.stack)
        if index is not None:
            if not 0 <= index < depth:
                raise ParameterError(f"no image at IMG[{value}]: the stack has {depth}, counted from 0")
            return self._chain.image(index)
        if os.path.exists(value):
            return self._chain.opened(value)
        raise ParameterError(f"IMG[{value}]: expected a label, a file or an index{nearest(value, labels)}")

    def _of_image(self, image: Image) -> str:
        """The value of .name or [name] after an image; unknown names in brackets give ''."""
        bracket = self._take(r"[.\[]")
        if not bracket:
            raise ParameterError("expected .NAME or [NAME] after an image")
        quoted = self._take(_STRING)
        name = quoted[1:-1] if quoted else self._take(_NAME)
        if not name:
            raise ParameterError(f"expected a name after '{bracket}'")
        if not quoted and self._take(":"):
            raise ParameterError(f"names with ':' require quotes, as in TOP[\"{name}:{self._take(_NAME)}\"]")
        if bracket == "[":
            self._want("]", f"after '{name}'")
        value = _attribute(self._chain.known(image, name in _PIXEL_PROPERTIES), name)
        if value is None and bracket == ".":
            raise _unknown_attribute(image, name)
        return value or ""

    # functions

    def _function(self, name: str, signed: bool) -> str:
        if name not in _FUNCTIONS:
            known = ", ".join(_FUNCTIONS)
            raise ParameterError(f"unknown function '{name}'{nearest(name, _FUNCTIONS)}", expected=f"one of {known}")
        if signed and name in ("var", "getattribute"):
            raise ParameterError(f"oiiotool ignores '-' and '!' before {name}()", hint="put it in parentheses")
        value = _FUNCTIONS[name](self)
        self._want(")", f"of {name}()")
        return value

    def _name_argument(self) -> str:
        quoted = self._take(_STRING)
        name = quoted[1:-1] if quoted else self._take(r"[^)]*").strip()
        if not name:
            raise ParameterError("expected a name between the parentheses")
        return name

    def _same(self) -> bool:
        left = self._atom()
        self._want(",", "of a comparison: put sums in parentheses")
        return left == self._atom()

    def _format(self) -> str:
        template, arguments = self._atom(), list[str]()
        self._want(",", "of format(), which takes a template and its values")
        while not arguments or self._take(","):
            arguments.append(self._sum())
        return f'"{filled(template, arguments)}"'


_FUNCTIONS: dict[str, Callable[[_Evaluation], str]] = {
    "getattribute": lambda self: _global_attribute(self._name_argument()),
    "var": lambda self: self._variable(self._name_argument()),
    "eq": lambda self: str(int(self._same())),
    "neq": lambda self: str(int(not self._same())),
    "not": lambda self: str(int(not is_true(self._sum()))),
    "format": lambda self: self._format(),
}
