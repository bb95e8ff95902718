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
_ROUNDING = 0.01  # of a stage: a larger step back is a new attempt
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
    grow : callable or None
        Called by `lengthen`.
    """

    tell: Tell | None = None
    look: Onlooker | None = None
    say: Say | None = None
    measure: bool = False
    grow: Callable[[float], object] | None = None

    def lengthen(self, share: float) -> None:
        """Report more work than expected, as a share of the work that was expected of this stage."""
        if self.grow is not None:
            self.grow(share)

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

        The whole is `WHOLE` steps, so that the time left can be told from the first stage on, and more after
        `lengthen`. Every report is a step further. A stage that begins again, as for another attempt, takes what is
        left of its share.
        """
        expected, lengths, last = sum(shares), list(shares), -1

        def within(n: int) -> tuple[Tell, Callable[[float], None]]:
            reached = begun = 0.0

            def tell(done: int, total: int) -> bool | None:
                nonlocal reached, begun, last
                part, length = done / max(total, 1), lengths[n]
                if begun + (length - begun) * part < reached - _ROUNDING * length:
                    begun = reached
                reached = max(reached, begun + (length - begun) * part)
                whole = round(WHOLE * sum(lengths) / expected)
                before = last
                last = min(whole, max(last + 1, round(WHOLE * (sum(lengths[:n]) + reached) / expected)))
                return None if self.tell is None or last == before else self.tell(last, whole)

            def grow(share: float) -> None:
                lengths[n] += share * shares[n]
                self.lengthen(share * shares[n] / expected)

            return tell, grow

        for n in range(len(shares)):
            tell, grow = within(n)
            yield replace(self, tell=tell, grow=grow)
