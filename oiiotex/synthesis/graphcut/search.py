# SPDX-License-Identifier: Apache-2.0
"""The search for the best fitting patch of an exemplar: KSE03 section 5, in integers."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from scipy import fft

from ...analysis.regularity.offset_prices import InStep
from .photo import Photo
from .seams import SeamPhoto

CHOICES = 4  # number of best placements among which the hash chooses
TOLERANCE = 1.3  # maximum cost of a placement, relative to the best one
ENOUGH = 0.6  # minimum number of new pixels, relative to the most that any placement brings
SEARCHED = 256  # px; larger exemplars are first searched at 1/2, 1/4 ... of their size, then locally
_SAMPLES = 2048  # pixels compared in the local search
_NEARBY = 32  # steps to each side in the local search: photos of more than 8,192 px are searched in two passes
_UNIT = 4  # grid steps per integer step of a search: 1/2 Lab


def search_factor(shape: tuple[int, ...]) -> int:
    """Factor by which an exemplar is reduced for the search, a power of two."""
    factor = 1
    while max(shape[:2]) // factor > SEARCHED:
        factor *= 2
    return factor


class _Samples:
    """Some pixels of a window that are compared near the offsets found: their rows, columns and colors."""

    def __init__(self, source: SeamPhoto, places: np.ndarray, compared: np.ndarray):
        rows, columns = np.nonzero(compared)
        few = slice(None, None, len(rows) // _SAMPLES + 1)
        self.rows, self.columns, self.shape = rows[few], columns[few], compared.shape
        self._colors = source.at(*places[:, self.rows, self.columns])

        self._last: tuple[tuple[int, ...], np.ndarray] | None = None

    def spectra(self, shape: tuple[int, ...]) -> np.ndarray:
        """As `_spectra`; most often of the same shape again."""
        if self._last is None or self._last[0] != shape:
            sampled, lab = np.zeros(self.shape, bool), np.zeros((*self.shape, 3))
            sampled[self.rows, self.columns], lab[self.rows, self.columns] = True, self._colors
            self._last = shape, _spectra(lab, sampled, shape)
        return self._last[1]


class OffsetSearch:
    """The search for the best offsets of a patch: sums of squared differences by Fourier transforms (KSE03 §5).

    Departure: if the exemplar has a lattice, offsets out of phase with it have a penalty, in the exemplar's variance.
    """

    def __init__(self, photo: Photo, patch: int, in_step: InStep | None = None):
        self._factor, self._photo = search_factor(photo.shape), photo
        lab, self._allowed = photo.reduced(self._factor)
        lab = lab.astype(np.int64) // _UNIT
        self._side = -(-patch // self._factor)
        self._shape = tuple(fft.next_fast_len(n + self._side - 1, True) for n in self._allowed.shape)
        self._spectra = _spectra(lab, self._allowed, self._shape)
        self._offset_prices = None
        if in_step is not None:
            variance = float(lab[self._allowed].var(0).sum())
            self._offset_prices = in_step.prices((1, 1), (1, 1), patch, variance / patch**2)

    def placements(
        self, source: SeamPhoto, places: np.ndarray, compared: np.ndarray, wanted: np.ndarray, at: tuple[int, int]
    ) -> list[Callable[[], tuple[int, int]]]:
        """The best offsets (y, x) of the patch's corner in the exemplar, at most `CHOICES`, each refined when called.

        `places` (2, h, w) int; `compared`, `wanted` (h, w) bool.
        """
        f = self._factor
        grid = (slice(1 + f // 2, -1, f),) * 2
        if not (compared[grid].any() or wanted[grid].any()):  # finer than the reduced exemplar: use any pixel
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
        compared_samples = _Samples(source, places, compared)
        return [functools.partial(self._nearby, source, compared_samples, at, *offset) for offset in offsets]

    def _nearby(self, source: SeamPhoto, samples: _Samples, at: tuple[int, int], y: int, x: int) -> tuple[int, int]:
        """The best offset near one found in the reduced exemplar."""
        rows, columns = samples.rows, samples.columns
        if self._factor == 1 or not len(rows):
            return y, x
        f = self._factor
        ys, xs = (  # offsets beyond these leave no compared pixel in the photo
            range(min(0, max(-f, 1 - corner - last)), max(0, min(f, size - corner - begin)) + 1)
            for corner, begin, last, size in (
                (y, int(rows[0]), int(rows[-1]), self._photo.shape[0]),
                (x, int(columns.min()), int(columns.max()), self._photo.shape[1]),
            )
        )
        prices = np.zeros((len(ys), len(xs)))
        if self._offset_prices is not None:
            prices = _UNIT**2 * self._offset_prices.at(at[1], at[0], x + np.array(xs), y + np.array(ys))
        shape = tuple(n + len(reach) - 1 for n, reach in zip(samples.shape, (ys, xs), strict=True))
        around = self._around(source, y - 1 + ys[0], x - 1 + xs[0], *shape)
        padded = tuple(fft.next_fast_len(n, True) for n in shape)
        sums = _differences(_spectra(*around, padded), samples.spectra(padded), padded)
        apart, count = (table[: len(ys), : len(xs)] for table in sums)
        few_compared = 2 * count < len(rows)
        few_compared[-ys[0], -xs[0]] = False
        mean = np.where(few_compared, np.inf, apart / np.maximum(1, count) + prices)

        def cheapest(some_ys: list[int], some_xs: list[int]) -> tuple[int, int]:
            table = mean[np.ix_(np.array(some_ys) - ys[0], np.array(some_xs) - xs[0])]
            dy, dx = divmod(int(table.argmin()), len(some_xs))
            return some_ys[dy], some_xs[dx]

        step = -(-f // _NEARBY)
        dy, dx = cheapest(*([n for n in reach if n % step == 0] for reach in (ys, xs)))
        if step > 1:
            near = ([n for n in reach if abs(n - mid) < step] for reach, mid in ((ys, dy), (xs, dx)))
            dy, dx = cheapest(*near)
        return y + dy, x + dx

    def _around(self, source: SeamPhoto, y: int, x: int, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
        """Colors of the exemplar's pixels from (y, x), and a mask of usable ones."""
        rows, columns = y + np.arange(height), x + np.arange(width)
        inside = [(at >= 0) & (at < n) for at, n in zip((rows, columns), self._photo.shape, strict=True)]
        at = np.ix_(*(at.clip(0, n - 1) for at, n in zip((rows, columns), self._photo.shape, strict=True)))
        return source.lab[at], self._photo.usable[at] & inside[0][:, None] & inside[1]

    def _sums(self, lab: np.ndarray, seen: np.ndarray, new: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean squared difference over `seen`, and number of `new` pixels covered, for every corner from -side + 1."""
        sums = [*_differences(self._spectra, _spectra(lab, seen, self._shape), self._shape), np.zeros(self._shape)]
        if new.any():
            ours = np.conj(fft.rfft2(new.astype(np.float64), self._shape))
            sums[2] = np.rint(fft.irfft2(self._spectra[0] * ours, self._shape))
        # negative corners wrap to the far end
        reach = max(seen.shape) - 1
        rows, columns = (n + reach for n in self._allowed.shape)
        apart, count, gain = (np.roll(r, (reach, reach), (0, 1))[:rows, :columns] for r in sums)
        # few compared pixels prove little: the rest is charged with the typical cost
        total = max(1.0, float(seen.sum()))
        many = count > 0.5 * total
        usual = float(np.median(apart[many] / count[many])) if many.any() else 0.0
        return (np.maximum(apart, 0) + np.rint(usual) * (total - count)) / total, gain

    def _present(self, places: np.ndarray, compared: np.ndarray) -> np.ndarray:
        """Offsets that much of the window already has, (n, 2)."""
        y, x = np.nonzero(compared)
        if not len(y):
            return np.zeros((0, 2), np.int64)
        down, right = places[0, y, x] - y + 1, places[1, y, x] - x + 1
        packed, counts = np.unique(down << 32 | right + (1 << 31), return_counts=True)  # of pairs, it is slow
        present = packed[counts > 0.02 * len(y)]
        return np.stack([present >> 32, (present & 0xFFFFFFFF) - (1 << 31)], -1)

    def _apart(self, cost: np.ndarray, shunned: np.ndarray, side: int) -> list[tuple[int, int]]:
        """The best few offsets that are apart from one another and from the excluded ones."""
        f, away, free = self._factor, max(1, side // 8), cost.copy()

        def without(y: int, x: int) -> None:
            free[max(0, y - away) : max(0, y + away + 1), max(0, x - away) : max(0, x + away + 1)] = np.inf

        for y, x in (shunned // f + side - 1).tolist():
            without(y, x)
        if not np.isfinite(free).any():  # the only possible patch: use it again
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


def _spectra(lab: np.ndarray, mask: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Spectra, padded to that shape, of a mask, of the masked colors, and of the squares of their lengths: (5, ...)."""
    weight, values = mask.astype(np.float64), np.moveaxis(lab.astype(np.float64), -1, 0)
    planes = np.stack([weight, *(weight * values), weight * (values**2).sum(0)])
    return fft.fft(fft.rfft(planes, shape[1]), shape[0], axis=-2)  # rows that are padded are zero before and after


def _differences(exemplar: np.ndarray, patch: np.ndarray, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squared differences, and number of pixels compared, for every (cyclic) offset of a patch: integers.

    `exemplar`, `patch`: as `_spectra` returns them.
    """
    (here, *colors, squares), (seen, *wanted, lengths) = exemplar, np.conj(patch)
    products = here * lengths + squares * seen - 2 * sum(c * w for c, w in zip(colors, wanted, strict=True))
    apart, count = np.rint(fft.irfft2(np.stack([products, here * seen]), shape))
    return apart, count
