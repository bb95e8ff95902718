# SPDX-License-Identifier: Apache-2.0
"""Subtextures of superpixels: the one that covers most of each."""

from __future__ import annotations

import numpy as np

from ...engine.color.lab_reduced import LabPixels
from ...engine.session.resources import Resources
from ..labels.features import SmallLab
from ..superpixels.superpixels import Superpixels
from .subtextures import DecompositionSettings, decomposed


def superpixel_subtextures(
    superpixels: Superpixels, small: SmallLab, resources: Resources, count: int | None = None
) -> np.ndarray:
    """Subtexture of each superpixel, (n,) int64 from 0.

    Parameters
    ----------
    small : SmallLab
        The reduced image: the original is not read again.
    count : int, optional
        Maximum number of subtextures.
    """
    height, width = small.ids.shape
    pixels = LabPixels(small.lab, small.ids > 0, small.factor, None, width, height)
    labels = decomposed(pixels, DecompositionSettings(count=count), resources, texture=small.texture).labels.astype(
        np.int64
    )
    table = np.zeros((superpixels.count + 1, int(labels.max()) + 1), np.int64)
    np.add.at(table, (small.ids.ravel(), labels.ravel()), 1)
    table[np.arange(superpixels.count) + 1, labels[small.places[:, 0], small.places[:, 1]]] += 1
    table[:, 0] = -1
    return np.unique(table[1:].argmax(1), return_inverse=True)[1].reshape(-1)
