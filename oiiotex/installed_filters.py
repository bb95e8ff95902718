# SPDX-License-Identifier: Apache-2.0
"""Filters of other packages: entry points of the group `oiiotex.filters` that name a filter class."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from importlib.metadata import EntryPoint, entry_points

from .core.op import Op
from .errors import one_line

log = logging.getLogger("oiiotex")

GROUP = "oiiotex.filters"


def installed(taken: Iterable[str]) -> tuple[type[Op], ...]:
    """The filter classes of all installed packages, by name; one that is broken is passed over with a warning.

    `taken` are names of filters that there are already.
    """
    names = set(taken)
    ops: list[type[Op]] = []
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        try:
            op = _loaded(entry, names)
        except Exception as error:  # another's code may fail in any way; the program must start all the same
            log.warning("filter %s of %s is left out: %s", entry.name, entry.value, one_line(str(error)))
            continue
        names.add(op.name)
        ops.append(op)
    return tuple(ops)


def _loaded(entry: EntryPoint, names: set[str]) -> type[Op]:
    op = entry.load()
    if not (isinstance(op, type) and issubclass(op, Op)):
        raise TypeError("it is no subclass of oiiotex.core.op.Op")
    if not getattr(op, "name", "").isidentifier():
        raise TypeError("it declares no name that is a Python identifier")
    if op.name in names:
        raise TypeError(f"there is a filter '{op.name}' already")
    if op.prefix != Op.prefix:
        raise TypeError(f"filters begin with {Op.prefix}")
    op.images(), op.parameters()  # a declaration that cannot be read is found now
    return op
