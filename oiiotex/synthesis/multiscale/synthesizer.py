# SPDX-License-Identifier: Apache-2.0
"""Any window of any level of the texture defined by an exemplar graph: HRRG08 sections 4 and 5.

The plane of level t is unbounded. A pixel of level t is 2^t times smaller than one of level 0, which is as large as the
root. Pixels contain (exemplar, level, u) as one texel index and an accumulated transfer function, never a color. A
window depends only on its place: `plan` gives the pixels of each level that it needs.
"""

from __future__ import annotations

import copy
import functools
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import OutOfDeviceMemory, ParameterError, present
from ...engine.opencl.buffers import Buffers, in_smaller_pieces
from ...engine.opencl.device import Device, Download
from .candidate_sets import DIMS, Analysis, texels_at_once
from .plane_quilt import PlaneQuilt
from .superexemplar import FIRST_CORRECTED

log = logging.getLogger("oiiotex")

# rho on the levels that are jittered. With 1 all places of the exemplar are equally likely: otherwise correction undoes
# less of it, the root repeats as tiles, and its conspicuous features form a lattice
FIRST_JITTER, JITTER = (1.0, 1.0, 1.0), 0.6
PENALTY = 1.5  # kappa: ratio by which a second candidate must be better
KEPT_IN_LOOPS = 0.84  # share of the transfer function per level: keeps the colors of an endless zoom bounded
PASSES = 2
_LEAST_SIDE = 16  # px of the smallest window tried when the device runs out of memory: its halo is larger
MOST_LEVEL = 60  # its coordinates fit 64 bits with room for the halo

# Parities (x, y) of the pixels that the subpasses of a pass correct. Odd passes use another order, so that the last
# subpass of a pass and the first of the next have different parities.
_EVEN_PASS = ((0, 0), (1, 1), (0, 1), (1, 0))
_ODD_PASS = ((0, 1), (1, 0), (0, 0), (1, 1))


def schedule(passes: int) -> tuple[tuple[int, int], ...]:
    """The subpasses of correction in order, each as the parity (x, y) of its pixels."""
    return sum((_ODD_PASS if n % 2 else _EVEN_PASS for n in range(passes)), ())


class LevelPlan(NamedTuple):
    """Windows of one level: `windows[0]` is upsampled, `windows[n + 1]` is valid after subpass n."""

    level: int
    windows: tuple[Window, ...]


def looked_at(window: Window, parity: tuple[int, int]) -> Window:
    """The window that must be valid before a subpass for `window` to be valid after it.

    A pixel of the parity reads two pixels far, so the outermost one of that parity decides on each side.
    """
    low = [at - (2 if at & 1 == odd else 1) for at, odd in zip(window[:2], parity, strict=True)]
    high = [at + (2 if (at - 1) & 1 == odd else 1) for at, odd in zip(window[2:], parity, strict=True)]
    return Window(low[0], low[1], high[0], high[1])


def parents(window: Window) -> Window:
    """The pixels of the coarser level that are read to upsample a window: the four nearest of each (section 5)."""
    return Window((window.left - 1) >> 1, (window.top - 1) >> 1, (window.right >> 1) + 1, (window.bottom >> 1) + 1)


def plan(window: Window, level: int, passes: int, first: int = 0) -> tuple[LevelPlan, ...]:
    """The pixels of each level, from `first`, that a window of `level` needs."""
    plans = []
    for at in range(level, first - 1, -1):
        windows = [window]
        for parity in reversed(schedule(passes) if at >= max(FIRST_CORRECTED, first + 1) else ()):
            windows.append(looked_at(windows[-1], parity))
        plans.append(LevelPlan(at, tuple(reversed(windows))))
        window = parents(windows[-1])
    return tuple(reversed(plans))


@dataclass(frozen=True, kw_only=True)
class PlaneSettings:
    """Settings of a plane."""

    seed: int = 0
    jitter: tuple[float, ...] = (0.0,)  # rho by level, 0 to 1; the last holds for all finer levels
    passes: int = PASSES  # of correction, four subpasses each
    penalty: float = PENALTY  # kappa, 1 to 2: factor on second candidates' distances
    kept: float = 1.0  # share of the parents' transfer function that a pixel inherits
    around: tuple[int, int] | None = None  # period of the plane, width and height on `around_level`
    around_level: int = 0
    quilt: PlaneQuilt | None = None  # where the plane starts, instead of from one texel
    root_level: int = -1  # last level on which the plane's first cell is the root itself: L, or -1 for none

    def rho(self, level: int) -> int:
        """Jitter of a level in 1/256."""
        return round(256 * self.jitter[min(level, len(self.jitter) - 1)])

    def plan(self, window: Window, level: int) -> tuple[LevelPlan, ...]:
        """The pixels of each level, from the plane's start, that a window of `level` needs."""
        return plan(window, level, self.passes, 0 if self.quilt is None else min(level, self.quilt.level))

    def period(self, level: int) -> tuple[int, int]:
        """Period of a level along x and y, px. 0: none."""
        if self.around is None:
            return 0, 0
        return self.around[0] >> (self.around_level - level), self.around[1] >> (self.around_level - level)

    def root_cell(self, level: int, window: Window) -> Window:
        """The part of a level's window that is the root itself, from the window's corner."""
        side = 1 << level if level <= self.root_level else 0
        cell = Window(0, 0, side, side) & window
        return Window(0, 0, 0, 0) if cell.empty else cell.shifted(-window.left, -window.top)


def default_jitter(finest: int, everywhere: bool = False, rooted: bool = False) -> tuple[float, ...]:
    """rho by level: none on the root's two finest levels and beyond, which HRRG08 does not say.

    An endless zoom is jittered `everywhere`, below the root if the plane contains it (`rooted`). Otherwise similar
    places would stay similar.
    """
    if everywhere and not rooted:
        return 0.0, JITTER
    jittered = (*FIRST_JITTER, *[JITTER] * finest)[: max(0, finest - 2)]
    return (0.0, *jittered, *[0.0] * (finest - len(jittered)), JITTER) if rooted else (0.0, *jittered, 0.0)


class PlaneState(NamedTuple):
    """Pixels of a window: texel indices (height, width) uint32, transfer functions (height, width, 4) int16.

    None as transfer functions: all are the identity.
    """

    texel: np.ndarray
    offset: np.ndarray | None


@dataclass(frozen=True)
class _Pending:
    """A window in progress on the device."""

    _inside: tuple[slice, slice]
    _texel: Download
    _offset: Download | None
    _release: Callable[[], None]

    def state(self) -> PlaneState:
        """Wait for its pixels. To be called once."""
        texel = self._texel.array()[self._inside]
        offset = None if self._offset is None else self._offset.array()[self._inside]
        self._release()
        return PlaneState(texel, offset)


class Synthesizer:
    """Synthesizes windows, with the tables on the device. Threads may share it and take turns.

    `budget`: memory in bytes.
    """

    def __init__(self, device: Device, analysis: Analysis, settings: PlaneSettings, budget: int):
        self._device, self._settings, self._budget = device, settings, budget
        self._side = analysis.stacks.side_bits
        self._at_once = texels_at_once(device)
        self._run = device.program("multiscale", RUN=self._at_once)
        levels = analysis.stacks.levels
        tables = {
            "links": analysis.links,  # levels x side^2 x 2
            "records": analysis.records,  # levels x side^2 x 2 x DIMS
            "offsets": analysis.offsets,  # levels x side^2 x 2 x 4
            "stack": analysis.stacks.planes,  # levels x side x side x 4
            "basis": paired(analysis.basis),  # 26 x 2 x DIMS x 2
            "finer": np.array(levels.finer, np.int32),
            "first_finer": np.array(levels.first_finer, np.int32),
            "first_left": np.array(levels.first_left, np.int32),
            "spacing": np.array([levels.spacing(n) for n in range(len(levels.stacks))], np.int32),
            "tiles": np.array(analysis.stacks.periodic, np.int32),
        }
        self.nbytes = sum(table.nbytes for table in tables.values())  # on the device
        self._tables = Buffers(device, {}, budget, "analyzing exemplars", tables=tables)
        self._shown = levels.shown
        middle = 1 << self._side - 1
        self._first: Any = SourceMap.of(middle, middle, self._side).packed  # of level 0
        self._moves = bool(analysis.offsets.any())
        self._free: list[tuple[int, Buffers]] = []  # of finished windows, by number of pixels
        self._turn = threading.RLock()

    def keeping(self, kept: float) -> Synthesizer:
        """A copy that keeps another share of transfer functions."""
        return self._with(replace(self._settings, kept=kept))

    def plainly(self) -> Synthesizer:
        """A copy with seed 0, on a plane that does not repeat."""
        return self._with(replace(self._settings, seed=0, around=None))

    def _with(self, settings: PlaneSettings) -> Synthesizer:
        other = copy.copy(self)
        other._settings = settings
        return other

    def window(self, level: int, window: Window) -> PlaneState:
        """The pixels of a window of a level's plane."""
        return self.begin(level, window)()

    def begin(self, level: int, window: Window) -> Callable[[], PlaneState]:
        """Start on a window without waiting. The returned function waits for it, and must be called once."""
        if not 0 <= level <= MOST_LEVEL:
            raise ParameterError(parameter="lod", value=level, expected=f"an integer from 0 to {MOST_LEVEL}")
        with self._turn:
            try:
                begun = self._begun(self._settings.plan(window, level), window)
            except OutOfDeviceMemory as error:
                return functools.partial(self._in_pieces, level, window, error)

        def state() -> PlaneState:
            try:
                return begun.state()
            except OutOfDeviceMemory as error:
                return self._in_pieces(level, window, error)

        return state

    def _in_pieces(self, level: int, window: Window, error: OutOfDeviceMemory) -> PlaneState:
        """A window in squares of decreasing size until they fit: its pixels depend only on their place."""
        side = max(window.width, window.height)
        if side <= _LEAST_SIDE:
            raise error
        log.warning("%s; continuing in smaller pieces", error)

        def of_squares(side: int) -> PlaneState:
            texel = np.empty((window.height, window.width), np.uint32)
            offset = np.empty((window.height, window.width, 4), np.int16) if self._moves else None
            for cell in window.cells(side, side):
                one = self._begun(self._settings.plan(cell, level), cell).state()
                at = cell.inside(window)
                texel[at] = one.texel
                if offset is not None:
                    offset[at] = present(one.offset)
            return PlaneState(texel, offset)

        with self._turn:
            self._free.clear()
            return in_smaller_pieces(of_squares, max(_LEAST_SIDE, side // 2), _LEAST_SIDE)

    def _begun(self, levels: Sequence[LevelPlan], window: Window) -> _Pending:
        most = max(entry.windows[0].width * entry.windows[0].height for entry in levels)
        buffers = self._buffers(most, f"a window of {window.width}x{window.height} pixels")
        device, at = self._device, levels[0].windows[0]
        if self._settings.quilt is None:
            # Departure: S_0 is the root's coarsest texel everywhere; its level contains only a mean
            device.fill(buffers["texel"], self._first, at.width * at.height)
        else:
            device.write(buffers["texel"], self._settings.quilt.texels(levels[0].level, at, self._side, self._shown))
        device.fill(buffers["r"], np.int16(0), 4 * at.width * at.height)
        settings, shown = self._settings, levels[-1].level
        leads = settings.root_level if shown > settings.root_level else None  # where the root itself is left
        for entry in levels[1:]:
            buffers.swap("texel", "parent")
            buffers.swap("r", "parent_r")
            self._upsample(buffers, entry, at, entry.level == leads)
            at = entry.windows[0]
            own = Window(0, 0, 0, 0) if entry.level == leads else settings.root_cell(entry.level, at)
            for parity, after in zip(schedule(self._settings.passes), entry.windows[1:], strict=False):
                self._correct(buffers, at, after, parity, own)
        texel = device.read_later(buffers["texel"], (at.height, at.width), np.uint32)
        offset = device.read_later(buffers["r"], (at.height, at.width, 4), np.int16) if self._moves else None

        def release() -> None:
            with self._turn:
                self._free.append((most, buffers))

        return _Pending(window.inside(at), texel, offset, release)

    def _buffers(self, most: int, task: str) -> Buffers:
        """Buffers for that number of pixels: those of a finished window, if they are large enough."""
        fits = [n for n, (size, _) in enumerate(self._free) if size >= most]
        if fits:
            return self._free.pop(fits[0])[1]
        self._free.clear()
        layout = {"texel": 4 * most, "r": 8 * most, "parent": 4 * most, "parent_r": 8 * most, "color": 8 * most}
        return Buffers(self._device, layout, self._budget, task)

    def _upsample(self, buffers: Buffers, entry: LevelPlan, before: Window, leads: bool) -> None:
        window, settings, tables = entry.windows[0], self._settings, self._tables
        finer = tables["finer" if entry.level > settings.root_level else "first_left" if leads else "first_finer"]
        period = settings.period(entry.level)
        self._run(
            "upsample", (window.width, window.height), buffers["parent"], buffers["parent_r"], buffers["texel"],
            buffers["r"], buffers["color"], tables["stack"], finer, tables["spacing"], tables["tiles"],
            self._side, before.width, (window.left >> 1) - before.left, (window.top >> 1) - before.top,
            window.width, window.height, np.int64(window.left), np.int64(window.top), np.int64(period[0]),
            np.int64(period[1]), np.uint32(entry.level), np.uint32(settings.seed), settings.rho(entry.level),
            round(256 * settings.kept), *settings.root_cell(entry.level, window),
        )  # fmt: skip

    def _correct(
        self, buffers: Buffers, whole: Window, after: Window, parity: tuple[int, int], own: Window
    ) -> None:  # fmt: skip
        left, top = after.left + ((after.left ^ parity[0]) & 1), after.top + ((after.top ^ parity[1]) & 1)
        count = (after.right - left + 1) // 2, (after.bottom - top + 1) // 2
        if min(count) < 1:
            return
        run, tables = self._run, self._tables
        place = whole.width, left - whole.left, top - whole.top, *count
        run(
            "correct", (-(-count[0] // self._at_once), count[1]), buffers["texel"], buffers["r"], buffers["color"],
            tables["links"], tables["records"], tables["offsets"], tables["basis"], tables["spacing"], self._side,
            *place, round(16 * (self._settings.penalty - 1)), *own,
        )  # fmt: skip
        run("color", count, buffers["texel"], buffers["r"], tables["stack"], buffers["color"], *place)


def paired(basis: np.ndarray) -> np.ndarray:
    """The basis in the format of cl/multiscale.cl: pairs of rows (L, a) and (b, 0), dimension by dimension.

    For every tap of a neighborhood, and finally for their sum.
    """
    taps = basis.reshape(25, 3, DIMS)
    rows = np.zeros((26, 4, DIMS), np.int16)
    rows[:25, :3], rows[25, :3] = taps, taps.sum(0, dtype=np.int16)  # at most 5 * 4096: the columns have length 4096
    return np.ascontiguousarray(rows.reshape(26, 2, 2, DIMS).transpose(0, 1, 3, 2))
