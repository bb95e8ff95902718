# SPDX-License-Identifier: Apache-2.0
"""Image quilting as it is written: patch by patch, on plain arrays, pixels of the exemplar by their coordinates."""

from __future__ import annotations

import numpy as np

from oiiotex.engine.core.source_map import NONE
from oiiotex.synthesis.patchmatch.field import hash_at
from oiiotex.synthesis.quilting.quilt_plan import Grid, QuiltPlan

COARSE, SHORTLIST, DRAWS = 4, 8, 4
OFTEN = 3
LEFT, TOP, RIGHT, BOTTOM = range(4)


def below(bits, n: int) -> int:
    return (int(bits) * n) >> 32


class Oracle:
    """Decides the cells of a grid wave by wave, without labels."""

    def __init__(
        self, lab: np.ndarray, grid: Grid, table, keys: np.ndarray, rules, use_unit: int, step_unit=0, in_step=None
    ):
        self.lab, self.grid, self.table, self.keys, self.rules = lab.astype(np.int64), grid, table, keys, rules
        self.use_unit, self.step_unit, self.in_step = use_unit, step_unit, in_step
        self.square = max(1, grid.step // 6)
        self.shown = np.zeros((len(lab) // self.square + 1, lab.shape[1] // self.square + 1), np.int64)
        self.shares = np.zeros(self.shown.shape)
        self.taken: dict[int, tuple[range, list[int]]] = {}  # of a key: keys whose patches are taken, and these
        for key in np.unique(keys).tolist():
            showing = np.count_nonzero(keys == key) * (grid.step // self.square) ** 2
            first, second = table.keys[key].tolist()
            self.taken[key] = self.patches_of(range(key, key + 1))
            if first == second and showing > OFTEN * max(1, rules.reuse) * self.reached(key).sum():
                alike = np.flatnonzero(table.keys[:, 0] == first).tolist()
                self.taken[key] = self.patches_of(range(alike[0], alike[-1] + 1))
            can = self.reached(key)
            self.shares[can] += showing / can.sum()
        self.shares = np.rint(256 * rules.reuse * self.shares).astype(np.int64)
        self.progress = 0
        self.plan = QuiltPlan.empty(grid)
        h, w = lab.shape[0] // COARSE * COARSE, lab.shape[1] // COARSE * COARSE
        squares = self.lab[:h, :w].reshape(h // COARSE, COARSE, w // COARSE, COARSE, 3)
        self.coarse = (squares.sum((1, 3)) + 8) >> 4

    def patches_of(self, keys: range) -> tuple[range, list[int]]:
        t = self.table
        return keys, [at for key in keys for at in t.offsets[t.starts[key] : t.starts[key + 1]].tolist()]

    def reached(self, key: int) -> np.ndarray:
        """The squares that patches of a key show."""
        can = np.zeros(self.shown.shape, bool)
        for at in self.taken[key][1]:
            can[self.squares(at)] = True
        return can

    def fits(self, key: int, y: int, x: int) -> bool:
        height, width = self.table.key_map.shape
        return 0 <= y < height and 0 <= x < width and int(self.table.key_map[y, x]) in self.taken[key][0]

    # neighbors: (i, j) or None, and how far the patch is from them
    def neighbor(self, i: int, j: int, side: int):
        g = self.grid
        rows, columns = g.shape
        if side in (LEFT, RIGHT):
            other = j + (1 if side == RIGHT else -1)
            if not 0 <= other < columns:
                if not g.wrap_x:
                    return None
                other %= columns
            return i, other
        other = i + (1 if side == BOTTOM else -1)
        if not 0 <= other < rows:
            if not g.wrap_y:
                return None
            other %= rows
        return other, j

    def step(self, places: np.ndarray, a: int, b: int, size: int) -> int:
        return int(places[b] - places[a]) + (size if b <= a else 0)

    def placed(self, cell) -> bool:
        return cell is not None and self.plan.offsets[cell] != NONE

    def pixel(self, cell, ly: int, lx: int) -> tuple[int, int]:
        at = int(self.plan.offsets[cell])
        return (at >> 16) + ly, (at & 0xFFFF) + lx

    def in_row(self, i: int, j: int, ly: int, lx: int) -> tuple[int, int]:
        """The source among the cells of one row."""
        g = self.grid
        while True:
            right = self.neighbor(i, j, RIGHT)
            if not self.placed(right):
                break
            step = self.step(g.xs, j, right[1], g.width)
            if lx < step:
                break
            lx, j = lx - step, right[1]
        if lx < g.overlap and lx < self.plan.vertical[i, j, ly]:
            left = self.neighbor(i, j, LEFT)
            return self.pixel(left, ly, lx + self.step(g.xs, left[1], j, g.width))
        return self.pixel((i, j), ly, lx)

    def under(self, i: int, j: int, ly: int, lx: int) -> tuple[int, int]:
        """The source of a pixel of cell (i, j) if the cell were not there."""
        g = self.grid
        left, up = self.neighbor(i, j, LEFT), self.neighbor(i, j, TOP)
        if lx < g.overlap and self.placed(left):
            x = lx + self.step(g.xs, left[1], j, g.width)
            if ly >= self.plan.horizontal[left][x]:
                return self.pixel(left, ly, x)
        return self.in_row(up[0], j, ly + self.step(g.ys, up[0], i, g.height), lx)

    def source(self, y: int, x: int) -> tuple[int, int]:
        """The source of an output pixel."""
        g = self.grid
        j = int(np.searchsorted(g.xs, x, "right")) - 1
        i = int(np.searchsorted(g.ys, y, "right")) - 1
        if g.wrap_y and y >= g.height + g.ys[0]:
            i, y = 0, y - g.height
        ly, lx = y - int(g.ys[i]), x - int(g.xs[j])
        if lx >= self.plan.vertical[i, j, ly] and ly >= self.plan.horizontal[i, j, lx]:
            return self.pixel((i, j), ly, lx)
        return self.under(i, j, ly, lx)

    def surroundings(self, i: int, j: int):
        """The overlaps of a cell as an image, and a mask of where they are."""
        g = self.grid
        sides = [self.placed(self.neighbor(i, j, side)) for side in range(4)]
        image, there = np.zeros((g.patch, g.patch, 3), np.int64), np.zeros((g.patch, g.patch), bool)
        corners = {LEFT: (0, 0), TOP: (0, 0), RIGHT: (0, g.patch), BOTTOM: (g.patch, 0)}
        if sides[RIGHT]:
            corners[RIGHT] = (0, self.step(g.xs, j, self.neighbor(i, j, RIGHT)[1], g.width))
        if sides[BOTTOM]:
            corners[BOTTOM] = (self.step(g.ys, i, self.neighbor(i, j, BOTTOM)[0], g.height), 0)
        right, bottom = corners[RIGHT][1], corners[BOTTOM][0]
        for ly in range(g.patch):
            for lx in range(g.patch):
                if (sides[LEFT] and lx < g.overlap) or (sides[TOP] and ly < g.overlap):
                    at = self.under(i, j, ly, lx)
                elif right <= lx < right + g.overlap:
                    at = self.pixel(self.neighbor(i, j, RIGHT), ly, lx - right)
                elif bottom <= ly < bottom + g.overlap:
                    at = self.pixel(self.neighbor(i, j, BOTTOM), ly - bottom, lx)
                else:
                    continue
                image[ly, lx], there[ly, lx] = self.lab[at], True
        return image, there, sides, right, bottom

    def squares(self, at: int):
        """Those that a patch shows."""
        n, to = self.grid.step // self.square, self.grid.overlap // 2 + self.square // 2
        y, x = ((at >> 16) + to) // self.square, ((at & 0xFFFF) + to) // self.square
        return slice(y, y + n), slice(x, x + n)

    def use(self, at: int) -> int:
        due = np.maximum(256, self.shares[self.squares(at)] * self.progress >> 16)
        over = 256 * self.shown[self.squares(at)] - due
        return int((np.clip(np.where(over > 0, over // 16, 0), 0, 1023) ** 2).sum())

    def cycles(self, i: int, j: int, at: int) -> list[int]:
        """How a patch lies on the exemplar's lattice beside the cell, in 2^-32, and half a bin more."""
        p = [int(n) for n in self.in_step.phases(patch=self.grid.patch)]
        x, y, ex, ey = int(self.grid.xs[j]), int(self.grid.ys[i]), at & 0xFFFF, at >> 16
        parts = (p[2 * n] * ex + p[2 * n + 1] * ey - p[2 * n + 4] * x - p[2 * n + 5] * y + p[8 + n] for n in (0, 1))
        return [part % 2**32 for part in parts]

    def offset_price(self, i: int, j: int, at: int) -> int:
        if self.in_step is None:
            return 0
        u, v = self.cycles(i, j, at)
        return self.step_unit * int(self.in_step.table(1 << 16)[v >> 26, u >> 26])

    def moved(self, i: int, j: int, key: int, at: int) -> int:
        """To where it is in step."""
        off = [(n - 2**25 + 2**31) % 2**32 - 2**31 for n in self.cycles(i, j, at)]
        x, y = ((off @ self.in_step.steps().astype(np.int64) + 2**39) >> 40).tolist()
        y, x = (at >> 16) - y, (at & 0xFFFF) - x
        return y << 16 | x if self.fits(key, y, x) else at

    def candidates(self, i: int, j: int, key: int) -> list[int | None]:
        seed, patches = self.rules.seed, self.taken[key][1]
        count = len(patches)
        ij = np.array([i]), np.array([j])
        found: list[int | None] = []
        for k in range(self.rules.candidates):
            if count <= self.rules.candidates:
                turn = below(hash_at(seed, 0x917, *ij)[0], count)
                draws = [(k + turn) % count] if k < count else []
            else:
                draws = [below(hash_at(seed, 0x10000 + DRAWS * k + d, *ij)[0], count) for d in range(DRAWS)]
            places = [patches[draw] for draw in draws]
            if self.in_step is not None and count > self.rules.candidates and k % 2 == 0:
                places = [self.moved(i, j, key, at) for at in places]
            found.append(min(places, key=self.use, default=None))
        return found

    def first_cost(self, at: int, around) -> int:
        image, there, sides, right, bottom = around
        g = self.grid
        side, overlap = g.patch // COARSE, g.overlap // COARSE
        y = min(((at >> 16) + 2) // COARSE, self.coarse.shape[0] - side)
        x = min(((at & 0xFFFF) + 2) // COARSE, self.coarse.shape[1] - side)
        small = image[: side * COARSE, : side * COARSE].reshape(side, COARSE, side, COARSE, 3).sum((1, 3)) + 8 >> 4
        error = ((small - self.coarse[y : y + side, x : x + side]) ** 2).sum(-1)
        v, u = np.mgrid[:side, :side]
        use = (sides[TOP] & (v < overlap)) | (sides[LEFT] & (u < overlap))
        whole = there[: side * COARSE, : side * COARSE].reshape(side, COARSE, side, COARSE).all((1, 3))
        # squares that lie in the lower and right overlaps as a whole
        use |= sides[BOTTOM] & (COARSE * v >= bottom) & (COARSE * (v + 1) <= bottom + g.overlap) & whole
        use |= sides[RIGHT] & (COARSE * u >= right) & (COARSE * (u + 1) <= right + g.overlap) & whole
        return COARSE**2 * int(error[use].sum())

    def cost(self, at: int, around) -> int:
        image, there, *_ = around
        p = self.grid.patch
        y, x = at >> 16, at & 0xFFFF
        return int(((image - self.lab[y : y + p, x : x + p]) ** 2).sum(-1)[there].sum())

    def best(self, i: int, j: int, key: int):
        around = self.surroundings(i, j)
        tried = self.candidates(i, j, key)
        here = [at for at in tried if at is not None]
        first = [self.first_cost(at, around) + self.offset_price(i, j, at) for at in here]
        prices = [self.use_unit * self.use(at) for at in here]

        def whole_cost(at: int) -> int:
            return self.cost(at, around) + self.use_unit * self.use(at) + self.offset_price(i, j, at)

        short = np.argsort(np.add(first, prices), kind="stable")[:SHORTLIST].tolist()
        number = min(short, key=lambda k: whole_cost(here[k]))
        found, least = here[number], whole_cost(here[number])
        step = self.rules.reach
        while step > 0 and least > 0 and any(around[2]):
            cy, cx = found >> 16, found & 0xFFFF
            for k in range(9):
                y, x = cy + step * (k // 3 - 1), cx + step * (k % 3 - 1)
                if k == 4 or not self.fits(key, y, x):
                    continue
                there = whole_cost(y << 16 | x)
                if there < least:
                    found, least = y << 16 | x, there
            step //= 2
        return found, number, here, first, prices

    def cut(self, i: int, j: int, upper: bool) -> None:
        """Dynamic programming over the squared differences of the two patches (Efros & Freeman 2001, section 2.1)."""
        g = self.grid
        error = np.zeros((g.patch, g.overlap), np.int64)
        for s in range(g.patch):
            for t in range(g.overlap):
                ly, lx = (t, s) if upper else (s, t)
                old, new = self.lab[self.under(i, j, ly, lx)], self.lab[self.pixel((i, j), ly, lx)]
                error[s, t] = ((old - new) ** 2).sum()
        for s in range(1, g.patch):
            before = np.pad(error[s - 1], 1, constant_values=2**60)
            error[s] += np.minimum(np.minimum(before[:-2], before[1:-1]), before[2:])
        cut = np.zeros(g.patch, np.uint8)
        cut[-1] = error[-1].argmin()
        for s in range(g.patch - 2, -1, -1):
            low, high = max(int(cut[s + 1]) - 1, 0), min(int(cut[s + 1]) + 2, g.overlap)
            cut[s] = low + error[s, low:high].argmin()
        (self.plan.horizontal if upper else self.plan.vertical)[i, j] = cut

    def run(self) -> QuiltPlan:
        rows, columns = self.grid.shape
        for wave in range(2 * (rows - 1) + columns):
            cells = [(i, wave - 2 * i) for i in range(rows) if 0 <= wave - 2 * i < columns]
            self.progress = (np.count_nonzero(self.plan.offsets != NONE) << 16) // (rows * columns)
            found = {cell: self.best(*cell, int(self.keys[cell])) for cell in cells}
            for cell in cells:
                self.take(cell, *found[cell])
            near = {cell: [self.neighbor(*cell, side) for side in range(4)] for cell in cells}
            for cell in cells:
                for side in (LEFT, TOP):
                    if self.placed(near[cell][side]):
                        self.cut(*cell, side == TOP)
            for side in (RIGHT, BOTTOM):
                for cell in cells:
                    if self.placed(near[cell][side]):
                        self.cut(*near[cell][side], side == BOTTOM)
        return self.plan

    def take(self, cell, at: int, number: int, tried: list[int], first: list[int], prices: list[int]) -> None:
        if self.use_unit * self.use(at) > prices[number]:
            shown = [at if k == number else other for k, other in enumerate(tried)]
            at = shown[int(np.argmin([c + self.use_unit * self.use(o) for c, o in zip(first, shown, strict=True)]))]
        self.shown[self.squares(at)] += 1
        self.plan.offsets[cell] = at
