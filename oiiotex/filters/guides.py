# SPDX-License-Identifier: Apache-2.0
"""A guide image as what every cell of a quilt asks for: LSA16 section 6.1, figure 12."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..analysis.regions import ContentTable
from ..color import as_float
from ..errors import ImageError, ParameterError
from ..images import Part, channels_of
from ..session import Session
from ..synthesis.plans import Grid
from ..synthesis.quilting import GUIDE
from ..tiles import remembered
from ..windows import Window

SAMPLES = 16  # of the guide along a side of a cell: its histogram is taken from these
_NAMED = 5  # colours that an error names


@dataclass(frozen=True)
class Meaning:
    """What the codes of a guide mean.

    Attributes
    ----------
    codes : (n,) int64
        Ascending: ids, or colours as red << 16 | green << 8 | blue.
    keys : (n, 2) int64
        (k1, k2) of each.
    pure : (n,) bool
        It names one label, and so also says where in a cell it is wanted.
    colours : bool
    """

    codes: np.ndarray
    keys: np.ndarray
    pure: np.ndarray
    colours: bool

    def name(self, code: int) -> str:
        """As it is written in a table."""
        return f"{code >> 16},{code >> 8 & 255},{code & 255}" if self.colours else str(code)


def meaning_of(guide: Part, table: Path | None, labels: np.ndarray) -> Meaning:
    """What a guide's ids or colours mean: by the table, or, of ids without one, the labels themselves.

    Parameters
    ----------
    guide : Part
    table : Path or None
        JSON: {"255,0,0": 3, "0,255,0": [3, 1], ...} or {"7": 3, ...}: colours in 8 bits or ids -> a label or a key.
    labels : (n,)
        The ids that the exemplar has.

    Raises
    ------
    ImageError, ParameterError
        A guide of colours has no table, or a table cannot be read or names a label that there is not.
    """
    if table is None:
        if not _holds_ids(guide):
            raise ParameterError(f"guide {guide.name} holds colours: table=FILE.json says which label each one means")
        ids = labels[labels > 0].astype(np.int64)
        return Meaning(ids, np.stack([ids, ids], 1), np.ones(len(ids), bool), False)
    try:
        held = json.loads(table.read_text())
        rows = sorted((_code(name), value) for name, value in held.items())
    except (OSError, ValueError, AttributeError, TypeError) as error:
        raise ImageError(f"table={table}: not a table of '255,0,0' or ids to labels or [k1, k2]: {error}") from error
    if not rows:
        raise ImageError(f"table={table} is empty")
    keys = [tuple(value) if isinstance(value, list) else (value, value) for _, value in rows]
    for key in keys:
        if len(key) != 2 or not all(type(k) is int and k in labels and k > 0 for k in key):
            there = f"1 to {labels.max()}" if len(labels) else "none"
            raise ImageError(f"table={table}: {list(key)} is no label or pair of labels; there is {there}")
    colours = [len(name.split(",")) == 3 for name in held]
    if any(colours) != all(colours):
        raise ImageError(f"table={table} has both colours and ids")
    return Meaning(
        np.array([code for code, _ in rows], np.int64),
        np.array(keys, np.int64),
        np.array([not isinstance(value, list) for _, value in rows]),
        colours[0],
    )


def _code(name: str) -> int:
    numbers = [int(n) for n in name.split(",")]
    if len(numbers) not in (1, 3) or (len(numbers) == 3 and not all(0 <= n <= 255 for n in numbers)):
        raise ValueError(f"'{name}'")
    return numbers[0] if len(numbers) == 1 else numbers[0] << 16 | numbers[1] << 8 | numbers[2]


def _holds_ids(guide: Part) -> bool:
    return len(channels_of(guide.spec).colour) == 1


def labels_met(guide: Part, meaning: Meaning, rows: int = 32, least: float = 0.01) -> list[int]:
    """The labels that the guide asks for by themselves, found on some of its rows; those it hardly asks for are not."""
    whole = guide.window
    channels = channels_of(guide.spec).colour
    if meaning.colours != (len(channels) > 1):
        return []  # `wishes_of` says what is wrong
    met = np.zeros(len(meaning.codes), np.int64)
    for y in np.unique(whole.top + (2 * np.arange(rows) + 1) * whole.height // (2 * rows)):
        row = guide.read(Window(whole.left, int(y), whole.right, int(y) + 1))[0]
        codes = _codes(row, channels, meaning.colours)
        place = np.minimum(np.searchsorted(meaning.codes, codes), len(met) - 1)
        met += np.bincount(place[meaning.codes[place] == codes], minlength=len(met))
    often = meaning.pure & (met >= max(1, least * met.sum()))
    return sorted({int(k) for k in meaning.keys[often, 0]})


@dataclass(frozen=True)
class Wishes:
    """What a guide asks of the cells of a grid.

    Attributes
    ----------
    keys : (rows, columns, 2) int32
        The two most frequent labels under each cell (LSA16 section 6.1), ties to the lower id.
    wanted : (rows, columns, GUIDE, GUIDE) uint16
        The label at the middles of its pieces, 0 where the guide names no single one.
    """

    keys: np.ndarray
    wanted: np.ndarray


def wishes_of(guide: Part, meaning: Meaning, grid: Grid, session: Session) -> Wishes:
    """One look through the guide, row of cells by row of cells; it is scaled to the output by the nearest pixel.

    Raises
    ------
    ImageError
        It has ids or colours that mean nothing: they are named, with how many of them were met.
    """
    rows, columns = grid.shape
    keys = np.zeros((rows, columns, 2), np.int32)
    wanted = np.zeros((rows, columns, GUIDE, GUIDE), np.uint16)
    unknown: dict[int, int] = {}
    kept = remembered(guide, session.cache)
    along_x = _samples(grid.xs, grid.patch, grid.width) * guide.spec.width // grid.width
    every = SAMPLES // GUIDE
    single = np.where(meaning.pure, meaning.keys[:, 0], 0).astype(np.uint16)
    for i, codes in enumerate(_rows(kept, meaning, grid)):
        met = codes[:, along_x.ravel()].reshape(SAMPLES, columns, SAMPLES).transpose(1, 0, 2)
        place = np.minimum(np.searchsorted(meaning.codes, met), len(meaning.codes) - 1)
        stray = meaning.codes[place] != met
        if stray.any():
            for code, count in zip(*np.unique(met[stray], return_counts=True), strict=True):
                unknown[int(code)] = unknown.get(int(code), 0) + int(count)
            continue
        keys[i] = _keys(place.reshape(columns, -1), meaning)
        wanted[i] = single[place[:, every // 2 :: every, every // 2 :: every]]
    if unknown:
        worst = sorted(unknown, key=lambda code: (-unknown[code], code))
        named = ", ".join(f"{meaning.name(code)} ({unknown[code]} samples)" for code in worst[:_NAMED])
        more = f" and {len(worst) - _NAMED} more" if len(worst) > _NAMED else ""
        what = "colours" if meaning.colours else "ids"
        raise ImageError(
            f"the guide has {what} that mean no label: {named}{more}; there is"
            f" {', '.join(meaning.name(int(code)) for code in meaning.codes[:8])} (draw it without smoothing)"
        )
    return Wishes(keys, wanted)


def _samples(places: np.ndarray, patch: int, size: int) -> np.ndarray:
    """Where cells that begin at `places` are looked at: (cells, SAMPLES), inside the output."""
    at = places[:, None].astype(np.int64) + (2 * np.arange(SAMPLES) + 1) * patch // (2 * SAMPLES)
    return np.where(at < 0, at + size, np.minimum(at, size - 1))


def _rows(guide: Part, meaning: Meaning, grid: Grid) -> Iterator[np.ndarray]:
    """For every row of cells the guide's codes on its sample rows: (SAMPLES, guide width) int64."""
    whole = guide.window
    channels = channels_of(guide.spec).colour
    if meaning.colours and len(channels) == 1:
        channels = channels * 3
    if not meaning.colours and len(channels) > 1:
        raise ImageError(f"the table names ids, but guide {guide.name} holds colours")
    for at in _samples(grid.ys, grid.patch, grid.height) * whole.height // grid.height:
        codes = np.empty((SAMPLES, whole.width), np.int64)
        for n, y in enumerate(at):  # row by row: where the torus closes they are not neighbours
            row = guide.read(Window(whole.left, whole.top + int(y), whole.right, whole.top + int(y) + 1))[0]
            codes[n] = _codes(row, channels, meaning.colours)
        yield codes


def _codes(row: np.ndarray, channels: tuple[int, ...], colours: bool) -> np.ndarray:
    if not colours:
        return np.rint(row[:, channels[0]]).astype(np.int64)
    eight = np.rint(np.clip(np.nan_to_num(as_float(row)), 0, 1) * 255).astype(np.int64)
    return eight[:, channels[0]] << 16 | eight[:, channels[1]] << 8 | eight[:, channels[2]]


def _keys(place: np.ndarray, meaning: Meaning) -> np.ndarray:
    """The key of every cell from its samples (cells, n) of indices into the codes: (cells, 2)."""
    cells, many = len(place), len(meaning.codes)
    counts = np.bincount((place + many * np.arange(cells)[:, None]).ravel(), minlength=cells * many)
    counts = counts.reshape(cells, many)
    first = counts.argmax(1)
    left = counts.copy()
    left[np.arange(cells), first] = 0
    second = np.where(left.max(1) > 0, left.argmax(1), first)
    found = meaning.keys[first].copy()
    both = meaning.pure[first]  # a pair stands as it is
    found[both, 1] = meaning.keys[second[both], 0]
    return found


def keys_in(table: ContentTable, wished: np.ndarray) -> tuple[np.ndarray, dict[tuple[int, int], tuple[int, int]]]:
    """Numbers of the wished keys (..., 2) in the table, and which of them had to be replaced by which."""
    codes = wished[..., 0].astype(np.int64) << 32 | wished[..., 1].astype(np.int64)
    present, inverse = np.unique(codes, return_inverse=True)
    numbers, replaced = np.empty(len(present), np.int32), {}
    for n, code in enumerate(present):
        key = int(code >> 32), int(code & 0xFFFFFFFF)
        numbers[n] = table.nearest(key)
        found = int(table.keys[numbers[n], 0]), int(table.keys[numbers[n], 1])
        if found != key:
            replaced[key] = found
    return numbers[inverse].reshape(codes.shape), replaced
