# SPDX-License-Identifier: Apache-2.0
"""The first of several results that the judge calls good, else the one that it calls best."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

from ...engine.errors import Error, present
from .fidelity import GOOD, Fidelity

log = logging.getLogger("oiiotex")

Made = TypeVar("Made")


@dataclass(frozen=True)
class Tried(Generic[Made]):
    """A result, the modifiers that request it, and its fidelity; None if it is too small to measure."""

    spelled: str
    made: Made
    kept: Fidelity | None


def best_tried(
    flag: str, tries: Iterable[tuple[str, Callable[[], Made]]], judged: Callable[[Made], Fidelity | None]
) -> Tried[Made]:
    """Make results until one is good. The first must succeed; others that fail are skipped.

    Parameters
    ----------
    flag : str
        Name of the op, for the log.
    tries : iterable of (str, callable)
        The modifiers that request a result, and what makes it.
    judged : callable
        The fidelity of a result.
    """
    best: Tried[Made] | None = None
    for spelled, make in tries:
        if best is not None:
            log.info("%s: %s with %s; trying %s", flag, best.kept, best.spelled, spelled)
        try:
            made = make()
        except Error as error:
            if best is None:
                raise
            log.info("%s: %s: %s", flag, spelled, error)
            continue
        kept = judged(made)
        if best is None or (best.kept is not None and kept is not None and kept.value > best.kept.value):
            best = Tried(spelled, made, kept)
        if best.kept is None or best.kept.value >= GOOD:
            break
    return present(best)
