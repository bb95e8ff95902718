# SPDX-License-Identifier: Apache-2.0
"""Local histogram matching at every pixel, MJH17 section 4.3 to the letter: the oracle of cl/histograms.cl."""

from __future__ import annotations

import numpy as np


def value_counts(image: np.ndarray, first: int, entries: int) -> np.ndarray:
    """How often each value occurs in (..., channels): (channels, entries), entry i for value first + i."""
    flat = image.reshape(-1, image.shape[-1]).astype(int)
    return np.stack([np.bincount(values - first, minlength=entries) for values in flat.T])


def matching_table(counts: np.ndarray, target: np.ndarray, first: int, alpha: float) -> np.ndarray:
    """Value -> alpha G^-1(F(value)) + (1 - alpha) value (MJH17 section 4.2), before rounding.

    `counts`, `target` (channels, entries) int: of F and G, entry i for value first + i; (channels, entries) float64.
    """
    entries = counts.shape[1]
    values, edges = first + np.arange(entries), first + np.arange(entries + 1) - 0.5
    tables = []
    for own, wanted in zip(counts, target, strict=True):
        below = np.concatenate([[0.0], np.cumsum(own)]) / own.sum()
        below_target = np.concatenate([[0.0], np.cumsum(wanted + 1e-9)])
        matched = np.interp(0.5 * (below[:-1] + below[1:]), below_target / below_target[-1], edges)
        tables.append(np.clip(alpha * matched + (1.0 - alpha) * values, first, first + entries - 1))
    return np.stack(tables)


def gaussian_rows(size: int, sigma: float, wrap: bool) -> np.ndarray:
    """(size, size): row i weighs all pixels of an axis seen from pixel i."""
    away = np.arange(size)[None, :] - np.arange(size)[:, None]
    turns = np.arange(-6, 7) * size if wrap else np.zeros(1)
    weights = np.exp(-0.5 * ((away[..., None] + turns) / sigma) ** 2).sum(-1)
    return weights / weights.sum(1, keepdims=True)


def soft_members(values: np.ndarray, low: float, high: float, bins: int) -> np.ndarray:
    """(bins, ...): triangular membership of every value in every bin."""
    place = np.clip((values - low) / max(1.0, high - low), 0, 1) * (bins - 1)
    centers = np.arange(bins).reshape(-1, *(1 for _ in values.shape))
    return np.maximum(0.0, 1.0 - np.abs(place - centers))


def project(
    image: np.ndarray, sigma: float, low: np.ndarray, high: np.ndarray, bins: int, wrap_x: bool, wrap_y: bool
) -> np.ndarray:
    """c' = G^-1(F_x(c)) per channel, with F_x the Gaussian-weighted local cumulative and G the whole image's."""
    height, width = image.shape[:2]
    down, right = gaussian_rows(height, sigma, wrap_y), gaussian_rows(width, sigma, wrap_x)
    out = np.empty(image.shape, np.float64)
    for c in range(3):
        lo, hi = float(low[c]), float(high[c])
        members = soft_members(image[..., c].astype(np.float64), lo, hi, bins)
        local = down @ members @ right.T + 1e-6
        below = np.concatenate([np.zeros((1, height, width)), local.cumsum(0)]) / local.sum(0)
        place = np.clip((image[..., c] - lo) / max(1.0, hi - lo), 0, 1) * (bins - 1)
        b = np.floor(place + 0.5).astype(int)
        inside = place + 0.5 - b
        first = np.take_along_axis(below, b[None], 0)[0]
        share = first + (np.take_along_axis(below, b[None] + 1, 0)[0] - first) * inside
        overall = np.concatenate([[0.0], (members.sum((1, 2)) + 1e-6 * height * width).cumsum()])
        at = np.interp(share, overall / overall[-1], np.arange(bins + 1) - 0.5)
        out[..., c] = np.clip(lo + at * max(1.0, hi - lo) / (bins - 1), lo, hi)
    return out
