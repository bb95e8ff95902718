# SPDX-License-Identifier: Apache-2.0
"""Any window of any level of a texture that an exemplar graph defines: HRRG08 sections 4 and 5.

The plane of level t has no end; a pixel of level t is 2^t times smaller than one of level 0, which is as large as the
root. Pixels hold (exemplar, level, u) as one texel number and an accumulated transfer function, never a color. What a
window holds depends on nothing but its place: `plan` says which pixels of which level it needs.
"""

from __future__ import annotations

import copy
import functools
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from ..core.source_map import SourceMap
from ..core.window import Window
from ..deferred import np
from ..errors import OutOfDeviceMemory, ParameterError, present
from ..opencl.buffers import Buffers, Download, in_smaller_pieces
from ..opencl.device import Device
from ..regularity.offset_prices import InStep
from .candidate_sets import DIMS, Analysis, texels_at_once
from .superexemplar import FIRST_CORRECTED

log = logging.getLogger("oiiotex")

# rho on the levels that are jittered. With 1 all places of the exemplar are as likely: less is undone by the
# correction, and the root shows as tiles; what is conspicuous in it comes back on a lattice
FIRST_JITTER, JITTER = (1.0, 1.0, 1.0), 0.6
PENALTY = 1.5  # kappa: by how much a second candidate must be better
KEPT_IN_LOOPS = 0.84  # of the transfer function per level: it would drift out of all colors where a zoom never ends
PASSES = 2
_LEAST_SIDE = 16  # px of the smallest window that is tried where the device runs out of memory: its halo is larger
MOST_LEVEL = 60  # places on it fit 64 bits with room for the halo

# Parities (x, y) of the pixels that the subpasses of a pass correct. Odd passes go another way round, so that the last
# subpass of a pass and the first of the next are of different parities.
_EVEN_PASS = ((0, 0), (1, 1), (0, 1), (1, 0))
_ODD_PASS = ((0, 1), (1, 0), (0, 0), (1, 1))


def schedule(passes: int) -> tuple[tuple[int, int], ...]:
    """The subpasses of correction in order, each by the parity (x, y) of its pixels."""
    return sum((_ODD_PASS if n % 2 else _EVEN_PASS for n in range(passes)), ())


class LevelPlan(NamedTuple):
    """What one level takes part with: `windows[0]` is upsampled, `windows[n + 1]` is right after subpass n."""

    level: int
    windows: tuple[Window, ...]


def looked_at(window: Window, parity: tuple[int, int]) -> Window:
    """What must be right before a subpass for `window` to be right after it.

    A pixel of the parity looks two pixels far, so on each side the outermost one of that parity decides.
    """
    low = [at - (2 if at & 1 == odd else 1) for at, odd in zip(window[:2], parity, strict=True)]
    high = [at + (2 if (at - 1) & 1 == odd else 1) for at, odd in zip(window[2:], parity, strict=True)]
    return Window(low[0], low[1], high[0], high[1])


def parents(window: Window) -> Window:
    """The pixels of the coarser level that upsampling a window looks at: each one's four nearest (section 5)."""
    return Window((window.left - 1) >> 1, (window.top - 1) >> 1, (window.right >> 1) + 1, (window.bottom >> 1) + 1)


def plan(window: Window, level: int, passes: int) -> tuple[LevelPlan, ...]:
    """The pixels of each level, from 0 on, that a window of `level` needs."""
    plans = []
    for at in range(level, -1, -1):
        windows = [window]
        for parity in reversed(schedule(passes) if at >= FIRST_CORRECTED else ()):
            windows.append(looked_at(windows[-1], parity))
        plans.append(LevelPlan(at, tuple(reversed(windows))))
        window = parents(windows[-1])
    return tuple(reversed(plans))


class LatticeSteps(NamedTuple):
    """How texels are kept in step with the lattice of the one exemplar: whole numbers, the same on all devices.

    Not in HRRG08. Jitter and candidates take pixels of a level to places that look alike on that level, and coarse
    levels hold nothing of a lattice that is finer than they are.
    """

    phases: tuple[int, ...]  # As `offset_prices.Prices.phases`, on level L
    moves: tuple[int, ...]  # How far a texel moves for a whole cycle of phase u, x and y, and of v; 1/256 px
    vectors: tuple[int, ...]  # Of the lattice, the same

    @classmethod
    def of(cls, kept: InStep) -> LatticeSteps:
        """Half of all `structure` moves all the way, less a share of it."""
        vectors = kept.steps()
        moves = np.rint(min(1.0, 2 * kept.structure) * vectors).astype(int)
        return cls(*(tuple(a.ravel().tolist()) for a in (kept.phases(), moves, vectors)))

    def phases_at(self, spacing: int) -> np.ndarray:
        """On a coarser level, whose pixels are that many wide and are looked at in their middles: (10,) uint32.

        Multiples of those on level L, so that all levels agree on any place, however far away.
        """
        own, there, corner = np.split(np.array(self.phases, np.int64), [4, 8])
        corner = corner - there.reshape(2, 2).sum(1) * (spacing - 1) // 2
        return (np.concatenate([own, there * spacing, corner]) & 0xFFFFFFFF).astype(np.uint32)


@dataclass(frozen=True, kw_only=True)
class PlaneSettings:
    """How a plane is made."""

    seed: int = 0
    jitter: tuple[float, ...] = (0.0,)  # rho by level, 0 to 1; the last holds for all finer levels
    passes: int = PASSES  # Of correction, four subpasses each
    penalty: float = PENALTY  # kappa, 1 to 2: second candidates' distances count so many times
    kept: float = 1.0  # How much of its parents' transfer function a pixel inherits
    around: tuple[int, int] | None = None  # Width and height, on `around_level`, after which the plane repeats
    around_level: int = 0
    steps: LatticeSteps | None = None  # Of the one exemplar, where the plane keeps its lattice

    def rho(self, level: int) -> int:
        """Jitter of a level in 1/256."""
        return round(256 * self.jitter[min(level, len(self.jitter) - 1)])

    def period(self, level: int) -> tuple[int, int]:
        """After how many pixels a level repeats along x and y; 0: never."""
        if self.around is None:
            return 0, 0
        return self.around[0] >> (self.around_level - level), self.around[1] >> (self.around_level - level)


def default_jitter(finest: int, endless: bool = False) -> tuple[float, ...]:
    """rho by level: none on the two finest of the root and beyond.

    A zoom that never ends is jittered on all further levels, or places that are alike stay alike for ever.
    """
    if endless:
        return 0.0, JITTER
    jittered = (*FIRST_JITTER, *[JITTER] * finest)[: max(0, finest - 2)]
    return 0.0, *jittered, 0.0


class PlaneState(NamedTuple):
    """Pixels of a window: texel numbers (height, width) uint32, transfer functions (height, width, 4) int16.

    No transfer functions, None, is all of them the identity.
    """

    texel: np.ndarray
    offset: np.ndarray | None


@dataclass(frozen=True)
class _Pending:
    """A window that the device works on."""

    _inside: tuple[slice, slice]
    _texel: Download
    _offset: Download | None
    _release: Callable[[], None]

    def state(self) -> PlaneState:
        """Its pixels, as soon as they are there; to be asked for once."""
        texel = self._texel.array()[self._inside]
        offset = None if self._offset is None else self._offset.array()[self._inside]
        self._release()
        return PlaneState(texel, offset)


class Synthesizer:
    """Makes windows; holds what they look up on the device. Any thread may ask; they take turns.

    `budget`: bytes of memory that there are.
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
            "spacing": np.array([levels.spacing(n) for n in range(len(levels.stacks))], np.int32),
        }
        self.nbytes = sum(table.nbytes for table in tables.values())  # on the device
        self._tables = Buffers(device, {}, budget, "the analyzed exemplars", tables=tables)
        middle = 1 << self._side - 1
        self._first: Any = SourceMap.of(middle, middle, self._side).packed  # of level 0
        self._moves = bool(analysis.offsets.any())
        self._free: list[tuple[int, Buffers]] = []  # of finished windows, by the pixels that they hold
        self._stepped: dict[int, tuple[bool, Any, Any]] = {}
        self._turn = threading.RLock()

    def keeping(self, kept: float) -> Synthesizer:
        """The same, where levels keep another share of transfer functions."""
        return self._with(replace(self._settings, kept=kept))

    def plainly(self) -> Synthesizer:
        """The same of seed 0, on a plane that does not repeat."""
        return self._with(replace(self._settings, seed=0, around=None))

    def _with(self, settings: PlaneSettings) -> Synthesizer:
        other = copy.copy(self)
        other._settings = settings
        return other

    def window(self, level: int, window: Window) -> PlaneState:
        """The pixels of a window of a level's plane."""
        return self.begin(level, window)()

    def begin(self, level: int, window: Window) -> Callable[[], PlaneState]:
        """The same, without waiting for it: what is called for it waits, to be called once."""
        if not 0 <= level <= MOST_LEVEL:
            raise ParameterError(f"level={level}: expected a whole number >= 0 and <= {MOST_LEVEL}")
        with self._turn:
            try:
                begun = self._begun(plan(window, level, self._settings.passes), window)
            except OutOfDeviceMemory as error:
                return functools.partial(self._in_pieces, level, window, error)

        def state() -> PlaneState:
            try:
                return begun.state()
            except OutOfDeviceMemory as error:
                return self._in_pieces(level, window, error)

        return state

    def _in_pieces(self, level: int, window: Window, error: OutOfDeviceMemory) -> PlaneState:
        """A window in squares until they fit: what it holds depends on nothing but its place."""
        side = max(window.width, window.height)
        if side <= _LEAST_SIDE:
            raise error
        log.warning("%s; going on in smaller pieces", error)

        def of_squares(side: int) -> PlaneState:
            texel = np.empty((window.height, window.width), np.uint32)
            offset = np.empty((window.height, window.width, 4), np.int16) if self._moves else None
            for cell in window.cells(side, side):
                one = self._begun(plan(cell, level, self._settings.passes), cell).state()
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
        # Departure: S_0 is the root's coarsest texel everywhere; its level holds nothing but a mean
        device.fill(buffers["texel"], self._first, at.width * at.height)
        device.fill(buffers["r"], np.int16(0), 4 * at.width * at.height)
        for entry in levels[1:]:
            buffers.swap("texel", "parent")
            buffers.swap("r", "parent_r")
            self._upsample(buffers, entry, at)
            at = entry.windows[0]
            for parity, after in zip(schedule(self._settings.passes), entry.windows[1:], strict=False):
                self._correct(buffers, at, after, parity)
        texel = device.read_later(buffers["texel"], (at.height, at.width), np.uint32)
        offset = device.read_later(buffers["r"], (at.height, at.width, 4), np.int16) if self._moves else None

        def release() -> None:
            with self._turn:
                self._free.append((most, buffers))

        return _Pending(window.inside(at), texel, offset, release)

    def _buffers(self, most: int, task: str) -> Buffers:
        """Buffers for so many pixels: those of a window that is finished, where they are large enough."""
        fits = [n for n, (size, _) in enumerate(self._free) if size >= most]
        if fits:
            return self._free.pop(fits[0])[1]
        self._free.clear()
        layout = {"texel": 4 * most, "r": 8 * most, "parent": 4 * most, "parent_r": 8 * most, "color": 8 * most}
        return Buffers(self._device, layout, self._budget, task)

    def _upsample(self, buffers: Buffers, entry: LevelPlan, before: Window) -> None:
        window, settings, tables = entry.windows[0], self._settings, self._tables
        period = settings.period(entry.level)
        self._run(
            "upsample", (window.width, window.height), buffers["parent"], buffers["parent_r"], buffers["texel"],
            buffers["r"], buffers["color"], tables["stack"], tables["finer"], tables["spacing"], self._side,
            before.width, (window.left >> 1) - before.left, (window.top >> 1) - before.top, window.width, window.height,
            np.int64(window.left), np.int64(window.top), np.int64(period[0]), np.int64(period[1]),
            np.uint32(entry.level), np.uint32(settings.seed), settings.rho(entry.level), round(256 * settings.kept),
            *self._steps(entry.level),
        )  # fmt: skip

    def _steps(self, level: int) -> tuple[bool, Any, Any]:
        """Whether a level is kept in step, and what cl/multiscale.cl, in_step, asks for."""
        if level not in self._stepped:
            steps = self._settings.steps if level <= self._side else None
            phases = np.zeros(10, np.uint32) if steps is None else steps.phases_at(1 << (self._side - level))
            moves = np.zeros(8, np.int32) if steps is None else np.array((*steps.moves, *steps.vectors), np.int32)
            self._stepped[level] = steps is not None, self._device.upload(phases), self._device.upload(moves)
        return self._stepped[level]

    def _correct(self, buffers: Buffers, whole: Window, after: Window, parity: tuple[int, int]) -> None:
        left, top = after.left + ((after.left ^ parity[0]) & 1), after.top + ((after.top ^ parity[1]) & 1)
        count = (after.right - left + 1) // 2, (after.bottom - top + 1) // 2
        if min(count) < 1:
            return
        run, tables = self._run, self._tables
        place = whole.width, left - whole.left, top - whole.top, *count
        run(
            "correct", (-(-count[0] // self._at_once), count[1]), buffers["texel"], buffers["r"], buffers["color"],
            tables["links"], tables["records"], tables["offsets"], tables["basis"], tables["spacing"], self._side,
            *place, round(16 * (self._settings.penalty - 1)),
        )  # fmt: skip
        run("color", count, buffers["texel"], buffers["r"], tables["stack"], buffers["color"], *place)


def paired(basis: np.ndarray) -> np.ndarray:
    """The basis as cl/multiscale.cl reads it: pairs of rows (L, a) and (b, 0), dimension by dimension.

    For every tap of a neighborhood, and at last for the sum of all.
    """
    taps = basis.reshape(25, 3, DIMS)
    rows = np.zeros((26, 4, DIMS), np.int16)
    rows[:25, :3], rows[25, :3] = taps, taps.sum(0, dtype=np.int16)  # at most 5 * 4096: the columns have length 4096
    return np.ascontiguousarray(rows.reshape(26, 2, 2, DIMS).transpose(0, 1, 3, 2))
