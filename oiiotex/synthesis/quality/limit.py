# SPDX-License-Identifier: Apache-2.0
"""Limits of measures, in the notation of options, recipes and searches."""

from __future__ import annotations

import operator
import re
from typing import NamedTuple

from ...engine.errors import ParameterError

_LIMIT = re.compile(r"([a-z_]+)\s*([<>])\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)", re.ASCII)
_BEYOND = {">": operator.gt, "<": operator.lt}


class Limit(NamedTuple):
    """A measure and its limit."""

    measure: str
    relation: str
    limit: float

    @classmethod
    def read(cls, text: str, parameter: str) -> Limit:
        """Parse NAME>NUMBER or NAME<NUMBER. Otherwise raise a ParameterError for the parameter."""
        match = _LIMIT.fullmatch(text.strip())
        if not match:
            raise ParameterError(
                parameter=parameter, value=text, expected="NAME>NUMBER or NAME<NUMBER, such as seam>1.3"
            )
        return cls(match[1], match[2], float(match[3]))

    def passed_by(self, value: float) -> bool:
        """Whether a value exceeds the limit."""
        return bool(_BEYOND[self.relation](value, self.limit))

    def __str__(self) -> str:
        return f"{self.measure}{self.relation}{self.limit:g}"
