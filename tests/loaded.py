# SPDX-License-Identifier: Apache-2.0
"""All that a line may ask for, imported: the program itself imports what a line names."""

import OpenImageIO
import PyOpenColorIO

from oiiotex.cli.printing import caches, devices, help, report, shells
from oiiotex.cli.running import frame_runs, parallel
from oiiotex.cli.vocabulary import LANGUAGE

__all__ = [
    "OpenImageIO",
    "PyOpenColorIO",
    "caches",
    "devices",
    "frame_runs",
    "help",
    "parallel",
    "report",
    "shells",
]
assert LANGUAGE.ops and LANGUAGE.groups  # all of their files are imported
