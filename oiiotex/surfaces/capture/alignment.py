# SPDX-License-Identifier: Apache-2.0
"""Whether maps or photos of one surface lie on each other: the offset at which their edges correlate best."""

from __future__ import annotations

from typing import NamedTuple

from ...engine.deferred import np

SIDE = 512  # px; longer side at which maps are compared
LEAST = 0.1  # correlation of edges: below it, maps have too little in common to be compared
MOST = 2.0  # px of the compared size: blurs of maps differ by that much
_CLEAR = 1.5  # times the correlation without an offset, as of maps of which one was moved
_DARK = 0.05  # of the mean luminance, added before logarithms
_SLOW = 1 / 16  # of the longer side: Gaussian whose mean does not count


class Offset(NamedTuple):
    """How a map lies on another."""

    x: float  # px of the compared size by which it must be moved
    y: float
    best: float  # correlation of edges then
    here: float  # without an offset, give or take a pixel

    @property
    def moved(self) -> bool:
        """Whether one of them was certainly moved."""
        return self.best > max(LEAST, _CLEAR * self.here) and max(abs(self.x), abs(self.y)) > MOST


def offset_between(map: np.ndarray, other: np.ndarray, wraps: tuple[bool, bool]) -> Offset:
    """The offset of `map` from `other` at which their edges correlate best, by Fourier transforms.

    Parameters
    ----------
    map, other : (height, width, c) float
        The same height and width; channels may differ.
    wraps : (bool, bool)
        They tile along y, along x. Along other axes they fade out at the border.
    """
    a, b = (_edges(values, wraps) for values in (map, other))
    power = np.fft.irfft2(np.conj(np.fft.rfft2(a)) * np.fft.rfft2(b), a.shape)
    power /= max(float(np.sqrt((a * a).sum() * (b * b).sum())), 1e-12)
    y, x = (int(n) for n in np.unravel_index(int(power.argmax()), power.shape))
    here = max(power[dy, dx] for dy in (-1, 0, 1) for dx in (-1, 0, 1))
    down, right = ((n + size // 2) % size - size // 2 for n, size in zip((y, x), a.shape, strict=True))
    return Offset(float(right), float(down), float(power.max()), float(here))


def moved_photos(luminance: np.ndarray) -> list[int]:
    """Numbers of the photos that certainly show the surface elsewhere than the photos before them.

    Edges change with the light, so each photo is compared with the one of three that is most like it: the two before
    it, or the first.

    Parameters
    ----------
    luminance : (n, height, width) float
        Of one surface under n lights, reduced; NaN where it is not seen.
    """
    light = np.nan_to_num(luminance.astype(np.float64), nan=0.0)
    contrast = np.log(light + _DARK * light.mean((1, 2), keepdims=True))[..., None]
    moved = []
    for n in range(1, len(contrast)):
        others = {0, n - 1, max(0, n - 2)}
        offset = max(
            (offset_between(contrast[m], contrast[n], (False, False)) for m in others), key=lambda one: one.best
        )
        moved += [n] * offset.moved
    return moved


def _edges(values: np.ndarray, wraps: tuple[bool, bool]) -> np.ndarray:
    """Steepness of an image without its slow variation, (height, width) float64 of mean 0."""
    from scipy.ndimage import gaussian_filter  # slow to import

    modes = ["wrap" if around else "nearest" for around in wraps]
    smooth = gaussian_filter(values.astype(np.float64), (1, 1, 0), mode=[*modes, "nearest"])
    steps = (
        np.roll(smooth, -1, axis) - np.roll(smooth, 1, axis) if around else np.gradient(smooth, axis=axis)
        for axis, around in enumerate(wraps)
    )
    steep = np.sqrt(sum((step * step).sum(-1) for step in steps))
    steep -= gaussian_filter(steep, _SLOW * max(steep.shape), mode=modes)
    for axis, around in enumerate(wraps):
        if not around:
            steep = steep * np.expand_dims(np.hanning(steep.shape[axis] + 2)[1:-1], 1 - axis)
    return steep - steep.mean()
