# SPDX-License-Identifier: Apache-2.0
"""The bound for cl/patchmatch.cl in benchmarks/kernels/test_kernels.py: the same work as compiled numba loops.

This is the speed of a good Python loop on the CPU, parallel over rows, on the same data: `BoundMatcher` does what
`Matcher.improve` does, candidate for candidate. Only the toroidal case is written out, and the patch size is a
constant, as it is in the compiled kernels.
"""

from __future__ import annotations

import numpy as np
from llvmlite.binding import get_host_cpu_features
from numba import config, njit, prange

from oiiotex.synthesis.patchmatch.field import Geometry
from oiiotex.synthesis.patchmatch.matcher import JUMPS
from oiiotex.synthesis.patchmatch.patch_search import WINDOWS

PATCH = 11
ROW = 3 * PATCH
SPAN = 2 * PATCH - 1  # of the triangle by which uses are counted
INT_MAX = 2**31 - 1

# Inner loops index with unsigned integers: numba then leaves out the test for places that count from the end. The index
# of a prange is also unsigned; it is cast to signed, because numba makes a float of the sum of both.
TOP_ROWS, OTHER_ROWS = (np.uint64(0), np.uint64(3)), (np.uint64(3), np.uint64(PATCH))
MOST_COLUMNS, LAST_COLUMN = (np.uint64(0), np.uint64(ROW - 1)), (np.uint64(ROW - 1), np.uint64(ROW))

_features = get_host_cpu_features()
if _features.get("avx512bw") and not config.CPU_FEATURES:
    _features["prefer-256-bit"] = False  # LLVM halves the registers on some CPUs, which takes a third longer
    config.CPU_FEATURES = _features.flatten()

serial = njit(error_model="numpy")
parallel = njit(error_model="numpy", parallel=True)


@serial
def squares(total, t, t_at, t_row, e, e_at, e_row, rows, columns):
    """`total` and the squared differences of some `rows` (first, end) and `columns` (first, end) of two patches.

    The loop over rows lies inside, where LLVM unrolls it, so that the lanes of a register are summed up only once;
    differences stay 16 bits wide, so that squaring and adding is one instruction (vpmaddwd).
    """
    for k in range(columns[0], columns[1]):
        for r in range(rows[0], rows[1]):
            d = np.int32(np.int16(t[t_at + r * t_row + k] - e[e_at + r * e_row + k]))
            total = np.int32(total + np.int32(d * d))
    return total


@serial
def patch_distance(t, t_at, t_row, e, e_at, e_row, limit):
    """Sum of squared differences of two patches; given up after three rows where it reaches `limit` there.

    A row of 33 values fills its registers and has one more value: the loop over 33 took 1.3 times as long, all of
    `improve` counted. One slice of each image per row, as one would write it first, took 4 times as long, this alone.
    """
    patches = (t, np.uint64(t_at), np.uint64(t_row), e, np.uint64(e_at), np.uint64(e_row))
    total = squares(squares(np.int32(0), *patches, TOP_ROWS, MOST_COLUMNS), *patches, TOP_ROWS, LAST_COLUMN)
    if total >= limit:
        return total
    return squares(squares(total, *patches, OTHER_ROWS, MOST_COLUMNS), *patches, OTHER_ROWS, LAST_COLUMN)


@serial
def hash_pcg(v):
    """cl/hash.h's `hash_pcg`, uint32."""
    state = np.uint32(v * np.uint32(747796405) + np.uint32(2891336453))
    word = np.uint32(((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(277803737))
    return np.uint32((word >> np.uint32(22)) ^ word)


@serial
def hash_at(seed, step, y, x):
    """cl/hash.h's `hash_at`, uint32."""
    bits = hash_pcg(np.uint32(step + hash_pcg(seed)))
    return hash_pcg(np.uint32(np.uint32(x) + hash_pcg(np.uint32(np.uint32(y) + bits))))


@serial
def hash_below(bits, n):
    """32 random bits as 0 .. n - 1."""
    return np.int64((np.uint64(bits) * np.uint64(n)) >> np.uint64(32))


@parallel
def pad(image, padded):
    """The target (rows, 3 * columns) with PATCH - 1 wrapped pixels at its right and bottom."""
    height, length = image.shape
    for index in prange(padded.shape[0]):
        y = np.int64(index)
        line = image[y if y < height else y - height]
        padded[y, :length] = line
        padded[y, length:] = line[: ROW - 3]


@parallel
def score(target, exemplar, field, distance, t_row, e_row):
    """Distances of the present field."""
    rows, columns = field.shape
    for index in prange(rows):
        y = np.int64(index)
        for x in range(columns):
            at = np.int64(field[y, x])
            e_at = (at >> 16) * e_row + 3 * (at & 0xFFFF)
            distance[y, x] = patch_distance(target, y * t_row + 3 * x, t_row, exemplar, e_at, e_row, np.int32(INT_MAX))


@parallel
def propagate(target, exemplar, penalty, field, distance, field_out, distance_out, t_row, e_row, jump):
    """One Jacobi pass: every patch is offered the matches of its four neighbors `jump` pixels away."""
    rows, columns = field.shape
    e_rows, e_columns = penalty.shape
    for index in prange(rows):
        y = np.int64(index)
        for x in range(columns):
            best = np.int64(field[y, x])
            best_distance = np.int64(distance[y, x])
            best_cost = min(best_distance + penalty[best >> 16, best & 0xFFFF], INT_MAX)
            for k in range(4):
                dx = -jump if k == 0 else jump if k == 1 else 0
                dy = -jump if k == 2 else jump if k == 3 else 0
                nx, ny = x + dx, y + dy
                nx = nx + columns if nx < 0 else nx - columns if nx >= columns else nx
                ny = ny + rows if ny < 0 else ny - rows if ny >= rows else ny
                other = np.int64(field[ny, nx])
                ex, ey = (other & 0xFFFF) - dx, (other >> 16) - dy
                if ex < 0 or ey < 0 or ex >= e_columns or ey >= e_rows or (ey << 16 | ex) == best:
                    continue
                extra = np.int64(penalty[ey, ex])
                if extra >= best_cost:
                    continue
                t_at, e_at = y * t_row + 3 * x, ey * e_row + 3 * ex
                d = np.int64(patch_distance(target, t_at, t_row, exemplar, e_at, e_row, best_cost - extra))
                if d < best_cost - extra:
                    best, best_distance, best_cost = ey << 16 | ex, d, d + extra
            field_out[y, x] = best
            distance_out[y, x] = best_distance


@parallel
def search(target, exemplar, penalty, field, distance, t_row, e_row, radius, seed, step):
    """Random search: one candidate in each of `radius.size` windows around the best so far."""
    rows, columns = field.shape
    e_rows, e_columns = penalty.shape
    for index in prange(rows):
        y = np.int64(index)
        for x in range(columns):
            best = np.int64(field[y, x])
            best_distance = np.int64(distance[y, x])
            best_cost = min(best_distance + penalty[best >> 16, best & 0xFFFF], INT_MAX)
            bits = hash_at(seed, step, y, x)
            for k in range(radius.size):
                r, bx, by = np.int64(radius[k]), best & 0xFFFF, best >> 16
                x0, x1 = max(bx - r, 0), min(bx + r, e_columns - 1)
                y0, y1 = max(by - r, 0), min(by + r, e_rows - 1)
                bits = hash_pcg(np.uint32(bits + np.uint32(2 * k + 1)))
                ex = x0 + hash_below(bits, x1 - x0 + 1)
                bits = hash_pcg(np.uint32(bits + np.uint32(2 * k + 2)))
                ey = y0 + hash_below(bits, y1 - y0 + 1)
                extra = np.int64(penalty[ey, ex])
                if extra >= best_cost or (ey << 16 | ex) == best:
                    continue
                t_at, e_at = y * t_row + 3 * x, ey * e_row + 3 * ex
                d = np.int64(patch_distance(target, t_at, t_row, exemplar, e_at, e_row, best_cost - extra))
                if d < best_cost - extra:
                    best, best_distance, best_cost = ey << 16 | ex, d, d + extra
            field[y, x] = best
            distance[y, x] = best_distance


@serial
def count(field, counts):
    """How often each exemplar patch is used; `counts` has a border of PATCH - 1 zeros."""
    counts[:] = 0
    rows, columns = field.shape
    for y in range(rows):
        for x in range(columns):
            at = np.int64(field[y, x])
            counts[(at >> 16) + PATCH - 1, (at & 0xFFFF) + PATCH - 1] += 1


@parallel
def uses_rows(counts, uses):
    """The triangle along rows; `uses` has a border of PATCH - 1 zeros at its top and bottom."""
    columns = uses.shape[1]
    for index in prange(PATCH - 1, uses.shape[0] - PATCH + 1):
        y = np.int64(index)
        line, into = counts[y], uses[y]
        for x in range(columns):
            total = np.int32(0)
            for k in range(SPAN):
                total = np.int32(total + np.int32((PATCH - abs(k - PATCH + 1)) * line[x + k]))
            into[x] = total


@parallel
def penalties(uses, allowed, penalty, weight):
    """The triangle along columns, where the sum becomes the penalty of choosing the patch."""
    rows, columns = penalty.shape
    for index in prange(rows):
        y = np.int64(index)
        into, free = penalty[y], allowed[y]
        into[:] = 0
        for k in range(SPAN):
            share, line = np.int32(PATCH - abs(k - PATCH + 1)), uses[y + k]
            for x in range(columns):
                into[x] = np.int32(into[x] + np.int32(share * line[x]))
        for x in range(columns):
            cost = weight * np.float32(into[x])
            into[x] = INT_MAX if not free[x] else np.int32(cost) if cost < np.float32(1e9) else 1000000000


class BoundMatcher:
    """`Matcher`, its improvement only, for a target that wraps along both axes.

    Parameters
    ----------
    geometry : Geometry
        With a patch of PATCH px, wrapping along both axes.
    exemplar : (exemplar_height, exemplar_width, 3) int16
    allowed : (exemplar_rows, exemplar_columns) bool
    image : (height, width, 3) int16
        The target.
    field : (rows, columns) uint32
    penalty_weight : float
        Of one doubly summed use.
    seed : int
    """

    def __init__(
        self,
        geometry: Geometry,
        exemplar: np.ndarray,
        allowed: np.ndarray,
        image: np.ndarray,
        field: np.ndarray,
        penalty_weight: float,
        seed: int,
    ):
        if geometry.patch != PATCH or not (geometry.wrap_x and geometry.wrap_y):
            raise ValueError(f"the bound is written for patches of {PATCH} px and a target that wraps")
        e_rows, e_columns = allowed.shape
        self._exemplar = np.ascontiguousarray(exemplar).reshape(-1)
        self._strides = (np.int64(3 * geometry.padded_width), np.int64(3 * geometry.exemplar_width))
        self._allowed = allowed
        self._weight, self._seed = np.float32(penalty_weight), np.uint32(seed)
        self._image = np.ascontiguousarray(image).reshape(geometry.height, -1)
        self._target = np.empty((geometry.height + PATCH - 1, 3 * geometry.padded_width), np.int16)
        self._counts = np.zeros((e_rows + 2 * PATCH - 2, e_columns + 2 * PATCH - 2), np.int32)
        self._uses = np.zeros((e_rows + 2 * PATCH - 2, e_columns), np.int32)
        self._penalty = np.empty((e_rows, e_columns), np.int32)
        reach = max(geometry.exemplar_columns, geometry.exemplar_rows)
        shrink = (2.0 / reach) ** (1.0 / (WINDOWS - 1))
        self._radius = np.array([max(1, int(reach * shrink**k)) for k in range(WINDOWS)], np.int32)
        self.field, self._field_next = field.copy(), np.empty_like(field)
        self.distance, self._distance_next = np.empty(field.shape, np.int32), np.empty(field.shape, np.int32)

    def improve(self, iterations: int, step: int) -> None:
        """Search better matches; `step` numbers the outer iteration for the random numbers."""
        target = self._target.reshape(-1)
        images, strides = (target, self._exemplar, self._penalty), self._strides
        pad(self._image, self._target)
        score(target, self._exemplar, self.field, self.distance, *strides)
        for i in range(iterations):
            count(self.field, self._counts)
            uses_rows(self._counts, self._uses)
            penalties(self._uses, self._allowed, self._penalty, self._weight)
            for jump in JUMPS:
                now, after = (self.field, self.distance), (self._field_next, self._distance_next)
                propagate(*images, *now, *after, *strides, np.int64(jump))
                (self.field, self.distance), (self._field_next, self._distance_next) = after, now
            numbers = (self._radius, self._seed, np.uint32(16 * step + i))
            search(*images, self.field, self.distance, *strides, *numbers)
