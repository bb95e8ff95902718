# SPDX-License-Identifier: Apache-2.0
"""--plugin-path: the folder of the plugin with which OpenImageIO reads `.oiiotex` files."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from ....engine.errors import Error

_NAME = "oiiotexfile.imageio.so"


def plugin_path() -> str:
    """The value for OPENIMAGEIO_PLUGIN_PATH; Error where the plugin is not built."""
    folder = Path(sys.prefix) / "lib" / "oiiotex"
    if not (folder / _NAME).exists():
        raise Error(
            f"--plugin-path: {folder / _NAME} is not built: in a checkout run {shlex.quote(sys.executable)}"
            " hosts/openimageio/build.py (docs/how-to/hosts.md)"
        )
    return str(folder)
