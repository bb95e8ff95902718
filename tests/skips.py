# SPDX-License-Identifier: Apache-2.0
"""Which tests CI may skip: the table in skips.toml. A test that never runs protects nothing."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path

TABLE = Path(__file__).with_name("skips.toml")


def unexpected(reasons: Iterable[str]) -> list[str]:
    """The reasons of skips that the table does not have, each once."""
    table = tomllib.loads(TABLE.read_text())["skip"]
    return sorted({reason for reason in reasons if not any(re.search(row["reason"], reason) for row in table)})
