# SPDX-License-Identifier: Apache-2.0
"""All that a command line may say, put together."""

from __future__ import annotations

import sys

from .. import filters, host
from ..op import Op
from . import control, output, printing, reading, sequences, stack, textures
from .output import switch
from .parse import Language, Option, Refused

_DEEP = "deep images are not supported"

SETTINGS = (
    Option("--device", ("DEVICE",), "OpenCL device: number, gpu, cpu or part of its name; else $OIIOTEX_DEVICE"),
    Option("--devices", (), "list the OpenCL devices"),
    Option("--threads", ("N",), "CPU threads; 0: as many as the process may use"),
    Option("--cache", ("MB",), "memory budget; a quarter of the machine's when left out"),
    Option("--colorconfig", ("FILE",), "OCIO config; else $OCIO, else a built-in one"),
    Option(
        "--interchange", ("SPACE", "OURS"), "SPACE of a config without interchange roles is lin_rec709, ACES2065-1 ..."
    ),
    Option("-v", (), "say what is done, and measure the results", aliases=("--verbose",)),
    Option("-q", (), "print less"),
    Option("--runstats", (), "say where the time went, and measure the results"),
    Option("--debug", (), "show a traceback where something fails"),
    Option("--version", (), "print versions"),
    Option("--completion", ("SHELL",), "print what bash or zsh needs to complete command lines"),
    Option("--help", (), "print this, or with a name behind it that op's page", aliases=("-h",)),
    *(Option(name, *facts) for name, facts in sequences.SETTINGS.items()),
)
_STATES = (
    Option("--no-error-exit", (), "go on with the next step where one fails", switch("--no-error-exit"), state=True),
    Option("--metamerge", (), "results have the metadata of all their inputs", switch("--metamerge"), state=True),
    Option("--sansattrib", (), "--history without --attrib and --sattrib", switch("--sansattrib"), state=True),
    Option(
        "--autotile",
        ("SIZE",),
        "nothing: images are always read piece by piece here",
        lambda chain, size: None,
        state=True,
    ),
    Option("--experimental", (), "nothing: no op is experimental here", lambda chain: None, state=True),
)

REFUSED = (
    Refused("--capture", 0, "OpenImageIO's wheel has no OpenCV; save the camera's picture to a file"),
    Refused("--gpu", 0, "OpenImageIO's own GPU support is not in its wheel; --device chooses where --tex... ops run"),
    Refused("--deepmerge", 0, _DEEP),
    Refused("--deepholdout", 0, _DEEP),
    Refused("--deepen", 0, _DEEP),
    Refused("--flatten", 0, _DEEP),
    Refused("--thumbnail-set", 0, "OpenImageIO cannot write thumbnails from Python"),
)


def _heading(op: type[Op]) -> str:
    """What its module says that it is about."""
    return (sys.modules[op.__module__].__doc__ or "").partition("\n")[0].rstrip(".:")


def _by_heading(ops: tuple[type[Op], ...]) -> dict[str, tuple[type[Op], ...]]:
    found: dict[str, tuple[type[Op], ...]] = {}
    for op in ops:
        found[_heading(op)] = (*found.get(_heading(op), ()), op)
    return found


LANGUAGE = Language(
    ops={"Texture filters": filters.FILTERS, **_by_heading(host.OPS)},
    groups={
        "Reading": reading.OPTIONS,
        "Writing": (*output.OPTIONS, *textures.OPTIONS),
        "The stack, and parts of images": stack.OPTIONS,
        "Printing and comparing": printing.OPTIONS,
        "Control flow": control.OPTIONS,
        "The run": (*_STATES, *SETTINGS),
    },
    refused=REFUSED,
)
