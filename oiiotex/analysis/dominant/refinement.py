# SPDX-License-Identifier: Apache-2.0
"""Refinement of the mask of the dominant texture to pixels, by their colors.

Not in LDR09, whose step 7 dilates the centers of dominant texels by a patch: structures narrower than a patch (veins,
cracks, ledges, bars) are then covered from both sides, and the border of the mask consists of squares.
"""

from __future__ import annotations

import numpy as np
from scipy.cluster.vq import kmeans2, vq
from scipy.ndimage import gaussian_filter, uniform_filter

from ...engine.color.lab_reduced import LabPixels
from .diffusion import DOMINANT, Dominance, spread_over

_COLORS = 16  # clusters of colors; 32 changed nothing
_SAMPLE = 6000  # pixels from which they are learned
_WEIGHT = 3.0  # of the color's evidence, relative to that of surrounding texels
_LEAST = -5.0  # log odds: both texels and color are needed to exclude a pixel
_PRIOR = 0.02  # proportion that is never certain
_SMOOTH = 1.0  # px: sigma of the Gaussian over log odds
_COVERED = 1e-6  # of a patch: less is rounding error


def refined_mask(dominant: Dominance, pixels: LabPixels, colors: np.ndarray) -> np.ndarray:
    """Mask of the dominant texture, (h, w) bool; false at invalid pixels and outside of complete patches.

    Evidence for a pixel is the proportion of dominant texels among those that cover it, and the proportion of pixels of
    its color (`pixel_colors`) that lie in dominant texels. Their log odds are added, as for independent evidence.
    """
    seen, texels = pixels.seen, dominant.texels
    if not (dominant.types == DOMINANT).any():
        return np.zeros(seen.shape, bool)
    own = spread_over(texels, (dominant.types == DOMINANT).astype(np.float32), seen.shape)
    every = spread_over(texels, np.ones(texels.count, np.float32), seen.shape)
    own, every = (uniform_filter(centers, texels.patch, mode="constant") for centers in (own, every))
    share = np.where(every > _COVERED, own / np.maximum(every, _COVERED), 0)
    mean = float(share[seen].mean(dtype=np.float64))
    count = np.bincount(colors[seen], minlength=_COLORS)
    among = (np.bincount(colors[seen], share[seen], _COLORS) + mean) / (count + 1)
    odds = _log_odds(share) + _WEIGHT * (_log_odds(among) - _log_odds(np.array(mean)))[colors]
    return (gaussian_filter(odds, _SMOOTH) > _LEAST) & (every > _COVERED) & seen


def pixel_colors(pixels: LabPixels) -> np.ndarray:
    """Index of each pixel's color cluster, (h, w) int, by k-means in Lab; 0 if no pixel is valid."""
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
