# SPDX-License-Identifier: Apache-2.0
"""A guide image as what every cell of a quilt asks for: LSA16 section 6.1, figure 12."""

from __future__ import annotations

import functools
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.demand import cached
from ..core.image import Channels, Part, channels_of
from ..core.window import Window
from ..deferred import np
from ..errors import ImageError, ParameterError, texture_filter
from ..io.documents import read_document
from ..labels.content_table import ContentTable
from ..labels.legend import code_of, codes_in, color_of, oklab_of
from ..session.resources import Resources
from .quilt_plan import Grid
from .quilter import GUIDE

if TYPE_CHECKING:
    from scipy.spatial import KDTree

log = logging.getLogger("oiiotex")

SAMPLES = 16  # of the guide along a side of a cell: its histogram is taken from these
_NAMED = 5  # colors that an error names
_ROWS = 32  # of a guide that are looked at for the labels that it asks for
_FAR = 2**53  # of ids in floats
_LEAST = 0.01  # of what it asks for: labels with less are hardly asked for


@dataclass(frozen=True)
class Meaning:
    """What the codes of a guide mean.

    Attributes
    ----------
    codes : (n,) int64
        Ascending: ids, or colors as `legend.code_of` has them.
    keys : (n, 2) int64
        (k1, k2) of each.
    pure : (n,) bool
        It names one label, and so also says where in a cell it is wanted.
    soft : float
        How far a color may be from one of `codes` to be taken for it, in Oklab.
    """

    codes: np.ndarray
    keys: np.ndarray
    pure: np.ndarray
    colors: bool
    soft: float = 0.0

    def name(self, code: int) -> str:
        """As it is written in a table."""
        return color_of(code) if self.colors else str(code)

    def find(self, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where each is in `codes`, or the nearest color within `soft`, and which are not."""
        place = np.minimum(np.searchsorted(self.codes, codes), len(self.codes) - 1)
        stray = self.codes[place] != codes
        if self.colors and self.soft and stray.any():
            others, inverse = np.unique(codes[stray], return_inverse=True)
            distance, nearest = self._nearest.query(oklab_of(others))
            place[stray], stray[stray] = nearest[inverse], (distance > self.soft)[inverse]
        return place, stray

    @functools.cached_property
    def _nearest(self) -> KDTree:
        """Its colors in Oklab."""
        from scipy.spatial import KDTree  # not loaded before it is needed

        return KDTree(oklab_of(self.codes))

    def strays(self, met: Strays, unit: str) -> str:
        """What codes that mean nothing are, for messages."""
        worst = sorted(met, key=lambda code: (-met[code].count, code))
        named = ", ".join(f"{self.name(code)} ({met[code].text(unit)})" for code in worst[:_NAMED])
        more = f" and {len(worst) - _NAMED} more" if len(worst) > _NAMED else ""
        limit = f", beyond soft={self.soft:g} of any that does" if self.colors and self.soft else ""
        return f"{'colors' if self.colors else 'ids'} that mean no label{limit}: {named}{more}"

    def codes_of(self, pixels: np.ndarray, channels: Channels) -> np.ndarray:
        """The codes of pixels of a guide, int64."""
        if not self.colors:
            ids = pixels[..., channels.color[0]]
            if ids.dtype.kind == "f":  # NaN and what no int64 holds mean no label
                ids = np.rint(np.clip(np.nan_to_num(ids.astype(np.float64), nan=-1), -_FAR, _FAR))
            return ids.astype(np.int64)
        three = channels.color if len(channels.color) == 3 else channels.color[:1] * 3
        return codes_in(pixels, three, channels.alpha)


@dataclass(frozen=True)
class Stray:
    """How often a code that means nothing was met, and at which pixel first."""

    count: int
    x: int
    y: int

    def text(self, unit: str) -> str:
        """For messages."""
        return f"{self.count} {unit}, the first at {self.x},{self.y}"


class Strays(dict[int, Stray]):
    """Codes that mean nothing, as they are met."""

    def add(self, codes: np.ndarray, stray: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
        """Note codes, (rows, columns), some of which mean nothing, met at x (columns,) and y (rows,)."""
        rows, columns = np.nonzero(stray)
        unique = np.unique(codes[rows, columns], return_index=True, return_counts=True)
        for code, first, count in zip(*unique, strict=True):
            before = self.get(int(code), Stray(0, int(x[columns[first]]), int(y[rows[first]])))
            self[int(code)] = Stray(before.count + int(count), before.x, before.y)


@dataclass(frozen=True)
class Table:
    """Which label, or key [k1, k2], codes mean; of a palette also those of the next finer level."""

    path: Path
    keys: dict[int, Any]
    finer: dict[int, Any]
    colors: bool
    level: int | None
    soft: float


SOFT = (
    "how far a color of a painting may be from one of the table to be taken for the nearest, in Oklab, where black and"
    " white are 1 apart: what soft brushes blend is within 0.2 of `palette`'s colors; 0: none"
)


def read_table(path: Path, soft: float = 0.0) -> Table:
    """A palette's JSON, or {"255,0,0": 3, "0,255,0": [3, 1], ...} in 8 bits, or {"7": 3, ...} of ids."""
    try:
        document = read_document(path)
        named: list[dict[str, Any]] = [document, {}]
        level = int(document["level"]) if "labels" in document else None
        if level is not None:
            named = [{entry["color"]: entry["id"] for entry in document[rows]} for rows in ("labels", "finer")]
        colors = {"," in name for rows in named for name in rows}
        keys, finer = ({code_of(n) if "," in n else int(n): key for n, key in rows.items()} for rows in named)
    except (ImageError, ValueError, KeyError, TypeError, AttributeError) as error:
        problem = f"not a table of '255,0,0' or ids to labels or [k1, k2], nor of {texture_filter('palette')}: {error}"
        raise ImageError(problem, parameter="table", value=str(path)) from error
    if not keys:
        raise ImageError(f"table={path} is empty")
    if len(colors) > 1:
        raise ImageError(f"table={path} has both colors and ids")
    return Table(path, keys, finer, colors.pop(), level, soft)


def meaning_of(guide: Part, table: Table | None, labels: np.ndarray, fine: bool = False) -> Meaning:
    """What a guide's ids or colors mean: by the table, or, of ids without one, the labels (n,) that the exemplar has.

    fine: it speaks of the table's finer level.
    """
    labels = labels[labels > 0].astype(np.int64)
    if not len(labels):
        raise ImageError("the label map has no label to paint with")
    rows = {} if table is None else table.finer if fine else table.keys
    if table is None or not rows:
        if len(channels_of(guide.spec).color) > 1:
            name = "fine" if fine else f"guide {guide.name}"
            raise ParameterError(f"{name} holds colors: table=FILE.json says which label each one means")
        return Meaning(labels, np.stack([labels, labels], 1), np.ones(len(labels), bool), False)
    codes = sorted(rows)
    pure = np.array([not isinstance(rows[code], list) for code in codes])
    keys = [[rows[code]] * 2 if alone else rows[code] for code, alone in zip(codes, pure, strict=True)]
    for key in keys:
        if len(key) != 2 or not all(type(k) is int and k in labels for k in key):
            raise ImageError(f"table={table.path}: {key} is no label or pair of labels; there is 1 to {labels.max()}")
    if fine and 0 not in rows:  # nothing is painted there, and brushes that are soft blend into it, too
        codes, keys, pure = [0, *codes], [[0, 0], *keys], np.concatenate([[True], pure])
    return Meaning(np.array(codes, np.int64), np.array(keys, np.int64), pure, table.colors, table.soft)


def labels_met(guide: Part, meaning: Meaning) -> list[int]:
    """The labels that the guide asks for by themselves, found on some of its rows; those it hardly asks for are not."""
    whole = guide.window
    channels = channels_of(guide.spec)
    if meaning.colors != (len(channels.color) > 1):
        return []  # `wishes_of` says what is wrong
    met = np.zeros(len(meaning.codes), np.int64)
    for y in np.unique(whole.top + (2 * np.arange(_ROWS) + 1) * whole.height // (2 * _ROWS)):
        row = guide.read(Window(whole.left, int(y), whole.right, int(y) + 1))[0]
        place, stray = meaning.find(meaning.codes_of(row, channels))
        met += np.bincount(place[~stray], minlength=len(met))
    often = meaning.pure & (met >= max(1, _LEAST * met.sum()))
    return sorted({int(k) for k in meaning.keys[often, 0]})


@dataclass(frozen=True)
class Wishes:
    """What a guide asks of the cells of a grid."""

    keys: np.ndarray  # (rows, columns, 2) int32: the two most frequent labels under each cell, ties to the lower id
    wanted: np.ndarray  # (rows, columns, GUIDE, GUIDE) uint16: labels at the middles of its pieces; 0: no single one


def wishes_of(guide: Part, meaning: Meaning, grid: Grid, resources: Resources) -> Wishes:
    """One look through the guide, row of cells by row of cells; it is scaled to the output by the nearest pixel.

    Raises ImageError where it has ids or colors that mean nothing: named, with how many of them were met.
    """
    rows, columns = grid.shape
    keys = np.zeros((rows, columns, 2), np.int32)
    wanted = np.zeros((rows, columns, GUIDE, GUIDE), np.uint16)
    unknown, blended = Strays(), 0
    kept = cached(guide, resources.cache)
    along_x = _samples(grid.xs, grid.patch, grid.width) * guide.spec.width // grid.width
    every = SAMPLES // GUIDE
    single = np.where(meaning.pure, meaning.keys[:, 0], 0).astype(np.uint16)
    for i, (y, codes) in enumerate(_rows(kept, meaning, grid)):
        met = codes[:, along_x.ravel()]
        place, stray = meaning.find(met)
        if stray.any():
            unknown.add(met, stray, guide.window.left + along_x.ravel(), y)
            continue
        blended += int(np.count_nonzero(meaning.codes[place] != met))
        place = place.reshape(SAMPLES, columns, SAMPLES).transpose(1, 0, 2)
        keys[i] = _keys(place.reshape(columns, -1), meaning)
        wanted[i] = single[place[:, every // 2 :: every, every // 2 :: every]]
    if unknown:
        meant = ", ".join(meaning.name(int(code)) for code in meaning.codes[:8])
        strays = meaning.strays(unknown, "samples")
        raise ImageError(f"the guide has {strays}; there is {meant}")
    if blended:
        share = 100 * blended / (rows * columns * SAMPLES**2)
        log.warning("%s: %.0f %% of it is of no color of the table, and taken for the nearest", guide.name, share)
    return Wishes(keys, wanted)


def _samples(places: np.ndarray, patch: int, size: int) -> np.ndarray:
    """Where cells that begin at `places` are looked at: (cells, SAMPLES), inside the output."""
    at = places[:, None].astype(np.int64) + (2 * np.arange(SAMPLES) + 1) * patch // (2 * SAMPLES)
    return np.where(at < 0, at + size, np.minimum(at, size - 1))


def _rows(guide: Part, meaning: Meaning, grid: Grid) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """For every row of cells its sample rows (SAMPLES,), and the guide's codes there: (SAMPLES, guide width) int64."""
    whole = guide.window
    channels = channels_of(guide.spec)
    if not meaning.colors and len(channels.color) > 1:
        raise ImageError(f"the table names ids, but guide {guide.name} holds colors")
    for at in _samples(grid.ys, grid.patch, grid.height) * whole.height // grid.height:
        codes = np.empty((SAMPLES, whole.width), np.int64)
        for n, y in enumerate(at):  # row by row: where the torus closes they are not neighbors
            row = guide.read(Window(whole.left, whole.top + int(y), whole.right, whole.top + int(y) + 1))[0]
            codes[n] = meaning.codes_of(row, channels)
        yield whole.top + at, codes


def _keys(place: np.ndarray, meaning: Meaning) -> np.ndarray:
    """The key of every cell from its samples (cells, n) of indices into the codes: (cells, 2)."""
    cells, many = len(place), len(meaning.codes)
    counts = np.bincount((place + many * np.arange(cells)[:, None]).ravel(), minlength=cells * many)
    counts = counts.reshape(cells, many)
    first = counts.argmax(1)
    left = counts.copy()
    left[np.arange(cells), first] = 0
    second = np.where(left.max(1) > 0, left.argmax(1), first)
    pairs = meaning.keys[first].copy()
    both = meaning.pure[first]  # a pair stands as it is
    pairs[both, 1] = meaning.keys[second[both], 0]
    return pairs


def keys_in(table: ContentTable, wished: np.ndarray) -> tuple[np.ndarray, dict[tuple[int, int], tuple[int, int]]]:
    """Numbers of the wished keys (..., 2) in the table, and which of them had to be replaced by which."""
    codes = wished[..., 0].astype(np.int64) << 32 | wished[..., 1].astype(np.int64)
    present, inverse = np.unique(codes, return_inverse=True)
    numbers, replaced = np.empty(len(present), np.int32), {}
    for n, code in enumerate(present):
        key = int(code >> 32), int(code & 0xFFFFFFFF)
        numbers[n] = table.nearest(key)
        substitute = int(table.keys[numbers[n], 0]), int(table.keys[numbers[n], 1])
        if substitute != key:
            replaced[key] = substitute
    return numbers[inverse].reshape(codes.shape), replaced
