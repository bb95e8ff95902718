# SPDX-License-Identifier: Apache-2.0
"""The first of several results that the judge calls good, else the one that it calls best."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from ...engine.errors import ImageError, present
from .fidelity import GOOD, NEARLY, Fidelity

if TYPE_CHECKING:
    from ...engine.session.progress import Progress

log = logging.getLogger("oiiotex")

Made = TypeVar("Made")


class Dismissed(Exception):
    """A result is skipped, because it cannot be the best one."""


@dataclass(frozen=True)
class Try(Generic[Made]):
    """One way to make a result.

    Attributes
    ----------
    spelled : str
        The modifiers that request it.
    make : callable
        Makes the result. It is called with the fidelity of the best one so far, and may raise `Dismissed`.
    time : float
        Its time, relative to that of the first try.
    improves : collection of str
        The only parts of the first result's fidelity that may become better. Empty: all.
    evens : bool
        It repeats less, and cuts more than the first, which is seen only beyond a limit (`Fidelity.evened`). If it is
        the better one, no other is made.
    despite : collection of str
        Parts that it makes worse, which decide nothing: by eye they weigh less than what it improves. If it is the
        better one, no other is made.
    """

    spelled: str
    make: Callable[[float], Made]
    time: float = 1.0
    improves: Collection[str] = ()
    evens: bool = False
    despite: Collection[str] = ()

    def hope(self, first: Fidelity) -> float:
        """The fidelity that it may have at best."""
        if not self.improves or (self.is_last and first.exceeds(self.improves)):
            return 1.0
        return first.without(self.improves)

    @property
    def is_last(self) -> bool:
        """Whether no other is made if it is the better one."""
        return self.evens or bool(self.despite)


@dataclass(frozen=True)
class Tried(Generic[Made]):
    """A result, the modifiers that request it, and its fidelity; None if it is too small to measure."""

    spelled: str
    made: Made
    kept: Fidelity | None


def best_tried(
    flag: str, tries: Iterable[Try[Made]], judged: Callable[[Made], Fidelity | None], progress: Progress
) -> Tried[Made]:
    """Make results until one is good. The first must succeed; others that fail are skipped.

    Parameters
    ----------
    flag : str
        Name of the op, for the log.
    tries : iterable of Try
    judged : callable
        The fidelity of a result.
    progress : Progress
        That of the first try.
    """
    best: Tried[Made] | None = None
    first: Fidelity | None = None
    least = 0.0
    for one in tries:
        if first is not None and one.hope(first) < min(GOOD, least + NEARLY):
            continue
        if best is not None:
            log.info("%s: %s with %s; trying %s", flag, best.kept, best.spelled, one.spelled)
            progress.lengthen(one.time)
        try:
            made = one.make(least)
        except (Dismissed, ImageError) as error:
            if best is None:
                raise
            progress.advance(1, 1)
            log.info("%s: %s: %s", flag, one.spelled, error)
            continue
        kept = judged(made)
        if kept is None:  # too small to measure
            return best or Tried(one.spelled, made, None)
        first = first or kept
        if one.evens:
            whole = kept.evened(first)
            if whole is None:
                log.info("%s: %s: %s: more objects are cut", flag, one.spelled, kept)
                continue
            kept = whole
        is_better = best is None or kept.beats(present(best.kept), one.despite)
        if is_better:
            best, least = Tried(one.spelled, made, kept), kept.value
        if least >= GOOD or (one.is_last and is_better):
            break
    return present(best)
