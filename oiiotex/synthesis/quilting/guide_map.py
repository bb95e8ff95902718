# SPDX-License-Identifier: Apache-2.0
"""A guide image as demands on the cells of a quilt: LSA16 section 6.1, figure 12."""

from __future__ import annotations

import functools
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...analysis.labels.content_table import ContentTable
from ...analysis.labels.legend import code_of, codes_in, color_of, oklab_of
from ...engine.core.demand import cached
from ...engine.core.image import Channels, Part, channels_of
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError, ParameterError, texture_filter
from ...engine.io.documents import read_document
from ...engine.session.resources import Resources
from .quilt_plan import Grid
from .quilter import GUIDE

if TYPE_CHECKING:
    from scipy.spatial import KDTree

log = logging.getLogger("oiiotex")

SAMPLES = 16  # of the guide along a side of a cell, for its histogram
_NAMED = 5  # maximum number of colors in an error
_ROWS = 32  # rows of a guide to search for its labels
_FAR = 2**53  # largest id that a float holds exactly
_NEAR = 0.2  # distance in Oklab up to which a color is taken for the nearest one: blends of soft brushes lie within it
_LEAST = 0.01  # labels with a smaller share are ignored when the patch size is chosen


@dataclass(frozen=True)
class Meaning:
    """The labels that the codes of a guide stand for.

    Attributes
    ----------
    codes : (n,) int64
        Ascending: ids, or colors as in `legend.code_of`.
    keys : (n, 2) int64
        (k1, k2) of each code.
    pure : (n,) bool
        The code names a single label, and so also its place inside a cell.
    """

    codes: np.ndarray
    keys: np.ndarray
    pure: np.ndarray
    colors: bool

    def name(self, code: int) -> str:
        """A code as written in a table."""
        return color_of(code) if self.colors else str(code)

    def find(self, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Index of each code in `codes`, or of the nearest color within `_NEAR`, and a mask of those without."""
        place = np.minimum(np.searchsorted(self.codes, codes), len(self.codes) - 1)
        stray = self.codes[place] != codes
        if self.colors and stray.any():
            others, inverse = np.unique(codes[stray], return_inverse=True)
            distance, nearest = self._nearest.query(oklab_of(others))
            place[stray], stray[stray] = nearest[inverse], (distance > _NEAR)[inverse]
        return place, stray

    @functools.cached_property
    def _nearest(self) -> KDTree:
        """Search tree of the colors in Oklab."""
        from scipy.spatial import KDTree  # slow to import

        return KDTree(oklab_of(self.codes))

    def strays(self, met: Strays, unit: str) -> str:
        """Codes without a label, as text for messages."""
        worst = sorted(met, key=lambda code: (-met[code].count, code))
        named = ", ".join(f"{self.name(code)} ({met[code].text(unit)})" for code in worst[:_NAMED])
        more = f" and {len(worst) - _NAMED} more" if len(worst) > _NAMED else ""
        limit = f" (farther than {_NEAR:g} in Oklab from every color of the table)" if self.colors else ""
        return f"{'colors' if self.colors else 'ids'} without a label{limit}: {named}{more}"

    def codes_of(self, pixels: np.ndarray, channels: Channels) -> np.ndarray:
        """The codes of pixels of a guide, int64."""
        if not self.colors:
            ids = pixels[..., channels.first]
            if ids.dtype.kind == "f":  # NaN and values beyond int64 have no label
                ids = np.rint(np.clip(np.nan_to_num(ids.astype(np.float64), nan=-1), -_FAR, _FAR))
            return ids.astype(np.int64)
        three = channels.color if len(channels.color) == 3 else channels.color[:1] * 3
        return codes_in(pixels, three, channels.alpha)


@dataclass(frozen=True)
class Stray:
    """A code without a label: its number of pixels, and the first of them."""

    count: int
    x: int
    y: int

    def text(self, unit: str) -> str:
        """Text for messages."""
        return f"{self.count} {unit}, first at {self.x},{self.y}"


class Strays(dict[int, Stray]):
    """Codes without a label."""

    def add(self, codes: np.ndarray, stray: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
        """Count codes without a label among `codes`, (rows, columns), at x (columns,) and y (rows,)."""
        rows, columns = np.nonzero(stray)
        unique = np.unique(codes[rows, columns], return_index=True, return_counts=True)
        for code, first, count in zip(*unique, strict=True):
            before = self.get(int(code), Stray(0, int(x[columns[first]]), int(y[rows[first]])))
            self[int(code)] = Stray(before.count + int(count), before.x, before.y)


@dataclass(frozen=True)
class Table:
    """The label, or key [k1, k2], of each code. From a palette: also those of the next finer level."""

    path: Path
    keys: dict[int, Any]
    finer: dict[int, Any]
    colors: bool
    level: int | None


def read_table(path: Path) -> Table:
    """Read a palette's JSON, or {"255,0,0": 3, "0,255,0": [3, 1], ...} in 8 bits, or {"7": 3, ...} of ids."""
    try:
        document = read_document(path)
        named: list[dict[str, Any]] = [document, {}]
        level = int(document["level"]) if "labels" in document else None
        if level is not None:
            named = [{entry["color"]: entry["id"] for entry in document[rows]} for rows in ("labels", "finer")]
        colors = {"," in name for rows in named for name in rows}
        keys, finer = ({code_of(n) if "," in n else int(n): key for n, key in rows.items()} for rows in named)
    except (ImageError, ValueError, KeyError, TypeError, AttributeError) as error:
        expected = f"a file of {texture_filter('palette')}, or a label or [k1, k2] for each '255,0,0' or id"
        raise ImageError(
            f"cannot be read ({error})", parameter="palette", value=str(path), expected=expected
        ) from error
    if not keys:
        raise ImageError("the table is empty", parameter="palette", value=str(path))
    if len(colors) > 1:
        raise ImageError("mixes colors and ids", parameter="palette", value=str(path), expected="only one of them")
    return Table(path, keys, finer, colors.pop(), level)


def meaning_of(guide: Part, table: Table | None, labels: np.ndarray, fine: bool = False) -> Meaning:
    """The meaning of a guide's ids or colors: from the table, or, for ids without a table, the exemplar's labels (n,).

    `fine`: the guide is of the table's finer level.
    """
    labels = labels[labels > 0].astype(np.int64)
    if not len(labels):
        raise ImageError("the label map has no labels")
    rows = {} if table is None else table.finer if fine else table.keys
    if table is None or not rows:
        if len(channels_of(guide.spec).color) > 1:
            name = "fine" if fine else f"guide {guide.name}"
            raise ParameterError(f"{name} contains colors", hint="map them to labels with palette=FILE.json")
        return Meaning(labels, np.stack([labels, labels], 1), np.ones(len(labels), bool), False)
    codes = sorted(rows)
    pure = np.array([not isinstance(rows[code], list) for code in codes])
    keys = [[rows[code]] * 2 if alone else rows[code] for code, alone in zip(codes, pure, strict=True)]
    for key in keys:
        if len(key) != 2 or not all(type(k) is int and k in labels for k in key):
            expected = f"a label from 1 to {labels.max()}, or a pair [k1, k2] of labels"
            raise ImageError(f"unknown label {key}", parameter="palette", value=str(table.path), expected=expected)
    if fine and 0 not in rows:  # 0: not painted, also where soft brushes blend into it
        codes, keys, pure = [0, *codes], [[0, 0], *keys], np.concatenate([[True], pure])
    return Meaning(np.array(codes, np.int64), np.array(keys, np.int64), pure, table.colors)


def labels_met(guide: Part, meaning: Meaning) -> list[int]:
    """The labels that the guide names, from some of its rows. Labels with a tiny share are ignored."""
    whole = guide.window
    channels = channels_of(guide.spec)
    if meaning.colors != (len(channels.color) > 1):
        return []  # `wishes_of` raises the error
    met = np.zeros(len(meaning.codes), np.int64)
    for y in np.unique(whole.top + (2 * np.arange(_ROWS) + 1) * whole.height // (2 * _ROWS)):
        row = guide.read(Window(whole.left, int(y), whole.right, int(y) + 1))[0]
        place, stray = meaning.find(meaning.codes_of(row, channels))
        met += np.bincount(place[~stray], minlength=len(met))
    often = meaning.pure & (met >= max(1, _LEAST * met.sum()))
    return sorted({int(k) for k in meaning.keys[often, 0]})


@dataclass(frozen=True)
class Wishes:
    """Labels that a guide demands for the cells of a grid."""

    keys: np.ndarray  # (rows, columns, 2) int32: the two most frequent labels under each cell, ties to the lower id
    wanted: np.ndarray  # (rows, columns, GUIDE, GUIDE) uint16: labels at the centers of its pieces; 0: mixed


def wishes_of(guide: Part, meaning: Meaning, grid: Grid, resources: Resources) -> Wishes:
    """Read the guide once, by rows of cells, scaled to the output by the nearest pixel.

    Raises ImageError for ids or colors without a label: names them and their counts.
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
        raise ImageError(f"the guide has {strays}", expected=f"one of {meant}")
    if blended:
        share = 100 * blended / (rows * columns * SAMPLES**2)
        log.warning("%s: %.0f %% of the samples match no color of the table; nearest color used", guide.name, share)
    return Wishes(keys, wanted)


def _samples(places: np.ndarray, patch: int, size: int) -> np.ndarray:
    """Sample positions of cells that begin at `places`: (cells, SAMPLES), inside the output."""
    at = places[:, None].astype(np.int64) + (2 * np.arange(SAMPLES) + 1) * patch // (2 * SAMPLES)
    return np.where(at < 0, at + size, np.minimum(at, size - 1))


def _rows(guide: Part, meaning: Meaning, grid: Grid) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """For every row of cells: its sample rows (SAMPLES,), and the guide's codes there: (SAMPLES, guide width) int64."""
    whole = guide.window
    channels = channels_of(guide.spec)
    if not meaning.colors and len(channels.color) > 1:
        problem = f"guide {guide.name} contains colors, but the table maps label ids"
        raise ImageError(problem, expected="an integer label map")
    for at in _samples(grid.ys, grid.patch, grid.height) * whole.height // grid.height:
        codes = np.empty((SAMPLES, whole.width), np.int64)
        for n, y in enumerate(at):  # row by row: rows are not contiguous where the torus closes
            row = guide.read(Window(whole.left, whole.top + int(y), whole.right, whole.top + int(y) + 1))[0]
            codes[n] = meaning.codes_of(row, channels)
        yield whole.top + at, codes


def _keys(place: np.ndarray, meaning: Meaning) -> np.ndarray:
    """The key of every cell from samples (cells, n) of indices into the codes: (cells, 2)."""
    cells, many = len(place), len(meaning.codes)
    counts = np.bincount((place + many * np.arange(cells)[:, None]).ravel(), minlength=cells * many)
    counts = counts.reshape(cells, many)
    first = counts.argmax(1)
    left = counts.copy()
    left[np.arange(cells), first] = 0
    second = np.where(left.max(1) > 0, left.argmax(1), first)
    pairs = meaning.keys[first].copy()
    both = meaning.pure[first]  # pairs are kept as they are
    pairs[both, 1] = meaning.keys[second[both], 0]
    return pairs


def keys_in(table: ContentTable, wished: np.ndarray) -> tuple[np.ndarray, dict[tuple[int, int], tuple[int, int]]]:
    """Indices of the wished keys (..., 2) in the table, and the replacement of each key that is not in it."""
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
