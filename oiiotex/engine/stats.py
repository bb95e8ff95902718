# SPDX-License-Identifier: Apache-2.0
"""Seconds by stage, as printed by `--runstats`. Imports no other module of oiiotex."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Stats:
    """Seconds and calls by name, in the order of first use."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}
        self.watch: Callable[[str, bool], object] | None = None  # called at the begin (True) and end of each block

    def add(self, name: str, seconds: float) -> None:
        """Count one call of `name` that took `seconds`."""
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
        self.calls[name] = self.calls.get(name, 0) + 1

    @contextmanager
    def time(self, name: str) -> Iterator[None]:
        """Count the wall time of a block as one call of `name`."""
        start = time.perf_counter()
        if self.watch is not None:
            self.watch(name, True)
        try:
            yield
        finally:
            if self.watch is not None:
                self.watch(name, False)
            self.add(name, time.perf_counter() - start)
