# SPDX-License-Identifier: Apache-2.0
"""What this process may use of the machine, threads and memory; how it starts another of ours."""

from __future__ import annotations

import math
import os
import sys
import sysconfig
from pathlib import Path


def usable_threads() -> int:
    """CPU threads that this process may use: by affinity, and by the quota of its cgroup."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    for quota in _quotas():
        count = min(count, max(1, math.ceil(quota)))
    return count


def _quotas() -> list[float]:
    """CPUs that the cgroup allows, where it says so."""
    quotas = []
    try:
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text().split()
        quotas.append(int(quota) / int(period))
    except (OSError, ValueError):  # absent, or the word 'max'
        pass
    try:
        folder = Path("/sys/fs/cgroup/cpu")
        quota, period = ((folder / f"cpu.cfs_{n}_us").read_text() for n in ("quota", "period"))
        if int(quota) > 0:
            quotas.append(int(quota) / int(period))
    except (OSError, ValueError):
        pass
    return quotas


def memory() -> int:
    """Bytes of memory that this process may use: the machine's, or less where a cgroup says so."""
    installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 8 << 30
    limits = [installed]
    for name in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            limits.append(int(Path(name).read_text()))
        except (OSError, ValueError):  # absent, or the word 'max'
            continue
    return min(limits)


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
