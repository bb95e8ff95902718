# SPDX-License-Identifier: Apache-2.0
"""A filter bank, and textons: clusters of its responses.

Gaussians and textons are kernels (cl/filter_bank.cl). Responses are rounded to 1/64 of a standard deviation before
textons are learned, so textons are the same on every device.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...engine.core.elementary import exponential, gaussian_taps
from ...engine.opencl.buffers import Buffers
from ...engine.session.resources import Resources
from .products import wide_of

TEXTONS = 60
WAVES = (4.0, 8.0, 16.0)  # px
_PAD = 24  # px of mirrored border
FARTHEST = 40  # px that responses depend on
PLANES = 24  # values per pixel: 21 responses, three colors
STEPS = 64  # per standard deviation
_TURNS = 6
_LEAST_GAIN = 1e-25  # less is lost in single precision, and denormal numbers take three times as long
_FAR = 2047  # steps
_SAMPLES = 8000  # pixels from which textons are learned
_ROUNDS = 20  # of k-means


def gabor_responses(plane: np.ndarray, waves: tuple[float, ...], turns: int) -> list[np.ndarray]:
    """|response| of Gabor filters of given wavelengths in px, in `turns` directions; plane (h, w) float32.

    Each is a Gaussian in frequency (in space of standard deviation 0.45 wavelengths) on one half plane, so its inverse
    transform is complex, and the modulus is the local energy for any phase.
    """
    spectrum = _spectrum(plane)
    return [response for wave in waves for response in _octave(spectrum, plane.shape, wave, turns)]


def _spectrum(plane: np.ndarray) -> np.ndarray:
    """Spectrum of a plane with mirrored borders, complex64."""
    padded = np.pad(plane - plane.mean(), _PAD, mode="symmetric")
    return np.fft.fft2(padded.astype(np.float32), [_smooth(s) for s in padded.shape])


def _octave(spectrum: np.ndarray, shape: tuple[int, ...], wave: float, turns: int) -> list[np.ndarray]:
    """|response| of Gabor filters of one wavelength, from the `_spectrum` of a plane of this shape."""
    v, u = (np.fft.fftfreq(s) for s in spectrum.shape)
    height, width = shape
    spread = 2.0 * (math.pi * 0.45 * wave) ** 2
    responses = []
    for turn in range(turns):
        angle = math.pi * turn / turns
        over_x = exponential(-spread * (u - math.cos(angle) / wave) ** 2)
        over_y = exponential(-spread * (v - math.sin(angle) / wave) ** 2)
        gains = over_y.astype(np.float32)[:, None] * over_x.astype(np.float32)
        gains[gains < _LEAST_GAIN] = 0
        both = np.fft.ifft2(spectrum * gains)[_PAD : _PAD + height, _PAD : _PAD + width]
        responses.append(np.sqrt(both.real**2 + both.imag**2))
    return responses


def _smooth(size: int) -> int:
    """The least number from `size` on without a prime factor above 11, which FFTs compute fast."""
    while True:
        rest = size
        for prime in (2, 3, 5, 7, 11):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return size
        size += 1


@dataclass(frozen=True)
class Texture:
    """Texture around each pixel of an image, which textons cluster.

    Attributes
    ----------
    seen : (h, w) bool
        Where textons are learned.
    responses : (21, h w) int16
        Energies of 18 Gabor filters and three Laplacians of L, in standard deviations times `STEPS`.
    colors : (3, h w) float32
        L, a and b, slightly blurred, in standard deviations.
    """

    seen: np.ndarray
    responses: np.ndarray
    colors: np.ndarray

    def within(self, rows: slice, columns: slice) -> Texture:
        """The texture in a window."""

        def cut(planes: np.ndarray) -> np.ndarray:
            whole = planes.reshape(len(planes), *self.seen.shape)
            return np.ascontiguousarray(whole[:, rows, columns]).reshape(len(planes), -1)

        return Texture(np.ascontiguousarray(self.seen[rows, columns]), cut(self.responses), cut(self.colors))

    def invariant(self) -> Texture:
        """Mean energy of all directions and wavelengths instead of each one, so that turned and scaled versions agree.

        The Laplacians, which depend on scale, are omitted.
        """
        responses = np.zeros_like(self.responses)
        gabor = _TURNS * len(WAVES)
        responses[:gabor] = np.rint(self.responses[:gabor].mean(0, dtype=np.float64))
        return Texture(self.seen, responses, self.colors)


def texture_of(lab: np.ndarray, seen: np.ndarray, resources: Resources) -> Texture:
    """The texture of (h, w, 3) float32 Lab; `seen` (h, w) bool are the valid pixels."""
    layers, known = np.ascontiguousarray(np.moveaxis(lab, -1, 0)), np.flatnonzero(seen.ravel())
    light = layers[:1]
    responses = np.empty((PLANES - 3, seen.size), np.int16)

    def keep(plane: int, look: np.ndarray) -> None:
        responses[plane] = _whole(_standard(look.ravel(), known))

    spectrum = _spectrum(layers[0])
    octaves = resources.spread(lambda wave: np.stack(_octave(spectrum, seen.shape, wave, _TURNS)), WAVES)
    for n, (wave, energies) in enumerate(zip(WAVES, octaves, strict=True)):
        for turn in range(_TURNS):  # one at a time, since there are several copies of each
            keep(_TURNS * n + turn, blurred_layers(energies[turn : turn + 1], 0.35 * wave, 2.5, resources))
    for n, sigma in enumerate((1.4, 2.8, 5.6)):  # a difference of Gaussians approximates a Laplacian
        wide, narrow = (blurred_layers(light, times * sigma, 3.0, resources) for times in (1.6, 1.0))
        keep(_TURNS * len(WAVES) + n, narrow - wide)
    colors = blurred_layers(layers, 1.0, 4.0, resources).reshape(3, -1)
    return Texture(seen, responses, np.stack([_standard(color, known) for color in colors]))


def blurred_layers(layers: np.ndarray, sigma: float, reach: float, resources: Resources) -> np.ndarray:
    """Layers (k, h, w) float32 blurred by a Gaussian, on the device, with mirrored borders.

    Parameters
    ----------
    layers : (k, h, w) float32
    sigma : float
        px.
    reach : float
        Radius of the Gaussian, in sigmas.
    """
    device, (count, height, width) = resources.device, layers.shape
    taps, wide = gaussian_taps(sigma, reach), wide_of(resources)
    radius, rest = len(taps) // 2, -width % wide
    columns = np.pad(np.pad(np.arange(width), radius, "symmetric"), (0, rest), "edge")
    looks = np.empty((count, height, len(columns)), np.float32)
    looks[..., radius : radius + width] = layers
    for ends in (slice(radius), slice(radius + width, None)):
        looks[..., ends] = layers[..., columns[ends]]
    mirrored = np.pad(np.arange(height, dtype=np.int32), radius, "symmetric")
    weights, stride = device.upload(taps[radius:].astype(np.float32)), width + rest
    run = device.program("filter_bank", PLANES=PLANES)
    layout = dict.fromkeys(("across", "down"), 4 * count * height * stride)
    with Buffers(device, layout, resources.budget, "the filter bank", tables={"looks": looks}) as buffers:
        numbers = radius, stride, count * height
        run("across", (stride // wide, count * height), buffers["looks"], buffers["across"], weights, *numbers)
        rows, sizes = device.upload(mirrored), (radius, stride, height, count)
        run("down", (stride // wide, height, count), buffers["across"], buffers["down"], weights, rows, *sizes)
        blurred = device.read(buffers["down"], (count, height, stride), np.float32)
    return np.ascontiguousarray(blurred[..., :width])


def texton_map(
    texture: Texture, resources: Resources, most: int = TEXTONS, color: float = math.sqrt(3.0), samples: int = _SAMPLES
) -> np.ndarray:
    """Texton of each pixel, (h, w) uint8, from 0.

    Parameters
    ----------
    most : int
        Maximum number of textons, up to 256.
    color : float
        Weight of each of the three colors relative to each of the 21 responses.
    samples : int
        Maximum number of pixels from which textons are learned.
    """
    known = np.flatnonzero(texture.seen.ravel())
    planes = np.concatenate([texture.responses, _whole(np.float32(color) * texture.colors)])
    if len(known) > samples:
        known = known[np.random.default_rng(0).choice(len(known), samples, replace=False)]
    centers = codebook(planes[:, known].T, most)
    return nearest_centers(planes, centers, resources).reshape(texture.seen.shape)


def nearest_centers(planes: np.ndarray, centers: np.ndarray, resources: Resources) -> np.ndarray:
    """Index of the center nearest to each pixel, ties to the first, (n,) uint8.

    `planes` (24, n) int16; `centers` (k, 24) int32.
    """
    device, pixels, wide = resources.device, planes.shape[1], wide_of(resources)
    tables = device.upload(2 * centers), device.upload((centers**2).sum(1, dtype=np.int32))
    if pixels < wide:
        planes = np.pad(planes, ((0, 0), (0, wide - pixels)))
    size = planes.shape[1]
    run = device.program("filter_bank", PLANES=PLANES)
    with Buffers(device, {"nearest": size}, resources.budget, "textons", tables={"planes": planes}) as buffers:
        run("nearest", (-(-size // wide),), buffers["planes"], *tables, buffers["nearest"], size, len(centers))
        return device.read(buffers["nearest"], (pixels,), np.uint8)


def _standard(plane: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Values in standard deviations, in place; less than half a Lab unit is noise and is not amplified."""
    values = plane if len(seen) == plane.size else plane[seen]
    mean, deviation = values.mean(dtype=np.float64), values.std(dtype=np.float64)
    plane -= np.float32(mean)
    plane *= np.float32(1.0 / max(deviation, 0.5))
    return plane


def _whole(values: np.ndarray) -> np.ndarray:
    """Values in steps of 1 / `STEPS`, int16, clipped at 32 standard deviations."""
    return np.rint(np.clip(values * np.float32(STEPS), -_FAR, _FAR)).astype(np.int16)


def codebook(sample: np.ndarray, most: int, trials: int = 1) -> np.ndarray:
    """k-means of a sample (n, d) int16, at most (most, d) int32; centers are rounded in each iteration.

    Of `trials` candidates for each initial center, the one with the least error is used. All sums are of integers below
    2^53, so the order of summation and the BLAS have no effect: k-means amplifies the least difference in near ties.
    """
    distinct = np.unique(sample, axis=0)
    if len(distinct) <= most:
        return distinct.astype(np.int32)
    points = sample.astype(np.float64)
    centers = _spread_out(points, most, trials)
    columns, ones = np.ascontiguousarray(points.T), np.ones((len(points), 1))
    points, away = np.concatenate([points, ones], 1), np.empty((len(points), most))
    for _ in range(_ROUNDS):
        # |v - c|^2 - |v|^2 in one product
        nearest = np.matmul(points, np.concatenate([-2.0 * centers.T, [(centers**2).sum(1)]]), out=away).argmin(1)
        counts = np.bincount(nearest, minlength=most)
        sums = np.stack([np.bincount(nearest, column, most) for column in columns], axis=1)
        near = counts > 0
        centers[near] = np.rint(sums[near] / counts[near, None])
    return centers.astype(np.int32)


def _spread_out(points: np.ndarray, count: int, trials: int) -> np.ndarray:
    """`count` of (n, d) points, (count, d): k-means++, greedy if `trials` exceeds 1 (Arthur, Vassilvitskii 2007)."""
    random, squares = np.random.default_rng(0), (points**2).sum(1)

    def apart(drawn: list[int]) -> np.ndarray:
        return squares + (squares[drawn, None] - 2.0 * (points[drawn] @ points.T))

    chosen = [int(random.integers(len(points)))]
    nearest = apart(chosen)[0]
    while len(chosen) < count:
        upto = nearest.cumsum()
        drawn = np.searchsorted(upto, random.uniform(size=trials) * upto[-1]).tolist()
        left = np.minimum(nearest, apart(drawn))
        best = int(left.sum(1).argmin())
        chosen.append(drawn[best])
        nearest = left[best]
    return points[chosen]
