# SPDX-License-Identifier: Apache-2.0
"""Features of superpixels at any level: moments, Gabor responses, a local quadtree, textons (LSA16 4.1, 4.7).

All are sums over finest superpixels, so features at any level follow from one pass over the image. Moments derive from
the power sums that `superpixels` computes at full resolution. The others use box-filtered pixels, reduced by an integer
to at most `WORKING_PIXELS`, so their cost does not grow with the image.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...engine.color.lab_grid import mean_lab
from ...engine.core.elementary import root
from ...engine.core.window import Window
from ...engine.errors import present
from ...engine.opencl.buffers import Buffers
from ...engine.session.resources import Resources
from ..superpixels.superpixels import Superpixels
from .filter_bank import FARTHEST, WAVES, Texture, gabor_responses, texton_map, texture_of

KINDS = ("both", "textons", "moments", "gabor", "quadtree")
WORKING_PIXELS = 3 << 18
_TEXTURED = 2.0 * max(WAVES)  # px of the reduced image: scale from which a superpixel shows the texture inside it
_UNIT = 100.0  # sum of a squared histogram: its distances are of the order of those of Lab
_POOLED = 0.5  # sigma, in scales of a superpixel, over which neighbors' textons are pooled
_NEAR = 2.5  # sigmas at which pooling ends
_PLACE_STEPS = 64  # steps per sigma to which places are rounded

Features = Callable[[np.ndarray], np.ndarray]
"""(n,) int: the group of each finest superpixel, 0 to m - 1 -> (m, d) float64: the groups' features."""


def features_of(kind: str, superpixels: Superpixels, small: SmallLab, resources: Resources) -> Features:
    """The feature function of a kind, for all levels of a hierarchy; both: `_by_scale`."""
    if kind == "both":
        fine, coarse = (features_of(one, superpixels, small, resources) for one in ("moments", "textons"))
        return _by_scale(fine, coarse, superpixels.sizes, _TEXTURED * small.factor)
    if kind == "moments":
        return lambda groups: moments(present(superpixels.power_sums), superpixels.sizes, groups)
    if kind == "quadtree":
        return _quadtree(small, superpixels)
    if kind == "gabor":
        return _gabor(small)
    return _texton_histograms(small, superpixels, resources)


def grouped(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Sums over groups: (n, ...) and (n,) -> (m, ...), in one fixed order."""
    m = int(groups.max()) + 1
    columns = values.reshape(len(values), -1).T
    return np.stack([np.bincount(groups, column, m) for column in columns], axis=1).reshape(m, *values.shape[1:])


def _by_scale(fine: Features, coarse: Features, sizes: np.ndarray, scale: float) -> Features:
    """`fine` for superpixels below a scale in px, else `coarse`.

    A superpixel smaller than the filters of textons takes theirs from its surroundings, which blurs thin patterns such
    as joints; its own colors do not. Larger ones differ in texture more than in color.
    """
    area = float(sizes.sum())

    def features(groups: np.ndarray) -> np.ndarray:
        return (fine if area < scale * scale * (int(groups.max()) + 1) else coarse)(groups)

    return features


def moments(power_sums: np.ndarray, sizes: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Mean, standard deviation and three higher moments per channel, (m, 15), in units of Lab.

    The kth is sign(mu_k) |mu_k|^(1/k) / k!: LSA16 section 4.1 with the root that its text omits.
    """
    raw = grouped(power_sums, groups) / grouped(sizes.astype(np.float64), groups)[:, None, None]  # (m, 3, 5)
    mean = raw[..., 0]
    raw = np.concatenate([np.ones_like(raw[..., :1]), raw], axis=-1)
    powers = [np.ones_like(mean)]
    for _ in range(5):
        powers.append(powers[-1] * -mean)
    columns = [mean]
    for k in range(2, 6):
        central = sum(math.comb(k, j) * raw[..., j] * powers[k - j] for j in range(k + 1))
        columns.append(np.sign(central) * root(np.abs(central), k) / math.factorial(k))
    return np.concatenate(columns, axis=1)


# --- the reduced image ---


@dataclass(frozen=True)
class SmallLab:
    """Means of `factor` x `factor` pixels: Lab (h, w, 3) float32, and the superpixel at their centers, 0: none."""

    lab: np.ndarray
    ids: np.ndarray
    factor: int
    places: np.ndarray  # (n, 2) rows and columns near the centers of superpixels
    count: int
    wraps: tuple[bool, bool] = (False, False)  # it tiles along y, along x
    _texture: list[Texture] = field(default_factory=list, repr=False)

    def texture(self, resources: Resources) -> Texture:
        """Texture around each pixel, the input of textons; computed once."""
        if not self._texture:
            pads = [(FARTHEST * around,) * 2 for around in self.wraps]
            lab, seen = np.pad(self.lab, [*pads, (0, 0)], "wrap"), np.pad(self.ids > 0, pads, "wrap")
            rows, columns = (slice(before, before + n) for n, (before, _) in zip(self.ids.shape, pads, strict=True))
            self._texture.append(texture_of(lab, seen, resources).within(rows, columns))
        return self._texture[0]

    def sums(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sums (n, k) of values (h, w, k) over finest superpixels, and the number of values in each (n,).

        A superpixel too thin to appear in the reduced image gets the value at its center.
        """
        ids = self.ids.ravel()
        counts = np.bincount(ids, minlength=self.count + 1)[1:]
        flat = values.reshape(ids.size, -1)
        sums = np.stack([np.bincount(ids, column, self.count + 1)[1:] for column in flat.T], axis=1)
        missed = counts == 0
        sums[missed] = values[self.places[missed, 0], self.places[missed, 1]].reshape(-1, flat.shape[1])
        return sums, np.maximum(counts, 1)


def small_lab(superpixels: Superpixels) -> SmallLab:
    """From the box-filtered pixels that the Gaussian stack starts with, so the image is not read again."""
    window, squares = superpixels.window, superpixels.reduced
    times = max(1, math.ceil(math.sqrt(squares.sums.shape[0] * squares.sums.shape[1] / WORKING_PIXELS)))
    factor = squares.side * times
    sums = squares.sums.astype(np.int64)
    for axis in (0, 1):
        sums = np.add.reduceat(sums, np.arange(0, sums.shape[axis], times), axis=axis)
    height, width = sums.shape[:2]
    lab = np.clip(mean_lab(sums), -1e4, 1e4)  # a firefly must not dominate the scale of all other pixels
    columns = np.minimum(np.arange(width) * factor + factor // 2, window.width - 1)
    ids = np.empty((height, width), np.int64)
    for row in range(height):
        y = window.top + min(row * factor + factor // 2, window.height - 1)
        ids[row] = superpixels.labels.read(Window(window.left, y, window.right, y + 1))[0, columns, 0]
    if (ids == 0).any() and (ids > 0).any():
        lab[ids == 0] = lab[ids > 0].mean(0)
    positions = superpixels.positions % (window.width, window.height)  # those of a tile may lie beyond its border
    places = np.clip((positions[:, ::-1] / factor).astype(np.int64), 0, [height - 1, width - 1])
    wraps = superpixels.periods[1] > 0, superpixels.periods[0] > 0
    return SmallLab(lab, ids, factor, places, len(superpixels.sizes), wraps)


# --- filters ---


def _gabor(small: SmallLab) -> Features:
    """Mean |response| of 12 Gabor filters per channel, (m, 36): LSA16 section 4.7."""
    responses = [r for c in range(3) for r in gabor_responses(small.lab[..., c], WAVES, 4)]
    sums, counts = small.sums(np.stack(responses, axis=-1))
    return lambda groups: grouped(sums, groups) / grouped(counts.astype(np.float64), groups)[:, None]


def _quadtree(small: SmallLab, superpixels: Superpixels) -> Features:
    """Means of Lab in 1 + 4 + 16 cells of a square around the center, (m, 63): LSA16 section 4.7.

    The square's side is twice the level's scale.
    """
    height, width = small.ids.shape
    known = np.concatenate([small.lab * (small.ids > 0)[..., None], (small.ids > 0)[..., None]], -1)
    integral = np.zeros((height + 1, width + 1, 4))
    integral[1:, 1:] = known.astype(np.float64).cumsum(0).cumsum(1)
    sizes = superpixels.sizes.astype(np.float64)

    def features(groups: np.ndarray) -> np.ndarray:
        areas = grouped(sizes, groups)
        centers = grouped(superpixels.positions * sizes[:, None], groups) / areas[:, None] / small.factor
        side = 2.0 * math.sqrt(areas.mean()) / small.factor
        means = []
        for cells in (1, 2, 4):
            edges = (np.arange(cells + 1) / cells - 0.5) * side
            x, y = (
                np.clip(np.rint(centers[:, i, None] + edges), 0, limit).astype(np.int64)
                for i, limit in ((0, width), (1, height))
            )
            for j in range(cells):
                for i in range(cells):
                    # a cell beyond the border uses the nearest pixels inside
                    left, top = np.minimum(x[:, i], width - 1), np.minimum(y[:, j], height - 1)
                    right, bottom = np.maximum(x[:, i + 1], left + 1), np.maximum(y[:, j + 1], top + 1)
                    total = (
                        integral[bottom, right] - integral[top, right] - integral[bottom, left] + integral[top, left]
                    )
                    means.append(total[:, :3] / np.maximum(total[:, 3:], 1.0))
        return np.concatenate(means, axis=1) / math.sqrt(len(means))

    return features


def _texton_histograms(small: SmallLab, superpixels: Superpixels, resources: Resources) -> Features:
    """Square roots of texton histograms, (m, TEXTONS), whose Euclidean distances are Hellinger distances.

    Textons are clusters of 18 Gabor energies (three octaves, six directions), three Laplacians of L, and color. A
    finest superpixel has too few pixels to show the texture that it belongs to, so those of its neighbors are added,
    weighted by a Gaussian of half its scale. Not in the paper; more accurate than its features on the ground truth
    (benchmarks/results/labels.md).
    """
    textons = texton_map(small.texture(resources), resources)
    count = int(textons.max()) + 1
    ids = small.ids.ravel().astype(np.int64)
    table = np.bincount(ids * count + textons.ravel(), minlength=(small.count + 1) * count)
    counts = table.reshape(small.count + 1, count)[1:]
    missed = np.flatnonzero(counts.sum(1) == 0)
    counts[missed, textons[small.places[missed, 0], small.places[missed, 1]]] = 1
    sigma = _POOLED * superpixels.sigma
    chosen, positions = _with_others(superpixels.positions, superpixels.periods, _NEAR * sigma)
    counts = pooled(counts[chosen], positions, sigma, resources)[: small.count]

    def features(groups: np.ndarray) -> np.ndarray:
        sums = grouped(counts, groups)
        return _UNIT * np.sqrt(sums / sums.sum(1, keepdims=True))

    return features


def _with_others(positions: np.ndarray, periods: tuple[int, int], reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 2), then those repeated within `reach` around a tile: (m,) which they are, and (m, 2)."""
    chosen = np.arange(len(positions))
    for axis, period in enumerate(periods):
        if period:
            at = positions[:, axis]
            before, after = np.flatnonzero(at > at.max() - 2 * reach), np.flatnonzero(at < at.min() + 2 * reach)
            turn = np.eye(2)[axis] * period
            positions = np.concatenate([positions, positions[before] - turn, positions[after] + turn])
            chosen = np.concatenate([chosen, chosen[before], chosen[after]])
    return chosen, positions


def pooled(counts: np.ndarray, positions: np.ndarray, sigma: float, resources: Resources) -> np.ndarray:
    """Counts pooled over near positions, by Gaussian weights in steps of 1/4096, 1 at the position itself.

    `counts` (n, k) int; `positions` (n, 2) float64: px; `sigma`: px; returns (n, k) int64.
    """
    unit = _PLACE_STEPS / sigma
    places = np.rint(positions * unit).astype(np.int32)
    if np.ptp(places[:, 1]) > np.ptp(places[:, 0]):
        places = places[:, ::-1]
    order = np.argsort(places[:, 0], kind="stable")
    along, reach = places[order, 0], int(_NEAR * _PLACE_STEPS)
    tables = {
        "places": np.ascontiguousarray(places[order]),
        "first": np.searchsorted(along, along - reach).astype(np.int32),
        "last": np.searchsorted(along, along + reach, "right").astype(np.int32),
        "counts": np.pad(counts[order].astype(np.int32), ((0, 0), (0, -counts.shape[1] % 4))),
    }
    n, width = tables["counts"].shape
    with Buffers(resources.device, {"pooled": 4 * n * width}, resources.budget, "features", tables=tables) as buffers:
        arguments = [buffers[name] for name in (*tables, "pooled")]
        resources.device.program("features")("pool", (n,), *arguments, n, width, reach, 0.5 / _PLACE_STEPS**2)
        made = np.empty((n, counts.shape[1]), np.int64)
        made[order] = resources.device.read(buffers["pooled"], (n, width), np.int32)[:, : counts.shape[1]]
    return made
