# SPDX-License-Identifier: Apache-2.0
"""Regular expressions that users give, for names of metadata."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from .errors import ParameterError

_MOST_REPEATS = 4
_CLASSES = {"alpha": "a-zA-Z", "digit": "0-9", "alnum": "a-zA-Z0-9", "space": r"\s", "upper": "A-Z", "lower": "a-z"}


def pattern_of(text: str) -> re.Pattern[str]:
    """A POSIX extended regular expression that ignores case.

    Matchers of Python and C++ try all ways to divide a text among repeats, and cannot be interrupted.

    Raises
    ------
    ParameterError
        It is not a regular expression, or has more than a few repeats, or a repeat within another, or a repeat of
        alternatives.
    """
    translated = re.sub(r"\[:(\w+):\]", lambda match: _CLASSES.get(match[1], match[0]), text)
    try:
        pattern = re.compile(translated, re.IGNORECASE)
    except (re.error, OverflowError, RecursionError) as error:
        raise ParameterError(f"'{text}': expected a regular expression: {error}") from None
    if _repeats(re._parser.parse(translated)) > _MOST_REPEATS:  # type: ignore[attr-defined]
        raise ParameterError(
            f"'{text}' could take years to match",
            expected=f"a regular expression with at most {_MOST_REPEATS} repeats, and none of a repeat or alternatives",
        )
    return pattern


def _repeats(parsed: Iterable[tuple[Any, Any]], each: int = 1) -> int:
    """Number of repeats in a parsed pattern. Within a repeat, a further one or alternatives count as too many."""
    count = 0
    for kind, argument in parsed:
        inner = each
        if str(kind) in ("MAX_REPEAT", "MIN_REPEAT") and argument[1] > 1:
            count, inner = count + each, _MOST_REPEATS + 1
        elif str(kind) == "BRANCH" and each > 1:
            count += each
        below = argument[1] if str(kind) == "BRANCH" else argument if isinstance(argument, tuple) else ()
        count += sum(_repeats(one, inner) for one in below if hasattr(one, "data"))  # a subpattern
    return count
