# SPDX-License-Identifier: Apache-2.0
"""Normalized autocorrelation of a texture, also folded onto a lattice's cell."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ...engine.core.elementary import gaussian_taps
from ...engine.deferred import np

SLOW = 1 / 12  # of the longer side: sigma of the high-pass filter
LEAST = 0.25  # minimum share of a texture's pixels that must overlap at an offset for a valid correlation


def _fast_length(n: int) -> int:
    """The next product of 2, 3 and 5, for which a Fourier transform is fast."""
    while True:
        rest = n
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 1


def blurred(planes: np.ndarray, sigma: float, wraps: tuple[bool, bool] = (False, False)) -> np.ndarray:
    """(height, width, n) planes through a Gaussian, zero-padded along an axis, y or x, that does not wrap."""
    taps = gaussian_taps(sigma, 3.0)
    radius = len(taps) // 2
    for axis, around in enumerate(wraps):
        n = planes.shape[axis]
        length = n if around else _fast_length(n + len(taps))
        kernel = np.expand_dims(np.fft.rfft(_around_torus(taps, n) if around else taps, length), (1 - axis, 2))
        wide = np.fft.irfft(np.fft.rfft(planes, length, axis=axis) * kernel, length, axis=axis)
        planes = wide if around else np.take(wide, np.arange(radius, radius + n), axis=axis)
    return planes


def _around_torus(taps: np.ndarray, n: int) -> np.ndarray:
    """Centered taps added up on a torus of n pixels, with the center at 0."""
    return np.bincount((np.arange(len(taps)) - len(taps) // 2) % n, taps, n)


def wrapped_response(sigma: float, n: int) -> np.ndarray:
    """By what `blurred` scales each of the n waves of a torus along an axis, (n,) float64."""
    return np.fft.fft(_around_torus(gaussian_taps(sigma, 3.0), n)).real


def high_passed(
    values: np.ndarray, usable: np.ndarray, wraps: tuple[bool, bool] = (False, False), longer: int = 0
) -> np.ndarray:
    """Values minus their Gaussian mean over usable pixels, 0 where nothing is usable: (height, width, n) float64.

    `longer`: side that the Gaussian is a share of, 0 for the image's own longer side.
    """
    weight = usable[..., None].astype(np.float64)
    both = blurred(np.concatenate([values * weight, weight], -1), SLOW * (longer or max(usable.shape)), wraps)
    return (values - both[..., :-1] / np.maximum(both[..., -1:], 1e-6)) * weight


@dataclass(frozen=True)
class Autocorrelation:
    """Normalized autocorrelation over offsets.

    Attributes
    ----------
    ncc : (2 reach_y + 1, 2 reach_x + 1) float64
        Centered: offset 0 is in the middle. -1 to 1. 0 if too few pixels overlap.
    weight : the same
        Number of overlapping pixels. 0 if too few.
    """

    ncc: np.ndarray
    weight: np.ndarray

    @property
    def reach(self) -> tuple[int, int]:
        """The largest offset along x, along y."""
        return self.ncc.shape[1] // 2, self.ncc.shape[0] // 2

    @property
    def mean(self) -> float:
        """Weighted mean over offsets."""
        return float((self.ncc * self.weight).sum() / self.weight.sum())

    def offsets(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y of every offset."""
        x, y = self.reach
        return np.meshgrid(np.arange(-x, x + 1), np.arange(-y, y + 1))

    @cached_property
    def _half(self) -> tuple[np.ndarray, ...]:
        """x, y, weight and value of valid offsets, without their opposites, which have the same values."""
        x, y = self.offsets()
        half = (self.weight > 0) & ((y > 0) | ((y == 0) & (x > 0)))
        return x[half], y[half], self.weight[half], self.ncc[half]

    def folded(self, frequencies: np.ndarray, bins: int, blur: float = 0.0) -> np.ndarray:
        """The mean over all offsets of equal phase on a lattice, except the nearest to 0; 0 without an offset.

        Parameters
        ----------
        frequencies : (rank, 2) float
            Cycles per pixel along x, y.
        bins : int
            Number of bins of each phase. Phase 0 is the middle of bin 0.
        blur : float
            Sigma of a Gaussian weight of the mean, px along each frequency.

        Returns
        -------
        (bins,) * rank float64
        """
        x, y, weight, ncc = self._half
        weight = np.where(x * x + y * y > 0.25 / np.linalg.norm(frequencies, axis=1).max() ** 2, weight, 0.0)
        cell = np.zeros(len(x), np.int64)
        for along_x, along_y in frequencies:
            cell = cell * bins + np.rint(x * (along_x * bins) + y * (along_y * bins)).astype(np.int64) % bins
        shape = (bins,) * len(frequencies)
        sums: np.ndarray = np.bincount(cell, weight * ncc, bins ** len(shape)).reshape(shape)
        counts: np.ndarray = np.bincount(cell, weight, bins ** len(shape)).reshape(shape)
        mirrored = [np.roll(np.flip(a), 1, tuple(range(a.ndim))) for a in (sums, counts)]
        sums, counts = sums + mirrored[0], counts + mirrored[1]
        if blur > 0:
            for axis, size in enumerate(np.linalg.norm(frequencies, axis=1)):
                response = np.exp(-2.0 * (np.pi * blur * size * np.fft.fftfreq(bins, 1 / bins)) ** 2)
                shaped = np.expand_dims(response, tuple(a for a in range(sums.ndim) if a != axis))
                sums, counts = (np.fft.ifft(np.fft.fft(a, axis=axis) * shaped, axis=axis).real for a in (sums, counts))
        return sums / np.maximum(counts, 1e-6 * counts.max() or 1.0)


def autocorrelation(values: np.ndarray, usable: np.ndarray) -> Autocorrelation:
    """Autocorrelation of high-passed values, summed over channels, over all offsets with enough overlap.

    Parameters
    ----------
    values : (height, width, n) float
    usable : (height, width) bool
        Pixels that count.
    """
    height, width = usable.shape
    shape = _fast_length(2 * height), _fast_length(2 * width)

    def transformed(plane: np.ndarray) -> np.ndarray:
        return np.fft.fft(np.fft.rfft(plane, shape[1], axis=1), shape[0], axis=0)  # no row of zeros, as rfft2 would

    reach_y, reach_x = height * 3 // 4, width * 3 // 4
    down, right = np.arange(-reach_y, reach_y + 1), np.arange(-reach_x, reach_x + 1)

    def at_offsets(spectrum: np.ndarray) -> np.ndarray:
        return np.fft.irfft(np.fft.ifft(spectrum, axis=0)[down], shape[1], axis=1)[:, right]

    power = np.zeros((shape[0], shape[1] // 2 + 1))
    for c in range(values.shape[2]):
        spectrum = transformed(values[..., c])
        power = power + spectrum.real**2 + spectrum.imag**2
    products, squares = at_offsets(power), (values * values).sum(2)
    if usable.all():  # two overlapping rectangles, without Fourier transforms
        overlap = np.outer(height - np.abs(down), width - np.abs(right)).astype(np.float64)
        first = _sums_of_overlaps(squares, down, right)
    else:
        mask = transformed(usable.astype(np.float64))
        first = at_offsets(transformed(squares) * np.conj(mask))  # energy of the first of two overlapping images
        overlap = at_offsets(mask.real**2 + mask.imag**2)
    second = np.flip(first)  # and of the second
    enough = overlap >= LEAST * usable.sum()
    least = 1e-9 * max(1e-30, float((values * values).sum()))
    ncc = products / np.sqrt(np.maximum(first * second, least**2))
    return Autocorrelation(np.where(enough, ncc, 0.0), np.where(enough, overlap, 0.0))


def _sums_of_overlaps(values: np.ndarray, down: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Sums of (height, width) values where a copy that is moved up and left by an offset overlaps: (down, right)."""
    sums = np.zeros((values.shape[0] + 1, values.shape[1] + 1))
    sums[1:, 1:] = values.cumsum(0).cumsum(1)
    (top, bottom), (left, end) = (
        (np.maximum(0, by), np.minimum(n, n + by)) for by, n in zip((down, right), values.shape, strict=True)
    )
    rows = sums[bottom] - sums[top]
    return rows[:, end] - rows[:, left]


def wrapped_autocorrelation(values: np.ndarray, longer: int = 0) -> Autocorrelation:
    """Autocorrelation of an image on the torus, high-passed there: all offsets up to half its size.

    Parameters
    ----------
    values : (height, width, n) float
    longer : int
        Side that the high-pass filter's sigma is a share of, 0 for the image's own longer side.
    """
    height, width = values.shape[:2]
    cycles = np.fft.fftfreq(height)[:, None] ** 2 + np.fft.rfftfreq(width) ** 2
    kept = 1.0 - np.exp(-2.0 * (np.pi * SLOW * (longer or max(height, width))) ** 2 * cycles)
    power = sum(np.abs(kept * np.fft.rfft2(values[..., c])) ** 2 for c in range(values.shape[2]))
    ncc = np.fft.irfft2(power, (height, width))
    reach_y, reach_x = (height - 1) // 2, (width - 1) // 2
    ncc = ncc[np.ix_(np.arange(-reach_y, reach_y + 1), np.arange(-reach_x, reach_x + 1))] / max(ncc[0, 0], 1e-30)
    return Autocorrelation(ncc, np.full(ncc.shape, float(height * width)))
