# SPDX-License-Identifier: Apache-2.0
"""Options that say how images are written from where they stand on."""

from __future__ import annotations

from typing import Any

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
    """The pixel type of what is written from here on, or with CHANNEL=TYPE that of single channels."""
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
    """Tiles of that size from here on."""
    sides = []
    for text in (width, height):
        if not (text.isascii() and text.isdigit() and 0 < int(text) <= 65536):
            raise ParameterError(f"'{width} {height}': expected two whole numbers from 1 to 65536")
        sides.append(int(text))
    chain.settings["--tile"] = tuple(sides)
    chain.settings.pop("--scanline", None)


def set_planar(chain: Chain, text: str) -> None:
    """How channels are stored from here on."""
    if text not in ("contig", "separate", "default"):
        raise ParameterError(f"'{text}': expected contig, separate or default")
    chain.settings["--planarconfig"] = None if text == "default" else text


def set_quality(chain: Chain, text: str) -> None:
    """Quality of lossy compression from here on."""
    chain.settings["--quality"] = whole_number(text)


def switch(option: str, value: object = True) -> Any:
    """What sets an option for later ones."""

    def run(chain: Chain) -> None:
        chain.settings[option] = value

    return run


def set_text(option: str) -> Any:
    """What keeps an option's argument for later ones."""

    def run(chain: Chain, text: str) -> None:
        chain.settings[option] = text

    return run


def _state(name: str, help: str, *aliases: str, sets: tuple[str, object] | None = None) -> Option:
    return Option(name, (), help, switch(*(sets or (name,))), state=True, aliases=aliases)


OPTIONS = (
    Option(
        "-d",
        ("TYPE",),
        "pixel type of what is written from here on: uint8, uint10, half, float ..., or CHANNEL=TYPE,...",
        set_type,
        state=True,
    ),
    _state("--scanline", "write scanlines, whatever the source has"),
    Option("--tile", ("WIDTH", "HEIGHT"), "write tiles of this size", set_tile, state=True),
    Option("--compression", ("NAME",), "compression: NAME or NAME:QUALITY", set_text("--compression"), state=True),
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
)
