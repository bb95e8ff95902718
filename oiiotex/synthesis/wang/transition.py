# SPDX-License-Identifier: Apache-2.0
"""Which pixels of a set of tiles show the second of two materials: every border that a map of both needs.

The materials are tiles of one size that repeat. Pixels keep their place in the tile, so a tile of the set differs from
its neighbors only in where each material is shown. That is decided by minimum cuts (KSE03: Kwatra, Schödl, Essa, Turk,
Bobick, Graphcut Textures, SIGGRAPH 2003), which lead the border around the objects of both materials.

As in `tiles`, a strip of pixels belongs to an edge: it is decided once for all tiles with that edge, on both sides of
it, and the inside of each tile is then decided between its four strips.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ...engine.color.lab_grid import FINE_STEPS, to_grid
from ...engine.core.attributes import ATLAS, FILTER
from ...engine.core.demand import SomeRows, resized
from ...engine.core.parameters import Size
from ...engine.deferred import np, oiio
from ..graphcut.seams import NEIGHBORS, GridEdges, chosen, edges_at, near_border, seam_cost
from ..patchmatch.field import hash_at
from .atlas import CORNERS

LAYOUT = {16: Size(4, 4), 47: Size(8, 6)}  # columns x rows of the tiles of a set
STRIP_SHARE = 20  # of the side of a tile, 1 / n: the depth of a strip
_COARSEST = 256  # px; on larger tiles, the border found there is refined level by level
_REFINED = 2  # px on each side of the border of the coarser level
_RAGGED = 0.7  # share of the border's width that is random; the cut decides on the rest
_STREAM = 0x7A51  # of random numbers
Place = tuple[slice, slice]
_CELLS, _OCTAVES = 6, 3  # of the noise: cells along a side on its coarsest octave, and number of octaves


def controls(count: int) -> np.ndarray:
    """The materials at points of each tile, row by row of the set: (tiles, n, n) int, 0 or 1.

    16 tiles have four corners each (n = 2), in all combinations. On their torus, neighbors share corners. 47 tiles also
    have sides (n = 3), and show the second material in the center. A corner has it only between two sides that have
    it. The last tile of the set shows the first material alone.
    """
    if count == 16:
        corners = np.pad([[int(color) for color in row] for row in CORNERS], (0, 1), mode="wrap")
        return np.stack([corners[y : y + 2, x : x + 2] for y, x in itertools.product(range(4), repeat=2)])
    tiles = []
    for sides in itertools.product((0, 1), repeat=4):
        north, west, east, south = sides
        between = (north & west, north & east, south & west, south & east)
        for nw, ne, sw, se in itertools.product(*((0, 1)[: 1 + both] for both in between)):
            tiles.append([[nw, north, ne], [west, 1, east], [sw, south, se]])
    return np.array([*tiles, np.zeros((3, 3), int).tolist()])


def count_of(spec: oiio.ImageSpec) -> int:
    """The number of tiles of an image that is such a set; 0 if it is none."""
    if spec.get_string_attribute(FILTER) != "transition":
        return 0
    grid = spec.get_string_attribute(ATLAS)
    fitting = [count for count, layout in LAYOUT.items() if str(layout) == grid]
    whole = fitting and not (spec.width % LAYOUT[fitting[0]].width or spec.height % LAYOUT[fitting[0]].height)
    return fitting[0] if whole else 0


def widest(count: int, side: int) -> float:
    """The largest width of a border in tiles of that shorter side, px: the strips of other edges stay clear of it."""
    spans = controls(count).shape[-1] - 1
    return (1 - 2 * spans / STRIP_SHARE) * side / spans


def in_sheet(tiles: list[np.ndarray], layout: Size) -> np.ndarray:
    """Tiles, (height, width) each, in one array, row by row."""
    return np.block([tiles[at : at + layout.width] for at in range(0, len(tiles), layout.width)])


@dataclass(frozen=True)
class TransitionTiles:
    """Where a set of tiles shows the second material.

    Attributes
    ----------
    tiles : list of (height, width) bool
        In the order of `controls`.
    depth : int
        Depth of a strip on one side of an edge, px.
    around : callable
        A tile with the strips that lie across its edges, by its number: (height + 2 * depth, width + 2 * depth) bool.
    """

    tiles: list[np.ndarray]
    depth: int
    around: Callable[[int], np.ndarray]

    def weights(self, number: int) -> np.ndarray:
        """The weight of the second material in a tile, (height, width) float32: a ramp across the border.

        It is 0 or 1 from the depth of a strip on, and the same on both sides of an edge.
        """
        from scipy import ndimage  # slow to import

        around, depth = self.around(number), self.depth
        if around.all() or not around.any():
            return np.full(self.tiles[number].shape, around[0, 0], np.float32)
        inside, outside = (ndimage.distance_transform_edt(one) for one in (around, ~around))
        signed = np.where(around, inside - 0.5, 0.5 - outside)
        ramp = np.clip(0.5 + signed / (2 * depth), 0, 1).astype(np.float32)
        return ramp[depth:-depth, depth:-depth]


def shown(
    materials: tuple[SomeRows, SomeRows], count: int, width: float, seed: int, advance: Callable[[int, int], None]
) -> TransitionTiles:
    """Decide where each tile of a set shows the second material.

    Parameters
    ----------
    materials : pair of (height, width, channels) float
        CIE Lab of both tiles; further channels are ignored.
    count : int
        16 or 47.
    width : float
        Of the zone in which a border may run, px; at most `widest`.
    seed : int
    advance : callable
        Called with the number of decided tiles and the total, on all levels.
    """
    sizes = [materials[0].shape[:2]]
    while max(sizes[-1]) > _COARSEST:
        sizes.append(tuple(-(-side // 2) for side in sizes[-1]))
    points, coarser, done = controls(count), None, itertools.count(1)
    for height, across in reversed(sizes):
        grids = tuple(to_grid(resized(one, across, height)[..., :3], FINE_STEPS) for one in materials)
        level = _Level(grids, points, width * height / sizes[0][0], seed, coarser)
        for number in range(len(points)):
            level.decide(number)
            advance(next(done), len(points) * len(sizes))
        coarser = level
    return TransitionTiles(level.tiles, level.depth, level.around)


class _Level:
    """The tiles of a set at one resolution, decided between their strips."""

    def __init__(
        self, grids: tuple[np.ndarray, ...], points: np.ndarray, width: float, seed: int, coarser: _Level | None
    ):
        self.grids, self.points, self.coarser = grids, points, coarser
        self.shape = grids[0].shape[:2]
        share = (points.shape[-1] - 1) * width / (2 * min(self.shape))
        self.ragged, self.freedom = _RAGGED * share, (1 - _RAGGED) * share
        self.noise = np.zeros((1, 1)) if coarser else self.ragged * _noise(self.shape, seed)  # of the coarsest level
        least = max(1, min(self.shape) // STRIP_SHARE)
        self.depth: int = least if coarser is None else coarser.depth * self.shape[0] // coarser.shape[0]
        self.tiles: list[np.ndarray] = []
        self._strips: dict[tuple[int, tuple[int, ...]], np.ndarray] = {}

    def decide(self, number: int) -> None:
        """Decide the next tile."""
        points, depth = self.points[number], self.depth
        if self.coarser is None:
            more = 2 * (len(points) - 1) * depth / min(self.shape)  # the edges' strips are decided without the inside
            free, fixed = self._field(_between(points, self.shape), (0, 0), more)
        else:
            free, fixed = _refined(self.coarser.tiles[number], self.shape)
        for axis, line, here, part in _edges(points, depth):
            fixed[here] = self.strip(axis, line)[part]
            free[here] = False
        self.tiles.append(self._cut(free, fixed, (0, 0)))

    def strip(self, axis: int, line: tuple[int, ...]) -> np.ndarray:
        """The pixels along an edge, on both sides; bool, (2 * depth, width) for axis 0, else (height, 2 * depth).

        `line`: the materials at its points.
        """
        key = axis, line
        if key not in self._strips:
            self._strips[key] = self._strip(axis, line)
        return self._strips[key]

    def around(self, number: int) -> np.ndarray:
        """A decided tile with the strips that lie across its edges."""
        depth = self.depth
        around = np.pad(self.tiles[number], depth, mode="edge")
        for axis, line, here, _ in _edges(self.points[number], depth):
            beyond = [slice(depth, -depth)] * 2
            at_end = here[axis].start is not None
            beyond[axis] = slice(-depth, None) if at_end else slice(0, depth)
            other = slice(depth, None) if at_end else slice(0, depth)
            across = (other, slice(None)) if axis == 0 else (slice(None), other)
            around[tuple(beyond)] = self.strip(axis, line)[across]
        return around

    def _strip(self, axis: int, line: tuple[int, ...]) -> np.ndarray:
        depth, corner = self.depth, (-self.depth, 0) if axis == 0 else (0, -self.depth)
        shape = (2 * depth, self.shape[1]) if axis == 0 else (self.shape[0], 2 * depth)
        if self.coarser is None:
            points = np.array([line, line]) if axis == 0 else np.array([line, line]).T
            free, fixed = self._field(_between(points, shape), corner, 0.0)
        else:
            free, fixed = _refined(self.coarser.strip(axis, line), shape)
        for end in (slice(0, depth), slice(-depth, None)):  # where strips cross, all tiles show the corner's material
            here = (slice(None), end) if axis == 0 else (end, slice(None))
            free[here], fixed[here] = False, line[0 if end.start == 0 else -1]
        return self._cut(free, fixed, corner)

    def _field(self, mean: np.ndarray, corner: tuple[int, int], more: float) -> tuple[np.ndarray, np.ndarray]:
        """Where the cut decides, and the random border elsewhere."""
        apart = mean + _window(self.noise, corner, mean.shape) - 0.5
        return np.abs(apart) < self.freedom + more, apart > 0

    def _cut(self, free: np.ndarray, fixed: np.ndarray, corner: tuple[int, int]) -> np.ndarray:
        if not free.any():
            return fixed
        width, costs = free.shape[1], []

        def colors(grid: np.ndarray, at: np.ndarray) -> np.ndarray:
            y, x = at // width + corner[0], at % width + corner[1]
            return grid[y % grid.shape[0], x % grid.shape[1]].astype(np.int32)

        for step in NEIGHBORS:
            s, t = edges_at(free, step)
            cost = seam_cost(*(colors(grid, at) for grid in self.grids for at in (s, t)))
            costs.append(GridEdges(s, t, cost, cost))
        return chosen(free, fixed, np.zeros(free.size, np.int64), costs)


def _edges(points: np.ndarray, depth: int) -> Iterator[tuple[int, tuple[int, ...], Place, Place]]:
    """The four edges of a tile: axis, materials at their points, the strip's pixels in the tile, and in the strip."""
    begin, end, whole = slice(None, depth), slice(-depth, None), slice(None)
    for axis in (0, 1):
        lines = points if axis == 0 else points.T
        for line, here, part in ((lines[0], begin, end), (lines[-1], end, begin)):
            places = ((here, whole), (part, whole)) if axis == 0 else ((whole, here), (whole, part))
            yield axis, tuple(line.tolist()), *places


def _refined(coarse: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The border of a coarser level, and the pixels next to it, on which the cut decides."""
    rows, columns = (np.arange(n) * c // n for n, c in zip(shape, coarse.shape, strict=True))
    fixed = coarse[rows][:, columns]
    return near_border(fixed, _REFINED), fixed


def _between(points: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Values at points of a tile, interpolated between them: (height, width) float64."""

    def along(n: int, spans: int) -> tuple[np.ndarray, np.ndarray]:
        place = (np.arange(n) + 0.5) * spans / n
        low = np.minimum(place.astype(np.int64), spans - 1)
        return low, place - low

    (y, below), (x, right) = (along(n, count - 1) for n, count in zip(shape, points.shape, strict=True))
    upper, lower = (points[rows][:, x] * (1 - right) + points[rows][:, x + 1] * right for rows in (y, y + 1))
    return np.asarray(upper * (1 - below[:, None]) + lower * below[:, None])


def _noise(shape: tuple[int, int], seed: int) -> np.ndarray:
    """Smooth noise that repeats, from -1 to 1: (height, width) float64. Only sums and products: equal on every CPU."""
    total = np.zeros(shape)
    for octave in range(_OCTAVES):
        cells = _CELLS << octave
        y, x = np.mgrid[:cells, :cells]
        values = hash_at(seed, _STREAM + octave, y, x) / 2.0**31 - 1
        total += _between(np.pad(values, (0, 1), mode="wrap"), shape) / (1 << octave)
    return total / np.abs(total).max()


def _window(values: np.ndarray, corner: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    """A window of values that repeat, at (y, x)."""
    rows, columns = ((np.arange(n) + at) % side for n, at, side in zip(shape, corner, values.shape, strict=False))
    return values[rows][:, columns]
