# SPDX-License-Identifier: Apache-2.0
"""The output of --info and --printinfo: metadata, hash, statistics and pixel values of an image."""

from __future__ import annotations

import functools
import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass

from ....engine.core.demand import sha1
from ....engine.core.image import Image, Part, dtype_of
from ....engine.core.parameters import param
from ....engine.core.window import Window
from ....engine.deferred import np, oiio
from ....engine.patterns import pattern_of
from .pixel_statistics import as_floats, full_rows, part_statistics_text

_NAME_WIDTH = 20
_LEADING = "resolution, width, height, depth, channels"  # --metamatch must match it to print the first line


@dataclass(frozen=True, kw_only=True)
class Dump:
    """Modifiers of --dumpdata."""

    empty: bool = param(True, help="Output of black pixels.")
    C: str = param("", example="pixels", help="Name of a C array, as which the values are printed.")


@dataclass(frozen=True, kw_only=True)
class Asked:
    """The output requested for an image."""

    verbose: bool = False  # all metadata instead of the size
    all_parts: bool = False  # and their MIP levels, instead of the first part
    native: bool = False  # pixel types of the file instead of those that ops work on
    xml: bool = False
    match: str = ""  # regular expression for names of metadata to print
    no_match: str = ""
    hash: bool = False
    statistics: bool = False
    window: Window | None = None  # region of the statistics; `channels`: their number
    channels: int | None = None
    dump: Dump | None = None  # print the pixels

    @property
    def reads_pixels(self) -> bool:
        """Whether the output depends on pixels."""
        return bool(self.statistics or self.hash or self.dump)

    @functools.cached_property
    def wanted(self) -> re.Pattern[str]:
        """The pattern of the names of metadata to print."""
        return pattern_of(self.match)

    def passes(self, line: str) -> bool:
        """Whether a line of metadata is printed."""
        name = line.partition(": ")[0]
        return not (self.no_match and pattern_of(self.no_match).search(name)) and bool(self.wanted.search(name))

    @property
    def prefix(self) -> str:
        """The comment marker of lines in C output, else nothing."""
        return "// " if self.dump and self.dump.C else ""


def description(image: Image, asked: Asked, filename: str = "") -> Iterator[str]:
    """The description of an image in pieces; `filename` begins that of a file which has just been read."""
    for number, part in enumerate(image.parts if asked.all_parts else image.parts[:1]):
        yield _metadata(image, number, asked, filename)
        if filename and asked.dump:
            yield from dumped(part, asked.dump)
        if asked.statistics and asked.wanted.search("stats"):
            yield from _statistics(part, asked)


def _metadata(image: Image, number: int, asked: Asked, filename: str) -> str:
    part, leading = image.parts[number], asked.wanted.search(_LEADING)
    spec = part.spec if filename else _shown_spec(image, part, asked.native)
    verbosity = "detailedhuman" if asked.verbose else "brief"
    first, *rest = spec.serialize("xml" if asked.xml else "text", verbosity).split("\n")
    lines = [first]
    if asked.xml:
        lines += [f"<subimages>{len(image.parts)}</subimages>"] if len(image.parts) > 1 else []
        lines += [f"<miplevels>{1 + len(part.levels)}</miplevels>"] if part.levels else []
    else:
        head = _heading(image, number, asked, filename, f"{first} {file_format(image, part)}") if leading else []
        lines = [*head[:1], *(_overview(image, asked) if number == 0 else []), *head[1:]]
    if asked.verbose and leading and part.levels:
        sizes = " ".join(f"{level.spec.width}x{level.spec.height}" for level in (part, *part.levels))
        lines.append(f"    MIP-map levels: {sizes}")
    if filename and asked.hash and asked.wanted.search("sha-1"):
        lines.append(f"<SHA1>{sha1(part)}</SHA1>" if asked.xml else f"    SHA-1: {sha1(part)}")
    stays = not asked.xml and asked.verbose and leading
    lines = [line for n, line in enumerate([*lines, *rest]) if (n == 0 and stays) or asked.passes(line)]
    text = "\n".join([*lines[:1], *map(unescaped, lines[1:])])
    return text if text.endswith("\n") else f"{text}\n"


def _shown_spec(image: Image, part: Part, native: bool) -> oiio.ImageSpec:
    """The spec as ops see it, with the image's source."""
    spec = oiio.ImageSpec(part.spec)
    if not native:
        if not spec.deep:  # deep samples keep the file's types
            spec.set_format(part.working_type)
        spec.erase_attribute("oiio:SHA-1")  # of the file's pixels
        text = spec.get_string_attribute("ImageDescription")
        if "oiio:SHA-1=" in text:
            spec.attribute("ImageDescription", re.sub(r"oiio:SHA-1=\S*\s*", "", text, count=1))
    if os.path.isfile(image.source):
        spec.attribute("oiio:SourceFileFormat", file_format(image))
        spec.attribute("oiio:SourcePath", image.source)
    return spec


def file_format(image: Image, part: Part | None = None) -> str:
    """The format name of an image's file; empty if `part` has changed since it was read."""
    if (part is not None and part.stored is None) or not os.path.isfile(image.source):
        return ""
    opened = oiio.ImageInput.open(image.source)
    if opened is None:
        oiio.geterror()
        return ""
    return opened.format_name()


def _heading(image: Image, number: int, asked: Asked, filename: str, facts: str) -> list[str]:
    """The first line, and for several parts the line of part 0, which repeats it."""
    count, many_levels = len(image.parts), bool(image.parts[number].levels)
    named = f" subimage {number:2}: " if number else f"{asked.prefix}{filename:{_NAME_WIDTH}} : " if filename else ""
    line = f"{named}{facts}"
    if not asked.verbose and count > 1:
        line += f" ({count} subimages{' +mipmap)' if many_levels else ''})"
    elif not asked.verbose and many_levels:
        line += " (+mipmap)"
    repeated = count > 1 and number == 0 and asked.all_parts
    return [line, *([f" subimage  0: {facts}"] if repeated else [])]


def _overview(image: Image, asked: Asked) -> list[str]:
    """The line on sizes and pixel types of all parts."""
    if not asked.verbose or len(image.parts) == 1:
        return []
    parts = image.parts[:1] if image.first.spec.get_int_attribute("oiio:Movie") else image.parts
    kinds = ", ".join(f"{part.spec.width}x{part.spec.height} [{_channel_types(part.spec)}]" for part in parts)
    return [f"    {len(image.parts)} subimages: {kinds}"]


def _channel_types(spec: oiio.ImageSpec) -> str:
    bits = spec.get_int_attribute("oiio:BitsPerSample") or spec.format.size() * 8
    names = {"float": "f", "half": "h", "double": f"f{bits}"}
    kinds = (str(spec.channelformat(channel)) for channel in range(spec.nchannels))
    return ",".join(names.get(kind, f"{kind[0]}{bits}") for kind in kinds)  # u16 and i16


_ESCAPES = {"n": "\n", "t": "\t", "v": "\v", "b": "\b", "r": "\r", "f": "\f", "a": "\a", "\\": "\\", '"': '"'}


def unescaped(text: str) -> str:
    """The text with escapes such as \\n, \\" and \\033 replaced by their characters."""
    pattern = r'\\(?:([ntvbrfa\\"])|([0-7]{1,3}))'
    return re.sub(pattern, lambda match: _ESCAPES[match[1]] if match[1] else chr(int(match[2], 8) & 255), text)


def _statistics(part: Part, asked: Asked) -> Iterator[str]:
    levels = (part, *part.levels)
    indent = "      " if part.levels else "    "
    for number, level in enumerate(levels if asked.all_parts else levels[:1]):
        if part.levels and asked.all_parts:
            size = f"{level.spec.width} x {level.spec.height}"
            yield f"{asked.prefix}    MIP {number} of {len(levels)} ({size}):\n"
        yield part_statistics_text(level, indent, asked.window, asked.channels)


def dumped(part: Part, how: Dump) -> Iterator[str]:
    """The values of all pixels in the format of --dumpdata."""
    kind = np.dtype(dtype_of(part.spec))
    integers = kind.kind in "ui"
    if how.C:
        size = f"[{part.spec.height}][{part.spec.width}][{part.spec.nchannels}]"
        yield f"{part.spec.format}{'_t' if integers else ''} {how.C}{size} =\n{{\n"
    separator = ", " if how.C else " "
    for window in full_rows(part.window):
        pixels = part.read(window)
        scaled = as_floats(part.buffer(window), window) if integers else pixels
        for y in range(window.height):
            lines = []
            for x in range(window.width):
                values = pixels[y, x]
                if not how.empty and not values.any():
                    continue
                text = _values(values, scaled[y, x] if integers else None, separator, bool(how.C))
                place = f"({x + window.left}, {y + window.top}): "
                if how.C:
                    ends = " }" if x == window.width - 1 else ""
                    lines.append(f"  {'{ ' if x == 0 else '  '}/* {place}*/ {{ {text}{ends} }},\n")
                else:
                    lines.append(f"    Pixel {place}{text}\n")
            yield "".join(lines)
    if how.C:
        yield "};\n"


def _values(values: np.ndarray, scaled: np.ndarray | None, separator: str, as_c: bool) -> str:
    if scaled is None:
        return separator.join(map(_nine_digits, values.tolist()))
    numbers = separator.join(map(str, values.tolist()))
    fractions = separator.join(map(shortest, scaled))
    return f"{numbers} /* ({fractions}) */" if as_c else f"{numbers} ({fractions})"


def _nine_digits(value: float) -> str:
    if math.isfinite(value):
        return f"{value:.9f}"
    return "nan" if math.isnan(value) else "inf"


def shortest(value: float | np.floating) -> str:
    """The shortest text that reads back as this number, as the fmt library writes it."""
    if not np.isfinite(value):
        return ("-" if np.signbit(value) else "") + ("nan" if np.isnan(value) else "inf")
    single = isinstance(value, np.float32)
    digits = np.format_float_scientific(value if single else np.float64(value), trim="-")
    mantissa, _, exponent = digits.partition("e")
    if -5 < int(exponent) < (7 if single else 16):
        return np.format_float_positional(value if single else np.float64(value), trim="-")
    return f"{mantissa}e{int(exponent):+03d}"
