# SPDX-License-Identifier: Apache-2.0
"""Options that apply to the whole run, wherever they stand, and options that print and end."""

from __future__ import annotations

from ..language.parse import settings_of

OPTIONS = settings_of(
    (
        "--device DEVICE",
        "Select the OpenCL device: number, gpu, cpu or part of its name. Default: $OIIOTEX_DEVICE, else a GPU or CPU",
    ),
    ("--devices", "List the OpenCL devices and whether they work; with -v all details"),
    ("--threads N", "Set the number of CPU threads, 0 to 4096. Default: 0, all that the process may use"),
    ("--cache MB", "Set the memory budget, in MB. Default: a quarter of the machine's memory"),
    ("--colorconfig FILE", "Set the OCIO config. Default: $OCIO, else a built-in config"),
    (
        "--interchange SPACE OURS",
        "Identify SPACE of a config without interchange roles as OURS: lin_rec709, ACES2065-1 ...",
    ),
    ("-q", "Print errors only"),
    ("--noprogress", "Print no progress"),
    ("--runstats", "Print the time of each step, and measure the results"),
    ("--debug", "Print a traceback after an error"),
    ("--version", "Print the versions of the program and its libraries"),
    ("--completion SHELL", "Print a script that completes command lines in bash, zsh or fish"),
    ("--plugin-path", "Print the folder of the plugin with which OpenImageIO reads .oiiotex files"),
    ("--cache-info", "Print the contents of the cache folder"),
    ("--cache-clear", "Empty the cache folder"),
    (
        "--help",
        "Print one screen of help, or help on the next word: all, a group, OP, OP:MODIFIER, :MODIFIER or any word",
        "-h",
    ),
)
