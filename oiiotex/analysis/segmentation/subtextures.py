# SPDX-License-Identifier: Apache-2.0
"""Decomposition of an image into subtextures: CZF02, and by default a more accurate method.

By default, textons are from a filter bank, an oversegmentation is merged (`region_merging`), and before and after that
the subtextures compete for pixels by their texton distributions. The paper groups samples by clique partitioning and
compares the histogram of each pixel with those of the samples around it. `superpixel_subtextures` gives each superpixel
the subtexture that covers most of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ...engine.color.lab_reduced import LabPixels
from ...engine.core.demand import bands
from ...engine.core.elementary import logarithm
from ...engine.core.image import Part
from ...engine.core.label_map import LabelMap
from ...engine.session.resources import Resources
from ..labels.features import SmallLab
from ..labels.filter_bank import Texture, blurred_layers, texture_of
from ..labels.potts import members, winners
from ..labels.products import gram, product
from ..superpixels.superpixels import Superpixels, label_spec
from .region_merging import fine_regions, merged
from .textons import (
    FULL,
    Counts,
    Samples,
    bank_counts,
    disc_sums,
    histogram_roots,
    mean_shift_similarities,
    sample_grid,
    similarities,
    weighted_counts,
)

_CELL, _LEARNED = 4, 1 << 18  # px: cell of filter bank textons in images up to this number of pixels
_LEAST = 0.02  # of the image: smaller subtextures lose their pixels in the competition
_COUPLINGS = (2, 4, 6, 8, 8)  # of a cell to its surroundings in each round, nats; its own textons: nats per pixel
_UPDATES = 4  # of the memberships in a round
_NEAR = 1 / 4  # sigma of the surroundings, in radii
_PRIOR = 5  # pixels of each texton in the prior of a subtexture
_SMOOTH = 1.0  # sigma in cells, of the last vote
_REACH = 2.5  # radius of Gaussians, sigmas
_HAAR_RADIUS = 8.0  # px
_HAAR_SAMPLES = 1000  # CZF02 section III C: "similar to the typical texture segmentation problems"


@dataclass(frozen=True)
class DecompositionSettings:
    """Settings of a decomposition; px are those of the (reduced) image.

    Attributes
    ----------
    features : str
        "bank" or "haar".
    bins : int
        Number of textons; with "haar" for color and structure each.
    cell : int
        Side of a cell, px.
    radius, shift : float
        Radius of the disc, and of the search for the best match, px.
    scales : int
        Number of radii at which the second place is compared, half an octave apart.
    search : str
        "grid" or "meanshift".
    group : str
        "merging" of regions or "cliques" of samples.
    threshold : float
        Similarity of places, or probability of regions, above which two belong together.
    count : int or None
        Number of subtextures; None: found.
    step : int
        Spacing of samples, px.
    refine : bool
        Refine the clique partition.
    assign : str
        "competition" or "neighbors".
    invariant : bool
        Regard versions of a texture in other directions and scales as that texture; with "bank".
    """

    features: str = "bank"
    bins: int = 64
    cell: int = _CELL
    radius: float = 48.0
    shift: float = 24.0
    scales: int = 1
    search: str = "grid"
    group: str = "merging"
    threshold: float = 0.32
    count: int | None = None
    step: int = 16
    refine: bool = True
    assign: str = "competition"
    invariant: bool = False


def usual(pixels: int) -> DecompositionSettings:
    """Settings for an image of this many pixels; places are 16 px apart, more in large images, less in small ones.

    Merging was learned on images of up to `_LEARNED` pixels. Larger ones would keep more of their variation as separate
    regions, so cells and the radius grow, with the root of the side: at its rate, shutters of a house join its
    windows, and a road joins a lawn.
    """
    step = max(4, min(16, round(math.sqrt(pixels) / 16 / 4) * 4), math.ceil(math.sqrt(pixels / 2500)))
    cell = max(_CELL, round(_CELL * (pixels / _LEARNED) ** 0.25))
    return DecompositionSettings(step=step, cell=cell, radius=DecompositionSettings.radius * cell / _CELL)


def czf02(pixels: int, radius: float | None = None) -> DecompositionSettings:
    """Settings of the paper for an image of this many pixels, and discs of `radius` px."""
    disc = radius or _HAAR_RADIUS
    return DecompositionSettings(
        features="haar", bins=8, radius=disc, shift=disc, scales=3, search="meanshift", group="cliques",
        threshold=0.95, step=math.ceil(math.sqrt(pixels / _HAAR_SAMPLES)), refine=False, assign="neighbors",
    )  # fmt: skip


@dataclass(frozen=True)
class Decomposition:
    """Result of a decomposition."""

    labels: np.ndarray  # (h, w) int32: of the reduced image, from 1 by first pixel; 0 at invalid pixels
    count: int
    samples: int  # Regions, or vertices of the clique partition, before grouping
    groups: int  # Groups before the competition


def decomposed(
    pixels: LabPixels,
    settings: DecompositionSettings,
    resources: Resources,
    advance: Callable[[int, int], None] = lambda done, total: None,
    texture: Callable[[Resources], Texture] | None = None,
) -> Decomposition:
    """The subtextures of an image.

    Parameters
    ----------
    advance : callable
        Called with (done, total).
    texture : callable, optional
        Gives the texture of pixels if it is already known.
    """
    if not pixels.seen.any():
        advance(2, 4)
        advance(3, 4)
        return Decomposition(np.zeros(pixels.seen.shape, np.int32), 0, 0, 0)
    with threadpool_limits(1, "blas"):
        with resources.stats.time("textons"):
            if settings.features == "haar":
                counts = weighted_counts(pixels, resources, settings.bins)
            else:
                looks = texture(resources) if texture else texture_of(pixels.lab, pixels.seen, resources)
                looks = looks.invariant() if settings.invariant else looks
                counts = bank_counts(looks, resources, settings.bins, settings.cell)
        advance(2, 4)
        with resources.stats.time("groups"):
            group = _cliques if settings.group == "cliques" else _merged_regions
            labels, samples = group(counts, settings, resources)
            groups = len(np.unique(labels))
        advance(3, 4)
        height, width = pixels.seen.shape
        with resources.stats.time("pixels of subtextures"):
            if settings.assign == "competition":
                labels = _competed(
                    _gathered(counts, settings.cell // counts.side), labels, settings.radius, (height, width), resources
                )
            else:
                side = -(-height // labels.shape[0])
                labels = np.repeat(np.repeat(labels, side, 0), side, 1)[:height, :width]
    labels, count = _numbered(labels, pixels.seen)
    return Decomposition(labels, count, samples, groups)


def decomposed_tile(
    pixels: LabPixels, tiled: str, settings: DecompositionSettings, resources: Resources,
    advance: Callable[[int, int], None],
) -> Decomposition:  # fmt: skip
    """The subtextures of an image that tiles along these axes, and from `surroundings` beyond its borders."""
    pads = [(around, around) for around in surroundings(tiled, settings)]
    lab, seen = np.pad(pixels.lab, [*pads, (0, 0)], "wrap"), np.pad(pixels.seen, pads, "wrap")
    split = decomposed(replace(pixels, lab=lab, seen=seen), settings, resources, advance)
    inside = tuple(slice(before, before + n) for n, (before, _) in zip(pixels.seen.shape, pads, strict=True))
    labels, count = _numbered(split.labels[inside], pixels.seen)
    return replace(split, labels=labels, count=count)


def surroundings(tiled: str, settings: DecompositionSettings) -> tuple[int, int]:
    """Pixels of the reduced image to repeat beyond the borders along y, and along x: the radius, in whole cells."""
    around = math.ceil(settings.radius / settings.cell) * settings.cell
    return around * ("y" in tiled), around * ("x" in tiled)


def _merged_regions(counts: Counts, settings: DecompositionSettings, resources: Resources) -> tuple[np.ndarray, int]:
    """Labels (h, w) of cells by merging of regions after a competition, and the number of these regions."""
    cells = _gathered(counts, settings.cell // counts.side)
    values = cells.values.astype(np.float32) / (FULL * cells.side**2)
    start = fine_regions(values, resources, 2 * (settings.count or 1))
    regions = _members(values, start, cells.side, settings.radius, resources).argmax(0)
    return merged(values, regions, settings.threshold, resources, settings.count), len(np.unique(regions))


def _cliques(counts: Counts, settings: DecompositionSettings, resources: Resources) -> tuple[np.ndarray, int]:
    """Labels (h, w) of cells by clique partitioning (CZF02 sections II B and III), and the number of samples."""
    from .clique_partition import joined_to, partition  # scipy is not loaded before it is needed

    side = counts.side
    octaves = [(-1) ** s * ((s + 1) // 2) for s in range(settings.scales)]  # 0, -1, 1, -2, ...: the true scale first
    scales = tuple(settings.radius / side * 2 ** (s / 2) for s in octaves)
    roots = [histogram_roots(disc_sums(counts.values, r, resources)) for r in scales]
    valid = np.logical_or.reduce(counts.values, -1)
    samples = sample_grid(valid, max(1, round(settings.step / side)))
    if not len(samples.places):  # small islands between the samples
        samples = Samples(np.arange(valid.shape[0]), np.arange(valid.shape[1]), np.flatnonzero(valid)[:1])
    shift = settings.shift / side
    if settings.search == "meanshift" and shift > 0:
        likeness = mean_shift_similarities(counts, scales, samples, shift, resources)
    else:
        likeness = similarities(roots[0], samples, shift, tuple(roots[1:]))
    weights = likeness.astype(np.float64) - settings.threshold
    cliques = partition(weights, settings.refine)
    if settings.count is not None:
        cliques = joined_to(weights, cliques, settings.count)
    return _nearest_samples(roots[0], samples, cliques), len(samples.places)


def _nearest_samples(roots: np.ndarray, samples: Samples, cliques: np.ndarray) -> np.ndarray:
    """Clique of the sample, among the nine around a cell, with the most similar histogram: CZF02 section II B."""
    height, width = roots.shape[:2]
    down, across = len(samples.rows), len(samples.columns)
    index = np.full(down * across, -1)
    index[samples.places] = np.arange(len(samples.places))
    index = np.pad(index.reshape(down, across), 1, constant_values=-1)
    at = roots[samples.cells()].astype(np.float32)
    nearest_row = np.abs(np.arange(height)[:, None] - samples.rows).argmin(1)
    nearest_column = np.abs(np.arange(width)[:, None] - samples.columns).argmin(1)
    best, labels = np.full((height, width), -1.0, np.float32), np.zeros((height, width), np.int64)
    order = sorted(((dy, dx) for dy in (0, 1, 2) for dx in (0, 1, 2)), key=lambda d: (d[0] - 1) ** 2 + (d[1] - 1) ** 2)
    for top in range(0, height, 64):
        rows = slice(top, top + 64)
        here = roots[rows].astype(np.float32)
        for dy, dx in order:
            sample = index[nearest_row[rows, None] + dy, nearest_column + dx]
            likeness = np.where(sample >= 0, np.einsum("yxk,yxk->yx", here, at[sample]), -1.0)
            better = likeness > best[rows]
            best[rows][better] = likeness[better]
            labels[rows][better] = cliques[sample[better]]
    lonely = best < 0
    if lonely.any():  # no sample nearby: start with the first one, which the competition may replace
        labels[lonely] = cliques[0]
    return labels


# --- competition ---


def _gathered(counts: Counts, times: int) -> Counts:
    """Counts in cells `times` as wide."""
    if times <= 1:
        return counts
    values = counts.values
    for axis in (0, 1):
        values = np.add.reduceat(values, np.arange(0, values.shape[axis], times), axis=axis)
    return Counts(values, counts.side * times)


def _competed(
    counts: Counts, labels: np.ndarray, radius: float, shape: tuple[int, int], resources: Resources
) -> np.ndarray:
    """Labels (h, w) of pixels after the competition of subtextures for cells."""
    values = counts.values.astype(np.float32) / (FULL * counts.side**2)
    height, width = values.shape[:2]
    if labels.shape != (height, width):
        labels = labels[:: labels.shape[0] // height or 1, :: labels.shape[1] // width or 1][:height, :width]
    member = _members(values, labels, counts.side, radius, resources)
    return winners(blurred_layers(member, _SMOOTH, _REACH, resources), counts.side, shape, resources)


def _members(values: np.ndarray, labels: np.ndarray, side: int, radius: float, resources: Resources) -> np.ndarray:
    """Memberships (n, h, w) of cells in subtextures, by initial size; small subtextures are removed.

    In each round a subtexture has the texton distribution of its cells. The membership of a cell is the likelihood of
    its textons times the membership of its surroundings (the mean field of a Potts model with Gaussian neighborhoods).
    The weight of the surroundings increases from round to round, so that borders settle late.
    """
    height, width, bins = values.shape
    cells, valid = values.reshape(-1, bins), values.any(-1).ravel()
    layers = np.ascontiguousarray(cells.T)
    areas = np.bincount(labels.ravel(), valid)
    largest = np.argsort(-areas, kind="stable")[: int(1 / _LEAST)]
    member = ((labels.ravel() == largest[:, None]) & valid).astype(np.float32)
    sigma = max(1.0, _NEAR * radius / side)
    for coupling in _COUPLINGS:
        areas = member.sum(1, dtype=np.float64)
        member = member[areas >= min(_LEAST * areas.sum(), areas.max())]
        sums = gram(np.ascontiguousarray(member.T), cells, resources).astype(np.float64)
        chances = sums + _PRIOR / side**2
        likely = product(logarithm(chances / chances.sum(1, keepdims=True)).astype(np.float32), layers, resources)
        shape = len(member), height, width
        likely = blurred_layers((likely - likely.max(0)).reshape(shape), 1.0, _REACH, resources).reshape(
            len(member), -1
        )
        for _ in range(_UPDATES):
            around = blurred_layers(member.reshape(shape), sigma, _REACH, resources).reshape(len(member), -1)
            member = members(likely, around, valid, float(coupling), resources)
    return member.reshape(-1, height, width)


def _numbered(labels: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, int]:
    """Labels from 1 in the order of first pixels, 0 at invalid pixels; and their number."""
    numbers = np.zeros(labels.shape, np.int32)
    _, first, inverse = np.unique(labels[valid], return_index=True, return_inverse=True)
    numbers[valid] = (first.argsort().argsort() + 1)[inverse]
    return numbers, int(numbers.max())


def memory_needed(pixels: int, settings: DecompositionSettings) -> int:
    """Peak memory of a decomposition, in bytes, for a number of pixels of the reduced image."""
    kinds = 2 * settings.bins if settings.features == "haar" else 0
    per_pixel = 400 if settings.features == "bank" else 60 + 14 * kinds * (1 + settings.scales // 2)
    vertices = pixels / settings.step**2
    return math.ceil(per_pixel * pixels + 40 * vertices**2)


def label_map_of(like: Part, pixels: LabPixels, split: Decomposition) -> LabelMap:
    """The label map in the image's windows."""
    spec = label_spec(like.spec)
    spec.attribute("oiiotex:samples", split.samples)  # regions or places before grouping
    part = pixels.part("label.1", spec, split.labels.astype(np.uint32)[..., None])
    return LabelMap.of(part, 1, [()] * split.count)


def facts_of(labels: Part, split: Decomposition, settings: DecompositionSettings, factor: int) -> dict[str, Any]:
    """Facts for `facts`."""
    areas = np.zeros(split.count + 1, np.int64)
    for band in bands(labels):
        areas += np.bincount(labels.read(band).ravel(), minlength=split.count + 1)
    return {
        "labels": [{"id": i, "pixels": int(area)} for i, area in enumerate(areas[1:].tolist(), 1)],
        "reduction": factor,
        "samples": split.samples,
        "groups": split.groups,
        "settings": dict(vars(settings)),
    }


def superpixel_subtextures(
    superpixels: Superpixels, small: SmallLab, resources: Resources, count: int | None = None
) -> np.ndarray:
    """Subtexture of each superpixel, (n,) int64 from 0.

    Parameters
    ----------
    small : SmallLab
        The reduced image: the original is not read again.
    count : int, optional
        Maximum number of subtextures.
    """
    height, width = small.ids.shape
    pixels = LabPixels(small.lab, small.ids > 0, small.factor, None, width, height)
    settings = replace(usual(width * height), count=count)
    labels = decomposed(pixels, settings, resources, texture=small.texture).labels.astype(np.int64)
    table = np.zeros((superpixels.count + 1, int(labels.max()) + 1), np.int64)
    np.add.at(table, (small.ids.ravel(), labels.ravel()), 1)
    table[np.arange(superpixels.count) + 1, labels[small.places[:, 0], small.places[:, 1]]] += 1
    table[:, 0] = -1
    return np.unique(table[1:].argmax(1), return_inverse=True)[1].reshape(-1)
