# SPDX-License-Identifier: Apache-2.0
"""Height maps that are copied in pieces: steps between the pieces, and constants that close them.

A piece is a connected area of pixels that are neighbors in the photo as well. Two pieces that meet may have similar
colors and different heights, because relief extends beyond a patch; when displaced, such a seam becomes a cliff.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace

from ...engine.color.config import as_float
from ...engine.color.lens import in_type
from ...engine.core.image import Image, Part, channels_of, dtype_of
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError
from ...engine.session.resources import Resources

log = logging.getLogger("oiiotex")

Pairing = tuple["np.ndarray", "np.ndarray"]  # (n,) int64 each: flat indices of pixels of a tile
RELEVEL = (
    "Raise or lower each copied piece of a height map so that pieces meet without steps. Set it if displaced"
    " heights show cliffs. Requires kinds=...,height."
)
_LARGE = 0.1  # a step, as a share of the map's range
_MUCH = 0.005  # share of neighbors, in addition to twice the photo's, that causes a warning
_ANCHOR = 1e-6  # weight that holds a pixel's piece in place, relative to a pair at a seam; keeps pieces without seams
_STILL = 1e6  # the same for a pixel that must keep its height
_TOLERANCE, _MOST_ITERATIONS = 1e-7, 5000
_PIXEL_BYTES = 240  # for each pixel of a tile whose pieces are leveled


def height_tile(
    flag: str,
    tile: Part,
    image: Image,
    source: SourceMap,
    wrap: tuple[bool, bool],
    relevel: bool | None,
    still: np.ndarray | None,
    resources: Resources,
    shared: Pairing | None = None,
) -> Part:
    """A tile of a height map, leveled if `relevel` is set (None: impossible); logs its steps, and warns of many.

    It was copied from the image according to `source`. Pixels in `still`, (height, width) bool, keep their height.
    `shared`: as of `levels`.
    """
    color = list(channels_of(image.first.spec).color)
    heights = as_float(image.first.pixels()[..., color[0]])
    if not np.isfinite(heights).all():
        raise ImageError(f"{image.source} has {np.count_nonzero(~np.isfinite(heights))} NaN or Inf values")
    raised = source.gather(heights)
    if relevel:
        height, width = source.packed.shape
        resources.require(_PIXEL_BYTES * source.packed.size, f"leveling {width}x{height} heights")
        constants = levels(source, wrap, heights, still, shared)
        raised = raised + constants
        tile = _raised(tile, constants, color)
        cut = np.count_nonzero((raised < 0) | (raised > 1)) if dtype_of(tile.spec)(0).dtype.kind == "u" else 0
        if cut:
            beyond = f"{cut} leveled heights of {image.source} exceed the range of {tile.spec.format}"
            log.warning("%s: %s and are clipped; convert the map to float", flag, beyond)
    least = _LARGE * float(np.ptp(heights))
    own, shown = large_steps(heights, least), large_steps(raised, least, wrap)
    text = (
        f"{100 * shown:.2f} % of neighboring heights in {image.source} differ by more than a tenth of the range,"
        f" {100 * own:.2f} % in the photo"
    )
    log.info("%s: %s", flag, text)
    if shown > 2 * own + _MUCH:
        advice = "raise the height's weight in mapweights" + (", or set relevel=1" if relevel is False else "")
        log.warning("%s: cliffs at seams: %s; %s", flag, text, advice)
    return tile


def large_steps(heights: np.ndarray, least: float, wrap: tuple[bool, bool] = (False, False)) -> float:
    """The share of horizontal and vertical neighbors whose heights differ by more than `least`."""
    large = total = 0
    for axis, wraps in ((1, wrap[0]), (0, wrap[1])):
        step = np.diff(heights, axis=axis, append=np.take(heights, [0], axis)) if wraps else np.diff(heights, axis=axis)
        large += int(np.count_nonzero(np.abs(step) > least))
        total += step.size
    return large / max(1, total)


# --- the constants ---


@dataclass(frozen=True)
class Pairs:
    """All pairs of neighbors in one direction: each pixel of a tile, and the next one to the right or below.

    A step is the height of the first pixel's piece above the second's, the mean over both pixels, with each piece
    continued across the seam as in the photo.
    """

    first: np.ndarray  # (n,) int64: flat indices of the pixels, as second
    second: np.ndarray
    together: np.ndarray  # (n,) bool: whether they are neighbors in the photo as well
    step: np.ndarray  # (n,) float64


def neighbors(source: SourceMap, wrap: tuple[bool, bool], heights: np.ndarray) -> Iterator[Pairs]:
    """Neighbors along x, then along y; parameters as of `levels`."""
    numbers = np.arange(source.packed.size).reshape(source.packed.shape)
    y, x = source.yx

    def at(y: np.ndarray, x: np.ndarray) -> np.ndarray:
        return heights[np.clip(y, 0, heights.shape[0] - 1), np.clip(x, 0, heights.shape[1] - 1)].astype(np.float64)

    for axis, (down, right), wraps in ((1, (0, 1), wrap[0]), (0, (1, 0), wrap[1])):
        count = numbers.shape[axis] - (0 if wraps else 1)
        (y1, x1, p), (y2, x2, q) = (
            [np.take(each, np.arange(count) + ahead, axis, mode="wrap").ravel() for each in (y, x, numbers)]
            for ahead in (0, 1)
        )
        together = (y2 == y1 + down) & (x2 == x1 + right)
        at_first = at(y1, x1) - at(y2 - down, x2 - right)
        at_second = at(y1 + down, x1 + right) - at(y2, x2)
        yield Pairs(p, q, together, (at_first + at_second) / 2)


def levels(
    source: SourceMap,
    wrap: tuple[bool, bool],
    heights: np.ndarray,
    still: np.ndarray | None = None,
    shared: Pairing | None = None,
) -> np.ndarray:
    """The constant to add to each pixel's piece, (height, width) float32, that minimizes the steps at seams.

    The constants c minimize the sum of (c_a - c_b + step)^2 over all neighbors in different pieces a and b: a Poisson
    equation on the graph of pieces, whose right side is the sum of steps along each seam. The mean height is kept, or
    the heights of the pixels in `still`, (height, width) bool. Both pixels of a pair of `shared` get the same constant.
    """
    from scipy import sparse  # scipy is not loaded before it is needed
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import cg

    shape = source.packed.shape
    pairs = list(neighbors(source, wrap, heights))
    same = [(one.first[one.together], one.second[one.together]) for one in pairs] + ([] if shared is None else [shared])
    p, q = map(np.concatenate, zip(*same, strict=True))
    graph = sparse.coo_array((np.ones(len(p), bool), (p, q)), shape=(source.packed.size, source.packed.size))
    count, piece = connected_components(graph, directed=False)
    a, b = (piece[np.concatenate([getattr(one, end)[~one.together] for one in pairs])] for end in ("first", "second"))
    step = np.concatenate([one.step[~one.together] for one in pairs])
    area = np.bincount(piece, minlength=count)
    fixed = np.zeros(count, np.int64) if still is None else np.bincount(piece[still.ravel()], minlength=count)
    anchor = _ANCHOR * area + _STILL * fixed
    diagonal = np.bincount(a, minlength=count) + np.bincount(b, minlength=count) + anchor
    values = np.concatenate([diagonal, np.full(2 * len(a), -1.0)])
    each = np.arange(count)
    where = np.concatenate([each, a, b]), np.concatenate([each, b, a])
    system = sparse.coo_array((values, where), shape=(count, count)).tocsr()
    right = np.bincount(b, step, count) - np.bincount(a, step, count)
    scale = sparse.diags_array(1 / system.diagonal())
    constant, _ = cg(system, right, rtol=_TOLERANCE, maxiter=_MOST_ITERATIONS, M=scale)
    if fixed.any():
        constant[fixed > 0] = 0
    else:
        constant -= (constant * area).sum() / area.sum()
    return constant[piece].reshape(shape).astype(np.float32)


def _raised(tile: Part, constants: np.ndarray, color: list[int]) -> Part:
    """The tile with constants added to its heights, in its own type."""

    def fetch(window: Window) -> np.ndarray:
        pixels = tile.read(window).copy()
        values = as_float(pixels[..., color]) + constants[window.inside(tile.window)][..., None]
        pixels[..., color] = in_type(values, pixels.dtype)
        return pixels

    return replace(tile, fetch=fetch)
