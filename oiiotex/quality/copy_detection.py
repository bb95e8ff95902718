# SPDX-License-Identifier: Apache-2.0
"""What of a synthesized image is copied from its exemplar in one piece, and how often the same."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

from ..core.source_map import NONE, SourceMap

BLOCK = 8  # px
REGION = 32  # px, a side of what is seen again


class Copies(NamedTuple):
    """Whence the pixels of a result are.

    Attributes
    ----------
    exact : float
        Share of pixels that lie in some 8 x 8 block which the exemplar has, too, to the bit.
    shown : float or None
        How often these pixels show the most repeated 32 x 32 region of the exemplar; None of one that is smaller.
    over_fair : float or None
        The same over what each region's share of the result would be.
    """

    exact: float
    shown: float | None
    over_fair: float | None


def copies_by_source(source: SourceMap, size: tuple[int, int]) -> Copies:
    """Of an image whose pixels are known to be those of an exemplar of `size` (height, width).

    What lies in some block that is copied in one piece is exact.
    """
    y, x = source.yx
    moved = y - np.arange(y.shape[0])[:, None], x - np.arange(x.shape[1])[None, :]
    most, least = ([f(m, BLOCK, mode="nearest") for m in moved] for f in (maximum_filter, minimum_filter))
    whole = (most[0] == least[0]) & (most[1] == least[1])
    # the filters' window of an even side begins half of it before its pixel; blocks are inside the image
    half = BLOCK // 2
    inside = np.zeros_like(whole)
    inside[half : whole.shape[0] - half + 1, half : whole.shape[1] - half + 1] = True
    covered = maximum_filter(whole & inside, BLOCK, origin=-1, mode="constant")
    copied = SourceMap(np.where(covered, source.packed, NONE))
    shown = most_shown(copied, size) if min(size) >= REGION else (None, None)
    return Copies(float(covered.mean()), *shown)


def most_shown(source: SourceMap, size: tuple[int, int]) -> tuple[float, float]:
    """`shown` and `over_fair` of the source of every pixel, or `NONE`, in an exemplar of (h, w), `REGION` at least."""
    known = source[source.packed != NONE].flat(size[1])
    used = np.bincount(known, minlength=size[0] * size[1]).reshape(size).astype(float)
    inside = slice(REGION // 2, 1 - REGION // 2)
    shown = float(uniform_filter(used, REGION)[inside, inside].max())
    return shown, shown * used.size / source.packed.size


def label_copies(source: SourceMap, ids: np.ndarray, painted: np.ndarray) -> tuple[float, float, float]:
    """Repetition in the painted label where it is largest: over the fair share, how often shown, the label.

    A label's fair share is how often its area in the exemplar fits into the area where it was painted.

    Parameters
    ----------
    source : SourceMap
        Of every pixel.
    ids : (h, w) int
        Of the exemplar, `REGION` a side at least.
    painted : (height, width) int
        The labels that were asked for; 0: none.
    """
    own, asked = np.bincount(ids.ravel()), np.bincount(painted.ravel())
    most = (0.0, 0.0, 0.0)
    for label in np.flatnonzero(asked[1:]) + 1:
        shown, _ = most_shown(SourceMap(np.where(painted == label, source.packed, NONE)), ids.shape)
        fair = asked[label] / max(1, own[label] if label < len(own) else 0)
        most = max(most, (shown / fair, shown, float(label)))
    return most
