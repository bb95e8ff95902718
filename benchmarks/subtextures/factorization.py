# SPDX-License-Identifier: Apache-2.0
"""Segmentation by factorization, a peer of --texdecompose, written from the equations of its paper.

Yuan, Wang, Cheriyadat: Factorization-Based Texture Segmentation, IEEE Transactions on Image Processing 24(11), 2015.
Every pixel's local spectral histogram is modeled as a mixture, by area, of those of the textures in its window:
Y = Z beta. Representatives Z are found in the subspace of the largest singular vectors of Y, beta is solved by least
squares, a pixel has the label whose share is largest. The number of textures is the rank of Y up to a residual.

Departures from the paper, and choices that it leaves open: color is three intensity bands in addition to the filters on
their mean. Histograms are of values between the 0.5 and 99.5 percentiles. Places where opposite windows differ more
than the median are borders, without representatives. Alternating least squares with non-negative factors ends after ten
rounds. Labels of less than 2 % of the image are dropped. Window and residual were set on the half "tune" of
benchmarks.shared.mosaics.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import convolve, gaussian_laplace, uniform_filter

BINS = 11
WINDOW, WINDOW_TOLD = 41, 57  # px, side of the square that a histogram is of; where the number is told
RESIDUAL = 0.18  # omega: of the features' energy that the subspace may leave out, as a root
MOST = 16  # textures
_LOG = (1.2, 2.4)  # px, sigma
_GABOR = (2.5, 6)  # px, sigma; orientations
_SMALL = 0.02  # of the image: a label with less is none; as of --texdecompose
_ROUNDS, _CENTERS = 10, 20


def bands(rgb: np.ndarray) -> np.ndarray:
    """(h, w, 11): three colors, two Laplacians of a Gaussian, six Gabor filters of their mean; rgb in 0 .. 1."""
    gray = rgb.mean(-1)
    sigma, turns = _GABOR
    reach = round(3 * sigma)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    made = [*np.moveaxis(rgb, -1, 0), *(gaussian_laplace(gray, s) for s in _LOG)]
    for angle in np.arange(turns) * np.pi / turns:
        along = x * np.cos(angle) + y * np.sin(angle)
        wave = np.exp(-(x * x + y * y) / (2 * sigma**2)) * np.cos(2 * np.pi * along / (2.5 * sigma))
        made.append(convolve(gray, wave - wave.mean(), mode="nearest"))
    return np.stack(made, -1)


def spectral_histograms(values: np.ndarray, window: int) -> np.ndarray:
    """Y: (h, w, bands * BINS) float32, the share of each bin of each band in the square around every pixel."""
    made = np.empty((*values.shape[:2], values.shape[2] * BINS), np.float32)
    for band in range(values.shape[2]):
        low, high = np.percentile(values[..., band], (0.5, 99.5))
        bins = ((values[..., band] - low) / max(high - low, 1e-9) * BINS).astype(np.int64).clip(0, BINS - 1)
        for n in range(BINS):
            made[..., band * BINS + n] = uniform_filter((bins == n).astype(np.float32), window, mode="nearest")
    return made


def edgeness(features: np.ndarray, window: int) -> np.ndarray:
    """(h, w): how far the histograms half a window away on opposite sides are from each other, both ways added."""
    away = window // 2
    padded = np.pad(features, ((away, away), (away, away), (0, 0)), mode="edge")
    h, w = features.shape[:2]
    middle = slice(away, away + h), slice(away, away + w)
    down = padded[2 * away :, middle[1]] - padded[:h, middle[1]]
    across = padded[middle[0], 2 * away :] - padded[middle[0], :w]
    return np.sqrt((down**2).sum(-1)) + np.sqrt((across**2).sum(-1))


def representatives(points: np.ndarray, count: int) -> np.ndarray:
    """Z in the subspace: (count, r), begun at the points farthest from those chosen before, then k-means."""
    chosen = [int((points**2).sum(1).argmax())]
    near = ((points - points[chosen[0]]) ** 2).sum(1)
    while len(chosen) < count:
        chosen.append(int(near.argmax()))
        near = np.minimum(near, ((points - points[chosen[-1]]) ** 2).sum(1))
    centers = points[chosen]
    for _ in range(_CENTERS):
        owner = ((centers**2).sum(1) - 2 * points @ centers.T).argmin(1)
        sums = np.stack([points[owner == n].mean(0) if (owner == n).any() else centers[n] for n in range(count)])
        if np.allclose(sums, centers):
            break
        centers = sums
    return centers


def segmented(
    rgb: np.ndarray, count: int | None = None, window: int = WINDOW, residual: float = RESIDUAL
) -> np.ndarray:
    """Labels (h, w) from 1 on.

    Parameters
    ----------
    rgb : (h, w, 3) array
        0 to 1.
    count : int, optional
        Number of textures. Default: the rank of Y up to `residual`.
    window : int
        Side of the windows, px, odd.
    residual : float
        omega.
    """
    features = spectral_histograms(bands(rgb), window)
    flat = features.reshape(-1, features.shape[-1])
    energies, vectors = np.linalg.eigh(flat.T.astype(np.float64) @ flat)  # squared singular values, ascending
    energies, vectors = energies[::-1].clip(0), vectors[:, ::-1]
    left = np.sqrt(np.maximum(1 - np.cumsum(energies) / energies.sum(), 0))
    rank = count or int(min(MOST, 1 + (left > residual).sum()))
    points = flat @ vectors[:, :rank].astype(np.float32)
    inside = edgeness(features, window).ravel()
    candidates = points[inside <= np.median(inside)]
    centers = representatives(candidates[:: max(1, len(candidates) // 20000)].astype(np.float64), rank)
    z = np.maximum(centers @ vectors[:, :rank].T, 0).T  # (M, r)
    sample = flat[:: max(1, len(flat) // 20000)].astype(np.float64).T
    for _ in range(_ROUNDS):  # alternating least squares
        beta = np.maximum(np.linalg.lstsq(z, sample, rcond=None)[0], 0)
        z = np.maximum(np.linalg.lstsq(beta.T, sample.T, rcond=None)[0].T, 0)
    labels = (flat @ np.linalg.pinv(z).T.astype(np.float32)).argmax(1)
    shares = np.bincount(labels, minlength=rank) / len(labels)
    kept = np.flatnonzero(shares >= min(_SMALL, shares.max()))
    labels = kept[(flat @ np.linalg.pinv(z[:, kept]).T.astype(np.float32)).argmax(1)]
    return labels.reshape(features.shape[:2]) + 1
