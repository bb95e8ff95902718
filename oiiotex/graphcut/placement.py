# SPDX-License-Identifier: Apache-2.0
"""Graph-cut textures: patches laid one after another, each cut where it is seen least (KSE03), from allowed pixels only
(LSA16 §5.2).

First every place of a grid gets a patch that fits what is there; then the worst seams are laid over anew. A patch is
kept only if the seams become cheaper, so refinement never makes them worse.

Departures from KSE03: the sum of squared differences of a placement (their eq. 4) is taken over whole numbers, so that
rounding decides nothing; instead of a probability (their eq. 5) a hash chooses among the few best that lie apart;
offsets that are there already are passed over, because they continue the exemplar word for word.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import distance_transform_edt

from ..color.lab_grid import FINE_STEPS, to_grid
from ..core.source_map import SourceMap
from ..core.window import Domain
from ..patchmatch.field import hash_at
from ..regularity.offset_prices import InStep
from .seams import Source, cut, seam_costs
from .search import Search, search_factor

OVERLAP = 3  # patches of a first layer lie 2/3 of their side apart
TRIES = 2  # placements of a refinement
MOST_NARROW = 16  # px, side of a refinement's patch


@dataclass(frozen=True, kw_only=True)
class Layout(Domain):
    """What to make: the domain, side of a patch in px, passes of refinement."""

    patch: int
    passes: int
    seed: int

    def sites(self) -> list[tuple[int, int]]:
        """Corners (y, x) of the first layer's patches; they cover everything, with overlap."""
        step = max(1, self.patch - self.patch // OVERLAP)

        def axis(size: int, wrap: bool) -> list[int]:
            if wrap:
                count = max(1, -(-size // step))
                return [i * size // count for i in range(count)]
            before = self.patch // (2 * OVERLAP)  # the border is the middle of an overlap, like any other place
            return list(range(-before, max(1, size - self.patch + step), step))

        rows, columns = axis(self.height, self.wrap_y), axis(self.width, self.wrap_x)
        if not self.wrap_x:
            return [(y, x) for y in rows for x in columns]
        # around the border a row's first patch waits for the last one of the row above: not if it begins further right
        return [(y, columns[(n + i) % len(columns)]) for n, y in enumerate(rows) for i in range(len(columns))]


def bytes_needed(layout: Layout, exemplar: tuple[int, ...], threads: int = 1) -> int:
    """Memory of a synthesis: the result's places and seams; of each thread spectra of a search, arcs of a cut."""
    pixels = exemplar[0] * exemplar[1]
    factor = search_factor(exemplar)
    side = [fft.next_fast_len(n // factor + layout.patch // factor + 2, True) for n in exemplar[:2]]
    return 40 * layout.width * layout.height + 60 * pixels + threads * (150 * side[0] * side[1] + 250 * layout.patch**2)


def graph_cut(
    exemplar: np.ndarray,
    allowed: np.ndarray | None,
    layout: Layout,
    progress: Callable[[int, int], None],
    in_step: InStep | None = None,
    spread: Callable[..., Iterable] = map,
) -> SourceMap:
    """Lay and cut patches until all is covered, then lay the worst seams over.

    Patches of a wave do not touch: what is made is what they would make one after the other.

    Parameters
    ----------
    exemplar : (height, width, 3) float32
        CIE Lab.
    allowed : (height, width) bool or None
        Pixels that may be used, at least one; None: all. What the others look like is not looked at.
    layout : Layout
    progress : callable
        Called with (patches tried, patches in all); may raise to stop.
    in_step : InStep or None
        The exemplar's lattice, where the result keeps it.
    spread : callable
        As `map`, perhaps on several threads.

    Returns
    -------
    SourceMap
        Of (height, width) pixels.
    """
    canvas = _Canvas(exemplar, allowed, layout, in_step)
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
    return canvas.laid


def waves(layout: Layout, squares: list[tuple[int, int, int]]) -> list[list[int]]:
    """Squares (y, x, side) by number, in waves: each in one behind all those before it that it touches.

    Parameters
    ----------
    layout : Layout
        Where they lie; one may reach beyond the border, where it begins anew or there is nothing.
    squares : list of (int, int, int)
    """
    cell = max(2, layout.patch // 16)  # px, how exactly it is looked at what touches
    last = np.full((-(-layout.height // cell), -(-layout.width // cell)), -1, np.int32)  # wave that touched it
    by_wave: list[list[int]] = []
    for number, (y, x, side) in enumerate(squares):
        rows, columns = (  # with the pixels around it, which are looked at
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


class _Canvas:
    """What has been laid so far."""

    def __init__(self, exemplar: np.ndarray, allowed: np.ndarray | None, layout: Layout, in_step: InStep | None):
        lab = to_grid(exemplar, FINE_STEPS)
        if allowed is not None:
            # seams compare what lies beyond a patch's border, too: there the nearest pixel that may be used stands in
            y, x = distance_transform_edt(~allowed, return_distances=False, return_indices=True)
            lab = lab[y, x]
        self._source = Source(lab)
        self._allowed = np.ones(lab.shape[:2], bool) if allowed is None else allowed
        self._layout = layout
        self._search = Search(self._source, self._allowed, layout.patch, in_step)
        self.laid = SourceMap(np.zeros((layout.height, layout.width), np.uint32))
        self._filled = np.zeros((layout.height, layout.width), bool)
        self._tried = np.zeros(self._filled.shape, np.uint8)

    def _window(self, y: int, x: int, side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and columns of the patch at (y, x) with a margin, wrapped; and which of them there are."""
        g, margin = self._layout, 1
        side += 2 * margin
        rows, columns = np.arange(y - margin, y - margin + side), np.arange(x - margin, x - margin + side)
        there_y = np.ones(side, bool) if g.wrap_y else (rows >= 0) & (rows < g.height)
        there_x = np.ones(side, bool) if g.wrap_x else (columns >= 0) & (columns < g.width)
        # a window larger than the torus would meet itself
        there_y &= np.arange(side) < margin + g.height if g.wrap_y else True
        there_x &= np.arange(side) < margin + g.width if g.wrap_x else True
        return rows % g.height, columns % g.width, there_y[:, None] & there_x[None, :]

    def _seen(self, y: int, x: int, side: int) -> tuple[tuple, np.ndarray, np.ndarray, np.ndarray]:
        """(indices, inside, filled, places) of the window at (y, x), a pixel wider than the patch."""
        rows, columns, there = self._window(y, x, side)
        inside = there.copy()
        inside[[0, -1]] = inside[:, [0, -1]] = False
        place = np.ix_(rows, columns)
        return place, inside, self._filled[place] & there, np.stack(self.laid[place].yx)

    def _covered(self, offset: tuple[int, int], inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The patch whose corner lies at `offset` of the exemplar: its (y, x), and where it may be taken."""
        y, x = (offset[k] - 1 + np.arange(len(inside)) for k in (0, 1))
        height, width = self._allowed.shape
        ok = ((y >= 0) & (y < height))[:, None] & ((x >= 0) & (x < width))[None, :]
        ok &= self._allowed[np.ix_(y.clip(0, height - 1), x.clip(0, width - 1))]
        return np.stack(np.broadcast_arrays(y[:, None], x[None, :])), ok & inside

    def lay(self, y: int, x: int, side: int, number: int, offset: tuple[int, int] | None = None) -> None:
        """A first patch at (y, x): it fills what is empty and is cut against what is there."""
        place, inside, filled, there = self._seen(y, x, side)
        if not (inside & ~filled).any():
            return
        if offset is None:
            offsets = self._search.placements(self._source, there, filled & inside, inside & ~filled, (y, x))
            offset = offsets[self._chance(0x1A1D, number) % len(offsets)]
        patch, covers = self._covered(offset, inside)
        self._put(place, patch, cut(self._source, there, filled, patch, covers))

    def close_holes(self) -> None:
        """Patches around pixels that none has covered yet, until there are none."""
        side, number = self._layout.patch, 0x100000
        half = side // 2
        while not self._filled.all():
            y, x = (int(n) for n in np.unravel_index(int(self._filled.argmin()), self._filled.shape))
            number += 1
            self.lay(y - half, x - half, side, number)
            if not self._filled[y, x]:  # no patch that fits has an allowed pixel just there: any that has
                places = np.flatnonzero(self._allowed)
                at_y, at_x = divmod(int(places[self._chance(0x401E, number) % len(places)]), self._allowed.shape[1])
                self.lay(y - half, x - half, side, number, (at_y - half, at_x - half))

    def improve(self, y: int, x: int, side: int, number: int) -> None:
        """Another patch over (y, x), where it makes the seams cheaper."""
        place, inside, filled, there = self._seen(y, x, side)
        before = self._cost(there, filled)
        if before == 0:
            return
        ring = filled & inside
        ring[side // 3 : -side // 3, side // 3 : -side // 3] = False  # what lies within is what is to be replaced
        offsets = self._search.placements(self._source, there, ring, np.zeros_like(inside), (y, x))
        first = self._chance(0x2EF1, number)
        for n in range(min(TRIES, len(offsets))):
            patch, covers = self._covered(offsets[(first + n) % len(offsets)], inside)
            taken = cut(self._source, there, filled, patch, covers)
            if self._cost(np.where(taken, patch, there), filled | taken) < before:
                self._put(place, patch, taken)
                return

    def _cost(self, places: np.ndarray, filled: np.ndarray) -> int:
        return sum(int(c.sum()) for c in seam_costs(self._source, places, filled))

    def _put(self, place: tuple, patch: np.ndarray, taken: np.ndarray) -> None:
        y, x = np.nonzero(taken)
        rows, columns = place[0][y, 0], place[1][0, x]
        self.laid.packed[rows, columns] = SourceMap.of(*patch[:, y, x]).packed
        self._filled[rows, columns] = True

    def _chance(self, step: int, number: int) -> int:
        return int(hash_at(self._layout.seed, step, np.array([number >> 12]), np.array([number & 0xFFF]))[0] >> 8)

    def worst(self, count: int) -> Iterator[tuple[int, int, int]]:
        """Corners and sides of patches around the most expensive seams, each smaller the oftener it was tried."""
        cell = max(1, self._layout.patch // 4)
        energy = self._energy(cell) / 4.0 ** self._tried[::cell, ::cell]
        for place in np.argsort(-energy, axis=None, kind="stable")[:count].tolist():
            y, x = (int(n) * cell for n in divmod(place, energy.shape[1]))
            side = max(MOST_NARROW, self._layout.patch * 2 // (3 + int(self._tried[y, x])))
            self._tried[y, x] = min(15, self._tried[y, x] + 1)
            yield y + (cell - side) // 2, x + (cell - side) // 2, min(side, self._layout.patch)

    def _energy(self, cell: int) -> np.ndarray:
        """Seam costs summed over cells."""
        g = self._layout
        sums = np.zeros((-(-g.height // cell), -(-g.width // cell)))
        for top in range(0, g.height, cell):
            rows = np.arange(top, min(top + cell + 1, g.height + g.wrap_y)) % g.height
            columns = np.arange(g.width + g.wrap_x) % g.width
            places = np.stack(self.laid[np.ix_(rows, columns)].yx)
            for costs in seam_costs(self._source, places, np.ones(places.shape[1:], bool)):
                sums[top // cell] += np.add.reduceat(costs.sum(0), np.arange(0, g.width, cell)[: sums.shape[1]])
        return sums
