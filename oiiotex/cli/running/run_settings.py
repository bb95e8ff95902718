# SPDX-License-Identifier: Apache-2.0
"""Settings that hold for the whole run, wherever they stand, and what prints something and ends."""

from __future__ import annotations

from ..language.parse import Option

OPTIONS = (
    Option("--device", ("DEVICE",), "OpenCL device: number, gpu, cpu or part of its name; else $OIIOTEX_DEVICE"),
    Option("--devices", (), "list the OpenCL devices and whether they work; with -v what was tried and why"),
    Option("--threads", ("N",), "Number of CPU threads, 0 to 4096. Default: 0, as many as the process may use."),
    Option("--cache", ("MB",), "memory budget; a quarter of the machine's when left out"),
    Option("--colorconfig", ("FILE",), "OCIO config; else $OCIO, else a built-in one"),
    Option(
        "--interchange", ("SPACE", "OURS"), "SPACE of a config without interchange roles is lin_rec709, ACES2065-1 ..."
    ),
    Option("-q", (), "print less"),
    Option("--noprogress", (), "no bar on a terminal, and no lines of progress in a log"),
    Option("--runstats", (), "say where the time went, and measure the results"),
    Option("--debug", (), "show a traceback where something fails"),
    Option("--version", (), "print versions"),
    Option("--completion", ("SHELL",), "print what bash, zsh or fish needs to complete command lines"),
    Option("--manpage", (), "print the page for man"),
    Option("--plugin-path", (), "print where the plugin lies by which OpenImageIO opens .oiiotex files"),
    Option("--cache-info", (), "what lies in the cache folder"),
    Option("--cache-clear", (), "empty the cache folder"),
    Option("--help", (), "print this, or with a name behind it that op's page; OP:MODIFIER: of one", aliases=("-h",)),
)
