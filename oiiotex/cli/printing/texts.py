# SPDX-License-Identifier: Apache-2.0
"""Options that print texts of images, as they are read or of the top one.

Where we depart from oiiotool
-----------------------------
1. Regular expressions of --metamatch are Python's, with the letter classes of POSIX added.
2. --stats of unsigned 32 bit images are of 4294967295; oiiotool multiplies by -1. --dumpdata prints int8 as numbers.
3. --printinfo:native=1 is of the image as it is now, with what --attrib has set.
4. Where an image came from (oiio:SourcePath, oiio:SourceFileFormat) is said of its file, also where --eraseattrib has
   been at work, and for all parts alike.
5. --hash refuses files with channels of integers and of floats. Of deep files only --info and --printinfo print.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

from ...core.image import Image
from ...core.parameters import param
from ...core.window import Window
from ...deferred import np
from ...errors import ParameterError
from ..language.parse import Option
from ..stack.chain import Chain, require_flat
from ..stack.output_settings import set_text, state
from .metadata import Asked, Dump, description, unescaped
from .pixel_statistics import color_counts, range_counts


def _asked(chain: Chain) -> Asked:
    """What the options so far ask for."""
    settings = chain.settings
    info = settings.get("--info")
    return Asked(
        verbose=bool(settings.get("-v") or (info and info.verbose)),
        all_parts=chain.session.settings.all_parts,
        match=settings.get("--metamatch", ""),
        no_match=settings.get("--no-metamatch", ""),
        hash=bool(settings.get("--hash")),
        statistics=bool(settings.get("--stats")),
        dump=settings.get("--dumpdata"),
    )


def print_input(chain: Chain, image: Image, info: int | None = None, infoformat: str = "") -> None:
    """Print what --info, --stats, --hash and --dumpdata ask of a file, or -i by its modifiers (info: 0, 1, 2)."""
    settings = chain.settings
    level = int("--info" in settings) if info is None else info
    asked = _asked(chain)
    if asked.reads_pixels:
        require_flat([image])
    elif not level:
        return
    form = infoformat or (settings["--info"].format if "--info" in settings else "")
    asked = replace(
        asked, verbose=asked.verbose or level > 1, all_parts=asked.all_parts or level > 1, xml=form.lower() == "xml"
    )
    _print(chain, image, asked, image.source)


def _print(chain: Chain, image: Image, asked: Asked, filename: str = "") -> None:
    if not chain.acts(*(image.parts if asked.reads_pixels else ())):
        return
    with chain.session.resources.stats.time("print"):
        for text in description(image, asked, filename):
            print(text, end="")
    sys.stdout.flush()


# --- texts of images ---


@dataclass(frozen=True)
class InfoModifiers:
    """Of --info."""

    format: str = param("", choices=("", "text", "xml"), help="as text or xml")
    verbose: bool = param(False, help="with all metadata, as -v does")


def print_inputs(chain: Chain, given: InfoModifiers) -> None:
    """Print the size of every image as it is read; with -v its metadata."""
    chain.settings["--info"] = given


@dataclass(frozen=True)
class PrintInfoModifiers:
    """Of --printinfo."""

    allsubimages: bool | None = param(None, help="of all parts; as -a says when left out")
    native: bool = param(False, help="pixel types as in the file, not as ops see them")
    stats: bool | None = param(None, help="with statistics; as --stats says when left out")
    verbose: bool = param(True, help="with all metadata")


def print_top(chain: Chain, given: PrintInfoModifiers) -> None:
    """Print the size and metadata of the top image."""
    asked = _asked(chain)
    asked = replace(
        asked,
        verbose=given.verbose,
        native=given.native,
        all_parts=asked.all_parts if given.allsubimages is None else given.allsubimages,
        statistics=asked.statistics if given.stats is None else given.stats,
    )
    _print(chain, chain.top, asked)


@dataclass(frozen=True)
class PrintStatsModifiers:
    """Of --printstats."""

    allsubimages: bool | None = param(None, help="of all parts; as -a says when left out")
    native: bool = param(False, help="nothing, as in oiiotool: statistics are of the file's own numbers")
    window: str = param("", help="of this window alone: WxH+X+Y or X0,Y0,X1,Y1")


def print_statistics(chain: Chain, given: PrintStatsModifiers) -> None:
    """Print the pixel statistics of the top image."""
    asked, first = _asked(chain), chain.top.first
    asked = replace(
        asked,
        statistics=True,
        all_parts=asked.all_parts if given.allsubimages is None else given.allsubimages,
        window=_window(given.window, first.window),  # of the first part, also for the others
        channels=first.spec.nchannels,
    )
    _print(chain, chain.top, asked)


def _window(text: str, whole: Window) -> Window:
    from ...host.geometry_text import box_of, parse_box

    window = parse_box(text, box_of(whole), scaling=True).window() if text else whole
    if window.empty:
        raise ParameterError(f"window={text}: it has no pixel")
    return window


def dump_inputs(chain: Chain, given: Dump) -> None:
    """Print the pixels of every image as it is read."""
    chain.settings["--dumpdata"] = given


# --- counting ---


@dataclass(frozen=True)
class CountModifiers:
    """Of --colorcount."""

    eps: str = param("0.001", help="how far a value may be off, per channel")


def count_colors(chain: Chain, text: str, given: CountModifiers) -> None:
    """Count the pixels of each color: R,G,B;R,G,B ..."""
    from ...host.arithmetic import numbers_for_channels

    part = chain.top.first
    words = text.split(":" if ":" in text else ";")
    colors = np.array([numbers_for_channels(word, part.spec.nchannels, 0.0) for word in words], np.float32)
    tolerance = np.array(numbers_for_channels(given.eps, part.spec.nchannels, 0.001), np.float32)
    if not chain.acts(part):
        return
    for word, count in zip(words, color_counts(part, colors, tolerance), strict=True):
        print(f"{count:8}  {word}")


def check_range(chain: Chain, low: str, high: str) -> None:
    """Count the pixels outside a range of colors."""
    from ...host.arithmetic import numbers_for_channels

    part = chain.top.first
    count = part.spec.nchannels
    bounds = numbers_for_channels(low, count, 0.0), numbers_for_channels(high, count, 1.0)
    if not chain.acts(part):
        return
    below, above, within = range_counts(part, *bounds)
    print(f"{below:8}  < {low}\n{above:8}  > {high}\n{within:8}  within range")


# --- texts of the program ---


@dataclass(frozen=True)
class EchoModifiers:
    """Of --echo."""

    newline: int = param(1, ge=0, help="how many line ends follow")


def echo(chain: Chain, text: str, given: EchoModifiers) -> None:
    """Print a text."""
    if chain.acts():
        print(unescaped(text), end="\n" * given.newline, flush=True)


OPTIONS = (
    Option("--info", print_inputs, InfoModifiers, state=True),
    Option("--printinfo", print_top, PrintInfoModifiers, needs=1),
    state("--stats", "Print pixel statistics of every image as it is read"),
    Option("--printstats", print_statistics, PrintStatsModifiers, needs=1, flat=True),
    state("--hash", "Print the SHA-1 of the pixels of every image as it is read"),
    Option("--dumpdata", dump_inputs, Dump, state=True),
    Option("--metamatch REGEX", set_text("--metamatch"), text="Which metadata to print, by name", state=True),
    Option("--no-metamatch REGEX", set_text("--no-metamatch"), text="Which metadata not to print", state=True),
    Option("--colorcount COLORS", count_colors, CountModifiers, needs=1, flat=True),
    Option("--rangecheck LOW HIGH", check_range, needs=1, flat=True),
    Option("--echo TEXT", echo, EchoModifiers, state=True),
)
