# SPDX-License-Identifier: Apache-2.0
"""The bound that benchmarks/test_kernels.py measures against: the work of two kernel files as compiled numba loops.

What a good loop in Python reaches on the CPU, parallel over rows, on the same data: `Bound*` do what `Matcher.improve`
and `Projection.project` do, candidate for candidate and sum for sum. Only the toroidal case is written out, and the
patch size is a constant, as it is in the compiled kernels.
"""

from __future__ import annotations

import math

import numpy as np
from llvmlite.binding import get_host_cpu_features
from numba import config, njit, prange

from oiiotex.synthesis.histograms import BINS, INVERSE, Cells
from oiiotex.synthesis.patchmatch import JUMPS, SEARCHES, Geometry

PATCH = 11
ROW = 3 * PATCH
SPAN = 2 * PATCH - 1  # of the triangle by which uses are counted
INT_MAX = 2**31 - 1

# Inner loops index with unsigned integers: numba then leaves out the test for places that count from the end. The index
# of a prange is unsigned, too; where it meets signed ones it is made signed, for the sum of both is a float to numba.
TOP_ROWS, OTHER_ROWS = (np.uint64(0), np.uint64(3)), (np.uint64(3), np.uint64(PATCH))
MOST_COLUMNS, LAST_COLUMN = (np.uint64(0), np.uint64(ROW - 1)), (np.uint64(ROW - 1), np.uint64(ROW))

_features = get_host_cpu_features()
if _features.get("avx512bw") and not config.CPU_FEATURES:
    _features["prefer-256-bit"] = False  # LLVM halves the registers on some CPUs, which takes a third longer
    config.CPU_FEATURES = _features.flatten()

_serial = njit(error_model="numpy")
_parallel = njit(error_model="numpy", parallel=True)


@_serial
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


@_serial
def patch_distance(t, t_at, t_row, e, e_at, e_row, limit):
    """Sum of squared differences of two patches; given up after three rows where it reaches `limit` there.

    A row of 33 values is a whole number of registers and one value: the loop over 33 took 1.3 times as long, all of
    `improve` counted. One slice of each image per row, as one would write it first, took 4 times as long, this alone.
    """
    patches = (t, np.uint64(t_at), np.uint64(t_row), e, np.uint64(e_at), np.uint64(e_row))
    total = squares(squares(np.int32(0), *patches, TOP_ROWS, MOST_COLUMNS), *patches, TOP_ROWS, LAST_COLUMN)
    if total >= limit:
        return total
    return squares(squares(total, *patches, OTHER_ROWS, MOST_COLUMNS), *patches, OTHER_ROWS, LAST_COLUMN)


@_serial
def hash_pcg(v):
    """cl/hash.h's `hash_pcg`, uint32."""
    state = np.uint32(v * np.uint32(747796405) + np.uint32(2891336453))
    word = np.uint32(((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(277803737))
    return np.uint32((word >> np.uint32(22)) ^ word)


@_serial
def hash_at(seed, step, y, x):
    """cl/hash.h's `hash_at`, uint32."""
    bits = hash_pcg(np.uint32(step + hash_pcg(seed)))
    return hash_pcg(np.uint32(np.uint32(x) + hash_pcg(np.uint32(np.uint32(y) + bits))))


@_serial
def hash_below(bits, n):
    """32 random bits as 0 .. n - 1."""
    return np.int64((np.uint64(bits) * np.uint64(n)) >> np.uint64(32))


@_parallel
def pad(image, padded):
    """The target (rows, 3 * columns) with PATCH - 1 wrapped pixels at its right and bottom."""
    height, length = image.shape
    for index in prange(padded.shape[0]):
        y = np.int64(index)
        line = image[y if y < height else y - height]
        padded[y, :length] = line
        padded[y, length:] = line[: ROW - 3]


@_parallel
def score(target, exemplar, field, distance, t_row, e_row):
    """Distances of the present field."""
    rows, columns = field.shape
    for index in prange(rows):
        y = np.int64(index)
        for x in range(columns):
            at = np.int64(field[y, x])
            e_at = (at >> 16) * e_row + 3 * (at & 0xFFFF)
            distance[y, x] = patch_distance(target, y * t_row + 3 * x, t_row, exemplar, e_at, e_row, np.int32(INT_MAX))


@_parallel
def propagate(target, exemplar, penalty, field, distance, field_out, distance_out, t_row, e_row, jump):
    """One Jacobi pass: every patch is offered the matches of its four neighbours `jump` pixels away."""
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


@_parallel
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


@_serial
def count(field, counts):
    """How often each exemplar patch is used; `counts` has a border of PATCH - 1 zeros."""
    counts[:] = 0
    rows, columns = field.shape
    for y in range(rows):
        for x in range(columns):
            at = np.int64(field[y, x])
            counts[(at >> 16) + PATCH - 1, (at & 0xFFFF) + PATCH - 1] += 1


@_parallel
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


@_parallel
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
        shrink = (2.0 / reach) ** (1.0 / (SEARCHES - 1))
        self._radius = np.array([max(1, int(reach * shrink**k)) for k in range(SEARCHES)], np.int32)
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


# --- local histograms ---

ZERO, HALF, ONE, TOP = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(BINS - 1)
SHARES = np.float32(INVERSE)


# min, max and floor of floats mind what is no number, which takes a third of the time of `match`


@_serial
def clamp(value, low, high):
    """The nearest value from low to high."""
    value = low if value < low else value
    return high if value > high else value


@_serial
def floor_int(value):
    """The floor as int32."""
    i = np.int32(value)
    return i - np.int32(value < np.float32(i))


@_serial
def place_in_bins(value, low, per_bin):
    """A value's place among the bins, 0 .. BINS - 1."""
    return clamp((np.float32(value) - low) * per_bin, ZERO, TOP)


@_serial
def shares_of_cell(centre, pitch, size, places, shares):
    """The wrapped places of the pixels less than a cell away along an axis, and their shares; returns how many."""
    first, end = math.floor(centre - pitch) + 1, math.ceil(centre + pitch)
    for i in range(first, end):
        places[i - first] = i + size if i < 0 else i - size if i >= size else i
        shares[i - first] = ONE - abs(np.float32(i) - centre) / pitch
    return end - first


@_parallel
def gather(image, grid, low, per_bin):
    """Every pixel (height, width, 3) shared bilinearly among the cells (3, cells_y, cells_x, BINS) around it."""
    height, width, _ = image.shape
    _, cells_y, cells_x, _ = grid.shape
    pitch_x, pitch_y = np.float32(width) / np.float32(cells_x), np.float32(height) / np.float32(cells_y)
    most = np.int64(2 * max(pitch_x, pitch_y)) + 2
    for index in prange(3 * cells_y):
        c, cy = np.int64(index) // cells_y, np.int64(index) % cells_y
        least, scale = low[c], per_bin[c]
        places_x, places_y = np.empty(most, np.uint64), np.empty(most, np.uint64)
        shares_x, shares_y = np.empty(most, np.float32), np.empty(most, np.float32)
        n_y = shares_of_cell((np.float32(cy) + HALF) * pitch_y - HALF, pitch_y, height, places_y, shares_y)
        for cx in range(cells_x):
            histogram = grid[c, cy, cx]
            histogram[:] = np.float32(1e-6) * pitch_x * pitch_y
            n_x = shares_of_cell((np.float32(cx) + HALF) * pitch_x - HALF, pitch_x, width, places_x, shares_x)
            for j in range(n_y):
                row, share_y = image[places_y[j]], shares_y[j]
                for i in range(n_x):
                    weight = share_y * shares_x[i]
                    t = place_in_bins(row[places_x[i], np.uint64(c)], least, scale)
                    b = np.uint64(min(np.int32(t), np.int32(BINS - 2)))
                    upper = (t - np.float32(b)) * weight
                    histogram[b] += weight - upper
                    histogram[b + np.uint64(1)] += upper


@_parallel
def row_sums(grid, sums):
    """Sums of a row of cells, bin by bin: (lines, cells_x, BINS) -> (lines, BINS)."""
    for index in prange(grid.shape[0]):
        line = np.int64(index)
        into = sums[line]
        into[:] = 0
        for x in range(grid.shape[1]):
            histogram = grid[line, x]
            for b in range(BINS):
                into[b] += histogram[b]


@_parallel
def blur(grid, blurred, weights):
    """One wrapped axis of the Gaussian, along the second axis of (lines, n, length).

    Four taps in a pass keep a sum in its register for longer; it is summed in the order of taps all the same.
    """
    lines, n, length = grid.shape
    radius = weights.size // 2
    fours = weights.size // 4 * 4
    for index in prange(lines * n):
        job = np.int64(index)
        line, i = job // n, job % n
        first, into = i - radius, blurred[line, i]
        into[:] = 0
        for k in range(0, fours, 4):
            w0, w1, w2, w3 = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
            a0, a1 = grid[line, (first + k) % n], grid[line, (first + k + 1) % n]
            a2, a3 = grid[line, (first + k + 2) % n], grid[line, (first + k + 3) % n]
            for b in range(length):
                into[b] = into[b] + w0 * a0[b] + w1 * a1[b] + w2 * a2[b] + w3 * a3[b]
        for k in range(fours, weights.size):
            w0, a0 = weights[k], grid[line, (first + k) % n]
            for b in range(length):
                into[b] += w0 * a0[b]


@_parallel
def cumulate(grid):
    """Histograms -> their cumulatives, normalised: (cells, BINS)."""
    for index in prange(grid.shape[0]):
        i = np.int64(index)
        histogram = grid[i]
        total = ZERO
        for b in range(BINS):
            total += histogram[b]
        scale, below = ONE / total, ZERO
        for b in range(BINS):
            share = histogram[b]
            histogram[b] = below * scale
            below += share


@_serial
def around(place, cells):
    """The two cells around a place on a wrapped axis, and how far it lies on the way to the second."""
    first = floor_int(place)
    before = first + cells if first < 0 else first
    after = first + 1 - cells if first + 1 >= cells else first + 1
    return before, after, place - np.float32(first)


@_serial
def share_below(cumulative, cell, b, inside):
    """The cumulative of one cell, linear inside the bin."""
    at = np.uint64(cell) * np.uint64(BINS) + np.uint64(b)
    upper = cumulative[at + np.uint64(1)] if b < BINS - 1 else ONE
    return cumulative[at] + (upper - cumulative[at]) * inside


@_parallel
def match(image, cumulative, cells_y, cells_x, inverse, matched, low, per_bin, strength):
    """Pixels moved `strength` times the way to G^-1(F(c)); F is interpolated between the four cells around them."""
    height, width, _ = image.shape
    per_x, per_y = np.float32(cells_x) / np.float32(width), np.float32(cells_y) / np.float32(height)
    for index in prange(height):
        line, into = image[index], matched[index]
        above, below, lower = around((np.float32(index) + HALF) * per_y - HALF, cells_y)
        for c in range(np.uint64(3)):
            least, scale, g = low[c], per_bin[c], inverse[c]
            darkest, brightest = g[0], g[INVERSE]
            row_above = (np.int64(c) * cells_y + above) * cells_x
            row_below = (np.int64(c) * cells_y + below) * cells_x
            for x in range(np.uint64(width)):
                left, after, right = around((np.float32(x) + HALF) * per_x - HALF, cells_x)
                old = np.float32(line[x, c])
                t = place_in_bins(old, least, scale)
                b = np.int32(t + HALF)
                inside = t + HALF - np.float32(b)
                w0, w1 = (ONE - right) * (ONE - lower), right * (ONE - lower)
                w2, w3 = (ONE - right) * lower, right * lower
                share = w0 * share_below(cumulative, row_above + left, b, inside)
                share += w1 * share_below(cumulative, row_above + after, b, inside)
                share += w2 * share_below(cumulative, row_below + left, b, inside)
                share += w3 * share_below(cumulative, row_below + after, b, inside)
                share = share / (w0 + w1 + w2 + w3) * SHARES
                i = min(np.int32(share), np.int32(INVERSE - 1))
                g0, g1 = g[np.uint64(i)], g[np.uint64(i) + np.uint64(1)]
                value = old + strength * (g0 + (g1 - g0) * (share - np.float32(i)) - old)
                into[x, c] = np.int16(floor_int(clamp(value, darkest, brightest) + HALF))


class BoundProjection:
    """`Projection` for an image that wraps along both axes; parameters as there."""

    def __init__(self, cells: Cells, sigma: float, low: np.ndarray, high: np.ndarray):
        self._low, self._high = np.asarray(low, np.float32), np.asarray(high, np.float32)
        self._per_bin = ((BINS - 1) / np.maximum(self._high - self._low, np.float32(1.0))).astype(np.float32)
        self._weights = [gaussian(sigma * n / size) for n, size in ((cells.x, cells.width), (cells.y, cells.height))]
        self._grid = np.empty((3, cells.y, cells.x, BINS), np.float32)
        self._grid_next = np.empty_like(self._grid)
        self._row_sums = np.empty((3 * cells.y, BINS), np.float32)

    def project(self, image: np.ndarray, matched: np.ndarray, strength: float = 1.0) -> None:
        """Write to `matched` what lies `strength` times the way from `image` to its projection."""
        _, cells_y, cells_x, _ = self._grid.shape
        lines = (3 * cells_y, cells_x, BINS)
        columns = (3, cells_y, cells_x * BINS)
        gather(image, self._grid, self._low, self._per_bin)
        row_sums(self._grid.reshape(lines), self._row_sums)
        blur(self._grid.reshape(lines), self._grid_next.reshape(lines), self._weights[0])
        blur(self._grid_next.reshape(columns), self._grid.reshape(columns), self._weights[1])
        cumulate(self._grid.reshape(-1, BINS))
        inverse = self._inverse(self._row_sums.reshape(3, cells_y, BINS))
        cells = (self._grid.reshape(-1), np.int64(cells_y), np.int64(cells_x))
        match(image, *cells, inverse, matched, self._low, self._per_bin, np.float32(strength))

    def _inverse(self, sums: np.ndarray) -> np.ndarray:
        """G^-1 at INVERSE + 1 equidistant shares, as `Projection` finds it on the host."""
        shares = np.linspace(0.0, 1.0, INVERSE + 1)
        table = np.empty((3, INVERSE + 1), np.float32)
        for c in range(3):
            below = np.concatenate([[0.0], np.cumsum(sums[c].sum(axis=0, dtype=np.float64))])
            place = np.interp(shares, below / below[-1], np.arange(BINS + 1) - 0.5)
            low, high = float(self._low[c]), float(self._high[c])
            table[c] = np.clip(low + place * max(1.0, high - low) / (BINS - 1), low, high)
        return table


def gaussian(sigma: float) -> np.ndarray:
    """Weights over cells, as `Projection` has them."""
    sigma = math.sqrt(max(1e-4, sigma**2 - 1.0 / 3.0))
    radius = max(1, math.ceil(3.2 * sigma))
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return (weights / weights.sum()).astype(np.float32)
