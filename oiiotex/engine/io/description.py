# SPDX-License-Identifier: Apache-2.0
"""Metadata of a part in formats that would drop it: its color space, its name, how it was made.

EXR and PNG hold arbitrary attributes, but only color spaces that they know. TIFF and JPEG hold neither: there the
metadata is a line of JSON at the end of ImageDescription. Reading restores all of it.
"""

from __future__ import annotations

import json
import logging
import math
import re
import struct
from collections.abc import Iterator, Sequence
from typing import Any

from ..core.attributes import OURS, TAG, UNKNOWN, as_utf8
from ..deferred import oiio
from ..errors import present
from .evidence import UNCALIBRATED, contradicted, evidence_in
from .icc import ADOBE, REC709

log = logging.getLogger("oiiotex")

NAME = "oiio:subimagename"
SPACE = "oiiotex:colorspace"  # only in files
_DESCRIPTION = "ImageDescription"
_MARK = "oiiotex: {"
_MOST = 1 << 20  # longest line of JSON, characters: foreign files may hold anything
_SRGB = "srgb_rec709_scene"
_SPACES = {  # that a format can tag itself
    "tiff": (_SRGB,),
    "jpeg": (_SRGB,),
    "png": (_SRGB, "lin_rec709_scene", "g22_rec709_scene", "srgb_p3d65_scene"),
}
_ROUNDING = 0.002  # largest difference of chromaticities that are the same
_SURROGATE = re.compile("[\ud800-\udfff]")
_SEGMENT = 1 << 16  # largest segment of a JPEG file
_INTEROPERABILITY = (0x8769, 0xA005)  # Exif's pointers to the directory with the index
_TAGGING = (b"sRGB", b"gAMA", b"iCCP", b"cICP", b"cHRM")  # chunks of PNG


# --- writing ---


def describe(spec: oiio.ImageSpec, format_name: str) -> None:
    """Add attributes that carry the metadata which the format would drop."""
    space = spec.get_string_attribute(TAG)
    carried: dict[str, Any] = {}
    if space and format_name in (*_SPACES, "openexr") and not _says(format_name, space):
        carried[SPACE] = space
        if format_name in _SPACES:  # these formats would tag the nearest space, or sRGB; they do not tag data
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
            text = as_utf8(spec.get_string_attribute(_DESCRIPTION))
            line = f"oiiotex: {json.dumps(carried)}"
            spec.attribute(_DESCRIPTION, f"{text}\n{line}" if text else line)


def keep_true(spec: oiio.ImageSpec, format_name: str) -> None:
    """Keep untagged values from being read as others: EXR's chromaticities are of linear ones, JPEG is sRGB."""
    if spec.get_string_attribute(TAG) or spec.getattribute("chromaticities") is None:
        return
    if format_name == "openexr" and spec.get_float_attribute("oiio:Gamma", 1.0) != 1:
        spec.erase_attribute("chromaticities")
    elif format_name in ("jpeg", "png") and contradicted(spec):
        spec.attribute("Exif:ColorSpace", UNCALIBRATED)


def _own(spec: oiio.ImageSpec) -> Iterator[tuple[str, Any]]:
    """Our attributes, of types that JSON has."""
    for attribute in spec.extra_attribs:
        readable = isinstance(attribute.value, (str, int, float)) and not _SURROGATE.search(attribute.name)
        if attribute.name.startswith(OURS) and readable:
            yield attribute.name, attribute.value


def is_ours(spec: oiio.ImageSpec) -> bool:
    """Whether the spec has attributes of our filters."""
    return any(attribute.name.startswith(OURS) for attribute in spec.extra_attribs)


def _says(format_name: str, space: str) -> bool:
    """Whether the format has a tag for this color space."""
    if format_name == "openexr":
        return bool(_names().get_color_interop_id(space))
    return any(_same(space, own) for own in _SPACES[format_name])


def _same(a: str, b: str) -> bool:
    return a == b or _names().equivalent(a, b)


def _encoded_alike(a: str, b: str) -> bool:
    """Whether two spaces have the same code values; files do not tell sRGB for a display from sRGB of a scene."""
    if _same(a, b):  # the usual case: the first identifier that is asked for takes 20 ms
        return True
    ids = [_names().get_color_interop_id(name).rpartition("_")[0] for name in (a, b)]
    return bool(ids[0] and ids[0] == ids[1])


def _names() -> oiio.ColorConfig:
    """The config by which OpenImageIO's writers know names: theirs, which they have loaded or will."""
    return oiio.ColorConfig.default_colorconfig()


# --- reading ---


def restore(spec: oiio.ImageSpec, format_name: str, path: str) -> None:
    """Restore what `describe` added, unless the file has been tagged with another color space since.

    A tag that the reader assumed is removed if the file says otherwise: by its profile, CICP, chromaticities or Exif.
    """
    if format_name == "png":
        _read_chromaticities(spec, path)
    elif spec.get_int_attribute("Exif:ColorSpace") == UNCALIBRATED and _is_optional_of_dcf(path):
        _set_chromaticities(spec, ADOBE, 2.2)
    if _same(spec.get_string_attribute(TAG), _SRGB) and contradicted(spec):
        spec.erase_attribute(TAG)
    carried: dict[str, Any] = {}
    if format_name in ("openexr", "png"):
        space = spec.get_string_attribute(SPACE)
        carried = {SPACE: space} if space else {}
        spec.erase_attribute(SPACE)
    elif format_name in ("tiff", "jpeg"):
        text, carried = _split(as_utf8(spec.get_string_attribute(_DESCRIPTION)))
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
    """A description without our line of JSON, and the line's contents; an empty dict without such a line."""
    at = text.rfind(_MARK)
    if at < 0 or len(text) - at > _MOST:
        return text, {}
    try:
        carried, end = json.JSONDecoder().raw_decode(text, at + len(_MARK) - 1)
    except (ValueError, RecursionError):
        return text, {}
    return (text[:at].removesuffix("\n") + text[end:]).rstrip(), carried


def _fits(value: Any) -> bool:
    """Whether the value is valid for an attribute."""
    if isinstance(value, str):
        return not _SURROGATE.search(value)
    if isinstance(value, float):
        return math.isfinite(value)
    return isinstance(value, int) and not isinstance(value, bool) and -(2**31) <= value < 2**31


def is_tagged(spec: oiio.ImageSpec, format_name: str, path: str) -> bool:
    """Whether the file itself is tagged; for JPEG and PNG OpenImageIO otherwise assumes a color space."""
    if not spec.get_string_attribute(TAG):
        return False
    if format_name == "png":
        return bool(_png_chunks(path))
    if format_name in ("jpeg", "tiff"):
        return spec.getattribute("Exif:ColorSpace") is not None or spec.getattribute("ICCProfile") is not None
    return format_name in ("openexr", "dpx", "cineon", "jpegxl")


def _png_chunks(path: str) -> dict[bytes, bytes]:
    """The chunks of a PNG file that describe its colors; of long ones only the beginning."""
    chunks = {}
    try:
        with open(path, "rb") as file:
            file.seek(8)
            while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
                (size,) = struct.unpack(">I", head[:4])
                after = file.tell() + size + 4
                if head[4:] in _TAGGING:
                    chunks[head[4:]] = file.read(min(size, 64))
                file.seek(after)
    except OSError:
        pass  # reading the pixels reports the error
    return chunks


def _read_chromaticities(spec: oiio.ImageSpec, path: str) -> None:
    """Add the chromaticities of a PNG file, which OpenImageIO ignores, with the order of EXR: red, green, blue, white.

    They count only with a gamma, and without a better description (PNG, third edition, 4.3).
    """
    chunks = _png_chunks(path)
    if len(chunks.get(b"cHRM", b"")) != 32 or b"gAMA" not in chunks or {b"cICP", b"iCCP", b"sRGB"} & set(chunks):
        return
    white_x, white_y, *primaries = (n / 100000 for n in struct.unpack(">8I", chunks[b"cHRM"]))
    values = (*primaries, white_x, white_y)
    if max(abs(value - own) for value, own in zip(values, REC709, strict=True)) > _ROUNDING:
        _set_chromaticities(spec, values, spec.get_float_attribute("oiio:Gamma", 1.0))


def _set_chromaticities(spec: oiio.ImageSpec, values: Sequence[float], gamma: float) -> None:
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), tuple(values))
    spec.attribute("oiio:Gamma", gamma)
    spec.erase_attribute(TAG)


def _is_optional_of_dcf(path: str) -> bool:
    """Whether a camera's JPEG has the optional space of DCF 2.0 (Adobe RGB): Exif's interoperability index R03."""
    try:
        with open(path, "rb") as file:
            exif = file.read(2 * _SEGMENT).partition(b"Exif\0\0")[2]
        order = {b"II": "<", b"MM": ">"}[exif[:2]]
        (place,) = struct.unpack_from(f"{order}I", exif, 4)
        for pointer in _INTEROPERABILITY:
            (place,) = struct.unpack(f"{order}I", _tiff_entries(exif, order, place)[pointer])
        return _tiff_entries(exif, order, place)[1] == b"R03\0"
    except (OSError, KeyError, struct.error):
        return False


def _tiff_entries(data: bytes, order: str, place: int) -> dict[int, bytes]:
    """The values of a directory of TIFF, by their tags; of long ones their offsets."""
    (count,) = struct.unpack_from(f"{order}H", data, place)
    entries = (struct.unpack_from(f"{order}HHI4s", data, place + 2 + 12 * n) for n in range(count))
    return {tag: value for tag, _, _, value in entries}


# --- lost metadata ---


def warn_of_loss(
    path: object, format_name: str, wanted: Sequence[oiio.ImageSpec], arrived: Sequence[oiio.ImageSpec]
) -> None:
    """Warn, in one line, of metadata that a written file lacks or has changed.

    For files that oiiotool would write alike, only of a wrong color space.
    """
    pairs = zip(wanted, arrived, strict=False)  # a format's limit of parts has been reported before
    missing = dict.fromkeys(loss for want, have in pairs for loss in _lost(want, have))
    if missing:
        log.warning("%s: %s cannot store %s", path, format_name, " or ".join(missing))


def _lost(wanted: oiio.ImageSpec, arrived: oiio.ImageSpec) -> Iterator[str]:
    read, space = arrived.get_string_attribute(TAG), wanted.get_string_attribute(TAG)
    described = not read and arrived.getattribute("ICCProfile") is not None
    if space == UNKNOWN or described:
        space = ""
    if read and not space and contradicted(wanted):
        yield f"{present(evidence_in(wanted)).text} (it is read as {read})"
    if space and (read or is_ours(wanted) or not _same(space, _SRGB)) and not (read and _encoded_alike(space, read)):
        yield f"the color space {space}" + (f" (it is read as {read})" if read else "")
    # EXR has no empty strings
    names = [name for name, value in _own(wanted) if value != "" and arrived.getattribute(name) is None]
    if names:
        yield f"how it was made ({', '.join(names)})"
