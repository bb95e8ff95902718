# SPDX-License-Identifier: Apache-2.0
"""All that a command line may say, put together."""

from __future__ import annotations

from .. import filters, host
from . import output, reading
from .parse import Language, Option

SETTINGS = (
    Option("--device", ("DEVICE",), "OpenCL device: number, gpu, cpu or part of its name; else $OIIOTEX_DEVICE"),
    Option("--devices", (), "list the OpenCL devices"),
    Option("--threads", ("N",), "CPU threads; 0: as many as the process may use"),
    Option("--cache", ("MB",), "memory budget; a quarter of the machine's when left out"),
    Option("--autocc", (), "let the config's file rules name the space of files that do not say it"),
    Option("--colorconfig", ("FILE",), "OCIO config; else $OCIO, else a built-in one"),
    Option("-v", (), "say what is done, and measure the results", aliases=("--verbose",)),
    Option("--runstats", (), "say where the time went, and measure the results"),
    Option("--debug", (), "show a traceback where something fails"),
    Option("--version", (), "print versions"),
    Option("--help", (), "print this, or with a name behind it that op's page", aliases=("-h",)),
)

LANGUAGE = Language(
    ops={op.flag(): op for op in (*filters.FILTERS, *host.OPS)},
    options=(*reading.OPTIONS, *output.OPTIONS, *SETTINGS),
)
