# SPDX-License-Identifier: Apache-2.0
"""All that a command line may say, put together."""

from __future__ import annotations

from .. import filters, host
from ..deferred import Shelf
from .language.parse import Language, Refused

REFUSED = (
    Refused("--capture", 0, "OpenImageIO's wheel has no OpenCV; save the camera's picture to a file"),
    Refused("--gpu", 0, "OpenImageIO's own GPU support is not in its wheel; --device chooses where --tex... ops run"),
)

_OPTIONS = tuple(
    Shelf(heading, f"{__package__}.{module}", tuple(names.split()), attribute)
    for heading, module, attribute, names in (
        (
            "Reading",
            "files.reading",
            "OPTIONS",
            "-i --iconfig --missingfile --testread -a --native --no-autopremult --autopremult --autoorient"
            " --auto-orient --autocc --noautocc",
        ),
        (
            "Writing",
            "files.output",
            "OPTIONS",
            "-o -d --scanline --tile --compression --quality --dither --planarconfig --adjust-time --noautocrop"
            " --autotrim --history --no-history --nosoftwareattrib -n -u --no-clobber --noclobber --create-dir"
            " --iccwrite",
        ),
        (
            "Writing",
            "files.textures",
            "OPTIONS",
            "-otex -oenv -obump",
        ),
        (
            "The stack, and parts of images",
            "stack.moves",
            "OPTIONS",
            "--label --dup --swap --pop --popbottom --stackreverse --stackextract --stackclear --subimage"
            " --sisplit --siappend --siappendall --layersplit --unmip --selectmip --thumbnail-get --thumbnail-set",
        ),
        (
            "Printing and comparing",
            "printing.texts",
            "OPTIONS",
            "--info --printinfo --stats --printstats --hash --dumpdata --metamatch --no-metamatch --colorcount"
            " --rangecheck --echo",
        ),
        (
            "Printing and comparing",
            "printing.comparing",
            "OPTIONS",
            "--diff --pdiff --flipdiff --fail --failpercent --hardfail --warn --warnpercent --hardwarn",
        ),
        (
            "Printing and comparing",
            "printing.inventory",
            "OPTIONS",
            "--list-formats --buildinfo --colorconfiginfo",
        ),
        (
            "Looking",
            "files.viewing",
            "OPTIONS",
            "--tev",
        ),
        (
            "Looking",
            "running.living",
            "OPTIONS",
            "--texlive",
        ),
        (
            "Control flow",
            "language.control",
            "OPTIONS",
            "--set --if --else --endif --while --endwhile --for --endfor --evaloff --evalon --oiioattrib",
        ),
        (
            "The run",
            "language.control",
            "STATES",
            "-v --verbose --maxloop --no-error-exit --metamerge --sansattrib --autotile --experimental",
        ),
        (
            "The run",
            "running.run_settings",
            "OPTIONS",
            "--device --devices --threads --cache --colorconfig --interchange -q --noprogress --runstats"
            " --debug --version --completion --manpage --plugin-path --cache-info --cache-clear --help -h",
        ),
        (
            "The run",
            "language.sequences",
            "OPTIONS",
            "--frames --framepadding --views --wildcardoff --wildcardon --skip-bad-frames --parallel-frames",
        ),
        (
            "The run",
            "running.shares",
            "OPTIONS",
            "--share --join --farm --openjd",
        ),
    )
)

LANGUAGE = Language((*filters.SHELVES, *host.SHELVES, *_OPTIONS), REFUSED, filters.further)
