# SPDX-License-Identifier: Apache-2.0
"""Additions of other distributions: entry points of the groups `oiiotex.filters` and `oiiotex.options`."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

from ..engine.core.op import Op
from ..engine.errors import reason_of

log = logging.getLogger("oiiotex")

Declared = TypeVar("Declared")


def installed(what: str, checked: Callable[[EntryPoint], Declared], name: str = "") -> tuple[Declared, ...]:
    """The filters or options that all distributions declare, by name; only the entry of `name` if given.

    `checked` loads an entry and returns its declaration. Where it raises, the entry is skipped with a warning.
    """
    declared: list[Declared] = []
    for entry in sorted(entry_points(group=f"oiiotex.{what}s"), key=lambda entry: entry.name):
        if name not in ("", entry.name):
            continue
        try:
            declared.append(checked(entry))
        except Exception as error:  # foreign code may raise anything; the program must start anyway
            log.warning("%s %s of %s is ignored: %s", what, entry.name, entry.value, reason_of(error))
    return tuple(declared)


def installed_filters(taken: Iterable[str]) -> tuple[type[Op], ...]:
    """The filter classes of all distributions; `taken`: names of existing filters."""
    names = set(taken)

    def checked(entry: EntryPoint) -> type[Op]:
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
        names.add(op.name)
        return op

    return installed("filter", checked)
