# SPDX-License-Identifier: Apache-2.0
"""Attributes: those by which parts say what they hold and how they were made, and values of any from texts."""

from __future__ import annotations

import re
from typing import Any

from ..deferred import np, oiio
from ..errors import ParameterError

TAG = "oiio:ColorSpace"
OURS = "oiiotex:"  # what the names of all that follow begin with
SOURCE = "oiiotex:source"  # of an image that was made from a photo: the photo's name, and the hash of its pixels

COUNT = "oiiotex:labels"  # of a label part: how many labels it has
RHO, PARENTS = "oiiotex:rho", "oiiotex:parents"  # its scale, px; of each label the one it is part of, a level coarser
NAMES = "oiiotex:names"  # what its labels are called, a JSON list in order
SUPERPIXELS, SIGMA = "oiiotex:superpixels", "oiiotex:sigma"  # of superpixels: how many, and their scale, px
EDGES = "oiiotex:edges"  # of a Wang tile: the colors of its edges
ESTIMATE = "oiiotex:estimate"  # of what was guessed and not measured: how
HEIGHT_PX = "oiiotex:heightpx"  # of a height map: how many px a height of 1 rises above one of 0
WINDOW = "oiiotex:window"  # of a plane without end, of which the image is a part
PLANE = "oiiotex:plane"  # of a share of one: what its pixels follow from

_OF_COLORS = ("colorInteropID", "oiio:BitsPerSample", "Exif:ColorSpace", "ICCProfile")  # nothing of data
_MOST_VALUES = 65536  # of an attribute
_INT = re.compile(r"\s*[+-]?\d+\s*")
_FLOAT = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")


def note(spec: oiio.ImageSpec, name: str, value: str | float) -> None:
    """Set an attribute; whole numbers beyond 31 bits, which seeds may have, as text: neither EXR nor Python's edge of
    OpenImageIO has a type for them."""
    large = isinstance(value, int) and not -(2**31) <= value < 2**31
    spec.attribute(name, str(value) if large else value)


def mark_as_data(spec: oiio.ImageSpec) -> None:
    """Say that the channels are no colors, and forget what said that they were."""
    for attribute in _OF_COLORS:
        spec.erase_attribute(attribute)
    spec.attribute(TAG, "data")


# --- from texts, as oiiotool reads them: 3 is an int, 3.0 a float, 'a,b' with a type an array ---


def attribute_value(text: str, type_name: str | None = None) -> int | float | str | np.ndarray:
    """A text as the value of an attribute; `attribute_type` gives the type to set it with.

    Raises
    ------
    ParameterError
        The type is unknown, or the text is no value of it.
    """
    if type_name is None:
        if _INT.fullmatch(text):
            return _whole(text)
        return float(text) if _FLOAT.fullmatch(text) else text
    described = attribute_type(type_name)
    count = max(1, described.arraylen) * described.aggregate.value
    base = oiio.BASETYPE(described.basetype)
    if base == oiio.STRING:
        return text
    if str(described) == "timecode" and ":" in text:
        return _timecode(text)
    if count > _MOST_VALUES:
        raise ParameterError(f"type={type_name}: expected at most {_MOST_VALUES} values")
    words = re.split(r"[,/]" if str(described).endswith("rational") else ",", text)
    pattern, kind = (_FLOAT, np.float32) if base in (oiio.FLOAT, oiio.HALF, oiio.DOUBLE) else (_INT, _whole)
    if len(words) > count or not all(pattern.fullmatch(word) for word in words):
        raise ParameterError(f"'{text}' is no {type_name}")
    numbers = [kind(word) for word in words] + [0] * (count - len(words))
    if count == 1:
        return float(numbers[0]) if kind is np.float32 else int(numbers[0])
    whole = np.uint32 if base == oiio.UINT32 else np.int32  # OpenImageIO takes no array of the other kind, in silence
    return np.array(numbers, np.float32) if kind is np.float32 else np.array(numbers, np.int64).astype(whole)


def _whole(text: str) -> int:
    """A whole number; the nearest of 32 bits where it has more, as oiiotool takes it."""
    digits = text.strip()[:40]  # Python refuses to read thousands
    return max(-(2**31), min(2**31 - 1, int(digits)))


def _timecode(text: str) -> np.ndarray:
    """HH:MM:SS:FF as SMPTE 12M packs it: two decimal digits to a byte, frames in the lowest; and no user data."""
    match = re.fullmatch(r"(\d\d?)[:](\d\d?)[:](\d\d?)[:;](\d\d?)", text, re.ASCII)
    numbers = [int(word) for word in match.groups()] if match else [99]
    if not all(number < limit for number, limit in zip(numbers, (24, 60, 60, 60), strict=False)):
        raise ParameterError(f"'{text}' is no timecode: expected HH:MM:SS:FF, or two whole numbers with a comma")
    packed = 0
    for number in numbers:
        packed = packed << 8 | number // 10 << 4 | number % 10
    return np.array([packed, 0], np.uint32)


def attribute_type(type_name: str) -> oiio.TypeDesc:
    """The type of that name."""
    described = oiio.TypeDesc(type_name)
    if described == oiio.TypeDesc() or oiio.BASETYPE(described.basetype) == oiio.UNKNOWN:
        raise ParameterError(f"no type '{type_name}'; there is int, float, string, float[3], color, matrix ...")
    return described


def set_attribute(spec: Any, name: str, text: str, type_name: str | None = None) -> None:
    """Set an attribute of a spec from a text; raises as `attribute_value` does.

    Parameters
    ----------
    spec : oiio.ImageSpec, or what else has `attribute`
    name, text : str
    type_name : str, optional
        As OpenImageIO calls it; int, float or string, as the text looks, when left out.
    """
    require_utf8(name, text, type_name or "")
    value = attribute_value(text, type_name)
    if type_name is None:
        spec.attribute(name, value)
    else:
        spec.attribute(name, attribute_type(type_name), value)


def require_utf8(*texts: str) -> None:
    """Refuse what OpenImageIO's Python edge cannot take.

    Raises
    ------
    ParameterError
    """
    for text in texts:
        try:
            text.encode()
        except UnicodeEncodeError:
            shown = text.encode(errors="surrogateescape").decode(errors="backslashreplace")
            raise ParameterError(f"'{shown}' is not UTF-8") from None
