# SPDX-License-Identifier: Apache-2.0
"""Merging of tiny pieces into neighbors while a label map is created, so that memory does not grow with noise.

In a large noisy image, pixels at borders of superpixels make millions of pieces of a few pixels each. They are merged
into neighbors as small pieces are afterwards (`run_length.small_joined`), but within strips of a fixed number of rows,
which depend on the image alone: first in one set of strips, then in another that begins half a strip later. A piece
less than half a strip high lies fully inside a strip of either set.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

from ...engine.deferred import np
from .run_length import OUTSIDE, Strip, pieces_of, small_joined

_HIGH = 64  # rows of a strip


def without_crumbs(strips: Iterable[Strip], height: int, least: float, tiled: str = "none") -> Iterator[Strip]:
    """Merge pieces below `least` px, and less than 64 rows high, into a neighbor.

    `least`: px; `tiled`: axes along which opposite borders touch, where a piece may be larger than it seems.
    """
    for begin in (0, _HIGH // 2):
        edges = sorted({0, *range(begin, height, _HIGH), height})
        strips = _joined(_cut(strips, edges), height, least, tiled)
    return iter(strips)


def _joined(strips: Iterable[Strip], height: int, least: float, tiled: str) -> Iterator[Strip]:
    top = 0
    for strip in strips:
        found = pieces_of([strip], strip.height)
        piece, inside = found.runs.label, strip.label != OUTSIDE
        label = np.zeros(len(found.sizes) + 1, np.int32)
        label[piece[inside]] = strip.label[inside]
        label[-1] = OUTSIDE
        unknown = np.zeros(len(found.sizes) + 1, bool)
        if top > 0 or "y" in tiled:
            unknown[piece[: np.searchsorted(strip.starts, strip.width)]] = True
        top += strip.height
        if top < height or "y" in tiled:
            unknown[piece[np.searchsorted(strip.starts, strip.width * (strip.height - 1)) :]] = True
        if "x" in tiled:
            first = np.flatnonzero(strip.starts % strip.width == 0)
            unknown[piece[np.concatenate([first, first - 1])]] = True
        of, _, _, first = small_joined(found, least, unknown[:-1])
        label[:-1] = label[first[of]]
        yield Strip.joined(strip.width, strip.height, strip.starts, label[piece])


def _cut(strips: Iterable[Strip], edges: list[int]) -> Iterator[Strip]:
    """The same rows, split at `edges`, from 0 to the map's height."""
    source, rest = iter(strips), None
    for top, bottom in itertools.pairwise(edges):
        parts, missing = [], bottom - top
        while missing:
            if rest is None or not rest.height:
                rest = next(source)
            count = min(missing, rest.height)
            parts.append(rest.rows(0, count))
            rest = rest.rows(count, rest.height)
            missing -= count
        width, before = parts[0].width, itertools.accumulate((part.height for part in parts), initial=0)
        starts = np.concatenate([part.starts + rows * width for part, rows in zip(parts, before, strict=False)])
        yield Strip(width, bottom - top, starts, np.concatenate([part.label for part in parts]))
