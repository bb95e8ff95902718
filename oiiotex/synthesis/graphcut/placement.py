# SPDX-License-Identifier: Apache-2.0
"""Graph-cut textures (KSE03): patches placed one after another and joined along minimum-error seams.

Patches contain allowed pixels only (LSA16 §5.2).

First every site of a grid gets a patch that fits its surroundings. Each refinement pass places patches over the worst
seams. Such a patch is kept only if the seams become cheaper, so refinement never makes them worse.

Departures from KSE03: the sum of squared differences of a placement (their eq. 4) is computed in integers, so that
rounding decides nothing. Instead of a probability (their eq. 5) a hash chooses two of the few best distinct placements.
The one with the cheaper coarse cut is taken.
Offsets that are already present are skipped, because they would continue the exemplar verbatim.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import fft

from ...analysis.regularity.offset_prices import InStep
from ...engine.core.source_map import NONE, SourceMap
from ...engine.core.window import Domain
from ..patchmatch.field import hash_at
from .photo import Laid, Photo, held_bytes
from .seams import PatchCut, SeamPhoto, crossing_costs, seam_costs
from .search import OffsetSearch, search_factor

OVERLAP = 3  # distance between patches of the first layer: 2/3 of their side
TRIES = 2  # placements that are cut for each patch
MOST_NARROW = 16  # px, minimum side of a refinement patch
_LOOKED_AT = 1 << 16  # px whose seams are summed at a time


@dataclass(frozen=True, kw_only=True)
class Layout(Domain):
    """The task: the domain, the side of a patch in px, and the number of refinement passes."""

    patch: int
    passes: int
    seed: int

    def sites(self) -> list[tuple[int, int]]:
        """Corners (y, x) of the first layer's patches, which cover everything with overlap."""
        step = max(1, self.patch - self.patch // OVERLAP)

        def axis(size: int, wrap: bool) -> list[int]:
            if wrap:
                count = max(1, -(-size // step))
                return [i * size // count for i in range(count)]
            before = self.patch // (2 * OVERLAP)  # the border lies in the middle of an overlap, like any other place
            return list(range(-before, max(1, size - self.patch + step), step))

        rows, columns = axis(self.height, self.wrap_y), axis(self.width, self.wrap_x)
        if not self.wrap_x:
            return [(y, x) for y in rows for x in columns]
        # shift rows: else a row's first patch would wait for the last one of the row above, across the border
        return [(y, columns[(n + i) % len(columns)]) for n, y in enumerate(rows) for i in range(len(columns))]


def bytes_needed(layout: Layout, exemplar: tuple[int, ...], budget: int, threads: int = 1) -> int:
    """Memory of a synthesis: photo and result, or their caches, and per thread a search's spectra and a cut's arcs."""
    factor = search_factor(exemplar)
    side = [fft.next_fast_len(n // factor + layout.patch // factor + 2, True) for n in exemplar[:2]]
    held = held_bytes(budget, exemplar[0] * exemplar[1], layout.width * layout.height)
    return held + threads * (150 * side[0] * side[1] + 320 * layout.patch**2)


def graph_cut(
    exemplar: Any,
    allowed: Any,
    layout: Layout,
    budget: int,
    progress: Callable[[int, int], None],
    in_step: InStep | None = None,
    spread: Callable[..., Iterable[Any]] = map,
) -> SourceMap:
    """Place and cut patches until all pixels are covered, then refine the worst seams.

    Patches of a wave do not touch, so the result is the same as placing one after the other.

    Parameters
    ----------
    exemplar : (height, width, 3) float32
        CIE Lab: an array, or an object whose slices are arrays of rows.
    allowed : (height, width) bool or None
        Usable pixels, at least one. None: all. The colors of the others are ignored.
    budget : int
        Bytes. Photo and result are in files if they take more than a quarter of it.
    progress : callable
        Called with (patches tried, total patches). May raise an exception to stop.
    in_step : InStep or None
        The exemplar's lattice, if the result keeps it.
    spread : callable
        Like `map`, possibly on several threads.

    Returns
    -------
    SourceMap
        For (height, width) pixels.
    """
    canvas = _Canvas(Photo.of(exemplar, allowed, budget), layout, budget, in_step)
    sites = layout.sites()
    total, done = len(sites) * (1 + layout.passes), 0

    def work(do: Callable[[int, int, int, int], None], squares: list[tuple[int, int, int]]) -> None:
        nonlocal done
        first = done
        for wave in waves(layout, squares):
            for _ in spread(lambda n: do(*squares[n], first + n), wave):
                done += 1
                progress(done, total)

    work(canvas.lay, [(y, x, layout.patch) for y, x in sites])
    canvas.close_holes()
    for refined in range(layout.passes):
        work(canvas.improve, list(canvas.worst(len(sites))))
        while done < len(sites) * (2 + refined):  # there may be fewer cells than sites
            done += 1
            progress(done, total)
    return SourceMap.of_rows(canvas.laid.rows)


def waves(layout: Layout, squares: list[tuple[int, int, int]]) -> list[list[int]]:
    """Indices of squares (y, x, side) in waves: each is in a later wave than all earlier squares that it touches."""
    cell = max(2, layout.patch // 16)  # px, precision of the overlap test
    last = np.full((-(-layout.height // cell), -(-layout.width // cell)), -1, np.int32)  # last wave that touched it
    by_wave: list[list[int]] = []
    for number, (y, x, side) in enumerate(squares):
        rows, columns = (  # with the surrounding pixels, which are compared
            np.unique((around % size if wraps else around[(around >= 0) & (around < size)]) // cell)
            for around, size, wraps in (
                (np.arange(y - 1, y + side + 1), layout.height, layout.wrap_y),
                (np.arange(x - 1, x + side + 1), layout.width, layout.wrap_x),
            )
        )
        touched = np.ix_(rows, columns)
        wave = int(last[touched].max()) + 1
        last[touched] = wave
        if wave == len(by_wave):
            by_wave.append([])
        by_wave[wave].append(number)
    return by_wave


class _Seen(NamedTuple):
    """The window in which a patch is placed.

    Rows and columns of the result, which may wrap. Masks of where the patch may lie and where pixels exist, and these.
    """

    rows: np.ndarray
    columns: np.ndarray
    inside: np.ndarray
    filled: np.ndarray
    laid: SourceMap

    @property
    def places(self) -> np.ndarray:
        """(2, h, w) rows and columns in the exemplar."""
        return np.stack(self.laid.yx)


class _Canvas:
    """The result so far."""

    def __init__(self, photo: Photo, layout: Layout, budget: int, in_step: InStep | None):
        self._photo, self._source = photo, SeamPhoto(photo.lab)
        self._layout = layout
        self._search = OffsetSearch(photo, layout.patch, in_step)
        self.laid = Laid(layout.height, layout.width, budget)
        self._cell = max(1, layout.patch // 4)
        self._tried = np.zeros((-(-layout.height // self._cell), -(-layout.width // self._cell)), np.uint8)

    def _window(self, y: int, x: int, side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and columns of the patch at (y, x) with a margin, wrapped, and masks of those that exist."""
        g, margin = self._layout, 1
        side += 2 * margin
        rows, columns = np.arange(y - margin, y - margin + side), np.arange(x - margin, x - margin + side)
        there_y = np.ones(side, bool) if g.wrap_y else (rows >= 0) & (rows < g.height)
        there_x = np.ones(side, bool) if g.wrap_x else (columns >= 0) & (columns < g.width)
        # a window larger than the torus would overlap itself
        there_y &= np.arange(side) < margin + g.height if g.wrap_y else True
        there_x &= np.arange(side) < margin + g.width if g.wrap_x else True
        return rows % g.height, columns % g.width, there_y[:, None] & there_x[None, :]

    def _seen(self, y: int, x: int, side: int) -> _Seen:
        """The window at (y, x), one pixel wider than the patch."""
        rows, columns, there = self._window(y, x, side)
        inside = there.copy()
        inside[[0, -1]] = inside[:, [0, -1]] = False
        laid = self.laid.window(rows, columns)
        return _Seen(rows, columns, inside, (laid.packed != NONE) & there, laid)

    def _covered(self, offset: tuple[int, int], inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The patch with its corner at `offset` of the exemplar: its (y, x), and a mask of usable pixels."""
        y, x = (offset[k] - 1 + np.arange(len(inside)) for k in (0, 1))
        height, width = self._photo.shape
        ok = ((y >= 0) & (y < height))[:, None] & ((x >= 0) & (x < width))[None, :]
        ok &= self._photo.usable[np.ix_(y.clip(0, height - 1), x.clip(0, width - 1))]
        return np.stack(np.broadcast_arrays(y[:, None], x[None, :])), ok & inside

    def lay(self, y: int, x: int, side: int, number: int, offset: tuple[int, int] | None = None) -> None:
        """Place an initial patch at (y, x): it fills empty pixels and is cut against existing ones."""
        seen = self._seen(y, x, side)
        empty = seen.inside & ~seen.filled
        if not empty.any():
            return
        tried = [offset] if offset else self._offsets(seen, seen.filled & seen.inside, empty, (y, x), 0x1A1D, number)
        self._put(seen, *self._joined(seen, tried))

    def _offsets(
        self, seen: _Seen, compared: np.ndarray, wanted: np.ndarray, at: tuple[int, int], step: int, number: int
    ) -> list[tuple[int, int]]:
        """Offsets of the placements that are cut, at most `TRIES`, by chance among the best."""
        offsets = self._search.placements(self._source, seen.places, compared, wanted, at)
        first = self._chance(step, number)
        return [offsets[(first + n) % len(offsets)]() for n in range(min(TRIES, len(offsets)))]

    def _joined(self, seen: _Seen, tried: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
        """The patch whose seams cost the least for each pixel that it fills, and the pixels that it takes."""

        def priced(offset: tuple[int, int]) -> tuple[float, np.ndarray, PatchCut]:
            patch, covers = self._covered(offset, seen.inside)
            joint = PatchCut.of(
                crossing_costs(self._source, seen.places, seen.filled, patch, covers), seen.filled, covers
            )
            cost = joint.estimate() if len(tried) > 1 else 0
            return cost / max(1, int(np.count_nonzero(joint.new))), patch, joint

        _, patch, joint = min(map(priced, tried), key=operator.itemgetter(0))
        return patch, joint.banded()

    def close_holes(self) -> None:
        """Place patches around uncovered pixels, at most as many as there are sites, then single pixels.

        In an exemplar of a few pixels, or one pixel wide, a patch covers so little that there is no end of them.
        """
        side, number = self._layout.patch, 0x100000
        half, hole = side // 2, self.laid.first_hole(0)
        most = number + len(self._layout.sites())
        while hole is not None:
            y, x = hole
            if number == most:
                self._continue_rows(y)
                return
            number += 1
            self.lay(y - half, x - half, side, number)
            hole = self.laid.first_hole(y)
            if hole == (y, x):  # no fitting patch has an allowed pixel there: take any that has
                (at_y,), (at_x,) = self._photo.usable_from(self._chance(0x401E, number), 1)
                self.lay(y - half, x - half, side, number, (int(at_y) - half, int(at_x) - half))
                hole = self.laid.first_hole(y)

    def _continue_rows(self, top: int) -> None:
        """Fill uncovered pixels from row `top` with usable pixels in raster order, each row from another one on."""
        columns = np.arange(self._layout.width)
        for y in range(top, self._layout.height):
            rows = np.array([y])
            laid = self.laid.window(rows, columns).packed
            places = SourceMap.of(*self._photo.usable_from(self._chance(0x5CA7, y), len(columns))).packed
            self.laid.put(rows, columns, SourceMap(np.where(laid == NONE, places, laid)))

    def improve(self, y: int, x: int, side: int, number: int) -> None:
        """Place another patch over (y, x) if it makes the seams cheaper."""
        seen = self._seen(y, x, side)
        before = self._cost(seen.places, seen.filled)
        if before == 0:
            return
        ring = seen.filled & seen.inside
        ring[side // 3 : -side // 3, side // 3 : -side // 3] = False  # the inside is to be replaced
        tried = self._offsets(seen, ring, np.zeros_like(ring), (y, x), 0x2EF1, number)
        patch, taken = self._joined(seen, tried)
        if taken.any() and self._cost(np.where(taken, patch, seen.places), seen.filled | taken) < before:
            self._put(seen, patch, taken)

    def _cost(self, places: np.ndarray, filled: np.ndarray) -> int:
        return sum(int(c.sum()) for c in seam_costs(self._source, places, filled))

    def _put(self, seen: _Seen, patch: np.ndarray, taken: np.ndarray) -> None:
        """Write the taken pixels of a patch, only those inside the window, none twice."""
        rows, columns = (np.flatnonzero(seen.inside.any(axis)) for axis in (1, 0))
        inside = np.ix_(rows, columns)
        at = patch[:, inside[0], inside[1]].clip(0)  # a patch may start outside of the photo
        packed = np.where(taken[inside], SourceMap.of(*at).packed, seen.laid.packed[inside])
        self.laid.put(seen.rows[rows], seen.columns[columns], SourceMap(packed))

    def _chance(self, step: int, number: int) -> int:
        return int(hash_at(self._layout.seed, step, np.array([number >> 12]), np.array([number & 0xFFF]))[0] >> 8)

    def worst(self, count: int) -> Iterator[tuple[int, int, int]]:
        """Corners and sides of patches around the most expensive seams, smaller with each try."""
        cell = self._cell
        energy = self._energy() / 4.0**self._tried
        for place in np.argsort(-energy, axis=None, kind="stable")[:count].tolist():
            row, column = divmod(place, energy.shape[1])
            y, x, tried = row * cell, column * cell, int(self._tried[row, column])
            side = max(MOST_NARROW, self._layout.patch * 2 // (3 + tried))
            self._tried[row, column] = min(15, tried + 1)
            yield y + (cell - side) // 2, x + (cell - side) // 2, min(side, self._layout.patch)

    def _energy(self) -> np.ndarray:
        """Seam costs summed over cells."""
        g, cell, sums = self._layout, self._cell, np.zeros(self._tried.shape)
        across = cell * max(1, _LOOKED_AT // cell**2)
        for top, left in itertools.product(range(0, g.height, cell), range(0, g.width, across)):
            rows = np.arange(top, min(top + cell + 1, g.height + g.wrap_y)) % g.height
            columns = np.arange(left, min(left + across + 1, g.width + g.wrap_x)) % g.width
            places = np.stack(self.laid.window(rows, columns).yx)
            inner = across if left + across < g.width else None  # pixels beyond belong to the next piece
            for costs in seam_costs(self._source, places, np.ones(places.shape[1:], bool)):
                along = costs[:, :inner].sum(0)
                begins = np.arange(0, min(len(along), g.width - left), cell)
                first = left // cell
                sums[top // cell, first : first + len(begins)] += np.add.reduceat(along, begins)
        return sums
