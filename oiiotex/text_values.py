# SPDX-License-Identifier: Apache-2.0
"""Values of metadata from texts, as oiiotool reads them: 3 is an int, 3.0 a float, 'a,b' with a type an array."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import OpenImageIO as oiio

from .errors import ParameterError

_INT = re.compile(r"\s*[+-]?\d+\s*")
_FLOAT = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")


def attribute_value(text: str, type_name: str | None = None) -> int | float | str | np.ndarray:
    """A text as the value of an attribute; `attribute_type` gives the type to set it with.

    Raises
    ------
    ParameterError
        The type is unknown, or the text is no value of it.
    """
    if type_name is None:
        if _INT.fullmatch(text):
            return int(text)
        return float(text) if _FLOAT.fullmatch(text) else text
    described = attribute_type(type_name)
    count = max(1, described.arraylen) * described.aggregate.value
    base = oiio.BASETYPE(described.basetype)
    if base == oiio.STRING:
        return text
    if str(described) == "timecode" and ":" in text:
        raise ParameterError(f"'{text}': give a timecode as two whole numbers with a comma between them")
    words = re.split(r"[,/]" if str(described).endswith("rational") else ",", text)
    pattern, kind = (_FLOAT, np.float32) if base in (oiio.FLOAT, oiio.HALF, oiio.DOUBLE) else (_INT, np.int64)
    if len(words) > count or not all(pattern.fullmatch(word) for word in words):
        raise ParameterError(f"'{text}' is no {type_name}")
    numbers = [kind(word) for word in words] + [kind(0)] * (count - len(words))
    if count == 1:
        return float(numbers[0]) if kind is np.float32 else int(numbers[0])
    return np.array(numbers, np.float32 if kind is np.float32 else np.int32)


def attribute_type(type_name: str) -> oiio.TypeDesc:
    """The type of that name.

    Raises
    ------
    ParameterError
        There is none.
    """
    described = oiio.TypeDesc(type_name)
    if described == oiio.TypeDesc() or oiio.BASETYPE(described.basetype) == oiio.UNKNOWN:
        raise ParameterError(f"no type '{type_name}'; there is int, float, string, float[3], color, matrix ...")
    return described


def set_attribute(spec: Any, name: str, text: str, type_name: str | None = None) -> None:
    """Set an attribute of a spec from a text; raises as `attribute_value` does."""
    value = attribute_value(text, type_name)
    if type_name is None:
        spec.attribute(name, value)
    else:
        spec.attribute(name, attribute_type(type_name), value)
