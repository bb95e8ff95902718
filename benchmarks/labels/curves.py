# SPDX-License-Identifier: Apache-2.0
"""Labels against ground truth over the number of labels (LSA16 figures 3c and 3d), for features and for clusters.

python -m benchmarks.labels.curves [--name PART] [--superpixels 400,100] [--plots DIR]
                                  [--features textons,moments,gabor,quadtree] [--cluster nmf,kmeans,spectral]

Figure 3c: every kind of features, labels by nmf. Figure 3d: the first of the features, every kind of clusters; k-means
and spectral clustering get the number of labels that nmf finds, as in the paper. Labels are those of one scale (C~, the
paper's section 4.2): the hierarchy's level with about that number of superpixels. The number of labels depends on the
persistence of the walk, which is swept. Rand index; covering of true regions by labels (`cover`) and of labels by true
regions (`back`). Means include only images for which every curve of the figure reaches the number of labels.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse
from sklearn.cluster import KMeans, SpectralClustering

from benchmarks.labels.levels import Case, cases, score
from oiiotex.analysis.labels.affinity_graph import NEIGHBORS, similarity_graph
from oiiotex.analysis.labels.features import Features, features_of, small_lab
from oiiotex.analysis.labels.scales import LabelSettings, labeled
from oiiotex.analysis.superpixels.hierarchy import Hierarchy, hierarchy
from oiiotex.analysis.superpixels.superpixels import superpixels
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.session import Session
from oiiotex.engine.session.resources import Resources

PERSISTENCES = (0.99, 0.97, 0.95, 0.9, 0.85, 0.75, 0.6, 0.45, 0.3, 0.15, 0.05)
COUNTS = (2, 3, 4, 5, 6, 8, 10, 12, 16)
METRICS = ("Rand", "cover", "back")


class Series(NamedTuple):
    """One curve of a figure, for all images."""

    superpixels: int
    features: str
    cluster: str


class Curve(NamedTuple):
    """Results for one image: metrics (n, 3) over increasing numbers of labels (n,)."""

    counts: np.ndarray
    metrics: np.ndarray

    def at(self, counts: Iterable[float]) -> np.ndarray:
        """Metrics (m, 3) at numbers of labels, interpolated; NaN where the curve does not reach."""
        wanted = np.array(list(counts), float)
        found = np.stack([np.interp(wanted, self.counts, m) for m in self.metrics.T], -1)
        found[(wanted < self.counts[0]) | (wanted > self.counts[-1])] = np.nan
        return found


def curve(
    case: Case, ids: np.ndarray, groups: np.ndarray, described: Features, cluster: str, session: Session
) -> Curve:
    """Labels of one partition over the persistence; where several give as many labels, their mean."""
    points = described(groups)
    # spectral clustering warns of disconnected graphs, which are expected here
    warnings.filterwarnings("ignore", "Graph is not fully connected")
    found: dict[int, list[tuple[float, float, float]]] = {}
    for persistence in PERSISTENCES:
        labels = labeled(points, LabelSettings(persistence=persistence), 0, session.resources).G.argmax(0)
        if cluster != "nmf":
            labels = clustered(points, cluster, int(labels.max()) + 1, session.resources)
        s = score(case.truth, labels[groups][ids], groups[ids])
        found.setdefault(int(labels.max()) + 1, []).append((s.rand, s.covering, s.back))
    counts = np.array(sorted(found))
    return Curve(counts, np.array([np.mean(found[n], 0) for n in counts]))


def clustered(points: np.ndarray, cluster: str, count: int, resources: Resources) -> np.ndarray:
    """Labels of m points, from 0, by another method with as many clusters (LSA16 figure 3d)."""
    if cluster == "kmeans":
        return KMeans(count, n_init=10, random_state=0).fit(points).labels_
    graph = similarity_graph(points, min(NEIGHBORS, max(8, len(points) // 13)), resources)  # as of `labeled`
    if len(graph.counts) <= count:  # no more distinct points than clusters
        return graph.node
    scaled, root = graph.scaled, np.sqrt(graph.mass)
    weights = scaled.weights * np.repeat(root, np.diff(scaled.starts)) * root[scaled.columns]
    similarities = scipy.sparse.csr_array((weights, scaled.columns, scaled.starts))
    model = SpectralClustering(count, affinity="precomputed", random_state=0, assign_labels="kmeans")
    return np.unique(model.fit(similarities).labels_, return_inverse=True)[1][graph.node]


def partition_near(levels: Hierarchy, count: int) -> np.ndarray:
    """The partition with that number of superpixels, or the nearest."""
    return levels.partition_of(int(np.clip(count, levels.counts[-1], levels.counts[0])))


def measured(case: Case, wanted: Iterable[Series], session: Session) -> Iterator[tuple[Series, Curve]]:
    """Every series on one image."""
    found = superpixels(case.image, lens_of(case.image, session.resources), session.resources)
    levels = hierarchy(found, session.resources)
    ids = found.labels.read(found.window)[..., 0].astype(np.int64) - 1
    described: dict[str, Features] = {}
    for series in wanted:
        if series.features not in described:
            described[series.features] = features_of(series.features, found, small_lab(found), session.resources)
        groups = partition_near(levels, series.superpixels)
        yield series, curve(case, ids, groups, described[series.features], series.cluster, session)


# --- tables ---


def print_means(title: str, curves: dict[Series, dict[str, Curve]], names: list[str]) -> None:
    """A figure's curves, mean over images."""
    table = np.array([[curves[s][name].at(COUNTS) for name in names] for s in curves])  # series, images, counts, 3
    reached = ~np.isnan(table).any((0, 3))  # images, counts
    print(f"\n{title}; mean of {len(names)} images, where all reach it")
    print(f"{'labels':37s}" + "".join(f"{n:>7d}" for n in COUNTS))
    print(f"{'images':37s}" + "".join(f"{n:>7d}" for n in reached.sum(0)))
    for m, metric in enumerate(METRICS):
        for series, values in zip(curves, table, strict=True):
            cells = [values[reached[:, n], n, m].mean() if reached[:, n].any() else np.nan for n in range(len(COUNTS))]
            name = f"{metric:6s} {series.superpixels:4d} sp  {series.features:8s} {series.cluster}"
            print(f"{name:37s}" + "".join(f"{c:7.3f}" for c in cells))


def print_at_truth(title: str, curves: dict[Series, dict[str, Curve]], truths: dict[str, int]) -> None:
    """Every image at its true number of labels; where a curve does not reach that, at its nearest end (*)."""
    print(f"\n{title}; at the true number of labels: Rand/cover/back, * at the nearest there is")
    heads = [f"{s.features} {s.cluster} {s.superpixels}" for s in curves]
    print(f"{'':27s}" + "".join(f"{h:>24s}" for h in heads))
    sums = []
    for name, count in truths.items():
        row = f"{name:24s}{count:3d}"
        sums.append([])
        for by_image in curves.values():
            found = by_image[name]
            nearest = float(np.clip(count, found.counts[0], found.counts[-1]))
            values = found.at([nearest])[0]
            sums[-1].append(values)
            star = " " if nearest == count else "*"
            row += f"{star:>7s}" + "/".join(f"{v:5.3f}" for v in values)
        print(row)
    for group, chosen in groups_of(truths).items():
        means = np.mean([sums[n] for n in chosen], 0)
        print(f"{group:27s}" + "".join(f"{'':7s}" + "/".join(f"{v:5.3f}" for v in m) for m in means))


def groups_of(names: Iterable[str]) -> dict[str, list[int]]:
    """Which images the means are of."""
    listed = list(names)
    kinds = {
        "mean of ground truth": [n for n, name in enumerate(listed) if not name.startswith("synthetic")],
        "mean of mosaics": [n for n, name in enumerate(listed) if name.startswith("mosaic")],
        "mean of synthetic": [n for n, name in enumerate(listed) if name.startswith("synthetic")],
    }
    return {group: chosen for group, chosen in kinds.items() if chosen}


# --- plots ---


def plot(path: Path, curves: dict[Series, dict[str, Curve]], names: list[str]) -> None:
    """Covering over the number of labels: a panel for each image, a line for each series.

    Requires matplotlib (the extra `benchmark`).
    """
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    across = min(6, len(names))
    down = -(-len(names) // across)
    size = (2.1 * across, 1.7 * down + 0.5)
    figure, axes = pyplot.subplots(down, across, figsize=size, sharex=True, sharey=True, squeeze=False)
    for axis in axes.ravel()[len(names) :]:
        axis.set_axis_off()
    for axis, name in zip(axes.ravel(), names, strict=False):
        for n, (series, by_image) in enumerate(curves.items()):
            found = by_image[name]
            style = "-" if series.superpixels == next(iter(curves)).superpixels else "--"
            label = f"{series.features} {series.cluster}, {series.superpixels}"
            cover = found.metrics[:, METRICS.index("cover")]
            axis.plot(found.counts, cover, style, color=f"C{n}", lw=1, marker=".", ms=3, label=label)
        axis.set_title(name.removeprefix("mosaic_"), fontsize=7)
        axis.tick_params(labelsize=6)
        axis.set_xlim(1, 24)
        axis.set_ylim(0, 1)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncol=min(4, len(labels)), fontsize=7, frameon=False)
    figure.suptitle("Covering over the number of labels", fontsize=8)
    figure.tight_layout(rect=(0, 0.07, 1, 1))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80, pil_kwargs={"optimize": True})
    pyplot.close(figure)
    print(path, path.stat().st_size // 1024, "KB")


def main() -> None:
    """Measure, print tables, draw plots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--features", default="textons,moments,gabor,quadtree")
    parser.add_argument("--cluster", default="nmf,kmeans,spectral")
    parser.add_argument("--superpixels", default="100", help="superpixels of the level to label; comma-separated list")
    parser.add_argument("--name", default="", help="images whose names contain one of these; comma-separated list")
    parser.add_argument("--plots", type=Path)
    given = parser.parse_args()
    kinds, clusters = given.features.split(","), given.cluster.split(",")
    levels = [int(n) for n in given.superpixels.split(",")]
    figures = {
        "Figure 3c": [Series(n, kind, "nmf") for n in levels for kind in kinds],
        "Figure 3d": [Series(n, kinds[0], cluster) for n in levels for cluster in clusters],
    }
    wanted = dict.fromkeys(series for all_of in figures.values() for series in all_of)
    curves: dict[Series, dict[str, Curve]] = {series: {} for series in wanted}
    truths, session = {}, Session()
    for case in cases():
        if not any(part in case.name for part in given.name.split(",")):
            continue
        begin = time.perf_counter()
        truths[case.name] = len(np.unique(case.truth[case.truth > 0]))
        for series, found in measured(case, wanted, session):
            curves[series][case.name] = found
        print(f"{case.name:26s} {time.perf_counter() - begin:6.1f} s", flush=True)
    names = list(truths)
    for title, all_of in figures.items():
        chosen = {series: curves[series] for series in all_of}
        print_means(title, chosen, names)
        print_at_truth(title, chosen, truths)
        if given.plots:
            plot(given.plots / f"{title.replace(' ', '_').lower()}.png", chosen, names)


if __name__ == "__main__":
    main()
