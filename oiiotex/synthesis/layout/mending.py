# SPDX-License-Identifier: Apache-2.0
"""What a tile shows of excluded pixels is replaced by texture that fits around it (PatchMatch)."""

from __future__ import annotations

from collections.abc import Callable

from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.errors import ImageError
from ..patchmatch.constraints import Constraints, FixedPixels

_MOST = 0.5  # share of a tile that may be replaced: of more, its layout would not be the photo's


def mended(source: SourceMap, usable: np.ndarray | None, synthesized: Callable[[Constraints], SourceMap]) -> SourceMap:
    """The tile without excluded pixels of the photo.

    Parameters
    ----------
    source : SourceMap
        (height, width): the tile.
    usable : (h, w) bool or None
        Valid source pixels of the photo. None: all.
    synthesized : callable
        Returns a tile of that size in which fixed pixels are kept, from valid source pixels only.

    Raises
    ------
    ImageError
        Most of the tile is excluded.
    """
    if usable is None:
        return source
    kept = source.gather(usable)
    share = 1.0 - float(kept.mean())
    if share == 0:
        return source
    if share > _MOST:
        raise ImageError(
            f"{100 * share:.0f} % of the photo's layout is excluded or transparent: expected at most"
            f" {100 * _MOST:.0f} %",
            hint="use another preset",
        )
    return synthesized(Constraints(fixed=FixedPixels(kept, source)))
