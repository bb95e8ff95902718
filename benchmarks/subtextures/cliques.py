# SPDX-License-Identifier: Apache-2.0
"""Clique partitioning on the random instances of CZF02 tables I, II and figure 4, compared with the paper's.

python -m benchmarks.subtextures.cliques [--instances 100] [--large]
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.sparse import csr_array

from oiiotex.analysis.segmentation.clique_partition import partition
from tests.reference.cliques import best_partition, instance, misplaced, score

# noise 25 %; vertices, cliques, errors of the exact solution and of the heuristic, how far the two are apart ("Diff %")
TABLE_1 = ((15, 3, 6.8, 6.93, 0.53), (12, 2, 2.92, 3.08, 0.5), (21, 3, 2.19, 2.14, 0.05), (24, 3, 1.13, 1.33, 0.2))
TABLE_2 = ((40, 4, 0.25, 0.33), (60, 4, 0.25, 0.1), (60, 4, 0.33, 2.1), (120, 5, 0.36, 1.6), (1000, 10, 0.40, 0.7))


def errors(vertices: int, cliques: int, noise: float, instances: int, exact: bool = False) -> np.ndarray:
    """Per instance: errors in percent of heuristic, refined, exact; their CPU seconds; score lost, percent; vertices
    that heuristic and refined must move to become the exact solution, percent."""
    rows = []
    for seed in range(instances):
        weights, truth = instance(vertices, cliques, noise, seed)
        row, seconds, scores, partitions = [], [], [], []
        methods = [lambda w: partition(w, refine=False), partition, *([best_partition] if exact else [])]
        for method in methods:
            start = time.process_time()
            found = method(weights)
            seconds.append(time.process_time() - start)
            row.append(100 * misplaced(found, truth) / vertices)
            scores.append(score(weights, found))
            partitions.append(found)
        fill = [np.nan] * (3 - len(row))
        lost = [100 * (1 - s / scores[2]) if exact else np.nan for s in scores[:2]]
        apart = [100 * misplaced(p, partitions[2]) / vertices if exact else np.nan for p in partitions[:2]]
        rows.append([*row, *fill, *seconds, *fill, *lost, *apart])
    return np.array(rows)


def sparse_instance(vertices: int, cliques: int, degree: int, noise: float, seed: int) -> tuple[csr_array, np.ndarray]:
    """As `instance`, but every vertex has weights to about `degree` others alone."""
    random = np.random.default_rng(seed)
    a = 9 * noise / (1 - noise)
    truth = random.integers(0, cliques, vertices)
    i, j = random.integers(0, vertices, (2, vertices * degree // 2))
    keep = i < j
    i, j = np.unique(np.stack([i[keep], j[keep]]), axis=1)
    drawn = random.random(len(i)) * (9 + a)
    values = np.where(truth[i] == truth[j], drawn - a, drawn - 9)
    both = np.concatenate([i, j]), np.concatenate([j, i])
    return csr_array((np.concatenate([values, values]), both), shape=(vertices, vertices)), truth


def main() -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instances", type=int, default=100)
    parser.add_argument("--large", action="store_true", help="also 20,000 vertices")
    arguments = parser.parse_args()
    print("| vertices | cliques | noise | paper exact | exact | paper heuristic | heuristic | s.e. | refined | CPU ms"
          " heuristic | refined | score lost by heuristic, refined | paper diff | diff |")  # fmt: skip
    print("|---" * 14 + "|")
    rows = [(n, k, 0.25, lp, own, diff) for n, k, lp, own, diff in TABLE_1]
    rows += [(n, k, s, None, own, None) for n, k, s, own in TABLE_2]
    for vertices, cliques, noise, lp, own, diff in rows:
        found = errors(vertices, cliques, noise, arguments.instances, lp is not None)
        mean, spread = found.mean(0), found[:, 0].std() / np.sqrt(len(found))
        exact = ("", "") if lp is None else (f"{lp}", f"{mean[2]:.2f}")
        lost = "" if lp is None else f"{mean[6]:.2f}, {mean[7]:.2f} %"
        apart = ("", "") if lp is None else (diff, f"{mean[8]:.2f}, {mean[9]:.2f}")
        row = [
            vertices,
            cliques,
            f"{100 * noise:.0f} %",
            *exact,
            own,
            *(f"{x:.2f}" for x in (mean[0], spread, mean[1])),
        ]
        print("|", " | ".join(map(str, [*row, *(f"{1000 * x:.1f}" for x in mean[3:5]), lost, *apart])), "|", flush=True)
    print("\nFigure 4: 100 vertices, 5 cliques\n\n| a | noise | heuristic % | refined % |\n|---|---|---|---|")
    for a in (3.0, 3.5, 4.0, 4.5, 5.0, 5.5):
        mean = errors(100, 5, a / (a + 9), arguments.instances).mean(0)
        print(f"| {a} | {100 * a / (a + 9):.1f} % | {mean[0]:.2f} | {mean[1]:.2f} |", flush=True)
    if arguments.large:
        for name, (weights, truth) in {
            "20,000 vertices, 10 cliques, 25 % noise, 300 weights a vertex": sparse_instance(20000, 10, 300, 0.25, 0),
            "20,000 vertices, 10 cliques, 40 % noise, all weights, float32": dense_instance(20000, 10, 0.40),
        }.items():
            for refine in (False, True):
                start = time.process_time()
                found = partition(weights, refine)
                print(f"{name}, {'refined' if refine else 'heuristic'}: {time.process_time() - start:.1f} s CPU,"
                      f" {100 * misplaced(found, truth) / len(found):.3f} % misplaced", flush=True)  # fmt: skip


def dense_instance(vertices: int, cliques: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """As `instance`, in float32 and by blocks of rows."""
    random = np.random.default_rng(0)
    a = np.float32(9 * noise / (1 - noise))
    truth = random.integers(0, cliques, vertices)
    weights = np.empty((vertices, vertices), np.float32)
    for first in range(0, vertices, 500):
        rows = slice(first, first + 500)
        drawn = random.random((500, vertices), np.float32) * (9 + a)
        weights[rows] = np.where(truth[rows, None] == truth, drawn - a, drawn - 9)
    for first in range(0, vertices, 500):
        weights[first : first + 500, :first] = weights[:first, first : first + 500].T
        block = np.triu(weights[first : first + 500, first : first + 500], 1)
        weights[first : first + 500, first : first + 500] = block + block.T
    return weights, truth


if __name__ == "__main__":
    main()
