# SPDX-License-Identifier: Apache-2.0
"""Folders of plugins that are built once: kept in the environment until something changes that they are built from."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from pathlib import Path


def kept(name: str, source: Path, *facts: str) -> Path:
    """A folder for what this Python and the machine's C++ compiler build from `source`; older ones are removed."""
    digest = hashlib.sha256(repr((sys.executable, facts)).encode())
    digest.update(subprocess.run(["c++", "--version"], capture_output=True, check=True).stdout)
    for path in sorted(source.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(f"{path.relative_to(source)}\0".encode() + path.read_bytes())
    folder = Path(sys.prefix, "builds", f"{name}-{digest.hexdigest()[:16]}")
    for old in set(folder.parent.glob(f"{name}-*")) - {folder}:
        shutil.rmtree(old, ignore_errors=True)  # another process may do the same
    folder.mkdir(parents=True, exist_ok=True)
    return folder
