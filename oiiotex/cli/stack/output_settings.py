# SPDX-License-Identifier: Apache-2.0
"""Options that say how images are written from where they stand on."""

from __future__ import annotations

from collections.abc import Callable

from ...core.image import type_named
from ...deferred import oiio
from ...errors import ParameterError
from ..language.parse import Option, whole_number
from .chain import Chain

_NARROW = {"uint10": ("uint16", 10), "uint12": ("uint16", 12), "uint6": ("uint8", 6), "uint4": ("uint8", 4)}
_NARROW |= {"uint2": ("uint8", 2), "uint1": ("uint8", 1)}


def pixel_type(text: str) -> tuple[oiio.TypeDesc, int]:
    """The type that a -d name means, and its significant bits where they are fewer; else 0."""
    name, bits = _NARROW.get(text, (text, 0))
    return type_named(name), bits


def set_type(chain: Chain, text: str) -> None:
    """Set the pixel type of what is written from here on: uint8, uint10, half, float ..., or CHANNEL=TYPE,..."""
    if "=" not in text:
        chain.settings["-d"] = pixel_type(text)
        chain.settings.pop("-d channels", None)
        return
    named = dict(chain.settings.get("-d channels", {}))
    for piece in text.split(","):
        channel, equals, name = piece.partition("=")
        if not (channel and equals):
            raise ParameterError(f"'{piece}' is not CHANNEL=TYPE")
        named[channel] = pixel_type(name)[0]
    chain.settings["-d channels"] = named


def set_tile(chain: Chain, width: str, height: str) -> None:
    """Write tiles of this size."""
    sides = []
    for text in (width, height):
        if not (text.isascii() and text.isdigit() and 0 < int(text) <= 65536):
            raise ParameterError(f"'{width} {height}': expected two whole numbers from 1 to 65536")
        sides.append(int(text))
    chain.settings["--tile"] = tuple(sides)
    chain.settings.pop("--scanline", None)


def set_planar(chain: Chain, text: str) -> None:
    """Store channels so from here on: contig, separate or default."""
    if text not in ("contig", "separate", "default"):
        raise ParameterError(f"'{text}': expected contig, separate or default")
    chain.settings["--planarconfig"] = None if text == "default" else text


def set_quality(chain: Chain, text: str) -> None:
    """Set the quality of lossy compression, 0 to 100."""
    chain.settings["--quality"] = whole_number(text)


def switch(option: str, value: object = True) -> Callable[[Chain], None]:
    """What sets an option for later ones."""

    def run(chain: Chain) -> None:
        chain.settings[option] = value

    return run


def set_text(option: str) -> Callable[[Chain, str], None]:
    """What keeps an option's argument for later ones."""

    def run(chain: Chain, text: str) -> None:
        chain.settings[option] = text

    return run


def state(name: str, text: str, *aliases: str, sets: tuple[str, object] | None = None) -> Option:
    """An option without arguments that sets one of later ones: itself, unless `sets` says which to what."""
    return Option(name, switch(*(sets or (name,))), text=text, state=True, aliases=aliases)


OPTIONS = (
    Option("-d TYPE", set_type, state=True),
    state("--scanline", "Write scanlines, whatever the source has"),
    Option("--tile WIDTH HEIGHT", set_tile, state=True),
    Option("--compression NAME", set_text("--compression"), text="Compression: NAME or NAME:QUALITY", state=True),
    Option("--quality N", set_quality, state=True),
    state("--dither", "Dither when quantizing to 8 bits"),
    Option("--planarconfig CONFIG", set_planar, state=True),
    state("--adjust-time", "Give written files the time that their metadata says"),
    state("--noautocrop", "Write the data window to formats without a display window", sets=("--autocrop", False)),
    state("--autotrim", "Trim black borders, where the format has a data window"),
    state("--history", "Write the command line into the files' metadata"),
    state("--no-history", "Write only a hash of the command line (default)", sets=("--history", False)),
    state("--nosoftwareattrib", "Write nothing of this program into the files' metadata"),
    state("-n", "Write nothing: a dry run"),
    state("-u", "Do not write files that are newer than their inputs"),
    state("--no-clobber", "Do not overwrite files", "--noclobber"),
    state("--create-dir", "Create the folders of written files"),
)
