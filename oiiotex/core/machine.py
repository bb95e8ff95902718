# SPDX-License-Identifier: Apache-2.0
"""What this process may use of the machine: threads and memory."""

from __future__ import annotations

import math
import os
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
