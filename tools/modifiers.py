# SPDX-License-Identifier: Apache-2.0
"""The modifiers of all filters: `python -m tools.modifiers` prints each name, its filters, and how many there are."""

from __future__ import annotations

from collections import defaultdict

from oiiotex.engine.core.op import Op
from oiiotex.engine.core.parameters import Parameter
from oiiotex.filters import OURS


def inputs_and_modifiers(op: type[Op]) -> tuple[Parameter, ...]:
    """All input images and modifiers of a filter."""
    further = op.further_images()
    return (*op.images(), *((further,) if further else ()), *op.modifiers())


def main() -> None:
    """Print the names in alphabetical order, then the counts."""
    filters = defaultdict(list)
    for op in OURS:
        for parameter in op.modifiers():
            filters[parameter.name].append(op.name)
    for name, users in sorted(filters.items()):
        print(f"{name:16}{' '.join(users)}")
    advanced = sum(parameter.advanced for op in OURS for parameter in op.modifiers())
    print(f"{sum(map(len, filters.values()))} modifiers, {advanced} of them advanced; {len(filters)} names")


if __name__ == "__main__":
    main()
