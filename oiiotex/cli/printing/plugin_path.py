# SPDX-License-Identifier: Apache-2.0
"""--plugin-path: where the plugin lies by which OpenImageIO opens `.oiiotex` files."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from ...errors import Error

_NAME = "oiiotex.imageio.so"


def plugin_path() -> str:
    """The folder for OPENIMAGEIO_PLUGIN_PATH, in the environment of this Python."""
    folder = Path(sys.prefix) / "lib" / "oiiotex"
    if not (folder / _NAME).exists():
        raise Error(
            f"--plugin-path: {folder / _NAME} is not built: in a checkout run {shlex.quote(sys.executable)}"
            " hosts/openimageio/build.py (docs/how-to/hosts.md)"
        )
    return str(folder)
