# SPDX-License-Identifier: Apache-2.0
"""What a tile shows of excluded pixels is replaced by texture that fits around it (PatchMatch)."""

from __future__ import annotations

from collections.abc import Callable

from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.errors import ImageError
from ..patchmatch.constraints import FixedPixels

_MOST = 0.5  # share of a tile that may be replaced: of more, its layout would not be the photo's
_AROUND = 3  # patches around the excluded pixels that their replacement is fitted to


def mended(
    source: SourceMap,
    usable: np.ndarray | None,
    wraps: tuple[bool, bool],
    patch: int,
    synthesized: Callable[[FixedPixels, tuple[bool, bool]], SourceMap],
) -> SourceMap:
    """The tile without excluded pixels of the photo.

    Parameters
    ----------
    source : SourceMap
        (height, width): the tile.
    usable : (h, w) bool or None
        Valid source pixels of the photo. None: all.
    wraps : (bool, bool)
        Whether the tile wraps along x, along y.
    patch : int
        Side of a patch, px.
    synthesized : callable
        Returns a piece of the tile in which fixed pixels are kept, from valid source pixels only, given these and
        whether the piece wraps along x, along y.

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
    columns, rows = (
        _around(np.asarray(~kept.all(axis)), _AROUND * patch, around)
        for axis, around in zip((0, 1), wraps, strict=True)
    )
    at = np.ix_(rows, columns)
    is_whole = len(columns) == kept.shape[1], len(rows) == kept.shape[0]
    fixed = FixedPixels(kept[at], SourceMap(source.packed[at]))
    packed = source.packed.copy()
    packed[at] = synthesized(fixed, (wraps[0] and is_whole[0], wraps[1] and is_whole[1])).packed
    return SourceMap(packed)


def _around(excluded: np.ndarray, margin: int, closed: bool) -> np.ndarray:
    """The shortest run of positions of a line or ring with all excluded ones and a margin."""
    count, places = len(excluded), np.flatnonzero(excluded)
    if not closed:
        return np.arange(max(0, places[0] - margin), min(count, places[-1] + 1 + margin))
    gaps = np.diff(np.append(places, places[0] + count))
    widest = int(gaps.argmax())  # which ends where the run begins
    length = count - int(gaps[widest]) + 1 + 2 * margin
    start = int(places[(widest + 1) % len(places)]) - margin
    return np.arange(count) if length >= count else np.arange(start, start + length) % count
