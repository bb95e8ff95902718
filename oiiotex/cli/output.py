# SPDX-License-Identifier: Apache-2.0
"""Options that write images, and those that say how."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import logging
import os
import re
import shlex
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import OpenImageIO as oiio

from .. import __version__
from ..errors import ImageError, ParameterError
from ..formats import Format
from ..images import Image, Part, cropped, type_named
from ..params import Size, param
from ..windows import Window
from ..writing import write
from .chain import Chain
from .parse import Option
from .sequences import Tile, names_tiles, tile_name

log = logging.getLogger("oiiotex")

_NARROW = {"uint10": ("uint16", 10), "uint12": ("uint16", 12), "uint6": ("uint8", 6), "uint4": ("uint8", 4)}
_NARROW |= {"uint2": ("uint8", 2), "uint1": ("uint8", 1)}


@dataclass(frozen=True)
class WriteModifiers:
    """Of -o."""

    all: int | None = param(None, ge=0, help="write all images of the stack: %d in the name counts from this number")
    udim: Size | None = param(
        None, ge=1, le=10, help="cut the image into so many UDIM tiles of one size; the name holds <UDIM>"
    )
    type: str | None = param(None, help="pixel type, as of -d")
    datatype: str | None = param(None, help="the same")
    bits: int | None = param(None, ge=1, le=64, help="significant bits")
    tile: Size | None = param(None, ge=1, le=65536, help="size of tiles")
    scanline: bool | None = param(None, help="no tiles")
    dither: bool | None = param(None, help="dither where 8 bits are made of more")
    autocrop: bool | None = param(None, help="exactly the display window, where the format has none")
    autotrim: bool | None = param(None, help="without black borders, where the format has a data window")
    autocc: bool | None = param(None, help="convert to the colour space that the file's name says")
    unpremult: bool | None = param(None, help="convert colours undone of alpha")
    contig: bool = param(False, help="channels interleaved")
    separate: bool = param(False, help="channels one after the other")
    fileformatname: str = param("", help="the format, whatever the name's extension")


def write_output(chain: Chain, path: str, **modifiers: Any) -> None:
    """Write the top image, or all, or its UDIM tiles."""
    given = WriteModifiers(**modifiers)
    if given.udim is not None:
        return _write_tiles(chain, path, given.udim, dataclasses.replace(given, udim=None))
    if given.all is None:
        return _write_one(chain, path, given)
    saved = list(chain.stack)
    for n, image in enumerate(saved):
        chain.stack = [*saved[:n], image]
        try:
            name = path % (n + given.all)
        except (TypeError, ValueError):
            raise ParameterError(f"'{path}' has no %d for the number of the image") from None
        _write_one(chain, name, dataclasses.replace(given, all=None))
    chain.stack = saved
    return None


def _write_tiles(chain: Chain, path: str, count: Size, given: WriteModifiers) -> None:
    """Cut the top image into tiles, 1001 at the lower left as UDIM counts, and write each."""
    if given.all is not None:
        raise ParameterError("udim and all: -o takes one of them")
    if not names_tiles(path):
        raise ParameterError(f"udim={count}: '{path}' has no <UDIM> for the number of the tile")
    image = chain.top
    spec = image.first.spec
    width, height = spec.width // count.width, spec.height // count.height
    if (width * count.width, height * count.height) != (spec.width, spec.height):
        raise ParameterError(f"udim={count}: an image of {spec.width}x{spec.height} has no {count} tiles of one size")
    for v, u in itertools.product(range(count.height), range(count.width)):
        window = Window.sized(spec.x + u * width, spec.y + (count.height - 1 - v) * height, width, height)
        chain.stack[-1] = Image((_tile(image.first, window),), image.source)
        _write_one(chain, tile_name(path, Tile(v, u)), given)
    chain.stack[-1] = image


def _tile(part: Part, window: Window) -> Part:
    """That window of a part as an image of its own, which goes on in others and not in itself."""

    def begin_at_0(spec: oiio.ImageSpec) -> None:
        spec.x = spec.y = spec.full_x = spec.full_y = 0
        spec.full_width, spec.full_height = window.width, window.height
        spec.attribute("wrapmodes", "black,black")

    return cropped(part, window).respecced(begin_at_0)


def _write_one(chain: Chain, path: str, given: WriteModifiers) -> None:
    if os.path.realpath(path) in chain.session.written:
        raise ParameterError(f"{path} has just been written by an op's modifier")
    if not may_write(chain, path):
        return
    image, how = chain.top, _format(chain, path, given)
    if _either(given.autotrim, chain.settings.get("--autotrim")):
        image = _trimmed(chain, image, path)
    if _either(given.autocc, chain.session.autocc):
        image, how = _converted(chain, image, path, how, bool(given.unpremult))
    log.info("writing %s", path)
    if not chain.settings.get("-n"):
        with chain.session.stats.time("write"), chain.session.keeping(path):
            write(_with_provenance(chain, image), path, how, chain.session.advance)
        if chain.settings.get("--adjust-time"):
            _adjust_time(path, image)
    chain.unwritten, chain.used = False, True


def may_write(chain: Chain, path: str) -> bool:
    """Whether the file is to be written; makes its folder where --create-dir says so."""
    chain.unwritten, chain.used = False, True
    if chain.settings.get("--no-clobber") and os.path.exists(path):
        log.warning("%s exists and is left as it is", path)
        return False
    if chain.settings.get("-u") and os.path.exists(path):
        newest = max((os.path.getmtime(name) for name in chain.inputs if os.path.exists(name)), default=0.0)
        if os.path.getmtime(path) >= newest:
            log.info("%s is newer than what it is made of", path)
            return False
    folder = os.path.dirname(path)
    if chain.settings.get("--create-dir") and folder and not chain.settings.get("-n"):
        try:
            os.makedirs(folder, exist_ok=True)
        except OSError as error:
            raise ImageError(f"{path}: the folder cannot be made: {error.strerror}") from error
    return True


def _either(own: bool | None, general: object) -> bool:
    """A modifier where it is given, else what an option has set."""
    return bool(general) if own is None else own


def _format(chain: Chain, path: str, given: WriteModifiers) -> Format:
    settings = chain.settings
    asked, bits = settings.get("-d", (None, 0))
    channels = settings.get("-d channels", {})
    if given.type or given.datatype:
        asked, bits = _pixel_type(given.type or given.datatype or "")
    if given.bits is not None:
        bits = given.bits
    tile = given.tile or settings.get("--tile")
    return Format(
        pixel_type=asked,
        computed_type=chain.first.pixel_type,
        computed_tile=chain.first.tile,
        computed_channels={} if asked else chain.first.channel_types,
        channel_types=channels,
        bits=bits or (0 if asked else chain.first.bits),
        tile=tuple(tile) if tile else None,
        scanline=_either(given.scanline, settings.get("--scanline")),
        attributes=_attributes(chain, path, given),
        autocrop=_either(given.autocrop, settings.get("--autocrop", True)),
        format_name=given.fileformatname,
    )


def _attributes(chain: Chain, path: str, given: WriteModifiers) -> dict[str, Any]:
    settings = chain.settings
    found: dict[str, Any] = {"oiio:SHA-1": None, "oiio:ConstantColor": None, "oiio:AverageColor": None}
    for option, attribute in (("--compression", "compression"), ("--quality", "CompressionQuality")):
        if option in settings:
            found[attribute] = settings[option]
    planar = "separate" if given.separate else "contig" if given.contig else settings.get("--planarconfig")
    if planar:
        found["planarconfig"] = planar
    if _either(given.dither, settings.get("--dither")):
        # OpenImageIO wants a seed that differs from file to file and is the same for the same name
        found["oiio:dither"] = 1 + int.from_bytes(hashlib.sha256(os.path.basename(path).encode()).digest()[:3])
    return found | software(chain)


def software(chain: Chain) -> dict[str, Any]:
    """What a file says of the program that wrote it: a hash of the command line, or with --history the line itself."""
    if chain.settings.get("--nosoftwareattrib"):
        return {}
    words = list(chain.session.words)
    if chain.settings.get("--sansattrib"):
        words = _without_attributes(words)
    line = shlex.join(["oiiotex", *words]).encode(errors="backslashreplace").decode()
    # OpenImageIO believes a texture's hash and average colour only where this begins with its own name
    program = f"OpenImageIO {oiio.__version__}, oiiotex {__version__}"
    found: dict[str, Any] = {"Software": f"{program} : {hashlib.sha1(line.encode()).hexdigest()}"}
    if chain.settings.get("--history"):
        found["Software"] = f"{program} : {line}"
        before = chain.top.first.spec.get_string_attribute("Exif:ImageHistory") if chain.stack else ""
        found["Exif:ImageHistory"] = f"{before.rstrip()}\n{line}".lstrip()
    return found


def _without_attributes(words: list[str]) -> list[str]:
    """A command line less its --attrib and --sattrib, each of which is three words."""
    kept, skip = [], 0
    for word in words:
        if word.split(":")[0].lstrip("-") in ("attrib", "sattrib") and word.startswith("-"):
            skip = 3
        if not skip:
            kept.append(word)
        skip = max(0, skip - 1)
    return kept


def _with_provenance(chain: Chain, image: Image) -> Image:
    """The image, without what our filters have noted in it where --nosoftwareattrib asks for that."""
    if not chain.settings.get("--nosoftwareattrib"):
        return image

    def forget(spec: oiio.ImageSpec) -> None:
        for attribute in list(spec.extra_attribs):
            if attribute.name.startswith("oiiotex:"):
                spec.erase_attribute(re.escape(attribute.name))

    return Image(tuple(part.respecced(forget) for part in image.parts), image.source)


def _trimmed(chain: Chain, image: Image, path: str) -> Image:
    from ..host.cropping import Trim

    out = oiio.ImageOutput.create(path)
    return Trim(source=image).compute(chain.session) if out is not None and out.supports("displaywindow") else image


def _converted(chain: Chain, image: Image, path: str, how: Format, unpremult: bool) -> tuple[Image, Format]:
    """In the colour space, and of the type, that the config finds in the file's name (--autocc)."""
    from ..host.color import ColorConvert

    colors = chain.session.color
    space = colors.space_of_output(path)
    if space is None:
        return image, how
    kind = colors.pixel_type(space)
    if kind is not None and kind[0] != oiio.TypeDesc("float"):
        how = dataclasses.replace(how, pixel_type=kind[0], bits=kind[1])
    current = image.first.spec.get_string_attribute("oiio:ColorSpace") or colors.linear
    if current is None or colors.same(current, space):
        return image, how
    convert = ColorConvert(
        source=image, from_space=current, to_space=space, unpremult=unpremult, strict=False, allsubimages=True
    )
    return convert.compute(chain.session), how


def _adjust_time(path: str, image: Image) -> None:
    """Give the file the time that its metadata says, else that of its source."""
    stamp = image.first.spec.get_string_attribute("DateTime")
    try:
        seconds = time.mktime(time.strptime(stamp, "%Y:%m:%d %H:%M:%S"))
    except (ValueError, OverflowError):
        if not os.path.exists(image.source):
            return
        seconds = os.path.getmtime(image.source)
    os.utime(path, (seconds, seconds))


# --- how ---


def _pixel_type(text: str) -> tuple[oiio.TypeDesc, int]:
    name, bits = _NARROW.get(text, (text, 0))
    return type_named(name), bits


def set_type(chain: Chain, text: str) -> None:
    """The pixel type of what is written from here on, or with CHANNEL=TYPE that of single channels."""
    if "=" not in text:
        chain.settings["-d"] = _pixel_type(text)
        chain.settings.pop("-d channels", None)
        return
    named = dict(chain.settings.get("-d channels", {}))
    for piece in text.split(","):
        channel, equals, name = piece.partition("=")
        if not (channel and equals):
            raise ParameterError(f"'{piece}' is not CHANNEL=TYPE")
        named[channel] = _pixel_type(name)[0]
    chain.settings["-d channels"] = named


def set_tile(chain: Chain, width: str, height: str) -> None:
    """Tiles of that size from here on."""
    sides = []
    for text in (width, height):
        if not (text.isascii() and text.isdigit() and 0 < int(text) <= 65536):
            raise ParameterError(f"'{width} {height}': allowed are two whole numbers from 1 to 65536")
        sides.append(int(text))
    chain.settings["--tile"] = tuple(sides)
    chain.settings.pop("--scanline", None)


def set_planar(chain: Chain, text: str) -> None:
    """How channels are stored from here on."""
    if text not in ("contig", "separate", "default"):
        raise ParameterError(f"'{text}': allowed is contig, separate or default")
    chain.settings["--planarconfig"] = None if text == "default" else text


def set_quality(chain: Chain, text: str) -> None:
    """Quality of lossy compression from here on."""
    if not (text.isascii() and text.isdigit()):
        raise ParameterError(f"'{text}': allowed is a whole number >= 0")
    chain.settings["--quality"] = int(text)


def set_compression(chain: Chain, text: str) -> None:
    """Compression from here on, as NAME or NAME:QUALITY."""
    chain.settings["--compression"] = text


def switch(option: str, value: object = True) -> Any:
    """What sets an option for later ones."""

    def run(chain: Chain) -> None:
        chain.settings[option] = value

    return run


def write_profile(chain: Chain, path: str) -> None:
    """Write the top image's ICC profile to a file of its own."""
    from ..temporary import temporary_beside

    profile = chain.top.first.spec.getattribute("ICCProfile")
    if profile is None:
        raise ImageError(f"{chain.top.source} has no ICC profile")
    if may_write(chain, path) and not chain.settings.get("-n"):
        with temporary_beside(Path(path)) as temporary:
            temporary.write_bytes(bytes(profile))


def _state(name: str, help: str, *aliases: str, sets: tuple[str, object] | None = None) -> Option:
    return Option(name, (), help, switch(*(sets or (name,))), state=True, aliases=aliases)


OPTIONS = (
    Option(
        "-o",
        ("FILE",),
        "write the top image; a run that fails leaves the old file as it was",
        write_output,
        WriteModifiers,
    ),
    Option(
        "-d",
        ("TYPE",),
        "pixel type of what is written from here on: uint8, uint10, half, float ..., or CHANNEL=TYPE,...",
        set_type,
        state=True,
    ),
    _state("--scanline", "write scanlines, whatever the source has"),
    Option("--tile", ("WIDTH", "HEIGHT"), "write tiles of this size", set_tile, state=True),
    Option("--compression", ("NAME",), "compression: NAME or NAME:QUALITY", set_compression, state=True),
    Option("--quality", ("N",), "quality of lossy compression, 0 to 100", set_quality, state=True),
    _state("--dither", "dither where 8 bits are made of more"),
    Option("--planarconfig", ("CONFIG",), "contig, separate or default", set_planar, state=True),
    _state("--adjust-time", "give written files the time that their metadata says"),
    _state("--noautocrop", "formats without display window get the data window", sets=("--autocrop", False)),
    _state("--autotrim", "without black borders, where the format has a data window"),
    _state("--history", "write the command line into the files' metadata"),
    _state("--no-history", "write only a hash of the command line (as is the rule)", sets=("--history", False)),
    _state("--nosoftwareattrib", "write nothing of this program into the files' metadata"),
    _state("-n", "write nothing: a dry run"),
    _state("-u", "do not write files that are newer than what they are made of"),
    _state("--no-clobber", "do not write over files", "--noclobber"),
    _state("--create-dir", "make the folders of files to be written"),
    Option("--iccwrite", ("FILE",), "write the top image's ICC profile to a file", write_profile),
)
