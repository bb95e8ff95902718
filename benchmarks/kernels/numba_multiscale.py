# SPDX-License-Identifier: Apache-2.0
"""The bound for cl/multiscale.cl in benchmarks/kernels/test_kernels.py: the same correction as compiled numba loops.

This is the speed of a good Python loop on the CPU, parallel over rows, on the same data: `BoundCorrection.correct` has
the same candidates as the subpasses of `Synthesizer` on one level.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from llvmlite.binding import get_host_cpu_features
from numba import config, njit, prange

from oiiotex.engine.core.window import Window
from oiiotex.synthesis.multiscale.candidate_sets import DIMS, MOST_PROJECTED, Analysis

BITS, MOST_OFFSET = np.int32(12), np.int32(8191)  # of cl/multiscale.cl
NEAR = np.array([(0, 0), (1, 0), (-1, 1), (0, 1), (1, 1), (-1, -1), (0, -1), (1, -1), (-1, 0)], np.int64)  # (dx, dy)
TAPS, CHANNELS, WIDE, PADDED = np.uint64(5), np.uint64(3), np.uint64(DIMS), np.uint64(96)
RUN = 16  # pixels whose records are touched before they are worked on

_features = get_host_cpu_features()
if _features.get("avx512bw") and not config.CPU_FEATURES:
    _features["prefer-256-bit"] = False  # LLVM halves the registers on some CPUs, which takes a third longer
    config.CPU_FEATURES = _features.flatten()

serial = njit(error_model="numpy")
parallel = njit(error_model="numpy", parallel=True)


@serial
def project_around(around, wanted, color, y, x, own, basis):
    """The 5 x 5 neighborhood to the right and below of (y, x), less `own`, projected.

    It is copied together first, so that every dimension is a sum of products of 16-bit numbers, which LLVM makes of
    few instructions (vpmaddwd); padded to whole registers. Sixteen sums side by side, tap by tap, took longer.
    """
    for v in range(TAPS):
        for u in range(TAPS):
            for c in range(CHANNELS):
                around[CHANNELS * (v * TAPS + u) + c] = np.int16(color[y + v, x + u, c] - own[c])
    for d in range(WIDE):
        row, total = basis[d], np.int32(1 << 11)
        for k in range(PADDED):
            total = np.int32(total + np.int32(np.int32(around[k]) * np.int32(row[k])))
        wanted[d] = np.int16(min(max(total >> BITS, -MOST_PROJECTED), MOST_PROJECTED))


@serial
def distance(wanted, record):
    """Squared, of two projected neighborhoods; differences stay 16 bits wide, so that it is one instruction."""
    total = np.int32(0)
    for d in range(WIDE):
        away = np.int32(np.int16(wanted[d] - record[d]))
        total = np.int32(total + np.int32(away * away))
    return total


@parallel
def correct(texel, r, color, links, records, offsets, basis, spacing, side, place, penalty, sink):
    """`multiscale_correct`; `place` is first_x, first_y, count_x, count_y."""
    first_x, first_y, count_x, count_y = place
    bits, inside = np.uint32(side), np.uint32((1 << side) - 1)
    for index in prange(count_y):
        y = np.int64(first_y + 2 * np.int64(index))
        around, wanted = np.zeros(PADDED, np.int16), np.empty(DIMS, np.int16)
        near, touched = np.empty((RUN, 9), np.uint64), np.int64(0)
        for i in range(count_x):
            if i % RUN == 0:
                for m in range(min(RUN, count_x - i)):
                    x = first_x + 2 * (i + m)
                    for n in range(9):
                        dx, dy = NEAR[n, 0], NEAR[n, 1]
                        other = texel[y + dy, x + dx]
                        level = other >> np.uint32(2 * bits)
                        h = spacing[level]
                        v = np.uint32(np.int64((other >> bits) & inside) - dy * h) & inside
                        u = np.uint32(np.int64(other & inside) - dx * h) & inside
                        at = (np.uint64(level) << np.uint64(2 * bits)) | np.uint64((v << bits) | u)
                        near[m, n] = at
                        touched += np.int64(records[at, 0, 0])
            x = first_x + 2 * i
            own = r[y, x]
            project_around(around, wanted, color, np.uint64(y - 2), np.uint64(x - 2), own, basis)
            best, chosen, number = np.int64(1 << 40), np.uint64(0), np.uint64(0)
            for k in range(np.uint64(2)):
                for n in range(np.uint64(9)):
                    cost = np.int64(distance(wanted, records[near[i % RUN, n], k]))
                    if k > 0:
                        cost += (cost >> 4) * penalty
                    if cost < best:
                        best, chosen, number = cost, near[i % RUN, n], k
            texel[y, x] = links[chosen, number]
            for c in range(3):
                moved = np.int32(own[c]) + np.int32(offsets[chosen, number, c])
                own[c] = np.int16(min(max(moved, -MOST_OFFSET), MOST_OFFSET))
        sink[index] = touched


@parallel
def recolor(texel, r, stack, color, place):
    """`multiscale_color`."""
    first_x, first_y, count_x, count_y = place
    for index in prange(count_y):
        y = np.int64(first_y + 2 * np.int64(index))
        for i in range(count_x):
            x = first_x + 2 * i
            for c in range(3):
                color[y, x, c] = stack[texel[y, x], c] + r[y, x, c]


class BoundCorrection:
    """All subpasses of a level.

    Parameters
    ----------
    analysis : Analysis
    penalty : int
        Of second candidates, in sixteenths.
    """

    def __init__(self, analysis: Analysis, penalty: int):
        levels = analysis.stacks.levels
        self._side, self._penalty = analysis.stacks.side_bits, np.int64(penalty)
        self._stack = analysis.stacks.planes.reshape(-1, 4)
        self._links = np.array(analysis.links).reshape(-1, 2)
        self._records = np.array(analysis.records).reshape(-1, 2, DIMS)
        self._offsets = np.array(analysis.offsets).reshape(-1, 2, 4)
        self._basis = np.zeros((DIMS, 96), np.int16)
        self._basis[:, :75] = analysis.basis.T
        self._sink = np.empty(1 << 20, np.int64)
        self._spacing = np.array([levels.spacing(n) for n in range(len(levels.stacks))], np.int64)

    def correct(
        self, texel: np.ndarray, r: np.ndarray, color: np.ndarray, windows: Sequence[Window],
        parities: Sequence[tuple[int, int]],
    ) -> None:  # fmt: skip
        """Change the pixels of `windows[0]`, as `LevelPlan` says, in place."""
        whole = windows[0]
        for parity, after in zip(parities, windows[1:], strict=True):
            left, top = after.left + ((after.left ^ parity[0]) & 1), after.top + ((after.top ^ parity[1]) & 1)
            count = (after.right - left + 1) // 2, (after.bottom - top + 1) // 2
            place = left - whole.left, top - whole.top, *count
            correct(
                texel, r, color, self._links, self._records, self._offsets, self._basis, self._spacing, self._side,
                place, self._penalty, self._sink,
            )  # fmt: skip
            recolor(texel, r, self._stack, color, place)
