# SPDX-License-Identifier: Apache-2.0
"""Which parts of an image a `subimages` modifier means."""

from __future__ import annotations

from ..core.image import Image
from ..errors import ParameterError


def chosen(subimages: str | None, first: Image) -> set[int] | None:
    """The numbers of the parts meant by a `subimages` modifier; None for all."""
    if subimages is None:
        return None
    included: set[int] = set()
    excluded: set[int] = set()
    names = [part.name for part in first.parts]
    for word in filter(None, (w.strip() for w in subimages.split(","))):
        bare = word.removeprefix("-")
        if bare == "all":
            included |= set(range(len(names)))
        elif bare.isdigit() or bare in names:
            (excluded if word != bare else included).add(int(bare) if bare.isdigit() else names.index(bare))
        else:
            raise ParameterError(
                f"subimages={subimages}: {first.source} has no part '{bare}'; it has {', '.join(names)}"
            )
    return (included or set(range(len(names)))) - excluded
