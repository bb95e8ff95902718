# SPDX-License-Identifier: Apache-2.0
"""Minimum cuts of patches by libraries with wheels and a compatible license.

python -m benchmarks.quilts.cuts   (OR-tools and networkx are timed if installed)
"""

from __future__ import annotations

import importlib.util
import time

import numpy as np
from scipy.ndimage import gaussian_filter

from oiiotex.graphcut import seams

SIDES = (64, 128, 256)


def problems(side: int) -> dict[str, tuple[np.ndarray, ...]]:
    """Windows that `seams.cut` takes: a patch over what is there, and one at the corner of what is there."""
    y, x = np.mgrid[0:side, 0:side]
    there = np.stack([y + 10, x + 10])
    there[:, :, : side // 2] += 40
    patch = np.stack([y + 100, x + 150])
    covers = np.zeros((side, side), bool)
    covers[1:-1, 1:-1] = True
    corner = np.ones((side, side), bool)
    corner[side // 3 :, side // 3 :] = False
    return {"over": (there, np.ones((side, side), bool), patch, covers), "corner": (there, corner, patch, covers)}


def by_scipy(count: int, s: np.ndarray, t: np.ndarray, c: np.ndarray) -> int:
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import maximum_flow

    graph = csr_array((c.astype(np.int32), (s, t)), shape=(count + 2, count + 2))
    graph.eliminate_zeros()
    return int(maximum_flow(graph, count, count + 1).flow_value)


def by_ortools(count: int, s: np.ndarray, t: np.ndarray, c: np.ndarray) -> int:
    from ortools.graph.python import max_flow

    solver = max_flow.SimpleMaxFlow()
    solver.add_arcs_with_capacity(s.astype(np.int32), t.astype(np.int32), c)
    solver.solve(count, count + 1)
    return int(solver.optimal_flow())


def by_networkx(count: int, s: np.ndarray, t: np.ndarray, c: np.ndarray) -> int:
    import networkx

    graph = networkx.DiGraph()
    for a, b, capacity in zip(s.tolist(), t.tolist(), c.tolist(), strict=True):
        if capacity:
            graph.add_edge(a, b, capacity=capacity)
    found = networkx.algorithms.flow.boykov_kolmogorov(graph, count, count + 1)
    return int(found.graph["flow_value"])


def arcs_of(window: tuple[np.ndarray, ...], source: seams.SeamPhoto) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    """The graph that `seams.cut` makes of a window."""
    held: list[tuple[int, np.ndarray, np.ndarray, np.ndarray]] = []

    def keep(count: int, arcs: list[tuple[np.ndarray, np.ndarray, np.ndarray]], lean: np.ndarray) -> np.ndarray:
        node, dear, cheap = np.arange(count), lean > 0, lean < 0
        s = np.concatenate([*(a[0] for a in arcs), np.full(int(dear.sum()), count), node[cheap]])
        t = np.concatenate([*(a[1] for a in arcs), node[dear], np.full(int(cheap.sum()), count + 1)])
        held.append((count, s, t, np.concatenate([*(a[2] for a in arcs), lean[dear], -lean[cheap]])))
        return np.zeros(count, bool)

    real, seams.minimum_cut = seams.minimum_cut, keep
    try:
        seams.cut(source, *window)
    finally:
        seams.minimum_cut = real
    return held[0]


def main() -> None:
    """Print a table of seconds; flows must be the same."""
    ways = {"scipy": by_scipy, "ortools": by_ortools, "networkx": by_networkx}
    ways = {name: way for name, way in ways.items() if importlib.util.find_spec(name)}
    noise = np.random.default_rng(0).normal(0, 1, (512, 512, 3))
    source = seams.SeamPhoto(np.rint(gaussian_filter(noise, (2, 2, 0)) * 600).astype(np.int16))
    print(f"{'':16}" + "".join(f"{name:>10}" for name in ways))
    for side in SIDES:
        for name, window in problems(side).items():
            graph, times, flows = arcs_of(window, source), [], set()
            for library, way in ways.items():
                if library == "networkx" and side > 128:
                    times.append(float("nan"))
                    continue
                start = time.perf_counter()
                flows.add(way(*graph))
                times.append(time.perf_counter() - start)
            assert len(flows) == 1
            print(f"{side:4} {name:11}" + "".join(f"{t:10.3f}" for t in times), flush=True)


if __name__ == "__main__":
    main()
