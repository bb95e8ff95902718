# SPDX-License-Identifier: Apache-2.0
"""Processes of ours: started so that they take no code from the current folder."""

from __future__ import annotations

import os
import sys
import sysconfig
from pathlib import Path


def isolated(module: str, *arguments: str) -> list[str]:
    """The command that runs a module of ours in a Python that takes no code from the current folder.

    It looks where this process looks (an environment, an editable installation, a folder of PYTHONPATH), less the
    current folder, which `python -m` and `python -c` put first.
    """
    start = (
        f"import sys; sys.path[:] = {search_path()!r}; import runpy;"
        f" runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    )
    return [sys.executable, "-I", "-c", start, *arguments]


def search_path() -> list[str]:
    """Where this process looks for modules, less the current folder."""
    own = set(sysconfig.get_paths().values())  # of the interpreter, even where somebody works there
    here = os.path.realpath(os.curdir)
    entries = [p for p in sys.path if os.path.isabs(p) and (p in own or os.path.realpath(p) != here)]
    return [*entries, str(Path(__file__).resolve().parents[2])]
