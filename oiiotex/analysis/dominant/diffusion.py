# SPDX-License-Identifier: Apache-2.0
"""The dominant texture: the largest group of texels reached by heat from the densest texel.

LDR09: Lu, Dorsey, Rushmeier, Dominant Texture and Diffusion Distance Manifolds, Eurographics 2009, section 5 step 6.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter
from scipy.sparse import csr_array, diags_array
from threadpoolctl import threadpool_limits

from ...engine.color.lab_reduced import LabPixels
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from .patch_manifold import (
    Kernel,
    Texels,
    densities,
    description_time,
    kernel_of,
    landmark_squares,
    landmarks,
    neighbor_squares,
    neighbor_weights,
    patch_size,
    search_time,
    squared_distances,
    texels_of,
    weights_of,
)

DOMINANT, SMALL, BRIDGE, SCATTERED = range(4)  # texel types 0, I, II, III: LDR09 section 4
SHARE = 0.4  # least proportion of all texels in a dominant group
MOST_STEPS = 200  # of the diffusion
TEXELS = 12000  # maximum: the paper's images have up to 11,000 at a step of 1
_LEAST_CORRELATION = 0.1  # of pixels with their neighbors; textures at hand have at least 0.5
_FAR = 64  # random texels to which each texel is then linked
_WIDER = (4.0, 16.0)  # kernel sizes tried before an image is rejected
_BINS, _SMOOTH, _PROMINENCE = 64, 2.0, 0.03
_DEPTH = 12.0  # decades of heat below the hottest texel that are distinguished
_LOW = 0.2  # quantile of density used where it has no valley
_BLOCK = 1024  # texels per block
_KEPT = 0.65  # expected proportion of a patch's dimensions after PCA
_CLASSIFIED = 40_000  # ns: time of a texel in kernel, densities, heat and mask
_EVEN = 0.1  # of the mean weight, added to all before a normalized cut
_FAR_BELOW = 2.5  # deviations of the texture's own heat below its median; 1.5 has .966 of IoU on composites, not .972


@dataclass(frozen=True)
class Round:
    """One pass of step 6, as plotted in LDR09 figure 4 (d)."""

    seed: int  # texel that is the source of heat
    left: int  # remaining texels
    density: float  # threshold of density
    heat: float | None  # threshold of heat, as a decimal logarithm; None: no valley
    group: int  # texels above both thresholds
    small: bool  # whether they are a small group, which is removed


@dataclass(frozen=True)
class Dominance:
    """Result for N texels."""

    texels: Texels
    types: np.ndarray  # (N,) int8: 0 to 3
    density: np.ndarray  # (N,) float64: eq. 4
    heat: np.ndarray  # (N,) float64: decimal logarithm of eq. 3 in the last pass
    kernel: Kernel | None = None  # None: all texels are equal
    steps: int = 0  # tau
    rounds: list[Round] = field(default_factory=list)
    rejected: str = ""  # reason why there is no dominant texture; empty if there is one

    @property
    def share(self) -> float:
        """Proportion of dominant texels."""
        return float((self.types == DOMINANT).mean()) if len(self.types) else 0.0


def dominant_texture(
    pixels: LabPixels,
    resources: Resources,
    progress: Progress,
    *,
    patch: int | None = None,
    step: int | None = None,
    mode: str = "diffusion",
    rule: str = "repaired",
) -> Dominance:
    """LDR09 section 5 without the mask.

    `patch` is the odd side of a patch, px; `step` is their spacing, px, without which there are at most `TEXELS`.
    `mode` is how patches are compared: diffusion, or for comparison euclidean (colors, eq. 7) or spectral (the larger
    half of a normalized cut). `rule` is repaired, or paper: thresholds as published, without an estimate of noise.
    """
    with threadpool_limits(1, "blas"), resources.in_background(lambda: neighbor_correlation(pixels)) as correlated:
        side = patch or patch_size(pixels.lab[..., 0], resources.spread)
        apart = step or step_for(pixels.seen.shape, side)
        describing, searching, classifying = progress.stages(*times_of(pixels.seen.shape, side, apart))
        texels = texels_of(pixels, side, apart, resources)
        nothing = np.full(texels.count, SCATTERED, np.int8), np.zeros(texels.count), np.zeros(texels.count)
        describing.advance(1, 1)
        if not texels.count:
            return Dominance(texels, *nothing, rejected="no patch is opaque")
        dimensions = texels.values.shape[1]
        searching.lengthen(search_time(texels.count, dimensions) / times_of(pixels.seen.shape, side, apart)[1] - 1)
        with resources.stats.time("kernel and densities"):
            chosen = landmarks(texels)
            kernel = kernel_of(texels, chosen)
            if kernel is None:
                alike = np.full(texels.count, DOMINANT, np.int8), np.full(texels.count, float(len(chosen)))
                return Dominance(texels, *alike, np.zeros(texels.count))
            correlation = correlated()
            if correlation < _LEAST_CORRELATION and rule != "paper":
                why = f"neighboring pixels are not correlated ({correlation:.2f}), as in noise"
                return Dominance(texels, *nothing, kernel, rejected=why)
            euclidean = mode == "euclidean"
            density = densities(texels, chosen, kernel.size, euclidean, resources)
        with resources.stats.time("neighbors"):
            squares = neighbor_squares(texels, resources, searching)
        with resources.stats.time("heat"):
            weights = neighbor_weights(squares, kernel.size, euclidean)
            if mode == "spectral":
                types = _larger_half(texels, chosen, kernel, resources)
                dominant = Dominance(texels, types, density, np.zeros(texels.count), kernel)
            else:
                dominant = _classified(texels, kernel, density, weights, rule)
            if dominant.rejected and mode == "diffusion" and rule != "paper":
                # A regular pattern splits into one group per phase, which no near neighbors connect: retry with wider
                # kernels, and link each texel to a few random ones.
                far = landmark_squares(texels, chosen[:: max(1, len(chosen) // _FAR)], resources)
                for times in _WIDER:
                    if dominant.rejected:
                        wide = replace(kernel, size=times * kernel.size)
                        density = densities(texels, chosen, wide.size, euclidean, resources)
                        joined = neighbor_weights(squares, wide.size, False)
                        joined = joined.maximum(neighbor_weights(far, wide.size, False)).tocsr()
                        again = _classified(texels, wide, density, joined, rule)
                        dominant = dominant if again.rejected else again
        classifying.advance(1, 1)
    return dominant


def times_of(shape: tuple[int, int], patch: int, step: int) -> tuple[float, float, float]:
    """Expected times of describing texels, comparing them, and the rest, in nanoseconds of a usual processor."""
    rows, columns = (max(1, s - patch + 1) for s in shape)
    count = -(-rows // step) * -(-columns // step)
    dimensions = _KEPT * 3 * patch**2
    return description_time(count, patch), search_time(count, dimensions), _CLASSIFIED * count


def neighbor_correlation(pixels: LabPixels) -> float:
    """Correlation of Lab with that of the next pixel to the right or below, the larger of the two; 0 without pixels.

    The paper does not say how to tell noise from a texture. Diffusion cannot: in noise, each patch is equally near to
    all others.
    """
    if not pixels.seen.any():
        return 0.0
    away = (pixels.lab - pixels.lab[pixels.seen].mean(0, dtype=np.float64)) * pixels.seen[..., None]
    correlations = []
    for here, there, pairs in (
        (away[:, :-1], away[:, 1:], pixels.seen[:, :-1] & pixels.seen[:, 1:]),
        (away[:-1], away[1:], pixels.seen[:-1] & pixels.seen[1:]),
    ):
        a, b = here[pairs], there[pairs]
        correlations.append((a * b).sum() / max(float(np.sqrt((a * a).sum() * (b * b).sum())), 1e-9))
    return float(max(correlations))


def step_for(shape: tuple[int, int], patch: int) -> int:
    """The smallest spacing that gives at most `TEXELS`."""
    rows, columns = (max(1, s - patch + 1) for s in shape)
    step = 1
    while -(-rows // step) * -(-columns // step) > TEXELS:
        step += 1
    return step


def heat_steps(count: int, dimension: float) -> int:
    """tau = d N^(1/d): LDR09 section 3; clipped to `MOST_STEPS`, which a small d would exceed by far."""
    return int(np.clip(round(dimension * count ** (1 / dimension)), 1, MOST_STEPS))


def heat_from(matrix: csr_array, seed: int, steps: int) -> np.ndarray:
    """LDR09 eq. 3: A^tau chi, (N,) float64."""
    heat = np.zeros(matrix.shape[0])
    heat[seed] = 1.0
    for _ in range(steps):
        heat = matrix @ heat
    return heat


def _classified(texels: Texels, kernel: Kernel, density: np.ndarray, weights: csr_array, rule: str) -> Dominance:
    """Step 6: remove groups until one is dominant."""
    count = texels.count
    matrix = (diags_array(1 / weights.sum(1)) @ weights.astype(np.float64)).tocsr()  # Table 1: A is row-normalized
    steps = heat_steps(count, kernel.dimension)
    types, left = np.full(count, SCATTERED, np.int8), np.ones(count, bool)
    rounds: list[Round] = []
    heat = np.zeros(count)
    decide = _literal if rule == "paper" else _repaired
    while left.sum() >= SHARE * count:
        seed = int(np.flatnonzero(left)[density[left].argmax()])
        heat = np.log10(np.maximum(heat_from(matrix, seed, steps), 1e-300))
        dense_above, hot_above, small = decide(density[left], heat[left], count)
        hot = left & (heat > hot_above) if hot_above is not None else left.copy()
        group = hot & (density > dense_above)
        rounds.append(Round(seed, int(left.sum()), dense_above, hot_above, int(group.sum()), small))
        types[hot & ~group] = BRIDGE
        if not small:
            types[group] = DOMINANT
            return Dominance(texels, types, density, heat, kernel, steps, rounds)
        types[group] = SMALL
        hot[seed] = True  # ensures that the loop ends
        left &= ~hot
    why = f"no group of patches contains {100 * SHARE:.0f} % of the image"
    return Dominance(texels, types, density, heat, kernel, steps, rounds, why)


def _literal(density: np.ndarray, heat: np.ndarray, count: int) -> tuple[float, float | None, bool]:
    """Thresholds of density and heat, and whether the group is small: LDR09 step 6 as published.

    "The first valley beyond the 0.4-quantile point" is counted from the coldest, as densities are ordered. It must
    leave 40 % of the image; without such a valley all remaining texels are Type 0, also those of low density. Two other
    readings are compared in benchmarks/dominant/readings.py.
    """
    shown = _shown(heat)
    counts, edges = _histogram(shown)
    point = np.quantile(shown, SHARE)
    above = [float(edges[v + 1]) for v in _valleys(counts, 0.0)[0] if edges[v + 1] >= point]
    if not above or (shown > above[0]).sum() < SHARE * count:
        return -np.inf, None, False
    dense = _dense_above(density)
    return dense, above[0], bool(((density > dense) & (heat > above[0])).sum() <= SHARE * count)


def _dense_above(density: np.ndarray) -> float:
    """The valley between the first two peaks of density; its 0.2 quantile without one: LDR09 step 6."""
    counts, edges = _histogram(density)
    valleys, _ = _valleys(counts, 0.0)
    return float(edges[valleys[0] + 1]) if len(valleys) else float(np.quantile(density, _LOW))


def _repaired(density: np.ndarray, heat: np.ndarray, count: int) -> tuple[float, float | None, bool]:
    """As `_literal`, with detection of small groups and a limit on the last threshold.

    The paper's group contains at least 40 %, so if the densest texel is in a small group, such as a pipe on a wall,
    the pipe is kept with a part of the wall. Here the seed's group is small if the deepest valley of heat leaves
    less than 40 % above it, or if fewer texels than that are warm at all. Otherwise the first valley that keeps 40
    % is the threshold, but not below `_core_above`: texels that overlap an outlier cool down without a valley. Density
    is thresholded by decades, where outliers are rare, and among hot texels only; its valley must also leave 40 %.
    """
    shown = _shown(heat)
    counts, edges = _histogram(shown)
    valleys, depths = _valleys(counts, _PROMINENCE)
    kept = np.array([(shown > edges[v + 1]).sum() for v in valleys])
    hot = _core_above(shown)
    if len(valleys):
        deepest = int(np.argmax(depths))
        if kept[deepest] < SHARE * count:
            return -np.inf, float(edges[valleys[deepest] + 1]), True
        hot = max(hot, float(edges[valleys[np.flatnonzero(kept >= SHARE * count)[-1]] + 1]))
    coldest = float(shown.max() - _DEPTH)
    if (shown > coldest).sum() < SHARE * count:
        return -np.inf, coldest, True
    decades = np.log10(np.maximum(density[shown > hot], 1e-9))
    if not len(decades):  # all are equally warm
        return -np.inf, None, len(heat) < SHARE * count
    counts, edges = _histogram(decades)
    valleys, _ = _valleys(counts, _PROMINENCE)
    dense = float(edges[valleys[0] + 1]) if len(valleys) else -np.inf
    if (decades > dense).sum() < SHARE * count:
        dense = -np.inf
    return 10.0**dense, hot, False


def _core_above(shown: np.ndarray) -> float:
    """Heat below which texels are colder than the texture's own variation: that above the median, mirrored."""
    middle = float(np.median(shown))
    deviation = 1.4826 * (float(np.median(shown[shown >= middle])) - middle)
    return middle - _FAR_BELOW * deviation


def _shown(heat: np.ndarray) -> np.ndarray:
    return np.maximum(heat, heat.max() - _DEPTH)


def _histogram(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A smoothed histogram and its bin edges."""
    counts, edges = np.histogram(values, _BINS)
    return gaussian_filter1d(counts.astype(np.float64), _SMOOTH), edges


def _valleys(counts: np.ndarray, prominence: float) -> tuple[np.ndarray, np.ndarray]:
    """Minima between two peaks, in order, and their depths; the center of a flat minimum.

    Defined as peaks and prominences in scipy.signal.find_peaks, whose import takes half a second.
    """
    least, n = max(prominence * counts.max(), 1e-9), len(counts)
    begins = np.flatnonzero(np.diff(counts, prepend=-np.inf) != 0)  # of runs of equal values
    ends, values = np.append(begins[1:], n), counts[begins]
    valleys, depths = [], []
    for k in range(1, len(begins) - 1):
        if not values[k - 1] > values[k] < values[k + 1]:
            continue
        lower = np.flatnonzero(values < values[k])
        left, right = lower[lower < k], lower[lower > k]  # peaks count up to the next deeper minimum on each side
        left_peak = values[left[-1] + 1 if len(left) else 0 : k].max()
        right_peak = values[k + 1 : right[0] if len(right) else None].max()
        depth = min(left_peak, right_peak) - values[k]
        if depth >= least:
            valleys.append((begins[k] + ends[k] - 1) // 2)
            depths.append(depth)
    return np.array(valleys, np.int64), np.array(depths)


def _larger_half(texels: Texels, chosen: np.ndarray, kernel: Kernel, resources: Resources) -> np.ndarray:
    """The larger of two segments of a normalized cut as Type 0, the other as Type I (LDR09 section 7.4).

    The cut is computed on all pairs of landmarks; other texels get the weighted mean of the landmarks' eigenvector. A
    tenth of the mean weight is added to all weights, otherwise a single patch would be the smaller segment.
    """
    squares = squared_distances(texels.values[chosen], texels.values[chosen])
    weights = weights_of(squares, kernel.landmark_size, False).astype(np.float64)
    weights += _EVEN * weights.mean()
    total = weights.sum(1)
    vector = np.linalg.eigh(weights / np.sqrt(np.outer(total, total)))[1][:, -2] / np.sqrt(total)
    order = np.argsort(vector, kind="stable")
    weights, mass = weights[np.ix_(order, order)], total[order].cumsum()[:-1]
    inside = np.diag(weights.cumsum(0).cumsum(1))[:-1]  # total weight among the first n
    cut = (mass - inside) / mass + (mass - inside) / (total.sum() - mass)
    best = int(cut.argmin())
    split = (vector[order[best]] + vector[order[best + 1]]) / 2
    marks = texels.values[chosen]

    def above(first: int) -> np.ndarray:
        near = weights_of(squared_distances(texels.values[first : first + _BLOCK], marks), kernel.landmark_size, False)
        near = near + np.float32(1e-12)
        return (near @ vector) / near.sum(1, dtype=np.float64) > split

    halves = np.concatenate(list(resources.spread(above, range(0, texels.count, _BLOCK))))
    return np.where(halves == (2 * halves.sum() > len(halves)), DOMINANT, SMALL).astype(np.int8)


# --- values per pixel ---


def spread_over(texels: Texels, values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Values (N,) of texels at their centers, else at the nearest pixels: (h, w); 0 beyond all patches."""
    height, width = shape
    half, step = texels.patch // 2, texels.step
    down, across = (max(0, -(-(s - texels.patch + 1) // step)) for s in shape)
    grid = np.zeros((down, across), values.dtype)
    grid[(texels.rows - half) // step, (texels.columns - half) // step] = values
    pixels = np.zeros(shape, values.dtype)
    if not grid.size:
        return pixels
    inner = height - texels.patch + 1, width - texels.patch + 1
    y, x = (np.minimum((np.arange(n) + step // 2) // step, g - 1) for n, g in zip(inner, grid.shape, strict=True))
    pixels[half : half + inner[0], half : half + inner[1]] = grid[np.ix_(y, x)]
    return pixels


def dominant_mask(dominant: Dominance, valid: np.ndarray) -> np.ndarray:
    """LDR09 step 7: centers of dominant texels dilated by a patch, (h, w) bool; false where `seen` is false."""
    centers = spread_over(dominant.texels, (dominant.types == DOMINANT).astype(np.uint8), valid.shape)
    return (maximum_filter(centers, dominant.texels.patch, mode="constant") > 0) & valid
