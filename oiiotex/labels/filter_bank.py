# SPDX-License-Identifier: Apache-2.0
"""A bank of filters, and textons: clusters of what it says of pixels."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
import scipy.fft
from scipy.cluster.vq import kmeans2
from scipy.ndimage import gaussian_filter
from scipy.spatial.distance import cdist

from ..session import Session

TEXTONS = 60
WAVES = (4.0, 8.0, 16.0)  # px
_PAD = 24  # px of mirror image around what is filtered
_SAMPLES = 8000  # pixels that the textons are learned from
_BLOCK = 1 << 15


def gabor_responses(plane: np.ndarray, waves: tuple[float, ...], turns: int) -> list[np.ndarray]:
    """|response| of Gabor filters of those wavelengths in px, in `turns` directions; plane (h, w) float32.

    Each is a Gaussian in frequency around its wave (of deviation 0.45 wavelengths in space) on one half plane: its
    inverse transform is complex, its modulus the local energy whatever the phase.
    """
    padded = np.pad(plane - plane.mean(), _PAD, mode="symmetric")
    shape = [scipy.fft.next_fast_len(s) for s in padded.shape]
    spectrum = scipy.fft.fft2(padded.astype(np.float32), shape)
    v, u = (scipy.fft.fftfreq(s).astype(np.float32) for s in shape)
    responses = []
    for wave in waves:
        spread = 2.0 * (np.pi * 0.45 * wave) ** 2
        for turn in range(turns):
            angle = np.pi * turn / turns
            over_x = np.exp(-spread * (u - np.cos(angle) / wave) ** 2)
            over_y = np.exp(-spread * (v - np.sin(angle) / wave) ** 2)
            response = np.abs(scipy.fft.ifft2(spectrum * (over_y[:, None] * over_x)))
            responses.append(response[_PAD : _PAD + plane.shape[0], _PAD : _PAD + plane.shape[1]])
    return responses


@dataclass(frozen=True)
class Texture:
    """How an image looks around every pixel: what textons are clusters of.

    Attributes
    ----------
    seen : (h, w) bool
        Where textons are learned.
    responses : list of (h w,) float32
        Energies of 18 Gabor filters and three Laplacians of L, in units of their deviations.
    colours : list of (h w,) float32
        L, a and b, a little blurred.
    """

    seen: np.ndarray
    responses: list[np.ndarray]
    colours: list[np.ndarray]


def texture_of(lab: np.ndarray, seen: np.ndarray, session: Session) -> Texture:
    """The texture of (h, w, 3) float32 Lab, (h, w) bool of which counts."""
    light, known = lab[..., 0], np.flatnonzero(seen.ravel())

    def energies(wave: float) -> list[np.ndarray]:
        return [gaussian_filter(r, 0.35 * wave, truncate=2.5) for r in gabor_responses(light, (wave,), 6)]

    def spots(sigma: float) -> np.ndarray:  # a difference of Gaussians is a Laplacian
        return gaussian_filter(light, sigma, truncate=3.0) - gaussian_filter(light, 1.6 * sigma, truncate=3.0)

    responses = [layer for octave in session.spread(energies, WAVES) for layer in octave]
    responses += session.spread(spots, (1.4, 2.8, 5.6))
    responses = [_standard(response.ravel(), known, 1.0) for response in responses]
    return Texture(seen, responses, [gaussian_filter(lab[..., c], 1.0).ravel() for c in range(3)])


def texton_map(
    texture: Texture, session: Session, most: int = TEXTONS, colour: float = math.sqrt(3.0), samples: int = _SAMPLES
) -> np.ndarray:
    """The texton of every pixel, (h, w) int64, from 0 on.

    Parameters
    ----------
    texture : Texture
    session : Session
    most : int
        Textons.
    colour : float
        Weight of each of three colours against each of 21 responses.
    samples : int
        Pixels that textons are learned from, at most.
    """
    known = np.flatnonzero(texture.seen.ravel())
    planes = [*texture.responses, *(_standard(plane.copy(), known, colour) for plane in texture.colours)]
    if len(known) > samples:
        known = known[np.random.default_rng(0).choice(len(known), samples, replace=False)]
    centres = _centres(np.stack([plane[known] for plane in planes], axis=1), most)
    squares = (centres**2).sum(1) / 2.0

    def nearest(first: int) -> np.ndarray:
        block = np.stack([plane[first : first + _BLOCK] for plane in planes], axis=1)
        return (block @ centres.T - squares).argmax(1)

    textons = np.concatenate(list(session.spread(nearest, range(0, texture.seen.size, _BLOCK))))
    return textons.reshape(texture.seen.shape)


def _standard(plane: np.ndarray, seen: np.ndarray, weight: float) -> np.ndarray:
    """The values in units of their deviation, in place; less than half a Lab unit is noise and not blown up."""
    mean, deviation = plane[seen].mean(dtype=np.float64), plane[seen].std(dtype=np.float64)
    plane -= np.float32(mean)
    plane *= np.float32(weight / max(deviation, 0.5))
    return plane


def _spread_out(points: np.ndarray, count: int) -> np.ndarray:
    """`count` of (n, d) points, (count, d): k-means++ (Arthur and Vassilvitskii 2007).

    As kmeans2's own, to the bit; that measures the distances to all centres again for each.
    """
    random = np.random.default_rng(0)
    chosen = [int(random.integers(len(points)))]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < count:
        np.minimum(nearest, cdist(points[chosen[-1:]], points, "sqeuclidean")[0], out=nearest)
        shares = nearest / nearest.sum()
        chosen.append(int(np.searchsorted(shares.cumsum(), random.uniform())))
    return points[chosen]


def _centres(sample: np.ndarray, most: int) -> np.ndarray:
    """k-means over a sample (n, d), at most (most, d) float32."""
    distinct = np.unique(np.rint(sample * 64.0) / 64.0, axis=0)
    if len(distinct) <= most:
        return distinct.astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a centre that nobody is near stays where it was: no harm
        points = sample.astype(np.float64)
        centres, _ = kmeans2(points, _spread_out(points, most), 20, minit="matrix")
    return centres[np.isfinite(centres).all(1)].astype(np.float32)
