# SPDX-License-Identifier: Apache-2.0
"""The maps of a surface from several photos, in one pass over bands of all of them.

Maps are stored as rows, in files beyond a quarter of the memory budget, so that memory does not grow with the photos.
Only misfits of highlights are held, 32 bytes for a cell of 64 pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ...engine.color.lens import Lens
from ...engine.core.demand import BAND_BYTES, rows_for
from ...engine.core.image import Image, Part, dtype_of
from ...engine.core.scratch import RowStore, empty_rows
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import present
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from .integration import integrate, row_slices
from .lights import Lights
from .lobes import CELL, WIDTHS, between_cells, in_cells, lobe_misfits, refined, roughness_of, shown_by, subtracted
from .photometric import FEWEST, albedo_of, fitted, shading, slopes_of
from .photos import Piece, nonlinear, piece_of

_CELL_BYTES = 3 * 4 * WIDTHS  # of a cell: its misfits, and those of its neighborhood
_FIT_BYTES = 148  # peak per pixel and photo that a thread fits
_PIECE = 1 << 14  # pixels of all photos that a thread fits at once
_SHADOW = 0.5  # weight below which an observation that is darker than the matte surface is a shadow


@dataclass(frozen=True)
class Captured:
    """Maps as rows: arrays, or files beyond the budget.

    `albedo` (height, width, channels) of the photos' type; `slopes` (height, width, 2) float32, right and down, NaN in
    gaps; `heights` (height, width) float32, px. `roughness` (rows, columns) float32, of cells. `clipped` (n,): shares.
    `whole`: the data window.
    """

    albedo: np.ndarray | RowStore
    slopes: np.ndarray | RowStore
    heights: np.ndarray | RowStore
    roughness: np.ndarray | None
    clipped: np.ndarray
    whole: Window

    def fetches(self, down: bool) -> tuple[dict[str, Callable[[Window], np.ndarray]], float]:
        """Functions that return windows of each map, and the height of 1, px; `down`: green points down."""
        low, high = _range(self.heights)
        most = max(high - low, 1e-6)

        def height(window: Window) -> np.ndarray:
            return (self._rows(self.heights, window)[..., None] - np.float32(low)) / np.float32(most)

        def normal(window: Window) -> np.ndarray:
            slopes = np.nan_to_num(self._rows(self.slopes, window), nan=0.0)
            vectors = np.stack([-slopes[..., 0], slopes[..., 1], np.ones(slopes.shape[:2], np.float32)], -1)
            vectors[..., 1] *= -1 if down else 1
            length = np.sqrt(1 + slopes[..., 0] * slopes[..., 0] + slopes[..., 1] * slopes[..., 1])
            return np.float32(0.5) + np.float32(0.5) * vectors / length[..., None]

        def roughness(window: Window) -> np.ndarray:
            rows, columns = (np.arange(place.start, place.stop) for place in window.inside(self.whole))
            return between_cells(present(self.roughness), rows, columns)[..., None]

        def albedo(window: Window) -> np.ndarray:
            return self._rows(self.albedo, window)

        return {"albedo": albedo, "normal": normal, "height": height, "roughness": roughness}, most

    def _rows(self, values: np.ndarray | RowStore, window: Window) -> np.ndarray:
        return values[window.inside(self.whole)]


def _range(heights: np.ndarray | RowStore) -> tuple[float, float]:
    """The least and the largest height."""
    limits = [(float(rows.min()), float(rows.max())) for rows in (heights[at] for at in row_slices(heights.shape))]
    return min(low for low, _ in limits), max(high for _, high in limits)


@dataclass(frozen=True)
class _Fitted:
    albedo: np.ndarray  # (height, width, channels)
    slopes: np.ndarray  # (height, width, 2)
    lobes: np.ndarray | None  # (WIDTHS, rows, columns) of cells
    clipped: np.ndarray  # (n,) numbers of pixels


def cells_of(size: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of cells of an image of (width, height)."""
    width, height = size
    return math.ceil(height / CELL), math.ceil(width / CELL)


def bytes_for(photos: Sequence[Image], rough: bool, threads: int) -> int:
    """Peak memory of `captured`, without what it stores in files."""
    part, count = photos[0].first, len(photos)
    rows, columns = cells_of(part.window.size)
    band = _band_rows(part, count) * part.spec.width * part.pixel_bytes * (count + 2)
    fits = threads * count * _FIT_BYTES * min(_PIECE, part.spec.width * part.spec.height)
    return band + fits + rough * _CELL_BYTES * rows * columns


def _band_rows(part: Part, count: int) -> int:
    """Rows of a band of all photos."""
    return min(rows_for(part, 4 * BAND_BYTES // count, CELL), math.ceil(part.spec.height / CELL) * CELL)


def captured(
    photos: Sequence[Image],
    lenses: Sequence[Lens],
    lights: Lights,
    hidden: Window | None,
    strength: float,
    rough: bool,
    resources: Resources,
    progress: Progress,
) -> Captured:
    """The maps.

    Parameters
    ----------
    photos, lenses : sequences
        Of the same data window.
    lights : Lights
        With intensities.
    hidden : Window or None
        Where no surface is seen: a gap.
    strength : float
        Multiplier of the slopes.
    rough : bool
        Whether to find roughness.
    """
    fitting, integrating = progress.stages(3, 1)
    first, whole = photos[0].first, photos[0].first.window
    size = whole.height, whole.width
    small = whole.height * whole.width * (first.pixel_bytes + 12) <= resources.budget // 4
    albedo = empty_rows((*size, first.spec.nchannels), dtype_of(first.spec), small)
    slopes, heights = empty_rows((*size, 2), np.float32, small), empty_rows(size, np.float32, small)
    sums = np.zeros((WIDTHS, *cells_of(whole.size)), np.float32) if rough else None
    clipped = np.zeros(len(photos), np.int64)

    def look(given: tuple[Window, list[np.ndarray]]) -> _Fitted:
        return _fit(given[1], given[0], lenses, lights, hidden, strength)

    for band in whole.cells(whole.width, _band_rows(first, len(photos))):
        rows = [photo.first.read(band) for photo in photos]
        pieces = list(band.cells(_PIECE // CELL, CELL, (whole.left, whole.top)))
        given = [(piece, [one[piece.inside(band)] for one in rows]) for piece in pieces]
        painted = np.empty_like(rows[0])
        sloped = np.empty((*painted.shape[:2], 2), np.float32)
        for piece, found in zip(pieces, resources.spread(look, given), strict=True):
            at = piece.inside(band)
            painted[at], sloped[at] = found.albedo, found.slopes
            clipped += found.clipped
            if sums is not None and found.lobes is not None:
                top, left = (place.start // CELL for place in piece.inside(whole))
                high, wide = found.lobes.shape[1:]
                sums[:, top : top + high, left : left + wide] = found.lobes
        albedo[band.inside(whole)[0]], slopes[band.inside(whole)[0]] = painted, sloped
        fitting.advance(band.bottom - whole.top, whole.height)
    integrate(slopes, heights)
    roughness = None if sums is None else roughness_of(sums)
    integrating.advance(1, 1)
    return Captured(albedo, slopes, heights, roughness, clipped / (whole.width * whole.height), whole)


def _fit(
    rows: Sequence[np.ndarray],
    piece: Window,
    lenses: Sequence[Lens],
    lights: Lights,
    hidden: Window | None,
    strength: float,
) -> _Fitted:
    """The surface in a piece of the photos."""
    seen = piece_of(rows, lenses)
    y, x = np.indices(seen.opaque.shape) + 0.5
    toward, power = lights.at((x + piece.left).ravel(), (y + piece.top).ravel())
    luminance, color = seen.luminance / power, seen.color / power[:, None]
    fit, lobes = fitted(luminance, toward, seen.valid), None
    normals = fit.normals
    if len(rows) > FEWEST:  # three photos are explained by a matte surface, whatever they show
        over = luminance - np.maximum(shading(fit.normals, toward), 0) * fit.albedo
        lit = ((over >= 0) | (fit.weights >= _SHADOW)) & seen.valid & seen.opaque.ravel()
        lobes = in_cells(lobe_misfits(over, lit, fit, toward).reshape(WIDTHS, *seen.opaque.shape))
        shown = shown_by(lobes, seen.opaque.shape, len(rows))
        matte, (fit, bright) = fit, subtracted(luminance, toward, fit, shown)
        normals = refined(luminance, toward, seen.valid, matte, shown) if lights.known else fit.normals
        color -= bright[:, None]
    albedo = albedo_of(color, fit.normals, toward, fit.weights).T
    slopes = slopes_of(normals).T.reshape(*seen.opaque.shape, 2) * np.float32(strength)
    slopes[~seen.opaque] = np.nan
    if hidden is not None and not (hidden & piece).empty:
        slopes[(hidden & piece).inside(piece)] = np.nan
    return _Fitted(_painted(rows[0], seen, albedo, lenses[0]), slopes, lobes, (~seen.valid).sum(1))


def _painted(rows: np.ndarray, seen: Piece, albedo: np.ndarray, lens: Lens) -> np.ndarray:
    """The albedo (pixels, 3) as pixels of the first photo."""
    values = seen.values
    values[..., :3] = nonlinear(albedo.reshape(*seen.opaque.shape, 3), lens)
    return lens.replaced(rows, values, None if seen.opaque.all() else seen.opaque)
