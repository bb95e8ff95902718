# SPDX-License-Identifier: Apache-2.0
"""Procedural ashlar: straight courses of unequal height, blocks of any width."""

from __future__ import annotations

import numpy as np

from oiiotex.synthesis.patchmatch.field import hash_at
from tests.pictures import noise, stained


def heights_of(heights: tuple[float, ...], seed: int, count: int) -> np.ndarray:
    """`count` courses, each between the two heights."""
    shares = hash_at(seed, 21, np.arange(count), np.zeros(count, int)) / 2.0**32
    return heights[0] + (heights[1] - heights[0]) * shares


def ashlar(
    height: int, width: int, seed: int, heights: tuple[float, float] = (16, 36), joint: float = 3.0, dark: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """The picture, (height, width, 3) in 0 to 1, and the rows in the middle of its joints."""
    ends = np.cumsum(heights_of(heights, seed, 1 + int(height / heights[0])))
    joints = ends[ends < height - joint]
    y, x = np.mgrid[0:height, 0:width] + 0.5
    row = np.searchsorted(joints, y)
    widths = heights[1] * (1 + 2 * hash_at(seed, 22, row, np.zeros_like(row)) / 2.0**32)
    along = x / widths + hash_at(seed, 23, row, np.zeros_like(row)) / 2.0**32
    block = np.floor(along).astype(int)
    to_bed = np.abs(y[..., None] - joints).min(-1)
    to_end = np.minimum(along % 1, 1 - along % 1) * widths
    in_joint = np.clip(joint / 2 + 0.5 - np.minimum(to_bed, to_end), 0, 1)
    stone = 0.45 + 0.2 * hash_at(seed, 24, row, block) / 2.0**32 + 0.15 * (noise(height, width, seed, 25) - 0.5)
    gray = stone * (1 - in_joint) + (0.15 if dark else 0.9) * in_joint
    return stained(np.clip(gray[..., None] * [1.0, 0.92, 0.8], 0, 1)), joints


def converging(picture: np.ndarray, share: float) -> np.ndarray:
    """A picture whose rows are farther apart on its left, and nearer on its right, by half of this share."""
    height, width = picture.shape[:2]
    y, x = np.mgrid[:height, :width]
    at = np.clip(height / 2 + (y - height / 2) * (1 - share / 2 + share * x / width), 0, height - 1.001)
    row, part = at.astype(int), (at % 1)[..., None]
    return picture[row, x] * (1 - part) + picture[row + 1, x] * part
