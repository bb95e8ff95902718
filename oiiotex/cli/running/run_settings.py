# SPDX-License-Identifier: Apache-2.0
"""Settings that hold for the whole run, wherever they stand, and what prints something and ends."""

from __future__ import annotations

from ..language.parse import Option

OPTIONS = tuple(
    Option(call, text=text, aliases=tuple(aliases))
    for call, text, *aliases in (
        ("--device DEVICE", "OpenCL device: number, gpu, cpu or part of its name; else $OIIOTEX_DEVICE"),
        ("--devices", "List the OpenCL devices and whether they work; with -v what was tried and why"),
        ("--threads N", "Number of CPU threads, 0 to 4096. Default: 0, as many as the process may use"),
        ("--cache MB", "Memory budget; default: a quarter of the machine's"),
        ("--colorconfig FILE", "OCIO config; else $OCIO, else a built-in one"),
        ("--interchange SPACE OURS", "SPACE of a config without interchange roles is lin_rec709, ACES2065-1 ..."),
        ("-q", "Print less"),
        ("--noprogress", "No bar on a terminal, and no lines of progress in a log"),
        ("--runstats", "Say where the time went, and measure the results"),
        ("--debug", "Show a traceback where something fails"),
        ("--version", "Print versions"),
        ("--completion SHELL", "Print what bash, zsh or fish needs to complete command lines"),
        ("--manpage", "Print the page for man"),
        ("--plugin-path", "Print where the plugin lies by which OpenImageIO opens .oiiotex files"),
        ("--cache-info", "Print what lies in the cache folder"),
        ("--cache-clear", "Empty the cache folder"),
        ("--help", "Print this, or with a name after it that op's page; OP:MODIFIER: of one", "-h"),
    )
)
