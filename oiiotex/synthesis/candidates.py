# SPDX-License-Identifier: Apache-2.0
"""The analysis stage: for every stack texel K = 2 spatially dispersed candidates and their transfer functions.

HRRG08 sections 4.4, 5 and 6. Everything is decided on integers, so that every device finds the same candidates.

Departures: one basis serves all levels (a basis per level moved no measured result above the coarsest levels);
neighbours are searched as PatchMatch does instead of exactly (tests/test_candidates.py states how near they come);
a transfer function is found for levels of one exemplar, too, where HRRG08 takes the identity: self-loops lose their
contrast without it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from ..device import Buffers, Device
from ..kept import Arrays, hash_of, kept
from .stacks import blurred
from .superexemplar import Levels

DIMS = 16  # of cl/projected.h
MOST_PROJECTED = 5790
NONE = 0xFFFFFFFF  # no texel is excluded
DISC = 0.06  # radius that keeps two candidates apart, in exemplar sides (the sheet's; HRRG08 gives none)
_BITS = 12  # of the fraction of the basis
_JUMPS = (8, 4, 2, 1)
_ROUNDS = 5
_DULL = 0.75  # share of a level's texels that are not jumped to in a loop
_SAMPLES = 2000  # neighbourhoods of a level that the basis is found from
_VERSION = "oiiotex candidates 3"  # to be counted up where the same stacks lead to another analysis


@dataclass(frozen=True)
class Stacks:
    """What is analysed.

    Attributes
    ----------
    levels : Levels
    planes : (levels, side, side, 4) int16
        Colour of every texel on the integer grid (`stacks.grid_stack`).
    usable : (levels, side, side) bool
        Texels that are not transparent.
    lively : (levels, side, side) bool or None
        Texels that may be candidates of others (`lively_texels`); None: all.
    """

    levels: Levels
    planes: np.ndarray
    usable: np.ndarray
    lively: np.ndarray | None = None

    @property
    def side_bits(self) -> int:
        """log2 of the exemplars' side."""
        return self.planes.shape[1].bit_length() - 1


@dataclass(frozen=True)
class Analysis:
    """What synthesis looks up.

    Attributes
    ----------
    stacks : Stacks
    basis : (75, 16) int16
        Principal components of 5 x 5 neighbourhoods (rows, columns, channels), times 4096.
    links : (levels, side^2, 2) uint32
        The two candidates of every texel, as texels.
    records : (levels, side^2, 2, 16) int16
        Their projected neighbourhoods, transformed by their transfer functions (HRRG08 section 6).
    offsets : (levels, side^2, 2, 4) int16
        The transfer functions c + b (HRRG08 eq. 4): b, and 0.
    variance : float
        Share of the neighbourhoods' variance that the basis holds.
    """

    stacks: Stacks
    basis: np.ndarray
    links: np.ndarray
    records: np.ndarray = field(repr=False)
    offsets: np.ndarray = field(repr=False)
    variance: float = 0.0


def lively_texels(levels: Levels, planes: np.ndarray, loops: Collection[int]) -> np.ndarray:
    """Texels that hold much of what their exemplar has finer than their level; all, of exemplars in no loop.

    Where a zoom never ends, flat matches flat, and every turn of the loop makes more of it (HRRG08 leaves this open:
    with its candidates a zoom loses its contrast). So in a loop only those texels are jumped to that have more detail
    to come than `_DULL` of all: squared differences to the finest level, summed up over what a neighbourhood sees.
    """
    found = np.ones(planes.shape[:3], bool)
    for number, (exemplar, level) in enumerate(levels.stacks):
        finest = (exemplar, levels.finest)
        if exemplar in loops and level < levels.finest and finest in levels.stacks:
            away = planes[levels.stacks.index(finest)].astype(np.float64) - planes[number]
            detail = blurred(np.square(away).sum(-1, keepdims=True), 1.5 * levels.spacing(number))[..., 0]
            found[number] = detail >= np.quantile(detail, _DULL)
    return found


def neighbourhoods(plane: np.ndarray, spacing: int) -> np.ndarray:
    """The 5 x 5 neighbourhoods of a plane's texels: (side^2, 75) float64, in the order rows, columns, channels."""
    steps = range(-2, 3)
    shifted = [np.roll(plane[..., :3], (-y * spacing, -x * spacing), (0, 1)) for y in steps for x in steps]
    return np.concatenate(shifted, -1).reshape(-1, 75).astype(np.float64)


def _around(plane: np.ndarray, spacing: int, rows: np.ndarray) -> np.ndarray:
    """Those rows of `neighbourhoods`."""
    side, steps = len(plane), range(-2, 3)
    y, x = np.divmod(rows, side)
    taken = [plane[(y + v * spacing) % side, (x + u * spacing) % side, :3] for v in steps for u in steps]
    return np.concatenate(taken, -1).astype(np.float64)


def basis_of(stacks: Stacks, dims: int) -> tuple[np.ndarray, float]:
    """The first `dims` principal components, times 4096, the rest 0: (75, 16) int16; and the variance they hold."""
    random = np.random.default_rng(0)
    sampled = []
    for number, plane in enumerate(stacks.planes):
        usable = np.flatnonzero(stacks.usable[number])
        rows = usable[random.integers(0, len(usable), _SAMPLES)]
        sampled.append(_around(plane, stacks.levels.spacing(number), rows))
    variances, vectors = np.linalg.eigh(np.cov(np.concatenate(sampled).T))
    found = np.zeros((75, DIMS), np.int16)
    chosen = vectors[:, ::-1][:, :dims]
    chosen = chosen * np.where(chosen[np.abs(chosen).argmax(0), np.arange(dims)] < 0, -1.0, 1.0)  # a sign of its own
    found[:, :dims] = np.rint(chosen * (1 << _BITS))
    return found, float(variances[::-1][:dims].sum() / max(variances.sum(), 1e-12))


def texels_at_once(device: Device) -> int:
    """RUN of cl/projected.h: how many texels or pixels of a row a work item does; a power of two, at most 16."""
    return 16 if device.lanes > 1 else 1


def project(around: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Neighbourhoods (n, 75) of whole numbers -> (n, 16) int16, exactly as cl/multiscale.cl does it."""
    return _scaled(around @ basis.astype(np.float64))


def _scaled(sums: np.ndarray) -> np.ndarray:
    """Sums of products, whole numbers in floats, to projected coordinates."""
    rounded = np.floor((sums + (1 << (_BITS - 1))) / (1 << _BITS))
    return np.clip(rounded, -MOST_PROJECTED, MOST_PROJECTED).astype(np.int16)


def analyse(
    device: Device, stacks: Stacks, dims: int, correct: bool, budget: int, advance: Callable[[int, int], None],
    cache: Path | None,
) -> Analysis:  # fmt: skip
    """Candidates and transfer functions of all levels.

    Parameters
    ----------
    device : Device
    stacks : Stacks
    dims : int
        Dimensions of projected neighbourhoods, at most 16.
    correct : bool
        Find transfer functions; else all are the identity.
    budget : int
        Bytes of memory that there are.
    advance : callable
        Told (done, total).
    cache : Path or None
        A folder where it is kept from one run to the next.

    Raises
    ------
    DeviceError
        It does not fit.
    """
    facts = (getattr(stacks, of.name) for of in fields(stacks))
    name = hash_of(_VERSION, *facts, dims, correct, DISC, _ROUNDS, _JUMPS)
    steps = 2 * len(stacks.planes) + 1

    def step(number: int) -> None:
        advance(number, steps)

    found = kept(cache, name, lambda: _analysed(device, stacks, dims, correct, budget, step))
    step(steps)
    basis, links, records, offsets, variance = found
    return Analysis(stacks, basis, links, records, offsets, float(variance[0]))


def _analysed(
    device: Device, stacks: Stacks, dims: int, correct: bool, budget: int, step: Callable[[int], None]
) -> Arrays:
    """What follows from the stacks, of an `Analysis`: basis, links, records, offsets, variance."""
    basis, variance = basis_of(stacks, dims)
    count, side = stacks.planes.shape[:2]
    projections = np.empty((count, side * side, DIMS), np.int16)
    means = np.empty((count, side * side, 3))
    for number, plane in enumerate(stacks.planes):
        around = neighbourhoods(plane, stacks.levels.spacing(number))
        projections[number] = project(around, basis)
        means[number] = around.reshape(-1, 25, 3).mean(1)
        step(number + 1)
    links = _searched(device, stacks, projections, budget, step)
    offsets, records = _transfers(stacks, links, projections, means, basis, correct)
    return basis, links, records, offsets, np.array([variance])


def _transfers(
    stacks: Stacks, links: np.ndarray, projections: np.ndarray, means: np.ndarray, basis: np.ndarray, correct: bool
) -> tuple[np.ndarray, np.ndarray]:
    """(offsets, records) of an `Analysis`."""
    count, texels = links.shape[:2]
    offsets = np.zeros((count, texels, 2, 4), np.int16)
    records = np.empty((count, texels, 2, DIMS), np.int16)
    whole = basis.astype(np.int64).reshape(25, 3, DIMS).sum(0)  # the projection of one colour everywhere
    flat, flat_means = projections.reshape(-1, DIMS), means.reshape(-1, 3)
    for number in range(count):
        chosen = links[number].astype(np.int64)
        if correct:
            # HRRG08 eq. 4 with r(c) = c + b: b is the difference of the neighbourhoods' means
            away = np.rint(means[number][:, None] - flat_means[chosen]).astype(np.int64)
            away[chosen // texels == number] = 0  # an exemplar agrees with itself (section 5)
            offsets[number, ..., :3] = away
        shift = _scaled(offsets[number, ..., :3].astype(np.float64) @ whole).astype(np.int32)
        records[number] = np.clip(flat[chosen] + shift, -MOST_PROJECTED, MOST_PROJECTED)
    return offsets, records


# --- the search ---


def _searched(
    device: Device, stacks: Stacks, projections: np.ndarray, budget: int, step: Callable[[int], None]
) -> np.ndarray:
    """The candidates of every texel: (levels, side^2, 2) uint32."""
    count, texels = projections.shape[:2]
    links = np.empty((count, texels, 2), np.uint32)
    layout = {"projections": projections.nbytes, "usable": stacks.usable.size, "excluded": 4 * texels}
    layout |= dict.fromkeys(("texel", "cost", "texel_next", "cost_next"), 4 * texels)
    with Buffers(device, layout, budget, "the analysis of the exemplars", held=projections.nbytes) as buffers:
        device.write(buffers["projections"], projections)
        usable = stacks.usable if stacks.lively is None else _both(stacks.usable, stacks.lively)
        device.write(buffers["usable"], usable.view(np.uint8))
        for number in range(count):
            links[number] = _level(device, buffers, stacks, number)
            step(count + number + 1)
    return links


def _both(usable: np.ndarray, lively: np.ndarray) -> np.ndarray:
    """Where both say yes, level by level; where that is nowhere, what is usable."""
    both = usable & lively
    return np.where(both.any((1, 2), keepdims=True), both, usable)


def _level(device: Device, buffers: Buffers, stacks: Stacks, number: int) -> np.ndarray:
    """(side^2, 2) uint32: the candidates of one level's texels."""
    texels = stacks.planes[0].shape[0] ** 2
    own = number * texels + np.arange(texels, dtype=np.uint32)
    usable = stacks.usable[number].ravel()
    first = np.where(usable, own, np.uint32(NONE))
    if stacks.levels.admissible[number][0][0] != number:  # the level itself is not admissible
        first[:] = NONE
    if (first == NONE).any():
        found = search(device, buffers, stacks, number, np.full(texels, NONE, np.uint32))
        first = np.where(first == NONE, found, first)
    return np.stack([first, search(device, buffers, stacks, number, first)], -1)


def search(device: Device, buffers: Buffers, stacks: Stacks, number: int, excluded: np.ndarray) -> np.ndarray:
    """The best texel found for each of a level, outside the discs around `excluded`: (side^2,) uint32.

    Where a disc leaves nothing, it is what was excluded.
    """
    at_once, side = texels_at_once(device), stacks.side_bits
    run, shape = device.program("candidates", RUN=at_once), ((1 << side) // at_once, 1 << side)
    admissible = device.upload(np.array(stacks.levels.admissible[number], np.int32))
    device.write(buffers["excluded"], excluded)
    disc = round((DISC * (1 << side)) ** 2)
    what = (
        buffers["projections"], buffers["usable"], admissible, len(stacks.levels.admissible[number]),
        buffers["excluded"], disc,
    )  # fmt: skip
    run("start", shape, *what, buffers["texel"], buffers["cost"], number, side, np.uint32(0))
    for turn in range(_ROUNDS):
        for jump in _JUMPS:
            now, after = (buffers["texel"], buffers["cost"]), (buffers["texel_next"], buffers["cost_next"])
            run("propagate", shape, *what, *now, *after, number, side, jump)
            buffers.swap("texel", "texel_next")
            buffers.swap("cost", "cost_next")
        run("search", shape, *what, buffers["texel"], buffers["cost"], number, side, np.uint32(0), np.uint32(turn))
    found = device.read(buffers["texel"], (1 << 2 * side,), np.uint32)
    missed = device.read(buffers["cost"], (1 << 2 * side,), np.uint32) == NONE
    return np.where(missed & (excluded != NONE), excluded, found)
