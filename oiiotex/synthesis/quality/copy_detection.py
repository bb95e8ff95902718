# SPDX-License-Identifier: Apache-2.0
"""Verbatim copies from the exemplar in a synthesized image, and how often regions repeat."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple, cast

from ...analysis.stationarity.row_bands import row_bands
from ...engine.core.demand import MadeRows, SomeRows
from ...engine.core.source_map import NONE, SourceMap
from ...engine.deferred import np, oiio
from ..patchmatch.field import box_sums

BLOCK = 8  # px
REGION = 32  # px, side of a region whose repeats are counted


class Copies(NamedTuple):
    """The origin of a result's pixels.

    `shown`: number of uses of the most repeated 32 x 32 region of the exemplar. None: the exemplar is smaller.
    """

    exact: float  # share of pixels that lie in an 8 x 8 block that also exists in the exemplar, bit for bit
    shown: float | None
    over_fair: float | None  # `shown` divided by the number of uses if all regions were used equally, at least 1


def copies_by_source(source: SourceMap, size: tuple[int, int]) -> Copies:
    """Measures of an image whose pixels are known copies of those of an exemplar of `size` (height, width).

    Pixels in a block that is copied in one piece are exact.
    """
    used = _uses(_kept(source, lambda rows: _is_copied(source, rows)), size)
    pixels = math.prod(source.packed.shape)
    shown = _most_shown(used, pixels) if min(size) >= REGION else (None, None)
    return Copies(float(used.sum()) / pixels, *shown)


def _is_copied(source: SourceMap, rows: slice) -> np.ndarray:
    """Mask of the pixels of some rows that lie in such a block, (rows, width) bool."""
    height, width = source.packed.shape
    first, last = max(0, rows.start - BLOCK), min(height, rows.stop + BLOCK)
    y, x = source[first:last].yx
    y -= np.arange(first, last)[:, None]
    x -= np.arange(width)
    beside = (y[:, 1:] == y[:, :-1]) & (x[:, 1:] == x[:, :-1])  # neighbors moved alike
    below = (y[1:] == y[:-1]) & (x[1:] == x[:-1])
    blocks = _runs(_runs(beside, BLOCK - 1, 1), BLOCK, 0) & _runs(below, BLOCK - 1, 0)[:, : 1 - BLOCK]
    beyond = BLOCK - 1
    covered = ~_runs(_runs(np.pad(~blocks, beyond, constant_values=True), BLOCK, 0), BLOCK, 1)
    return covered[rows.start - first : rows.stop - first]


def _runs(marked: np.ndarray, length: int, axis: int) -> np.ndarray:
    """Whether that many in a row are all marked, by their first: shorter by `length` - 1 along the axis."""
    lines = np.moveaxis(marked, axis, 0)
    done = 1
    while done < length:
        step = min(done, length - done)
        lines = lines[:-step] & lines[step:] if step < len(lines) else lines[:0]
        done += step
    return np.moveaxis(lines, 0, axis)


def _kept(source: SourceMap, keeps: Callable[[slice], np.ndarray]) -> SourceMap:
    """The source of those pixels, `NONE` for the others."""

    def made(first: int, last: int) -> np.ndarray:
        return np.where(keeps(slice(first, last)), source.packed[first:last], source.packed.dtype.type(NONE))

    return SourceMap(cast("np.ndarray", MadeRows(source.packed.shape, source.packed.dtype, made)), source.bits)


def _uses(source: SourceMap, size: tuple[int, int]) -> np.ndarray:
    """Number of uses of each pixel of an exemplar of (h, w), (h, w) uint32."""
    used = np.zeros(size[0] * size[1], np.uint32)
    for band in row_bands(source.packed):
        places = source[band]
        np.add.at(used, places[places.packed != NONE].flat(size[1]), np.uint32(1))
    return used.reshape(size)


def most_shown(source: SourceMap, size: tuple[int, int]) -> tuple[float, float]:
    """`shown` and `over_fair` from sources of pixels, or `NONE`, in an exemplar of (h, w), at least `REGION`."""
    return _most_shown(_uses(source, size), math.prod(source.packed.shape))


def region_uses(st: np.ndarray, spec: oiio.ImageSpec) -> tuple[np.ndarray, np.ndarray]:
    """How often the region of `REGION` px around each pixel is used, as a mean of its pixels.

    Parameters
    ----------
    st : (height, width, 2) float32
        Part 'st' of a result.
    spec : ImageSpec
        Of the exemplar.

    Returns
    -------
    (h, w) float32, (height, width) float32
        At the pixels of the exemplar, and at those of the result, where they are taken from.
    """
    from scipy.ndimage import uniform_filter

    source = SourceMap.of_coordinates(st, spec, "st")
    uses = uniform_filter(_uses(source, (spec.height, spec.width)).astype(np.float32), REGION, mode="nearest")
    return uses, uses.ravel()[source.flat(spec.width)]


def _most_shown(used: np.ndarray, pixels: int) -> tuple[float, float]:
    squares = (box_sums(used[b.start : b.stop + REGION - 1], REGION) for b in row_bands(used[: 1 - REGION]))
    shown = max(int(sums.max()) for sums in squares) / REGION**2
    return shown, shown / max(1.0, pixels / used.size)


def _is_label(painted: SomeRows, label: int, rows: slice) -> np.ndarray:
    return painted[rows] == label


def label_copies(source: SourceMap, ids: np.ndarray, painted: SomeRows) -> tuple[float, float, float]:
    """Repetition in the painted label where it is largest: uses over the fair share, uses, and the label.

    A label's fair share is the area where it was painted divided by its area in the exemplar, at least 1.

    `ids` (h, w) int; `painted` (height, width) int.
    """
    own, asked = np.bincount(ids.ravel()), Counter[int]()
    for band in row_bands(painted):
        asked.update(dict(zip(*(n.tolist() for n in np.unique(painted[band], return_counts=True)), strict=True)))
    most = (0.0, 0.0, 0.0)
    for label in sorted(asked.keys() - {0}):
        own_source = _kept(source, functools.partial(_is_label, painted, label))
        shown, _ = most_shown(own_source, ids.shape)
        fair = max(1.0, asked[label] / max(1, own[label] if label < len(own) else 0))
        most = max(most, (shown / fair, shown, float(label)))
    return most
