# SPDX-License-Identifier: Apache-2.0
"""Metadata, and windows without pixels."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ..core.access import Pointwise
from ..core.attributes import set_attribute
from ..core.image import Image, Part
from ..core.op import Op
from ..core.parameters import argument, image, param
from ..core.window import Window
from ..deferred import np, oiio
from ..errors import ImageError, ParameterError
from ..io.documents import require_regular
from ..session import Session
from .geometry_text import box_of, parse_box, parse_offset
from .kinds import HostOp, Respec, worked

_CLOCKWISE = (0, 6, 7, 8, 5, 2, 3, 4, 1)  # what an Exif orientation becomes by a quarter turn
_PROFILE_LIMIT = 64 << 20


# --- attributes ---


@dataclass(frozen=True, kw_only=True)
class SetAttribute(Respec):
    """Set an attribute; an empty value erases it."""

    name: ClassVar[str] = "attrib"

    attribute: str = argument(help="its name")
    value: str = argument(help="its value")
    type: str | None = param(
        None, help="its type: int, float, string, float[3] ...; by the look of the value when left out"
    )

    def change(self, spec: oiio.ImageSpec) -> None:
        """Set or erase it."""
        if self.value:
            set_attribute(spec, self.attribute, self.value, self.type)
        else:
            spec.erase_attribute(self.attribute)


@dataclass(frozen=True, kw_only=True)
class SetString(Respec):
    """Set an attribute that is text; an empty one erases it."""

    name: ClassVar[str] = "sattrib"

    attribute: str = argument(help="its name")
    value: str = argument(help="its value")

    def change(self, spec: oiio.ImageSpec) -> None:
        """Set or erase it."""
        _set_text(spec, self.attribute, self.value)


def _set_text(spec: oiio.ImageSpec, name: str, text: str) -> None:
    if text:
        spec.attribute(name, text)
    else:
        spec.erase_attribute(name)


@dataclass(frozen=True, kw_only=True)
class EraseAttributes(Respec):
    """Erase the attributes whose whole name matches a pattern."""

    name: ClassVar[str] = "eraseattrib"

    pattern: str = argument(help="a basic regular expression, or with fromfile a file with one in every line")
    fromfile: bool = param(False, help="read the patterns from a file")

    def change(self, spec: oiio.ImageSpec) -> None:
        """Erase them."""
        patterns = [self.pattern]
        if self.fromfile:
            try:
                patterns = Path(self.pattern).read_text(encoding="utf-8").splitlines()
            except (OSError, UnicodeDecodeError) as error:
                raise ParameterError(f"{self.pattern}: no file of patterns can be read: {error}") from None
        for pattern in filter(None, patterns):
            spec.erase_attribute(pattern)


@dataclass(frozen=True, kw_only=True)
class SetCaption(Respec):
    """Set the caption (ImageDescription); an empty one erases it."""

    name: ClassVar[str] = "caption"

    text: str = argument(help="the caption")

    def change(self, spec: oiio.ImageSpec) -> None:
        """Set or erase it."""
        _set_text(spec, "ImageDescription", self.text)


@dataclass(frozen=True, kw_only=True)
class AddKeyword(Respec):
    """Add a keyword, unless it is there."""

    name: ClassVar[str] = "keyword"

    keyword: str = argument(help="the keyword")

    def change(self, spec: oiio.ImageSpec) -> None:
        """Append it to those there are."""
        old = spec.get_string_attribute("Keywords")
        words = [word.strip() for word in old.split(";")] if old else []
        if self.keyword and self.keyword not in words:
            spec.attribute("Keywords", "; ".join([*words, self.keyword]))


@dataclass(frozen=True, kw_only=True)
class ClearKeywords(Respec):
    """Drop all keywords."""

    name: ClassVar[str] = "clear-keywords"

    def change(self, spec: oiio.ImageSpec) -> None:
        """Erase them."""
        spec.erase_attribute("Keywords")


@dataclass(frozen=True, kw_only=True)
class SetCicp(Respec):
    """Set the CICP metadata (ITU-T H.273): primaries, transfer, matrix, full range."""

    name: ClassVar[str] = "cicp"

    codes: str = argument(
        help="up to four codes with commas; what is empty or left out stays, or is 0,0,0,1; '' erases all"
    )

    def change(self, spec: oiio.ImageSpec) -> None:
        """Set or erase them."""
        if not self.codes:
            spec.erase_attribute("CICP")
            return
        old = spec.getattribute("CICP", oiio.TypeDesc("int[4]"))
        codes = [0, 0, 0, 1] if old is None else [int(code) for code in old]
        words = [word.strip() for word in self.codes.split(",")]
        if len(words) > 4 or not all(word.isascii() and word.isdigit() for word in filter(None, words)):
            raise ParameterError(f"codes={self.codes}: allowed are up to four whole numbers with commas between them")
        for place, word in enumerate(words):
            codes[place] = int(word) if word else codes[place]
        spec.attribute("CICP", oiio.TypeDesc("int[4]"), tuple(codes))


@dataclass(frozen=True, kw_only=True)
class ReadProfile(Respec):
    """Take the image's ICC profile from a file."""

    name: ClassVar[str] = "iccread"

    file: str = argument(help="the profile")

    def change(self, spec: oiio.ImageSpec) -> None:
        """Set it."""
        require_regular(self.file)
        try:
            profile = Path(self.file).read_bytes()
        except OSError as error:
            raise ImageError(f"{self.file}: the profile cannot be read: {error.strerror}") from None
        if not 0 < len(profile) < _PROFILE_LIMIT:
            raise ImageError(f"{self.file}: {len(profile)} bytes are no ICC profile")
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


# --- orientation ---


@dataclass(frozen=True, kw_only=True)
class SetOrientation(Respec):
    """Say how the image is to be turned to stand upright."""

    name: ClassVar[str] = "orientation"

    orientation: int = argument(
        ge=1, le=8, help="as Exif has it: 1 upright, 3 by 180 degrees, 6 clockwise, 8 counter-clockwise"
    )

    def change(self, spec: oiio.ImageSpec) -> None:
        """Set it."""
        spec.attribute("Orientation", self.orientation)


@dataclass(frozen=True, kw_only=True)
class Turn(Respec):
    """Change the orientation by quarter turns."""

    turns: ClassVar[int]

    def change(self, spec: oiio.ImageSpec) -> None:
        """Turn it, if it is one."""
        orientation = spec.get_int_attribute("Orientation", 1)
        if 1 <= orientation <= 8:
            for _ in range(self.turns):
                orientation = _CLOCKWISE[orientation]
            spec.attribute("Orientation", orientation)


@dataclass(frozen=True, kw_only=True)
class TurnClockwise(Turn):
    """Turn the orientation clockwise by 90 degrees; pixels stay."""

    name: ClassVar[str] = "orientcw"
    aliases: ClassVar[tuple[str, ...]] = ("--rotcw",)
    turns = 1


@dataclass(frozen=True, kw_only=True)
class TurnCounterClockwise(Turn):
    """Turn the orientation counter-clockwise by 90 degrees; pixels stay."""

    name: ClassVar[str] = "orientccw"
    aliases: ClassVar[tuple[str, ...]] = ("--rotccw",)
    turns = 3


@dataclass(frozen=True, kw_only=True)
class TurnOver(Turn):
    """Turn the orientation by 180 degrees; pixels stay."""

    name: ClassVar[str] = "orient180"
    aliases: ClassVar[tuple[str, ...]] = ("--rot180",)
    turns = 2


# --- windows ---


@dataclass(frozen=True, kw_only=True)
class SetOrigin(Respec):
    """Move the data window to a place."""

    name: ClassVar[str] = "origin"

    place: str = argument(help="+X+Y")

    def change(self, spec: oiio.ImageSpec) -> None:
        """Put its corner there."""
        data = Window.sized(*parse_offset(self.place), spec.width, spec.height)
        spec.x, spec.y = data.in_range()[:2]


@dataclass(frozen=True, kw_only=True)
class MoveOrigin(Respec):
    """Move the data window from where it is."""

    name: ClassVar[str] = "originoffset"

    offset: str = argument(help="+X+Y")

    def change(self, spec: oiio.ImageSpec) -> None:
        """Shift it."""
        spec.x, spec.y = Window.data(spec).shifted(*parse_offset(self.offset)).in_range()[:2]


@dataclass(frozen=True, kw_only=True)
class SetDisplayWindow(Respec):
    """Set the display window."""

    name: ClassVar[str] = "fullsize"

    size: str = argument(help="WxH, WxH+X+Y, X0,Y0,X1,Y1 or +X+Y")

    def change(self, spec: oiio.ImageSpec) -> None:
        """Set it."""
        window = parse_box(self.size, box_of(Window.display(spec))).window()
        if window.empty:
            raise ParameterError(f"size={self.size}: the display window would have no pixel")
        window.show_in(spec)


@dataclass(frozen=True, kw_only=True)
class DisplayWindowOfPixels(Respec):
    """Make the display window that of the pixels."""

    name: ClassVar[str] = "fullpixels"

    def change(self, spec: oiio.ImageSpec) -> None:
        """Set it."""
        Window.data(spec).show_in(spec)


OPS: tuple[type[Op], ...] = (
    SetAttribute,
    SetString,
    EraseAttributes,
    SetCaption,
    AddKeyword,
    ClearKeywords,
    SetOrientation,
    TurnClockwise,
    TurnCounterClockwise,
    TurnOver,
    SetOrigin,
    MoveOrigin,
    SetDisplayWindow,
    DisplayWindowOfPixels,
    SetCicp,
    ReadProfile,
    PasteMetadata,
)
