# SPDX-License-Identifier: Apache-2.0
"""The analysis stage: K = 2 spatially dispersed candidates for every stack texel, and their transfer functions.

HRRG08 sections 4.4, 5 and 6. All decisions are made on integers, so every device finds the same candidates.

Departures: one basis for all levels (from level 4 of 7 it explains at most .03 less of the variance than a basis per
level). Neighbors are searched by PatchMatch instead of exactly (tests/synthesis/test_candidates.py: how close).
Transfer functions are also computed for levels of one exemplar, where HRRG08 takes the identity: self-loops lose their
contrast otherwise. Where a zoom turns, candidates are found by shape, whatever their mean color is. `Levels.literal`
turns off the last two.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path

from ...engine.deferred import np
from ...engine.errors import DeviceError
from ...engine.io.disk_cache import cached_arrays, hash_of
from ...engine.io.sealed import Arrays
from ...engine.machine import return_freed_memory
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from .superexemplar import Levels

DIMS = 16  # of cl/projected.h
MOST_PROJECTED = 5790
NONE = 0xFFFFFFFF  # no texel is excluded
DISC = 0.06  # minimum distance of two candidates in exemplar sides (not given in HRRG08)
_BITS = 12  # fractional bits of the basis
_JUMPS = (8, 4, 2, 1)
_ROUNDS = 5
_BAND = 1 << 14  # texels of a level that are projected at once
_SAMPLES = 2000  # neighborhoods of a level from which the basis is computed
_VERSION = "oiiotex candidates 4"  # increment if the same stacks lead to another analysis


@dataclass(frozen=True)
class Stacks:
    """The input of the analysis."""

    levels: Levels
    planes: np.ndarray  # (levels, side, side, 4) int16: color of every texel on the integer grid
    usable: np.ndarray  # (levels, side, side) bool: texels that may be candidates of themselves
    targets: np.ndarray  # (levels, side, side) bool: texels that may be candidates of others
    periodic: tuple[bool, ...]  # for every level, whether its exemplar is a torus; otherwise it is mirrored

    @property
    def side_bits(self) -> int:
        """log2 of the exemplars' side."""
        return self.planes.shape[1].bit_length() - 1


@dataclass(frozen=True)
class Analysis:
    """The tables for synthesis."""

    stacks: Stacks
    basis: np.ndarray  # (75, 16) int16: principal components of 5 x 5 neighborhoods, times 4096
    links: np.ndarray  # (levels, side^2, 2) uint32: the two candidates of every texel, as texels
    records: np.ndarray = field(
        repr=False
    )  # (levels, side^2, 2, 16) int16: their transformed neighborhoods (HRRG08 section 6)
    offsets: np.ndarray = field(
        repr=False
    )  # (levels, side^2, 2, 4) int16: the transfer functions c + b (HRRG08 eq. 4): b, and 0
    variance: float = 0.0  # share of the neighborhoods' variance that the basis explains


def neighborhoods(plane: np.ndarray, spacing: int, periodic: bool, lines: slice = slice(None)) -> np.ndarray:
    """The 5 x 5 neighborhoods of the texels of some lines of a plane: (texels, 75) float64.

    75 values are in the order rows, columns, channels.
    """
    side = len(plane)
    at = _places_around(side, spacing, periodic)
    first, last, _ = lines.indices(side)
    steps = [n * spacing for n in range(5)]
    rows = [plane[at[first + y : last + y], :, :3] for y in steps]  # only those: a coarse level is padded by its side
    around = np.concatenate([row[:, at[x : x + side]] for row in rows for x in steps], -1)
    return around.reshape(-1, 75).astype(np.float64)


def _around(plane: np.ndarray, spacing: int, periodic: bool, rows: np.ndarray) -> np.ndarray:
    """Some rows of `neighborhoods`."""
    at = _places_around(len(plane), spacing, periodic)
    y, x = np.divmod(rows, len(plane))
    steps = [n * spacing for n in range(5)]
    return np.concatenate([plane[at[y + v], at[x + u], :3] for v in steps for u in steps], -1).astype(np.float64)


def _places_around(side: int, spacing: int, periodic: bool) -> np.ndarray:
    """Indices of the lines of a plane, from two spacings before its border to two after the opposite one."""
    return np.pad(np.arange(side), 2 * spacing, mode="wrap" if periodic else "symmetric")


def basis_of(stacks: Stacks, dims: int) -> tuple[np.ndarray, float]:
    """The first `dims` principal components, times 4096, the rest 0: (75, 16) int16. And the variance they explain."""
    random = np.random.default_rng(0)
    sampled = []
    for number, plane in enumerate(stacks.planes):
        usable = np.flatnonzero(stacks.usable[number])
        rows = usable[random.integers(0, len(usable), _SAMPLES)]
        sampled.append(_around(plane, stacks.levels.spacing(number), stacks.periodic[number], rows))
    variances, vectors = np.linalg.eigh(np.cov(np.concatenate(sampled).T))
    basis = np.zeros((75, DIMS), np.int16)
    chosen = vectors[:, ::-1][:, :dims]
    chosen = chosen * np.where(chosen[np.abs(chosen).argmax(0), np.arange(dims)] < 0, -1.0, 1.0)  # unique signs
    basis[:, :dims] = np.rint(chosen * (1 << _BITS))
    return basis, float(variances[::-1][:dims].sum() / max(variances.sum(), 1e-12))


def texels_at_once(device: Device) -> int:
    """RUN of cl/projected.h: number of texels or pixels of a row per work item, a power of two, at most 16."""
    return 16 if device.lanes > 1 else 1


def project(around: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Neighborhoods (n, 75) of integers -> (n, 16) int16, exactly as in cl/multiscale.cl."""
    return _scaled(around @ basis.astype(np.float64))


def _scaled(sums: np.ndarray) -> np.ndarray:
    """Sums of products, integers in floats, as projected coordinates."""
    rounded = np.floor((sums + (1 << (_BITS - 1))) / (1 << _BITS))
    return np.clip(rounded, -MOST_PROJECTED, MOST_PROJECTED).astype(np.int16)


def analyze(
    device: Device, stacks: Stacks, dims: int, correct: bool, budget: int, advance: Callable[[int, int], None],
    cache: Path | None,
) -> Analysis:  # fmt: skip
    """Candidates and transfer functions of all levels, `dims` at most 16. Not `correct`: transfer functions are 0.

    `advance` is called with (done, total); `cache`: file kept between runs. Raises DeviceError for too many texels.
    """
    if 2 * stacks.usable.size > 1 << 32:  # cl/multiscale.cl identifies a candidate by twice its texel's index
        problem = f"{stacks.usable.size} texels in all levels are beyond 2^31"
        raise DeviceError(problem, hint="use fewer or smaller exemplars")
    facts = (getattr(stacks, of.name) for of in fields(stacks))
    name = hash_of(_VERSION, *facts, dims, correct, DISC, _ROUNDS, _JUMPS)
    steps = 2 * len(stacks.planes) + 1

    told = 0

    def step(number: int) -> None:
        nonlocal told
        told = number
        advance(number, steps)

    basis, links, records, offsets, variance = cached_arrays(
        cache, name, lambda: _analyzed(device, stacks, dims, correct, budget, step)
    )
    for number in range(told + 1, steps + 1):  # all of them if it was cached
        step(number)
    return Analysis(stacks, basis, links, records, offsets, float(variance[0]))


def _analyzed(
    device: Device, stacks: Stacks, dims: int, correct: bool, budget: int, step: Callable[[int], None]
) -> Arrays:
    """The arrays of an `Analysis`, from the stacks: basis, links, records, offsets, variance."""
    basis, variance = basis_of(stacks, dims)
    count, side = stacks.planes.shape[:2]
    projections = np.zeros((count, side * side, DIMS), np.int16)
    shapes = projections
    if correct and any(map(stacks.levels.turns, range(count))):
        shapes = np.empty_like(projections)
    sums = np.zeros((count, side * side, 3), np.int32)  # of the 25 colors around a texel: exact, half of a mean's bytes
    for number, plane in enumerate(stacks.planes):
        for texels in () if stacks.levels.starts(number) else _in_bands(side * side):
            lines = slice(texels.start // side, texels.stop // side)
            around = neighborhoods(plane, stacks.levels.spacing(number), stacks.periodic[number], lines)
            projections[number, texels] = project(around, basis)
            sums[number, texels] = around.reshape(-1, 25, 3).sum(1)
            if shapes is not projections:
                shapes[number, texels] = project(around - np.tile(np.rint(sums[number, texels] / 25), 25), basis)
        step(number + 1)
    links = _searched(device, stacks, projections, shapes, budget, step)
    del shapes
    return_freed_memory()  # the device's
    of = np.array([exemplar for exemplar, _ in stacks.levels.stacks])
    alike = of[:, None] == of if stacks.levels.literal else np.eye(count, dtype=bool)
    offsets, records = _transfers(links, projections, sums, basis, correct, alike)
    return basis, links, records, offsets, np.array([variance])


def _transfers(
    links: np.ndarray, projections: np.ndarray, sums: np.ndarray, basis: np.ndarray, correct: bool, alike: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(offsets, records) of an `Analysis`. `alike` (levels, levels) bool: pairs that need no transfer function."""
    count, texels = links.shape[:2]
    offsets = np.zeros((count, texels, 2, 4), np.int16)
    records = np.empty((count, texels, 2, DIMS), np.int16)
    whole = basis.astype(np.int64).reshape(25, 3, DIMS).sum(0)  # the projection of a uniform color
    flat, flat_sums = projections.reshape(-1, DIMS), sums.reshape(-1, 3)
    for number, band in itertools.product(range(count), _in_bands(texels)):
        chosen = links[number, band].astype(np.int64)
        if correct:
            # HRRG08 eq. 4 with r(c) = c + b: b is the difference of the neighborhoods' means
            away = np.rint(sums[number, band][:, None] / 25 - flat_sums[chosen] / 25).astype(np.int64)
            away[alike[number][chosen // texels]] = 0  # an exemplar agrees with itself (section 5)
            if away.any():  # zeros that are not written take no memory
                offsets[number, band, :, :3] = away
        shift = _scaled(offsets[number, band, :, :3].astype(np.float64) @ whole).astype(np.int32)
        records[number, band] = np.clip(flat[chosen] + shift, -MOST_PROJECTED, MOST_PROJECTED)
    return offsets, records


def _in_bands(texels: int) -> list[slice]:
    """A level's texels in bands of whole lines, so that their 75 values take little memory. Sides are powers of two."""
    band = min(max(_BAND, math.isqrt(texels)), texels)
    return [slice(first, first + band) for first in range(0, texels, band)]


# --- the search ---


def _searched(
    device: Device, stacks: Stacks, projections: np.ndarray, shapes: np.ndarray, budget: int,
    step: Callable[[int], None],
) -> np.ndarray:  # fmt: skip
    """The candidates of every texel: (levels, side^2, 2) uint32.

    Where a zoom turns, neighborhoods are compared by `shapes`, minus their means: the transfer function takes up the
    difference of the means, and a flat place of any color may lead to detail of any other.
    """
    count, texels = projections.shape[:2]
    links = np.empty((count, texels, 2), np.uint32)
    layout = {"projections": projections.nbytes, "usable": stacks.usable.size, "excluded": 4 * texels}
    layout |= dict.fromkeys(("texel", "cost", "texel_next", "cost_next"), 4 * texels)
    with Buffers(device, layout, budget, "the analysis of the exemplars", held=projections.nbytes) as buffers:
        device.write(buffers["usable"], stacks.targets.view(np.uint8))
        for number in range(count):
            if number == 0 or stacks.levels.turns(number) != stacks.levels.turns(number - 1):
                device.write(buffers["projections"], shapes if stacks.levels.turns(number) else projections)
            links[number] = _level(device, buffers, stacks, number)
            step(count + number + 1)
    return links


def _level(device: Device, buffers: Buffers, stacks: Stacks, number: int) -> np.ndarray:
    """(side^2, 2) uint32: the candidates of one level's texels."""
    texels = stacks.planes[0].shape[0] ** 2
    own = number * texels + np.arange(texels, dtype=np.uint32)
    if stacks.levels.starts(number):
        return np.stack([own, own], -1)
    usable = stacks.usable[number].ravel()
    first = np.where(usable, own, np.uint32(NONE))
    if stacks.levels.admissible[number][0][0] != number:  # the level itself is not admissible
        first[:] = NONE
    if (first == NONE).any():
        candidates = search(device, buffers, stacks, number, np.full(texels, NONE, np.uint32))
        first = np.where(first == NONE, candidates, first)
    return np.stack([first, search(device, buffers, stacks, number, first)], -1)


def search(device: Device, buffers: Buffers, stacks: Stacks, number: int, excluded: np.ndarray) -> np.ndarray:
    """The best texel found for each texel of a level, outside the discs around `excluded`: (side^2,) uint32.

    If a disc leaves nothing, it is the excluded one. `NONE` excludes nothing.
    """
    at_once, side = texels_at_once(device), stacks.side_bits
    run, shape = device.program("candidates", RUN=at_once), ((1 << side) // at_once, 1 << side)
    admissible = device.upload(np.array(stacks.levels.admissible[number], np.int32))
    device.write(buffers["excluded"], excluded)
    disc = round((DISC * (1 << side)) ** 2)
    searched = (
        buffers["projections"], buffers["usable"], admissible, len(stacks.levels.admissible[number]),
        buffers["excluded"], disc,
    )  # fmt: skip
    run("start", shape, *searched, buffers["texel"], buffers["cost"], number, side, np.uint32(0))
    for turn in range(_ROUNDS):
        for jump in _JUMPS:
            now, after = (buffers["texel"], buffers["cost"]), (buffers["texel_next"], buffers["cost_next"])
            run("propagate", shape, *searched, *now, *after, number, side, jump)
            buffers.swap("texel", "texel_next")
            buffers.swap("cost", "cost_next")
        run("search", shape, *searched, buffers["texel"], buffers["cost"], number, side, np.uint32(0), np.uint32(turn))
    texels = device.read(buffers["texel"], (1 << 2 * side,), np.uint32)
    missed = device.read(buffers["cost"], (1 << 2 * side,), np.uint32) == NONE
    return np.where(missed & (excluded != NONE), excluded, texels)
