# SPDX-License-Identifier: Apache-2.0
"""Any window of any level of a texture that an exemplar graph defines: HRRG08 sections 4 and 5.

The plane of level t has no end; a pixel of level t is 2^t times smaller than one of level 0, which is as large as the
root. Pixels hold (exemplar, level, u) as one texel number and an accumulated transfer function, never a colour. What a
window holds depends on nothing but its place: `plan` says which pixels of which level it needs.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..device import Buffers, Device
from ..errors import ParameterError
from ..windows import Window
from .candidates import DIMS, Analysis, texels_at_once
from .superexemplar import FIRST_CORRECTED

JITTER = 0.6  # rho on the levels that are jittered: less is undone by the correction, and the root shows as tiles
PENALTY = 1.5  # kappa: by how much a second candidate must be better
KEPT_IN_LOOPS = 0.84  # of the transfer function per level: it would drift out of all colours where a zoom never ends
PASSES = 2
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
    found = []
    for at in range(level, -1, -1):
        windows = [window]
        for parity in reversed(schedule(passes) if at >= FIRST_CORRECTED else ()):
            windows.append(looked_at(windows[-1], parity))
        found.append(LevelPlan(at, tuple(reversed(windows))))
        window = parents(windows[-1])
    return tuple(reversed(found))


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a plane is made.

    Attributes
    ----------
    seed : int
    jitter : tuple of float
        rho by level, 0 to 1; the last holds for all finer levels.
    passes : int
        Of correction, four subpasses each.
    penalty : float
        kappa, 1 to 2: second candidates' distances count so many times.
    kept : float
        How much of its parents' transfer function a pixel inherits.
    around : (int, int) or None
        Width and height, on `around_level`, after which the plane repeats.
    around_level : int
    """

    seed: int = 0
    jitter: tuple[float, ...] = (0.0,)
    passes: int = PASSES
    penalty: float = PENALTY
    kept: float = 1.0
    around: tuple[int, int] | None = None
    around_level: int = 0

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
    return (0.0, JITTER) if endless else tuple(JITTER if 0 < level <= finest - 2 else 0.0 for level in range(finest))


class State(NamedTuple):
    """Pixels of a window: texel numbers (height, width) uint32, transfer functions (height, width, 4) int16."""

    texel: np.ndarray
    offset: np.ndarray


class Synthesizer:
    """Makes windows; holds what they look up on the device. Any thread may ask; they take turns.

    Parameters
    ----------
    device : Device
    analysis : Analysis
    settings : Settings
    budget : int
        Bytes of memory that there are.
    """

    def __init__(self, device: Device, analysis: Analysis, settings: Settings, budget: int):
        self._device, self._settings, self._budget = device, settings, budget
        self._side = analysis.stacks.side_bits
        self._at_once = texels_at_once(device)
        self._run = device.program("multiscale", RUN=self._at_once)
        levels = analysis.stacks.levels
        tables = {
            "links": analysis.links,
            "records": analysis.records,
            "offsets": analysis.offsets,
            "stack": analysis.stacks.planes,
            "basis": paired(analysis.basis),
            "finer": np.array(levels.finer, np.int32),
            "spacing": np.array([levels.spacing(n) for n in range(len(levels.stacks))], np.int32),
        }
        self._tables = Buffers(device, {}, budget, "the analysed exemplars", tables=tables)
        self._first = ((1 << self._side) // 2 << self._side) + (1 << self._side) // 2  # the middle of level 0
        self._turn = threading.Lock()

    def window(self, level: int, window: Window) -> State:
        """The pixels of a window of a level's plane.

        Raises
        ------
        DeviceError
            It does not fit; ask for a smaller one.
        """
        if not 0 <= level <= MOST_LEVEL:
            raise ParameterError(f"level={level}: allowed is a whole number >= 0 and <= {MOST_LEVEL}")
        with self._turn:
            return self._made(plan(window, level, self._settings.passes), window)

    def _made(self, levels: Sequence[LevelPlan], window: Window) -> State:
        most = max(entry.windows[0].width * entry.windows[0].height for entry in levels)
        layout = {"texel": 4 * most, "r": 8 * most, "parent": 4 * most, "parent_r": 8 * most, "colour": 8 * most}
        device, what = self._device, f"a window of {window.width}x{window.height} pixels"
        with Buffers(device, layout, self._budget, what) as held:
            at = levels[0].windows[0]
            # Departure: S_0 is the root's coarsest texel everywhere; its level holds nothing but a mean
            device.fill(held["texel"], np.uint32(self._first), at.width * at.height)
            device.fill(held["r"], np.int16(0), 4 * at.width * at.height)
            for entry in levels[1:]:
                held.swap("texel", "parent")
                held.swap("r", "parent_r")
                self._upsample(held, entry, at)
                at = entry.windows[0]
                for parity, after in zip(schedule(self._settings.passes), entry.windows[1:], strict=False):
                    self._correct(held, at, after, parity)
            texel = device.read(held["texel"], (at.height, at.width), np.uint32)
            offset = device.read(held["r"], (at.height, at.width, 4), np.int16)
        inside = window.inside(at)
        return State(texel[inside], offset[inside])

    def _upsample(self, held: Buffers, entry: LevelPlan, before: Window) -> None:
        window, settings, tables = entry.windows[0], self._settings, self._tables
        period = settings.period(entry.level)
        self._run(
            "upsample", (window.width, window.height), held["parent"], held["parent_r"], held["texel"], held["r"],
            held["colour"], tables["stack"], tables["finer"], tables["spacing"], self._side, before.width,
            (window.left >> 1) - before.left, (window.top >> 1) - before.top, window.width, window.height,
            np.int64(window.left), np.int64(window.top), np.int64(period[0]), np.int64(period[1]),
            np.uint32(entry.level), np.uint32(settings.seed), settings.rho(entry.level), round(256 * settings.kept),
        )  # fmt: skip

    def _correct(self, held: Buffers, whole: Window, after: Window, parity: tuple[int, int]) -> None:
        left, top = after.left + ((after.left ^ parity[0]) & 1), after.top + ((after.top ^ parity[1]) & 1)
        count = (after.right - left + 1) // 2, (after.bottom - top + 1) // 2
        if min(count) < 1:
            return
        run, tables = self._run, self._tables
        place = whole.width, left - whole.left, top - whole.top, *count
        run(
            "correct", (-(-count[0] // self._at_once), count[1]), held["texel"], held["r"], held["colour"],
            tables["links"], tables["records"], tables["offsets"], tables["basis"], tables["spacing"], self._side,
            *place, round(16 * (self._settings.penalty - 1)),
        )  # fmt: skip
        run("colour", count, held["texel"], held["r"], tables["stack"], held["colour"], *place)


def paired(basis: np.ndarray) -> np.ndarray:
    """The basis as cl/multiscale.cl reads it: pairs of rows (L, a) and (b, 0), dimension by dimension.

    For every tap of a neighbourhood, and at last for the sum of all.
    """
    taps = basis.reshape(25, 3, DIMS)
    rows = np.zeros((26, 4, DIMS), np.int16)
    rows[:25, :3], rows[25, :3] = taps, taps.sum(0, dtype=np.int16)  # at most 5 * 4096: the columns have length 4096
    return np.ascontiguousarray(rows.reshape(26, 2, 2, DIMS).transpose(0, 1, 3, 2))
