# SPDX-License-Identifier: Apache-2.0
"""What {expressions} compute with: texts that may be numbers of single precision, their operators, and format()."""

from __future__ import annotations

import math
import re
import string
import typing
from collections.abc import Callable, Mapping, Sequence

from ...deferred import np
from ...errors import ParameterError

Value = int | float | str

_DIGITS = r"0[xX](?:[\da-fA-F]+\.?[\da-fA-F]*|\.[\da-fA-F]+)(?:[pP][+-]?\d+)?|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
NUMBER = rf"{_DIGITS}|(?:[iI][nN][fF](?:[iI][nN][iI][tT][yY])?|[nN][aA][nN])(?!\w)"  # what C's strtof takes
_NUMERIC = re.compile(rf"\s*[+-]?(?:{NUMBER})\s*", re.ASCII)
_INTEGER = re.compile(r"\s*[+-]?\d+\s*", re.ASCII)
_LEAST, _MOST = -(1 << 31), (1 << 31) - 1  # of 32-bit whole numbers


def number_in(text: str) -> np.float32 | None:
    """The number that the whole of `text` is, or None."""
    if not _NUMERIC.fullmatch(text):
        return None
    try:
        return np.float32(float.fromhex(text) if "x" in text.lower() else float(text))
    except OverflowError:  # only fromhex raises it
        return np.float32(-np.inf if "-" in text else np.inf)


def integer_in(text: str) -> int | None:
    """The whole number that the whole of `text` is, held to 32 bit, or None."""
    return max(_LEAST, min(_MOST, int(text))) if _INTEGER.fullmatch(text) and len(text) < 4000 else None


def shown(number: float | np.floating) -> str:
    """A number as C's %g shows it: with the sign of a NaN."""
    return f"{'-' if math.isnan(number) and np.signbit(number) else ''}{float(number):g}"


def is_true(text: str) -> bool:
    """Whether `text` counts as true: not 0, '', no, off or false."""
    number = number_in(text)
    return text.strip().lower() not in ("", "false", "no", "off") if number is None else bool(number != 0)


def negated(text: str) -> str:
    """`text` with the other sign; one that is no number just gets a '-'."""
    number = number_in(text)
    return text.strip()[1:] if number is not None and np.signbit(number) else f"-{text}"


def is_quoted(text: str) -> bool:
    """Whether it is a result of format() or FRAME_NUMBER_PAD: a text that no arithmetic may touch."""
    return len(text) >= 2 and text[0] == text[-1] == '"'


def _whole(number: np.float32) -> int:
    if not _LEAST <= float(number) <= _MOST:  # false for NaN too
        raise ParameterError(f"{shown(number)} is not a whole number of 32 bit")
    return int(number)


def _whole_numbers(compute: Callable[[int, int], int]) -> Callable[[np.float32, np.float32], np.float32]:
    """`compute` on both numbers cut to whole ones; 0 where the right one is 0, as oiiotool says."""

    def operator(left: np.float32, right: np.float32) -> np.float32:
        if right == 0:
            return np.float32(0)
        divisor = _whole(right)
        if divisor == 0:
            raise ParameterError(f"{shown(right)} cut to a whole number is 0: it divides nothing")
        return np.float32(compute(_whole(left), divisor))

    return operator


PRODUCTS: dict[str, Callable[[np.float32, np.float32], np.float32]] = {
    "*": lambda left, right: left * right,
    "/": lambda left, right: left / right,
    "//": _whole_numbers(lambda left, right: math.trunc(left / right)),
    "%": _whole_numbers(lambda left, right: int(math.fmod(left, right))),
}
SUMS: dict[str, Callable[[np.float32, np.float32], typing.Any]] = {
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "<": lambda left, right: left < right,
    ">": lambda left, right: left > right,
    "<=": lambda left, right: left <= right,
    ">=": lambda left, right: left >= right,
    "==": lambda left, right: left == right,
    "!=": lambda left, right: left != right,
    "<=>": lambda left, right: int(left > right) - int(left < right),
    "&": lambda left, right: left != 0 and right != 0,
    "|": lambda left, right: left != 0 or right != 0,
}
SUMS |= {"&&": SUMS["&"], "||": SUMS["|"]}

_SPEC = re.compile(
    r"(?:(?P<fill>[^{}])?(?P<align>[<^>]))?(?P<sign>[-+ ])?(?P<alternate>#)?(?P<zero>0)?(?P<width>\d{0,4})"
    r"(?P<precision>\.\d{1,4})?L?(?P<type>[a-zA-Z]?)",
    re.ASCII | re.DOTALL,
)


class _Formatter(string.Formatter):
    """Python's formatter held to what the fmt library does: no attributes, no conversions, no types of its own."""

    def get_field(self, field_name: str, args: Sequence[Value], kwargs: Mapping[str, Value]) -> tuple[Value, str]:
        if not re.fullmatch(r"[0-9]+", field_name):
            raise ValueError(f"fields have numbers, not names like '{field_name}'")
        return args[int(field_name)], field_name

    def convert_field(self, value: Value, conversion: str | None) -> Value:
        if conversion is not None:
            raise ValueError(f"'!{conversion}' is not known")
        return value

    def format_field(self, value: Value, format_spec: str) -> str:
        return _formatted(value, format_spec)


def filled(template: str, arguments: Sequence[str]) -> str:
    """What format() makes of a template of the fmt library and its values."""
    try:
        return _Formatter().vformat(template, [_argument(text) for text in arguments], {})
    except IndexError:
        raise ParameterError(f"format(): '{template}' wants more than {len(arguments)} values") from None
    except (ValueError, OverflowError) as error:
        raise ParameterError(f"format(): {error}") from error


def _argument(text: str) -> Value:
    whole, number = integer_in(text), number_in(text)
    if whole is not None:
        return whole
    if number is None:
        return text
    return float(number) if "x" in text.lower() else float(text)  # of double precision, as there


def _formatted(value: Value, spec: str) -> str:
    """`value` by a format specification of fmt, which is stricter than Python's."""
    match = _SPEC.fullmatch(spec)
    types = "s" if isinstance(value, str) else "dxXobBc" if isinstance(value, int) else "eEfFgG"
    if match is None or match["type"] not in ("", *types):
        raise ValueError(f"'{spec}' does not fit {value!r}")
    kind, precision, zero = match["type"], match["precision"] or "", match["zero"] or ""
    align = match["align"] or ""
    if isinstance(value, float):
        kind, precision = (kind, precision) if kind else ("g", precision) if precision else _shortest(value)
        if not math.isfinite(value):  # fmt sets it left, and no zeros before it
            align, zero = align or ("" if zero else "<"), ""
    elif kind == "c":
        value, kind = chr(int(value)).encode().decode(), "s"  # no half of a surrogate pair
    if isinstance(value, str) and (match["sign"] or match["alternate"] or zero):
        raise ValueError(f"'{spec}' is for numbers, not {value!r}")
    zero = "" if align else zero  # in fmt, alignment wins
    flags = f"{match['fill'] or ''}{align}{match['sign'] or ''}{match['alternate'] or ''}{zero}"
    text = format(value, f"{flags}{match['width']}{precision}{kind.replace('B', 'b')}")
    return text.replace("0b", "0B", 1) if kind == "B" else text


def _shortest(number: float) -> tuple[str, str]:
    """Python's presentation type and precision that show a number as fmt's '{}' does."""
    text = repr(number)
    if text.endswith(".0"):
        return "f", ".0"
    return "g", f".{len(re.sub(r'e.*|[^0-9]', '', text).lstrip('0'))}"
