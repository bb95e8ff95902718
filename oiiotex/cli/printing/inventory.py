# SPDX-License-Identifier: Apache-2.0
"""Options that print what there is: file formats, OpenImageIO's build, the color config. Its own oiiotool says it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from ...deferred import oiio
from ...errors import Error, one_line
from ..language.parse import Option
from ..stack.chain import Chain


def list_formats(chain: Chain) -> None:
    """Print the file formats and their extensions."""
    _say(chain, "--list-formats")


def build_info(chain: Chain) -> None:
    """Print what OpenImageIO was built from."""
    _say(chain, "--buildinfo")


def color_config_info(chain: Chain) -> None:
    """Print the contents of the color config."""
    _say(chain, "--colorconfig", chain.session.color.path, "--colorconfiginfo")


def _say(chain: Chain, *words: str) -> None:
    """Print what the oiiotool of OpenImageIO's wheel prints; no other one is started."""
    if not chain.acts():
        return
    folder = Path(oiio.__file__).parent / "bin"
    program = shutil.which("oiiotool", path=folder)
    if program is None:
        raise Error(f"expected oiiotool in {folder}: install OpenImageIO from PyPI")
    done = subprocess.run([program, *words], capture_output=True, text=True)
    if done.returncode:
        raise Error(one_line(done.stderr or done.stdout))
    print(done.stdout, end="")


OPTIONS = (
    Option("--list-formats", list_formats, state=True),
    Option("--buildinfo", build_info, state=True),
    Option("--colorconfiginfo", color_config_info, state=True),
)
