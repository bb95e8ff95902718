# SPDX-License-Identifier: Apache-2.0
"""Metadata, and windows without pixels."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..core.access import Pointwise
from ..core.attributes import set_attribute
from ..core.image import Image, Part
from ..core.parameters import argument, image, param
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError, ParameterError
from ..io.documents import require_regular
from ..session import Session
from .geometry_text import box_of, parse_box, parse_offset
from .kinds import HostOp, Respec, op, worked

_CLOCKWISE = (0, 6, 7, 8, 5, 2, 3, 4, 1)  # what an Exif orientation becomes by a quarter turn
_PROFILE_LIMIT = 64 << 20


# --- attributes ---


def _set(spec: oiio.ImageSpec, name: str, value: str, *type: str | None) -> None:
    """Set an attribute, of a type or else a text; erase it where the value is empty."""
    if not value:
        spec.erase_attribute(name)
    elif type:
        set_attribute(spec, name, value, *type)
    else:
        spec.attribute(name, value)


def _erase(spec: oiio.ImageSpec, pattern: str, fromfile: bool) -> None:
    """Erase attributes by one pattern, or by those of a file."""
    patterns = [pattern]
    if fromfile:
        try:
            patterns = Path(pattern).read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise ParameterError(f"{pattern}: no file of patterns can be read: {error}") from None
    for each in filter(None, patterns):
        spec.erase_attribute(each)


def _add_keyword(spec: oiio.ImageSpec, keyword: str) -> None:
    """Append it to those there are."""
    old = spec.get_string_attribute("Keywords")
    words = [word.strip() for word in old.split(";")] if old else []
    if keyword and keyword not in words:
        spec.attribute("Keywords", "; ".join([*words, keyword]))


def _set_cicp(spec: oiio.ImageSpec, given: str) -> None:
    """Set or erase the codes."""
    if not given:
        spec.erase_attribute("CICP")
        return
    old = spec.getattribute("CICP", oiio.TypeDesc("int[4]"))
    codes = [0, 0, 0, 1] if old is None else [int(code) for code in old]
    words = [word.strip() for word in given.split(",")]
    if len(words) > 4 or not all(word.isascii() and word.isdigit() for word in filter(None, words)):
        raise ParameterError(f"codes={given}: allowed are up to four whole numbers with commas between them")
    for place, word in enumerate(words):
        codes[place] = int(word) if word else codes[place]
    spec.attribute("CICP", oiio.TypeDesc("int[4]"), tuple(codes))


def _read_profile(spec: oiio.ImageSpec, file: str) -> None:
    """Set the profile."""
    require_regular(file)
    try:
        profile = Path(file).read_bytes()
    except OSError as error:
        raise ImageError(f"{file}: the profile cannot be read: {error.strerror}") from None
    if not 0 < len(profile) < _PROFILE_LIMIT:
        raise ImageError(f"{file}: {len(profile)} bytes are no ICC profile")
    spec.attribute("ICCProfile", oiio.TypeDesc(f"uint8[{len(profile)}]"), np.frombuffer(profile, np.uint8))


@dataclass(frozen=True, kw_only=True)
class PasteMetadata(HostOp, Pointwise):
    """Give the second image the metadata of the first."""

    name: ClassVar[str] = "pastemeta"

    metadata: Image = image(help="whose metadata is taken")
    pixels: Image = image(help="whose pixels are taken")
    merge: int = param(
        0,
        ge=0,
        le=2,
        help="0: the second's own metadata is dropped; 1: it stays, and goes before; 2: it stays, and goes after",
    )
    pattern: str = param("", help="only attributes with a match of this basic regular expression in their name")

    def inputs(self) -> list[Image]:
        """The second image first: its parts are those of the result."""
        return [self.pixels, self.metadata]

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The second's pixels under their new spec."""
        pixels, metadata = parts
        corner = Window.sized(pixels.spec.x, pixels.spec.y, 1, 1)
        merged, source = (oiio.ImageBuf(corner.apply_to(part.spec)) for part in (pixels, metadata))
        if self.merge == 0:
            merged.specmod().erase_attribute(".*")
        try:
            merged.merge_metadata(source, self.merge > 1, self.pattern)
        except RuntimeError as error:
            raise ParameterError(f"pattern={self.pattern}: no regular expression: {error}") from None
        computed = worked(pixels)
        spec = computed.window.apply_to(merged.spec())
        spec.set_format(computed.spec.format)
        place = next(n for n, part in enumerate(self.pixels.parts) if part is pixels)
        name = spec.get_string_attribute("oiio:subimagename") or f"part{place}"
        return dataclasses.replace(computed, name=name, spec=spec)


# --- orientation and windows ---


def _turn(name: str, help: str, turns: int, alias: str) -> type[HostOp]:
    """An op that changes the orientation, if it is one, by quarter turns."""

    def turn(spec: oiio.ImageSpec) -> None:
        orientation = spec.get_int_attribute("Orientation", 1)
        if 1 <= orientation <= 8:
            for _ in range(turns):
                orientation = _CLOCKWISE[orientation]
            spec.attribute("Orientation", orientation)

    return op(name, f"Turn the orientation {help}; pixels stay.", Respec, turn, aliases=(alias,))


def _set_origin(spec: oiio.ImageSpec, place: str) -> None:
    """Put the data window's corner there."""
    spec.x, spec.y = Window.sized(*parse_offset(place), spec.width, spec.height).in_range()[:2]


def _move_origin(spec: oiio.ImageSpec, offset: str) -> None:
    """Shift the data window."""
    spec.x, spec.y = Window.data(spec).shifted(*parse_offset(offset)).in_range()[:2]


def _set_display_window(spec: oiio.ImageSpec, size: str) -> None:
    """Set it, unless it is empty."""
    window = parse_box(size, box_of(Window.display(spec))).window()
    if window.empty:
        raise ParameterError(f"size={size}: the display window would have no pixel")
    window.show_in(spec)


def _text(help: str) -> Any:
    """A parameter: a text behind the op."""
    return str, argument(help=help)


_ATTRIBUTE = {"attribute": _text("its name"), "value": _text("its value")}

METADATA = (
    op("attrib", "Set an attribute; an empty value erases it.", Respec, _set, **_ATTRIBUTE,
       type=(str | None, param(
           None, help="its type: int, float, string, float[3] ...; by the look of the value when left out"))),
    op("sattrib", "Set an attribute that is text; an empty one erases it.", Respec, _set, **_ATTRIBUTE),
    op("eraseattrib", "Erase the attributes whose whole name matches a pattern.", Respec, _erase,
       pattern=_text("a basic regular expression, or with fromfile a file with one in every line"),
       fromfile=param(False, help="read the patterns from a file")),
    op("caption", "Set the caption (ImageDescription); an empty one erases it.", Respec,
       lambda spec, text: _set(spec, "ImageDescription", text), text=_text("the caption")),
    op("keyword", "Add a keyword, unless it is there.", Respec, _add_keyword, keyword=_text("the keyword")),
    op("clear-keywords", "Drop all keywords.", Respec, lambda spec: spec.erase_attribute("Keywords")),
    op("orientation", "Say how the image is to be turned to stand upright.", Respec,
       lambda spec, orientation: spec.attribute("Orientation", orientation),
       orientation=(int, argument(
           ge=1, le=8, help="as Exif has it: 1 upright, 3 by 180 degrees, 6 clockwise, 8 counter-clockwise"))),
    _turn("orientcw", "clockwise by 90 degrees", 1, "--rotcw"),
    _turn("orientccw", "counter-clockwise by 90 degrees", 3, "--rotccw"),
    _turn("orient180", "by 180 degrees", 2, "--rot180"),
    op("origin", "Move the data window to a place.", Respec, _set_origin, place=_text("+X+Y")),
    op("originoffset", "Move the data window from where it is.", Respec, _move_origin, offset=_text("+X+Y")),
    op("fullsize", "Set the display window.", Respec, _set_display_window,
       size=_text("WxH, WxH+X+Y, X0,Y0,X1,Y1 or +X+Y")),
    op("fullpixels", "Make the display window that of the pixels.", Respec,
       lambda spec: Window.data(spec).show_in(spec)),
    op("cicp", "Set the CICP metadata (ITU-T H.273): primaries, transfer, matrix, full range.", Respec, _set_cicp,
       codes=_text("up to four codes with commas; what is empty or left out stays, or is 0,0,0,1; '' erases all")),
    op("iccread", "Take the image's ICC profile from a file.", Respec, _read_profile, file=_text("the profile")),
    PasteMetadata,
)  # fmt: skip
