# SPDX-License-Identifier: Apache-2.0
"""SLIC in Lab on the device: LSA16 section 3.1, after Achanta et al. 2012, doi:10.1109/TPAMI.2012.120.

A pixel chooses among the seeds of its cell and the eight neighboring cells of a regular grid. Departures:

1. Seeds start as the means of their cells, not on single pixels: no noise, and no random access to the image.
2. A distance is an exact integer: Lab is on a grid of 1/8, centers on one of 1/64 (`Seeds.candidates`). The
   partition is the same for any order of summation, tile, register width or device. Ties go to the lower seed.
3. A seed does not move until its mean is 0.2 Lab away, and cells whose nine seeds are unchanged are skipped:
   the cost of 1000 iterations is that of the changes.
4. Seeds of a large image converge on means of squares, see `refined_slots` and `squares`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...engine.color.lab_grid import FINE_STEPS
from ...engine.color.lab_on_device import Band, LabGrid
from ...engine.deferred import np
from ...engine.opencl.buffers import Buffers
from ...engine.session.resources import Resources

if TYPE_CHECKING:
    from .squares import LabelSquares

NONE = 255  # slot of transparent pixels
_STRIP = 16  # rows per work item
_SUMS = 6  # pixels, L, a, b, x, y
_SCALE = 4  # integer distances are squared steps times this
_STILL = 0.2  # Lab units by eq. 1 up to which a seed does not move: 0.01 sigma in areas of uniform color
_ABSENT = 1 << 30  # base of a candidate that is never chosen
NINE = tuple((dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1))


@dataclass(frozen=True)
class SeedGrid:
    """Cells of about sigma x sigma, one seed each.

    Attributes
    ----------
    width, height : int
        Size of the image, px.
    across, down : int
        Number of cells along x and y.
    compactness : float
        m of LSA16 eq. 1, Lab units per sigma.
    square : int
        Side of the squares, px, along which cells are cut.
    tiled : str
        Axes along which opposite borders touch: x, y, xy or none.
    """

    width: int
    height: int
    across: int
    down: int
    compactness: float
    square: int = 1
    tiled: str = "none"

    @classmethod
    def of(
        cls, width: int, height: int, sigma: float, compactness: float, square: int = 1, tiled: str = "none"
    ) -> SeedGrid:
        """The grid with the scale nearest to `sigma`.

        Parameters
        ----------
        width, height : int
            Size of the image, px.
        sigma : float
            px.
        compactness : float
            m of LSA16 eq. 1, Lab units per sigma.
        square : int
            Side of the squares, px, along which cells are cut.
        tiled : str
            Axes along which opposite borders touch.
        """
        across, down = (max(1, round(size / sigma)) for size in (width, height))
        return cls(width, height, across, down, compactness, square, tiled)

    @property
    def of_squares(self) -> SeedGrid:
        """The same cells for the image in which a square is a pixel."""
        width, height = -(-self.width // self.square), -(-self.height // self.square)
        return SeedGrid(width, height, self.across, self.down, self.compactness, tiled=self.tiled)

    @property
    def periods(self) -> tuple[int, int]:
        """Width and height where the image tiles, px; 0: it does not."""
        return self.width * ("x" in self.tiled), self.height * ("y" in self.tiled)

    def ringed(self, of: np.ndarray, outside: float | bool) -> np.ndarray:
        """Values of seeds (down, across, ...) in a ring of those across a border, or `outside`."""
        ringed = np.full((self.down + 2, self.across + 2, *of.shape[2:]), outside, of.dtype)
        ringed[1:-1, 1:-1] = of
        if "x" in self.tiled:
            ringed[:, [0, -1]] = ringed[:, [-2, 1]]
        if "y" in self.tiled:
            ringed[[0, -1]] = ringed[[-2, 1]]
        return ringed

    @property
    def count(self) -> int:
        """Seeds."""
        return self.across * self.down

    @property
    def scale(self) -> float:
        """sigma = sqrt(Ix Iy / #superpixels), px."""
        return math.sqrt(self.width * self.height / self.count)

    @property
    def weight(self) -> float:
        """Squared steps per squared pixel: m^2 / sigma^2 of LSA16 eq. 1."""
        return (FINE_STEPS * self.compactness / self.scale) ** 2

    @property
    def shift(self) -> int:
        """Number of bits by which x and y are shifted, so that a candidate's coefficients fit 16 bits."""
        largest = 2 * self.weight * _SCALE * 3 * max(self.width / self.across, self.height / self.down)
        return max(0, math.ceil(math.log2(largest / 32000)))

    @property
    def units(self) -> tuple[float, float, float, float]:
        """Units of a candidate's coefficients for color and place, and factors of their squares."""
        unit = float(1 << self.shift)
        per_color, per_place = -2.0 * _SCALE, -2.0 * _SCALE * self.weight / unit
        return per_color, per_place, 4.0 * _SCALE, unit * unit / (4 * _SCALE * self.weight)

    def edges(self, axis: int) -> np.ndarray:
        """First column (axis 1) or row (axis 0) of every cell, and the end, int32."""
        size, cells = ((self.height, self.down), (self.width, self.across))[axis]
        squares = np.arange(cells + 1, dtype=np.int64) * -(-size // self.square) // cells
        return np.minimum(squares * self.square, size).astype(np.int32)

    def cells(self, axis: int) -> np.ndarray:
        """The column (axis 1) or row (axis 0) of cells of every column or row of pixels, int32."""
        return np.repeat(np.arange((self.down, self.across)[axis], dtype=np.int32), np.diff(self.edges(axis)))

    def strips(self, band_rows: int) -> np.ndarray:
        """(n, 4) int32: first row, row after the last, row of cells and its reference row.

        None crosses a border between cells or between bands of `band_rows` rows.
        """
        edges = self.edges(0)
        cuts = np.unique(np.concatenate([edges, np.arange(0, self.height, band_rows)])).tolist()
        spans = []
        for top, bottom in itertools.pairwise(cuts):
            spans += [(y, min(y + _STRIP, bottom)) for y in range(top, bottom, _STRIP)]
        rows = np.array(spans)
        cell = np.searchsorted(edges, rows[:, 0], "right") - 1
        return np.column_stack([rows, cell, self.references()[0][cell]]).astype(np.int32)

    def references(self) -> tuple[np.ndarray, np.ndarray]:
        """Reference rows and columns of the cells, (down,) and (across,)."""
        y, x = (self.edges(axis).astype(np.int64) for axis in (0, 1))
        return (y[:-1] + y[1:]) // 2, (x[:-1] + x[1:]) // 2


def centers_of(sums: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Means (down, across, 5) of L, a, b in steps, x, y in px from sums (down, across, 6). Empty seeds are kept.

    Seeds that never had a pixel are NaN.
    """
    count = sums[..., :1]
    return np.where(count > 0, sums[..., 1:] / np.maximum(count, 1), before)


def candidates(grid: SeedGrid, centers: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """The nine seeds around each of `cells` (k,), counted row by row, as linear functions of a pixel: (k, 9, 4) int32.

    |v - c|^2 = |v|^2 - 2 v c + |c|^2, where |v|^2 is the same for all nine. The coefficients -2 c are rounded to
    integers, and |c|^2 is that of the rounded center, so borders between cells of seeds are straight.
    """
    padded = grid.ringed(centers, np.nan)  # rows x columns of seeds x (L, a, b, x, y)
    period_x, period_y = grid.periods
    padded[:, 0, 3] -= period_x
    padded[:, -1, 3] += period_x
    padded[0, :, 4] -= period_y
    padded[-1, :, 4] += period_y
    row, column = (n[:, None] for n in np.divmod(cells, grid.across))
    dy, dx = np.array(NINE).T
    near = padded[row + 1 + dy, column + 1 + dx]  # cells x 9 x 5
    rows, columns = grid.references()
    near[..., 3] -= columns[column]
    near[..., 4] -= rows[row]
    absent = np.isnan(near[..., 0])
    near[absent] = 0
    per_color, per_place, color_unit, place_unit = grid.units
    coefficients = np.rint(near * ([per_color] * 3 + [per_place] * 2))
    squares = coefficients * coefficients
    base = (squares[..., 0] + squares[..., 1] + squares[..., 2]) / color_unit
    base += (squares[..., 3] + squares[..., 4]) * place_unit
    c = coefficients.astype(np.int32)
    packed = np.empty((*absent.shape, 4), np.int32)
    packed[..., 0] = np.where(absent, _ABSENT, np.rint(base))
    packed[..., 1] = (c[..., 0] & 0xFFFF) | (c[..., 1] << 16)
    packed[..., 2] = (c[..., 2] & 0xFFFF) | (c[..., 3] << 16)
    packed[..., 3] = c[..., 4]
    return packed


def own_cells_only(grid: SeedGrid) -> np.ndarray:
    """Candidates that make every pixel choose its own cell's seed."""
    packed = np.zeros((grid.count, 9, 4), np.int32)
    packed[..., 0] = _ABSENT
    packed[:, 4, 0] = 0
    return packed


def _layout(grid: SeedGrid, strips: int) -> dict[str, int]:
    """Bytes of tables of seeds and cells on the device."""
    per_seed = {"candidates": 16 * 9, "totals": 8 * 9 * _SUMS, "active": 1, "centers": 8 * 5, "moved": 1}
    return {name: size * grid.count for name, size in per_seed.items()} | {"sums": 4 * 9 * _SUMS * strips * grid.across}


def least_bytes(grid: SeedGrid) -> int:
    """Minimum memory of SLIC with such seeds, for any bands."""
    return sum(_layout(grid, -(-grid.height // _STRIP)).values())


class Slic:
    """SLIC on a `LabGrid`: converged centers, and the slots of all pixels."""

    def __init__(self, lab: LabGrid | LabelSquares, grid: SeedGrid, resources: Resources):
        self._lab, self.grid, self._device = lab, grid, resources.device
        self._run = self._device.program("superpixels")
        self._strips = grid.strips(lab.band_rows)
        first = np.searchsorted(self._strips[:, 2], np.arange(grid.down + 1)).astype(np.int32)  # of each row of cells
        layout = _layout(grid, len(self._strips)) | {"slots": lab.band_rows * lab.width}
        self._buffers = Buffers(self._device, layout, resources.budget, f"SLIC with {grid.count} seeds")
        self._tables = [
            self._device.upload(t) for t in (self._strips, grid.edges(1), grid.cells(1), first, grid.edges(0))
        ]

    def __enter__(self) -> Slic:
        return self

    def __exit__(self, *_: object) -> None:
        self._buffers.__exit__()

    def iterate(self, iterations: int, jitter: np.ndarray | None = None) -> np.ndarray:
        """Seeds after at most `iterations` assignments of pixels to them. The last one is left to `slots`.

        `jitter` (down, across, 2) moves the seeds at the start, px. Returns (down, across, 5) float64: L, a, b in
        steps, x, y in px. NaN: no seed.
        """
        settle = self._settled_there if self._device.info.has_doubles else self._settled_here
        return settle(iterations, jitter)

    def _settled_there(self, iterations: int, jitter: np.ndarray | None) -> np.ndarray:
        """On the device, with seeds, candidates and sums. Only the active cells are read back."""
        device, buffers, grid = self._device, self._buffers, self.grid
        run = device.program("slic_seeds")
        edges, shape = (self._tables[4], self._tables[1]), (grid.across, grid.down)
        seeds, cells = (buffers["centers"], buffers["moved"]), (buffers["candidates"], buffers["active"])
        sums = buffers["totals"], buffers["active"]
        weight, still, *units = map(np.float64, (grid.weight, (_STILL * FINE_STEPS) ** 2, *grid.units))

        def move(start: int) -> None:
            run("move", shape, *sums, *edges, *seeds, *shape, *grid.periods, weight, still, start)

        def follow(start: int) -> None:
            run("follow", shape, *seeds, *edges, *cells, *shape, *grid.periods, _ABSENT, *units, start)

        active = np.ones(grid.count, bool)
        device.write(buffers["candidates"], own_cells_only(grid))
        device.write(buffers["active"], active.view(np.uint8))
        device.fill(buffers["centers"], np.float64(0), 5 * grid.count)
        self._look(active)
        move(1)
        if jitter is not None:
            centers = device.read(buffers["centers"], (grid.down, grid.across, 5), np.float64)
            centers[..., 3:] += jitter
            device.write(buffers["centers"], centers)
        follow(1)
        for _ in range(iterations - 1):
            self._look(active)
            move(0)
            follow(0)
            active = device.read(buffers["active"], (grid.count,), np.uint8).view(bool)
            if not active.any():
                break
        return device.read(buffers["centers"], (grid.down, grid.across, 5), np.float64)

    def _settled_here(self, iterations: int, jitter: np.ndarray | None) -> np.ndarray:
        """On the host, for devices without double precision. Results are bit-identical."""
        grid = self.grid
        present = own_cells_only(grid)
        centers = np.full((grid.down, grid.across, 5), np.nan)  # rows x columns of seeds x (L, a, b, x, y)
        centers = centers_of(self._sums(present, np.ones(grid.count, bool)), centers)
        if jitter is not None:
            centers[..., 3:] += jitter
        following = candidates(grid, centers, np.arange(grid.count))
        active = np.ones(grid.count, bool)
        for _ in range(iterations - 1):
            present = following
            means = centers_of(self._sums(present, active), centers)
            away = (means - centers) ** 2
            away = away[..., 0] + away[..., 1] + away[..., 2] + grid.weight * (away[..., 3] + away[..., 4])
            moved = grid.ringed(away > (_STILL * FINE_STEPS) ** 2, False)
            centers = np.where(moved[1:-1, 1:-1, None], means, centers)
            beside = [moved[1 + dy : 1 + dy + grid.down, 1 + dx : 1 + dx + grid.across] for dy, dx in NINE]
            near = np.flatnonzero(np.any(beside, 0))
            following = present.copy()
            following[near] = candidates(grid, centers, near)
            active = (following != present).any((1, 2))
            if not active.any():
                break
        return centers

    def slots(self, centers: np.ndarray) -> Iterator[tuple[Band, Any]]:
        """(band, a buffer of its slots (rows, width) uint8) from top to bottom: each pixel's choice of nine seeds."""
        self._device.write(self._buffers["candidates"], candidates(self.grid, centers, np.arange(self.grid.count)))
        for band in self._lab.bands():
            self._assign(band, keep=1)
            yield band, self._buffers["slots"]

    def _assign(self, band: Band, keep: int) -> None:
        """Run the kernel on a band: sums to their buffer, or with `keep` slots to theirs."""
        first, end = np.searchsorted(self._strips[:, 0], (band.top, band.bottom)).tolist()
        tables = *self._tables[:3], *(self._buffers[name] for name in ("active", "sums", "slots"))
        items = self._lab.width if self._device.lanes == 1 else self.grid.across
        numbers = self._lab.width, self.grid.across, end - first, self.grid.shift, band.top, first, keep
        self._run("assign", (items, end - first), band.lab, self._buffers["candidates"], *tables, *numbers)

    def _look(self, active: np.ndarray) -> None:
        """Sums over the active cells' pixels, from the candidates and active cells on the device."""
        device, buffers, grid = self._device, self._buffers, self.grid
        edges, rows_active = grid.edges(0), np.logical_or.reduce(active.reshape(grid.down, grid.across), 1)
        if device.lanes == 1:  # single lanes add to the existing sums
            tables = self._tables[0], buffers["active"], buffers["sums"]
            self._run("clear", (grid.across, len(self._strips)), *tables, grid.across, len(self._strips))

        def wanted(top: int, bottom: int) -> bool:
            rows = slice(np.searchsorted(edges, top, "right") - 1, np.searchsorted(edges, bottom, "left"))
            return bool(rows_active[rows].any())

        for band in self._lab.bands(wanted):
            self._assign(band, keep=0)
        tables = self._tables[3], buffers["active"], buffers["totals"]
        self._run("total", (grid.across, grid.down), buffers["sums"], *tables, grid.across, grid.down)

    def _sums(self, chosen: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Sums (down, across, 6) over the pixels of every seed, in px from the image's corner. int64."""
        device, buffers, grid = self._device, self._buffers, self.grid
        device.write(buffers["candidates"], chosen)
        device.write(buffers["active"], active.view(np.uint8))
        self._look(active)
        # rows x columns of cells x their nine seeds x sums
        sums = device.read(buffers["totals"], (grid.down, grid.across, 9, _SUMS), np.int64)
        rows, columns = grid.references()
        sums[..., 4] += sums[..., 0] * columns[None, :, None]
        sums[..., 5] += sums[..., 0] * rows[:, None, None]
        total = np.zeros((grid.down + 2, grid.across + 2, _SUMS), np.int64)
        for n, (dy, dx) in enumerate(NINE):
            total[1 + dy : 1 + dy + grid.down, 1 + dx : 1 + dx + grid.across] += sums[:, :, n]
        for lines, period, place in ((total.swapaxes(0, 1), grid.periods[0], 4), (total, grid.periods[1], 5)):
            if period:  # seeds beyond a border are those of the other one
                for outside, seed, turn in ((0, -2, period), (-1, 1, -period)):
                    lines[seed] += lines[outside]
                    lines[seed, :, place] += turn * lines[outside, :, 0]
        return total[1:-1, 1:-1]


def refined_slots(
    lab: LabGrid, grid: SeedGrid, squares: LabelSquares, settled: Slic, centers: np.ndarray, resources: Resources
) -> Iterator[tuple[Band, Any]]:
    """As `Slic.slots` for the image: the choice of each pixel among nine seeds, band by band.

    `centers` (down, across, 5) float64: its seeds: L, a, b in steps, x, y in squares.
    """
    device, side, strips = resources.device, squares.reduced.side, grid.strips(lab.band_rows)
    run = device.program("superpixels")
    layout = {"seeds": 2 * squares.width * squares.height, "candidates": 16 * 9 * grid.count}
    layout["slots"] = lab.band_rows * lab.width
    with Buffers(device, layout, resources.budget, f"{grid.count} superpixels") as buffers:
        cells = [device.upload(grid.of_squares.cells(axis)) for axis in (0, 1)]
        for band, slots in settled.slots(centers):
            shape = squares.width, squares.height
            run("seeds", shape, band.lab, slots, *cells, buffers["seeds"], *shape)
        centers = centers * [1, 1, 1, side, side] + [0, 0, 0, (side - 1) / 2, (side - 1) / 2]
        device.write(buffers["candidates"], candidates(grid, centers, np.arange(grid.count)))
        tables = [device.upload(t) for t in (strips, grid.edges(1), grid.cells(1))]
        for band in lab.bands():
            first, end = np.searchsorted(strips[:, 0], (band.top, band.bottom)).tolist()
            items = lab.width if device.lanes == 1 else grid.across
            images = buffers["seeds"], buffers["slots"]
            place = end - first, grid.shift, band.top, first
            numbers = lab.width, grid.across, *place, side.bit_length() - 1, squares.width
            run("refine", (items, end - first), band.lab, buffers["candidates"], *tables, *images, *numbers)
            yield band, buffers["slots"]
