# SPDX-License-Identifier: Apache-2.0
"""Lower bounds of a kernel launch: bytes that must be read and written at least once.

Bounds are expressions of the names of a kernel's arguments in its .cl file. A buffer stands for its size in bytes, a
number for itself. The program's macros, such as LANES, and the launch's `items` are also defined. A table that is read
at random (exemplars, records of candidates) counts once, or not at all if the launch does not contain its size. So a
kernel that waits for such a table is far from its bound.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from types import SimpleNamespace as Launch

import numpy as np

from oiiotex.engine.opencl.source import kernel_source

_SOURCES = resources.files("oiiotex") / "cl"
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_DEFINE = re.compile(r"^[ \t]*#[ \t]*define[ \t]+(\w+)[ \t]+((?:[^\\\n]|\\\n|\\.)*)$", re.MULTILINE)
_KERNEL = re.compile(r"__kernel\b[^;{]*?\bvoid\s+(\w+)\s*\(")
_BINS = 256  # of quilting's histograms


def _quilting_patch(a: Launch) -> float:
    return a.vertical / (a.offset / 4)  # a byte for each row of each cell


def _rows(a: Launch, first: str, end: str) -> int:
    """Rows that a launch over a band of them makes; `from` is a word of Python's."""
    return max(1, getattr(a, end) - getattr(a, first))


def _matching(a: Launch, rows: int) -> float:
    return a.columns * rows * (16 + 2 * a.CHANNELS) + a.e_rows * (2 * a.CHANNELS * a.e_width + 4 * a.e_columns)


BYTES: dict[str, Callable[[Launch], float]] = {
    "patchmatch_pad": lambda a: 2 * a.CHANNELS * (a.width * a.height + (a.width + a.PATCH - 1) * a.rows),
    "patchmatch_score": lambda a: a.columns * a.rows * (8 + 2 * a.CHANNELS),
    "patchmatch_cost": lambda a: 12 * a.columns * a.rows,
    "patchmatch_propagate": lambda a: _matching(a, _rows(a, "from", "to")),
    "patchmatch_search": lambda a: _matching(a, _rows(a, "from", "to")),
    "patchmatch_follow": lambda a: _matching(a, _rows(a, "from", "to")),
    "patchmatch_count": lambda a: 4 * a.columns * a.rows,
    "patchmatch_uses_rows": lambda a: 8 * a.e_columns * a.e_rows,
    "patchmatch_penalty": lambda a: 12 * a.e_columns * a.e_rows,
    "patchmatch_vote": lambda a: (4 * a.columns + 2 * a.CHANNELS * a.width) * _rows(a, "top", "bottom"),
    "patchmatch_pick": lambda a: 4 * (a.columns + a.width) * _rows(a, "top", "bottom"),
    "patchmatch_hold": lambda a: 2 * a.CHANNELS * a.width * a.height,
    "patchmatch_ease": lambda a: (6 * a.CHANNELS + 1) * a.width * a.height,
    "use_prices_count": lambda a: 4 * a.columns * a.rows,
    "use_prices_ascend": lambda a: 28 * a.kinds,
    "use_prices_rows": lambda a: 8 * a.e_columns * a.counted,
    "use_prices_add": lambda a: 13 * a.e_columns * a.e_rows,
    "histograms_gather": lambda a: (
        2 * a.CHANNELS * a.width * _rows(a, "begin", "end") + 4 * a.BINS * a.CHANNELS * a.cells_x * a.count
    ),
    "histograms_blur": lambda a: 8 * a.BINS * a.CHANNELS * a.n * a.across,
    "histograms_row_sums": lambda a: 4 * a.BINS * a.CHANNELS * a.count * (a.cells_x + 1),
    "histograms_totals": lambda a: a.BINS * a.CHANNELS * (4 * a.rows + 8),
    "histograms_inverse": lambda a: a.CHANNELS * (8 * a.BINS + 4 * a.INVERSE),
    "histograms_cumulate": lambda a: 8 * a.BINS * a.cells_x * a.rows,
    "histograms_match": lambda a: 4 * a.CHANNELS * a.width * a.count,
    "histograms_table": lambda a: 4 * a.CHANNELS * a.width * a.height,
    "histograms_values": lambda a: 2 * a.CHANNELS * a.width * a.height,
    "histograms_values_sum": lambda a: 4 * a.CHANNELS * a.entries * (a.parts + 1),
    "histograms_matching": lambda a: 10 * a.CHANNELS * a.entries,
    "histograms_blend": lambda a: (4 + 12 * a.CHANNELS) * a.width * a.count,
    "moments_gather": lambda a: 2 * a.CHANNELS * a.width * _rows(a, "begin", "end") + 24 * a.CHANNELS * a.cells_x,
    "moments_about": lambda a: 32 * a.cells_x * a.rows,
    "moments_match": lambda a: 4 * a.CHANNELS * a.width * a.count,
    "steerable_rows": lambda a: 18 * a.CHANNELS * a.width * a.count,
    "steerable_columns": lambda a: 24 * a.CHANNELS * a.width * a.count,
    "steerable_spread": lambda a: (24 + 8 * a.changes) * a.CHANNELS * a.width * a.count,
    "steerable_rest": lambda a: 20 * a.CHANNELS * a.width * a.count,
    "steerable_add": lambda a: 24 * a.CHANNELS * a.width * a.count,
    "candidates_start": lambda a: 41 * 4**a.side,
    "candidates_propagate": lambda a: 48 * 4**a.side,
    "candidates_search": lambda a: 48 * 4**a.side,
    "multiscale_upsample": lambda a: 23 * a.width * a.height,
    "multiscale_correct": lambda a: (
        68 * a.count_x * a.count_y
    ),  # 12 of each of four pixels in, 8 + 12 of one in and out
    "multiscale_color": lambda a: 20 * a.count_x * a.count_y,
    "quilting_render": lambda a: 4 * a.width * a.height,
    "quilting_reduce": lambda a: 1.0625 * a.target,
    "quilting_score": lambda a: a.candidate + a.cost,
    "quilting_histogram": lambda a: 2 * _BINS * a.items,
    "quilting_best": lambda a: a.candidate + a.cost,
    "quilting_assign": lambda a: a.cells * 16,
    "quilting_target": lambda a: 4 * a.cells * _quilting_patch(a),
    "quilting_cut": lambda a: a.cells * _quilting_patch(a),
    "superpixels_clear": lambda a: 216 * a.across * a.count,
    "superpixels_assign": lambda a: a.lab + (a.slots if a.keep else a.sums),  # all cells; those that rest are skipped
    "superpixels_total": lambda a: a.sums + a.totals,
    "superpixels_reduce": lambda a: a.lab + 16 * a.across * a.down,
    "superpixels_means": lambda a: 24 * a.across * a.down,
    "superpixels_seeds": lambda a: 11 * a.width * a.height,
    "superpixels_refine": lambda a: a.lab + a.slots,  # less where a square has but one seed
    "slic_seeds_move": lambda a: a.totals + a.centers if a.start else a.active,  # more where cells are active
    "slic_seeds_follow": lambda a: a.centers + a.candidates,
    "superpixels_powers": lambda a: a.lab + 2 * a.powers,
    "superpixels_blur": lambda a: 32 * a.width * a.height,
    "superpixels_halve": lambda a: 80 * a.width * a.height,
    "superpixels_shares": lambda a: a.runs + a.shares,
    "filter_bank_across": lambda a: 8 * a.width * a.rows,
    "filter_bank_down": lambda a: 8 * a.width * a.height * a.layers,
    "filter_bank_nearest": lambda a: a.planes + a.pixels,
    "superpixels_gather": lambda a: a.shares + 16 * a.superpixels,
    "atlas_missing": lambda a: 16 * a.count,
    "atlas_choose": lambda a: 36 * a.count,
    "atlas_adopt": lambda a: 20 * a.count,
    "features_pool": lambda a: a.counts + a.pooled,
    "affinity_nearest": lambda a: a.points + 8 * a.rows * a.wanted,
    "affinity_similar": lambda a: a.columns + a.squared + a.counted + a.weights,
    "affinity_scaled": lambda a: a.columns + 2 * a.weights,
    "factorization_spread": lambda a: a.columns + a.weights + a.x + a.before + a.out,
    "factorization_step": lambda a: a.columns + a.weights + 8 * a.rows,
    "factorization_product": lambda a: a.a + a.b + a.out,
    "factorization_gram": lambda a: a.a + a.b + a.out,
    "factorization_transposed": lambda a: a.matrix + a.out,
    "factorization_memberships": lambda a: a.linear + 2 * a.at,
    "factorization_advance": lambda a: a.linear + a.ahead + a.trial,
    "factorization_project": lambda a: a.trial + 2 * a.at + a.ahead,
    "potts_around": lambda a: a.neighbors + a.member + a.around,
    "potts_members": lambda a: a.alone + a.around + a.member,
    "potts_winners": lambda a: a.votes + a.winners,
}

# How many things of a kind a launch looks at, at most, where arithmetic or random reads are what it is about.
WORK: dict[str, tuple[str, Callable[[Launch], float]]] = {
    "patchmatch_score": ("patch distances", lambda a: a.columns * a.rows),
    "patchmatch_propagate": ("patch distances", lambda a: 4 * a.columns * _rows(a, "from", "to")),
    "patchmatch_search": ("patch distances", lambda a: (a.end - a.begin) * a.columns * _rows(a, "from", "to")),
    "patchmatch_follow": ("patch distances", lambda a: (a.end - a.begin) * a.columns * _rows(a, "from", "to")),
    "patchmatch_vote": ("votes", lambda a: a.PATCH**2 * a.width * _rows(a, "top", "bottom")),
    "patchmatch_pick": ("votes", lambda a: a.PATCH**2 * a.width * _rows(a, "top", "bottom")),
    "candidates_start": ("distances", lambda a: 16 * 4**a.side),
    "candidates_propagate": ("distances", lambda a: 4 * 4**a.side),
    "candidates_search": ("distances", lambda a: (1 + a.side) * 4**a.side),
    "multiscale_correct": ("distances", lambda a: 18 * a.count_x * a.count_y),
    "superpixels_assign": ("distances", lambda a: 9 * a.lab / 8),
    "filter_bank_across": ("taps", lambda a: (2 * a.radius + 1) * a.width * a.rows),
    "filter_bank_down": ("taps", lambda a: (2 * a.radius + 1) * a.width * a.height * a.layers),
    "filter_bank_nearest": ("distances", lambda a: a.count * a.pixels),
    "quilting_score": ("candidates", lambda a: a.candidate / 4),
    "affinity_nearest": ("distances", lambda a: a.rows * a.count),
    "factorization_spread": ("products", lambda a: a.columns / 4 * a.width),
    "factorization_gram": ("products", lambda a: a.rows * a.tall * a.width),
    "factorization_product": ("products", lambda a: a.rows * a.inner * a.width),
}


@functools.cache
def signatures(stem: str) -> dict[str, tuple[str, ...]]:
    """Names of the arguments of each kernel of cl/<stem>.cl, by the kernel's name."""
    text = _COMMENT.sub("", kernel_source(stem))
    macros = {name: body.replace("\\\n", " ") for name, body in _DEFINE.findall(text)}
    found = {}
    for match in _KERNEL.finditer(text):
        depth, end = 1, match.end()
        while depth:
            depth += {"(": 1, ")": -1}.get(text[end], 0)
            end += 1
        words = re.sub(r"\b\w+\b", lambda word: macros.get(word[0], word[0]), text[match.end() : end - 1])
        found[match[1]] = tuple(re.findall(r"\w+", part)[-1] for part in words.split(",") if part.strip())
    return found


def stems() -> list[str]:
    """The files of kernels."""
    return sorted(file.name.removesuffix(".cl") for file in _SOURCES.iterdir() if file.name.endswith(".cl"))


@functools.cache
def _defaults(stem: str) -> dict[str, int]:
    """Macros that a file sets to a number itself; those of a program come from outside and win."""
    return {name: int(body) for name, body in _DEFINE.findall(kernel_source(stem)) if body.strip().isdigit()}


def launch_of(stem: str, kernel: str, macros: dict[str, int], shape: tuple[int, ...], arguments: tuple) -> Launch:
    """A launch by the names of its kernel's arguments; those that cannot be read are omitted."""
    names = signatures(stem).get(kernel, ())
    values = [a if isinstance(a, (int, float, np.generic)) else getattr(a, "size", 0) for a in arguments]
    named = {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in zip(names, values, strict=False)
    }
    return Launch(**{**_defaults(stem), **macros, **named, "items": math.prod(shape)})


@dataclass
class Cost:
    """The least work of a kernel's launches; None if no bound is declared, or it no longer matches the kernel."""

    bytes: float | None = 0.0
    work: float | None = 0.0

    def add(self, kernel: str, launch: Launch) -> None:
        """Count one more launch."""
        self.bytes = _more(self.bytes, BYTES.get(kernel), launch)
        self.work = _more(self.work, WORK[kernel][1] if kernel in WORK else None, launch)


def _more(sum_: float | None, declared: Callable[[Launch], float] | None, launch: Launch) -> float | None:
    if sum_ is None or declared is None:
        return None
    try:
        return sum_ + declared(launch)
    except (AttributeError, ArithmeticError):  # an argument has another name now
        return None
