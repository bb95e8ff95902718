# SPDX-License-Identifier: Apache-2.0
"""Options that print file formats, OpenImageIO's build and the color config: output of the oiiotool in its wheel."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from subprocess import PIPE

from ....engine.deferred import oiio
from ....engine.errors import Error, one_line
from ....engine.machine import start
from ..language.parse import Option
from ..stack.chain import Chain


def color_config_info(chain: Chain) -> None:
    """Print the contents of the color config."""
    path = chain.session.resources.color.path
    _say(chain, "--colorconfig", os.path.abspath(path) if os.path.isfile(path) else path, "--colorconfiginfo")


def _say(chain: Chain, *words: str) -> None:
    """Print the output of the oiiotool in OpenImageIO's wheel, never of another one."""
    if not chain.acts():
        return
    folder = Path(oiio.__file__).parent / "bin"
    program = shutil.which("oiiotool", path=folder)
    if program is None:
        raise Error(f"expected oiiotool in {folder}: install OpenImageIO from PyPI")
    process = start([program, *words], stdout=PIPE, stderr=PIPE, text=True)
    text, errors = process.communicate()
    if process.returncode:
        raise Error(one_line(errors or text))
    print(text, end="")


_FORMATS = "Print the supported file formats and their extensions"
OPTIONS = (
    Option("--list-formats", lambda chain: _say(chain, "--list-formats"), text=_FORMATS, state=True),
    Option("--buildinfo", lambda chain: _say(chain, "--buildinfo"), text="Print how OpenImageIO was built", state=True),
    Option("--colorconfiginfo", color_config_info, state=True),
)
