# SPDX-License-Identifier: Apache-2.0
"""The dominant texture's mask at the resolution of pixels, by their colors.

Not in LDR09, whose step 7 dilates the centers of dominant texels by a patch: then what is narrower than a patch (veins,
cracks, ledges, bars) is covered from both sides, and the border of what is not runs along squares.
"""

from __future__ import annotations

import numpy as np
from scipy.cluster.vq import kmeans2, vq
from scipy.ndimage import gaussian_filter, uniform_filter

from ..color.lab_reduced import LabPixels
from .diffusion import DOMINANT, Dominance, spread_over

_COLORS = 16  # kinds of colors; 32 changed nothing
_SAMPLE = 6000  # pixels that they are learned from
_WEIGHT = 3.0  # of what a color says, beside the texels around
_LEAST = -5.0  # log odds: to leave a pixel out takes texels and color
_PRIOR = 0.02  # share that is never certain
_SMOOTH = 1.0  # px: the Gaussian over log odds
_COVERED = 1e-6  # of a patch: less is rounding


def refined_mask(dominant: Dominance, pixels: LabPixels, colors: np.ndarray) -> np.ndarray:
    """Where the dominant texture is, (h, w) bool; never where nothing is seen or no whole patch lies.

    Two things say whether a pixel belongs to it: which share of the texels that cover it is dominant, and how many of
    all pixels of its color (`pixel_colors`) lie under dominant ones. Log odds of both are added, as of independent
    evidence.
    """
    seen, texels = pixels.seen, dominant.texels
    if not (dominant.types == DOMINANT).any():
        return np.zeros(seen.shape, bool)
    own = spread_over(texels, (dominant.types == DOMINANT).astype(np.float32), seen.shape, 0)
    every = spread_over(texels, np.ones(texels.count, np.float32), seen.shape, 0)
    own, every = (uniform_filter(centers, texels.patch, mode="constant") for centers in (own, every))
    share = np.where(every > _COVERED, own / np.maximum(every, _COVERED), 0)
    mean = float(share[seen].mean(dtype=np.float64))
    count = np.bincount(colors[seen], minlength=_COLORS)
    among = (np.bincount(colors[seen], share[seen], _COLORS) + mean) / (count + 1)
    odds = _log_odds(share) + _WEIGHT * (_log_odds(among) - _log_odds(np.array(mean)))[colors]
    return (gaussian_filter(odds, _SMOOTH) > _LEAST) & (every > _COVERED) & seen


def pixel_colors(pixels: LabPixels) -> np.ndarray:
    """The kind of color of every pixel, (h, w) int: k-means in Lab; 0 where nothing is seen at all."""
    if not pixels.seen.any():
        return np.zeros(pixels.seen.shape, np.int32)
    values = pixels.lab.reshape(-1, 3)
    shown = values[pixels.seen.ravel()]
    sample = np.unique(shown[:: max(1, len(shown) // _SAMPLE)].astype(np.float64), axis=0)
    centers = sample
    if len(sample) > _COLORS:
        centers, _ = kmeans2(sample, _COLORS, 15, minit="++", rng=np.random.default_rng(0), missing="warn")
        centers = centers[np.isfinite(centers).all(1)]
    return vq(values, centers.astype(values.dtype), check_finite=False)[0].reshape(pixels.seen.shape)


def _log_odds(share: np.ndarray) -> np.ndarray:
    return np.log((share + _PRIOR) / (1 - share + _PRIOR))
