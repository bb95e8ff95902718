# SPDX-License-Identifier: Apache-2.0
"""Progress of a run: amount of work done, previews of the result, lines of text."""

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

    def stages(self) -> Iterator[Progress]:
        """Progress for consecutive stages of an op: each continues where the last one ended."""
        begun = ended = 0

        def tell(done: int, total: int) -> bool | None:
            nonlocal ended
            ended = begun + done
            return None if self.tell is None else self.tell(ended, begun + total)

        while True:
            yield replace(self, tell=tell)
            begun = ended
