# SPDX-License-Identifier: Apache-2.0
"""Low-frequency variation of an image: its local level and local contrast, as medians over a disc.

A lighting gradient or a stain changes the level of a texture over distances larger than its elements. A Gaussian
blurs the rim of a stain and leaves it. A median follows the rim and ignores elements smaller than half the disc. The
level is the value of a locally fitted plane plus the median of the residuals in the cells of a disc: the plane keeps
gradients exact up to the border, where a median alone would be biased inwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ...engine.color.lab_grid import SUM_STEPS
from ...engine.color.lens import Lens
from ...engine.core.image import Image
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.scan import scan
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from ..stationarity.grid_statistics import MARGIN, Cells, close_margins, correlated, smoothing_taps
from .compact_regions import objects, stains

_LIMIT = 2048 * SUM_STEPS  # values beyond are clamped: so the squares in a cell are summed exactly in doubles
_CELLS_PER_RADIUS = 8  # the rim of a stain is followed to within one cell
_PLANE = 2.0  # sigma of the plane fit, in radii
_SMALL = 0.4  # radius of the disc for stains and objects, relative to the radius
_LEAST_ALPHA = 1 / 32  # pixels below it do not count: their color is a quotient of small numbers
_AT_ONCE = 1 << 13  # values of discs sorted at a time, or as many as there are cells
_PLANES = 28  # maximum number of arrays of cells between the sums and the results
_FIELDS = "level", "contrast", "stains", "objects"  # of `Drift`
MOST_GAIN = 2.0  # contrast is at most doubled and at least halved
_RIDGE = 0.02  # regularization of the slope fit, relative to sigma^2


@dataclass(frozen=True)
class ValueRange:
    """Kind and range of values: `limits` are the lowest and highest value of L or data; not `in_lab`: data."""

    limits: tuple[float, float]
    in_lab: bool


@dataclass(frozen=True)
class Drift:
    """Local and global statistics of an image.

    Fields have values at the cells' centers, with the margin `grid_statistics.MARGIN`.

    Attributes
    ----------
    cells : Cells
    level : (down + 4, across + 4, channels) float
        Local level.
    contrast : (down + 4, across + 4, channels) float
        Median over the disc of the standard deviation in a cell, after subtracting the local level.
    stains : (down + 4, across + 4) float
        Stains smaller than the disc, 0 to 1, where contrast may change more than in the texture.
    objects : (down + 4, across + 4) float
        1 in regions of another material. `level` and `contrast` there are those of their surroundings.
    overall_level, overall_contrast : (channels,) float
        Medians over the image.
    scale : ValueRange
    """

    cells: Cells
    level: np.ndarray
    contrast: np.ndarray
    stains: np.ndarray
    objects: np.ndarray
    overall_level: np.ndarray
    overall_contrast: np.ndarray
    scale: ValueRange

    def stained(self) -> np.ndarray | None:
        """Pixels of `stains` and `objects`, (height, width) bool; None: there are none.

        A correction slower than sigma cannot restore them: a stain tints light elements more than dark ones.
        """
        regions = ((self.stains > 0) | (self.objects > 0))[MARGIN:-MARGIN, MARGIN:-MARGIN]
        if not regions.any():
            return None
        return regions[self.cells.lines][:, self.cells.columns]


def drift_of(
    image: Image,
    lens: Lens,
    radius: float,
    resources: Resources,
    progress: Progress,
    wraps: tuple[bool, bool] = (False, False),
    usable: np.ndarray | None = None,
    robust: bool = True,
) -> Drift | None:
    """The statistics of an image's first part at the scale of a radius, from one pass over its pixels.

    Parameters
    ----------
    radius : float
        Radius of the disc, px.
    wraps : (bool, bool)
        The image is a torus along y, along x.
    usable : (height, width) bool, optional
        Pixels that count. Default: all. Pixels whose alpha is below 1/32 never count.
    robust : bool
        Use medians. Otherwise the level is a Gaussian mean with half the radius as sigma, and contrast is 0.

    Returns
    -------
    Drift or None
        None where no pixel counts.

    Raises
    ------
    ImageError
        NaN or Inf, or the cells do not fit the budget.
    """
    whole, count, lens = image.first.window, lens.count, replace(lens, least_alpha=_LEAST_ALPHA)
    cells = drift_cells(whole, radius, wraps)
    places = cells.down + 2 * MARGIN, cells.across + 2 * MARGIN
    in_lab = lens.space is not None
    shapes = (*places, count), (*places, count), places, places
    layout = {name: (shape, np.float64) for name, shape in zip(_FIELDS, shapes, strict=True)}
    layout["sums"] = ((*places, 1 + 2 * count), np.float64)
    beside = 8 * _PLANES * max(math.prod(places), _AT_ONCE // 4)
    scratch = resources.scratch(layout, f"radius={radius:g}", "increase the radius", beside)
    sums = scratch["sums"][MARGIN:-MARGIN, MARGIN:-MARGIN]

    limits = [(math.inf, -math.inf)]

    def look(values: np.ndarray, opaque: np.ndarray | None, piece: Window) -> tuple[list[np.ndarray], float, float]:
        if usable is not None:
            mask = usable[piece.top - whole.top : piece.bottom - whole.top]
            opaque = mask if opaque is None else mask & opaque
        rows = [row.inside(piece) for row in cells.rows(piece)]
        sums = [cell_sums(values[at][..., :count], None if opaque is None else opaque[at], cells) for at in rows]
        seen = values[..., : 1 if in_lab else count]
        seen = seen if opaque is None else seen[opaque]
        return sums, float(seen.min(initial=math.inf)), float(seen.max(initial=-math.inf))

    def keep(piece: Window, found: tuple[list[np.ndarray], float, float]) -> None:
        cells.add(sums, piece, found[0])
        limits.append(found[1:])

    cell = 0 if wraps[0] else cells.side  # around a torus the heights of rows of cells differ by up to a pixel
    scan(image.first, lens, resources, look, keep, cell=cell, larger=2, advance=progress.advance)
    if not sums[..., 0].any():
        return None
    lowest, highest = zip(*limits, strict=True)
    return _drift(cells, scratch, radius, robust, ValueRange((min(lowest), max(highest)), in_lab))


def drift_cells(window: Window, radius: float, wraps: tuple[bool, bool] = (False, False)) -> Cells:
    """The cells of an image's drift. `radius`: of the disc, px."""
    return Cells.for_sigma(window, radius, _CELLS_PER_RADIUS, wraps)


def cell_sums(values: np.ndarray, opaque: np.ndarray | None, cells: Cells) -> np.ndarray:
    """Number, sums and sums of squares of values on the integer grid, per cell of a row of cells.

    Integers in doubles, whose sums are exact in any order.

    `values` (height, width, channels) float32; `opaque` (height, width) bool or None; returns (across, 1 + 2 channels)
    float64.
    """
    height, width, count = values.shape
    starts = cells.starts
    out = np.empty((len(starts), 1 + 2 * count))
    if opaque is None:
        out[:, 0] = np.diff(starts, append=width) * height
    else:
        out[:, 0] = np.add.reduceat(np.count_nonzero(opaque, axis=0), starts)
    for c in range(count):
        grid = np.clip(np.rint(values[..., c] * np.float32(SUM_STEPS)), -_LIMIT, _LIMIT)
        if opaque is not None:
            grid *= opaque
        grid = grid.astype(np.float64)
        out[:, 1 + c] = np.add.reduceat(grid.sum(0), starts)
        out[:, 1 + count + c] = np.add.reduceat(np.einsum("ij,ij->j", grid, grid), starts)
    return out


def _drift(cells: Cells, scratch: dict[str, np.ndarray], radius: float, robust: bool, scale: ValueRange) -> Drift:
    """Compute the statistics from sums into preallocated arrays, channel by channel to limit temporaries."""
    wraps = cells.wraps
    torus = tuple(slice(MARGIN, -MARGIN) if around else slice(None) for around in wraps)  # wrapped axes without margin
    sums, level, contrast, stained, left_out = (scratch[name][torus] for name in ("sums", *_FIELDS))
    number, count = sums[..., 0], level.shape[-1]
    sigma = _PLANE * radius if robust else radius / 2
    taps_y, taps_x = (smoothing_taps(sigma, step) for step in cells.steps)
    fit = _LocalFit(number, taps_y, taps_x, wraps)
    inside, safe = number > 0, np.maximum(number, 1.0)
    disc, near = (_Disc(inside, [share * radius / step for step in cells.steps], wraps) for share in (1.0, _SMALL))
    for c in range(count):
        total = sums[..., 1 + c] / SUM_STEPS
        plane = fit.means(total)
        level[..., c] = plane + disc.medians(total / safe - plane) if robust else plane
    if robust:
        means = sums[..., 1 : 1 + count] / SUM_STEPS / safe[..., None]
        rest = np.stack([near.medians(means[..., c] - level[..., c]) for c in range(count)], -1)
        if scale.in_lab and not left_out.any():
            found = objects(level + rest, np.median(level[inside], axis=0), inside)
            if found.any():
                left_out[:], sums[found] = found, 0.0
                return _drift(cells, scratch, radius, robust, scale)
        stained[:] = stains(rest, inside)
        level += stained[..., None] * rest  # it follows the stains
        _add_contrast(level, contrast, stained, sums, disc, near)
    overall_level, overall_contrast = (np.median(plane[inside], axis=0) for plane in (level, contrast))
    level[fit.weight <= 0] = overall_level
    if robust:
        measured = slice(1 if scale.in_lab else count)
        level[..., measured] = np.clip(level[..., measured], *scale.limits)  # a plane leaves them
    for name in _FIELDS:
        close_margins(scratch[name], wraps)
    fields = {name: scratch[name] for name in _FIELDS}
    return Drift(cells, **fields, overall_level=overall_level, overall_contrast=overall_contrast, scale=scale)


def _add_contrast(
    level: np.ndarray, contrast: np.ndarray, stained: np.ndarray, sums: np.ndarray, disc: _Disc, near: _Disc
) -> None:
    """Fill `contrast`. Arrays as in `Drift`."""
    number, count = sums[..., 0], level.shape[-1]
    safe = np.maximum(number, 1.0)
    for c in range(count):
        total, squares, own = sums[..., 1 + c] / SUM_STEPS, sums[..., 1 + count + c] / SUM_STEPS**2, level[..., c]
        # sum of squares after subtracting the local level, constant in a cell, from every value
        spread = np.sqrt(np.maximum(squares - 2.0 * own * total + own**2 * number, 0.0) / safe)
        contrast[..., c] = disc.medians(spread)
        if stained.any():
            contrast[..., c] += stained * (near.medians(spread) - contrast[..., c])


class _Disc:
    """Medians over a disc of cells. Empty cells, and those beyond the border, do not count."""

    def __init__(self, counts: np.ndarray, radius: list[float], wraps: tuple[bool, bool]):
        self._counts = counts
        most = [(n - 1) // 2 if around else n - 1 for n, around in zip(counts.shape, wraps, strict=True)]
        reach = [min(int(r), n) for r, n in zip(radius, most, strict=True)]
        y, x = np.mgrid[-reach[0] : reach[0] + 1, -reach[1] : reach[1] + 1]
        inside = (y / max(radius[0], 1e-9)) ** 2 + (x / max(radius[1], 1e-9)) ** 2 <= 1.0
        self._steps = y[inside], x[inside]
        self._reach, self._wraps = reach, wraps

    def medians(self, values: np.ndarray) -> np.ndarray:
        """Median around every cell, (down, across) float64. 0 if nothing counts."""
        down, across = values.shape
        padded = np.where(self._counts, values, np.inf)
        for axis, (reach, wraps) in enumerate(zip(self._reach, self._wraps, strict=True)):
            width = [(reach, reach) if a == axis else (0, 0) for a in (0, 1)]
            padded = np.pad(padded, width, "wrap") if wraps else np.pad(padded, width, constant_values=np.inf)
        (dy, dx), wide = self._steps, padded.shape[1]
        steps = (dy + self._reach[0]) * wide + dx + self._reach[1]
        out, flat = np.empty(down * across), padded.ravel()
        corners = (np.arange(down)[:, None] * wide + np.arange(across)).ravel()
        step = max(1, max(_AT_ONCE, len(corners)) // len(steps))
        for first in range(0, len(corners), step):
            at = corners[first : first + step]
            around = np.sort(flat[at[:, None] + steps], axis=1)
            number = np.maximum(np.count_nonzero(np.isfinite(around), axis=1), 1)
            rows = np.arange(len(at))
            out[first : first + len(at)] = 0.5 * (around[rows, (number - 1) // 2] + around[rows, number // 2])
        return np.where(np.isfinite(out), out, 0.0).reshape(down, across)


class _LocalFit:
    """Local means: the value at a cell's center of a plane fitted to its surroundings.

    A weighted mean is biased inwards at the border and away from holes, and would leave a part of a lighting gradient
    there. A fitted plane is not. Inside, both are the same.
    """

    def __init__(self, number: np.ndarray, taps_y: np.ndarray, taps_x: np.ndarray, wraps: tuple[bool, bool]):
        (y0, y1, y2), (x0, x1, x2) = (_moments(taps) for taps in (taps_y, taps_x))
        self._along, self._wraps = ((y0, x0), (y0, x1), (y1, x0)), wraps
        self.weight = self._around(number, y0, x0)
        self._safe = safe = np.where(self.weight > 0, self.weight, 1.0)
        self._x, self._y = x, y = [self._around(number, *pair) / safe for pair in self._along[1:]]
        xx, yy, xy = (self._around(number, *pair) / safe for pair in ((y0, x2), (y2, x0), (y1, x1)))
        self._xx = xx - x * x + _RIDGE * float(x2.sum())
        self._yy = yy - y * y + _RIDGE * float(y2.sum())
        self._xy = xy - x * y
        self._inverse = 1.0 / (self._xx * self._yy - self._xy * self._xy)

    def means(self, total: np.ndarray) -> np.ndarray:
        """Means of values whose sums in the cells are `total`, (down, across)."""
        x, y, xx, yy, xy = self._x, self._y, self._xx, self._yy, self._xy
        mean, along_x, along_y = (self._around(total, *pair) / self._safe for pair in self._along)
        along_x, along_y = along_x - x * mean, along_y - y * mean
        slope_x = (along_x * yy - along_y * xy) * self._inverse
        slope_y = (along_y * xx - along_x * xy) * self._inverse
        return mean - slope_x * x - slope_y * y

    def _around(self, grid: np.ndarray, taps_y: np.ndarray, taps_x: np.ndarray) -> np.ndarray:
        return correlated(grid, taps_y, taps_x, wraps=self._wraps)


def _moments(taps: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Taps, and their products with the distance in cells and with its square."""
    away = np.arange(len(taps)) - len(taps) // 2
    return taps, taps * away, taps * away**2
