# SPDX-License-Identifier: Apache-2.0
"""Region keys and the content table (LSA16 section 6) against a look at every window."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from oiiotex.analysis.labels import content_table
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.errors import ImageError


def blobs(height: int, width: int, labels: int, seed: int = 0) -> np.ndarray:
    """Label maps with large and small regions, and pixels of no label."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    points = random.random((3 * labels, 2)) * (height, width)
    nearest = np.argmin([(y - a) ** 2 + (x - b) ** 2 for a, b in points], 0) % labels + 1
    nearest[random.random((height, width)) < 0.0005] = 0
    return nearest.astype(np.uint32)


@pytest.mark.parametrize(("labels", "side"), [(3, 8), (40, 13), (300, 16)])
def test_keys_are_the_two_most_frequent_labels_of_every_window(labels, side, monkeypatch):
    monkeypatch.setattr(content_table, "_TILE", 24)  # several pieces, uneven at the ends
    ids = blobs(70, 61, labels)
    allowed = np.random.default_rng(1).random(ids.shape) > 0.0005
    first, second = content_table.window_keys(ids, side, allowed)
    assert first.shape == (70 - side + 1, 61 - side + 1)
    for y, x in np.ndindex(first.shape):
        window = ids[y : y + side, x : x + side]
        if (window == 0).any() or not allowed[y : y + side, x : x + side].all():
            assert (first[y, x], second[y, x]) == (0, 0)
        else:
            assert (first[y, x], second[y, x]) == content_table.key_of(content_table.histogram(ids, y, x, side))
    assert (first == 0).any() and (first > 0).any()


def test_ties_go_to_the_lower_id_and_one_label_alone_is_both():
    assert content_table.key_of({5: 4, 2: 4, 9: 4}) == (2, 5)
    assert content_table.key_of({7: 3}) == (7, 7)
    assert content_table.key_of({}) == (0, 0)
    halves = np.repeat([[3, 3, 1, 1]], 4, 0)
    assert [int(k[0, 0]) for k in content_table.window_keys(halves, 4)] == [1, 3]


def test_the_table_holds_every_window_once_under_its_key():
    first, second = content_table.window_keys(blobs(60, 70, 6, 3), 9)
    table = content_table.content_table(first, second, 9)
    seen = 0
    for n, key in enumerate(table.keys.tolist()):
        at = table.offsets[table.starts[n] : table.starts[n + 1]]
        y, x = at >> 16, at & 0xFFFF
        assert (first[y, x] == key[0]).all() and (second[y, x] == key[1]).all()
        assert (table.key_map[y, x] == n).all() and table.nearest(key) == n
        seen += len(np.unique(at))
    assert seen == np.count_nonzero(first) == len(table.offsets)
    assert ((table.key_map == content_table.NO_KEY) == (first == 0)).all()


def test_what_is_sorted_at_once_does_not_show_in_a_table(monkeypatch):
    labels = np.random.default_rng(1).integers(0, 5, (8, 9)).repeat(7, 0).repeat(7, 1)
    tables = []
    for at_once in (1 << 16, 100):
        monkeypatch.setattr(content_table, "_SORTED", at_once)
        tables.append(content_table.content_table(*content_table.window_keys(labels, 6), 6))
    for name in ("keys", "starts", "offsets", "key_map"):
        np.testing.assert_array_equal(*(getattr(table, name) for table in tables))
    for n, offsets in enumerate(np.split(tables[1].offsets, tables[1].starts[1:-1])):  # as they lie, row by row
        assert (np.diff(offsets.astype(np.int64)) > 0).all()
        assert (tables[1].key_map[SourceMap(offsets).yx] == n).all()


def test_a_key_that_no_window_has_gives_the_nearest():
    first = np.array([[1, 1, 2, 3, 4]])
    second = np.array([[2, 2, 1, 3, 3]])
    table = content_table.content_table(first, second, 8)
    keys = table.keys.tolist()
    for wanted, found in {(1, 1): [1, 2], (1, 3): [1, 2], (2, 9): [2, 1], (3, 1): [3, 3], (9, 3): [3, 3]}.items():
        assert keys[table.nearest(wanted)] == found
    assert keys[table.nearest((9, 9))] == [1, 2]  # any: the one with most windows


def test_no_window_with_a_label_is_an_error():
    with pytest.raises(ImageError, match="no 8x8 patch"):
        content_table.content_table(*content_table.window_keys(np.zeros((20, 20), int), 8), 8)


@pytest.mark.parametrize(("rho", "side"), [(0.1, 16), (23, 32), (22, 16), (60, 64), (91, 128), (90, 64), (5000, 256)])
def test_the_side_of_a_patch_is_the_nearest_power_of_two(rho, side):
    assert content_table.patch_side(rho) == side


def test_the_largest_window_is_found():
    allowed = np.zeros((40, 50), bool)
    assert content_table.largest_window(allowed) == 0
    allowed[3:20, 30:44] = True
    assert content_table.largest_window(allowed) == 14
    assert np.count_nonzero(content_table.whole_windows(allowed, 14)) == 4
    assert content_table.regions(content_table.whole_windows(allowed, 14), 30) == 1


def test_a_table_holds_what_is_asked_for_it(monkeypatch):
    """At its height, of a map of many small pieces: nearly every window has another key."""
    monkeypatch.setattr(content_table, "_SORTED", 1 << 11)
    labels = np.random.default_rng(0).integers(1, 60, (40, 40)).repeat(12, 0).repeat(12, 1).astype(np.uint32)
    tracemalloc.start()
    try:
        content_table.content_table(*content_table.window_keys(labels, 16), 16)
        held = tracemalloc.get_traced_memory()[1] / labels.size
    finally:
        tracemalloc.stop()
    assert 0.6 * content_table.TABLE_BYTES < held <= content_table.TABLE_BYTES, f"{held:.1f} bytes a pixel"
