# SPDX-License-Identifier: Apache-2.0
"""The copied share of a synthesized image, from the pixels of image and exemplar alone."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from oiiotex.engine.core.source_map import NONE, SourceMap
from oiiotex.synthesis.quality.copy_detection import BLOCK, Copies, most_shown

NEAR = 8  # of 255: a copy that was blended or rounded
_AT_ONCE = 512


def copies(made: np.ndarray, exemplar: np.ndarray) -> tuple[Copies, float]:
    """Of uint8 images (h, w, 3), and the share of pixels that are nearly copied.

    These are those that are, and those of other blocks of a grid of 8 px that the exemplar has with no value further
    off than `NEAR`.
    """
    source = _exact(made, exemplar)
    exact = float((source.packed != NONE).mean())
    _fill_near(source.packed, made, exemplar)
    return Copies(exact, *most_shown(source, exemplar.shape[:2])), float((source.packed != NONE).mean())


def _exact(made: np.ndarray, exemplar: np.ndarray) -> SourceMap:
    """The source of every pixel in a block with a bit-identical copy, by 64-bit hashes; `NONE` for the others."""
    there, here = _hashes(exemplar), _hashes(made)
    known, first = np.unique(there, return_index=True)
    at = np.minimum(np.searchsorted(known, here), len(known) - 1)
    found = known[at] == here
    place = SourceMap.of(*np.divmod(first[at], there.shape[1])).packed
    source = np.full(made.shape[:2], NONE)
    for dy, dx in np.ndindex(BLOCK, BLOCK):
        view = source[dy : dy + here.shape[0], dx : dx + here.shape[1]]
        view[found] = place[found] + SourceMap.of(dy, dx).packed
    return SourceMap(source)


def _hashes(image: np.ndarray) -> np.ndarray:
    """Of every block of an image, (h - 7, w - 7) uint64."""
    weights = np.random.default_rng(0).integers(1, 1 << 63, (3, BLOCK, BLOCK), np.uint64) | np.uint64(1)
    down, across = (side - BLOCK + 1 for side in image.shape[:2])
    total = np.zeros((down, across), np.uint64)
    for channel, dy, dx in np.ndindex(3, BLOCK, BLOCK):
        total += image[dy : dy + down, dx : dx + across, channel].astype(np.uint64) * weights[channel, dy, dx]
    return total


def _fill_near(source: np.ndarray, made: np.ndarray, exemplar: np.ndarray) -> None:
    """Sources of blocks of a grid that are nearly there, where none is known: the nearest by the sum of squares."""
    there = sliding_window_view(exemplar, (BLOCK, BLOCK), (0, 1)).transpose(0, 1, 3, 4, 2)
    across = there.shape[1]
    there = np.ascontiguousarray(there).reshape(-1, 3 * BLOCK**2)
    corners = np.array([(y, x) for y in range(0, made.shape[0] - BLOCK + 1, BLOCK)
                        for x in range(0, made.shape[1] - BLOCK + 1, BLOCK)
                        if (source[y : y + BLOCK, x : x + BLOCK] == NONE).any()]).reshape(-1, 2)  # fmt: skip
    values = there.astype(np.float32) - 128
    halves = (values**2).sum(1) / 2
    inner = SourceMap.of(np.arange(BLOCK)[:, None], np.arange(BLOCK)).packed
    for n in range(0, len(corners), _AT_ONCE):
        some = corners[n : n + _AT_ONCE]
        blocks = np.stack([made[y : y + BLOCK, x : x + BLOCK].reshape(-1) for y, x in some])
        best = (halves - (blocks.astype(np.float32) - 128) @ values.T).argmin(1)
        close = np.abs(there[best].astype(int) - blocks).max(1) <= NEAR
        for (y, x), place in zip(some[close], best[close], strict=True):
            block = source[y : y + BLOCK, x : x + BLOCK]
            fresh = block == NONE
            block[fresh] = (SourceMap.of(*divmod(place, across)).packed + inner)[fresh]
