# SPDX-License-Identifier: Apache-2.0
"""Limits of measures, as options, recipes and searches say them."""

from __future__ import annotations

import operator
import re
from typing import NamedTuple

from ..errors import ParameterError

_LIMIT = re.compile(r"([a-z_]+)\s*([<>])\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)", re.ASCII)
_BEYOND = {">": operator.gt, "<": operator.lt}


class Limit(NamedTuple):
    """A measure, and beyond what it fails or is found."""

    measure: str
    relation: str
    limit: float

    @classmethod
    def read(cls, text: str, parameter: str) -> Limit:
        """From NAME>NUMBER or NAME<NUMBER; ParameterError, with the parameter that says it, where it is neither."""
        match = _LIMIT.fullmatch(text.strip())
        if not match:
            raise ParameterError(
                parameter=parameter, value=text, expected="NAME>NUMBER or NAME<NUMBER, such as seam>1.3"
            )
        return cls(match[1], match[2], float(match[3]))

    def passed_by(self, value: float) -> bool:
        """Whether a value lies beyond it."""
        return bool(_BEYOND[self.relation](value, self.limit))

    def __str__(self) -> str:
        return f"{self.measure}{self.relation}{self.limit:g}"
