# SPDX-License-Identifier: Apache-2.0
"""Options that write images, and settings of outputs."""

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

from .... import __version__
from ....engine.core.attributes import as_utf8
from ....engine.core.image import Image, Part, cropped
from ....engine.core.parameters import Size, param
from ....engine.core.window import Window
from ....engine.deferred import oiio
from ....engine.errors import ImageError, ParameterError
from ....engine.io.atomic import make_folders, require_place, temporary_beside
from ....engine.io.formats import Format
from ....engine.io.writing import write
from ....engine.run import as_provisional
from ..language.parse import Option, without
from ..language.tiles import Tile, names_tiles, tile_name
from ..stack import output_settings
from ..stack.chain import Chain
from ..stack.output_settings import pixel_type

log = logging.getLogger("oiiotex")

_MANY_DIGITS = r"%[^%A-Za-z]*\d{4}"  # a number of more digits than names of files have


@dataclass(frozen=True)
class WriteModifiers:
    """Modifiers of -o."""

    all: int | None = param(None, ge=0, help="Write all images of the stack: %d in FILE counts from this number.")
    udim: Size | None = param(None, ge=1, le=10, example="2x2", help="Cut the image into UDIM tiles: <UDIM> in FILE.")
    type: str | None = param(
        None, unset="that of -d", example="half", help="Pixel type, such as uint8, uint10 or half."
    )
    datatype: str | None = param(None, unset="that of -d", example="half", help="Alias of type.", advanced=True)
    bits: int | None = param(None, ge=1, le=64, unset="all", example="10", help="Significant bits.", advanced=True)
    tile: Size | None = param(None, ge=1, le=65536, unset="that of --tile", example="64x64", help="Size of tiles.")
    scanline: bool | None = param(None, unset="1 after --scanline, else 0", help="Write scanlines instead of tiles.")
    dither: bool | None = param(None, unset="1 after --dither, else 0", help="Dither when quantizing to 8 bits.")
    autocrop: bool | None = param(
        None,
        advanced=True,
        unset="0 after --noautocrop, else 1",
        help="Crop or pad to the display window in formats with a single window.",
    )
    autotrim: bool | None = param(
        None, advanced=True, unset="1 after --autotrim, else 0", help="Trim as --autotrim does."
    )
    autocc: bool | None = param(
        None, unset="1 after --autocc, else 0", help="Convert to the color space in the file's name."
    )
    unpremult: bool = param(False, advanced=True, help="Unpremultiply colors for the conversion.")
    contig: bool = param(False, advanced=True, help="Interleave the channels.")
    separate: bool = param(False, advanced=True, help="Store each channel separately.")
    fileformatname: str = param(
        "", unset="that of the extension", example="tiff", advanced=True, help="Name of the file format."
    )


def write_output(chain: Chain, path: str, given: WriteModifiers) -> None:
    """Write the top image, all images, or UDIM tiles; a failing run leaves an existing file unchanged."""
    if given.udim is not None:
        return _write_tiles(chain, chain.expressed(path), given.udim, dataclasses.replace(given, udim=None))
    if given.all is None:
        return _write_one(chain, chain.expressed(path), given)
    saved, names = list(chain.stack), set[str]()
    for n, image in enumerate(saved):
        chain.stack = [*saved[:n], image]
        name = _numbered(chain.expressed(path), n + given.all)
        if name in names:  # as oiiotool, which does not say so
            log.warning("-o: %s replaces an earlier image of all=%d: add %%d, its number, to the name", name, given.all)
        names.add(name)
        _write_one(chain, name, dataclasses.replace(given, all=None))
    chain.stack = saved
    return None


def _numbered(path: str, number: int) -> str:
    """The name with its %d, if any, replaced by the number."""
    try:
        if re.search(_MANY_DIGITS, path):
            raise ValueError
        return path % number if "%" in path else path
    except (TypeError, ValueError):
        raise ParameterError(f"'{path}': expected a single %d, for the image number") from None


def _write_tiles(chain: Chain, path: str, count: Size, given: WriteModifiers) -> None:
    """Cut the top image into UDIM tiles, 1001 at the lower left, and write each."""
    if given.all is not None:
        raise ParameterError("udim conflicts with all: give one of them")
    if not names_tiles(path):
        raise ParameterError(f"udim={count} requires <UDIM> in the file name, which is '{path}'")
    image = chain.top
    spec = image.first.spec
    width, height = spec.width // count.width, spec.height // count.height
    if (width * count.width, height * count.height) != (spec.width, spec.height):
        raise ParameterError(f"udim={count} cannot divide {spec.width}x{spec.height} px into tiles of equal size")
    for v, u in itertools.product(range(count.height), range(count.width)):
        window = Window.sized(spec.x + u * width, spec.y + (count.height - 1 - v) * height, width, height)
        chain.stack[-1] = Image((_tile(image.first, window),), image.source)
        _write_one(chain, tile_name(path, Tile(v, u)), given)
    chain.stack[-1] = image


def _tile(part: Part, window: Window) -> Part:
    """A window of a part as a separate image that does not repeat: its neighbors continue it."""

    def begin_at_0(spec: oiio.ImageSpec) -> None:
        spec.x = spec.y = spec.full_x = spec.full_y = 0
        spec.full_width, spec.full_height = window.width, window.height

    return cropped(part, window).respecced(begin_at_0)


def _write_one(chain: Chain, path: str, given: WriteModifiers) -> None:
    image, how = chain.top, _format(chain, path, given)
    if is_left(chain, path):
        return
    if _either(given.autotrim, chain.settings.get("--autotrim")):
        image = _trimmed(chain, image, path)
    if _either(given.autocc, chain.session.settings.autocc):
        image, how = _converted(chain, image, path, how, given.unpremult)
    if not may_write(chain, image, path, how):
        return
    shares, inputs = chain.shares, sorted(chain.inputs)
    if shares is not None and shares.count:
        chain.tell(f"Computing share {shares.number}/{shares.count} of {path}")
        with chain.session.resources.stats.time("write"):
            shares.compute(chain.session, image, path, inputs)
        return
    if shares is not None:
        image = shares.joined(chain.session, image, inputs)
    _warn_of_channels(image, path, how)
    chain.tell(f"Writing {path}")
    with chain.session.resources.stats.time("write"), chain.session.resources.checkpoints(path):
        write(_with_provenance(chain, image), path, how, chain.session.progress.advance)
    if chain.settings.get("--adjust-time"):
        _adjust_time(path, image)


def _warn_of_channels(image: Image, path: str, how: Format) -> None:
    """Warn of channels of -d CHANNEL=TYPE that the image does not have."""
    keys = {name for part in image.parts for name in part.spec.channelnames}
    keys |= {f"{part.name}.{name}" for part in image.parts for name in (*part.spec.channelnames, "*")}
    keys |= {f"subimage{n:02}.{name}" for n, part in enumerate(image.parts) for name in (*part.spec.channelnames, "*")}
    unknown = [name for name, kind in how.channel_types.items() if kind is not None and name not in keys]
    if unknown:
        log.warning("%s has no channel %s: its type of -d has no effect", path, ", ".join(unknown))


def may_write(chain: Chain, image: Image, path: str, how: Format) -> bool:
    """Whether to write the file now; creates its folder after --create-dir."""
    chain.will_write(image, path, how)
    if chain.settings.get("-n"):
        chain.note(logging.INFO, f"{path} would be written")
        return False
    if not chain.acts(*image.parts):
        return False
    folder = os.path.dirname(path)
    if chain.settings.get("--create-dir") and folder:
        try:
            make_folders(Path(folder))
        except OSError as error:
            raise ImageError(f"cannot create the folder of {path}: {error.strerror}") from error
    return True


def is_left(chain: Chain, path: str) -> bool:
    """Whether to keep the existing file, by --no-clobber, or by -u because it is newer than its inputs."""
    chain.require_free(path)
    chain.unwritten, chain.used = False, True
    if not os.path.exists(path):
        return False
    if chain.settings.get("--no-clobber"):
        chain.note(logging.WARNING, f"{path} exists: skipped (--no-clobber)")
        return True
    if chain.settings.get("-u") and os.path.getmtime(path) >= max(map(chain.changed, chain.inputs), default=0.0):
        chain.note(logging.INFO, f"{path} is newer than its inputs: skipped (-u)")
        return True
    return False


def _either(own: bool | None, general: object) -> bool:
    """The modifier if given, else the setting of an option."""
    return bool(general) if own is None else own


def _format(chain: Chain, path: str, given: WriteModifiers) -> Format:
    settings = chain.settings
    asked, bits = settings.get("-d", (None, 0))
    channels = settings.get("-d channels", {})
    if given.type or given.datatype:
        asked, bits = pixel_type(given.type or given.datatype or "")
    if given.bits is not None:
        bits = given.bits
    tile = given.tile or settings.get("--tile")
    return Format(
        pixel_type=asked,
        computed_type=chain.first.pixel_type,
        computed_tile=chain.first.tile,
        computed_channels={} if asked else chain.first.channel_types,
        channel_types=channels,
        bits=bits,
        computed_bits=0 if asked else chain.first.bits,
        tile=tuple(tile) if tile else None,
        scanline=_either(given.scanline, settings.get("--scanline")),
        attributes=_attributes(chain, path, given),
        autocrop=_either(given.autocrop, settings.get("--autocrop", True)),
        format_name=given.fileformatname,
    )


def _attributes(chain: Chain, path: str, given: WriteModifiers) -> dict[str, Any]:
    settings = chain.settings
    attributes: dict[str, Any] = {"oiio:SHA-1": None, "oiio:ConstantColor": None, "oiio:AverageColor": None}
    attributes |= compression(chain)
    planar = "separate" if given.separate else "contig" if given.contig else settings.get("--planarconfig")
    if planar:
        attributes["planarconfig"] = planar
    if _either(given.dither, settings.get("--dither")):
        from farmhash import FarmHash64

        seed = FarmHash64(path) & 0xFFFFFFFF  # oiiotool's hash; OpenImageIO expects a signed int, not 0
        attributes["oiio:dither"] = seed - (seed >> 31 << 32) or 1
    return attributes | software(chain)


def compression(chain: Chain) -> dict[str, Any]:
    """Settings of --compression and --quality as attributes of a spec."""
    names = {"--compression": "compression", "--quality": "CompressionQuality"}
    return {name: chain.settings[option] for option, name in names.items() if option in chain.settings}


def software(chain: Chain) -> dict[str, Any]:
    """Attributes on this program: a hash of the command line, with --history the line itself."""
    if chain.settings.get("--nosoftwareattrib"):
        return {}
    words = chain.session.settings.words
    if chain.settings.get("--sansattrib"):
        words = without(words, {"attrib": 2, "sattrib": 2})
    line = shlex.join(["oiiotex", *words]).encode(errors="backslashreplace").decode()
    # OpenImageIO trusts a texture's hash and average color only if this begins with its own name
    program = f"OpenImageIO {oiio.__version__}, oiiotex {__version__}"
    attributes: dict[str, Any] = {"Software": f"{program} : {hashlib.sha1(line.encode()).hexdigest()}"}
    if chain.settings.get("--history"):
        attributes["Software"] = f"{program} : {line}"
        before = as_utf8(chain.top.first.spec.get_string_attribute("Exif:ImageHistory")) if chain.stack else ""
        attributes["Exif:ImageHistory"] = f"{before.rstrip()}\n{line}".lstrip()
    return attributes


def _with_provenance(chain: Chain, image: Image) -> Image:
    """The image, without the attributes of our filters after --nosoftwareattrib."""
    if not chain.settings.get("--nosoftwareattrib"):
        return image

    def forget(spec: oiio.ImageSpec) -> None:
        for attribute in list(spec.extra_attribs):
            if attribute.name.startswith("oiiotex:"):
                spec.erase_attribute(re.escape(attribute.name))

    return Image(tuple(part.respecced(forget) for part in image.parts), image.source)


def _trimmed(chain: Chain, image: Image, path: str) -> Image:
    from ...host.spatial.placing import Trim

    out = oiio.ImageOutput.create(path)
    if out is None or not out.supports("displaywindow"):
        return image
    if chain.dry:
        return as_provisional(image)
    trim = Trim(source=image)
    return trim.make(trim.plan(chain.session.resources), chain.session)


def _converted(chain: Chain, image: Image, path: str, how: Format, unpremult: bool) -> tuple[Image, Format]:
    """The image in the color space and type that the config finds in the file's name (--autocc)."""
    from ...host.color import ColorConvert

    colors = chain.session.resources.color
    space = colors.space_of_output(path)
    if space is None:
        return image, how
    kind = colors.pixel_type(space)
    if kind is not None and kind[0] != oiio.TypeDesc("float"):
        how = dataclasses.replace(how, pixel_type=kind[0], bits=kind[1])
    spec = image.first.spec
    current = spec.get_string_attribute("oiio:ColorSpace") or colors.described(spec) or colors.linear
    if current is None or colors.same(current, space):
        return image, how
    convert = ColorConvert(
        source=image, from_space=current, to_space=space, unpremult=unpremult, strict=False, allsubimages=True
    )
    return convert.plan(chain.session.resources).results, how


def _adjust_time(path: str, image: Image) -> None:
    """Set the time of the file from its DateTime metadata, else from its source."""
    stamp = image.first.spec.get_string_attribute("DateTime")
    try:
        seconds = time.mktime(time.strptime(stamp, "%Y:%m:%d %H:%M:%S"))
    except (ValueError, OverflowError):
        if not os.path.exists(image.source):
            return
        seconds = os.path.getmtime(image.source)
    os.utime(path, (seconds, seconds))


def write_profile(chain: Chain, path: str) -> None:
    """Write the ICC profile of the top image to a file."""
    profile = chain.top.first.spec.getattribute("ICCProfile")
    if profile is None:
        raise ImageError(f"{chain.top.source} has no ICC profile")
    if is_left(chain, path):
        return
    require_place(Path(path))
    if not chain.settings.get("-n") and chain.acts():
        with temporary_beside(Path(path)) as temporary:
            temporary.write_bytes(bytes(profile))


OPTIONS = (
    Option("-o FILE", write_output, WriteModifiers, late=True, writes=True),
    *output_settings.OPTIONS,
    Option("--iccwrite FILE", write_profile, writes=True),
)
