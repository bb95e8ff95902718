# SPDX-License-Identifier: Apache-2.0
"""Clique partitioning against the exact solution, against its text, and on the paper's random instances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from oiiotex.analysis.segmentation.clique_partition import contracted, partition
from tests.reference.cliques import best_partition, instance, merged_by_definition, misplaced, score


def figure_3() -> np.ndarray:
    """Five vertices as in CZF02 figure 3: vertex 1 is drawn to the wrong side, and its right partner is repelled."""
    weights = np.zeros((5, 5))
    for i, j, w in ((0, 1, 3), (0, 2, 2), (1, 2, -5), (2, 3, 6), (3, 4, 7), (2, 4, 5), (1, 3, -2)):
        weights[i, j] = weights[j, i] = w
    return weights


def test_the_heuristic_is_what_the_paper_says():
    for seed in range(30):
        for vertices, cliques, noise in ((15, 3, 0.25), (24, 3, 0.25), (40, 4, 0.36)):
            weights, _ = instance(vertices, cliques, noise, seed)
            np.testing.assert_array_equal(partition(weights, refine=False), merged_by_definition(weights))


def test_ties_end_and_go_to_the_lower_vertex():
    random = np.random.default_rng(0)
    for size in (2, 5, 9, 30):
        for _ in range(20):
            weights = np.triu(random.integers(-2, 3, (size, size)), 1)
            weights = weights + weights.T
            np.testing.assert_array_equal(partition(weights, refine=False), merged_by_definition(weights))
    np.testing.assert_array_equal(partition(1 - np.eye(6)), np.zeros(6))  # all alike: one clique


def test_a_vertex_resists_the_false_attraction_of_another_clique():
    weights = figure_3()
    np.testing.assert_array_equal(partition(weights), best_partition(weights))
    np.testing.assert_array_equal(partition(weights, refine=False), [0, 0, 1, 1, 1])


def test_the_refined_partition_is_nearly_the_exact_one():
    """Table I's sizes: the score lost is small, and no score beats the exact one."""
    for vertices, cliques in ((15, 3), (12, 2), (21, 3)):
        lost = []
        for seed in range(10):
            weights, _ = instance(vertices, cliques, 0.25, seed)
            exact = score(weights, best_partition(weights))
            plain, refined = (score(weights, partition(weights, refine)) for refine in (False, True))
            assert plain <= refined + 1e-9 and refined <= exact + 1e-6
            lost.append(1 - refined / exact)
        assert np.mean(lost) < 0.005


def test_large_instances_are_recovered_as_the_paper_says():
    """Table II, last row: 0.7 % misplaced; with the refinement next to none."""
    plain, refined = [], []
    for seed in range(3):
        weights, truth = instance(1000, 10, 0.4, seed)
        plain.append(misplaced(partition(weights, refine=False), truth) / 10)
        refined.append(misplaced(partition(weights), truth) / 10)
    assert np.mean(plain) < 2.0 and np.mean(refined) < 0.15


def test_no_single_move_and_no_merge_gains_after_the_refinement():
    weights, _ = instance(60, 4, 0.4, 1)
    labels = partition(weights)
    best = score(weights, labels)
    for v in range(60):
        for c in range(labels.max() + 2):
            moved = labels.copy()
            moved[v] = c
            assert score(weights, moved) <= best + 1e-9
    between = contracted(weights, labels)
    assert (between <= 1e-9).all()


@pytest.mark.parametrize("refine", [False, True])
def test_sparse_weights_give_what_dense_ones_give(refine):
    for seed in range(10):
        weights, _ = instance(60, 4, 0.35, seed)
        weights[np.abs(weights) < 2] = 0
        found = partition(weights, refine)
        sparse = partition(csr_array(weights), refine)
        np.testing.assert_array_equal(sparse, found)
        assert score(csr_array(weights), sparse) == pytest.approx(score(weights, found))


def test_the_order_of_vertices_does_not_show():
    weights, _ = instance(60, 4, 0.33, 3)
    order = np.random.default_rng(0).permutation(60)
    found = partition(weights, refine=False)[order]
    other = partition(weights[np.ix_(order, order)], refine=False)
    assert len(np.unique(np.stack([found, other]), axis=1).T) == len(np.unique(found)) == len(np.unique(other))


def test_float32_and_float64_and_a_diagonal_make_no_difference():
    weights, _ = instance(120, 5, 0.3, 0)
    np.testing.assert_array_equal(partition(weights), partition(weights.astype(np.float32)))
    np.testing.assert_array_equal(partition(weights), partition(weights + 50 * np.eye(120)))
    np.testing.assert_array_equal(partition(weights), partition(csr_array(weights + 50 * np.eye(120))))


def test_nothing_and_one_and_enemies():
    assert partition(np.zeros((0, 0))).shape == (0,)
    np.testing.assert_array_equal(partition(np.ones((1, 1))), [0])
    np.testing.assert_array_equal(partition(-np.ones((4, 4))), np.arange(4))
    np.testing.assert_array_equal(partition(csr_array((4, 4))), np.arange(4))


@pytest.mark.parametrize(
    "weights",
    [np.ones((2, 3)), np.ones(4), np.array([[0, 1.0], [2, 0]]), np.array([[0, np.nan], [np.nan, 0]])],
    ids=["oblong", "flat", "lopsided", "nan"],
)
@pytest.mark.parametrize("sparse", [False, True])
def test_what_are_no_weights_is_refused(weights, sparse):
    with pytest.raises(ValueError):
        partition(csr_array(weights) if sparse else weights)
