# SPDX-License-Identifier: Apache-2.0
"""Options that print information on images: on each one as it is read, or on the top one.

Differences from oiiotool
-------------------------
1. Regular expressions of --metamatch are Python's, with the POSIX character classes added.
2. --stats scales unsigned 32-bit images by 4294967295; oiiotool by -1. --dumpdata prints int8 as numbers.
3. --printinfo:native=1 describes the current image, with the attributes that --attrib has set.
4. oiio:SourcePath and oiio:SourceFileFormat are those of the file for all parts, also after --eraseattrib.
5. --hash refuses files that mix integer and float channels. For deep files only --info and --printinfo work.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

from ....engine.core.image import Image
from ....engine.core.parameters import param
from ....engine.core.window import Window
from ....engine.deferred import np
from ....engine.errors import ParameterError
from ..language.parse import Option
from ..stack.chain import Chain, require_flat
from ..stack.output_settings import set_text, state
from .metadata import Asked, Dump, description, unescaped
from .pixel_statistics import color_counts, range_counts


def _asked(chain: Chain) -> Asked:
    """The output that the options so far request."""
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
    """Print the output of --info, --stats, --hash and --dumpdata for a file; -i overrides them (info: 0, 1, 2)."""
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


@dataclass(frozen=True)
class InfoModifiers:
    """Modifiers of --info."""

    format: str = param("", choices=("", "text", "xml"), unset="text", help="Format of the output.")
    verbose: bool = param(False, help="Print all metadata, as with -v.")


def print_inputs(chain: Chain, given: InfoModifiers) -> None:
    """Print the size of each image as it is read, with -v also its metadata."""
    chain.settings["--info"] = given


@dataclass(frozen=True)
class PrintInfoModifiers:
    """Modifiers of --printinfo."""

    allsubimages: bool | None = param(None, unset="1 after -a, else 0", help="Output for all parts (subimages).")
    native: bool = param(False, help="Print the pixel types of the file instead of those that ops work on.")
    stats: bool | None = param(None, unset="1 after --stats, else 0", help="Print pixel statistics.")
    verbose: bool = param(True, help="Print all metadata.")


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
    """Modifiers of --printstats."""

    allsubimages: bool | None = param(None, unset="1 after -a, else 0", help="Output for all parts (subimages).")
    native: bool = param(False, help="Accepted and ignored, for oiiotool compatibility: values are the file's own.")
    window: str = param("", unset="the data window", example="64x64+0+0", help="Region, as WxH+X+Y or X0,Y0,X1,Y1.")


def print_statistics(chain: Chain, given: PrintStatsModifiers) -> None:
    """Print the pixel statistics of the top image."""
    asked, first = _asked(chain), chain.top.first
    asked = replace(
        asked,
        statistics=True,
        all_parts=asked.all_parts if given.allsubimages is None else given.allsubimages,
        window=_window(given.window, first.window),  # the first part's, also for the others
        channels=first.spec.nchannels,
    )
    _print(chain, chain.top, asked)


def _window(text: str, whole: Window) -> Window:
    from ...host.geometry_text import box_of, parse_box

    window = parse_box(text, box_of(whole), scaling=True).window() if text else whole
    if text and window.empty:
        raise ParameterError(parameter="window", value=text, expected="a region with at least one pixel")
    return window


def dump_inputs(chain: Chain, given: Dump) -> None:
    """Print the pixel values of each image as it is read."""
    chain.settings["--dumpdata"] = given


@dataclass(frozen=True)
class CountModifiers:
    """Modifiers of --colorcount."""

    eps: str = param("0.001", example="0.01,0.01,0.02", help="Tolerance of a match: one value, or one per channel.")


def count_colors(chain: Chain, text: str, given: CountModifiers) -> None:
    """Count the pixels of each color in COLORS, such as 1,0,0:0,1,0."""
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
    """Count the pixels below LOW, above HIGH and in between."""
    from ...host.arithmetic import numbers_for_channels

    part = chain.top.first
    count = part.spec.nchannels
    bounds = numbers_for_channels(low, count, 0.0), numbers_for_channels(high, count, 1.0)
    if not chain.acts(part):
        return
    below, above, within = range_counts(part, *bounds)
    print(f"{below:8}  < {low}\n{above:8}  > {high}\n{within:8}  within range")


@dataclass(frozen=True)
class EchoModifiers:
    """Modifiers of --echo."""

    newline: int = param(1, ge=0, help="Number of line ends after the text.")


def echo(chain: Chain, text: str, given: EchoModifiers) -> None:
    """Print TEXT."""
    line = unescaped(text) + "\n" * given.newline
    chain.echoed.append(line)
    if chain.acts():
        print(line, end="", flush=True)


OPTIONS = (
    Option("--info", print_inputs, InfoModifiers, state=True),
    Option("--printinfo", print_top, PrintInfoModifiers, needs=1),
    state("--stats", "Print pixel statistics of each image as it is read"),
    Option("--printstats", print_statistics, PrintStatsModifiers, needs=1, flat=True),
    state("--hash", "Print the SHA-1 hash of the pixels of each image as it is read"),
    Option("--dumpdata", dump_inputs, Dump, state=True),
    Option("--metamatch REGEX", set_text("--metamatch"), text="Print only metadata named by REGEX", state=True),
    Option("--no-metamatch REGEX", set_text("--no-metamatch"), text="Omit metadata named by REGEX", state=True),
    Option("--colorcount COLORS", count_colors, CountModifiers, needs=1, flat=True),
    Option("--rangecheck LOW HIGH", check_range, needs=1, flat=True),
    Option("--echo TEXT", echo, EchoModifiers, state=True),
)
