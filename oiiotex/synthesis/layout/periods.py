# SPDX-License-Identifier: Apache-2.0
"""Jumps along a strip with the cheapest minimum-error seams across the overlap, found coarse to fine.

All costs are sums of integers, and of equal ones the first is taken.
"""

from __future__ import annotations

import itertools
import math
import operator
from dataclasses import dataclass

from ...engine.deferred import np
from .strip import PhotoStrip

COARSEST = 96  # px, longer side on the level where all jumps are compared
WIDEST = 1024  # px of a level across the jump: a seam that is longer is averaged
LEAST, MOST = 0.45, 0.94  # of the strip's length: jumps
LEAST_ALONE = 0.6  # the same for the only jump of a tile: it shows more of the photo
MOST_RISE = 1 / 8  # of the jump: the tilt of a photo taken by hand
_LOSS = 4  # a jump that shows nothing new would cost 1/4 more
_TILT = 2  # one that needs the greatest rise, 1/2 more: leveled lines get steps
_REFINED = 1  # px by which a jump may change on a finer level
_EDGES = 2  # weight of the differences of lightness between neighbors: joints count as much as colors
_INVALID = 1 << 24  # cost of a pixel that is not usable
_ENDLESS = 1 << 50
_AT_ONCE = 1 << 17, 1 << 22  # px of planes that are compared at once, and whose paths are found at once
_SMOOTHED = 3  # px around a pixel that are compared with it: joints at the seam, too, must meet


@dataclass(frozen=True)
class Jumps:
    """Lengths of the jumps around a tile, px, and the cost of their seams per pixel, in variances of the photo."""

    lengths: tuple[int, ...]
    cost: float


def leveled_jumps(strip: PhotoStrip, length: int | None) -> tuple[PhotoStrip, list[Level], Jumps]:
    """The strip, leveled along its best jump, its levels, and the jumps around a tile of that length.

    `length` px; None: one jump, of the best length.
    """
    levels = levels_of(strip)
    leveled = strip.leveled(*rise_of(strip, levels))
    if leveled is not strip:
        levels = levels_of(leveled)
    return leveled, levels, cheapest_jumps(leveled, levels, length)


def levels_of(strip: PhotoStrip) -> list[Level]:
    """The strip at sizes a factor of 2 apart, coarse to fine."""
    count = 1 + max(0, math.ceil(math.log2(max(strip.length, strip.width) / COARSEST)))
    return [Level.of(strip, number) for number in range(count)]


def rise_of(strip: PhotoStrip, levels: list[Level]) -> tuple[int, int]:
    """The rise of the strip's best jump along its columns, and the length of the jump, px."""
    level, *others = levels
    length, rise, _ = level.best(LEAST_ALONE, tilted=True)[0]
    for finer in others:
        (longer, wider), (shorter, narrower) = finer.invalid.shape, level.invalid.shape
        length, rise = finer.refined(round(length * longer / shorter), round(rise * wider / narrower))
        level = finer
    return round(rise * strip.width / level.invalid.shape[1]), length


def cheapest_jumps(strip: PhotoStrip, levels: list[Level], length: int | None) -> Jumps:
    """The jumps around a tile of that length; None: one jump, of the best length."""
    level, *others = levels
    if length is None:
        jump = level.best(LEAST_ALONE)[0][0]
        jumps = [jump]
    else:
        count = max(1, math.ceil(length / (MOST * strip.length)))
        jumps = level.summing(count, max(count, round(length * level.invalid.shape[0] / strip.length)))
    for finer in others:
        scale = finer.invalid.shape[0] / level.invalid.shape[0]
        level, jumps = finer, [round(jump * scale) for jump in jumps]
        if length is None:
            jumps = [finer.refined(jumps[0], 0, tilted=False)[0]]
    if length is not None:
        jumps[-1] += length - sum(jumps)
    return Jumps(tuple(jumps), max(level.seam_cost(jump) for jump in jumps) / max(level.variance, 1e-9))


@dataclass(frozen=True)
class Level:
    """A strip at a smaller size.

    `colors` (length, width, channels) int32: with the differences of lightness along and across; `invalid`
    (length, width) bool.
    """

    colors: np.ndarray
    invalid: np.ndarray
    closed: bool

    @classmethod
    def of(cls, strip: PhotoStrip, number: int) -> Level:
        """The level of that number, from the coarsest."""
        scale = min(1.0, COARSEST * 2**number / max(strip.length, strip.width))
        length, width = (max(1, round(n * scale)) for n in (strip.length, strip.width))
        colors, share = strip.reduced(length, min(width, WIDEST))
        light = np.pad(colors[..., 0], 1, mode="edge")
        edges = light[2:, 1:-1] - light[:-2, 1:-1], light[1:-1, 2:] - light[1:-1, :-2]
        return cls(np.dstack([colors, *(_EDGES * edge for edge in edges)]), share < 0.5, strip.closed)

    @property
    def variance(self) -> float:
        """Of the colors, summed over channels."""
        return float(self.colors.reshape(-1, self.colors.shape[2]).astype(np.float64).var(0).sum())

    def differences(self, jump: int, rises: list[int], rows: int) -> np.ndarray:
        """Squared differences across a jump with each of the rises, smoothed: (rows, rises, width) int64.

        Outside the photo they are endless, and negative where no path runs.
        """
        length, width = self.invalid.shape
        here, there = min(rows, length - jump), np.arange(width) + np.array(rises)[:, None]
        inside = (there >= 0) & (there < width) | self.closed
        there = there % width
        end, start = slice(here), slice(jump, jump + here)
        apart = (self.colors[end, None] - self.colors[start][:, there]).astype(np.int64)
        cost = np.einsum("...c,...c", apart, apart)
        cost += _INVALID * (self.invalid[end, None] | self.invalid[start][:, there])
        out = np.full((rows, *there.shape), _ENDLESS)
        out[end] = _smoothed(cost, self.closed)
        out[:, ~inside] = -1
        return out

    def best(self, least: float, tilted: bool = False) -> list[tuple[int, int, int]]:
        """All (jump, rise, weighted cost), the cheapest first."""
        length, width = self.invalid.shape
        jumps = range(max(1, math.ceil(least * length)), max(2, int(MOST * length) + 1))
        most = int(MOST_RISE * jumps[0]) if tilted else 0
        each = [(jump, rise) for jump in jumps for rise in sorted(range(-most, most + 1), key=abs)]
        costs = self.path_costs(each)
        weighted = [
            (jump, rise, cost * (_LOSS * length + length - jump) * (_TILT * max(1, most) + abs(rise)))
            for (jump, rise), cost in zip(each, costs.tolist(), strict=True)
        ]
        return sorted(weighted, key=lambda one: one[2])

    def refined(self, jump: int, rise: int, tilted: bool = True) -> tuple[int, int]:
        """The cheapest jump and rise near given ones."""
        length, near = self.invalid.shape[0], range(-_REFINED, _REFINED + 1)
        jumps = [n for n in (jump + d for d in near) if 0 < n < length]
        rises = [rise + d for d in near] if tilted else [rise]
        each = [(n, r) for n in jumps for r in rises]
        return each[int(self.path_costs(each).argmin())]

    def seam_cost(self, jump: int) -> float:
        """Cost of the cheapest seam across a jump, per pixel of its length and of the box that was compared."""
        cost = self.path_costs([(jump, 0)])
        return float(cost[0]) / (self.invalid.shape[1] * (2 * _SMOOTHED + 1) ** 2)

    def summing(self, count: int, total: int) -> list[int]:
        """The cheapest `count` jumps with that sum."""
        length = self.invalid.shape[0]
        jumps = list(range(max(1, min(int(LEAST * length), total // count)), min(length - 1, total) + 1)) or [1]
        costs = self.path_costs([(jump, 0) for jump in jumps])
        spent = np.full(total + 1, _ENDLESS * 2)
        spent[0], chosen = 0, []
        for _ in range(count):
            sums = np.full((len(jumps), total + 1), _ENDLESS * 2)
            for n, (jump, cost) in enumerate(zip(jumps, costs.tolist(), strict=True)):
                if jump <= total:
                    sums[n, jump:] = spent[: total + 1 - jump] + cost
            chosen.append(sums.argmin(0))
            spent = sums.min(0)
        result, left = [], total
        for which in reversed(chosen):
            result.append(jumps[int(which[left])])
            left -= result[-1]
        return result

    def path_costs(self, each: list[tuple[int, int]]) -> np.ndarray:
        """Costs of the cheapest paths across jumps with rises, (n,) int64, as for the whole width."""
        rows = min(max(self.invalid.shape[0] - jump for jump, _ in each), max(jump for jump, _ in each))
        width, costs = self.invalid.shape[1], []
        few, many = (max(1, size // (rows * width)) for size in _AT_ONCE)
        for at in range(0, len(each), many):
            planes = []
            for jump, group in itertools.groupby(each[at : at + many], key=operator.itemgetter(0)):
                rises = [rise for _, rise in group]
                planes += [self.differences(jump, rises[n : n + few], rows) for n in range(0, len(rises), few)]
            costs.append(_cheapest(np.concatenate(planes, 1)))
        return np.concatenate(costs)


def _cheapest(planes: np.ndarray) -> np.ndarray:
    """Costs of the cheapest paths through planes, (rows, n, width) int64 -> (n,); -1 in a column: not counted."""
    rows, n, width = planes.shape
    total, seen = np.zeros((rows + 2, n), np.int64), np.zeros(n, np.int64)
    total[[0, -1]] = _ENDLESS * 2
    for column in range(width):
        cost = planes[:, :, column]
        counts = cost[0] >= 0
        best = np.minimum(np.minimum(total[:-2], total[2:]), total[1:-1]) + cost
        total[1:-1] = np.where(counts, np.minimum(best, _ENDLESS), total[1:-1])
        seen += counts
    return total.min(0) * width // np.maximum(seen, 1)


def _smoothed(cost: np.ndarray, closed: bool) -> np.ndarray:
    """Sums over the box around every pixel of (rows, n, width) planes, of the same shape."""
    side = 2 * _SMOOTHED + 1
    rows, columns = (np.arange(-_SMOOTHED - 1, n + _SMOOTHED) for n in (cost.shape[0], cost.shape[2]))
    columns = columns % cost.shape[2] if closed else columns.clip(0, cost.shape[2] - 1)
    # a table of sums; np.pad and general box sums take most of the time for planes as small as these
    table = cost[rows.clip(0, len(cost) - 1)][..., columns].cumsum(0).cumsum(2)
    return table[side:, :, side:] - table[:-side, :, side:] - table[side:, :, :-side] + table[:-side, :, :-side]
