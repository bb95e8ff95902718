# SPDX-License-Identifier: Apache-2.0
"""Kernels at places beyond 2^31 of images and grids that nobody could hold: `python -m tests.far_offsets LANES`.

On a CPU a buffer is the host's memory, and what is mapped but never touched takes none. So arrays here are as large as
they would be, and one work-item of the real kernel runs far out in them. A wrong offset ends in a crash or a wrong
number: this runs as a process of its own (tests/engine/test_far_offsets.py).
"""

from __future__ import annotations

import sys

import numpy as np

from oiiotex.synthesis.projections.histograms import BINS, INVERSE
from tests.far_arrays import AT_E, HEIGHT, SIDE, WIDTH, E, Far, X, Y
from tests.kernel_options import TABLES


def patchmatch(far: Far) -> None:
    macros = {"PATCH": 5, "CHANNELS": 3, "LATTICE": 0, "PIECES": 0}
    size = field_size = WIDTH, HEIGHT
    e_size, all_rows = (SIDE - 4, SIDE - 4, SIDE), (0, SIDE - 4)

    def run(name, at, *arguments):
        print("patchmatch", name, flush=True)
        far.run("patchmatch", name, at, *arguments, **macros)

    image, padded = far.zeros(np.int16, HEIGHT, WIDTH, 3), far.zeros(np.int16, HEIGHT + 4, WIDTH + 4, 3)
    image[Y, X] = 1, 2, 3
    run("pad", (X, Y), image, padded, *size, HEIGHT)
    assert padded[Y, X].tolist() == [1, 2, 3]
    held = far.zeros(np.int16, HEIGHT, WIDTH, 3)
    held[Y, X] = 7, 8, 9
    run("hold", (X, Y), held, image, *size)
    assert image[Y, X].tolist() == [7, 8, 9]
    share = far.zeros(np.uint8, HEIGHT, WIDTH)
    held[Y, X], share[Y, X] = 260, 255
    run("ease", (X, Y), image, held, share, *size)
    assert held[Y, X].tolist() == [260] * 3
    share[Y, X] = 0
    run("ease", (X, Y), image, held, share, *size)
    assert held[Y, X].tolist() == [7, 8, 9]

    exemplar = far.zeros(np.int16, SIDE, SIDE, 3)
    field, following = (far.zeros(np.uint32, HEIGHT, WIDTH) for _ in range(2))
    distance, nearer = (far.zeros(np.int32, HEIGHT, WIDTH) for _ in range(2))
    penalty = far.zeros(np.int32, SIDE - 4, SIDE - 4)
    target = padded
    target[Y, X], exemplar[E, E] = (7, 0, 0), (4, 0, 0)
    field[Y, X] = AT_E
    run("score", (X, Y), target, exemplar, field, distance, *field_size, WIDTH + 4, SIDE, *all_rows)
    assert distance[Y, X] == 9
    exemplar[E, E] = 7, 0, 0
    field[Y, X], distance[Y, X], penalty[E, E] = 0, 1000, 5
    field[Y, X + 1] = AT_E + 1  # the neighbor's match, shifted back, fits but for its penalty
    both = target, exemplar, penalty
    numbers, rows = (*field_size, WIDTH + 4, *e_size, *all_rows), (0, HEIGHT, 0, HEIGHT)  # made, at the start, in all
    run("propagate", (X, Y), *both, field, distance, following, nearer, *numbers, 1, 1, 1, *rows)
    assert (following[Y, X], nearer[Y, X]) == (AT_E, 0)
    penalty[E, E] = 500
    run("propagate", (X, Y), *both, field, distance, following, nearer, *numbers, 1, 1, 1, *rows)
    assert nearer[Y, X] == 49
    field[Y, X] = AT_E + 3
    numbers = (WIDTH, WIDTH + 4, *e_size, *all_rows, np.array([1], np.int32), 0, 1, np.uint32(1), np.uint32(2))
    run("search", (X, Y), *both, field, distance, following, nearer, *numbers, 0, HEIGHT, 0)
    y, x = np.divmod(int(following[Y, X]), 1 << 16)
    assert nearer[Y, X] == 49
    assert 0 < abs(y - E) + abs(x - E - 3) <= 2

    count, uses = penalty, far.zeros(np.int32, SIDE - 4, SIDE - 4)
    count[E, E], field[Y, X] = 4, AT_E
    run("count", (X, Y), field, count, *field_size, SIDE - 4, *all_rows)
    assert count[E, E] == 5
    run("uses_rows", (E, E), count, uses, SIDE - 4, SIDE - 4, 0)
    assert uses[E, E] == 25
    count[E, E] = (1 << 31) - 1  # sums pass 2^31 where one patch is used all over a large target
    run("uses_rows", (E, E), count, uses, SIDE - 4, SIDE - 4, 1)
    assert uses[E, E] == (1 << 31) - 1
    price = far.zeros(np.float32, SIDE - 4, SIDE - 4)
    price[E, E] = 1
    run("penalty", (E, E), uses, price, penalty, SIDE - 4, SIDE - 4, SIDE - 4, 0, 1, 1e-6)
    assert abs(int(penalty[E, E]) - 10737) <= 1

    exemplar[E, E] = 11, 22, 33
    for dy in range(5):  # all patches over the pixel say the same
        for dx in range(5):
            field[Y - dy, X - dx] = (E - dy) << 16 | (E - dx)
    items, band = (X if far.lanes == 1 else X // 64, Y), (0, HEIGHT, 0)
    run("vote", items, exemplar, field, image, *field_size, WIDTH, SIDE, 1, 1, *band, *all_rows)
    assert image[Y, X].tolist() == [11, 22, 33]
    run("pick", items, field, np.ones(25, np.int32), following, *field_size, WIDTH, 1, 1, *band)
    assert following[Y, X] == AT_E


def histograms(far: Far) -> None:
    cells, c = 3500, 3400

    def run(name, at, *arguments, group=1):
        print("histograms", name, flush=True)
        far.run("histograms", name, at, *arguments, group=group, BINS=BINS, INVERSE=INVERSE, CHANNELS=3)

    grid, other = (far.zeros(np.float32, 3, cells, cells, BINS) for _ in range(2))
    image, matched = (far.zeros(np.int16, HEIGHT, WIDTH, 3) for _ in range(2))
    low, per_bin = np.zeros(3, np.float32), np.ones(3, np.float32)
    pitch_y, pitch_x = HEIGHT / cells, WIDTH / cells
    y, x = int((c + 0.5) * pitch_y), int((c + 0.5) * pitch_x)
    image[y - 20 : y + 20, x - 24 : x + 24, 2] = 5
    size = WIDTH, HEIGHT, cells, cells, 1, 1
    at, group = ((BINS * c, c, 2), BINS) if far.lanes == 1 else ((c, c), 1)
    held = 0, 0, cells
    run("gather", at, image, grid, low, per_bin, 0, HEIGHT, 0, cells, 0, *held, *size, group=group)
    assert abs(grid[2, c, c, 5] / (pitch_x * pitch_y) - 1) < 0.01
    assert grid[2, c, c, 6] < 0.001
    weights = np.array([0.25, 0.5, 0.25], np.float32)
    grid[2, c, c, :] = 4
    for numbers in ((cells, 1, cells, cells), (cells, cells, cells, 1)):
        other[2, c, c, 0] = 0
        run("blur", (0, c, 2 * cells + c), grid, other, weights, 1, *numbers, cells * cells, 0, cells, 1)
        assert other[2, c, c, 0] == 2
    sums = far.zeros(np.float32, 3 * cells, BINS)
    run("row_sums", (0, c, 2), grid, sums, cells, cells, cells, 0, cells)
    assert sums[2 * cells + c, 0] == 4
    grid[2, c, c] = 0
    grid[2, c, c, :2] = 1, 3
    run("cumulate", (c, 2 * cells + c), grid, cells, 3 * cells)
    assert grid[2, c, c, :3].tolist() == [0, 0.25, 1]
    grid[2, c - 1 : c + 2, c - 1 : c + 2] = 0.5
    inverse = np.tile(np.arange(INVERSE + 1, dtype=np.float32), 3)
    run("match", (x, y), image, grid, inverse, matched, low, per_bin, 1.0, 0, HEIGHT, *held, *size)
    assert matched[y, x, 2] == INVERSE // 2
    image[Y, X] = 1, 2, 3
    table = (np.arange(10) + 100 * np.arange(3)[:, None]).astype(np.int16)
    run("table", (X, Y), image, table, matched, 0, 10, WIDTH, HEIGHT)
    assert matched[Y, X].tolist() == [1, 102, 203]
    place, total = far.zeros(np.float32, HEIGHT, WIDTH), far.zeros(np.int32, HEIGHT, WIDTH, 3)
    place[Y, X], image[Y, X] = 1, (4, 5, 6)
    total[Y, X] = 1000
    run("blend", (X, Y), image, place, total, 1, 2, 0, 0, WIDTH, HEIGHT)
    assert image[Y, X].tolist() == [8, 9, 10]  # (1000 + 256 n) / 256, rounded


def moments(far: Far) -> None:
    cells, c = 14000, 13900

    def run(name, at, *arguments):
        print("moments", name, flush=True)
        macros = {name: values[0] for name, values in TABLES.items()}
        far.run("moments", name, at, *arguments, INVERSE=INVERSE, **macros, CHANNELS=3)

    image, matched = (far.zeros(np.int16, HEIGHT, WIDTH, 3) for _ in range(2))
    sums, around = far.zeros(np.float32, 3, cells, cells, 6), far.zeros(np.float32, 3, cells, cells, 4)
    y, x = int((c + 0.5) * HEIGHT / cells), int((c + 0.5) * WIDTH / cells)
    image[y - 9 : y + 9, x - 9 : x + 9, 2] = 13
    size = WIDTH, HEIGHT, cells, cells, 1, 1
    held = 0, 0, cells
    run("gather", (c, c, 2), image, sums, 2, 0, HEIGHT, 0, cells, 0, *held, *size)
    weight = sums[2, c, c, 0]
    assert weight > 10
    run("about", (c, 2 * cells + c), sums, cells, 3 * cells)
    assert sums[2, c, c].tolist() == [0, 13, 0, 0, 0, 0]
    run("gather", (c, c, 2), image, sums, 5, 0, HEIGHT, 0, cells, 0, *held, *size)
    assert sums[2, c, c].tolist() == [weight, 13, 0, 0, 0, 0]
    around[2, c - 1 : c + 2, c - 1 : c + 2, :2] = 10, 1
    overall, nothing = np.tile(np.array([100, 2], np.float32), 3), np.zeros(16, np.float32)
    limits = np.full(3, -500, np.float32), np.full(3, 500, np.float32), np.ones(3, np.float32)
    tables = nothing, nothing, nothing, overall
    run("match", (x, y, 2), image, around, *tables, matched, *limits, 1.0, 1, 0, HEIGHT, *held, *size)
    assert matched[y, x, 2] == 106


def steerable(far: Far) -> None:
    def run(name, at, *arguments):
        print("steerable", name, flush=True)
        far.run("steerable", name, at, *arguments, RADIUS=6, CHANNELS=3)

    image, rest, rest_matched, matched = (far.zeros(np.int16, HEIGHT, 3 * WIDTH) for _ in range(4))
    before, after = ([far.zeros(np.int16, HEIGHT, 3 * WIDTH) for _ in range(4)] for _ in range(2))
    rows = far.zeros(np.float32, 4, HEIGHT, 3 * WIDTH)
    taps, angular = np.ones(4 * 13, np.float32), np.ones(16, np.float32)
    rows_held, around = (HEIGHT, HEIGHT, WIDTH, 0), (0, HEIGHT, 0, HEIGHT, WIDTH, HEIGHT, 0)
    i = 3 * X
    at = (i if far.lanes == 1 else i // 16, Y)
    image[Y, i] = 5
    run("rows", at, image, rows, taps, *rows_held)
    assert rows[:, Y, i].tolist() == [5] * 4
    rows[:, Y, i] = 1
    run("columns", at, rows, *before, taps, angular, 10.0, *around)
    assert [band[Y, i] for band in before] == [20] * 4
    run("spread", at, *before, *after, rows, taps, angular, 0.01, 0, *around)
    assert rows[:, Y, i].tolist() == [16] * 4
    rows[:, Y, i - 64 : i + 64] = 0
    rows[3, Y, i] = 2
    run("rest", at, image, rows, rest, taps, 0, *rows_held)
    assert rest[Y, i] == 7
    rest_matched[Y, i] = 10
    limits = np.full(3, -500, np.float32), np.full(3, 500, np.float32)
    run("add", at, image, rows, rest, rest_matched, matched, taps, *limits, 1.0, 0, 0, *rows_held)
    assert matched[Y, i] == 6


def superpixels(far: Far) -> None:
    def run(name, at, *arguments):
        print("superpixels", name, flush=True)
        far.run("superpixels", name, at, *arguments)

    across, down, gx, n = 20000, 20000, 19000, 15000
    lab = far.zeros(np.int16, HEIGHT, WIDTH, 4)
    lab[Y, X : X + 3] = 1, 2, 3, 1
    candidates, active = far.zeros(np.int32, down, across, 9, 4), far.zeros(np.uint8, down, across)
    strips, edges = np.zeros((down, 4), np.int32), np.zeros(across + 1, np.int32)
    cells, sums = np.full(WIDTH, gx, np.int32), far.zeros(np.int32, down, across, 9, 6)
    slots, totals = far.zeros(np.uint8, HEIGHT, WIDTH), far.zeros(np.int64, down, across, 9, 6)
    strips[n], edges[gx : gx + 2] = (Y, Y + 1, 18000, Y), (X, X + 3)
    candidates[18000, gx, 4, 0], active[18000, gx] = -5, 1
    columns = range(X, X + 3) if far.lanes == 1 else [gx]
    for keep in (0, 1):
        numbers = WIDTH, across, down, 0, 0, 0, keep
        for column in columns:
            run("assign", (column, n), lab, candidates, strips, edges, cells, active, sums, slots, *numbers)
    assert sums[n, gx, 4, :4].tolist() == [3, 3, 6, 9]
    assert slots[Y, X : X + 3].tolist() == [4] * 3
    first = np.zeros(down + 1, np.int32)
    first[18000:18002] = n, n + 1
    run("total", (gx, 18000), sums, first, active, totals, across, down)
    assert totals[18000, gx, 4, 0] == 3
    if far.lanes == 1:
        run("clear", (gx, n), strips, active, sums, across, down)
        assert not sums[n, gx].any()
    reduced = far.zeros(np.int32, HEIGHT, WIDTH, 4)
    run("reduce", (X, Y), lab, reduced, WIDTH, 0, HEIGHT, 1, WIDTH, 0, HEIGHT)
    run("means", (X, Y), reduced, lab, 1, WIDTH, 0, HEIGHT)
    zeros, one, seeds = np.zeros(WIDTH, np.int32), np.float64(1), far.zeros(np.uint16, HEIGHT, WIDTH)
    run("seeds", (X, Y), lab, slots, zeros, zeros, seeds, WIDTH, HEIGHT)
    assert (lab[Y, X].tolist(), seeds[Y, X]) == ([1, 2, 3, 2], 1 << 4 | 1 << 0)
    seeds[Y, X : X + 3], slots[Y, X : X + 3] = 17, 0
    tables = lab, candidates, strips, edges, cells, seeds, slots
    for column in columns:
        run("refine", (column, n), *tables, WIDTH, across, down, 0, 0, 0, 0, WIDTH)
    assert slots[Y, X : X + 3].tolist() == [4] * 3
    totals[18000, gx, 4, :4] = 3, 3, 6, 9
    tables = zeros, edges, far.zeros(np.float64, down, across, 5), far.zeros(np.uint8, down, across)
    far.run("slic_seeds", "move", (gx, 18000), totals, active, *tables, across, down, 0, 0, one, one, 1)
    assert (tables[2][18000, gx, :3].tolist(), tables[3][18000, gx]) == ([1, 2, 3], 1)
    tables = *tables[2:], *tables[:2], candidates, active
    far.run("slic_seeds", "follow", (gx, 18000), *tables, across, down, 0, 0, 9, -8 * one, *[one] * 3, 0)
    assert candidates[18000, gx, 4, 0] == 64 + 256 + 576
    powers, runs = np.zeros((1, 21), np.int64), np.array([[Y, X, X + 3]], np.int32)
    run("powers", (0,), lab, np.array([0, 1], np.int32), runs, powers, 1, WIDTH, 0)
    assert powers[0, [0, 7, 14]].tolist() == [3, 6, 9]

    side, y, x = 29968, 29000, 29000
    image, other = (far.zeros(np.float32, 4, side + 32, side + 32) for _ in range(2))
    image[3, y + 16, x + 16] = 8
    taps, plane = np.array([0.25, 0.5, 0.25], np.float32), (side + 32) ** 2
    for step in (1, side + 32):
        other[3, y + 16, x + 16] = 0
        at = (x if far.lanes == 1 else x // 8, 3 * side + y)
        run("blur", at, image, other, taps, 1, side, side, side + 32, plane, 16, step)
        assert other[3, y + 16, x + 16] == 4
    image[3, 2 * 14000 + 16 : 2 * 14000 + 18, 2 * 14000 + 16 : 2 * 14000 + 18] = 1
    run("halve", (14000, 3 * 14984 + 14000), image, other, side + 32, plane, 14984, 14984, side + 32, plane, 16)
    assert other[3, 14016, 14016] == 4
    image[:, y + 16, x + 16] = 8, 16, 32, 2
    boxes, sum_of = np.array([[x, y, 1, 0], [0, 0, 0, 1]], np.int32), np.zeros((1, 4), np.float32)
    run("gather", (0,), boxes, np.array([2], np.uint16), image, sum_of, 1, side + 32, plane, 16)
    assert sum_of[0].tolist() == [8, 16, 32, 0]


def quilting(far: Far) -> None:
    columns, patch, overlap, i, j = 10000, 64, 16, 9000, 9000
    cell, across = i * columns + j, SIDE // 16

    def run(name, at, *arguments):
        print("quilting", name, flush=True)
        far.run("quilting", name, at, *arguments)

    def facts(candidates: int = 65536, levels: int = 16) -> np.ndarray:
        grid = patch, overlap, 48 * columns, 48 * columns, columns, columns, 0, 0
        squares = 16, 3, 8, across
        rest = SIDE, SIDE - 63, SIDE - 63, *squares, candidates, levels, 4, 8, 0, 0, 0, 0, 0, 0, 0
        return np.array((*grid, *rest), np.uint32)

    xs = np.arange(columns, dtype=np.int32) * 48
    offset = far.zeros(np.uint32, columns, columns)
    vertical, horizontal = (far.zeros(np.uint8, columns, columns, patch) for _ in range(2))
    exemplar = far.zeros(np.int16, SIDE, SIDE, 3)
    plan = xs, xs, offset, vertical, horizontal
    offset[i, j], vertical[i, j] = AT_E, 3
    source = np.zeros((1, 2), np.uint32)
    where = np.full(2, j, np.int32), np.full(1, i, np.int32)
    for x in range(2):
        run("render", (x, 0), facts(), *plan, *where, source, 48 * j + 2, 48 * i + 20, 2, 1)
    assert source[0].tolist() == [20 << 16 | 50, E + 20 << 16 | E + 3]

    n = 1200000
    order = np.zeros(n + 1, np.uint32)
    order[n] = cell
    offset[i, j - 1], offset[i, j] = AT_E, 0
    exemplar[E + 20, E + 50] = 1, 2, 3
    target = far.zeros(np.int16, n + 1, patch, patch, 3)
    run("target", (20, n), facts(), *plan, order, 0, exemplar, target, n + 1)
    assert target[n, 20, 2].tolist() == [1, 2, 3]
    target[n, :4, :4] = 16
    coarse = far.zeros(np.int16, n + 1, patch // 4, patch // 4, 3)
    run("reduce", (0, n), facts(), target, coarse, n + 1)
    assert coarse[n, 0, 0].tolist() == [16] * 3
    labels = SIDE // 4
    finer = far.zeros(np.uint8, labels, labels, 16)
    finer[E // 4 : E // 4 + 16, E // 4 : E // 4 + 16, 15] = 9
    histogram = far.zeros(np.int16, n + 1, 16, 256)
    run("histogram", (15, n), facts(), *plan, order, 0, finer, histogram, n + 1)
    assert histogram[n, 15, 9] == 64

    offset[i, j], offset[i, j - 1] = AT_E, 0
    exemplar[E : E + patch, E : E + 5] = 50  # the cut keeps away from what is unlike its left neighbor
    table = far.zeros(np.int32, n + 1, 2, patch, overlap)
    run("cut", (0, n), facts(), *plan, order, 0, n + 1, exemplar, table, 0)
    assert set(vertical[i, j].tolist()) == {5}

    candidate, cost = far.zeros(np.uint32, n + 1, 65536), far.zeros(np.int64, n + 1, 65536)
    best = far.zeros(np.uint32, n + 1)
    key_map = far.zeros(np.uint32, SIDE - 63, SIDE - 63)
    nothing, keys = np.zeros(1, np.int32), far.zeros(np.int32, columns, columns)
    offsets = np.array([AT_E])
    target[n] = 0
    use = np.zeros(across**2, np.int32), np.zeros(across**2, np.int32), 0
    in_step = np.zeros(10, np.uint32), nothing
    labels = finer, histogram, nothing, nothing
    place = order, 0, n + 1, keys, target, exemplar, coarse, exemplar, *labels, *use, *in_step
    units, content = (np.int64(0),) * 4, (offsets, np.array([0, 1, 0, 1], np.int32), key_map)
    price = far.zeros(np.int64, n + 1, 65536)
    run("score", (0, n), facts(levels=0), *plan, *place, *units, *content, candidate, cost, price)
    assert candidate[n, 0] == AT_E
    cost[n, 1:] = (1 << 63) - 1  # nothing else is to be had
    exemplar[E : E + patch, E : E + patch] = 0
    exemplar[E, E] = 3, 0, 0
    number = far.zeros(np.int32, n + 1)
    run("best", (n,), facts(levels=0), *plan, *place, *units, *content, candidate, cost, price, best, number, 1)
    assert best[n] == (E - 1) << 16 | (E + 1)  # the first place next to it without that pixel; it has the same key


def multiscale(far: Far) -> None:
    def run(name, at, *arguments):
        print("multiscale", name, flush=True)
        far.run("multiscale", name, at, *arguments, RUN=1 if far.lanes == 1 else 16)

    parent, texel = (far.zeros(np.uint32, HEIGHT, WIDTH) for _ in range(2))
    parent_r, r, color = (far.zeros(np.int16, HEIGHT, WIDTH, 4) for _ in range(3))
    stack, finer, spacing = np.zeros((1 << 10, 4), np.int16), np.zeros(1, np.int32), np.ones(1, np.int32)
    stack[5] = 10, 20, 30, 0
    py, px = 24000 + Y // 2, 29000 + X // 2
    parent[py, px], parent_r[py - 1 : py + 2, px - 1 : px + 2] = 5, 16
    places = WIDTH, 29000, 24000, WIDTH, HEIGHT
    far_away = (np.int64(0),) * 4
    run(
        "upsample",
        (X, Y),
        parent,
        parent_r,
        texel,
        r,
        color,
        stack,
        finer,
        spacing,
        *(np.ones(1, np.int32), 5),
        *places,
        *far_away,
        *(np.uint32(3), np.uint32(1), 0, 256),
        *(0,) * 4,  # nothing is kept
    )
    assert texel[Y, X] == 5
    assert r[Y, X].tolist() == [16] * 4
    assert color[Y, X].tolist() == [26, 36, 46, 16]

    i, j = X // 32 * 16, Y // 2
    at = (i if far.lanes == 1 else i // 16, j)
    x = 2 * i
    links, records = np.full(2048, 77, np.uint32), np.zeros((1024, 32), np.int16)
    offsets, basis = np.zeros((2048, 4), np.int16), np.zeros((26, 2, 16, 2), np.int16)
    r[Y, x] = 1
    given = texel, r, color, links, records, offsets, basis, spacing, 5
    run("correct", at, *given, WIDTH, 0, 0, i + 1, j + 1, 8, 0, 0, 0, 0)
    assert texel[Y, x] == 77
    texel[Y, x] = 5
    run("color", (i, j), texel, r, stack, color, WIDTH, 0, 0, i + 1, j + 1)
    assert color[Y, x].tolist() == [11, 21, 31, 1]


CASES = (patchmatch, histograms, moments, steerable, superpixels, quilting, multiscale)

if __name__ == "__main__":
    lanes, *names = sys.argv[1:]
    held = Far(int(lanes))
    for case in CASES:
        if not names or case.__name__ in names:
            case(held)
    print("all")
