# SPDX-License-Identifier: Apache-2.0
"""Progress of a run: amount of work done, previews of the result, lines of text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..errors import Interrupted

if TYPE_CHECKING:
    import numpy as np

WHOLE = 10_000  # steps of an op with several stages
Tell = Callable[[int, int], bool | None]
Onlooker = Callable[["np.ndarray", bool], object]
Say = Callable[[str], object]


@dataclass(frozen=True)
class Progress:
    """Callbacks for the progress of a run.

    Attributes
    ----------
    tell : callable or None
        Called with (done, total) during the work; returning False stops the run.
    look : callable or None
        Called with (pixels, whole) for previews: (height, width, channels) of the image's own type, first at a reduced
        size; `whole` is True for the final result.
    say : callable or None
        Called with each line of text that a filter prints.
    measure : bool
        Whether to measure stationarity, fidelity and seams of a result (takes time).
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

    def stages(self, *shares: float) -> Iterator[Progress]:
        """Progress for consecutive stages of an op, each with its share of the expected time.

        The whole is always `WHOLE` steps, so that the time left can be told from the first stage on. Every report
        is a step further. A stage that begins again, as for another attempt, takes what is left of its share.
        """
        before, every, last = 0.0, sum(shares), -1

        def within(share: float, before: float) -> Tell:
            reached = begun = 0.0

            def tell(done: int, total: int) -> bool | None:
                nonlocal reached, begun, last
                part = done / max(total, 1)
                if begun + (1 - begun) * part < reached:
                    begun = reached
                reached = begun + (1 - begun) * part
                last = min(WHOLE, max(last + 1, round(WHOLE * (before + share * reached) / every)))
                return None if self.tell is None else self.tell(last, WHOLE)

            return tell

        for share in shares:
            yield replace(self, tell=within(share, before))
            before += share
