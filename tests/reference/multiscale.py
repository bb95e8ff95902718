# SPDX-License-Identifier: Apache-2.0
"""HRRG08 sections 4 and 5 pixel by pixel on one large window of every level: the oracle of cl/multiscale.cl."""

from __future__ import annotations

import numpy as np

from tests.reference.patchmatch import pcg

FIRST_CORRECTED = 2


def place_hash(x, y, level, seed):
    high, low = (lambda v: (v >> 32) & 0xFFFFFFFF), (lambda v: v & 0xFFFFFFFF)
    bits = pcg(high(x) + pcg(level + pcg(seed)))
    return pcg(low(x) + pcg(low(y) + pcg(high(y) + bits)))


class Oracle:
    """Pixels are dictionaries by place: no windows, no halo. `ask` makes what is asked for and all it depends on."""

    def __init__(self, analysis, settings):
        self.a, self.s = analysis, settings
        self.stack = analysis.stacks.planes[..., :3].astype(np.int64)
        self.levels, self.n = analysis.stacks.levels, analysis.stacks.planes.shape[1]
        self.basis = analysis.basis.astype(np.int64)
        order = []
        for n in range(settings.passes):
            order += [(0, 0), (1, 1), (0, 1), (1, 0)] if n % 2 == 0 else [(0, 1), (1, 0), (0, 0), (1, 1)]
        self.order, self.known, self.shown = order, {}, 0

    def in_root(self, level, x, y):
        """Whether a pixel is the root's own."""
        return level <= self.s.root_level and min(x, y) >= 0 and max(x, y) < 1 << level

    def ask(self, level, sub, x, y):
        """(texel (number, y, x), R) of a pixel after `sub` subpasses of a level."""
        key = level, sub, x, y
        if key not in self.known:
            if sub == 0:
                self.known[key] = self.upsampled(level, x, y)
            elif (x & 1, y & 1) != self.order[sub - 1] or (self.in_root(level, x, y) and not self.leads(level)):
                self.known[key] = self.ask(level, sub - 1, x, y)
            else:
                self.known[key] = self.corrected(level, sub - 1, x, y)
        return self.known[key]

    def leads(self, level):
        """Whether it is the root's finest level, and the next one is shown."""
        return level == self.s.root_level < self.shown

    def done(self, level, x, y):
        return self.ask(level, len(self.order) if level >= FIRST_CORRECTED else 0, x, y)

    def upsampled(self, level, x, y):
        if level == 0:
            return (0, self.n // 2, self.n // 2), np.zeros(3, np.int64)
        sx, sy = 2 * (x & 1) - 1, 2 * (y & 1) - 1
        px, py = x >> 1, y >> 1
        (number, v, u), r = self.done(level - 1, px, py)
        first = self.levels.first_left if self.leads(level) else self.levels.first_finer
        finer = (first if level <= self.s.root_level else self.levels.finer)[number]
        h = self.levels.spacing(finer)
        if finer != number:
            u, v = u + (h * sx) // 2, v + (h * sy) // 2
        rho = self.s.rho(level)
        own = self.in_root(level, x, y)
        if rho and not own:
            width, height = self.s.period(level)
            bits = place_hash(x % width if width else x, y % height if height else y, level, self.s.seed)
            u += int(np.floor(h * (rho / 256) * ((bits >> 16) - 32768) / 32768 + 0.5))
            v += int(np.floor(h * (rho / 256) * ((bits & 0xFFFF) - 32768) / 32768 + 0.5))
        others = [self.done(level - 1, px + a, py + b)[1] for a, b in ((sx, 0), (0, sy), (sx, sy))]
        r = (9 * r + 3 * others[0] + 3 * others[1] + others[2]) * round(256 * self.s.kept)
        r = np.zeros(3, np.int64) if own else np.clip((r + 2048) >> 12, -8191, 8191)
        return (finer, self.within(finer, v), self.within(finer, u)), r

    def within(self, number, at):
        """A coordinate inside its exemplar: wrapped where the exemplar tiles, otherwise mirrored."""
        tiles = self.a.stacks.periodic[number]
        return at % self.n if tiles else min(at % (2 * self.n), 2 * self.n - 1 - at % (2 * self.n))

    def color(self, pixel):
        return self.stack[pixel[0]] + pixel[1]

    def corrected(self, level, sub, x, y):
        r = self.ask(level, sub, x, y)[1]
        near = [(a, b) for b in range(-2, 3) for a in range(-2, 3)]
        colors = np.array([self.color(self.ask(level, sub, x + a, y + b)) - r for a, b in near])
        wanted = np.clip((colors.reshape(75) @ self.basis + 2048) >> 12, -5790, 5790)
        best, chosen = None, None
        around = [(0, 0), (1, 0), (-1, 1), (0, 1), (1, 1), (-1, -1), (0, -1), (1, -1), (-1, 0)]
        for k in range(2):
            for a, b in around:
                number, v, u = self.ask(level, sub, x + a, y + b)[0]
                h = self.levels.spacing(number)
                at = number, (v - b * h) % self.n * self.n + (u - a * h) % self.n, k
                cost = int(((wanted - self.a.records[at].astype(np.int64)) ** 2).sum())
                cost += (cost >> 4) * round(16 * (self.s.penalty - 1)) if k else 0
                if best is None or cost < best:
                    best, chosen = cost, at
        number, place = divmod(int(self.a.links[chosen]), self.n**2)
        r = np.clip(r + self.a.offsets[chosen][:3].astype(np.int64), -8191, 8191)
        return (number, *divmod(place, self.n)), r

    def window(self, level, left, top, right, bottom):
        """Texel numbers and R, as `multiscale.Synthesizer` gives them."""
        self.known, self.shown = {}, level
        texel = np.zeros((bottom - top, right - left), np.uint32)
        offset = np.zeros((bottom - top, right - left, 3), np.int64)
        for y in range(top, bottom):
            for x in range(left, right):
                (number, v, u), offset[y - top, x - left] = self.done(level, x, y)
                texel[y - top, x - left] = number * self.n**2 + v * self.n + u
        return texel, offset
