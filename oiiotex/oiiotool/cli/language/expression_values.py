# SPDX-License-Identifier: Apache-2.0
"""Values of {expressions}: strings that may be single-precision numbers, their operators, and format()."""

from __future__ import annotations

import math
import re
import string
import typing
from collections.abc import Callable, Mapping, Sequence

from ....engine.deferred import np
from ....engine.errors import ParameterError

Value = int | float | str

_DIGITS = r"0[xX](?:[\da-fA-F]+\.?[\da-fA-F]*|\.[\da-fA-F]+)(?:[pP][+-]?\d+)?|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
NUMBER = rf"{_DIGITS}|(?:[iI][nN][fF](?:[iI][nN][iI][tT][yY])?|[nN][aA][nN])(?!\w)"  # as C's strtof accepts
_NUMERIC = re.compile(rf"\s*[+-]?(?:{NUMBER})\s*", re.ASCII)
_INTEGER = re.compile(r"\s*[+-]?\d+\s*", re.ASCII)
_LEAST, _MOST = -(1 << 31), (1 << 31) - 1  # of 32-bit integers


def number_in(text: str) -> np.float32 | None:
    """`text` as a number, or None."""
    if not _NUMERIC.fullmatch(text):
        return None
    try:
        return np.float32(float.fromhex(text) if "x" in text.lower() else float(text))
    except OverflowError:  # only fromhex raises it
        return np.float32(-np.inf if "-" in text else np.inf)


def integer_in(text: str) -> int | None:
    """`text` as an integer, clamped to 32 bits, or None."""
    return max(_LEAST, min(_MOST, int(text))) if _INTEGER.fullmatch(text) and len(text) < 4000 else None


def shown(number: float | np.floating) -> str:
    """A number in C's %g format, which includes the sign of a NaN."""
    return f"{'-' if math.isnan(number) and np.signbit(number) else ''}{float(number):g}"


def is_true(text: str) -> bool:
    """Whether `text` is true: not 0, '', no, off or false."""
    number = number_in(text)
    return text.strip().lower() not in ("", "false", "no", "off") if number is None else bool(number != 0)


def negated(text: str) -> str:
    """`text` with the opposite sign; other strings get a '-'."""
    number = number_in(text)
    return text.strip()[1:] if number is not None and np.signbit(number) else f"-{text}"


def is_quoted(text: str) -> bool:
    """Whether it is a result of format() or FRAME_NUMBER_PAD, which is never taken for a number."""
    return len(text) >= 2 and text[0] == text[-1] == '"'


def _whole(number: np.float32) -> int:
    if not _LEAST <= float(number) <= _MOST:  # false for NaN too
        raise ParameterError(f"{shown(number)}: expected a 32-bit integer")
    return int(number)


def _whole_numbers(compute: Callable[[int, int], int]) -> Callable[[np.float32, np.float32], np.float32]:
    """`compute` on both numbers truncated to integers; 0 where the right one is 0, as in oiiotool."""

    def operator(left: np.float32, right: np.float32) -> np.float32:
        if right == 0:
            return np.float32(0)
        divisor = _whole(right)
        if divisor == 0:
            raise ParameterError(f"division by {shown(right)}, which truncates to 0")
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
    """Python's formatter, restricted to the fmt library: no attributes, conversions or extra types."""

    def get_field(self, field_name: str, args: Sequence[Value], kwargs: Mapping[str, Value]) -> tuple[Value, str]:
        if not re.fullmatch(r"[0-9]+", field_name):
            raise ValueError(f"field '{field_name}': expected a number")
        return args[int(field_name)], field_name

    def convert_field(self, value: Value, conversion: str | None) -> Value:
        if conversion is not None:
            raise ValueError(f"unknown conversion '!{conversion}'")
        return value

    def format_field(self, value: Value, format_spec: str) -> str:
        return _formatted(value, format_spec)


def filled(template: str, arguments: Sequence[str]) -> str:
    """The result of format() for a template of the fmt library and values."""
    try:
        return _Formatter().vformat(template, [_argument(text) for text in arguments], {})
    except IndexError:
        raise ParameterError(f"format(): '{template}' requires more than {len(arguments)} values") from None
    except (ValueError, OverflowError) as error:
        raise ParameterError(f"format(): {error}") from error


def _argument(text: str) -> Value:
    whole, number = integer_in(text), number_in(text)
    if whole is not None:
        return whole
    if number is None:
        return text
    return float(number) if "x" in text.lower() else float(text)  # double precision, as in oiiotool


def _formatted(value: Value, spec: str) -> str:
    """`value` in a format specification of fmt, which is stricter than Python's."""
    match = _SPEC.fullmatch(spec)
    types = "s" if isinstance(value, str) else "dxXobBc" if isinstance(value, int) else "eEfFgG"
    if match is None or match["type"] not in ("", *types):
        raise ValueError(f"specification '{spec}' does not apply to {value!r}")
    kind, precision, zero = match["type"], match["precision"] or "", match["zero"] or ""
    align = match["align"] or ""
    if isinstance(value, float):
        kind, precision = (kind, precision) if kind else ("g", precision) if precision else _shortest(value)
        if not math.isfinite(value):  # fmt aligns it left, without leading zeros
            align, zero = align or ("" if zero else "<"), ""
    elif kind == "c":
        value, kind = chr(int(value)).encode().decode(), "s"  # refuses lone surrogates
    if isinstance(value, str) and (match["sign"] or match["alternate"] or zero):
        raise ValueError(f"specification '{spec}' requires a number, not {value!r}")
    zero = "" if align else zero  # in fmt, alignment takes precedence
    flags = f"{match['fill'] or ''}{align}{match['sign'] or ''}{match['alternate'] or ''}{zero}"
    text = format(value, f"{flags}{match['width']}{precision}{kind.replace('B', 'b')}")
    return text.replace("0b", "0B", 1) if kind == "B" else text


def _shortest(number: float) -> tuple[str, str]:
    """Python's presentation type and precision for fmt's '{}'."""
    text = repr(number)
    if text.endswith(".0"):
        return "f", ".0"
    return "g", f".{len(re.sub(r'e.*|[^0-9]', '', text).lstrip('0'))}"
