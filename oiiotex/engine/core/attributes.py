# SPDX-License-Identifier: Apache-2.0
"""Attributes: the names of ours, and values parsed from strings."""

from __future__ import annotations

import re
from typing import Any

from ..deferred import np, oiio
from ..errors import ParameterError

TAG = "oiio:ColorSpace"
UNKNOWN = "Rec709"  # OpenImageIO's tag of all PNM files; the configs do not know the name
OURS = "oiiotex:"  # prefix of all following names
SOURCE = "oiiotex:source"  # of a synthesized image: name of the photo, and hash of its pixels
FILTER = "oiiotex:filter"  # of every result: the name of its op
PARAMETERS = "oiiotex:parameters"  # of every result: the modifiers of its op

COUNT = "oiiotex:labels"  # of a label part: number of labels
RHO, PARENTS = "oiiotex:rho", "oiiotex:parents"  # its scale, px; of each label, its parents on the next coarser level
NAMES = "oiiotex:names"  # names of its labels, a JSON list in order
SUPERPIXELS, SIGMA = "oiiotex:superpixels", "oiiotex:sigma"  # of superpixels: number, and scale, px
EDGES = "oiiotex:edges"  # of a Wang tile: the colors of its edges
ATLAS = "oiiotex:atlas"  # of an atlas of Wang tiles: columns x rows
ESTIMATE = "oiiotex:estimate"  # of estimated maps: the method
HEIGHT_PX = "oiiotex:heightpx"  # of a height map: px between heights 0 and 1
WINDOW = "oiiotex:window"  # of an image that is part of an unbounded plane
PROVISIONAL = "oiiotex:provisional"  # of parts whose windows, channels or number are not final

_OF_COLORS = (  # what a file says of its colors, in addition to TAG
    "colorInteropID", "chromaticities", "whiteLuminance", "ICCProfile", "ICCProfile:.*", "CICP", "Exif:ColorSpace",
    "oiio:Gamma", "oiio:AverageColor", "oiio:ConstantColor", "AverageColor", "ConstantColor",
)  # fmt: skip
_MOST_VALUES = 65536  # of an attribute
_INT = re.compile(r"\s*[+-]?\d+\s*")
_FLOAT = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")


def note(spec: oiio.ImageSpec, name: str, value: str | float) -> None:
    """Set an attribute; integers beyond 31 bits, such as seeds, become strings, as EXR has no type for them."""
    large = isinstance(value, int) and not -(2**31) <= value < 2**31
    spec.attribute(name, str(value) if large else value)


def tag_colors(spec: oiio.ImageSpec, space: str) -> None:
    """Tag the pixels with a color space, or with none if it is empty, and remove what may no longer be true of them."""
    for attribute in (*_OF_COLORS, TAG):
        spec.erase_attribute(attribute)
    if space:
        spec.attribute(TAG, space)


def mark_as_data(spec: oiio.ImageSpec) -> None:
    """Tag the channels as data, and remove attributes about color."""
    tag_colors(spec, "data")
    spec.erase_attribute("oiio:BitsPerSample")


# --- from strings, as in oiiotool: 3 is an int, 3.0 a float, 'a,b' with a type an array ---


def attribute_value(text: str, type_name: str | None = None) -> int | float | str | np.ndarray:
    """The value of an attribute, parsed from a string; `attribute_type` gives its type.

    Raises
    ------
    ParameterError
        The type is unknown, or the string is not a value of it.
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
        raise ParameterError(f"'{text}' is not of type {type_name}")
    numbers = [kind(word) for word in words] + [0] * (count - len(words))
    if count == 1:
        return float(numbers[0]) if kind is np.float32 else int(numbers[0])
    whole = np.uint32 if base == oiio.UINT32 else np.int32  # OpenImageIO silently ignores arrays of the other kind
    return np.array(numbers, np.float32) if kind is np.float32 else np.array(numbers, np.int64).astype(whole)


def _whole(text: str) -> int:
    """An integer, clamped to 32 bits as in oiiotool."""
    digits = text.strip()[:40]  # Python limits the number of digits
    return max(-(2**31), min(2**31 - 1, int(digits)))


def _timecode(text: str) -> np.ndarray:
    """HH:MM:SS:FF packed as in SMPTE 12M: two decimal digits per byte, frames in the lowest; no user data."""
    match = re.fullmatch(r"(\d\d?)[:](\d\d?)[:](\d\d?)[:;](\d\d?)", text, re.ASCII)
    numbers = [int(word) for word in match.groups()] if match else [99]
    if not all(number < limit for number, limit in zip(numbers, (24, 60, 60, 60), strict=False)):
        raise ParameterError(f"'{text}' is not a timecode: expected HH:MM:SS:FF, or two comma-separated integers")
    packed = 0
    for number in numbers:
        packed = packed << 8 | number // 10 << 4 | number % 10
    return np.array([packed, 0], np.uint32)


def attribute_type(type_name: str) -> oiio.TypeDesc:
    """The type of that name."""
    described = oiio.TypeDesc(type_name)
    if described == oiio.TypeDesc() or oiio.BASETYPE(described.basetype) == oiio.UNKNOWN:
        raise ParameterError(f"unknown type '{type_name}': expected int, float, string, float[3], color, matrix ...")
    return described


def set_attribute(spec: Any, name: str, text: str, type_name: str | None = None) -> None:
    """Set an attribute of a spec from a string; raises as `attribute_value` does.

    Parameters
    ----------
    spec : oiio.ImageSpec, or another object with `attribute`
    name, text : str
    type_name : str, optional
        An OpenImageIO type. Default: int, float or string, depending on the text.
    """
    require_utf8(name, text, type_name or "")
    value = attribute_value(text, type_name)
    if type_name is None:
        spec.attribute(name, value)
    else:
        spec.attribute(name, attribute_type(type_name), value)


def require_utf8(*texts: str) -> None:
    """Refuse strings that OpenImageIO's Python bindings cannot encode.

    Raises
    ------
    ParameterError
    """
    for text in texts:
        try:
            text.encode()
        except UnicodeEncodeError:
            raise ParameterError(f"'{as_utf8(text)}' is not UTF-8") from None


def as_utf8(text: str) -> str:
    """Text of a file or of the command line in UTF-8: other bytes are spelled out, as in \\xe9t\\xe9."""
    return text.encode(errors="surrogateescape").decode(errors="backslashreplace")
