# SPDX-License-Identifier: Apache-2.0
"""Filters of other packages: entry points of the group `oiiotex.filters` that name a filter class."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from importlib.metadata import EntryPoint, entry_points

from ..engine.core.op import Op
from ..engine.errors import one_line

log = logging.getLogger("oiiotex")

GROUP = "oiiotex.filters"


def installed(taken: Iterable[str]) -> tuple[type[Op], ...]:
    """The filter classes of all installed packages, by name; broken ones are skipped with a warning.

    `taken`: names of existing filters.
    """
    names = set(taken)
    ops: list[type[Op]] = []
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        try:
            op = _loaded(entry, names)
        except Exception as error:  # foreign code may raise anything; the program must start anyway
            log.warning("filter %s of %s is ignored: %s", entry.name, entry.value, one_line(str(error)))
            continue
        names.add(op.name)
        ops.append(op)
    return tuple(ops)


def _loaded(entry: EntryPoint, names: set[str]) -> type[Op]:
    op = entry.load()
    if not (isinstance(op, type) and issubclass(op, Op)):
        raise TypeError("expected a subclass of oiiotex.engine.core.op.Op")
    if not getattr(op, "name", "").isidentifier():
        raise TypeError("name must be a Python identifier")
    if op.name in names:
        raise TypeError(f"filter '{op.name}' already exists")
    if op.prefix != Op.prefix:
        raise TypeError(f"prefix must be {Op.prefix}")
    op.images(), op.parameters()  # finds invalid declarations
    return op
