# SPDX-License-Identifier: Apache-2.0
"""Nearest-neighbor fields: sizes, initialization, and upsampling from level to level (MJH17 section 4.2).

A target image is built from an exemplar: for the patch at every target pixel the field names an exemplar patch.
Fields are (rows, columns) source maps of patch corners. Images are (height, width, channels) int16
arrays on an integer grid (`lab_grid`): the three channels of Lab, and three more for each further map of a material.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ...analysis.regularity.offset_prices import Prices
from ...engine.color.lab_grid import steps_for
from ...engine.core.demand import SomeRows
from ...engine.core.scratch import RowStore
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Domain
from ...engine.deferred import np
from ...engine.errors import present

BAND = 128  # rows of a field processed at a time


@dataclass(frozen=True, kw_only=True)
class Geometry(Domain):
    """One pyramid level: the target, and the size of the exemplar.

    Where the target does not wrap, patches lie fully inside, so the field is `patch - 1` shorter than it.
    """

    exemplar_width: int
    exemplar_height: int
    patch: int
    channels: int = 3

    @property
    def steps(self) -> int:
        """Steps of the Lab grid per Lab unit."""
        return steps_for(self.patch, self.channels)

    @property
    def columns(self) -> int:
        """Number of target patches along x."""
        return self.width if self.wrap_x else self.width - self.patch + 1

    @property
    def rows(self) -> int:
        """Number of target patches along y."""
        return self.height if self.wrap_y else self.height - self.patch + 1

    @property
    def exemplar_columns(self) -> int:
        """Number of exemplar patches along x."""
        return self.exemplar_width - self.patch + 1

    @property
    def exemplar_rows(self) -> int:
        """Number of exemplar patches along y."""
        return self.exemplar_height - self.patch + 1

    @property
    def padded_width(self) -> int:
        """Width of the target with the padding that patches at its right border cover."""
        return self.width + self.patch - 1

    def layout(self, rows: int | None = None, exemplar_rows: int | None = None) -> dict[str, int]:
        """Device memory of a `Matcher` for a number of rows of target and exemplar (None: all), in bytes by name."""
        pixels = self.width * (self.height if rows is None else rows)
        exemplar = self.exemplar_width * (exemplar_rows or self.exemplar_height)
        padded = self.padded_width * (self.height + self.patch - 1 if rows is None else rows)
        bytes_of = 2 * self.channels
        return {
            "target": bytes_of * padded,
            "exemplar": bytes_of * exemplar,
            "image": bytes_of * pixels,
            "field": 4 * pixels,
            "field_next": 4 * pixels,
            "distance": 4 * pixels,
            "distance_next": 4 * pixels,
            "price": 4 * exemplar,
            "count": 4 * exemplar,
            "uses": 4 * exemplar,
            "penalty": 4 * exemplar,
            **({} if exemplar_rows is None else {"votes": 4 * self.channels * pixels}),
        }


def bands_of(rows: int, size: int = BAND) -> Iterator[slice]:
    """Rows in bands of a fixed height, which keep temporaries small and sums independent of the memory plan."""
    return (slice(top, min(top + size, rows)) for top in range(0, rows, size))


def variance_of(image: SomeRows, usable: np.ndarray | None) -> float:
    """Variance of a grid image, (height, width, channels) int16, summed over channels, in exact integer arithmetic.

    `usable` (height, width) bool: pixels that count. None: all.
    """
    count, channels = 0, image.shape[2]
    sums, squares = np.zeros(channels, np.int64), np.zeros(channels, np.int64)
    for band in bands_of(len(image), BAND // 4):
        planes = planes_of(image[band], None if usable is None else usable[band]).astype(np.int32)
        count, sums = count + planes.shape[1], sums + planes.sum(1, np.int64)
        squares += (planes * planes).sum(1, np.int64)
    return sum((count * int(q) - int(s) ** 2) / count**2 for s, q in zip(sums, squares, strict=True))


def planes_of(rows: np.ndarray, usable: np.ndarray | None) -> np.ndarray:
    """The channels of usable pixels, (channels, n): faster to reduce than (n, channels)."""
    pixels = rows.reshape(-1, rows.shape[2]) if usable is None else rows[usable]
    return np.ascontiguousarray(pixels.T)


def box_sums(plane: np.ndarray, side: int, dtype: type | str = "int64") -> np.ndarray:
    """Sums over every square of `side` inside a plane: (height - side + 1, width - side + 1)."""
    return _run_sums(_run_sums(plane.astype(dtype), side, 0), side, 1)


def _run_sums(values: np.ndarray, side: int, axis: int) -> np.ndarray:
    """Sums of `side` neighbors along an axis, from sums of 1, 2, 4 ... of them: rows at once, unlike cumulatives."""
    powers = np.moveaxis(values, axis, 0)
    count, width, done = len(powers) - side + 1, 1, 0
    total: np.ndarray | None = None
    while done < side:
        if side & width:
            part = powers[done : done + count]
            total, done = part if total is None else total + part, done + width
        width *= 2
        if done < side:
            powers = powers[: -width // 2] + powers[width // 2 :]
    return np.moveaxis(present(total), 0, axis)


def allowed_patches(allowed: np.ndarray | None, geometry: Geometry) -> np.ndarray:
    """Which patches lie fully inside `allowed` (height, width) bool: (exemplar_rows, exemplar_columns) bool."""
    patches, side = np.ones((geometry.exemplar_rows, geometry.exemplar_columns), bool), geometry.patch
    if allowed is not None:
        for band in bands_of(len(patches)):
            patches[band] = box_sums(allowed[band.start : band.stop + side - 1], side) == side**2
    return patches


def random_field(
    geometry: Geometry,
    allowed: np.ndarray,
    seed: int,
    weights: np.ndarray | None = None,
    out: np.ndarray | RowStore | None = None,
) -> SourceMap:
    """A random initial field (MJH17 algorithm 1): blocks of patch size copied from random places.

    Unlike single pixels, blocks keep the exemplar's detail.

    `allowed` (exemplar_rows, exemplar_columns) bool; `weights` (exemplar_rows, exemplar_columns) float32 or None; `out`
    (rows, columns) uint32 or None.
    """
    patch, draw = geometry.patch, _RandomPlaces(allowed, weights)
    columns = np.arange(geometry.columns)[None, :]
    out = np.empty((geometry.rows, geometry.columns), np.uint32) if out is None else out
    for begin in range(0, geometry.rows, BAND):  # bands keep the temporaries small
        rows = np.arange(begin, min(begin + BAND, geometry.rows))[:, None]
        y, x = draw(seed, 0xB10C, *np.broadcast_arrays(rows // patch, columns // patch))
        y = np.minimum(y + rows % patch, geometry.exemplar_rows - 1)
        x = np.minimum(x + columns % patch, geometry.exemplar_columns - 1)
        out[begin : begin + BAND] = SourceMap.of(y, x).packed
    return only_allowed(SourceMap.of_rows(out), allowed, seed, 0xB10D)


def shifted_field(
    geometry: Geometry, allowed: np.ndarray, seed: int, out: np.ndarray | RowStore | None = None
) -> SourceMap:
    """An initial field of the exemplar shifted by a random distance, instead of blocks of patch size.

    Long lines and large shapes are whole from the first iteration. Only the exemplar's border, which now lies inside
    the tile, must be resynthesized. A larger target starts as several exemplars, each with its own shift.
    """
    g = geometry
    down, right = (max(1, round(n / own)) for n, own in ((g.height, g.exemplar_height), (g.width, g.exemplar_width)))
    columns = np.arange(g.columns)[None, :]
    out = np.empty((g.rows, g.columns), np.uint32) if out is None else out
    for begin in range(0, g.rows, BAND):  # bands keep the temporaries small
        rows = np.arange(begin, min(begin + BAND, g.rows))[:, None]
        piece = np.broadcast_arrays(rows * down // g.height, columns * right // g.width)
        y = (rows + hash_at(seed, 0x5F1D, *piece).astype(np.int64)) % g.exemplar_height
        x = (columns + hash_at(seed, 0x5F1E, *piece).astype(np.int64)) % g.exemplar_width
        # patches across the border do not exist: use the last one inside it
        y, x = np.minimum(y, g.exemplar_rows - 1), np.minimum(x, g.exemplar_columns - 1)
        out[begin : begin + BAND] = SourceMap.of(y, x).packed
    return only_allowed(SourceMap.of_rows(out), allowed, seed, 0xB10D)


class _RandomPlaces:
    """Draws allowed exemplar patches with probability proportional to their weights.

    A draw is a rank, or a cumulative weight, whose place is then found: a list would take eight bytes per patch.
    """

    def __init__(self, allowed: np.ndarray, weights: np.ndarray | None = None):
        self._allowed, self._weights = allowed, weights
        self._bands = list(bands_of(len(allowed)))
        self._before = np.cumsum([0, *(np.count_nonzero(allowed[band]) for band in self._bands)])
        self._below = np.zeros(1)  # total weight of the preceding bands
        if weights is not None:
            for band in self._bands:
                self._below = np.append(self._below, self._weighed(band, self._below[-1])[-1])

    def _weighed(self, band: slice, before: float) -> np.ndarray:
        """Cumulative weight at each place of a band, added in one order whatever the bands."""
        weights = present(self._weights)[band][self._allowed[band]]
        return np.cumsum(np.concatenate([[before], weights]), dtype=np.float64)

    def __call__(self, seed: int, step: int, y: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Draw one place for every (y, x)."""
        count, bits = int(self._before[-1]), hash_at(seed, step, y, x).astype(np.uint64)
        if self._weights is None:
            at = ((bits * np.uint64(count)) >> np.uint64(32)).astype(np.int64)
            if count == self._allowed.size:
                return np.divmod(at, self._allowed.shape[1])
            band_of = np.searchsorted(self._before, at, side="right") - 1
        else:
            at = bits * (self._below[-1] / 2.0**32)
            band_of = np.minimum(np.searchsorted(self._below, at, side="right") - 1, len(self._bands) - 1)
        row, column = np.empty(at.shape, np.int64), np.empty(at.shape, np.int64)
        for n, band in enumerate(self._bands):
            here = band_of == n
            if here.any():
                if self._weights is None:
                    number = at[here] - self._before[n]
                else:
                    number = np.searchsorted(self._weighed(band, self._below[n])[1:], at[here], side="right")
                    number = np.minimum(number, self._before[n + 1] - self._before[n] - 1)
                places = np.flatnonzero(self._allowed[band])[number]
                row[here], column[here] = np.divmod(places, self._allowed.shape[1])
                row[here] += band.start
        return row, column


def only_allowed(field: SourceMap, allowed: np.ndarray, seed: int, step: int = 0xB10E) -> SourceMap:
    """The field with every match that is not allowed replaced by a random allowed one.

    `allowed` (exemplar_rows, exemplar_columns) bool.
    """
    if allowed.all():
        return field
    draw = _RandomPlaces(allowed)
    for begin in range(0, len(field.packed), BAND):
        rows = field[begin : begin + BAND]
        bad_y, bad_x = np.nonzero(~rows.gather(allowed))
        if len(bad_y):
            rows.packed[bad_y, bad_x] = SourceMap.of(*draw(seed, step, bad_y + begin, bad_x)).packed
            field.packed[begin : begin + BAND] = rows.packed
    return field


def hash_at(seed: int, step: int, y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """cl/hash.h's `hash_at` for arrays: 32 random bits from (seed, step, coordinates), uint32.

    Parameters
    ----------
    seed : int
        The low 32 bits are used.
    step : int
        0 to 2^32 - 1.
    y, x : array of int
        Coordinates, of shapes that broadcast. The low 32 bits are used.
    """

    def pcg(v: np.ndarray) -> np.ndarray:
        state = v * np.uint32(747796405) + np.uint32(2891336453)
        word = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(277803737)
        return (word >> np.uint32(22)) ^ word

    start = pcg(np.array([seed & 0xFFFFFFFF], np.uint32))
    bits = pcg(np.uint32(step) + start)
    return pcg(x.astype(np.uint32) + pcg(y.astype(np.uint32) + bits))


def upsample_field(
    field: SourceMap,
    coarse: Geometry,
    fine: Geometry,
    allowed: np.ndarray,
    seed: int,
    out: np.ndarray | RowStore | None = None,
    in_step: Prices | None = None,
) -> SourceMap:
    """A field upsampled to the next finer level.

    Patch centers are scaled. The offset inside a coarse pixel is kept, so neighbors stay coherent. Coarse levels do not
    resolve a fine lattice: as soon as a level does, matches move to the nearest place in phase with it.

    `allowed` (fine.exemplar_rows, fine.exemplar_columns) bool; `out` (fine.rows, fine.columns) uint32 or None.
    """

    def axis(n: int, from_n: int, ratio: float) -> tuple[np.ndarray, np.ndarray]:
        center = np.arange(n) + fine.patch // 2 + 0.5
        source = np.clip((center / ratio).astype(np.int64) - fine.patch // 2, 0, from_n - 1)
        return source, center - (source + fine.patch // 2 + 0.5) * ratio

    from_y, rest_y = axis(fine.rows, coarse.rows, fine.height / coarse.height)
    from_x, rest_x = axis(fine.columns, coarse.columns, fine.width / coarse.width)
    half = fine.patch // 2
    ratio_y = fine.exemplar_height / coarse.exemplar_height
    ratio_x = fine.exemplar_width / coarse.exemplar_width
    finer = np.empty((fine.rows, fine.columns), np.uint32) if out is None else out
    for begin in range(0, fine.rows, BAND):  # bands keep the temporaries small
        band = slice(begin, begin + BAND)
        first, last = from_y[band][[0, -1]]
        y, x = field[first : last + 1][from_y[band] - first][:, from_x].yx
        y = np.floor((y + half + 0.5) * ratio_y + rest_y[band, None]).astype(np.int64) - half
        x = np.floor((x + half + 0.5) * ratio_x + rest_x[None, :]).astype(np.int64) - half
        if in_step is not None and in_step.resolved:
            rows = np.arange(begin, begin + len(y))[:, None]
            x, y = in_step.nearest_in_step(np.arange(fine.columns)[None, :], rows, x, y)
        y, x = np.clip(y, 0, fine.exemplar_rows - 1), np.clip(x, 0, fine.exemplar_columns - 1)
        finer[band] = SourceMap.of(y, x).packed
    return only_allowed(SourceMap.of_rows(finer), allowed, seed, fine.width)
