# SPDX-License-Identifier: Apache-2.0
"""Superpixels of an image of any size: SLIC, connected, with their statistics.

LSA16 section 3.1 and 3.3: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction
for Texture Synthesis, SIGGRAPH 2016. Lab passes through the device (`lab_on_device`), seeds converge (`slic`), pixels
become runs (`run_length`). Only runs and sums stay in memory. All sums are of integers, so the partition and its
statistics are bit-identical for any tile, budget, register width or number of threads.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from ...engine.color.lab_grid import FINE_STEPS
from ...engine.color.lab_on_device import PIXEL_BYTES, Band, LabGrid, most_on_device
from ...engine.color.lens import Lens
from ...engine.core.attributes import mark_as_data
from ...engine.core.image import Image, Part, derived_spec
from ...engine.core.parameters import param
from ...engine.core.tiling import tiled_spec, tiling_of
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.errors import present
from ...engine.opencl.buffers import Buffers, in_smaller_pieces, offset_table
from ...engine.session.facts import Facts
from ...engine.session.resources import Resources
from .crumbs import without_crumbs
from .run_length import OUTSIDE, Pieces, Runs, Strip, pieces_of, without_small
from .slic import NINE, NONE, SeedGrid, Slic, least_bytes, refined_slots
from .squares import WIDEST, LabelSquares, Reduced

COMPACTNESS = 20.0  # m_1 of LSA16 section 3.4
LEAST_COMPACTNESS = 2.0  # by default, Lab units per sigma: below, noise decides
_PER_CONTRAST = 1.25  # compactness per median deviation of Lab in a cell
FINEST = 0.02  # sigma_1 as a share of the shorter side: LSA16 section 3.4
LEAST_SIGMA = 4.0  # px; smaller superpixels have no pattern
ITERATIONS = 1000
_BAND_ROWS = 128  # of labels that become runs at a time
_SUMS = 21  # per superpixel, of powers, in cl/superpixels.cl


def compactness_param(advanced: bool = False) -> Any:
    """Declare `compactness`."""
    return param(
        None, example="10", ge=0.1, le=100, advanced=advanced, unset="1.25 times the photo's contrast, from 2 to 20",
        help="Compactness m of SLIC: the Lab distance that weighs as much as one sigma in space. Increase it for"
             " rounder superpixels, reduce it for borders that follow faint edges.",
    )  # fmt: skip


@dataclass(frozen=True)
class Superpixels:
    """n superpixels of one image, numbered by their first pixel in reading order.

    Attributes
    ----------
    window : Window
        The image's data window.
    labels : Part
        One uint32 channel: ids 1 .. n, 0 where alpha is 0. Any window can be read in any order.
    sizes : (n,) int64
        Numbers of pixels.
    positions : (n, 2) float64
        Centroids (x, y) of the pixels' corners, relative to the window's. In a tile they may lie beyond its border.
    power_sums : (n, 3, 5) float64 or None
        Sums over pixels of L, a, b to the first .. fifth power, in Lab units to that power: exact sums over a grid of
        1/8 unit, rounded once. None: not requested.
    edges : (m, 2) int32
        a < b, 0-based: superpixels with a common border (4-connectivity).
    sigma : float
        Scale sigma_1, px.
    compactness : float
        m of eq. 1, Lab units per sigma.
    runs : Runs
        The label map, 0-based.
    periods : (int, int)
        Width and height where the image tiles, px; 0: it does not.
    """

    window: Window
    labels: Part
    sizes: np.ndarray
    positions: np.ndarray
    power_sums: np.ndarray | None
    edges: np.ndarray
    sigma: float
    compactness: float
    runs: Runs
    reduced: Reduced
    periods: tuple[int, int] = (0, 0)

    @property
    def count(self) -> int:
        """n."""
        return len(self.sizes)

    def error(self) -> float:
        """LSA16 eq. 3: the sum over pixels of the squared distance (eq. 1) to the mean of their superpixel, Lab^2."""
        n = self.sizes[:, None]
        sums = present(self.power_sums)
        color = sums[..., 1].sum() - (sums[..., 0] ** 2 / n).sum()
        rows, left, right = self.runs.rows().astype(np.float64), self.runs.left, self.runs.right()
        inside = self.runs.label != OUTSIDE
        squares = ((_squares(right) - _squares(left)) + rows**2 * (right - left))[inside].sum()
        place = squares - (self.positions**2 * n).sum()
        return float(color + (self.compactness / self.sigma) ** 2 * place)


def finest_scale(side: int) -> float:
    """sigma_1, px, for an image with that shorter side: LSA16 section 3.4, but at least `LEAST_SIGMA`."""
    return max(LEAST_SIGMA, FINEST * side)


def superpixels(
    image: Image,
    lens: Lens,
    resources: Resources,
    *,
    sigma: float | None = None,
    compactness: float | None = None,
    iterations: int = ITERATIONS,
    runs: int = 1,
    minsize: int | None = None,
    seed: int = 0,
    literal: bool = False,
    powers: bool = True,
    advance: Callable[[int, int], None] = lambda done, total: None,
) -> Superpixels:
    """Superpixels of the image's first part: LSA16 section 3.

    Parameters
    ----------
    image, lens
    sigma : float, optional
        Scale, px. Default: `finest_scale`.
    compactness : float, optional
        m of eq. 1, Lab units per sigma. Default: `compactness_of` the image.
    iterations : int
        Maximum number of assignments of pixels to seeds.
    runs : int
        Number of runs, of which the best by eq. 3 is returned. All but the first start with randomly moved seeds.
    minsize : int, optional
        Smaller pieces are merged into neighbors. Default: a quarter of sigma^2.
    seed : int
        Seed of the random moves.
    literal : bool
        Read all pixels in every iteration, however large the image.
    powers : bool
        Compute sums of powers, in a pass over the image. Several runs need them to choose the best.
    advance : callable
        Called with (done, total).

    Raises
    ------
    ImageError, DeviceError
        NaN or Inf, or it does not fit the budget.
    """
    part = image.first
    window, (side, on_squares, grid) = part.window, _seeds(part, sigma, literal)
    least = 0.25 * grid.scale**2 if minsize is None else minsize

    def require(need: int) -> None:
        size = f"{part.spec.width}x{part.spec.height} px"
        resources.require(need, f"{size} divided into that many pieces", "blur the image first")

    require_superpixels(part, resources, sigma, literal)

    def within(most: int) -> Superpixels:
        """With a limit in bytes for the image on the device at a time."""
        best: Superpixels | None = None
        with contextlib.ExitStack() as opened:
            squares = opened.enter_context(LabelSquares(window.width, window.height, side, resources, on_squares))
            lab = opened.enter_context(LabGrid(image, lens, resources, side, most, squares.look))
            advance(1, 5 * runs + 1)  # steps of about the same time
            chosen = replace(grid, compactness=compactness or compactness_of(squares.reduced, grid))
            settled, settling = (squares, chosen.of_squares) if on_squares else (lab, chosen)
            slic = opened.enter_context(Slic(settled, settling, resources))
            for run in range(runs):
                centers = slic.iterate(iterations, _jitter(settling, seed, run) if run else None)
                advance(5 * run + 5, 5 * runs + 1)
                slots = (
                    refined_slots(lab, chosen, squares, slic, centers, resources) if on_squares else slic.slots(centers)
                )
                strips = _strips(slots, grid, resources)
                if on_squares:
                    strips = without_crumbs(strips, lab.height, least, grid.tiled)
                pieces = without_small(pieces_of(strips, lab.height, require, grid.tiled), least)
                wanted = powers or runs > 1
                candidate = _described(part, lab if wanted else None, chosen, pieces, squares.reduced, resources)
                if best is None or candidate.error() < best.error():
                    best = candidate
                advance(5 * run + 6, 5 * runs + 1)
        assert best is not None
        return best

    row = PIXEL_BYTES * part.window.width
    return in_smaller_pieces(within, min(most_on_device(resources), row * part.window.height), side * row)


def compactness_of(reduced: Reduced, grid: SeedGrid) -> float:
    """Compactness by the image's contrast in cells of seeds, in halves of a Lab unit per sigma.

    The paper's value, for any photo, makes the borders of dark and soft photos straight lines of the grid.
    """
    edges = ((grid.edges(axis) + reduced.side - 1) // reduced.side for axis in (0, 1))
    wanted = round(2.0 * _PER_CONTRAST * reduced.contrast(*edges)) / 2.0
    return min(max(wanted, LEAST_COMPACTNESS), COMPACTNESS)


def _seeds(part: Part, sigma: float | None, literal: bool) -> tuple[int, bool, SeedGrid]:
    """The side of the squares that pixels are averaged in, whether seeds are moved on these, and the seeds."""
    window = part.window
    sigma = finest_scale(min(window.size)) if sigma is None else sigma
    # a superpixel is 16 to 32 squares wide, whatever the image's size
    side = min(1 << max(0, int(math.log2(sigma / 16))), WIDEST)
    on_squares = side > 1 and not literal
    square, tiled = side if on_squares else 1, "none" if literal else tiling_of(part.spec)
    return side, on_squares, SeedGrid.of(window.width, window.height, sigma, COMPACTNESS, square, tiled)


def require_superpixels(part: Part, facts: Facts, sigma: float | None, literal: bool = False) -> None:
    """Refuse `superpixels` that exceed the memory budget whatever the pixels are."""
    window, (side, on_squares, grid) = part.window, _seeds(part, sigma, literal)
    cut = f"{window.width}x{window.height} px divided into {grid.count} superpixels"
    facts.require(_certain(grid.of_squares if on_squares else grid, window, side), cut, "use larger superpixels")


def _certain(grid: SeedGrid, window: Window, side: int) -> int:
    """Bytes that are held for any image: the image in squares, and SLIC's tables."""
    return 16 * -(-window.width // side) * -(-window.height // side) + least_bytes(grid)


def _jitter(grid: SeedGrid, seed: int, run: int) -> np.ndarray:
    """Random moves of seeds by up to a quarter of a cell, (down, across, 2) px, from a counter-based hash."""
    bits = np.random.Philox(key=[seed, run]).random_raw(2 * grid.count)
    share = (bits >> np.uint64(11)).astype(np.float64) / 2.0**54 - 0.25
    return share.reshape(grid.down, grid.across, 2) * [grid.width / grid.across, grid.height / grid.down]


def _strips(bands: Iterable[tuple[Band, Any]], grid: SeedGrid, resources: Resources) -> Iterator[Strip]:
    """The seeds chosen by pixels, OUTSIDE where they are transparent, from top to bottom."""
    away = np.zeros((NONE + 1, 2), np.int32)
    away[: len(NINE)] = NINE
    rows, columns, edges = grid.cells(0), grid.cells(1), grid.edges(1)[:-1]
    for band, buffer in bands:
        slots = resources.device.read(buffer, (band.bottom - band.top, grid.width), np.uint8)
        for top in range(0, len(slots), _BAND_ROWS):
            piece = slots[top : top + _BAND_ROWS]
            change = np.ones(piece.shape, bool)
            np.not_equal(piece[:, 1:], piece[:, :-1], out=change[:, 1:])
            change[:, edges] = True  # slots that differ or belong to two cells may be one seed's
            starts = np.flatnonzero(change)
            row, column = np.divmod(starts, grid.width)
            slot = piece.ravel()[starts]
            down, across = away[slot].T
            label = (rows[band.top + top + row] + down) % grid.down * grid.across
            label += (columns[column] + across) % grid.across  # seeds beyond the border of a tile
            label[slot == NONE] = OUTSIDE
            yield Strip.joined(grid.width, len(piece), starts, label)


def _described(
    part: Part, lab: LabGrid | None, grid: SeedGrid, pieces: Pieces, reduced: Reduced, resources: Resources
) -> Superpixels:
    runs, sizes = pieces.runs, pieces.sizes
    inside = runs.label != OUTSIDE
    label, left, right, rows = runs.label[inside], runs.left[inside], runs.right()[inside], runs.rows()[inside]  # (n,)
    powers = None
    if lab is not None:
        powers = _power_sums(lab, np.stack([rows, left, right], 1), label, len(sizes), resources)
    length = (right - left).astype(np.int64)
    # exact: sums of integers below 2^53
    twice_x, y = left.astype(np.int64) + right - 1, rows.astype(np.int64)
    if any(grid.periods):  # a run counts where it is nearest to the first of its superpixel
        first = np.unique(label, return_index=True)[1][label]
        for places, period in ((twice_x, 2 * grid.periods[0]), (y, grid.periods[1])):
            if period:
                places += period * np.rint((places[first] - places) / period).astype(np.int64)
    x = np.bincount(label, twice_x * length, len(sizes)) / 2
    y = np.bincount(label, y * length, len(sizes))
    return Superpixels(
        window=part.window,
        labels=label_part(part, runs),
        sizes=sizes,
        positions=np.stack([x, y], 1) / sizes[:, None],
        power_sums=powers,
        edges=np.stack([pieces.borders.a, pieces.borders.b], 1).astype(np.int32),
        sigma=grid.scale,
        compactness=grid.compactness,
        runs=runs,
        reduced=reduced,
        periods=grid.periods,
    )


def _power_sums(lab: LabGrid, runs: np.ndarray, label: np.ndarray, count: int, resources: Resources) -> np.ndarray:
    """(count, 3, 5) from runs (n, 3): row, first column, column after the last, sorted by row."""
    if count == 0:
        return np.zeros((0, 3, 5))
    device = resources.device
    run = device.program("superpixels")
    with Buffers(device, {"powers": 8 * _SUMS * count}, resources.budget, f"{count} superpixels") as buffers:
        device.fill(buffers["powers"], np.int64(0), _SUMS * count)
        for band in lab.bands():
            begin, end = np.searchsorted(runs[:, 0], (band.top, band.bottom))
            order = np.argsort(label[begin:end].astype(np.uint16 if count <= 1 << 16 else np.int32), kind="stable")
            starts = np.searchsorted(label[begin:end][order], np.arange(count + 1))
            tables = device.upload(offset_table(starts)), device.upload(runs[begin:end][order])
            run("powers", (count,), band.lab, *tables, buffers["powers"], count, lab.width, band.top, team=True)
        # superpixels x (L, a, b) x sums, those of the fourth and fifth power in two halves
        sums = device.read(buffers["powers"], (count, 3, 7), np.int64).astype(np.float64)
    upper = 2.0**32
    powers = [sums[..., 0], sums[..., 1], sums[..., 2], sums[..., 3] + upper * sums[..., 4]]
    powers.append(sums[..., 5] + upper * sums[..., 6])
    return np.stack(powers, -1) / float(FINE_STEPS) ** np.arange(1, 6)


def _squares(end: np.ndarray) -> np.ndarray:
    """0^2 + 1^2 + ... + (end - 1)^2."""
    n = end.astype(np.float64)
    return (n - 1) * n * (2 * n - 1) / 6


def label_part(part: Part, runs: Runs) -> Part:
    """A label map of `part` as a separate part: ids from 1, 0 where runs are OUTSIDE."""
    spec = label_spec(part.spec)
    whole = part.window

    def fetch(window: Window) -> np.ndarray:
        rows, columns = window.inside(whole)
        ids = np.ascontiguousarray(runs.pixels(rows.start, rows.stop, columns.start, columns.stop))
        ids += 1
        return ids.view(np.uint32)[..., None]

    return Part("superpixels", spec, fetch, spec.format, ready=True, exact=True)


def label_spec(spec: oiio.ImageSpec) -> oiio.ImageSpec:
    """The spec of a label map of an image: one uint32 channel of data with the same windows, which tiles alike."""
    new = tiled_spec(derived_spec(spec), tiling_of(spec))
    new.set_format(oiio.TypeDesc(oiio.UINT32))
    new.channelformats = ()
    new.nchannels, new.channelnames, new.alpha_channel, new.z_channel = 1, ("Y",), -1, -1
    mark_as_data(new)
    return new
