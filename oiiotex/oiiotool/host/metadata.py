# SPDX-License-Identifier: Apache-2.0
"""Metadata, orientation and windows: ops that change no pixel."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ...engine.core.access import Pointwise
from ...engine.core.attributes import set_attribute
from ...engine.core.image import Image, Part, copied
from ...engine.core.parameters import argument, image, param
from ...engine.core.tiling import tiling_of
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import ImageError, ParameterError
from ...engine.io.documents import read_text, require_regular
from ...engine.patterns import pattern_of
from ...engine.session.facts import Facts
from .geometry_text import box_of, parse_box, parse_offset
from .kinds import HostOp, Respec, op

_CLOCKWISE = (0, 6, 7, 8, 5, 2, 3, 4, 1)  # an Exif orientation after a quarter turn clockwise
_PROFILE_LIMIT = 64 << 20


# --- attributes ---


def _set(spec: oiio.ImageSpec, name: str, value: str, *type: str | None) -> None:
    """Set an attribute of a type, else a string; erase it if the value is empty."""
    if not value:
        spec.erase_attribute(name)
    elif type:
        set_attribute(spec, name, value, *type)
    else:
        spec.attribute(name, value)


def _erase(spec: oiio.ImageSpec, pattern: str, fromfile: bool) -> None:
    """Erase attributes that match one pattern, or any pattern in a file."""
    patterns = [pattern]
    if fromfile:
        try:
            patterns = read_text(Path(pattern)).splitlines()
        except ImageError as error:
            raise ParameterError(f"cannot read patterns: {error}") from None
    for each in filter(None, patterns):
        pattern_of(each)
        spec.erase_attribute(each)


def _add_keyword(spec: oiio.ImageSpec, keyword: str) -> None:
    """Append a keyword."""
    old = spec.get_string_attribute("Keywords")
    words = [word.strip() for word in old.split(";")] if old else []
    if keyword and keyword not in words:
        spec.attribute("Keywords", "; ".join([*words, keyword]))


def _set_cicp(spec: oiio.ImageSpec, given: str) -> None:
    """Set or erase the CICP codes."""
    if not given:
        spec.erase_attribute("CICP")
        return
    old = spec.getattribute("CICP", oiio.TypeDesc("int[4]"))
    codes = [0, 0, 0, 1] if old is None else [int(code) for code in old]
    words = [word.strip() for word in given.split(",")]
    if len(words) > 4 or not all(word.isascii() and word.isdigit() for word in filter(None, words)):
        raise ParameterError(parameter="codes", value=given, expected="up to four comma-separated integers")
    for place, word in enumerate(words):
        codes[place] = int(word) if word else codes[place]
    spec.attribute("CICP", oiio.TypeDesc("int[4]"), tuple(codes))


def _read_profile(spec: oiio.ImageSpec, file: str) -> None:
    """Set the ICC profile."""
    require_regular(file)
    try:
        profile = Path(file).read_bytes()
    except OSError as error:
        raise ImageError(f"{file}: cannot read the ICC profile: {error.strerror}") from None
    if not 0 < len(profile) < _PROFILE_LIMIT:
        raise ImageError(f"{file}: not an ICC profile ({len(profile)} bytes)")
    spec.attribute("ICCProfile", oiio.TypeDesc(f"uint8[{len(profile)}]"), np.frombuffer(profile, np.uint8))


@dataclass(frozen=True, kw_only=True)
class PasteMetadata(HostOp, Pointwise):
    """Copy the metadata of the first image to the second."""

    name: ClassVar[str] = "pastemeta"

    metadata: Image = image(help="Image with the metadata.")
    pixels: Image = image(help="Image with the pixels.")
    merge: int = param(
        0,
        ge=0,
        le=2,
        help="Treatment of the second image's own metadata. 0: it is removed; 1: it is kept, and takes precedence;"
        " 2: it is kept, but the first image's metadata takes precedence.",
    )
    pattern: str = param(
        "", help="Basic regular expression that selects the attributes to copy by name.", example="Exif:"
    )

    def inputs(self) -> list[Image]:
        """The second image first: the result has its parts."""
        return [self.pixels, self.metadata]

    def tiling(self, parts: Sequence[Part], made: Part) -> str:
        """As the copied metadata say."""
        return tiling_of(made.spec)

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The second image's pixels with the new spec."""
        pixels, metadata = parts
        corner = Window.sized(pixels.spec.x, pixels.spec.y, 1, 1)
        merged, source = (oiio.ImageBuf(corner.apply_to(part.spec)) for part in (pixels, metadata))
        if self.merge == 0:
            merged.specmod().erase_attribute(".*")
        try:
            merged.merge_metadata(source, self.merge > 1, self.pattern)
        except RuntimeError as error:
            raise ParameterError(
                str(error), parameter="pattern", value=self.pattern, expected="a basic regular expression"
            ) from None
        spec = pixels.window.apply_to(merged.spec())
        spec.set_format(pixels.spec.format)
        spec.channelformats = pixels.spec.channelformats
        place = next(n for n, part in enumerate(self.pixels.parts) if part is pixels)
        name = spec.get_string_attribute("oiio:subimagename") or f"part{place}"
        return dataclasses.replace(copied(spec, pixels.fetch, pixels), name=name)


# --- orientation and windows ---


def _turn(name: str, help: str, turns: int, alias: str) -> type[HostOp]:
    """An op that turns a valid orientation by quarter turns."""

    def turn(spec: oiio.ImageSpec) -> None:
        orientation = spec.get_int_attribute("Orientation", 1)
        if 1 <= orientation <= 8:
            for _ in range(turns):
                orientation = _CLOCKWISE[orientation]
            spec.attribute("Orientation", orientation)

    return op(name, f"Rotate the orientation metadata by {help}; pixels do not change.", Respec, turn, aliases=(alias,))


def _set_origin(spec: oiio.ImageSpec, place: str) -> None:
    """Move the corner of the data window to `place`."""
    spec.x, spec.y = Window.sized(*parse_offset(place), spec.width, spec.height).in_range()[:2]


def _move_origin(spec: oiio.ImageSpec, offset: str) -> None:
    """Shift the data window."""
    spec.x, spec.y = Window.data(spec).shifted(*parse_offset(offset)).in_range()[:2]


def _set_display_window(spec: oiio.ImageSpec, size: str) -> None:
    """Set the display window."""
    window = parse_box(size, box_of(Window.display(spec))).window()
    if window.empty:
        raise ParameterError(parameter="size", value=size, expected="a display window of at least one pixel")
    window.show_in(spec)


def _text(help: str, example: str) -> Any:
    """A string argument."""
    return str, argument(help=help, example=example)


_ATTRIBUTE = {
    "attribute": _text("Name of the attribute.", "Copyright"),
    "value": _text("Value of the attribute. An empty string erases the attribute.", "Studio"),
}

METADATA = (
    op("attrib", "Set an attribute.", Respec, _set, **_ATTRIBUTE,
       type=(str | None, param(None, unset="derived from the value", example="float[3]",
                               help="Type of the attribute, such as int, float, string or float[3]."))),
    op("sattrib", "Set a string attribute.", Respec, _set, **_ATTRIBUTE),
    op("eraseattrib", "Erase attributes whose full name matches a pattern.", Respec, _erase,
       pattern=_text("Basic regular expression, or with fromfile a file with one expression per line.", "Exif:.*"),
       fromfile=param(False, help="Read the patterns from a file.")),
    op("caption", "Set the caption (ImageDescription); an empty string erases it.", Respec,
       lambda spec, text: _set(spec, "ImageDescription", text), text=_text("Caption.", "Oak bark")),
    op("keyword", "Add a keyword.", Respec, _add_keyword, keyword=_text("Keyword.", "bark")),
    op("clear-keywords", "Remove all keywords.", Respec, lambda spec: spec.erase_attribute("Keywords")),
    op("orientation", "Set the orientation metadata; pixels do not change.", Respec,
       lambda spec, orientation: spec.attribute("Orientation", orientation),
       orientation=(int, argument(ge=1, le=8, example="6", help="Exif code: 1 upright, 3 to rotate by 180 degrees,"
                                                                " 6 by 90 clockwise, 8 by 90 counterclockwise."))),
    _turn("orientcw", "90 degrees clockwise", 1, "--rotcw"),
    _turn("orientccw", "90 degrees counterclockwise", 3, "--rotccw"),
    _turn("orient180", "180 degrees", 2, "--rot180"),
    op("origin", "Set the origin of the data window.", Respec, _set_origin, place=_text("Origin +X+Y.", "+20+10")),
    op("originoffset", "Offset the data window from its current origin.", Respec, _move_origin,
       offset=_text("Offset +X+Y.", "+20-10")),
    op("fullsize", "Set the display window.", Respec, _set_display_window,
       size=_text("Display window: WxH, WxH+X+Y, X0,Y0,X1,Y1 or +X+Y.", "1920x1080")),
    op("fullpixels", "Set the display window to the data window.", Respec,
       lambda spec: Window.data(spec).show_in(spec)),
    op("cicp", "Set the CICP metadata (ITU-T H.273): primaries, transfer, matrix, full range.", Respec, _set_cicp,
       codes=_text("Up to four comma-separated codes. Empty or missing ones are kept, initially 0,0,0,1. An empty"
                   " string erases the metadata.", "1,13,0,1")),
    op("iccread", "Set the image's ICC profile from a file.", Respec, _read_profile,
       file=_text("File of the profile.", "display.icc")),
    PasteMetadata,
)  # fmt: skip
