# SPDX-License-Identifier: Apache-2.0
"""Image quilting (Efros & Freeman 2001) as a stream, with candidates chosen by content (LSA16 section 6.1).

A regular grid of overlapping square patches is filled from the top left to the bottom right. The result is a plan:
for every cell, the patch's offset in the exemplar and two cuts. The source of any output pixel follows from the plan
alone, so the overlaps of a cell are read through it, no pixels are kept, and any window can be made at any time.

Cells (i, j) with the same j + 2 i do not overlap: they are decided together, wave by wave. The order depends on the
grid only, so bands, budget and threads do not change the result.
"""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Callable
from dataclasses import InitVar, dataclass, field
from typing import Any

from ...analysis.labels.content_table import ContentTable
from ...analysis.regularity.courses import InCourses
from ...analysis.regularity.offset_prices import InStep
from ...engine.color.lab_grid import COARSE_STEPS, SPAN
from ...engine.core.source_map import NONE, SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import present
from ...engine.opencl.buffers import Buffers, offset_table
from ...engine.opencl.device import Device
from .quilt_plan import AT_ONCE, Grid, QuiltPlan, Renderer, plan_bytes
from .repetition import GROWTH, PatchSquares, laid

GUIDE = 4  # samples of the guide along a side of a cell, cl/quilting.cl
LABEL_STEP, _BINS, _COARSE = 4, 256, 4  # cl/quilting.cl
MOST_FINER = 3  # cl/quilting.cl, LEVELS
_WORST = 3 * (SPAN * COARSE_STEPS) ** 2  # largest squared difference of two pixels in grid steps
_ROWS = 128  # of squares summed in 32 bits
_LOSSES = 1 << 16  # maximum offset penalty, as integers of a table
_OVER = 16  # integer steps per excess use, cl/quilting.cl
_FLUSH = 64  # waves between two flushes of the queue


@dataclass(frozen=True)
class Rules:
    """Settings that control the choice of patches."""

    seed: int = 0
    candidates: int = 256  # maximum number of patches compared per cell
    reach: int = 4  # px by which the best candidate may be moved to fit better: halved down to 1
    reuse: float = 1.0  # free uses of a region, in fair shares: it pays for those above one more, and above two
    finer: float = 0.5  # weight of finer levels' histograms, in units of the exemplar's variance
    guidance: float = 1.0  # weight of pixels whose label is not the guide's, in the same unit


@dataclass(frozen=True)
class QuiltExemplar:
    """The source of patches."""

    lab: np.ndarray  # (h, w, 3) int16: Lab in steps of `lab_grid.COARSE_STEPS`
    table: ContentTable  # contents of windows of the patch's size
    finer: tuple[np.ndarray, ...] = ()  # (h, w) uint8, `folded`: at most MOST_FINER maps of finer levels
    labels: np.ndarray | None = None  # (h, w): the label map that a guide refers to


@dataclass
class Demand:
    """Contents demanded for the cells."""

    keys: np.ndarray  # (rows, columns) int32: index of each cell's key in the content table
    guide: np.ndarray | None = None  # (rows, columns, GUIDE, GUIDE) uint16, labels at the centers of pieces; 0: any


def folded(ids: np.ndarray) -> np.ndarray:
    """Labels as histogram bins, uint8. Above 255 labels, some share a bin. 0 stays separate."""
    return np.where(ids > 0, (ids - 1) % (_BINS - 1) + 1, 0).astype(np.uint8)


def reduced(lab: np.ndarray) -> np.ndarray:
    """(h, w, 3) int16 -> means of its complete squares of _COARSE pixels, halves rounded up."""
    h, w = (n // _COARSE for n in lab.shape[:2])
    squares = lab[: h * _COARSE, : w * _COARSE].reshape(h, _COARSE, w, _COARSE, 3)
    return ((squares.sum((1, 3), np.int32) + _COARSE**2 // 2) >> 4).astype(np.int16)


def total_variance(lab: np.ndarray) -> float:
    """Variances of all channels of (h, w, 3) int16, summed."""
    rows = lab.reshape(len(lab), -1)
    count, squares = rows.size // 3, np.zeros(rows.shape[1], np.int64)
    for top in range(0, len(rows), _ROWS):
        piece = rows[top : top + _ROWS].astype(np.int32)
        squares += np.einsum("ij,ij->j", piece, piece)
    sums = rows.sum(0, np.int64).reshape(-1, 3).sum(0)
    pairs = zip(squares.reshape(-1, 3).sum(0).tolist(), sums.tolist(), strict=True)
    return sum((count * square - total**2) / count**2 for square, total in pairs)


def cell_memory(grid: Grid, guided: bool) -> int:
    """Bytes of all that grows with the number of patches: to be checked before they are computed."""
    cells = math.prod(grid.shape)
    return cells * (4 + 4 + 2 * GUIDE**2 * guided) + sum(plan_bytes(grid, 0).values())


def layout(exemplar: QuiltExemplar, grid: Grid, rules: Rules, guided: bool, pixels: int) -> dict[str, int]:
    """Device memory of a `Quilt`, in bytes by name."""
    cells, wave = math.prod(grid.shape), min(grid.shape[0], (grid.shape[1] + 1) // 2)
    area, patch = exemplar.lab.shape[0] * exemplar.lab.shape[1], grid.patch
    table, squares = exemplar.table, PatchSquares.of(grid, *exemplar.lab.shape[:2])
    labels = math.prod(-(-n // LABEL_STEP) for n in exemplar.lab.shape[:2])
    return {
        "exemplar": 6 * area,
        "offsets": table.offsets.nbytes,
        "key_map": table.key_map.nbytes,
        "spans": 16 * len(table.keys),
        **dict.fromkeys(("shown", "shares"), 4 * squares.rows * squares.columns),
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
        **dict.fromkeys(("cost", "price"), 8 * wave * rules.candidates),
        **dict.fromkeys(("best", "best_number"), 4 * wave),
        "table": 8 * wave * patch * grid.overlap,
    }


@dataclass
class Quilt:
    """A plan in progress on the device.

    Parameters
    ----------
    held : int
        Bytes that the caller holds in addition.
    pixels : int
        Maximum number of pixels rendered at a time.
    plan : QuiltPlan, optional
        Initial plan: cells that have a patch keep it.
    in_step : InStep or InCourses, optional
        The exemplar's lattice or courses, if the quilt keeps them.
    report : callable, optional
        Called with (finished waves, total waves).

    Raises
    ------
    DeviceError
        It does not fit the budget. The message gives the size.
    """

    device: Device
    exemplar: InitVar[QuiltExemplar]  # on the device from then on
    grid: Grid
    demand: Demand
    rules: Rules
    budget: int
    held: int = 0
    pixels: int = AT_ONCE
    plan: QuiltPlan | None = None
    in_step: InStep | InCourses | None = None
    report: Callable[[int, int], None] | None = None
    waves_decided: int = field(default=0, init=False)

    def __post_init__(self, exemplar: QuiltExemplar) -> None:
        e, g, t = exemplar, self.grid, exemplar.table
        guided = self.demand.guide is not None and e.labels is not None
        sizes = layout(e, g, self.rules, guided, self.pixels)
        size = f"quilting {g.width}x{g.height} in {math.prod(g.shape)} patches of {g.patch} px"
        self._buffers = Buffers(self.device, sizes, self.budget, size, held=self.held)
        self._run = self.device.program("quilting")
        self._lock = threading.Lock()
        self._flushed: Any = None  # an event
        order, self._waves = g.waves()
        start = self.plan or QuiltPlan.empty(g)
        if self.plan is not None:  # decided cells are kept
            keep = start.offsets.ravel()[order] == NONE
            self._waves = np.append(0, keep.cumsum())[self._waves]
            order = order[keep]
        self._kept = math.prod(g.shape) - len(order)
        squares = PatchSquares.of(g, *e.lab.shape[:2])
        spans = squares.spans(t, self.demand.keys, self.rules.reuse)
        inputs = {
            "exemplar": e.lab, "coarse": reduced(e.lab),  # rows x columns x 3, both
            "offsets": t.offsets, "key_map": t.key_map,
            "spans": offset_table(spans), "order": order,
            "shown": squares.shown(laid(start.offsets)),  # rows x columns of squares
            "shares": squares.shares(t.offsets, spans, self.demand.keys, self.rules.reuse),  # the same
            "keys": self.demand.keys.astype(np.int32), "offset": start.offsets,  # rows x columns of cells
            "vertical": start.vertical, "horizontal": start.horizontal,  # rows x columns of cells x patch
        }  # fmt: skip
        if e.finer:
            inputs["finer"] = np.stack([f[::LABEL_STEP, ::LABEL_STEP] for f in e.finer], -1)  # x levels
        if guided:
            inputs["labels"] = present(e.labels)[::LABEL_STEP, ::LABEL_STEP].astype(np.uint16)
            inputs["guide"] = present(self.demand.guide).astype(np.uint16)
        phases, losses, steps = np.zeros(10, np.uint32), np.zeros(1, np.int32), np.zeros((2, 2), np.int32)
        if self.in_step is not None:
            phases, losses = self.in_step.of_patches(g.patch, _LOSSES)
            steps = self.in_step.steps()
        self._lattice = self.device.upload(phases), self.device.upload(losses)
        for name, array in inputs.items():
            if array.size:
                self.device.write(self._buffers[name], array)
        self.plan = None  # on the device from now on
        rows, columns = e.lab.shape[0] - g.patch + 1, e.lab.shape[1] - g.patch + 1
        facts = (
            e.lab.shape[1], columns, rows, squares.side, squares.count, squares.before, squares.columns,
            self.rules.candidates, len(e.finer), self._stride, max(1, (2**31 - 1) // (_WORST * g.patch)),
            self.rules.seed & 0xFFFFFFFF, guided, self._structure, *steps.ravel(),
        )  # fmt: skip
        self._renderer = Renderer(self.device, self._buffers, g, facts, self.pixels, self._lock)
        self._levels = len(e.finer)
        self._units = self._weights(total_variance(e.lab), squares)

    @property
    def _structure(self) -> int:
        """cl/quilting.cl, facts.lattice."""
        return 0 if self.in_step is None else 1 + isinstance(self.in_step, InCourses)

    @property
    def _stride(self) -> int:
        """Distance between two samples of a histogram, px: their number is the same for any patch."""
        return max(LABEL_STEP, self.grid.patch // 16)

    def _weights(self, variance: float, squares: PatchSquares) -> tuple[np.int64, ...]:
        """Costs of an excess histogram sample, of a sample off the guide, of reuse, and of being out of phase."""
        overlaps = variance * 2 * self.grid.patch * self.grid.overlap  # typical cost of overlaps, for comparison
        costs = (
            self.rules.finer * variance * self._stride**2 / max(1, self._levels),
            self.rules.guidance * overlaps / GUIDE**2,
            GROWTH * overlaps / (squares.count**2 * _OVER**2),
            0.0 if self.in_step is None else self.in_step.most(overlaps) / _LOSSES,
        )
        return tuple(np.int64(round(cost)) for cost in costs)

    # --- making ---

    @property
    def waves(self) -> int:
        """Number of waves."""
        return len(self._waves) - 1

    def advance(self, waves: int) -> None:
        """Decide all cells of the first `waves` waves that are still undecided."""
        with self._lock:
            while self.waves_decided < min(waves, self.waves):
                self._wave(int(self._waves[self.waves_decided]), int(self._waves[self.waves_decided + 1]))
                self.waves_decided += 1
                if self.waves_decided % _FLUSH == 0:  # keep the queue neither unbounded nor empty
                    if self._flushed is not None:
                        self._flushed.wait()
                    self._flushed = self.device.mark()
                if self.report is not None:
                    self.report(self.waves_decided, self.waves)

    def _wave(self, first: int, last: int) -> None:
        cells = last - first
        if not cells:
            return
        b, g, levels = self._buffers, self.grid, self._levels
        plan = self._renderer.plan
        run = functools.partial(self._run, team=True)
        run("target", (g.patch, cells), *plan, b["order"], first, b["exemplar"], b["target"], cells, group=8)
        run("reduce", (g.patch // _COARSE, cells), plan[0], b["target"], b["coarse_target"], cells, group=16)
        if levels:
            run("histogram", (levels, cells), *plan, b["order"], first, b["finer"], b["histogram"], cells, group=1)
        progress = (self._kept + first << 16) // math.prod(g.shape)
        place = (b["order"], first, cells, b["keys"], b["target"], b["exemplar"], b["coarse_target"], b["coarse"],
                 b["finer"], b["histogram"], b["guide"], b["labels"], b["shown"], b["shares"], progress, *self._lattice,
                 *self._units)  # fmt: skip
        table = b["offsets"], b["spans"], b["key_map"]
        tried = b["candidate"], b["cost"], b["price"]
        best = b["best"], b["best_number"]
        run("score", (self.rules.candidates, cells), *plan, *place, *table, *tried)
        run("best", (cells,), *plan, *place, *table, *tried, *best, self.rules.reach, group=1)
        use = b["shown"], b["shares"], progress, self._units[2]
        run("assign", (1,), plan[0], b["order"], first, cells, *use, *tried, *best, b["offset"])
        for number in range(3):  # the last two only if decided cells may exist to the right or below
            if number == 0 or self._closes:
                run("cut", (2, cells), *plan, b["order"], first, cells, b["exemplar"], b["table"], number, group=1)

    @property
    def _closes(self) -> bool:
        return self.grid.wrap_x or self.grid.wrap_y or int(self._waves[-1]) < math.prod(self.grid.shape)

    # --- reading ---

    def sources(self, window: Window) -> SourceMap:
        """The exemplar pixel at each pixel of the window. Decides the waves that it needs."""
        self.advance(self.grid.wave_of(window))
        return self._renderer.sources(window)

    def finished(self) -> QuiltPlan:
        """The finished plan."""
        self.advance(self.waves)
        return self._renderer.read()
