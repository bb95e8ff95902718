# SPDX-License-Identifier: Apache-2.0
"""Penalties on the use of exemplar patches that limit repetition and keep texture from being lost.

MJH17 evens out the use of single patches (eq. 6), in proportion to their use. Two problems remain:

- One stone appears ten times: a proportional penalty that ends this punishes all uses, also when there are few. Here
  (departure) a region of the size of objects (`region_of`) pays nothing up to a number of uses, and the square of the
  excess above it.
- If a part of the photo is flat, the mean of votes, being smoother than any texture, is nearest to flat patches, which
  win everywhere. Here (departure) the tile must not be flatter than the photo: for every activity bound, the share of
  the tile's patches below it must not exceed the photo's. These are linear constraints on the field. The multiplier of
  each rises while it is violated (dual ascent), as in semi-discrete optimal transport.
"""

from __future__ import annotations

from typing import NamedTuple

from ...engine.core.demand import SomeRows
from ...engine.core.scratch import empty_rows
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.opencl.device import Device
from .exemplar_rows import RowRange, region_of
from .field import BAND, Geometry, bands_of, box_sums

KINDS = 16  # classes of patches by activity
FLAT = 1 / 8  # activity up to which patches are flat, relative to the mean of those that are not
STEPS = 0.05, 1.5  # minimum and maximum step of a multiplier, in patch variances per share of all patches
SLACK = 0.02  # share of patches by which the tile may be flatter
REPEATS = 2.0  # free uses of a region
FAIR = 1.25  # the same, relative to its share of the target
GROWTH = 1.0  # cost of one excess use, in patch variances
_PIXELS_AT_ONCE = 1 << 18  # per deviation step
_HANDED_ON = "kind_duals", "kind_steps"


class Lost(NamedTuple):
    """Texture of an exemplar that its tile does not show.

    Attributes
    ----------
    own, shown : float
        Share of blocks that are not flat, in the exemplar and in the tile.
    """

    own: float
    shown: float

    @property
    def share(self) -> float:
        """Share of the tile that should not be flat."""
        return max(0.0, self.own - self.shown)


def layout(geometry: Geometry, exemplar_rows: int | None = None) -> dict[str, int]:
    """Device memory, in bytes by name, for a number of exemplar rows (None: all)."""
    exemplar = geometry.exemplar_width * (exemplar_rows or geometry.exemplar_height)
    small = dict.fromkeys(("kind_counts", "kind_most", "kind_duals", "kind_steps", "kind_prices"), 4 * KINDS)
    return {"kinds": exemplar, "region_sums": 4 * exemplar, **small}


def handed_on(device: Device, buffers: Buffers) -> np.ndarray:
    """State that one level passes to the next: multipliers and their step sizes, (2, KINDS) int32."""
    return np.stack([device.read(buffers[name], (KINDS,), np.int32) for name in _HANDED_ON])


def hand_on(device: Device, buffers: Buffers, prices: np.ndarray) -> None:
    """Restore the state from `handed_on` before the next level begins."""
    for name, values in zip(_HANDED_ON, prices, strict=True):
        device.write(buffers[name], values)


def activity(image: SomeRows, patch: int, in_memory: bool = True) -> SomeRows:
    """Activity of the least active quarter of every patch, so a patch on the edge of a flat area is flat.

    By the whole patch such an edge would be the most active place of all, and tiles would fill with it.

    (height, width, channels) int16 -> (rows, columns) float32.
    """
    quarter = (patch + 1) // 2
    beyond, rows, columns = patch - quarter, image.shape[0] - patch + 1, image.shape[1] - patch + 1
    active = empty_rows((rows, columns), np.float32, in_memory)
    for band in bands_of(rows):
        of = deviation(image[band.start : band.stop + patch - 1], quarter)
        corners = [(y, x) for y in (0, beyond) for x in (0, beyond)]
        active[band] = np.minimum.reduce([of[y : len(of) - beyond + y, x : x + columns] for y, x in corners])
    return active


def deviation(image: np.ndarray, side: int) -> np.ndarray:
    """Squared deviation of every block from its own mean, summed over pixels and channels, times the number of pixels.

    (height, width, channels) int16 -> (rows, columns) float32: integers, rounded once.
    """
    rows, columns, n = image.shape[0] - side + 1, image.shape[1] - side + 1, side * side
    deviations = np.empty((rows, columns), np.float32)
    for rows_of in bands_of(rows, max(16, _PIXELS_AT_ONCE // image.shape[1])):  # bands keep the temporaries small
        band = np.moveaxis(image[rows_of.start : rows_of.stop + side - 1], 2, 0).astype(np.int32)  # planes
        squares = np.einsum("cyx,cyx->yx", band, band)  # whose sums over a patch fit 32 bits: `lab_grid.steps_for`
        squared = n * box_sums(squares, side, np.int32).astype(np.int64)
        for plane in band:
            squared -= np.square(box_sums(plane, side, np.int32), dtype=np.int64)
        deviations[rows_of] = squared
    return deviations


def flat_bound(own: SomeRows, allowed: np.ndarray | None = None) -> np.float32:
    """Activity, from values (rows, columns), up to which a patch is flat. Flat patches do not influence it."""
    bound, before = np.float32(0), None
    while bound != before:  # it only rises
        before, total, count = bound, 0.0, 0
        for band in bands_of(len(own)):
            rest = own[band] if allowed is None else own[band][allowed[band]]
            rest = rest[rest > bound]
            total, count = total + float(rest.sum(dtype=np.float64)), count + rest.size
        bound = np.float32(FLAT * (total / count)) if count else before
    return bound


def ranked(values: SomeRows, allowed: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Quantiles of the values at allowed places, without sorting.

    `values` (rows, columns) float32; `allowed` (rows, columns) bool; `shares` (n,) float, 0 to 1; returns (n,) float32.
    """

    high = np.zeros(1 << 16, np.int64)  # count per upper 16 bits
    for band in bands_of(len(values)):
        high += np.bincount(values[band][allowed[band]].view(np.uint32) >> 16, minlength=1 << 16)
    high = high.cumsum()
    rank = np.maximum(0, np.ceil(high[-1] * shares - 1)).astype(np.int64)
    begin = np.searchsorted(high, rank, side="right")
    looked_for = np.zeros(1 << 16, bool)
    looked_for[begin] = True
    near = [np.zeros((2, 0), np.int64)]  # values with these upper bits, and their counts
    for band in bands_of(len(values)):
        bits = values[band][allowed[band]].view(np.uint32)
        near.append(np.stack(np.unique(bits[looked_for[bits >> 16]], return_counts=True)).astype(np.int64))
    bits, which = np.unique(np.concatenate([kinds for kinds, _ in near]), return_inverse=True)
    below = np.cumsum(np.bincount(which, np.concatenate([counts for _, counts in near]))).astype(np.int64)
    first = np.searchsorted(bits, begin << 16)  # the first value with the upper bits of each rank
    rank += np.where(first > 0, below[first - 1], 0) - np.where(begin > 0, high[begin - 1], 0)
    return bits[np.searchsorted(below, rank, side="right")].astype(np.uint32).view(np.float32)


def kinds_of(active: SomeRows, allowed: np.ndarray, in_memory: bool = True) -> SomeRows:
    """Classes of patches by activity, flattest first, `KINDS` of them: (rows, columns) uint8.

    They have as equal numbers of patches as ties allow, and one of their bounds is that of flat patches.
    """
    bounds = ranked(active, allowed, np.arange(1, KINDS - 1) / (KINDS - 1))
    bounds = np.sort(np.append(bounds, flat_bound(active, allowed)))
    kinds = empty_rows(active.shape, np.uint8, in_memory)
    for band in bands_of(len(active)):
        kinds[band] = np.searchsorted(bounds, active[band], side="left")
    return kinds


def lost_texture(source: SourceMap, exemplar: SomeRows, allowed: np.ndarray, geometry: Geometry) -> Lost:
    """The texture that a tile lacks.

    `exemplar` (exemplar_height, exemplar_width, channels) int16; `allowed` (exemplar_rows, exemplar_columns) bool.
    """
    side = geometry.patch
    own = empty_rows(allowed.shape, np.float32, isinstance(exemplar, np.ndarray))
    for band in bands_of(len(own)):
        own[band] = deviation(exemplar[band.start : band.stop + side - 1], side)
    flat = flat_bound(own, allowed)
    above = sum(int(np.count_nonzero(own[band][allowed[band]] > flat)) for band in bands_of(len(own)))
    down, right = (0 if wraps else side - 1 for wraps in (geometry.wrap_y, geometry.wrap_x))
    height, width = source.packed.shape
    textured = 0
    for top in range(0, height - down, BAND):
        bottom = min(top + BAND, height - down) + side - 1
        rows = source[top : min(bottom, height)].packed
        if bottom > height:
            rows = np.concatenate([rows, source[: bottom - height].packed])
        if not right:
            rows = np.pad(rows, ((0, 0), (0, side - 1)), mode="wrap")
        textured += int(np.count_nonzero(deviation(SourceMap(rows).gather(exemplar), side) > flat))
    return Lost(above / np.count_nonzero(allowed), textured / ((height - down) * (width - right)))


class UsePrices:
    """Both penalties on one level, added to those of a `Matcher`.

    `exemplar` (exemplar_height, exemplar_width, channels) int16; `allowed` (exemplar_rows, exemplar_columns) bool;
    `variance`: of the exemplar's pixels, summed over channels, in squared grid steps. `kinds` (exemplar_rows,
    exemplar_columns) uint8: classes of patches, the contents of buffer `kinds`.
    """

    def __init__(
        self, device: Device, buffers: Buffers, geometry: Geometry, exemplar: SomeRows, allowed: np.ndarray,
        scale: float, variance: float, first: bool,
    ):  # fmt: skip
        self._device, self._buffers, self._geometry = device, buffers, g = device, buffers, geometry
        self._run = device.program("use_prices")
        in_memory = isinstance(exemplar, np.ndarray)
        kinds = self.kinds = kinds_of(activity(exemplar, g.patch, in_memory), allowed, in_memory)
        patches = g.columns * g.rows
        counts = np.sum([np.bincount(kinds[band][allowed[band]], minlength=KINDS) for band in bands_of(len(kinds))], 0)
        share = counts.cumsum() / np.count_nonzero(allowed)
        device.write(buffers["kind_most"], np.floor(patches * np.minimum(1.0, share + SLACK)).astype(np.int32))
        unit = g.patch**2 * variance
        *self._steps, self._growth = (min(int(unit * k), 100_000_000) for k in (*STEPS, GROWTH))
        if first:
            device.fill(buffers["kind_duals"], np.int32(0), KINDS)
            device.fill(buffers["kind_steps"], np.int32(self._steps[1]), KINDS)
        self._side = max(1, min(round(region_of(g.patch) * scale), g.exemplar_columns, g.exemplar_rows))
        fair = patches / np.count_nonzero(allowed)
        self._most = int(max(REPEATS, FAIR * fair) * self._side**2)

    def begin(self) -> None:
        """Reset the counts for the current field."""
        self._device.fill(self._buffers["kind_counts"], np.int32(0), KINDS)

    def count(self, rows: int, piece: RowRange) -> None:
        """Count the first rows of buffer `field`, only the matches to patches of the piece."""
        g, b, field = self._geometry, self._buffers, (self._geometry.columns, rows)
        self._run("count", field, b["field"], b["kinds"], b["kind_counts"], *field, g.exemplar_columns, *piece)

    def ascend(self) -> None:
        """Update the flatness multipliers from the field, after `count` has seen all of it."""
        b, patches = self._buffers, self._geometry.columns * self._geometry.rows
        self._run(
            "ascend", (1,), b["kind_counts"], b["kind_most"], b["kind_duals"], b["kind_steps"], b["kind_prices"], KINDS,
            patches, *self._steps,
        )  # fmt: skip

    def around(self, piece: RowRange) -> RowRange:
        """The patches whose uses the penalties of a piece depend on: those of its regions, which are moved inside."""
        rows = self._geometry.exemplar_rows
        first, last = (max(0, min(at - self._side // 2, rows - self._side)) for at in (piece[0], piece[1] - 1))
        return first, min(rows, last + self._side)

    def add(self, piece: RowRange, counted: RowRange) -> None:
        """Add the penalties of the current field to buffer `penalty` of a piece; `counted`: patches in `count`."""
        g, b, width = self._geometry, self._buffers, self._geometry.exemplar_columns
        held = width, counted[1] - counted[0]
        self._run("rows", held, b["count"], b["region_sums"], *held, self._side)
        self._run(
            "add", (width, piece[1] - piece[0]), b["region_sums"], b["kinds"], b["kind_prices"], b["penalty"],
            width, g.exemplar_rows, *piece, counted[0], self._side, self._most, self._growth,
        )  # fmt: skip
