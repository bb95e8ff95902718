# SPDX-License-Identifier: Apache-2.0
"""What a part says of itself, through formats that would drop it: its color space, its name, how it was made.

EXR and PNG hold attributes of any name, but color spaces only of the names that they know. TIFF and JPEG hold neither;
there it goes into ImageDescription, as one line of JSON behind what stands there. Reading puts all back in its place.
"""

from __future__ import annotations

import functools
import json
import logging
import math
import os
import re
import struct
from collections.abc import Iterator, Sequence
from typing import Any

from ..core.attributes import OURS, TAG
from ..deferred import oiio

log = logging.getLogger("oiiotex")

NAME = "oiio:subimagename"
SPACE = "oiiotex:colorspace"  # in files alone
_DESCRIPTION = "ImageDescription"
_MARK = "oiiotex: {"
_MOST = 1 << 20  # characters of that line: foreign files may hold anything
_SRGB = "srgb_rec709_scene"
_SPACES = {  # that a format says for itself
    "tiff": (_SRGB,),
    "jpeg": (_SRGB,),
    "png": (_SRGB, "lin_rec709_scene", "g22_rec709_scene", "srgb_p3d65_scene"),
}
_SURROGATE = re.compile("[\ud800-\udfff]")
_TAGGING = (b"sRGB", b"gAMA", b"iCCP", b"cICP", b"cHRM")  # chunks of PNG


# --- leaving ---


def describe(spec: oiio.ImageSpec, format_name: str) -> None:
    """Have the spec say, in what the format holds, what it else would drop."""
    space = spec.get_string_attribute(TAG)
    carried: dict[str, Any] = {}
    if space and format_name in (*_SPACES, "openexr") and not _says(format_name, space):
        carried[SPACE] = space
        if format_name in _SPACES:  # they would say the next best, or sRGB; of data they say nothing
            spec.attribute(TAG, "data")
            spec.erase_attribute("Exif:ColorSpace")
    if format_name in ("openexr", "png"):
        carried |= {name: str(value) for name, value in _own(spec) if format_name == "png"}
        for name, value in carried.items():
            spec.attribute(name, value)
    elif format_name in ("tiff", "jpeg"):
        carried |= dict(_own(spec))
        name = spec.get_string_attribute(NAME)
        carried |= {NAME: name} if name else {}
        if carried:
            text = spec.get_string_attribute(_DESCRIPTION)
            line = f"oiiotex: {json.dumps(carried)}"
            spec.attribute(_DESCRIPTION, f"{text}\n{line}" if text else line)


def _own(spec: oiio.ImageSpec) -> Iterator[tuple[str, Any]]:
    """Our attributes, as far as JSON has them."""
    for attribute in spec.extra_attribs:
        if attribute.name.startswith(OURS) and isinstance(attribute.value, (str, int, float)):
            yield attribute.name, attribute.value


def is_ours(spec: oiio.ImageSpec) -> bool:
    """Whether a filter of ours has noted something in it."""
    return any(attribute.name.startswith(OURS) for attribute in spec.extra_attribs)


def _says(format_name: str, space: str) -> bool:
    """Whether a file of that format says the space by itself."""
    if format_name == "openexr":
        return bool(_names().get_color_interop_id(space))
    return any(_same(space, own) for own in _SPACES[format_name])


def _same(a: str, b: str) -> bool:
    return a == b or _names().equivalent(a, b)


@functools.cache
def _names() -> oiio.ColorConfig:
    """The config by which OpenImageIO's writers know names."""
    return oiio.ColorConfig()


# --- arriving ---


def restore(spec: oiio.ImageSpec, format_name: str, path: str) -> None:
    """Put back what `describe` has hidden, unless the file itself has been told another color space since."""
    carried: dict[str, Any] = {}
    if format_name in ("openexr", "png"):
        space = spec.get_string_attribute(SPACE)
        carried = {SPACE: space} if space else {}
        spec.erase_attribute(SPACE)
    elif format_name in ("tiff", "jpeg"):
        text, carried = _split(spec.get_string_attribute(_DESCRIPTION))
        if carried:
            spec.erase_attribute(_DESCRIPTION)
            if text:
                spec.attribute(_DESCRIPTION, text)
    for name, value in carried.items():
        if name == SPACE:
            if isinstance(value, str) and _fits(value) and not is_tagged(spec, format_name, path):
                spec.attribute(TAG, value)
        elif (name == NAME or name.startswith(OURS)) and _fits(value):
            spec.attribute(name, value)


def _split(text: str) -> tuple[str, dict[str, Any]]:
    """A description as people wrote it, and what ours says behind it; an empty dict where it says nothing."""
    at = text.rfind(_MARK)
    if at < 0 or len(text) - at > _MOST:
        return text, {}
    try:
        carried, end = json.JSONDecoder().raw_decode(text, at + len(_MARK) - 1)
    except (ValueError, RecursionError):
        return text, {}
    return (text[:at].removesuffix("\n") + text[end:]).rstrip(), carried


def _fits(value: Any) -> bool:
    """Whether an attribute can have the value."""
    if isinstance(value, str):
        return not _SURROGATE.search(value)
    if isinstance(value, float):
        return math.isfinite(value)
    return isinstance(value, int) and not isinstance(value, bool) and -(2**31) <= value < 2**31


def is_tagged(spec: oiio.ImageSpec, format_name: str, path: str) -> bool:
    """Whether the file says its color space, and OpenImageIO does not only assume one, as it does for JPEG and PNG."""
    if not spec.get_string_attribute(TAG):
        return False
    if format_name == "png":
        return _png_is_tagged(path)
    if format_name in ("jpeg", "tiff"):
        return spec.getattribute("Exif:ColorSpace") is not None or spec.getattribute("ICCProfile") is not None
    return format_name in ("openexr", "dpx", "cineon", "jpegxl")


def _png_is_tagged(path: str) -> bool:
    try:
        with open(path, "rb") as file:
            file.seek(8)
            while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
                if head[4:] in _TAGGING:
                    return True
                file.seek(struct.unpack(">I", head[:4])[0] + 4, os.SEEK_CUR)
    except OSError:
        pass  # whoever reads the pixels says why they cannot be
    return False


# --- what got lost ---


def warn_of_loss(
    path: object, format_name: str, wanted: Sequence[oiio.ImageSpec], arrived: Sequence[oiio.ImageSpec]
) -> None:
    """Warn, in one line, of what the parts of a file do not say of what they should, or say otherwise.

    Of what oiiotool would write alike, only that colors would be taken for others.
    """
    pairs = zip(wanted, arrived, strict=False)  # what a format holds of further parts has been said before
    missing = dict.fromkeys(loss for want, have in pairs for loss in _lost(want, have))
    if missing:
        log.warning("%s: %s cannot say %s", path, format_name, ", nor ".join(missing))


def _lost(wanted: oiio.ImageSpec, arrived: oiio.ImageSpec) -> Iterator[str]:
    read, space = arrived.get_string_attribute(TAG), wanted.get_string_attribute(TAG)
    if space and (read or is_ours(wanted) or not _same(space, _SRGB)) and not (read and _same(space, read)):
        yield f"the color space {space}" + (f" (read, it is {read})" if read else "")
    # EXR has no empty texts
    names = [name for name, value in _own(wanted) if value != "" and arrived.getattribute(name) is None]
    if names:
        yield f"how it was made ({', '.join(names)})"
