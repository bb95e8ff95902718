# SPDX-License-Identifier: Apache-2.0
"""Kernels by which labels are found, each against its equation, and the same bits for any width of registers."""

from __future__ import annotations

import hashlib
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_array

from oiiotex.analysis.labels import affinity_graph, features, potts, products, random_walk, stochastic_nmf
from oiiotex.engine.core.elementary import exponential, logarithm, root
from tests.analysis.test_superpixels import resources_of
from tests.reference import labels as reference

LOCAL = 6  # which neighbor's distance is the local scale: LSA16 eq. 4


def blobs(counts: tuple[int, ...], seed: int = 0, apart: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Points around as many places, and whose they are."""
    random = np.random.default_rng(seed)
    truth = np.repeat(np.arange(len(counts)), counts)
    return apart * np.eye(len(counts), 6)[truth] + random.normal(0, 1, (len(truth), 6)), truth


def dense(matrix: products.Sparse) -> np.ndarray:
    made = np.zeros((matrix.rows, matrix.rows))
    rows = np.repeat(np.arange(matrix.rows), np.diff(matrix.starts))
    np.add.at(made, (rows, matrix.columns), matrix.weights.astype(np.float64))
    return made


def test_exponentials_logarithms_and_roots_are_those_of_numpy():
    x = np.concatenate([np.random.default_rng(0).uniform(-60, 60, 5001), [0.0, 1.0, -1.0]])
    np.testing.assert_allclose(exponential(x), np.exp(x), rtol=4e-16)
    y = np.exp(x)
    np.testing.assert_allclose(logarithm(y), np.log(y), rtol=4e-16, atol=3e-16)
    for k in (2, 3, 5):
        np.testing.assert_allclose(root(y, k), y ** (1 / k), rtol=1e-14)
    assert root(np.zeros(1), 5) == 0


def test_their_bits_are_those_of_every_processor():
    x = np.arange(-3000, 3000) / 64
    made = [exponential(x), logarithm(np.arange(1, 6000) / 64), root(np.arange(6000) / 64, 3)]
    digest = hashlib.sha256(b"".join(array.astype("<f8").tobytes() for array in made)).hexdigest()
    assert digest.startswith("151bf77b01e79e50")


# --- neighbors ---


@pytest.mark.parametrize(("n", "d", "spread"), [(201, 3, 6), (77, 7, 9000), (40, 1, 2)])
def test_nearest_are_exact_and_ties_go_to_the_lower_index(any_lanes, monkeypatch, n, d, spread):
    random = np.random.default_rng(0)
    points = random.integers(-spread, spread + 1, (n, d)).astype(np.int16)
    copies = random.integers(1, 9, n)
    expected = reference.nearest(points, 20, copies, LOCAL)
    for scratch in (1 << 22, 3 * 224):  # rows of distances all at once, and three at a time
        monkeypatch.setattr(affinity_graph, "_SCRATCH", scratch)
        found = affinity_graph.nearest(points, 20, resources_of(any_lanes), copies)
        for ours, theirs in zip(found, expected, strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_the_farthest_points_still_have_exact_distances(any_lanes):
    points, unit = affinity_graph.on_grid(np.random.default_rng(1).normal(0, 300, (60, 15)))
    assert unit < 1024 and np.log2(unit) % 1 == 0
    away = points.astype(np.int64)
    assert ((away[:, None] - away) ** 2).sum(-1).max() < 2**31
    found = affinity_graph.nearest(points, 59, resources_of(any_lanes))
    np.testing.assert_array_equal(found.squared, reference.nearest(points, 59, np.ones(60, int), 6)[1])


@pytest.mark.parametrize("copies", [1, 5])
def test_the_graph_is_eq_4_made_symmetric(any_lanes, copies):
    points, _ = blobs((40, 50))
    points[:30] = np.repeat(points[:30:copies], copies, axis=0)
    resources = resources_of(any_lanes)
    steps, unit = affinity_graph.on_grid(points)
    nodes, node, counts = np.unique(steps, axis=0, return_inverse=True, return_counts=True)
    graph = affinity_graph.similarity_graph(points, 25, resources)
    np.testing.assert_array_equal(graph.node, node.ravel())
    index, squared, scales = reference.nearest(nodes, min(25, len(nodes) - 1), counts, LOCAL)
    scale = np.maximum(np.sqrt(scales), 0.1 * unit)
    K = np.zeros((len(nodes),) * 2)
    for i, near in enumerate(index):
        K[i, near] = np.exp(-squared[i] / (scale[i] * scale[near]) * np.exp(-graph.r))
    W = ((K + K.T) / 2 + np.eye(len(nodes))) * counts * counts[:, None]
    scaled, unscale = graph.scaled, np.sqrt(graph.mass)
    made = csr_array((scaled.weights, scaled.columns, scaled.starts)).toarray() * unscale * unscale[:, None]
    np.testing.assert_allclose(made, W, atol=1e-5 * W.max())
    np.testing.assert_allclose(graph.mass, W.sum(0), rtol=1e-5)


def test_r_is_where_similarities_grow_fastest(device):
    points, _ = blobs((80, 70), apart=5.0)
    graph = affinity_graph.similarity_graph(points, 40, resources_of(device))
    steps, unit = affinity_graph.on_grid(points)
    index, squared, scales = reference.nearest(steps, 40, np.ones(150, int), LOCAL)
    relative = squared / np.sqrt(scales[:, None] * scales[index].astype(float))
    r = np.arange(-6, 6, 0.01)
    total = np.log(150 + np.exp(-relative.ravel() * np.exp(-r)[:, None]).sum(1))
    assert graph.r == pytest.approx(r[np.gradient(total).argmax()], abs=0.03)


# --- the walk ---


@pytest.mark.parametrize("counts", [(60, 80, 70), (20, 22), (9,) * 5])
def test_a_walk_is_the_power_of_its_matrix(any_lanes, counts):
    points, _ = blobs(counts, apart=6.0)
    resources = resources_of(any_lanes)
    graph = affinity_graph.similarity_graph(points, min(64, len(points) // 4), resources)
    walk = random_walk.Walk(graph, resources, persistence=0.3)
    S, root = dense(graph.scaled), np.sqrt(graph.mass)
    D = root[:, None] * S / root
    np.testing.assert_allclose(D.sum(0), 1, atol=1e-5)
    power = np.linalg.matrix_power(D, walk.steps)
    np.testing.assert_allclose(walk.left @ walk.right.T, power, atol=5e-3 * power.max())
    assert walk.norm == pytest.approx((power**2).sum(), rel=0.02)
    values = np.linalg.eigvalsh(S)
    below = max([v for v in values if v < 0.9999] + [0.98])
    assert abs(walk.steps - min(2000, np.floor(np.log(0.3 * below) / np.log(below)))) <= 0.01 * walk.steps
    start = np.random.default_rng(0).random(len(S)).astype(np.float32)
    np.testing.assert_allclose(walk.step(start), D @ start, rtol=1e-4)
    column = walk.column(3)
    np.testing.assert_allclose(column, power[:, 3], atol=1e-2 * power.max())
    assert column.min() >= 0 and column.sum() == pytest.approx(1, abs=1e-5)


def test_steps_are_those_of_section_4_4():
    assert random_walk.steps_of(0.9, 0.95, 0.0) == int(np.log(0.95 * 0.9) / np.log(0.9))
    assert random_walk.steps_of(0.9, 0.95, 0.98) == int(np.log(0.95 * 0.98) / np.log(0.98))
    assert random_walk.steps_of(0.0, 0.95, 0.0) == 1
    assert random_walk.steps_of(0.99989, 0.01, 0.98) == 2000


def test_products_are_those_of_numpy(any_lanes):
    random, resources = np.random.default_rng(0), resources_of(any_lanes)
    a, b, c = (random.normal(0, 1, shape).astype(np.float32) for shape in ((37, 21), (21, 5), (37, 9)))
    np.testing.assert_allclose(products.product(a, b, resources), a @ b, atol=1e-5)
    np.testing.assert_allclose(products.gram(a, c, resources), a.T @ c, atol=1e-5)


# --- the descent ---


def thin_walk(n: int, r: int) -> tuple[SimpleNamespace, np.ndarray, np.ndarray]:
    """A left-stochastic matrix of rank r, and left-stochastic F (n, r) and G (r, n) near its factors."""
    random = np.random.default_rng(0)
    F, G = (random.random(shape) ** 3 for shape in ((n, r), (r, n)))
    F, G = ((M / M.sum(0)).astype(np.float32) for M in (F, G))
    near = [0.9 * M + 0.1 * random.permuted(M, axis=0) for M in (F, G)]
    power = SimpleNamespace(n=n, left=F, right=np.ascontiguousarray(G.T), norm=float(((F @ G) ** 2).sum()))
    return power, *near


def test_memberships_are_least_squares_on_the_simplex(any_lanes):
    walk, F, _ = thin_walk(61, 13)
    with stochastic_nmf.Descent(walk, F, None, resources_of(any_lanes)) as descent:
        descent.move_G(300)
        linear = walk.right @ (walk.left.T @ F)  # (D^s)^T F
        np.testing.assert_allclose(descent.G.T, reference.memberships(F.T @ F, linear), atol=2e-3)
        np.testing.assert_allclose(descent.G.sum(0), 1, atol=1e-5)
        assert descent.G.min() >= 0
        error = ((walk.left @ walk.right.T - descent.F @ descent.G) ** 2).sum() / walk.norm
        assert descent.error == pytest.approx(error, rel=1e-2, abs=1e-5)


def test_distributions_go_the_way_of_fista(any_lanes, monkeypatch):
    walk, F, G = thin_walk(333, 7)
    with stochastic_nmf.Descent(walk, F, G, resources_of(any_lanes)) as descent:
        descent.move_G(1)
        G = descent.G.astype(np.float64)
        monkeypatch.setattr(stochastic_nmf, "_largest", lambda matrix: np.linalg.norm(matrix, 2).item())
        descent.move_F()
        expected = reference.distributions(F.astype(np.float64), G @ G.T, G @ walk.right @ walk.left.T, 8)
        np.testing.assert_allclose(descent.F, expected, atol=1e-6)


def test_the_bound_of_a_norm_is_one():
    for seed in range(5):
        half = np.random.default_rng(seed).random((9, 9)) ** 4
        matrix = half @ half.T
        assert np.linalg.norm(matrix, 2) <= stochastic_nmf._largest(matrix) * (1 + 1e-12)
        assert stochastic_nmf._largest(matrix) <= 1.02 * np.linalg.norm(matrix, 2)


# --- what superpixels are and mind ---


def test_counts_are_pooled_by_a_gaussian(any_lanes):
    random = np.random.default_rng(0)
    counts, positions = random.integers(0, 300, (70, 13)), random.random((70, 2)) * [50, 90]
    found = features.pooled(counts, positions, 6.0, resources_of(any_lanes))
    np.testing.assert_allclose(found / 4096, reference.pooled(counts, positions, 6.0, 2.5), rtol=0.03, atol=2)


def test_a_potts_field_is_its_equation(any_lanes, monkeypatch):
    random = np.random.default_rng(0)
    likely = random.random((5, 31)) ** 4
    likely /= likely.sum(0)
    edges = random.integers(0, 30, (50, 2))  # one place has no neighbors
    edges = np.unique(np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1), axis=0)
    expected = reference.settled(likely, edges, 4.0, 6, 1e-3)
    np.testing.assert_array_equal(potts.settled(likely, edges, resources_of(any_lanes)), expected.argmax(0))
    alone, around = (random.normal(0, 3, (5, 31)).astype(np.float32) for _ in range(2))
    seen = np.arange(31) != 7
    pull = np.exp(alone + 2.0 * around)
    found = potts.members(alone, around, seen, 2.0, resources_of(any_lanes))
    np.testing.assert_allclose(found, pull / pull.sum(0) * seen, rtol=1e-5, atol=1e-7)


def test_votes_are_taken_between_the_middles_of_cells(any_lanes):
    votes = np.random.default_rng(0).random((6, 3, 4)).astype(np.float32)
    found = potts.winners(votes, 4, (11, 15), resources_of(any_lanes))
    at = [np.clip((np.arange(size) + 0.5) / 4 - 0.5, 0, cells - 1) for size, cells in ((11, 3), (15, 4))]
    rows = np.stack([[np.interp(at[0], np.arange(3), layer[:, x]) for x in range(4)] for layer in votes])
    pixels = np.stack([[np.interp(at[1], np.arange(4), layer[:, y]) for y in range(11)] for layer in rows])
    np.testing.assert_array_equal(found, pixels.argmax(0))


def test_registers_of_any_width_find_the_same_labels(device, narrow_device):
    points, _ = blobs((120, 90, 70), apart=4.0)
    made = []
    for one in (device, narrow_device):
        resources = resources_of(one)
        graph = affinity_graph.similarity_graph(points, 40, resources)
        walk = random_walk.Walk(graph, resources, persistence=0.9)
        factors = stochastic_nmf.factored(walk, resources, tries=1)
        made.append((graph.scaled.weights, walk.left, walk.right, factors.F, factors.G, factors.error))
    for wide, narrow in zip(*made, strict=True):
        np.testing.assert_array_equal(wide, narrow)
