# SPDX-License-Identifier: Apache-2.0
"""Image quilting (Efros & Freeman 2001) on a stream, its candidates chosen by their content (LSA16 section 6.1).

A regular grid of square patches that overlap is filled from the top left to the bottom right. What is kept is a plan:
for every cell the patch's offset in the exemplar and two cuts. The source of any output pixel follows from the plan
alone, so the overlaps of a cell are looked up through it, no pixels are kept, and any window can be made at any time.

Cells (i, j) with the same j + 2 i do not see each other: they are decided together, wave by wave. The order is a fact
of the grid, so no band, budget or thread shows in it.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..analysis.regions import ContentTable
from ..device import Buffers, Device
from ..windows import Window
from .plans import NONE, Grid, Plan, Renderer, plan_bytes

GRID = 21  # `patchmatch.to_grid`'s patch for the exemplar: four steps per Lab unit
GUIDE = 4  # samples of the guide along a side of a cell, cl/quilting.cl
LABEL_STEP, _BINS, _COARSE = 4, 256, 4  # cl/quilting.cl
_WORST = 3 * (300 * 4) ** 2  # largest squared difference of two pixels in grid steps
_FLUSH = 64  # waves between two looks at the queue


@dataclass(frozen=True)
class Rules:
    """How patches are chosen.

    Attributes
    ----------
    seed : int
    candidates : int
        Patches that are tried in a cell, at most.
    reach : int
        px by which the best of them may move to fit better: halved until nothing is left.
    reuse : float
        No region may be used more often than this times its fair share.
    finer : float
        Weight of the distance of finer levels' histograms, in units of the exemplar's variance.
    guidance : float
        Weight of pixels whose label is not the guide's, in the same unit.
    """

    seed: int = 0
    candidates: int = 256
    reach: int = 4
    reuse: float = 2.0
    finer: float = 0.5
    guidance: float = 1.0


@dataclass(frozen=True)
class Exemplar:
    """What patches are taken from.

    Attributes
    ----------
    lab : (h, w, 3) int16
        On the grid of `patchmatch.to_grid(lab, GRID)`.
    table : ContentTable
        Of windows of the patch's size.
    finer : tuple of (h, w) uint8
        Label maps of finer levels, `folded`, which tell candidates apart (LSA16 section 6.1).
    labels : (h, w) or None
        The label map that a guide speaks of.
    """

    lab: np.ndarray
    table: ContentTable
    finer: tuple[np.ndarray, ...] = ()
    labels: np.ndarray | None = None


@dataclass
class Demand:
    """What cells ask for.

    Attributes
    ----------
    keys : (rows, columns) int32
        The number of each cell's key in the content table.
    guide : (rows, columns, GUIDE, GUIDE) uint16 or None
        Labels that a cell wants at the middles of its pieces; 0: any.
    """

    keys: np.ndarray
    guide: np.ndarray | None = None


def caps(table: ContentTable, keys: np.ndarray, reuse: float) -> np.ndarray:
    """How often a region may be used for each key: `reuse` times its share if all regions with the key were used alike.

    With reuse >= 1 there is always a free one.
    """
    cells = np.bincount(keys.ravel(), minlength=len(table.keys))
    share = cells / np.diff(table.ranges)
    return np.minimum(np.ceil(np.maximum(share * reuse, share)), 2**31 - 1).astype(np.int32)


def folded(ids: np.ndarray) -> np.ndarray:
    """Labels as the bins in which they are counted, uint8: of more than 255 some share one; 0 stays apart."""
    return np.where(ids > 0, (ids - 1) % (_BINS - 1) + 1, 0).astype(np.uint8)


def reduced(lab: np.ndarray) -> np.ndarray:
    """(h, w, 3) int16 -> means of its whole squares of _COARSE pixels, halves up."""
    h, w = (n // _COARSE for n in lab.shape[:2])
    squares = lab[: h * _COARSE, : w * _COARSE].reshape(h, _COARSE, w, _COARSE, 3)
    return ((squares.sum((1, 3), np.int32) + _COARSE**2 // 2) >> 4).astype(np.int16)


def cell_memory(grid: Grid, guided: bool) -> int:
    """Bytes of what grows with the number of patches: to be asked before anything is worked out for them."""
    cells = math.prod(grid.shape)
    return cells * (4 + 4 + 2 * GUIDE**2 * guided) + sum(plan_bytes(grid, 0).values())


def layout(exemplar: Exemplar, grid: Grid, rules: Rules, guided: bool, pixels: int) -> dict[str, int]:
    """Device memory of a `Quilt`, in bytes by name; `pixels`: of the largest window that is made at once."""
    cells, wave = math.prod(grid.shape), min(grid.shape[0], (grid.shape[1] + 1) // 2)
    area, patch = exemplar.lab.shape[0] * exemplar.lab.shape[1], grid.patch
    table = exemplar.table
    labels = math.prod(-(-n // LABEL_STEP) for n in exemplar.lab.shape[:2])
    return {
        "exemplar": 6 * area,
        "offsets": table.offsets.nbytes,
        "key_map": table.key_map.nbytes,
        "starts": 4 * len(table.starts),
        "ranges": 4 * len(table.ranges),
        "range_blocks": table.range_blocks.nbytes,
        "range_starts": 4 * len(table.range_starts),
        "uses": 4 * len(table.range_blocks),
        "cap": 4 * len(table.keys),
        "finer": len(exemplar.finer) * labels,
        "labels": 2 * labels if guided else 2,
        "guide": 2 * GUIDE**2 * (cells if guided else 1),
        "order": 4 * cells,
        "keys": 4 * cells,
        **plan_bytes(grid, pixels),
        "target": 6 * wave * patch**2,
        "coarse": 6 * max(1, area // _COARSE**2),
        "coarse_target": 6 * wave * (patch // _COARSE) ** 2,
        "histogram": 2 * _BINS * wave * max(1, len(exemplar.finer)),
        "candidate": 4 * wave * rules.candidates,
        "cost": 8 * wave * rules.candidates,
        "best": 4 * wave,
        "table": 8 * wave * patch * grid.overlap,
    }


@dataclass
class Quilt:
    """A plan as it is made, on the device.

    Parameters
    ----------
    device : Device
    exemplar : Exemplar
    grid : Grid
    demand : Demand
    rules : Rules
    budget : int
    held : int
        Bytes that the caller holds beside it.
    pixels : int
        Of the largest window that is rendered at once.
    plan : Plan, optional
        Where to begin: cells that have a patch keep it.
    report : callable, optional
        Called with (waves done, waves in all).

    Raises
    ------
    DeviceError
        It does not fit; with the figure.
    """

    device: Device
    exemplar: Exemplar
    grid: Grid
    demand: Demand
    rules: Rules
    budget: int
    held: int = 0
    pixels: int = 1 << 20
    plan: Plan | None = None
    report: Callable[[int, int], None] | None = None
    done: int = field(default=0, init=False)  # waves

    def __post_init__(self) -> None:
        e, g, t = self.exemplar, self.grid, self.exemplar.table
        guided = self.demand.guide is not None and e.labels is not None
        sizes = layout(e, g, self.rules, guided, self.pixels)
        size = f"quilting {g.width}x{g.height} in {math.prod(g.shape)} patches of {g.patch} px"
        self._buffers = Buffers(self.device, sizes, self.budget, size, held=self.held)
        self._run = self.device.program("quilting")
        self._lock = threading.Lock()
        order, self._waves = g.waves()
        start = self.plan or Plan.empty(g)
        if self.plan is not None:  # cells that are decided stay
            keep = start.offsets.ravel()[order] == NONE
            self._waves = np.append(0, keep.cumsum())[self._waves]
            order = order[keep]
        cap = caps(t, self.demand.keys, self.rules.reuse)
        held = {
            "exemplar": e.lab, "coarse": reduced(e.lab), "offsets": t.offsets, "key_map": t.key_map,
            "starts": t.starts.astype(np.int32), "ranges": t.ranges.astype(np.int32), "range_blocks": t.range_blocks,
            "range_starts": t.range_starts.astype(np.int32), "uses": self._uses(start), "cap": cap, "order": order,
            "keys": self.demand.keys.astype(np.int32), "offset": start.offsets, "vertical": start.vertical,
            "horizontal": start.horizontal,
        }  # fmt: skip
        if e.finer:
            held["finer"] = np.stack([f[::LABEL_STEP, ::LABEL_STEP] for f in e.finer], -1)
        if guided:
            wanted = e.labels[::LABEL_STEP, ::LABEL_STEP]
            held["labels"], held["guide"] = wanted.astype(np.uint16), self.demand.guide.astype(np.uint16)
        for name, array in held.items():
            if array.size:
                self.device.write(self._buffers[name], array)
        self.plan = None  # it lives on the device now
        rows, columns = e.lab.shape[0] - g.patch + 1, e.lab.shape[1] - g.patch + 1
        facts = (
            e.lab.shape[1], columns, rows, t.block, -(-columns // t.block), self.rules.candidates, len(e.finer),
            self._stride, max(1, (2**31 - 1) // (_WORST * g.patch)), self.rules.seed & 0xFFFFFFFF, guided,
        )  # fmt: skip
        self._renderer = Renderer(self.device, self._buffers, g, facts, self.pixels, self._lock)
        self._units = self._weights(len(e.finer))

    @property
    def _stride(self) -> int:
        """px between two samples of a histogram: as many for any patch."""
        return max(LABEL_STEP, self.grid.patch // 16)

    def _uses(self, plan: Plan) -> np.ndarray:
        """How often each range is used by the cells that are decided."""
        t = self.exemplar.table
        uses = np.zeros(len(t.range_blocks), np.int32)
        there = plan.offsets != NONE
        y, x = (plan.offsets[there] >> 16).astype(np.int64), (plan.offsets[there] & 0xFFFF).astype(np.int64)
        key = t.key_map[y, x].astype(np.int64)
        block = y // t.block * -(-t.key_map.shape[1] // t.block) + x // t.block
        for n in np.unique(key[key < len(t.keys)]):
            first, last = t.ranges[n], t.ranges[n + 1]
            at = first + np.searchsorted(t.range_blocks[first:last], block[key == n])
            np.add.at(uses, at, 1)
        return uses

    def _weights(self, levels: int) -> tuple[np.int64, np.int64]:
        """Costs of one sample of a histogram too much, and of one sample that is not the guide's."""
        variance = float(self.exemplar.lab.reshape(-1, 3).var(axis=0, dtype=np.float64).sum())
        overlaps = 2 * self.grid.patch * self.grid.overlap  # pixels, about
        finer = self.rules.finer * variance * self._stride**2 / max(1, levels)
        return np.int64(round(finer)), np.int64(round(self.rules.guidance * variance * overlaps / GUIDE**2))

    # --- making ---

    @property
    def waves(self) -> int:
        """How many there are."""
        return len(self._waves) - 1

    def advance(self, waves: int) -> None:
        """Decide all cells of the first `waves` waves; nothing is done again."""
        with self._lock:
            while self.done < min(waves, self.waves):
                self._wave(int(self._waves[self.done]), int(self._waves[self.done + 1]))
                self.done += 1
                if self.done % _FLUSH == 0:
                    self.device.finish()
                if self.report is not None:
                    self.report(self.done, self.waves)

    def _wave(self, first: int, last: int) -> None:
        cells = last - first
        if not cells:
            return
        b, g, levels = self._buffers, self.grid, len(self.exemplar.finer)
        plan = self._renderer.plan
        self._run("target", (g.patch, cells), *plan, b["order"], first, b["exemplar"], b["target"], cells, group=8)
        self._run("reduce", (g.patch // _COARSE, cells), plan[0], b["target"], b["coarse_target"], cells, group=16)
        if levels:
            self._run("histogram", (levels, cells), *plan, b["order"], first, b["finer"], b["histogram"], cells,
                      group=1)  # fmt: skip
        place = (b["order"], first, cells, b["keys"], b["target"], b["exemplar"], b["coarse_target"], b["coarse"],
                 b["finer"], b["histogram"], b["guide"], b["labels"], *self._units)  # fmt: skip
        table = (b["offsets"], b["starts"], b["ranges"], b["range_blocks"], b["range_starts"], b["key_map"], b["uses"],
                 b["cap"])  # fmt: skip
        self._run("score", (self.rules.candidates, cells), *plan, *place, *table, b["candidate"], b["cost"])
        self._run("best", (cells,), *plan, *place, *table, b["candidate"], b["cost"], b["best"], self.rules.reach,
                  group=1)  # fmt: skip
        self._run("assign", (1,), plan[0], b["order"], first, cells, b["keys"], *table, b["candidate"], b["cost"],
                  b["best"], b["offset"])  # fmt: skip
        for number in range(3):  # the last two only where there may be something to the right or below
            if number == 0 or self._closes:
                self._run("cut", (2, cells), *plan, b["order"], first, cells, b["exemplar"], b["table"], number,
                          group=1)  # fmt: skip

    @property
    def _closes(self) -> bool:
        return self.grid.wrap_x or self.grid.wrap_y or int(self._waves[-1]) < math.prod(self.grid.shape)

    # --- reading ---

    def sources(self, window: Window) -> np.ndarray:
        """Which exemplar pixel lies where: (height, width) uint32 of y * exemplar width + x. Makes what it needs."""
        self.advance(self.grid.wave_of(window))
        return self._renderer.sources(window)

    def finished(self) -> Plan:
        """The whole plan."""
        self.advance(self.waves)
        return self._renderer.read()

    def used(self) -> tuple[np.ndarray, np.ndarray]:
        """How often each range of the content table is used, and how often it may be: (r,) int32 each."""
        with self._lock:
            uses = self.device.read(self._buffers["uses"], (len(self.exemplar.table.range_blocks),), np.int32)
        cap = caps(self.exemplar.table, self.demand.keys, self.rules.reuse)
        return uses, np.repeat(cap, np.diff(self.exemplar.table.ranges))
