# SPDX-License-Identifier: Apache-2.0
"""All ops and options of a command line."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

from ... import filters
from ...engine.deferred import Shelf
from .. import host
from .language.parse import ADDED, FURTHER, Language, Option, Refused

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

REFUSED = (
    Refused("--capture", 0, "OpenImageIO's wheel is built without OpenCV; save the camera's image to a file"),
    Refused("--gpu", 0, "OpenImageIO's wheel is built without GPU support; --device selects where --tex... ops run"),
)

_OPTIONS: dict[str, dict[str, str]] = {  # by heading and module, in the order of help; --help takes the first word
    "Reading": {
        "files.reading": "-i --iconfig --missingfile --testread -a --native --no-autopremult --autopremult"
        " --autoorient --auto-orient --autocc --noautocc",
    },
    "Writing": {
        "files.output": "-o -d --scanline --tile --compression --quality --dither --planarconfig --adjust-time"
        " --noautocrop --autotrim --history --no-history --nosoftwareattrib -n -u --no-clobber --noclobber"
        " --create-dir --iccwrite",
        "files.textures": "-otex -oenv -obump",
    },
    "Stack, subimages and MIP levels": {
        "stack.moves": "--label --dup --swap --pop --popbottom --stackreverse --stackextract --stackclear --subimage"
        " --sisplit --siappend --siappendall --layersplit --unmip --selectmip --thumbnail-get --thumbnail-set",
    },
    "Printing and comparing": {
        "printing.texts": "--info --printinfo --stats --printstats --hash --dumpdata --metamatch --no-metamatch"
        " --colorcount --rangecheck --echo",
        "printing.comparing": "--diff --pdiff --flipdiff --fail --failpercent --hardfail --warn --warnpercent"
        " --hardwarn",
        "printing.inventory": "--list-formats --buildinfo --colorconfiginfo",
    },
    "Viewing": {"files.viewing": "--tev"},
    "Control flow": {
        "language.control": "--set --if --else --endif --while --endwhile --for --endfor --evaloff --evalon"
        " --oiioattrib",
    },
    "Run settings": {
        "language.control:STATES": "-v --verbose --maxloop --no-error-exit --metamerge --sansattrib --autotile"
        " --experimental",
        "running.run_settings": "--device --devices --threads --cache --colorconfig --interchange -q --noprogress"
        " --runstats --debug --version --completion --plugin-path --cache-info --cache-clear --help -h",
        "language.each": "--each",
        "language.sequences": "--frames --framepadding --views --wildcardoff --wildcardon --skip-bad-frames"
        " --parallel-frames",
        "running.shares": "--share --join --openjd",
    },
}
_SHELVES = tuple(
    Shelf(heading, f"{__package__}.{module}", tuple(names.split()), attribute or "OPTIONS")
    for heading, modules in _OPTIONS.items()
    for (module, _, attribute), names in ((place.partition(":"), names) for place, names in modules.items())
)
_WORDS = {shelf.heading: "texture" for shelf in filters.SHELVES} | {FURTHER: "texture"}
_WORDS |= {shelf.heading: shelf.attribute.lower() for shelf in host.SHELVES}
_WORDS |= {heading: heading.replace(",", "").split()[0].lower() for heading in _OPTIONS}


@functools.cache
def added(name: str) -> tuple[Option, ...]:
    """The option of a name (without dashes) that another distribution adds; all that others add for ''."""
    from ...python.declared_entries import installed

    names = {name for shelf in (*filters.SHELVES, *host.SHELVES, *_SHELVES) for name in shelf.names}

    def checked(entry: EntryPoint) -> Option:
        option = entry.load()
        if not isinstance(option, Option) or option.name != f"--{entry.name}":
            raise TypeError(f"expected an Option named --{entry.name}")
        if option.name in names or option.aliases:
            raise TypeError(f"option '{option.name}' already exists, or has aliases")
        if option.heading not in ADDED:
            raise TypeError(f"heading must be one of {', '.join(ADDED)}")
        option.parameters()  # finds invalid declarations
        names.add(option.name)
        return option

    return installed("option", checked, name)


LANGUAGE = Language(
    (*filters.SHELVES, *host.SHELVES, *_SHELVES), REFUSED, filters.further, added, ("--farm", "--texlive"), _WORDS
)
