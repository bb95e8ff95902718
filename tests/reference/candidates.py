# SPDX-License-Identifier: Apache-2.0
"""The search of cl/candidates.cl in plain Python, and the exact answer to HRRG08 eq. 2."""

from __future__ import annotations

import numpy as np

from tests.reference.patchmatch import pcg

NONE = 0xFFFFFFFF


def hash_at(seed, step, y, x):
    return pcg(int(x) + pcg(int(y) + pcg(int(step) + pcg(int(seed)))))


def below(bits, n):
    return (bits * n) >> 32


class Oracle:
    """One level's search: projections (levels, texels, 16), usable (levels, texels), admissible [(level, r)]."""

    def __init__(self, projections, usable, admissible, excluded, disc, level, side):
        self.q, self.usable, self.a = projections.astype(np.int64), usable, admissible
        self.excluded, self.disc, self.level, self.side = excluded, disc, level, side
        self.n = 1 << side

    def texel(self, level, y, x):
        return (level << 2 * self.side) | ((y & (self.n - 1)) << self.side) | (x & (self.n - 1))

    def parts(self, t):
        return t >> 2 * self.side, (t >> self.side) & (self.n - 1), t & (self.n - 1)

    def cost(self, p, t):
        """Squared distance, or None where it may not be taken."""
        level, y, x = self.parts(t)
        if not self.usable[level, y * self.n + x]:
            return None
        if self.excluded[p] != NONE:
            other, v, u = self.parts(int(self.excluded[p]))
            dy, dx = (min((a - b) % self.n, (b - a) % self.n) for a, b in ((y, v), (x, u)))
            if other == level and dy * dy + dx * dx < self.disc:
                return None
        return int(((self.q[self.level, p] - self.q[level, y * self.n + x]) ** 2).sum())

    def better(self, best, p, t):
        if t == best[0]:
            return best
        cost = self.cost(p, t)
        return best if cost is None or cost >= best[1] else (t, cost)

    def anywhere(self, best, p, bits, into):
        return self.better(best, p, self.texel(into, bits >> 16, bits & 0xFFFFFFFF))

    def start(self):
        self.best = []
        for p in range(self.n**2):
            y, x = divmod(p, self.n)
            best = (self.texel(self.a[0][0], y, x), NONE)
            bits = hash_at(0, 0x5EED0000 + self.level, y, x)
            for k in range(16):
                bits = pcg(bits + k)
                into = self.a[below(bits, len(self.a))][0]
                bits = pcg(bits)
                best = self.anywhere(best, p, bits, into)
            self.best.append(best)

    def propagate(self, jump):
        old, r = list(self.best), dict(self.a)
        for p in range(self.n**2):
            y, x = divmod(p, self.n)
            for dy, dx in ((0, -jump), (0, jump), (-jump, 0), (jump, 0)):
                level, v, u = self.parts(old[((y + dy) % self.n) * self.n + (x + dx) % self.n][0])
                k = 1 << r.get(level, 0)
                self.best[p] = self.better(self.best[p], p, self.texel(level, v - dy * k, u - dx * k))

    def search(self, step):
        for p in range(self.n**2):
            y, x = divmod(p, self.n)
            bits = hash_at(0, (self.level << 16) + step, y, x)
            for k in range(2):
                bits = pcg(bits + k)
                into = self.a[below(bits, len(self.a))][0]
                bits = pcg(bits)
                self.best[p] = self.anywhere(self.best[p], p, bits, into)
            reach = self.n // 4
            while reach >= 1:
                bits = pcg(bits + reach)
                dx = below(bits, 2 * reach + 1) - reach
                bits = pcg(bits)
                dy = below(bits, 2 * reach + 1) - reach
                level, v, u = self.parts(self.best[p][0])
                self.best[p] = self.better(self.best[p], p, self.texel(level, v + dy, u + dx))
                reach //= 2

    def run(self, rounds, jumps):
        self.start()
        for turn in range(rounds):
            for jump in jumps:
                self.propagate(jump)
            self.search(turn)
        return [NONE if c == NONE else t for t, c in self.best]


def exact(projections, usable, admissible, excluded, disc, level, side):
    """The smallest squared distance that there is for every texel of a level; HRRG08 eq. 2 on projections."""
    n = 1 << side
    own = projections[level].astype(np.float64)
    y, x = np.divmod(np.arange(n * n), n)
    best = np.full(n * n, np.inf)
    for into, _ in admissible:
        other = projections[into].astype(np.float64)
        d = (own**2).sum(1)[:, None] + (other**2).sum(1)[None] - 2 * own @ other.T
        d[:, ~usable[into]] = np.inf
        at = excluded.astype(np.int64)
        same = (at != NONE) & (at >> 2 * side == into)
        v, u = (at >> side) & (n - 1), at & (n - 1)
        dy, dx = np.abs(v[:, None] - y[None]), np.abs(u[:, None] - x[None])
        near = np.minimum(dy, n - dy) ** 2 + np.minimum(dx, n - dx) ** 2 < disc
        d[near & same[:, None]] = np.inf
        best = np.minimum(best, d.min(1))
    return best
