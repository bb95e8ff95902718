# SPDX-License-Identifier: Apache-2.0
"""What of a synthesized image is copied from its exemplar, and how often the same, whoever made it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

BLOCK = 8  # px
REGION = 32  # px, a side of what is seen again
NEAR = 8  # of 255: a copy that was blended or rounded
_AT_ONCE = 512


class Copies(NamedTuple):
    """Whence the pixels of a result are.

    Attributes
    ----------
    exact : float
        Share of pixels that lie in some 8 x 8 block which the exemplar has, too, to the bit.
    near : float
        Those, and the pixels of other blocks of a grid of 8 px that the exemplar has with no value further off than
        `NEAR`.
    shown : float
        How often these pixels show the most repeated 32 x 32 region of the exemplar.
    over_fair : float
        The same over what each region's share of the result would be.
    """

    exact: float
    near: float
    shown: float
    over_fair: float


def copies(made: np.ndarray, exemplar: np.ndarray) -> Copies:
    """Of uint8 images (h, w, 3)."""
    source = _exact(made, exemplar)
    exact = float((source >= 0).mean())
    _fill_near(source, made, exemplar)
    return Copies(exact, float((source >= 0).mean()), *most_shown(source, exemplar.shape[:2]))


def copies_by_source(y: np.ndarray, x: np.ndarray, size: tuple[int, int]) -> Copies:
    """Of an image whose pixels are known to be those at (y, x) of an exemplar of `size` (height, width).

    What lies in some block that is copied in one piece is exact; nothing is merely near.
    """
    moved = y - np.arange(y.shape[0])[:, None], x - np.arange(x.shape[1])[None, :]
    most, least = ([f(m, BLOCK, mode="nearest") for m in moved] for f in (maximum_filter, minimum_filter))
    whole = (most[0] == least[0]) & (most[1] == least[1])
    # the filters' window of an even side begins half of it before its pixel; blocks are inside the image
    half = BLOCK // 2
    inside = np.zeros_like(whole)
    inside[half : whole.shape[0] - half + 1, half : whole.shape[1] - half + 1] = True
    covered = maximum_filter(whole & inside, BLOCK, origin=-1, mode="constant")
    source = np.where(covered, y * size[1] + x, -1)
    return Copies(*[float(covered.mean())] * 2, *most_shown(source, size))


def most_shown(source: np.ndarray, size: tuple[int, int]) -> tuple[float, float]:
    """`shown` and `over_fair` from the source of every pixel in an exemplar of (h, w), row * w + column or -1."""
    used = np.bincount(source[source >= 0], minlength=size[0] * size[1]).reshape(size).astype(float)
    inside = slice(REGION // 2, 1 - REGION // 2)
    shown = float(uniform_filter(used, REGION)[inside, inside].max())
    return shown, shown * used.size / source.size


def _exact(made: np.ndarray, exemplar: np.ndarray) -> np.ndarray:
    """The source of every pixel in a block that is there to the bit, by hashes of 64 bits; -1 for the others."""
    there, here = _hashes(exemplar), _hashes(made)
    known, first = np.unique(there, return_index=True)
    at = np.minimum(np.searchsorted(known, here), len(known) - 1)
    found = known[at] == here
    width = exemplar.shape[1]
    rows, columns = np.divmod(first[at], there.shape[1])
    place = rows * width + columns
    source = np.full(made.shape[:2], -1)
    for dy, dx in np.ndindex(BLOCK, BLOCK):
        view = source[dy : dy + here.shape[0], dx : dx + here.shape[1]]
        view[found] = place[found] + dy * width + dx
    return source


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
    across, width = there.shape[1], exemplar.shape[1]
    there = np.ascontiguousarray(there).reshape(-1, 3 * BLOCK**2)
    corners = np.array([(y, x) for y in range(0, made.shape[0] - BLOCK + 1, BLOCK)
                        for x in range(0, made.shape[1] - BLOCK + 1, BLOCK)
                        if (source[y : y + BLOCK, x : x + BLOCK] < 0).any()]).reshape(-1, 2)  # fmt: skip
    values = there.astype(np.float32) - 128
    halves = (values**2).sum(1) / 2
    inner = np.arange(BLOCK)[:, None] * width + np.arange(BLOCK)
    for n in range(0, len(corners), _AT_ONCE):
        some = corners[n : n + _AT_ONCE]
        blocks = np.stack([made[y : y + BLOCK, x : x + BLOCK].reshape(-1) for y, x in some])
        best = (halves - (blocks.astype(np.float32) - 128) @ values.T).argmin(1)
        close = np.abs(there[best].astype(int) - blocks).max(1) <= NEAR
        for (y, x), place in zip(some[close], best[close], strict=True):
            block = source[y : y + BLOCK, x : x + BLOCK]
            fresh = block < 0
            block[fresh] = (place // across * width + place % across + inner)[fresh]
