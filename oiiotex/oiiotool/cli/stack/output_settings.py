# SPDX-License-Identifier: Apache-2.0
"""Options that set how later outputs are written."""

from __future__ import annotations

from collections.abc import Callable

from ....engine.core.image import type_named
from ....engine.deferred import oiio
from ....engine.errors import ParameterError
from ..language.parse import Option, whole_number
from .chain import Chain

_NARROW = {"uint10": ("uint16", 10), "uint12": ("uint16", 12), "uint6": ("uint8", 6), "uint4": ("uint8", 4)}
_NARROW |= {"uint2": ("uint8", 2), "uint1": ("uint8", 1)}


def pixel_type(text: str) -> tuple[oiio.TypeDesc, int]:
    """The type of a -d name, and its significant bits if fewer than the type's; else 0."""
    name, bits = _NARROW.get(text, (text, 0))
    return type_named(name), bits


def set_type(chain: Chain, text: str) -> None:
    """Set the pixel type of later outputs: uint8 (8-bit), uint16 (16-bit), half ..., or a list of CHANNEL=TYPE."""
    if "=" not in text:
        chain.settings["-d"] = pixel_type(text)
        chain.settings.pop("-d channels", None)
        return
    named = dict(chain.settings.get("-d channels", {}))
    for piece in text.split(","):
        channel, equals, name = piece.partition("=")
        if not (channel and equals):
            raise ParameterError(f"'{piece}': expected CHANNEL=TYPE")
        named[channel] = pixel_type(name)[0]
    chain.settings["-d channels"] = named


def set_tile(chain: Chain, width: str, height: str) -> None:
    """Set the size of tiles in later outputs."""
    sides = []
    for text in (width, height):
        if not (text.isascii() and text.isdigit() and 0 < int(text) <= 65536):
            raise ParameterError(f"'{width} {height}': expected two integers from 1 to 65536")
        sides.append(int(text))
    chain.settings["--tile"] = tuple(sides)
    chain.settings.pop("--scanline", None)


def set_planar(chain: Chain, text: str) -> None:
    """Set the channel storage of later outputs: contig, separate or default."""
    if text not in ("contig", "separate", "default"):
        raise ParameterError(f"'{text}': expected contig, separate or default")
    chain.settings["--planarconfig"] = None if text == "default" else text


def switch(option: str, value: object = True) -> Callable[[Chain], None]:
    """A function that sets an option for later ones."""

    def run(chain: Chain) -> None:
        chain.settings[option] = value

    return run


def set_text(option: str, value: Callable[[str], object] = str) -> Callable[[Chain, str], None]:
    """A function that stores the value of an option's argument for later ones."""

    def run(chain: Chain, text: str) -> None:
        chain.settings[option] = value(text)

    return run


def state(name: str, text: str, *aliases: str, sets: tuple[str, object] | None = None) -> Option:
    """An option without arguments that sets itself, or the option and value of `sets`, for later ones."""
    return Option(name, switch(*(sets or (name,))), text=text, state=True, aliases=aliases)


_QUALITY = "Set the quality of lossy compression, 0 to 100"
OPTIONS = (
    Option("-d TYPE", set_type, state=True),
    state("--scanline", "Write scanlines instead of tiles"),
    Option("--tile WIDTH HEIGHT", set_tile, state=True),
    Option("--compression NAME", set_text("--compression"), text="Set the compression, as NAME or NAME:N", state=True),
    Option("--quality N", set_text("--quality", whole_number), text=_QUALITY, state=True),
    state("--dither", "Dither when quantizing to 8 bits"),
    Option("--planarconfig CONFIG", set_planar, state=True),
    state("--adjust-time", "Set the time of written files from their DateTime metadata"),
    state("--noautocrop", "Write the data window to formats with a single window", sets=("--autocrop", False)),
    state("--autotrim", "Trim black borders in formats that have a data window"),
    state("--history", "Write the command line to the metadata of files"),
    state("--no-history", "Write only a hash of the command line (default)", sets=("--history", False)),
    state("--nosoftwareattrib", "Omit all metadata about this program"),
    state("-n", "Write no files: a dry run"),
    state("-u", "Skip outputs that are newer than their inputs"),
    state("--no-clobber", "Never overwrite existing files", "--noclobber"),
    state("--create-dir", "Create missing folders of outputs"),
)
