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

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import distance_transform_edt

from ..color.lab_grid import FINE_STEPS, to_grid
from ..core.source_map import SourceMap
from ..core.window import Domain
from ..patchmatch.field import hash_at
from ..regularity.offset_prices import InStep, Prices
from .seams import Source, cut, seam_costs

OVERLAP = 3  # patches of a first layer lie 2/3 of their side apart
CHOICES = 4  # the best placements among which the hash chooses
TRIES = 2  # placements of a refinement
MOST_NARROW = 16  # px, side of a refinement's patch
TOLERANCE = 1.3  # a placement may cost this times the best one
ENOUGH = 0.6  # of the most new pixels that a placement brings: others are not looked at
SEARCHED = 256  # px; larger exemplars are searched at 1/2, 1/4 ... of their size, then nearby
_SAMPLES = 2048  # pixels that are compared nearby
_UNIT = 4  # grid steps of a search's whole numbers: 1/2 Lab


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

        return [(y, x) for y in axis(self.height, self.wrap_y) for x in axis(self.width, self.wrap_x)]


def bytes_needed(layout: Layout, exemplar: tuple[int, ...]) -> int:
    """Memory of a synthesis: the result's places, its seams, the spectra of a search."""
    pixels = exemplar[0] * exemplar[1]
    factor = search_factor(exemplar)
    side = [fft.next_fast_len(n // factor + layout.patch // factor + 2, True) for n in exemplar[:2]]
    return 40 * layout.width * layout.height + 60 * pixels + 150 * side[0] * side[1]


def search_factor(shape: tuple[int, ...]) -> int:
    """By how much an exemplar is reduced for the search, a power of two."""
    factor = 1
    while max(shape[:2]) // factor > SEARCHED:
        factor *= 2
    return factor


def graph_cut(
    exemplar: np.ndarray,
    allowed: np.ndarray | None,
    layout: Layout,
    progress: Callable[[int, int], None],
    in_step: InStep | None = None,
) -> SourceMap:
    """Lay and cut patches until all is covered, then lay the worst seams over.

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

    Returns
    -------
    SourceMap
        Of (height, width) pixels.
    """
    canvas = _Canvas(exemplar, allowed, layout, in_step)
    sites = layout.sites()
    total, patches = len(sites) * (1 + layout.passes), 0
    for y, x in sites:
        canvas.lay(y, x, patches)
        patches += 1
        progress(patches, total)
    canvas.close_holes()
    for refined in range(layout.passes):
        for y, x, side in canvas.worst(len(sites)):
            canvas.improve(y, x, side, patches)
            patches += 1
            progress(patches, total)
        while patches < len(sites) * (2 + refined):  # fewer cells than sites: a small result
            patches += 1
            progress(patches, total)
    return canvas.laid


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

    def lay(self, y: int, x: int, number: int, offset: tuple[int, int] | None = None) -> None:
        """A first patch at (y, x): it fills what is empty and is cut against what is there."""
        place, inside, filled, there = self._seen(y, x, self._layout.patch)
        if not (inside & ~filled).any():
            return
        if offset is None:
            offsets = self._search.placements(self._source, there, filled & inside, inside & ~filled, (y, x))
            offset = offsets[self._chance(0x1A1D, number) % len(offsets)]
        patch, covers = self._covered(offset, inside)
        self._put(place, patch, cut(self._source, there, filled, patch, covers))

    def close_holes(self) -> None:
        """Patches around pixels that none has covered yet, until there are none."""
        half, number = self._layout.patch // 2, 0x100000
        while not self._filled.all():
            y, x = (int(n) for n in np.unravel_index(int(self._filled.argmin()), self._filled.shape))
            number += 1
            self.lay(y - half, x - half, number)
            if not self._filled[y, x]:  # no patch that fits has an allowed pixel just there: any that has
                places = np.flatnonzero(self._allowed)
                at_y, at_x = divmod(int(places[self._chance(0x401E, number) % len(places)]), self._allowed.shape[1])
                self.lay(y - half, x - half, number, (at_y - half, at_x - half))

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


class Search:
    """Where in the exemplar a patch fits what is there: sums of squared differences at all offsets, by Fourier
    transforms (KSE03 §5), over pixels that may be used.

    Departure: where the exemplar has a lattice, offsets that are out of step with it cost, in the exemplar's variance.
    """

    def __init__(self, source: Source, allowed: np.ndarray, patch: int, in_step: InStep | None = None):
        self._patch, self._factor = patch, search_factor(allowed.shape)
        self._usable = allowed
        f = self._factor
        lab = source.lab[f // 2 :: f, f // 2 :: f].astype(np.int64) // _UNIT
        self._allowed = allowed[f // 2 :: f, f // 2 :: f]
        if not self._allowed.any():  # a mask finer than the reduced exemplar
            self._factor, lab, self._allowed = 1, source.lab.astype(np.int64) // _UNIT, allowed
        self._side = -(-patch // self._factor)
        self._shape = tuple(fft.next_fast_len(n + self._side - 1, True) for n in self._allowed.shape)
        usable = self._allowed.astype(np.float64)
        planes = [usable, *(usable * lab[..., c] for c in range(3)), usable * (lab**2).sum(-1)]
        self._spectra = np.stack([fft.rfft2(plane, self._shape) for plane in planes])
        self._offset_prices = None
        if in_step is not None:
            variance = float(lab[self._allowed].var(0).sum())
            self._offset_prices = Prices(in_step.phases(patch=patch), in_step.table(in_step.most(variance)))

    def placements(
        self, source: Source, places: np.ndarray, compared: np.ndarray, wanted: np.ndarray, at: tuple[int, int]
    ) -> list[tuple[int, int]]:
        """The best offsets (y, x) of the patch's corner in the exemplar, at most `CHOICES`.

        Parameters
        ----------
        source : Source
        places : (2, h, w) int
            Source of what is there, a pixel wider on every side than the patch.
        compared, wanted : (h, w) bool
            Where the patch must look like what is there; where it should bring something new.
        at : (int, int)
            Row and column of the patch's corner in the result.
        """
        f = self._factor
        grid = (slice(1 + f // 2, -1, f),) * 2
        if not (compared[grid].any() or wanted[grid].any()):  # finer than the reduced exemplar: any pixel will do
            grid = (slice(1, -1, f),) * 2
        seen, new = compared[grid], wanted[grid]
        lab = source.at(*places[(slice(None), *grid)]).astype(np.int64) // _UNIT
        cost, gain = self._sums(lab, seen, new)
        if self._offset_prices is not None:
            y, x = (f * (np.arange(n) - max(seen.shape) + 1) for n in cost.shape)
            cost = cost + self._offset_prices.at(at[1], at[0], x, y)
        if gain.max() > 0:
            cost = np.where(gain >= max(1, ENOUGH * gain.max()), cost, np.inf)
        offsets = self._apart(cost, self._present(places, compared), max(seen.shape))
        return offsets if f == 1 else [self._nearby(source, places, compared, at, *offset) for offset in offsets]

    def _nearby(
        self, source: Source, places: np.ndarray, compared: np.ndarray, at: tuple[int, int], y: int, x: int
    ) -> tuple[int, int]:
        """The best offset around one of the reduced exemplar's."""
        rows, columns = np.nonzero(compared)
        few = slice(None, None, len(rows) // _SAMPLES + 1)
        rows, columns = rows[few], columns[few]
        if not len(rows):
            return y, x
        wanted, f = source.at(*places[:, rows, columns]).astype(np.float64), self._factor
        best, chosen, reach = np.inf, (y, x), np.arange(-f, f + 1)
        prices = np.zeros((len(reach),) * 2)
        if self._offset_prices is not None:
            prices = _UNIT**2 * self._offset_prices.at(at[1], at[0], x + reach, y + reach)
        colours, usable = self._around(source, y - 1 - f, x - 1 - f, *(n + 2 * f for n in compared.shape))
        width, colours = compared.shape[1] + 2 * f, colours.reshape(-1, 3)
        first = rows * width + columns  # at the least offset
        for dy in reach.tolist():
            for dx in reach.tolist():
                pixels = first + ((dy + f) * width + dx + f)
                inside = usable[pixels]
                count = np.count_nonzero(inside)
                if 2 * count < len(rows) and (dy or dx):
                    continue
                apart = colours[pixels]
                apart -= wanted
                if count < len(rows):
                    apart *= inside[:, None]
                # whole numbers that doubles hold: the order of their sum does not show
                mean = np.vdot(apart, apart) / max(1, count) + prices[dy + f, dx + f]
                if mean < best:
                    best, chosen = mean, (y + dy, x + dx)
        return chosen

    def _around(self, source: Source, y: int, x: int, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
        """Colours of the exemplar's pixels from (y, x) on, in doubles, and which may be used, (height * width,)."""
        rows, columns = y + np.arange(height), x + np.arange(width)
        inside = [(at >= 0) & (at < n) for at, n in zip((rows, columns), self._usable.shape, strict=True)]
        at = np.ix_(*(at.clip(0, n - 1) for at, n in zip((rows, columns), self._usable.shape, strict=True)))
        usable = self._usable[at] & inside[0][:, None] & inside[1]
        return source.lab[at].astype(np.float64), usable.ravel()

    def _sums(self, lab: np.ndarray, seen: np.ndarray, new: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean squared difference over `seen`, and how many of `new` are brought, for every corner from -side + 1."""
        weight = seen.astype(np.float64)
        planes = [weight, *(weight * lab[..., c] for c in range(3)), weight * (lab**2).sum(-1), new.astype(np.float64)]
        ours = [np.conj(fft.rfft2(plane, self._shape)) for plane in planes]
        usable, *colour, square = self._spectra
        products = usable * ours[4] + square * ours[0] - 2 * sum(c * o for c, o in zip(colour, ours[1:4], strict=True))
        sums = [fft.irfft2(s, self._shape) for s in (products, usable * ours[0], usable * ours[5])]
        # corners before the exemplar's own come out at the far end
        reach = max(seen.shape) - 1
        apart, count, gain = (np.rint(np.roll(r, (reach, reach), (0, 1))) for r in sums)
        rows, columns = (n + reach for n in self._allowed.shape)
        apart, count, gain = (r[:rows, :columns] for r in (apart, count, gain))
        # a placement that compares little of what is there says little: it pays for the rest by what is usual
        total = max(1.0, float(weight.sum()))
        many = count > 0.5 * total
        usual = float(np.median(apart[many] / count[many])) if many.any() else 0.0
        return (np.maximum(apart, 0) + np.rint(usual) * (total - count)) / total, gain

    def _present(self, places: np.ndarray, compared: np.ndarray) -> np.ndarray:
        """Offsets that much of the window has already, (n, 2)."""
        y, x = np.nonzero(compared)
        if not len(y):
            return np.zeros((0, 2), np.int64)
        offsets = np.stack([places[0, y, x] - y + 1, places[1, y, x] - x + 1], -1)
        present, counts = np.unique(offsets, axis=0, return_counts=True)
        return present[counts > 0.02 * len(y)]

    def _apart(self, cost: np.ndarray, shunned: np.ndarray, side: int) -> list[tuple[int, int]]:
        """The best few that lie apart from one another and from what is shunned."""
        f, away, free = self._factor, max(1, side // 8), cost.copy()

        def without(y: int, x: int) -> None:
            free[max(0, y - away) : max(0, y + away + 1), max(0, x - away) : max(0, x + away + 1)] = np.inf

        for y, x in (shunned // f + side - 1).tolist():
            without(y, x)
        if not np.isfinite(free).any():  # a patch of which there is only one: again, then
            free[:] = cost
        offsets: list[tuple[int, int]] = []
        limit = np.inf
        while len(offsets) < CHOICES:
            y, x = (int(n) for n in np.unravel_index(int(free.argmin()), free.shape))
            if not free[y, x] <= limit:
                break
            limit = min(limit, TOLERANCE * free[y, x] + 1.0)
            offsets.append(((y - side + 1) * f, (x - side + 1) * f))
            without(y, x)
        return offsets
