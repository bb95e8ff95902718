# SPDX-License-Identifier: Apache-2.0
"""PatchMatch said plainly, pixel by pixel: the oracle of cl/patchmatch.cl."""

from __future__ import annotations

import numpy as np

from oiiotex.analysis.regularity.offset_prices import InStep
from oiiotex.synthesis.patchmatch.field import Geometry, hash_at
from oiiotex.synthesis.patchmatch.matcher import JUMPS, Matcher
from oiiotex.synthesis.patchmatch.patch_search import LINKS, WINDOWS, Links

VARIANCE = 20000.0  # of random exemplars


def patch(image: np.ndarray, y: int, x: int, size: int) -> np.ndarray:
    """The patch with its top-left pixel at (y, x), wrapped."""
    rows, columns = np.arange(y, y + size) % image.shape[0], np.arange(x, x + size) % image.shape[1]
    return image[np.ix_(rows, columns)].astype(np.int64)


def distance(target: np.ndarray, y: int, x: int, exemplar: np.ndarray, ey: int, ex: int, size: int) -> int:
    """MJH17 eq. 5, the inner sum."""
    return int(((patch(target, y, x, size) - patch(exemplar, ey, ex, size)) ** 2).sum())


def distances(matcher: Matcher) -> np.ndarray:
    """Squared distance of every match on the device, in squared grid steps: (rows, columns) int32."""
    shape = matcher.geometry.rows, matcher.geometry.columns
    return matcher._device.read(matcher._buffers["distance"], shape, np.int32)


def penalties(field_y: np.ndarray, field_x: np.ndarray, g: Geometry, weight: float) -> np.ndarray:
    """Weight times the uses of every exemplar patch's pixels, summed over the patch."""
    uses = np.zeros((g.exemplar_height, g.exemplar_width), np.int64)
    for y, x in zip(field_y.ravel(), field_x.ravel(), strict=True):
        uses[y : y + g.patch, x : x + g.patch] += 1
    out = np.zeros((g.exemplar_rows, g.exemplar_columns), np.int64)
    for y in range(g.exemplar_rows):
        for x in range(g.exemplar_columns):
            out[y, x] = int(np.float32(weight) * np.float32(uses[y : y + g.patch, x : x + g.patch].sum()))
    return out


class Oracle:
    """One level, as `Matcher` does it."""

    def __init__(
        self, target: np.ndarray, exemplar: np.ndarray, g: Geometry, y: np.ndarray, x: np.ndarray, penalty: np.ndarray,
        in_step: InStep | None = None,
    ):  # fmt: skip
        self.target, self.exemplar, self.g, self.penalty = target, exemplar, g, penalty
        self.in_step = in_step
        self.out_of_step = None if in_step is None else in_step.prices((1, 1), (1, 1), g.patch, VARIANCE).table
        self.y, self.x = y.copy(), x.copy()
        self.cost = np.array([[self._cost(r, c, y[r, c], x[r, c]) for c in range(g.columns)] for r in range(g.rows)])

    def _cost(self, r: int, c: int, ey: int, ex: int) -> int:
        cost = distance(self.target, r, c, self.exemplar, ey, ex, self.g.patch) + int(self.penalty[ey, ex])
        return cost + (0 if self.in_step is None else self._offset_price(r, c, ey, ex))

    def _offset_price(self, r: int, c: int, ey: int, ex: int) -> int:
        """Of the phases of two middles, each on its own lattice."""
        half = self.g.patch / 2
        own = self.in_step.lattice.frequencies @ [ex + half, ey + half]
        wanted = self.in_step.wanted @ (np.array([c + half, r + half]) + self.in_step.origin)
        bins = len(self.out_of_step)
        u, v = [*np.floor((own - wanted) * bins + 0.5).astype(int) % bins, 0][:2]
        return int(self.out_of_step[v, u])

    def _offer(self, r: int, c: int, ey: int, ex: int, best: list[int]) -> None:
        if 0 <= ey < self.g.exemplar_rows and 0 <= ex < self.g.exemplar_columns:
            cost = self._cost(r, c, ey, ex)
            if cost < best[0]:
                best[:] = [cost, ey, ex]

    def propagate(self, jump: int) -> None:
        """Offers of the four neighbors, all as they were before."""
        g = self.g
        old_y, old_x = self.y.copy(), self.x.copy()
        for r in range(g.rows):
            for c in range(g.columns):
                best = [self.cost[r, c], old_y[r, c], old_x[r, c]]
                for dy, dx in ((0, -jump), (0, jump), (-jump, 0), (jump, 0)):
                    rr, cc = r + dy, c + dx
                    if (not g.wrap_y and not 0 <= rr < g.rows) or (not g.wrap_x and not 0 <= cc < g.columns):
                        continue
                    rr, cc = rr % g.rows, cc % g.columns
                    self._offer(r, c, int(old_y[rr, cc]) - dy, int(old_x[rr, cc]) - dx, best)
                self.cost[r, c], self.y[r, c], self.x[r, c] = best

    def search(self, seed: int, step: int) -> None:
        """Random candidates in shrinking windows around the best so far."""
        g = self.g
        reach = max(g.exemplar_columns, g.exemplar_rows)
        shrink = (2.0 / reach) ** (1.0 / (WINDOWS - 1))
        for r in range(g.rows):
            for c in range(g.columns):
                best = [self.cost[r, c], self.y[r, c], self.x[r, c]]
                bits = int(hash_at(seed, step, np.array([r]), np.array([c]))[0])
                for k in range(WINDOWS):
                    radius = max(1, int(reach * shrink**k))
                    by, bx = int(best[1]), int(best[2])
                    x0, x1 = max(0, bx - radius), min(g.exemplar_columns - 1, bx + radius)
                    y0, y1 = max(0, by - radius), min(g.exemplar_rows - 1, by + radius)
                    bits = pcg(bits + 2 * k + 1)
                    ex = x0 + (bits * (x1 - x0 + 1) >> 32)
                    bits = pcg(bits + 2 * k + 2)
                    ey = y0 + (bits * (y1 - y0 + 1) >> 32)
                    self._offer(r, c, ey, ex, best)
                self.cost[r, c], self.y[r, c], self.x[r, c] = best

    def follow(self, links: Links) -> None:
        """The links of the cell of the best so far, one after the other, moved as it is within its cell."""
        for r in range(self.g.rows):
            for c in range(self.g.columns):
                best = [self.cost[r, c], int(self.y[r, c]), int(self.x[r, c])]
                for k in range(LINKS):
                    place = int(links.places[best[1] // links.side, best[2] // links.side, k])
                    y, x = (place >> 16) + best[1] % links.side, (place & 0xFFFF) + best[2] % links.side
                    self._offer(r, c, y, x, best)
                self.cost[r, c], self.y[r, c], self.x[r, c] = best

    def one_pass(self, seed: int, step: int, links: Links | None = None) -> None:
        """What one iteration of `Matcher.improve` does."""
        for jump in JUMPS:
            self.propagate(jump)
        if links is None:
            self.search(seed, step)
        else:
            self.follow(links)


def nearest(reduced: np.ndarray, corner: np.ndarray, allowed: np.ndarray, least: int, most: int) -> list[list[int]]:
    """For each patch, allowed ones by distance, then place: of the first `most`, those `least` px from all before."""
    found = []
    for own, values in enumerate(reduced):
        distance = [int(((other - values) ** 2).sum()) for other in reduced]
        order = sorted((d, k) for k, d in enumerate(distance) if allowed[k])[:most]
        chosen = [own]
        for _, k in order:
            if all(abs(corner[k] - corner[other]).max() >= least for other in chosen) and len(chosen) <= LINKS:
                chosen.append(k)
        found.append(chosen[1:])
    return found


def pcg(v: int) -> int:
    """cl/hash.h's hash_pcg."""
    state = (v * 747796405 + 2891336453) & 0xFFFFFFFF
    word = (((state >> ((state >> 28) + 4)) ^ state) * 277803737) & 0xFFFFFFFF
    return ((word >> 22) ^ word) & 0xFFFFFFFF


def votes(
    exemplar: np.ndarray, y: np.ndarray, x: np.ndarray, g: Geometry
) -> list[list[list[tuple[int, int, int, int]]]]:
    """For every target pixel all votes over it: (row in patch, column in patch, source y, source x)."""
    found = [[[] for _ in range(g.width)] for _ in range(g.height)]
    for r in range(g.rows):
        for c in range(g.columns):
            for v in range(g.patch):
                for u in range(g.patch):
                    place = found[(r + v) % g.height][(c + u) % g.width]
                    place.append((v, u, int(y[r, c]) + v, int(x[r, c]) + u))
    return found
