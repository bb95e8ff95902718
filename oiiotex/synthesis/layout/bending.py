# SPDX-License-Identifier: Apache-2.0
"""How far a strip must be bent so that its end continues in its start: courses that are seen in perspective.

A tilt moves all columns alike, and is leveled. Courses that converge meet their other ends at a different distance in
each column. As in texture synthesis that matches features and deforms patches along them (Wu and Yu 2004), columns are
moved little by little from one seam to the next, so that every joint meets a joint. The path of the distances is found
by dynamic programming over columns. All costs are sums of integers.
"""

from __future__ import annotations

from ...engine.deferred import np
from .periods import MOST_RISE, Jumps, Level, cheapest_jumps, levels_of
from .strip import PhotoStrip

_SIDE = 200  # px, longer side of the level on which distances are found
_AROUND = 64  # the level's width over the number of columns to each side that have about the same distance
_CHANGE = 2  # a distance that changes by a pixel costs 1/2 column more
_MOST = 2  # times the median: larger differences count as this
_FITS = 0.87  # of the costs without bending: bricks in perspective have .79 and .86, 38 other photos .88 and more


def bent_jumps(strip: PhotoStrip, levels: list[Level], jumps: Jumps) -> tuple[PhotoStrip, Jumps] | None:
    """The strip bent for its only jump, and that jump; None: there are several, or its seam does not get cheaper."""
    (jump, *others) = jumps.lengths
    distances = None if others else bend_of(strip, levels, jump)
    if distances is None:
        return None
    bent = strip.bent(distances, jump)
    after = cheapest_jumps(bent, levels_of(bent), jump)
    return (bent, after) if after.cost < jumps.cost else None


def bend_of(strip: PhotoStrip, levels: list[Level], jump: int) -> np.ndarray | None:
    """The distances between both ends of each column's course, (width,) int px; None: bending does not help.

    Parameters
    ----------
    strip : PhotoStrip
    levels : list of Level
        Of the strip.
    jump : int
        Rows after which its end continues in its start.
    """
    level = [one for one in levels if max(one.invalid.shape) <= _SIDE][-1]
    length, width = level.invalid.shape
    most = int(MOST_RISE * width)
    row = round(jump * length / strip.length)
    if not 0 < row < length or most == 0:
        return None
    apart = level.differences(row, list(range(-most, most + 1)), min(length - row, row))
    unlike = np.rint(np.sqrt(np.maximum(apart, 0))).astype(np.int64)
    unlike = np.minimum(unlike, _MOST * int(np.median(unlike[:, most])))  # also where a pixel is not usable
    costs = unlike.sum(0)
    costs = _summed(np.where(apart[0] < 0, costs.max(), costs).T, max(1, width // _AROUND), level.closed)
    change = int(costs[:, most].sum()) // (_CHANGE * width)
    path = _cheapest(np.concatenate([costs] * 3), change)[width : 2 * width] if level.closed else None
    path = _cheapest(costs, change, None if path is None else int(path[0]))
    if costs[np.arange(width), path].sum() >= _FITS * costs[:, most].sum():
        return None
    around = max(1, width // _AROUND)
    smooth = _summed(_summed((path - most)[:, None], around, level.closed), around, level.closed)[:, 0]
    places = (np.arange(strip.width) + 0.5) * (width / strip.width) - 0.5
    scale = strip.width / (width * (2 * around + 1) ** 2)
    return np.rint(np.interp(places, np.arange(width), smooth) * scale).astype(np.int64)


def _summed(lines: np.ndarray, by: int, closed: bool) -> np.ndarray:
    """Sums over `by` lines to each side, (n, ...) int each."""
    at = np.arange(-by - 1, len(lines) + by)
    table = lines[at % len(lines) if closed else at.clip(0, len(lines) - 1)].cumsum(0)
    return table[2 * by + 1 :] - table[: -2 * by - 1]


def _cheapest(costs: np.ndarray, change: int, end: int | None = None) -> np.ndarray:
    """The cheapest path through (n, states) int costs, which moves by a state at most: (n,). `end`: its ends."""
    far = int(costs.sum()) + change * costs.size
    total = costs[0].copy()
    if end is not None:
        total[np.arange(len(total)) != end] = far
    came = np.zeros(costs.shape, np.int64)
    for n in range(1, len(costs)):
        ways = np.stack([total, np.append(far, total[:-1] + change), np.append(total[1:] + change, far)])
        which = ways.argmin(0)
        came[n] = np.array([0, -1, 1])[which]
        total = ways.min(0) + costs[n]
    path = [int(total.argmin()) if end is None else end]
    for n in range(len(costs) - 1, 0, -1):
        path.append(path[-1] + int(came[n, path[-1]]))
    return np.array(path[::-1])
