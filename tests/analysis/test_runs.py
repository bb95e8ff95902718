# SPDX-License-Identifier: Apache-2.0
"""Pieces of label maps against scipy.ndimage, in any cut into bands."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import ndimage

from oiiotex.analysis.superpixels.run_length import OUTSIDE, Pieces, Strip, pieces_of, without_small


def pieces(labels: np.ndarray, *cuts: int) -> Pieces:
    height, _ = labels.shape
    edges = sorted({0, height, *(c for c in cuts if c < height)})
    return pieces_of((Strip.of(labels[a:b]) for a, b in itertools.pairwise(edges)), height)


def plain(labels: np.ndarray) -> np.ndarray:
    """4-connected pieces numbered by their first pixel."""
    found, count = np.full(labels.shape, -1), 0
    for label in range(labels.max() + 1):
        part, n = ndimage.label(labels == label)
        found[part > 0] = part[part > 0] + count - 1
        count += n
    ids, first = np.unique(found[found >= 0], return_index=True)
    rank = np.full(count, -1)
    rank[ids[np.argsort(first)]] = np.arange(len(ids))
    return np.where(found >= 0, rank[found], OUTSIDE)


def borders(labels: np.ndarray) -> dict[tuple[int, int], int]:
    found: dict[tuple[int, int], int] = {}
    for one, other in ((labels[:, 1:], labels[:, :-1]), (labels[1:], labels[:-1])):
        for p, q in zip(one.ravel().tolist(), other.ravel().tolist(), strict=True):
            if p != q and p >= 0 and q >= 0:
                found[min(p, q), max(p, q)] = found.get((min(p, q), max(p, q)), 0) + 1
    return found


@pytest.mark.parametrize("seed", range(40))
def test_pieces_sizes_and_borders_are_those_of_the_pixels(seed):
    random = np.random.default_rng(seed)
    height, width = random.integers(1, 40, 2)
    labels = random.integers(-1, 3, (height, width)).astype(np.int32)
    found = pieces(labels, *random.integers(1, 40, 3).tolist())
    expected = plain(labels)
    np.testing.assert_array_equal(found.runs.pixels(0, height, 0, width), expected)
    np.testing.assert_array_equal(found.sizes, np.bincount(expected[expected >= 0], minlength=len(found.sizes)))
    lengths = zip(found.borders.a.tolist(), found.borders.b.tolist(), found.borders.length.tolist(), strict=True)
    assert {(a, b): n for a, b, n in lengths} == borders(expected)


@pytest.mark.parametrize("seed", range(20))
def test_small_pieces_join_until_only_lonely_ones_are_small(seed):
    random = np.random.default_rng(seed)
    height, width = random.integers(2, 40, 2)
    labels = random.integers(-1, 3, (height, width)).astype(np.int32)
    before = pieces(labels)
    after = without_small(before, 6)
    pixels = after.runs.pixels(0, height, 0, width)
    np.testing.assert_array_equal(pixels, plain(pixels.astype(np.int32)))  # connected, in canonical order
    np.testing.assert_array_equal(after.sizes, np.bincount(pixels[pixels >= 0], minlength=len(after.sizes)))
    fine = before.runs.pixels(0, height, 0, width)
    assert len(set(zip(fine.ravel(), pixels.ravel(), strict=True))) == len(np.unique(fine))  # whole pieces join
    touching = {i for pair in borders(pixels) for i in pair}
    assert all(after.sizes[i] >= 6 for i in touching)
    again = without_small(pieces(labels, 3, 7, 19), 6)
    np.testing.assert_array_equal(again.runs.pixels(0, height, 0, width), pixels)


def test_a_small_piece_joins_the_large_neighbor_of_the_longest_border():
    labels = np.zeros((6, 9), np.int32)
    labels[:, 5:] = 1
    labels[2:4, 4] = 2  # three sides to 0's region (left, above, below) each counted, one to 1's
    labels[2:4, 3] = 3
    after = without_small(pieces(labels), 10)
    assert after.runs.pixels(0, 6, 0, 9)[2].tolist() == [0] * 5 + [1] * 4
