# SPDX-License-Identifier: Apache-2.0
"""What a run tells while it works: how far it is, what a result will look like, lines of text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..errors import Interrupted

if TYPE_CHECKING:
    import numpy as np

Tell = Callable[[int, int], bool | None]
Onlooker = Callable[["np.ndarray", bool], object]
Say = Callable[[str], object]


@dataclass(frozen=True)
class Progress:
    """How far a run is, and who wants to know.

    Attributes
    ----------
    tell : callable or None
        Called with (done, total) as work goes on; returning False stops the run.
    look : callable or None
        Called with (pixels, whole) as a result comes nearer: (height, width, channels) of the image's own type,
        first coarse ones of a smaller size; `whole` where they are the result's own.
    say : callable or None
        Called with each line of text that a filter was asked for.
    measure : bool
        Report how stationary, faithful and seamless a result is (takes time).
    """

    tell: Tell | None = None
    look: Onlooker | None = None
    say: Say | None = None
    measure: bool = False

    def advance(self, done: int, total: int) -> None:
        """Report progress.

        Raises
        ------
        Interrupted
            The callback returned False.
        """
        if self.tell is not None and self.tell(done, total) is False:
            raise Interrupted("stopped by the progress callback")

    def stages(self) -> Iterator[Progress]:
        """That of one stage after the other, for ops that work in stages: each goes on where the last one ended."""
        begun = ended = 0

        def tell(done: int, total: int) -> bool | None:
            nonlocal ended
            ended = begun + done
            return None if self.tell is None else self.tell(ended, begun + total)

        while True:
            yield replace(self, tell=tell)
            begun = ended
