# SPDX-License-Identifier: Apache-2.0
"""The contrast of endless zooms: how much of a transfer function each level keeps.

Not in HRRG08. A turn of a loop adds the exemplar's finest octaves and keeps the coarse ones as transfer functions.
These fade slightly on every level, so that colors stay bounded. How much may fade without a loss of contrast
depends on how much contrast an exemplar has in its finest octaves. This is tested on small windows of the zoom
itself. All arithmetic is in integers, so every device decides the same.
"""

from __future__ import annotations

from pathlib import Path

from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.io.disk_cache import cached_arrays, hash_of
from .candidate_sets import Analysis
from .synthesizer import KEPT_IN_LOOPS, MOST_LEVEL, Synthesizer

_VERSION = "oiiotex contrast 1"
_SHARES = (KEPT_IN_LOOPS, 0.90, 0.94)  # per level; with .97 a zoom into pebbles has 1.3 times their contrast
_DEEPER = (12, 32)  # tested levels below the exemplar's own
_SIDE, _APART, _WINDOWS = 128, 4096, 2  # px of a window, distance along x in px, number of windows
_FLOOR, _MOST = 81, 156  # percent of the exemplar's variance on the worst level: .9 and 1.25 of its spread


def kept_in(maker: Synthesizer, analysis: Analysis) -> float:
    """Share of a transfer function that a level keeps: the minimum that preserves `_FLOOR` of the exemplar's contrast.

    It stops before colors become unbounded: at the share before the one with which a level has more than `_MOST`. If
    several exemplars lead to each other there is no single contrast to preserve.
    """
    levels = analysis.stacks.levels
    if len({exemplar for exemplar, _ in levels.stacks}) > 1:
        return KEPT_IN_LOOPS
    finest = max(range(len(levels.stacks)), key=lambda n: levels.stacks[n][1])
    own = _variance(analysis.stacks.planes[finest][analysis.stacks.usable[finest]][:, 0].astype(np.int64))
    deep = [min(levels.finest + more, MOST_LEVEL) for more in _DEEPER]
    best = _SHARES[0]
    for share in _SHARES:
        tried = maker.keeping(share)
        found = [_variance(_seen(tried, analysis, level)) for level in deep]
        if any(_more(one, own, _MOST) for one in found):
            break
        best = share
        if all(_more(one, own, _FLOOR) for one in found):
            break
    return best


def _seen(maker: Synthesizer, analysis: Analysis, level: int) -> np.ndarray:
    """L of some windows of a level, in steps."""
    light, seen = analysis.stacks.planes[..., 0].reshape(-1), []
    for n in range(_WINDOWS):
        state = maker.window(level, Window.sized(_APART * n, 0, _SIDE, _SIDE))
        own = light[state.texel].astype(np.int64)
        seen.append(own if state.offset is None else own + state.offset[..., 0])
    return np.stack(seen)


def _variance(values: np.ndarray) -> tuple[int, int]:
    """The squared count times the variance, and the squared count: integers."""
    return values.size * int(np.square(values).sum()) - int(values.sum()) ** 2, values.size**2


def _more(one: tuple[int, int], own: tuple[int, int], per_cent: int) -> bool:
    """Whether a variance is at least that percentage of another."""
    return 100 * one[0] * own[1] >= per_cent * own[0] * one[1]


def with_contrast(maker: Synthesizer, analysis: Analysis, folder: Path | None, key: str) -> Synthesizer:
    """A maker of endless zooms that preserves the exemplar's contrast. A folder caches the result under its key.

    Neither the seed nor repetition matters: all zooms into an exemplar keep the same share.
    """
    name = hash_of(_VERSION, key, _SHARES, _DEEPER, _SIDE, _APART, _WINDOWS, _FLOOR, _MOST)
    (kept,) = cached_arrays(folder, name, lambda: (np.array([kept_in(maker.plainly(), analysis)]),))
    return maker.keeping(float(kept[0]))
